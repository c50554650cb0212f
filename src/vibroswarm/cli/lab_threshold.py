"""``vibroswarm lab threshold``: estimate theta_E from recordings on a floor whose vibrating tiles are known."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.deliver import print_result
from vibroswarm.cli.options import add_json, between, real, toml_file
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.recordings.threshold import Threshold


def costs(text: str) -> tuple[float, float]:
    """Return the costs of a false positive and of a false negative, in this order, from a text such as ``1:5``.

    Only their ratio matters. A cost of 0 is accepted here and refused by ``find_thresholds``.

    Raises:
        argparse.ArgumentTypeError: the text is not two finite numbers, or one is negative.
    """
    parts = text.split(":")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form A:B, such as 1:5")
    return real(parts[0], low=0), real(parts[1], low=0)


def add_parser(tasks: Any) -> None:
    """Add the task ``threshold``."""
    parser = tasks.add_parser(
        "threshold",
        help="estimate theta_E from recordings on a known floor, and whether the floor is decidable with it",
        description="Estimate the threshold by equal error, least error and given costs, with its uncertainty, the "
        "error rates with and without tile edges, and whether the floor is decidable.",
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of a recording (lab import)")
    parser.add_argument(
        "--costs",
        metavar="A:B",
        type=costs,
        default=(1.0, 1.0),
        help="cost of a false positive to that of a false negative (default 1:1)",
    )
    parser.add_argument("--at", metavar="THETA", type=between(real, 0), help="also report on this threshold")
    parser.add_argument(
        "--margin-mm",
        metavar="MM",
        type=between(real, 0),
        default=20.0,
        help="width of edge zones (default 20 mm)",
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=toml_file,
        help="write a scenario (TOML) with this threshold: that of --at, else of --costs, else of equal error",
    )
    parser.add_argument(
        "--base",
        metavar="NAME",
        help="preset or scenario file for the other fields of --out (default: those of the recording)",
    )
    parser.add_argument("--force", action="store_true", help="replace FILE if it exists")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Estimate thresholds by several rules, print them, and write a scenario with one of them; return the exit code.

    The thresholds are, in this order: that of equal error rates, that of least error, that of least expected cost if
    the two costs differ, and that of ``--at`` if it is given.
    """
    from vibroswarm.cli.calibrate_fit import scenario_of
    from vibroswarm.core.atomic_io import whole_file
    from vibroswarm.documents.recording import threshold_document
    from vibroswarm.recordings.recording import Recording
    from vibroswarm.recordings.threshold import at_threshold, edge_profile, find_thresholds, labelled

    if arguments.base is not None and arguments.out is None:
        raise InputError("has no effect without --out FILE", field="--base")
    false_positive, false_negative = arguments.costs
    margin_m = arguments.margin_mm / 1000.0
    recording = Recording.read(arguments.folder)
    base = recording.scenario if arguments.base is None else scenario_of(arguments.base, settings=[])
    thresholds = find_thresholds(recording, false_positive, false_negative, margin_m)
    if arguments.at is not None:
        thresholds.append(at_threshold(recording, arguments.at, margin_m=margin_m))
    profile = edge_profile(labelled(recording), thresholds[0].value)  # at the threshold of equal error
    # The scenario gets the threshold of --at, else that of different --costs: it is the last one. If neither is given,
    # it gets the threshold of equal error, which is the first one.
    chosen = thresholds[-1] if arguments.at is not None or false_positive != false_negative else thresholds[0]
    if arguments.out is not None:
        scenario = base.with_values({"sensor.rms_threshold": _written(chosen)})
        with whole_file(arguments.out, replace=arguments.force) as part:
            part.write_text(scenario.to_toml(), encoding="utf-8")
    print_result(threshold_document(thresholds, profile, chosen, margin_m), arguments)
    if arguments.out is not None and not arguments.json:
        print(f"\nSaved in {arguments.out}: sensor.rms_threshold = {_written(chosen):g} ({chosen.rule}).")
    return 0


def _written(chosen: Threshold) -> float:
    """Return the threshold rounded to three decimals, because robots log energies with three decimals."""
    return round(chosen.value, 3)
