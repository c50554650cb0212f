"""``vibroswarm tradeoff``: decision time against error over p_c and O_c, on shared motion.

p_c is the credible threshold: a robot decides when its belief in an answer exceeds it. O_c is the number of
observations that it must exceed to decide. The motion of each run is simulated once, and decisions are computed on it
for every pair of p_c and O_c.
"""

from __future__ import annotations

import argparse
from typing import Any

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
    whole,
)

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
    from vibroswarm.cli.deliver import REPORT, print_result, save, save_requested_pictures
    from vibroswarm.cli.out_folder import claim, hash_of, refuse_other
    from vibroswarm.cli.output import print_saved
    from vibroswarm.cli.progress import say_compiling
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.core.atomic_io import whole_folder
    from vibroswarm.documents.tradeoff import tradeoff_document
    from vibroswarm.show.document import without_pictures
    from vibroswarm.study.summary import write_table

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

    document = tradeoff_document(curve, scenario, arguments.seed)
    if arguments.out is not None:
        # replace=True even without --force: `claim` has accepted the folder.
        with whole_folder(arguments.out, replace=True, marker=MARKER) as part:
            write_table(curve, part / "tradeoff")
            (part / "scenario.toml").write_text(scenario.to_toml(), encoding="utf-8")
            on_page = without_pictures(document) if arguments.no_pictures else document
            save(on_page, part, "tradeoff", work)
            save_requested_pictures(document, arguments, part)
    print_result(document, arguments)
    pictures = "pictures, " if arguments.pictures else ""
    print_saved(arguments, f"tradeoff.csv, {pictures}scenario.toml", REPORT)
    return 0
