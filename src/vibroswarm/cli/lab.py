"""``vibroswarm lab``: recordings of real robots, read, replayed and measured."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli import lab_export, lab_replay, lab_threshold
from vibroswarm.cli.options import add_scenario_options
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.lab.recording import Recording

EPILOG = """\
examples:
  vibroswarm lab import day1.csv day2.csv --floor world.txt --tiles 5x5 --out lab
  vibroswarm lab import camera.csv --columns columns.toml --floor world.txt --tiles 5x5 --out lab
"""


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "lab",
        help="read recordings of real robots, replay and measure them",
        description="Recordings of real robots, in the tables of a simulation.",
        allow_abbrev=False,
    )
    tasks = parser.add_subparsers(title="tasks", metavar="TASK", dest="task")
    _add_import(tasks)
    lab_export.add_parser(tasks)
    lab_replay.add_parser(tasks)
    lab_threshold.add_parser(tasks)
    parser.set_defaults(run=lambda arguments: parser.print_help() or 0, parser=parser)


def _add_import(tasks: Any) -> None:
    parser = tasks.add_parser(
        "import",
        help="logs of sessions into a folder that is read as a result",
        description="Read logs of sessions (one file each) of the same robots on one floor.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("logs", metavar="LOG", nargs="+", type=Path, help="a session each")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="keep the recording here")
    parser.add_argument("--force", action="store_true", help="replace a result that is there")
    parser.add_argument("--reader", metavar="NAME", help="the kind of log, where it is not seen by itself")
    parser.add_argument("--columns", metavar="MAP", type=Path, help="read any CSV by this column map (TOML)")
    parser.add_argument(
        "--known-robots", metavar="A,B", help="the robots that there are, as the logs call them"
    )
    parser.add_argument("--any-floor", action="store_true", help="go on where the floor does not fit")
    parser.add_argument("--json", action="store_true", help="say what was read as JSON")
    add_scenario_options(parser)
    parser.set_defaults(run=run_import, parser=parser)


def run_import(arguments: argparse.Namespace) -> int:
    """Read, check, keep, tell."""
    from vibroswarm.cli.scenarios import scenario_from
    from vibroswarm.files import check_folder, whole_folder
    from vibroswarm.lab.readers import read_log
    from vibroswarm.lab.recording import recording_of
    from vibroswarm.scenario import parse_setting

    check_folder(arguments.out, replace=arguments.force)
    if arguments.floor is None and arguments.scenario is None:
        raise InputError("is needed: on which floor were the robots?", field="--floor")
    scenario = scenario_from(arguments)
    if scenario.floor.drawn_by_run:
        raise InputError("is random; a recording was made on one floor: name its file", field="--floor")
    stated = [parse_setting(text)[0] for text in arguments.settings]
    stated += ["strategy.name"] if arguments.strategy is not None else []
    logs = [read_log(path, arguments.reader, arguments.columns) for path in arguments.logs]
    recording = recording_of(
        logs,
        scenario.floor_for(0, 0),
        scenario,
        stated,
        robots=_robots(arguments.known_robots),
        any_floor=arguments.any_floor,
    )
    with whole_folder(arguments.out, replace=arguments.force) as part:
        recording.write_into(part)
        pages = _pages(recording, part)
    _say_import(recording, arguments, pages)
    return 0


def _robots(text: str | None) -> list[int] | None:
    if text is None:
        return None
    try:
        found = [int(one) for one in text.split(",")]
    except ValueError:
        found = []
    if not found or len(set(found)) != len(found) or min(found) < 0:
        raise InputError(f"'{text}' names no robots; say for example 1,2,3,4,5", field="--known-robots")
    return found


def _pages(recording: Recording, folder: Path) -> list[str]:
    """Page and picture of each session; with what robots would have believed where the log does not tell."""
    from vibroswarm.lab.replay import with_beliefs
    from vibroswarm.page.from_result import record_of
    from vibroswarm.page.write import write_page
    from vibroswarm.plots.run import write_run_picture

    made = []
    logged = _logs_beliefs(recording)
    shown = recording if logged else with_beliefs(recording)
    runs = recording.runs["run"].to_list()
    for run in runs:
        name = "run" if len(runs) == 1 else f"run-{run + 1}"
        write_run_picture(recording, folder / f"{name}.png", run)
        title = str(recording.sessions[run]["log"]) + ("" if logged else " (beliefs replayed, not logged)")
        write_page(record_of(shown, run, title=title), folder / f"{name}.html")
        made.append(f"{name}.html")
    return made


def _logs_beliefs(recording: Recording) -> bool:
    return bool(recording.inference.drop("message").null_count().sum_horizontal()[0] == 0)


def _say_import(recording: Recording, arguments: argparse.Namespace, pages: list[str]) -> None:
    from vibroswarm.lab.recording import told_lines

    if arguments.json:
        about = {
            "out": str(arguments.out),
            "names": list(recording.names),
            "sessions": [dict(one) for one in recording.sessions],
            "stated": list(recording.stated),
            "inferred": [dict(one) for one in recording.inferred],
            "floor": recording.floor_words,
            "consensus": recording.runs["consensus"].to_list(),
            "pages": pages,
        }
        print(json.dumps(about, indent=2, allow_nan=False))
        return
    print("\n".join(told_lines(recording)))
    print(recording.floor_words)
    print("\nWhat the robots ran with, as the logs tell:")
    for one in recording.inferred:
        print(_inferred_line(recording, one))
    for run, consensus, time_s in recording.runs.select("run", "consensus", "consensus_time_s").iter_rows():
        at = "" if time_s is None else f", by {time_s:.1f} s"
        came_to = "decisions are not logged" if consensus is None else f"consensus {consensus}{at}"
        print(f"{'' if run else chr(10)}session {run + 1}: {came_to}")
    print(f"Kept in {arguments.out}: tables, pictures, pages {', '.join(pages)}.")
    if not _logs_beliefs(recording):
        print(
            "The logs do not tell what the robots believed: the pages show what they would have, all hearing all."
        )


def _inferred_line(recording: Recording, one: Any) -> str:
    value = "cannot be told" if one["value"] is None else f"{one['value']}"
    against = ""
    if one["name"] in recording.stated and one["value"] is not None:
        section, _, name = one["name"].partition(".")
        said = getattr(getattr(recording.scenario, section), name)
        alike = said == one["value"]
        fits = alike or (one["low"] is not None and one["low"] - 1e-9 <= said <= one["high"] + 1e-9)
        against = f" (stated: {said}{'' if fits else ', WHICH DOES NOT FIT'})"
    return f"  {one['name']} = {value}{against}\n      {one['evidence']}"
