"""``vibroswarm calibrate effect``: what changes when calibrated robots are simulated."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.calibrate_fit import scenario_of, share_done
from vibroswarm.cli.options import add_json, add_settings, between, whole

if TYPE_CHECKING:
    from vibroswarm.calibrate.effect import Effect


def add_parser(tasks: Any) -> None:
    """Add the task."""
    parser = tasks.add_parser(
        "effect",
        help="effect of calibrated robots on decision time, accuracy and consensus",
        description="Compare two presets or scenario files on the same floors, for three strategies; paired by run, "
        "and repeated on other seeds.",
        epilog="example:\n  vibroswarm calibrate effect paper calibrated --runs 1000",
    )
    parser.add_argument(
        "first", metavar="FIRST", nargs="?", default="paper", help="preset or file (default paper)"
    )
    parser.add_argument(
        "second",
        metavar="SECOND",
        nargs="?",
        default="calibrated",
        help="preset or file (default calibrated)",
    )
    parser.add_argument(
        "--runs",
        metavar="N",
        type=between(whole, 2, 100_000),
        default=1000,
        help="runs of each scenario and seed (default 1000)",
    )
    parser.add_argument(
        "--seed",
        metavar="S",
        type=between(whole, 0, 2**62),
        default=1,
        help="first of two seeds (default 1)",
    )
    add_settings(parser, "set a field of both scenarios")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Simulate both scenarios and print the comparison."""
    from vibroswarm.calibrate.effect import effects
    from vibroswarm.cli.output import print_json

    first, second = (scenario_of(name, arguments.settings) for name in (arguments.first, arguments.second))
    results = effects(first, second, arguments.runs, arguments.seed, progress=share_done("runs"))
    if arguments.json:
        print_json([effect.as_dict() for effect in results])
    else:
        print_effects(results, (arguments.first, arguments.second))
    return 0


def print_effects(found: list[Effect], names: tuple[str, str]) -> None:
    """Print the figures of both scenarios, and their differences."""
    from vibroswarm.cli.output import print_paragraph, print_table, with_interval

    print_table(
        [
            "strategy",
            "scenario",
            "decision time, s",
            "belief in the truth",
            "right, %",
            "wrong, %",
            "split, %",
            "incomplete, %",
        ],
        [
            [
                effect.strategy,
                name,
                with_interval(figures["decision_time_s"], ".0f"),
                with_interval(figures["belief_in_truth"], ".3f"),
                *(f"{100 * share:.1f}" for share in shares.values()),
            ]
            for effect in found
            for name, figures, shares in zip(names, effect.figures, effect.consensus, strict=True)
        ],
        names=2,
    )
    print()
    print_paragraph(f"{names[1]} - {names[0]}, paired by run (95 %)")
    print_table(
        ["strategy", "figure", "difference", ""],
        [
            [
                effect.strategy,
                difference.first.figure,
                with_interval(
                    difference.first.difference, ".0f" if difference.first.figure.endswith("_s") else ".3f"
                ),
                difference.says,
            ]
            for effect in found
            for difference in effect.differences
        ],
        names=2,
        texts=4,
    )
