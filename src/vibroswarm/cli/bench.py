"""``vibroswarm bench``: how fast it is here, against the fixed-step engine and against peers."""

from __future__ import annotations

import argparse
import json
from itertools import groupby
from typing import TYPE_CHECKING, Any

from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.bench import Figure, Report

MOST_ROBOTS = 10_000
MOST_RUNS = 100_000


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "bench",
        help="measure the speed here, side by side with the fixed-step engine",
        description="Measure motion by both engines, observation and inference, in CPU time (about 30 s).",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--robots", metavar="N,N", help="how many robots, one number or several (default 5,10,100,1000)"
    )
    parser.add_argument("--runs", metavar="N", help="runs of each turn; more is steadier (default 16)")
    parser.add_argument(
        "--peers", action="store_true", help="also other simulators that are installed: pymunk"
    )
    parser.add_argument("--json", action="store_true", help="give the figures as JSON, and nothing else")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Measure and say it."""
    robots = None if arguments.robots is None else robots_of(arguments.robots)
    runs = None if arguments.runs is None else number(arguments.runs, "--runs", MOST_RUNS)
    from vibroswarm.bench import ROBOTS, RUNS, measure
    from vibroswarm.cli.progress import progress_bar

    with progress_bar("measuring") as progress:
        report = measure(robots or ROBOTS, runs or RUNS, peers=arguments.peers, progress=progress)
    if arguments.json:
        print(json.dumps(report.as_dict(), indent=2, allow_nan=False))
    else:
        print("\n".join(lines(report)))
    return 0


def robots_of(text: str) -> list[int]:
    """``5,10`` as numbers, each once."""
    return list(dict.fromkeys(number(part, "--robots", MOST_ROBOTS) for part in text.split(",")))


def number(text: str, option: str, most: int) -> int:
    """A whole number from 1 to ``most``."""
    from vibroswarm.cli.scenarios import whole_number

    value = whole_number(text.strip(), option)
    if not 1 <= value <= most:
        raise InputError(f"{value} is not from 1 to {most}", field=option)
    return value


def lines(report: Report) -> list[str]:
    """The report as plain text."""
    from textwrap import fill

    of, made = report.machine, report.versions
    named = ", ".join(
        f"{name} {made[name]}" for name in ("python", "numpy", "numba", "polars", "pymunk") if name in made
    )
    text = [
        f"vibroswarm {made['vibroswarm']} (code {made['code']}), {named}",
        f"{of['cpu']}, {of['cores']} cores, {of['system']}",
        fill(report.how[0].upper() + report.how[1:] + ".", 100),
    ]
    for _, group in groupby(
        report.figures, key=lambda figure: (figure.robots, figure.side_m, figure.yardstick is None)
    ):
        text += ["", *table(list(group))]
    text += [
        "",
        f"34 strategies (3; soft with 8 eta x 4 kappa) on one motion: {report.grid_ratio:.2f} times the cost of one "
        "with its motion",
    ]
    text += [f"{peer} is not installed: {install}" for peer, install in report.missing.items()]
    return text


def table(figures: list[Figure]) -> list[str]:
    """Works of one swarm, one a line."""
    first = figures[0]
    is_motion, side_m = first.yardstick is not None, first.side_m
    robots = f"{first.robots} robot{'' if first.robots == 1 else 's'}"
    head = f"{'motion' if is_motion else 'stages'}, {robots} in {side_m:g} m x {side_m:g} m"
    rows = [
        head,
        f"  {'':<26}{'simulated s':>11} {'ms a run':>10}  {'least - most':<17} {'s per CPU s':>12} "
        f"{'us a robot-s':>12} {'x fixed-step' if is_motion else '':>12}",
    ]
    for figure in figures:
        spread = f"{min(figure.times_ms):.4g} - {max(figure.times_ms):.4g}"
        ratio = "" if figure.yardstick is None else f"{figure.yardstick:.3g}"
        rows.append(
            f"  {figure.work:<26}{figure.simulated_s:>11g} {figure.median_ms:>10.4g}  {spread:<17} "
            f"{figure.speed:>12,.0f} {figure.robot_second_us:>12.3g} {ratio:>12}".rstrip()
        )
    return rows
