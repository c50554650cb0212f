"""``vibroswarm tradeoff``: decision time against error over p_c and O_c, on shared motion.

p_c is the credible threshold: a robot decides when its belief in an answer exceeds it. O_c is the number of
observations that it must exceed to decide. The motion of each run is simulated once, and decisions are computed on it
for every pair of p_c and O_c.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import (
    add_json,
    add_out,
    add_pictures,
    add_scenario_options,
    add_seed,
    add_style,
    add_workers,
    list_of,
    real,
    wants_picture_files,
    whole,
)

if TYPE_CHECKING:
    import polars as pl

THRESHOLDS = "0.7,0.8,0.9,0.95,0.98,0.99"
"""Default of ``--thresholds``: values of p_c."""
OBSERVATIONS = "0,50,100,200,300,400,600"
"""Default of ``--observations``: values of O_c."""
MARKER = "tradeoff.csv"
"""File by which ``whole_folder`` recognises a folder that this command wrote and may replace."""


def add_parser(commands: Any) -> None:
    """Add the command ``tradeoff`` and its options to the program's commands."""
    parser = commands.add_parser(
        "tradeoff",
        help="decision time against error, over p_c and O_c",
        description="Decision time against error for each credible threshold and minimum of observations, by replay.",
    )
    add_seed(add_scenario_options(parser))
    options = parser.add_argument_group("settings compared")
    options.add_argument(
        "--thresholds",
        metavar="P,...",
        type=list_of(real),
        default=THRESHOLDS,  # a text: argparse converts it like a value that the user gives
        help=f"p_c (default {THRESHOLDS})",
    )
    options.add_argument(
        "--observations",
        metavar="N,...",
        type=list_of(whole),
        default=OBSERVATIONS,
        help=f"O_c (default {OBSERVATIONS})",
    )
    options.add_argument("--runs", metavar="N", type=whole, default=300, help="runs (default 300)")
    add_workers(options, "threads (default 2)", default=2)
    add_json(options)
    add_out(options, "save table, report and scenario here", force=True)
    add_style(options)
    add_pictures(options)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Compute time and error of every pair of p_c and O_c on the same runs; print the Pareto front and save the curve.

    Returns the exit code.
    """
    from vibroswarm.analysis.tradeoff import time_error_curve
    from vibroswarm.cli.out_folder import claim, deliver, hash_of, refuse_other
    from vibroswarm.cli.output import print_line, print_paragraph, print_saved
    from vibroswarm.cli.progress import say_compiling
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.core.atomic_io import whole_folder
    from vibroswarm.report.html import write_report
    from vibroswarm.study.summary import write_table
    from vibroswarm.study.tradeoff_report import answer, front_picture, report_of

    scenario = scenario_from(arguments)
    work = hash_of(
        scenario.hash, arguments.seed, arguments.runs, arguments.thresholds, arguments.observations
    )
    # An existing folder is accepted only if it holds results of the same settings, or with --force. at_once=False: the
    # older folder stays until the new one is complete and replaces it.
    claim(arguments, lambda: refuse_other(arguments.out, "tradeoff", work), at_once=False)
    say_compiling()
    curve = time_error_curve(
        scenario,
        arguments.seed,
        arguments.runs,
        arguments.thresholds,
        arguments.observations,
        workers=arguments.workers,
    )

    def show() -> None:
        for sentence in answer(curve, scenario):
            print_paragraph(sentence)
        print_line()
        _print_front(curve)

    def deliver_to(part: Path | None) -> None:
        """Print the results, and save the printed text in the folder ``part`` if there is one."""
        deliver(arguments, part, "tradeoff", show, curve.to_dicts, work=work)

    if arguments.out is None:
        deliver_to(None)
    else:
        # Asked of the older folder, which is replaced.
        style = arguments.style if wants_picture_files(arguments, "front.svg") else None
        # replace=True even without --force: `claim` has accepted the folder.
        with whole_folder(arguments.out, replace=True, marker=MARKER) as part:
            write_table(curve, part / "tradeoff")
            if style is not None:
                front_picture(curve, style).write(part / "front")
            report = report_of(curve, scenario, arguments.seed, with_picture=not arguments.no_pictures)
            write_report(part / "report.html", report)
            (part / "scenario.toml").write_text(scenario.to_toml(), encoding="utf-8")
            deliver_to(part)
    picture = "front (picture), " if arguments.pictures else ""
    print_saved(arguments, f"tradeoff.csv, {picture}scenario.toml", "report.html")
    return 0


def _print_front(curve: pl.DataFrame) -> None:
    """Print the settings on the Pareto front, the fastest first.

    A setting is on the front if no other one is at least as good in decision time and error, and better in one of them.

    Args:
        curve: result of ``time_error_curve``: one row for each setting, a pair of p_c and O_c.
    """
    from vibroswarm.cli.output import print_paragraph, print_table

    def limits(row: dict[str, Any], name: str, scale: float, form: str) -> str:
        """Format the figure in column ``name`` with its limits, multiplied by ``scale`` and in the format ``form``.

        A figure without limits, such as the time of a single run, is formatted alone.
        """
        values = [row[name + end] for end in ("", "_low", "_high")]
        estimate, *limits = [f"{scale * value:{form}}" for value in values if value is not None]
        return f"{estimate} [{', '.join(limits)}]" if limits else estimate

    # The column "pareto" is true for the settings on the front.
    front = curve.filter("pareto").sort("decision_time_s")
    print_paragraph(
        f"Pareto front of {curve.height} settings, {curve['runs'][0]} runs each (95 % intervals over runs):"
    )
    print_table(
        ["p_c", "O_c", "decision time, s", "robots wrong, %", "robots undecided, %"],
        [
            [
                f"{row['credible_threshold']:g}",
                row["min_observations"],
                limits(row, "decision_time_s", scale=1, form=".0f"),
                limits(row, "error", scale=100, form=".1f"),
                f"{100 * row['robots_undecided']:.1f}",
            ]
            for row in front.iter_rows(named=True)
        ],
        names=2,  # p_c and O_c name a row
    )
