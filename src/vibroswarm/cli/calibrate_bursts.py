"""``vibroswarm calibrate bursts``: how the robots of recordings lose messages, and the model fitted to it."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vibroswarm.cli.options import add_json

EPILOG = """\
example:
  vibroswarm calibrate bursts lab --errors
"""


def add_parser(tasks: Any) -> None:
    """Add the task."""
    parser = tasks.add_parser(
        "bursts",
        help="whether robots lose messages in bursts, and the network 'bursts' fitted to that",
        description="Fit independent losses and bursts (Gilbert-Elliott, by receiver) to the counts of received "
        "messages in recordings, and compare the gaps that both expect with those found. Takes about half a minute "
        "for an hour of five robots.",
        epilog=EPILOG,
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
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fit, compare and print."""
    from vibroswarm.calibrate import message_loss
    from vibroswarm.cli.options import read_result
    from vibroswarm.cli.output import print_json, print_paragraph, print_table
    from vibroswarm.errors import InputError

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
    print()
    print_paragraph("Gaps (messages lost in a row) by size, all receivers; expected +- standard deviation")
    print_table(
        ["messages", "found", *models],
        [
            [
                f"{size}" if upper == size + 1 else f"{size} to {upper - 1}" if upper else f"{size} or more",
                str(found[k]),
                *(f"{expected[name][0, k]:.1f} +- {expected[name][1, k]:.1f}" for name in models),
            ]
            for k, (size, upper) in enumerate(
                zip(message_loss.STEPS, [*message_loss.STEPS[1:], 0], strict=True)
            )
        ],
        texts=1,
    )
    print_paragraph(
        f"Intervals of more than twice the median between a robot's own samples hold {100 * sent_in_long:.1f} % of the "
        f"messages and {100 * lost_in_long:.1f} % of the lost ones."
    )
    return 0
