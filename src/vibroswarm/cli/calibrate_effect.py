"""``vibroswarm calibrate effect``: what it changes to simulate with calibrated robots."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.calibrate_fit import base_of, progress_of
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.analysis.intervals import Interval
    from vibroswarm.calibrate.effect import Effect

MOST_RUNS = 100_000


def add_parser(tasks: Any) -> None:
    """Make the task known."""
    parser = tasks.add_parser(
        "effect",
        help="what it changes in time, accuracy and consensus to simulate with calibrated robots",
        description="Two presets or scenario files on the same floors, for the three strategies; paired by run, and "
        "looked at again on other seeds.",
        epilog="example:\n  vibroswarm calibrate effect paper calibrated --runs 1000",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("first", metavar="FIRST", nargs="?", default="paper", help="preset or file (paper)")
    parser.add_argument("second", metavar="SECOND", nargs="?", default="calibrated", help="(calibrated)")
    parser.add_argument("--runs", metavar="N", default="1000", help="runs of each, and as many again (1000)")
    parser.add_argument("--seed", metavar="S", default="1", help="the first of two seeds (1)")
    parser.add_argument("--set", metavar="FIELD=VALUE", action="append", default=[], help="fields of both")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate, compare, tell."""
    from vibroswarm.calibrate.effect import effects

    runs = _number(arguments.runs, "--runs", 2, MOST_RUNS)
    seed = _number(arguments.seed, "--seed", 0, 2**62)
    first, second = (base_of(name, arguments.set) for name in (arguments.first, arguments.second))
    found = effects(first, second, runs, seed, progress=progress_of("runs"))
    if arguments.json:
        print(json.dumps([one.as_dict() for one in found], indent=2, allow_nan=False))
        return 0
    print("\n".join(effect_lines(found, (arguments.first, arguments.second))))
    return 0


def _number(text: str, field: str, least: int, most: int) -> int:
    if not text.isdigit() or not least <= int(text) <= most:
        raise InputError(f"'{text}' is no whole number from {least} to {most}", field=field)
    return int(text)


def effect_lines(found: list[Effect], names: tuple[str, str]) -> list[str]:
    """The table, and the differences, in plain lines."""
    lines = [
        f"{'strategy':<10}{'scenario':<22}{'decision time, s':<22}{'belief in truth':<24}"
        "consensus, %: right, wrong, split, incomplete"
    ]
    for one in found:
        for name, figures, shares in zip(names, one.figures, one.consensus, strict=True):
            time, belief = _cell(figures["decision_time_s"], 0), _cell(figures["belief_in_truth"], 3)
            parts = ", ".join(f"{100 * share:.1f}" for share in shares.values())
            lines.append(f"{one.strategy:<10}{name:<22}{time:<22}{belief:<24}{parts}")
    lines += ["", f"{names[1]} less {names[0]}, paired by run (95 %)"]
    for one in found:
        for each in one.differences:
            digits = 0 if each.first.figure.endswith("_s") else 3
            shown = _cell(each.first.difference, digits)
            lines.append(f"{one.strategy:<10}{each.first.figure:<22}{shown:<26}{each.says}")
    return lines


def _cell(one: Interval, digits: int) -> str:
    return f"{one.estimate:.{digits}f} [{one.low:.{digits}f}, {one.high:.{digits}f}]"
