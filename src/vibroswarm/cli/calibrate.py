"""``vibroswarm calibrate``: compare recordings and simulations; its tasks ``figures``, ``effect`` and ``bursts``."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli import calibrate_compare, calibrate_fit
from vibroswarm.cli.calibrate_compare import over_sessions
from vibroswarm.cli.calibrate_fit import scenario_of, share_done
from vibroswarm.cli.options import add_json, add_settings, between, read_result, real, whole
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vibroswarm.calibrate.effect import Effect
    from vibroswarm.calibrate.message_loss import Bursts, Windows

BURSTS_EPILOG = """\
example:
  vibroswarm calibrate bursts lab --errors
"""


def add_parser(commands: Any) -> None:
    """Add the command and its tasks."""
    parser = commands.add_parser(
        "calibrate",
        help="compare a simulation with recordings, and fit it to them",
        description="Compare recordings and simulations.",
    )
    tasks = parser.add_subparsers(title="tasks", metavar="TASK", dest="task")
    calibrate_compare.add_parser(tasks)
    _add_figures(tasks)
    calibrate_fit.add_parser(tasks)
    _add_effect(tasks)
    _add_bursts(tasks)
    parser.set_defaults(run=lambda arguments: parser.print_help() or 0)


def _add_figures(tasks: Any) -> None:
    """Add the task ``figures``."""
    parser = tasks.add_parser(
        "figures",
        help="how robots drive, avoid, spread and read, side by side with a simulation",
        description="Figures of one or more results (each run is a session) with 95 % intervals over sessions.",
    )
    parser.add_argument(
        "folders", metavar="DIR", type=Path, nargs="+", help="folders of recordings or simulations"
    )
    parser.add_argument(
        "--at", metavar="THETA", type=real, default=1.33, help="threshold for error rates (default 1.33)"
    )
    add_json(parser)
    parser.set_defaults(run=run_figures)


def run_figures(arguments: argparse.Namespace) -> int:
    """Print the figures of results side by side."""
    from vibroswarm.calibrate.session_statistics import FIGURES, figures_of
    from vibroswarm.cli.output import print_json, print_paragraph, print_table

    figures = {str(folder): figures_of(read_result(folder), arguments.at) for folder in arguments.folders}
    if arguments.json:
        by_folder = {
            folder: [figure.as_dict() for figure in folder_figures]
            for folder, folder_figures in figures.items()
        }
        print_json({"rms_threshold": arguments.at, "figures": by_folder})
        return 0
    rows = [
        [
            words,
            *(
                over_sessions(folder_figures[place].interval, ".3g", scale=scale)
                for folder_figures in figures.values()
            ),
        ]
        for place, (words, scale) in enumerate(FIGURES.values())
    ]
    print_table(["figure", *(Path(folder).name for folder in figures)], rows)
    print_paragraph(
        f"Errors at a threshold of {arguments.at:g}; in brackets 95 % over sessions; '-': not measurable."
    )
    return 0


def _add_effect(tasks: Any) -> None:
    """Add the task ``effect``."""
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
    parser.set_defaults(run=run_effect)


def run_effect(arguments: argparse.Namespace) -> int:
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


def _add_bursts(tasks: Any) -> None:
    """Add the task ``bursts``."""
    parser = tasks.add_parser(
        "bursts",
        help="whether robots lose messages in bursts, and the network 'bursts' fitted to that",
        description="Fit independent losses and bursts (Gilbert-Elliott, by receiver) to the counts of received "
        "messages in recordings, and compare the gaps that both expect with those found. Takes about half a minute "
        "for an hour of five robots.",
        epilog=BURSTS_EPILOG,
    )
    parser.add_argument(
        "folders", metavar="REAL", type=Path, nargs="+", help="folders of recordings (lab import)"
    )
    parser.add_argument(
        "--errors",
        action="store_true",
        help="also standard errors, by leaving out one receiver at a time (minutes)",
    )
    add_json(parser)
    parser.set_defaults(run=run_bursts)


def run_bursts(arguments: argparse.Namespace) -> int:
    """Fit, compare and print."""
    from vibroswarm.calibrate import message_loss
    from vibroswarm.cli.output import print_json

    windows = [one for folder in arguments.folders for one in message_loss.windows_of(read_result(folder))]
    if not windows:
        raise InputError("counts no received messages", field=str(arguments.folders[0]))
    if all(message_loss.lost_for_good(one).sum() == 0 for one in windows):
        raise InputError("no message is lost; there is nothing to fit", field=str(arguments.folders[0]))
    models = {
        "independent": message_loss.fit_independent(windows),
        "bursts": message_loss.fit_bursts(windows),
    }
    found = message_loss.by_size(windows)
    expected = {name: message_loss.expected_by_size(windows, model) for name, model in models.items()}
    errors = message_loss.jackknife(windows, models["bursts"]) if arguments.errors else {}
    lost_in_long, sent_in_long = message_loss.lost_in_long_windows(windows)
    if arguments.json:
        fits = {name: {**asdict(model), "aic": model.aic} for name, model in models.items()}
        gaps = {
            "from": message_loss.STEPS,
            "found": found.tolist(),
            "expected": {name: counts[0].tolist() for name, counts in expected.items()},
        }
        long = {"lost": lost_in_long, "sent": sent_in_long}
        print_json({"fits": fits, "standard_errors": errors, "gaps": gaps, "long_intervals": long})
        return 0
    _print_models(windows, models, errors)
    print()
    _print_gaps(found, expected, lost_in_long, sent_in_long)
    return 0


def _print_models(windows: list[Windows], models: dict[str, Bursts], errors: dict[str, float]) -> None:
    """Print the fitted models side by side, and standard errors if there are any."""
    from vibroswarm.cli.output import print_paragraph, print_table

    print(
        f"{len(windows)} receivers, {sum(int(one.sent.sum()) for one in windows):,} messages addressed to them"
    )
    print_table(
        ["model", "lost, %", "bad_share", "bad_s", "lost_in_bad", "lost_in_good", "log likelihood", "AIC"],
        [
            [
                name, f"{100 * model.lost:.2f}", f"{model.bad_share:.4f}", f"{model.bad_s:.1f}",
                f"{model.lost_in_bad:.3f}", f"{model.lost_in_good:.4f}", f"{model.log_likelihood:.1f}",
                f"{model.aic:.1f}",
            ]
            for name, model in models.items()
        ],
    )  # fmt: skip
    if errors:
        print_paragraph(
            "standard errors: " + ", ".join(f"{name} {value:.2g}" for name, value in errors.items())
        )


def _print_gaps(
    found: NDArray[np.int64],
    expected: dict[str, NDArray[np.float64]],
    lost_in_long: float,
    sent_in_long: float,
) -> None:
    """Print the gaps found beside those that each model expects, and what long intervals hold."""
    from vibroswarm.calibrate.message_loss import STEPS
    from vibroswarm.cli.output import print_paragraph, print_table

    print_paragraph("Gaps (messages lost in a row) by size, all receivers; expected +- standard deviation")
    print_table(
        ["messages", "found", *expected],
        [
            [
                f"{size}" if upper == size + 1 else f"{size} to {upper - 1}" if upper else f"{size} or more",
                str(found[k]),
                *(f"{counts[0, k]:.1f} +- {counts[1, k]:.1f}" for counts in expected.values()),
            ]
            for k, (size, upper) in enumerate(zip(STEPS, [*STEPS[1:], 0], strict=True))
        ],
        texts=1,
    )
    print_paragraph(
        f"Intervals of more than twice the median between a robot's own samples hold {100 * sent_in_long:.1f} % of the "
        f"messages and {100 * lost_in_long:.1f} % of the lost ones."
    )
