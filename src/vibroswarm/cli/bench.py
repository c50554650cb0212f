"""``vibroswarm bench``: speed on this machine, compared with the fixed-step engine and with peers."""

from __future__ import annotations

import argparse
from itertools import groupby
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_json, between, list_of, whole

if TYPE_CHECKING:
    from vibroswarm.cli.stage_timing import Figure, Report


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "bench",
        help="measure the speed on this machine, compared with the fixed-step engine",
        description="Measure CPU time of motion (both engines), observation and inference; takes about 30 s.",
    )
    parser.add_argument(
        "--robots",
        metavar="N,N",
        type=list_of(between(whole, 1, 10_000)),
        help="numbers of robots (default 5,10,100,1000)",
    )
    parser.add_argument(
        "--runs",
        metavar="N",
        type=between(whole, 1, 100_000),
        help="runs per turn; more give steadier figures (default 16)",
    )
    parser.add_argument("--peers", action="store_true", help="also measure installed peers: pymunk")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Measure and report."""
    from vibroswarm.cli.output import print_json
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.cli.stage_timing import ROBOTS, RUNS, measure

    with progress_bar("measuring") as progress:
        report = measure(
            arguments.robots or ROBOTS, arguments.runs or RUNS, peers=arguments.peers, progress=progress
        )
    if arguments.json:
        print_json(report.as_dict())
    else:
        print_report(report)
    return 0


def print_report(report: Report) -> None:
    """Print versions, machine, method and figures."""
    from vibroswarm.cli.output import print_paragraph

    machine, versions = report.machine, report.versions
    packages = ", ".join(
        f"{name} {versions[name]}"
        for name in ("python", "numpy", "numba", "polars", "pymunk")
        if name in versions
    )
    print(f"vibroswarm {versions['vibroswarm']} (code {versions['code']}), {packages}")
    print(f"{machine['cpu']}, {machine['cores']} cores, {machine['system']}")
    print_paragraph(report.how)
    for _, group in groupby(
        report.figures, key=lambda figure: (figure.robots, figure.side_m, figure.yardstick is None)
    ):
        print()
        print_figures(list(group))
    print(
        f"\n34 strategies (3; soft with 8 eta x 4 kappa) on one motion cost {report.grid_ratio:.2f} times as much as "
        "one strategy with its motion"
    )
    for peer, install in report.missing.items():
        print(f"{peer} is not installed: {install}")


def print_figures(figures: list[Figure]) -> None:
    """Print the figures of one swarm as a table."""
    from vibroswarm.cli.output import print_table

    first = figures[0]
    is_motion = first.yardstick is not None
    robots = f"{first.robots} robot{'' if first.robots == 1 else 's'}"
    print(f"{'motion' if is_motion else 'stages'}, {robots} in {first.side_m:g} m x {first.side_m:g} m")
    columns = ["", "simulated s", "ms per run", "min - max", "s per CPU s", "us per robot-s"]
    rows = [
        [
            f"  {figure.work}",
            f"{figure.simulated_s:g}",
            f"{figure.median_ms:.4g}",
            f"{min(figure.times_ms):.4g} - {max(figure.times_ms):.4g}",
            f"{figure.speed:,.0f}",
            f"{figure.robot_second_us:.3g}",
            *([] if figure.yardstick is None else [f"{figure.yardstick:.3g}"]),
        ]
        for figure in figures
    ]
    print_table([*columns, *(["x fixed-step"] if is_motion else [])], rows)
