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
        help="compare a simulation with recordings, and fit it to them",
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
    compare.add_argument(
        "--pictures", metavar="DIR", type=Path, help="draw a file a feature there, and all together"
    )
    compare.add_argument("--json", action="store_true", help="as JSON")
    compare.set_defaults(run=run_compare, parser=compare)
    figures = tasks.add_parser(
        "figures",
        help="how robots drive, avoid, spread and read, and a simulation beside them",
        description="Figures of one or two results (each run is a session) with 95 %% intervals over sessions.",
        allow_abbrev=False,
    )
    figures.add_argument(
        "folders", metavar="DIR", type=Path, nargs="+", help="folders of recordings or simulations"
    )
    figures.add_argument("--at", metavar="THETA", default="1.33", help="threshold for error rates (1.33)")
    figures.add_argument("--json", action="store_true", help="as JSON")
    figures.set_defaults(run=run_figures, parser=figures)
    from vibroswarm.cli import calibrate_effect, calibrate_fit

    calibrate_fit.add_parser(tasks)
    calibrate_effect.add_parser(tasks)
    parser.set_defaults(run=lambda arguments: parser.print_help() or 0, parser=parser)


def run_figures(arguments: argparse.Namespace) -> int:
    """Read, count, tell side by side."""
    from vibroswarm.calibrate.figures import FIGURES, figures_of
    from vibroswarm.errors import InputError

    try:
        threshold = float(arguments.at)
    except ValueError:
        raise InputError(f"'{arguments.at}' is no threshold; give a number", field="--at") from None
    found = {str(folder): figures_of(_read(folder), threshold) for folder in arguments.folders}
    if arguments.json:
        about = {folder: [one.as_dict() for one in each] for folder, each in found.items()}
        print(json.dumps({"rms_threshold": threshold, "figures": about}, indent=2, allow_nan=False))
        return 0
    print(f"{'':<46}" + "".join(f"{Path(folder).name:<30}" for folder in found))
    for k, (words, times) in enumerate(FIGURES.values()):
        cells = [_scaled(each[k].interval, times) for each in found.values()]
        print(f"{words:<46}" + "".join(f"{cell:<30}" for cell in cells))
    print(f"Errors at a threshold of {threshold:g}; in brackets 95 % over sessions; '-': cannot be told.")
    return 0


def _scaled(one: Interval | None, times: float) -> str:
    if one is None:
        return "-"
    middle, low, high = (f"{times * each:.3g}" for each in (one.estimate, one.low, one.high))
    return middle if one.n < 2 else f"{middle} [{low}, {high}]"


def run_compare(arguments: argparse.Namespace) -> int:
    """Read both, compare, tell."""
    from vibroswarm.calibrate.compare import compare
    from vibroswarm.errors import InputError

    real, simulated = _read(arguments.real), _read(arguments.simulated)
    found = compare(real, simulated)
    if arguments.picture is not None:
        from vibroswarm.calibrate.pictures import write_comparison_picture
        from vibroswarm.floors.files import check_suffix

        check_suffix(arguments.picture, (".png", ".svg", ".pdf"))
        write_comparison_picture(real, simulated, found, arguments.picture)
    if arguments.pictures is not None:
        from vibroswarm.calibrate.pictures import write_comparison_pictures

        if arguments.pictures.is_file():
            raise InputError("is a file; give the name of a folder", field=str(arguments.pictures))
        write_comparison_pictures(real, simulated, found, arguments.pictures)
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
