"""``vibroswarm lab``: recordings of real robots, imported, and exported as a log or as CSV."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from vibroswarm.cli import lab_replay, lab_threshold, lab_track
from vibroswarm.cli.command_line import Option, reader
from vibroswarm.cli.options import add_json, add_scenario_options, between, list_of, whole
from vibroswarm.cli.output import add_open
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.recordings.log import Log
    from vibroswarm.recordings.recording import Recording
    from vibroswarm.scenario.scenario import Scenario

EPILOG = """\
examples:
  vibroswarm lab import day1.csv day2.csv --floor world.txt --tiles 5x5 --out lab
  vibroswarm lab import camera.csv --columns columns.toml --floor world.txt --tiles 5x5 --out lab
  vibroswarm lab import tracked-1 tracked-2 --floor world.txt --tiles 5x5 --out lab
"""


def add_parser(commands: Any) -> None:
    """Add the command ``lab`` and its tasks, which are subcommands, to the program's commands."""
    parser = commands.add_parser(
        "lab",
        help="import recordings of real robots, replay and measure them",
        description="Work with recordings of real robots, as tables like those of a simulation.",
    )
    tasks = parser.add_subparsers(title="tasks", metavar="TASK", dest="task")
    _add_import(tasks)
    _add_export(tasks)
    lab_replay.add_parser(tasks)
    lab_threshold.add_parser(tasks)
    lab_track.add_parser(tasks)
    parser.set_defaults(run=lambda arguments: parser.print_help() or 0)  # without a task: help, exit code 0


def _add_import(tasks: Any) -> None:
    """Add the subcommand ``import``."""
    parser = tasks.add_parser(
        "import",
        help="import logs of sessions into a folder that can be read as a result",
        description="Read logs of sessions (one file each) of the same robots on one floor.",
        epilog=EPILOG,
    )
    parser.add_argument(
        "logs", metavar="LOG", nargs="+", type=Path, help="one log per session, or folder of 'lab track'"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="save the recording here")
    parser.add_argument("--force", action="store_true", help="replace DIR if it holds something else")
    add_open(parser, "open the page of the first session in the browser")
    parser.add_argument("--reader", metavar="NAME", help="format of the logs (default: detected)")
    parser.add_argument(
        "--columns", metavar="MAP", type=Path, help="read any CSV with this column map (TOML)"
    )
    parser.add_argument(
        "--acceleration",
        metavar="FILE",
        nargs="+",
        type=Path,
        help="recorded acceleration, one CSV per session (robot,time_s,ax,ay,az): compute energies from it",
    )
    parser.add_argument(
        "--known-robots",
        metavar="A,B",
        type=list_of(between(whole, 0)),
        help="numbers of the robots in the logs",
    )
    parser.add_argument(
        "--any-floor", action="store_true", help="continue if the floor does not fit the logs"
    )
    add_json(parser)
    add_scenario_options(parser)
    parser.set_defaults(run=run_import)


def run_import(arguments: argparse.Namespace) -> int:
    """Read and check the logs, save them as one recording and print what it holds; return the exit code.

    Some fields of the scenario are inferred from the logs: threshold, gate, sampling interval, strategy and others. If
    an option sets such a field (``stated``), the value of the option is used instead of the inferred value.
    """
    from vibroswarm.cli.deliver import print_result, save
    from vibroswarm.cli.out_folder import claim, hash_of, refuse_other
    from vibroswarm.cli.output import print_line, print_saved
    from vibroswarm.cli.scenario_options import check_one_floor, scenario_from
    from vibroswarm.core.atomic_io import whole_folder
    from vibroswarm.documents.recording import import_document
    from vibroswarm.recordings.assemble_recording import recording_of
    from vibroswarm.scenario.scenario import parse_setting

    if arguments.floor is None and arguments.scenario is None:
        raise InputError("is required: on which floor were the robots?", field="--floor")
    scenario = scenario_from(arguments)
    check_one_floor(scenario)
    # The names of the fields that --set and --strategy set. No other option sets a field that can be inferred, except
    # --preset and --scenario, whose values are replaced by inferred ones.
    stated = [parse_setting(text)[0] for text in arguments.settings]
    stated += ["strategy.name"] if arguments.strategy is not None else []
    logs, computed, files = _logs_of(arguments, scenario)
    work = hash_of(
        scenario.hash, stated, arguments.reader, arguments.known_robots, arguments.any_floor, files
    )
    # An existing folder is accepted only if it holds the result of the same import, or with --force. at_once=False: an
    # older recording stays until the new one is complete and replaces it.
    claim(arguments, lambda folder: refuse_other(folder, "lab import", work), at_once=False)
    recording = recording_of(
        logs,
        scenario.floor_for(0, 0),  # seed and run do not matter: the floor is not random
        scenario,
        stated,
        robots=arguments.known_robots,
        any_floor=arguments.any_floor,
    )
    with whole_folder(arguments.out, replace=True) as part:
        recording.write_into(part)
        pages = _pages(recording, part)
        document = import_document(recording, pages, computed)
        save(document, part, "lab import", work, page=None)
    print_result(document, arguments)
    if not arguments.json:
        print_line()
    print_saved(arguments, f"tables, pictures, pages {', '.join(pages)}", pages[0])
    return 0


def _logs_of(arguments: argparse.Namespace, scenario: Scenario) -> tuple[list[Log], list[str], list[bytes]]:
    """Read the logs, and with ``--acceleration`` compute their energies.

    Returns:
        The logs; for each log a sentence about its computed energies (an empty list without ``--acceleration``); and
        the content of each file that was read, by which a repeated import of the same files is recognised.
    """
    from vibroswarm.recordings.log_readers import log_file, named_by_folder, read_log

    files = [log_file(path) for path in arguments.logs]
    logs = [
        named_by_folder(read_log(file, arguments.reader, arguments.columns), path, file)
        for path, file in zip(arguments.logs, files, strict=True)
    ]
    logs, computed = _with_energies(logs, scenario, arguments.acceleration)
    paths = [
        *files,
        *([arguments.columns] if arguments.columns is not None else []),
        *(arguments.acceleration or ()),
    ]
    return logs, computed, [path.read_bytes() for path in paths]


def _with_energies(
    logs: list[Log], scenario: Scenario, files: list[Path] | None
) -> tuple[list[Log], list[str]]:
    """Replace the energies of logs by those computed from recorded acceleration.

    Args:
        files: the files of acceleration, one for each log in the same order; None to return the logs unchanged.
    Returns:
        The changed logs, and for each log a sentence: how its energies were computed, and how far they differ from the
        logged energies. Without files, the list of sentences is empty.
    """
    from vibroswarm.observation.observe import sense_program
    from vibroswarm.recordings.acceleration import energies_from
    from vibroswarm.robot.sensing import readings

    if files is None:
        return logs, []
    if len(files) != len(logs):
        raise InputError(f"{len(files)} files for {len(logs)} logs; give one per log", field="--acceleration")
    program = sense_program(scenario)
    computed = [energies_from(log, path, program) for log, path in zip(logs, files, strict=True)]
    words = [
        f"{item.log.name}: {item.samples} energies computed from {path} ({readings(program)} readings at "
        f"{program.rate_hz:g} Hz each); they differ from the log's by up to {item.largest_difference:.3g}"
        for item, path in zip(computed, files, strict=True)
    ]
    return [item.log for item in computed], words


def _pages(recording: Recording, folder: Path) -> list[str]:
    """Write a page and a picture of each session into ``folder``; return the names of the pages.

    The pages show beliefs. If these are not all logged, those of all sessions are computed by a replay, and the title
    of each page says so. The pictures show no beliefs, and decisions as logged.
    """
    from vibroswarm.plots.run import write_run_picture
    from vibroswarm.recordings.replay import with_beliefs
    from vibroswarm.run_page.write import record_of, write_page

    names = []
    logged = recording.logs_beliefs
    with_replayed = recording if logged else with_beliefs(recording)
    runs = recording.runs["run"].to_list()
    for run in runs:
        name = "run" if len(runs) == 1 else f"run-{run + 1}"
        write_run_picture(recording, folder / f"{name}.png", run)
        title = str(recording.sessions[run]["log"]) + ("" if logged else " (beliefs replayed, not logged)")
        write_page(record_of(with_replayed, run, title=title), folder / f"{name}.html")
        names.append(f"{name}.html")
    return names


def _add_export(tasks: Any) -> None:
    """Add the subcommand ``export``."""
    parser = tasks.add_parser(
        "export",
        help="write a result as a log of the robots or of the simulator, or as CSV",
        description="Write one run of a result (vibroswarm run --out) as a log, or all its tables as CSV.",
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of a result or recording")
    parser.add_argument(
        "--format",
        metavar="NAME",
        type=reader(Literal["rugbot", "webots", "csv"], Option("")),
        default="rugbot",
        help="rugbot (default), webots or csv",
    )
    parser.add_argument(
        "--session",
        metavar="N",
        type=between(whole, 1),
        default=1,
        help="run to write to a log, from 1 (default 1)",
    )
    parser.add_argument("--out", metavar="PATH", type=Path, required=True, help="file; for csv a folder")
    parser.add_argument("--force", action="store_true", help="replace PATH if it exists")
    parser.set_defaults(run=run_export)


def run_export(arguments: argparse.Namespace) -> int:
    """Write a session of a result as a log, or all sessions as CSV; return the exit code."""
    from vibroswarm.recordings.export import WRITERS
    from vibroswarm.result import Result

    result = Result.read(arguments.folder)
    run = (
        arguments.session - 1
    )  # runs are numbered from 0; the writer of CSV ignores `run` and writes all runs
    WRITERS[arguments.format](result, arguments.out, run, replace=arguments.force)
    print(f"Saved: {arguments.out}")
    return 0
