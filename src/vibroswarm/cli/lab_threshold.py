"""``vibroswarm lab threshold``: theta_E from labelled recordings."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.lab.threshold import Rates, Threshold


def add_parser(tasks: Any) -> None:
    """Make the task known."""
    parser = tasks.add_parser(
        "threshold",
        help="theta_E from recordings on a known floor, and whether the floor can be decided with it",
        description="Find the threshold by equal error, least error and given costs, with its uncertainty, the error "
        "rates with and without tile edges, and whether the floor can be decided.",
        allow_abbrev=False,
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="of a recording (lab import)")
    parser.add_argument(
        "--costs", metavar="A:B", default="1:1", help="cost of a false positive to that of a false negative"
    )
    parser.add_argument("--at", metavar="THETA", help="also tell what this threshold does")
    parser.add_argument("--margin-mm", metavar="MM", default="20", help="how far edges reach (20 mm)")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Find, tell."""
    from vibroswarm.lab.recording import Recording
    from vibroswarm.lab.threshold import at_threshold, edge_profile, find_thresholds, labelled

    costs = arguments.costs.split(":")
    if len(costs) != 2:
        raise InputError(f"'{arguments.costs}' is not of the form A:B, such as 1:5", field="--costs")
    one, other = (_number(cost, "--costs") for cost in costs)
    margin_m = _number(arguments.margin_mm, "--margin-mm") / 1000.0
    recording = Recording.read(arguments.folder)
    found = find_thresholds(recording, one, other, margin_m)
    if arguments.at is not None:
        found.append(at_threshold(recording, _number(arguments.at, "--at"), margin_m=margin_m))
    profile = edge_profile(labelled(recording), found[0].value)
    if arguments.json:
        plain = [
            {name: None if value != value or value == float("inf") else value for name, value in row.items()}
            for row in profile.to_dicts()
        ]
        about = {"thresholds": [each.as_dict() for each in found], "edge_profile": plain}
        print(json.dumps(_finite(about), indent=2, allow_nan=False))
        return 0
    for each in found:
        print("\n".join(_lines(each, margin_m)))
    print(f"\nErrors by distance to the nearest tile of the other kind, at {found[0].value:.3f}:")
    for row in profile.to_dicts():
        far = f"{1000 * row['from_m']:.0f} mm on" if row["to_m"] > 1e3 else (
            f"{1000 * row['from_m']:.0f} to {1000 * row['to_m']:.0f} mm"
        )  # fmt: skip
        print(
            f"  {far:<12} still read as vibrating {100 * row['false_positive']:5.1f} % of {row['still']:<5} "
            f"vibrating read as still {100 * row['false_negative']:5.1f} % of {row['vibrating']}"
        )
    return 0


def _number(text: str, option: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0 <= value < float("inf"):
        raise InputError(f"'{text}' is no number of 0 or more", field=option)
    return value


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and value != value else value


def _lines(found: Threshold, margin_m: float) -> list[str]:
    between = "" if found.low != found.low else f" [{found.low:.3f}, {found.high:.3f}]"
    share = found.share_by_session
    spread = (
        "" if share.low != share.low else f" [{100 * share.low:.1f}, {100 * share.high:.1f}] over sessions"
    )
    return [
        f"{found.rule}: theta_E = {found.value:.3f}{between}",
        f"  all samples: {_rates(found.all_samples)}",
        f"  farther than {1000 * margin_m:g} mm from a tile of the other kind: {_rates(found.inner_samples)}",
        f"  share of ones, each tile alike: {100 * share.estimate:.1f} %{spread}",
        f"  {found.decidable.says}",
    ]


def _rates(rates: Rates) -> str:
    return (
        f"still read as vibrating {100 * rates.false_positive:.1f} %, vibrating read as still "
        f"{100 * rates.false_negative:.1f} %"
    )
