"""``vibroswarm run``: one inspection, from a floor to a verdict."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import (
    add_json,
    add_motion,
    add_out,
    add_scenario_options,
    add_seed,
    real,
)
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.result import Result
    from vibroswarm.scenario.scenario import Scenario

EPILOG = """\
examples:
  vibroswarm run                                        the paper's setting, no feedback
  vibroswarm run --strategy soft --seed 2 --out first   save tables, picture and page in 'first'
  vibroswarm run --floor diagonal:0.46 --robots 8 --watch
  vibroswarm run --floor world.txt --tiles 5x5 --set decision.decision_boundary=0.03 --set decision.boundary_of=tiles
"""


def speed(text: str) -> float:
    """Return a speed of playback."""
    value = real(text, 0, 1e6)
    if value == 0:
        raise argparse.ArgumentTypeError(f"'{text}' is not above 0")
    return value


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "run",
        help="run one inspection and print its verdict",
        description="Run one inspection: a swarm on a floor, from start to verdict.",
        epilog=EPILOG,
    )
    scenario = add_scenario_options(parser)
    add_seed(scenario)
    add_motion(scenario)
    out = parser.add_argument_group("output")
    add_out(out, "save scenario, tables, picture and page here", force=True)
    out.add_argument(
        "--watch",
        metavar="SPEED",
        type=speed,
        nargs="?",
        const=60.0,
        help="play the run back in the terminal, SPEED times as fast (default 60)",
    )
    add_json(out)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Simulate, save, play back and print the verdict."""
    from vibroswarm.cli.scenario_options import chosen, scenario_from
    from vibroswarm.core.atomic_io import check_folder

    scenario = scenario_from(arguments)
    if arguments.force and arguments.out is None:
        raise InputError("has no effect without --out DIR", field="--force")
    if arguments.out is not None:
        check_folder(arguments.out, replace=arguments.force)
    motion = chosen("motion", arguments.motion)
    with_segments = arguments.out is not None or arguments.watch is not None
    result = _simulate(scenario, arguments.seed, motion, with_segments)
    if arguments.out is not None:
        _save(result, arguments.out, replace=arguments.force)
    if arguments.watch is not None:
        if result.segments is None:
            raise InputError(
                f"'{arguments.motion}' has no positions between samples; cannot play back", field="--watch"
            )
        if not arguments.json:
            from vibroswarm.cli.watch import play

            play(result, arguments.watch)
    _print_verdict(result, arguments)
    return 0


def _simulate(scenario: Scenario, seed: int, motion: str, segments: bool) -> Result:
    """Simulate one run with a progress bar."""
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.simulation import simulate

    with progress_bar("simulating") as progress:
        return simulate(scenario, seed, 1, motion=motion, segments=segments, progress=progress)


def _save(result: Result, out: Path, *, replace: bool) -> None:
    """Write the folder of a result, completely or not at all."""
    from vibroswarm.core.atomic_io import whole_folder
    from vibroswarm.plots.run import write_run_picture
    from vibroswarm.run_page.write import write_run_page

    with whole_folder(out, replace=replace) as part:
        result.write_into(part)
        write_run_picture(result, part / "run.png")
        if result.segments is not None:
            write_run_page(result, part / "run.html")


def _print_verdict(result: Result, arguments: argparse.Namespace) -> None:
    """Print the verdict, warnings, and where the result is saved."""
    from vibroswarm.analysis.decidability import decidability
    from vibroswarm.analysis.verdict import verdict
    from vibroswarm.cli.output import print_json, print_paragraph
    from vibroswarm.cli.verdict_text import verdict_text

    summary = verdict(result)
    decidable = decidability(result.scenario, floor=result.floor())
    warnings = [decidable.says] if decidable.is_warning else []
    if arguments.json:
        print_json(
            {
                "scenario_hash": result.scenario.hash,
                "seed": result.seed,
                "out": None if arguments.out is None else str(arguments.out),
                "verdict": summary.as_dict(),
                **({} if result.faults is None else {"faults": result.faults.drop("run").to_dicts()}),
                "warnings": warnings,
                "versions": dict(result.versions),
            }
        )
        return
    print(verdict_text(result, summary))
    for warning in warnings:
        print_paragraph(f"Warning: {warning}")
    if arguments.out is None:
        print_paragraph("Not saved; add --out DIR to save scenario, tables, picture and page")
    else:
        print(f"Saved in {arguments.out}: scenario, tables and run.png")
        if result.segments is not None:
            print(f"Page: open {(arguments.out / 'run.html').resolve()} in a browser")
        else:
            print(f"No page: '{arguments.motion}' has no positions between samples")
    sys.stdout.flush()
