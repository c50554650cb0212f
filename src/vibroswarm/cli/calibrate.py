"""``vibroswarm calibrate``: how alike recordings and simulations are."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vibroswarm.analysis.intervals import Interval
    from vibroswarm.calibrate.compare import Comparison
    from vibroswarm.result import Result

EPILOG = """\
example:
  vibroswarm calibrate compare lab simulated --json
"""


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "calibrate",
        help="compare a simulation with recordings",
        description="How alike recordings and simulations are.",
        allow_abbrev=False,
    )
    tasks = parser.add_subparsers(title="tasks", metavar="TASK", dest="task")
    compare = tasks.add_parser(
        "compare",
        help="the paper's six similarities in their place, and measures that discriminate",
        description="Compare the samples of two results (lab import, run --out); each run is a session.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    compare.add_argument("real", metavar="REAL", type=Path, help="folder of a recording")
    compare.add_argument(
        "simulated", metavar="SIM", type=Path, help="folder of a simulation, or its log imported"
    )
    compare.add_argument(
        "--picture", metavar="FILE", type=Path, help="draw both, side by side (.png, .svg, .pdf)"
    )
    compare.add_argument("--json", action="store_true", help="as JSON")
    compare.set_defaults(run=run_compare, parser=compare)
    parser.set_defaults(run=lambda arguments: parser.print_help() or 0, parser=parser)


def run_compare(arguments: argparse.Namespace) -> int:
    """Read both, compare, tell."""
    from vibroswarm.calibrate.compare import compare

    real, simulated = _read(arguments.real), _read(arguments.simulated)
    found = compare(real, simulated)
    if arguments.picture is not None:
        from vibroswarm.calibrate.pictures import write_comparison_picture
        from vibroswarm.floors.files import check_suffix

        check_suffix(arguments.picture, (".png", ".svg", ".pdf"))
        write_comparison_picture(real, simulated, found, arguments.picture)
    if arguments.json:
        print(json.dumps(found.as_dict(), indent=2, allow_nan=False))
    else:
        print("\n".join(comparison_lines(found)))
    return 0


def _read(folder: Path) -> Result:
    from vibroswarm.lab.recording import Recording
    from vibroswarm.result import Result

    return Recording.read(folder) if (folder / "recording.json").is_file() else Result.read(folder)


def comparison_lines(found: Comparison) -> list[str]:
    """The whole comparison in plain lines."""
    from vibroswarm.calibrate.features import WORDS

    lines = [
        "Cosine similarity (as published: of all samples; then at equal counts)",
        f"{'':<28}{'published':>9} {'null':>7} {'here':>7} {'ceiling':>7}   "
        f"{'session, real-sim':<22}{'session, real-real':<22}",
    ]
    for one in found.similarities:
        here = "" if one.at_equal_counts > one.null else "  below its null"
        within = "-" if one.real_by_session is None else _spread(one.real_by_session)
        lines.append(
            f"{WORDS[one.feature]:<28}{one.as_published:>9.3f} {one.null:>7.3f} {one.at_equal_counts:>7.3f} "
            f"{one.ceiling:>7.3f}   {_spread(one.by_session):<22}{within:<22}{here}"
        )
    lines += [
        "",
        "Energy distance, effect size (0: the same distribution, 1: apart as far as can be; 95 % over sessions)",
        f"{'':<28}{'real against simulated':<28}{'real against real':<28}",
    ]
    lines += [
        f"{WORDS[one.feature]:<28}{_interval(one.effect, 4):<28}"
        f"{'-' if one.real is None else _interval(one.real, 4):<28}"
        for one in found.distances
    ]
    told = found.told_apart
    lines += [
        "",
        "Share of stretches of 20 samples that a classifier tells apart (0.5: chance)",
        f"  real from simulated, other robots and sessions than trained on: {_interval(told.simulated, 3)}",
        f"  real from simulated, other robots: {_interval(told.simulated_by_robot, 3)}",
    ]
    if told.real is not None:
        lines.append(f"  real session from real session, other robots: {_interval(told.real, 3)}")
    if found.missing:
        lines.append(f"Too few values to compare: {', '.join(WORDS[one] for one in found.missing)}")
    return lines


def _spread(one: Any) -> str:
    return f"{one.mean:.3f} ({one.least:.3f}-{one.most:.3f})"


def _interval(one: Interval, digits: int) -> str:
    if one.low != one.low:
        return f"{one.estimate:.{digits}f}"
    return f"{one.estimate:.{digits}f} [{one.low:.{digits}f}, {one.high:.{digits}f}]"
