"""``vibroswarm calibrate``: compare recordings with simulations, and fit a simulation to them.

This module has the tasks (subcommands) ``figures``, ``effect`` and ``bursts``. The tasks ``compare`` and ``fit`` have
modules of their own.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli import calibrate_compare, calibrate_fit
from vibroswarm.cli.calibrate_fit import scenario_of, share_done
from vibroswarm.cli.deliver import print_result
from vibroswarm.cli.options import add_json, add_settings, between, read_result, real, whole
from vibroswarm.errors import InputError

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
    from vibroswarm.calibrate.session_statistics import figures_of
    from vibroswarm.documents.calibration import figures_document

    if len({str(folder) for folder in arguments.folders}) < len(arguments.folders):
        raise InputError("names a folder twice", field="DIR")
    figures = {str(folder): figures_of(read_result(folder), arguments.at) for folder in arguments.folders}
    print_result(figures_document(figures, arguments.at), arguments)
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
    from vibroswarm.documents.effect import effect_document

    first, second = (scenario_of(name, arguments.settings) for name in (arguments.first, arguments.second))
    results = effects(first, second, arguments.runs, arguments.seed, progress=share_done("runs"))
    names = (arguments.first, arguments.second)
    print_result(effect_document(results, names, (first, second)), arguments)
    return 0


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
    from vibroswarm.documents.message_loss import message_loss_document

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
    found = message_loss.compare_models(windows, errors=arguments.errors)
    print_result(message_loss_document(found), arguments)
    return 0
