"""``vibroswarm run``: one inspection, from a floor to a verdict that can be watched."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_scenario_options
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.result import Result
    from vibroswarm.scenario import Scenario

EPILOG = """\
examples:
  vibroswarm run                                        the paper's setting, no feedback
  vibroswarm run --strategy soft --seed 2 --out first   keep tables, picture and page in the folder 'first'
  vibroswarm run --floor diagonal:0.46 --robots 8 --watch
  vibroswarm run --floor world.txt --tiles 5x5 --set decision.decision_boundary=0.03 --set decision.boundary_of=tiles
"""


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "run",
        help="run one inspection and give its verdict",
        description="Run one inspection: a swarm on a floor, to a verdict that can be watched.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    what = add_scenario_options(parser)
    what.add_argument(
        "--seed", metavar="S", default="1", help="same scenario and seed: same result (default 1)"
    )
    what.add_argument(
        "--motion",
        metavar="NAME",
        default="event",
        help="engine: event (default), fixed-step, or FILE.py:NAME",
    )
    out = parser.add_argument_group("what is shown and kept")
    out.add_argument("--out", metavar="DIR", type=Path, help="keep scenario, tables, picture and page here")
    out.add_argument("--force", action="store_true", help="replace a result that is there")
    out.add_argument(
        "--watch",
        metavar="SPEED",
        nargs="?",
        const="60",
        help="play it back here, so many times as fast (60)",
    )
    out.add_argument(
        "--json", action="store_true", help="give the verdict as JSON, and nothing else, on stdout"
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate, keep, play back, and say the verdict."""
    from vibroswarm.cli.scenarios import chosen, scenario_from, whole_number
    from vibroswarm.files import check_folder

    scenario = scenario_from(arguments)
    seed = whole_number(arguments.seed, "--seed")
    speed = _speed(arguments.watch)
    if arguments.force and arguments.out is None:
        raise InputError("says to replace a result, but --out names none", field="--force")
    if arguments.out is not None:
        check_folder(arguments.out, replace=arguments.force)
    motion = chosen("motion", arguments.motion)
    result = _simulate(scenario, seed, motion, keep=arguments.out is not None or speed is not None)
    if arguments.out is not None:
        _keep(result, arguments.out, replace=arguments.force)
    if speed is not None and result.segments is None:
        raise InputError(
            f"'{arguments.motion}' does not tell where robots are between their samples", field="--watch"
        )
    if speed is not None and not arguments.json:
        from vibroswarm.cli.watch import play

        play(result, speed)
    _say(result, arguments)
    return 0


def _speed(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        speed = float(text)
    except ValueError:
        speed = float("nan")
    if not 0 < speed <= 1e6:
        raise InputError(f"'{text}' is no speed; give a number above 0, such as 60", field="--watch")
    return speed


def _simulate(scenario: Scenario, seed: int, motion: str, *, keep: bool) -> Result:
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.simulation import simulate

    with progress_bar("simulating") as progress:
        return simulate(scenario, seed, 1, motion=motion, segments=keep, progress=progress)


def _keep(result: Result, out: Path, *, replace: bool) -> None:
    """The folder of a result: scenario, tables, picture and page; whole or not at all."""
    from vibroswarm.files import whole_folder
    from vibroswarm.page.from_result import write_run_page
    from vibroswarm.plots.run import write_run_picture

    with whole_folder(out, replace=replace) as part:
        result.write_into(part)
        write_run_picture(result, part / "run.png")
        if result.segments is not None:
            write_run_page(result, part / "run.html")


def _say(result: Result, arguments: argparse.Namespace) -> None:
    from textwrap import fill

    from vibroswarm.analysis.decidability import decidability
    from vibroswarm.analysis.verdict import verdict
    from vibroswarm.cli.words import WIDTH, verdict_text

    found = verdict(result)
    decidable = decidability(result.scenario, floor=result.floor())
    warnings = [decidable.says] if decidable.is_warning else []
    if arguments.json:
        about = {
            "scenario_hash": result.scenario.hash,
            "seed": result.seed,
            "out": None if arguments.out is None else str(arguments.out),
            "verdict": found.as_dict(),
            "warnings": warnings,
            "versions": dict(result.versions),
        }
        print(json.dumps(about, indent=2, allow_nan=False))
        return
    print(verdict_text(result, found))
    for warning in warnings:
        print(fill(f"Warning: {warning}", WIDTH))
    if arguments.out is None:
        print("Nothing was kept; --out DIR keeps scenario, tables, picture and page.")
    else:
        print(f"Kept in {arguments.out}: scenario, tables and run.png.")
        if result.segments is not None:
            print(f"Watch it: open {(arguments.out / 'run.html').resolve()} in a browser.")
        else:
            print(f"No page: '{arguments.motion}' does not tell where robots are between their samples.")
    sys.stdout.flush()
