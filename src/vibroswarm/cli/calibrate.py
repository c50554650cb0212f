"""``vibroswarm calibrate``: compare recordings with simulations, and fit a simulation to them.

This module has the tasks (subcommands) ``figures``, ``effect`` and ``bursts``. The tasks ``compare`` and ``fit`` have
modules of their own.
"""

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
    """Add the command ``calibrate`` and its tasks, which are subcommands, to the program's commands."""
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
    parser.set_defaults(run=lambda arguments: parser.print_help() or 0)  # without a task: help, exit code 0


def _add_figures(tasks: Any) -> None:
    """Add the task ``figures``, which compares figures of several results."""
    parser = tasks.add_parser(
        "figures",
        help="how robots drive, avoid, spread and read, side by side with a simulation",
        description="Figures of one or more results (each run is a session) with 95 % intervals over sessions.",
    )
    parser.add_argument(
        "folders", metavar="DIR", type=Path, nargs="+", help="folders of recordings or simulations"
    )
    # One threshold for all results, because error rates depend on it; by default that of the paper.
    parser.add_argument(
        "--at", metavar="THETA", type=real, default=1.33, help="threshold for error rates (default 1.33)"
    )
    add_json(parser)
    parser.set_defaults(run=run_figures)


def run_figures(arguments: argparse.Namespace) -> int:
    """Print the same figures of several results, one column for each folder; return the exit code."""
    from vibroswarm.calibrate.session_statistics import FIGURES, figures_of
    from vibroswarm.cli.output import print_json, print_paragraph, print_table

    if len({str(folder) for folder in arguments.folders}) < len(arguments.folders):
        raise InputError("names a folder twice", field="DIR")
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
                over_sessions(folder_figures[i].interval, ".3g", scale=scale)
                for folder_figures in figures.values()
            ),
        ]
        # figures_of returns the figures in the order of FIGURES, so i is the index of this one in each folder's list
        for i, (words, scale) in enumerate(FIGURES.values())
    ]
    print_table(["figure", *(Path(folder).name for folder in figures)], rows)
    print_paragraph(
        f"Errors at a threshold of {arguments.at:g}; in brackets 95 % over sessions; '-': not measurable."
    )
    return 0


def _add_effect(tasks: Any) -> None:
    """Add the task ``effect``, which compares two scenarios."""
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
    """Simulate both scenarios under each strategy and print the comparison; return the exit code."""
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
    """Print the figures of both scenarios under each strategy, and the differences (second - first).

    Args:
        found: one entry for each strategy.
        names: the names of the first and of the second scenario, as the user gave them.
    """
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
            "truth undefined, %",
        ],
        [
            [
                effect.strategy,
                name,
                with_interval(figures["decision_time_s"], ".0f"),
                with_interval(figures["belief_in_truth"], ".3f"),
                *(f"{100 * share:.1f}" for share in shares.values()),  # in the order of outcomes.CONSENSUS
            ]
            for effect in found
            for name, figures, shares in zip(names, effect.figures, effect.consensus, strict=True)
        ],
        names=2,  # strategy and scenario name a row
    )
    print()
    print_paragraph(f"{names[1]} - {names[0]}, paired by run (95 %)")
    rows = []
    for effect in found:
        for confirmation in effect.differences:
            # The difference on the first seed is printed; `says` states whether the second seed confirms it.
            measured = confirmation.first
            # times are printed in whole seconds, shares and beliefs with three decimals
            form = ".0f" if measured.figure.endswith("_s") else ".3f"
            difference = with_interval(measured.difference, form)
            rows.append([effect.strategy, measured.figure, difference, confirmation.says])
    columns = ["strategy", "figure", "difference", ""]
    # Strategy and figure name a row. All columns are aligned to the left as text: the sentences in the last one are
    # long and may be wrapped.
    print_table(columns, rows, names=2, texts=len(columns))


def _add_bursts(tasks: Any) -> None:
    """Add the task ``bursts``, which fits models of message loss."""
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
    """Fit both models of message loss to recordings, and print them with the expected and the recorded gaps.

    The models are independent losses and losses in bursts (Gilbert-Elliott). The size of a gap is the number of
    messages that a receiver lost in successive windows, each of which has losses. Returns the exit code.

    Raises:
        InputError: no robot has counts of received messages, no message is lost, or ``--errors`` is given for one
            receiver.
    """
    from vibroswarm.calibrate import message_loss
    from vibroswarm.cli.output import print_json

    # One entry for each receiver: the intervals (windows) between its own samples, and how many messages were sent to
    # it and received by it in each.
    windows = [one for folder in arguments.folders for one in message_loss.windows_of(read_result(folder))]
    if not windows:
        raise InputError("no received messages are counted", field=", ".join(map(str, arguments.folders)))
    if all(message_loss.lost_for_good(one).sum() == 0 for one in windows):
        raise InputError(
            "no message is lost; there is nothing to fit", field=", ".join(map(str, arguments.folders))
        )
    if arguments.errors and len(windows) < 2:
        raise InputError("needs the counts of at least two receivers; leave it out", field="--errors")
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
            # `expected` has the means and, after them, the standard deviations, which are left out
            "expected": {name: means.tolist() for name, (means, _) in expected.items()},
        }
        long = {"lost": lost_in_long, "sent": sent_in_long}
        print_json({"fits": fits, "standard_errors": errors, "gaps": gaps, "long_intervals": long})
        return 0
    _print_models(windows, models, errors)
    print()
    _print_gaps(found, expected, lost_in_long, sent_in_long)
    return 0


def _print_models(windows: list[Windows], models: dict[str, Bursts], errors: dict[str, float]) -> None:
    """Print the fitted models as a table, and below it the standard errors of the model with bursts.

    Args:
        windows: one entry for each receiver, with the messages sent to it.
        models: by name. Independent losses are a ``Bursts`` too, in which the bad state does not occur.
        errors: standard errors by name of the parameter; empty if they were not computed.
    """
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
    """Print the recorded number of gaps of each size beside those that the models expect, and losses in long intervals.

    The size of a gap is the number of messages that a receiver lost in successive intervals between its own samples,
    each of which has losses. An interval is long if it is more than twice the median.

    Args:
        found: recorded number of gaps in each class of size; ``STEPS`` has the smallest size of each class.
        expected: for each model, an array (2, classes): the means of these numbers, then their standard deviations.
        lost_in_long: share of the lost messages that fall into long intervals.
        sent_in_long: share of all messages that fall into long intervals.
    """
    from vibroswarm.calibrate.message_loss import STEPS
    from vibroswarm.cli.output import print_paragraph, print_table

    print_paragraph("Gaps (messages lost in a row) by size, all receivers; expected +- standard deviation")
    rows = []
    for k, size in enumerate(STEPS):
        if k + 1 == len(STEPS):
            sizes = f"{size} or more"
        else:
            largest = STEPS[k + 1] - 1
            sizes = f"{size}" if size == largest else f"{size} to {largest}"
        means_and_deviations = (
            f"{mean[k]:.1f} +- {deviation[k]:.1f}" for mean, deviation in expected.values()
        )
        rows.append([sizes, str(found[k]), *means_and_deviations])
    print_table(["messages", "found", *expected], rows)
    print_paragraph(
        f"Intervals of more than twice the median between a robot's own samples hold {100 * sent_in_long:.1f} % of the "
        f"messages and {100 * lost_in_long:.1f} % of the lost ones."
    )
