"""Options that several commands share, and the types of option values."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from vibroswarm.result import Result

STYLES: Final = ("column", "page", "slide")


def whole(text: str, low: float = -math.inf, high: float = math.inf) -> int:
    """Return a whole number from ``low`` to ``high``.

    Raises:
        argparse.ArgumentTypeError: it is not.
    """
    from vibroswarm.errors import shown

    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{shown(text)} is not a whole number") from None
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{value} is not {_range(low, high)}")
    return value


def real(text: str, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a finite number from ``low`` to ``high``.

    Raises:
        argparse.ArgumentTypeError: it is not.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number")
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"'{text}' is not {_range(low, high)}")
    return value


def _range(low: float, high: float) -> str:
    return f"{low:g} or more" if high == math.inf else f"from {low:g} to {high:.10g}"


def between(kind: Callable[..., Any], low: float, high: float = math.inf) -> Callable[[str], Any]:
    """Return the type ``kind``, limited to a range."""
    return lambda text: kind(text, low, high)


def list_of(kind: Callable[[str], Any] = str) -> Callable[[str], list[Any]]:
    """Return the type of values of ``kind`` separated by commas, such as ``5,10``; repeated values count once."""
    return lambda text: list(dict.fromkeys(kind(part.strip()) for part in text.split(",")))


def toml_file(text: str) -> Path:
    """Return the name of a scenario file.

    Raises:
        argparse.ArgumentTypeError: it does not end in .toml.
    """
    path = Path(text)
    if path.suffix != ".toml":
        raise argparse.ArgumentTypeError(f"'{text}' does not end in .toml")
    return path


def add_printing(parser: argparse.ArgumentParser) -> None:
    """Add the options for how much is printed, which all commands have."""
    group = parser.add_argument_group("printing")
    group.add_argument("--wide", action="store_true", help="print all columns and rows of tables")
    add_loudness(group)


def add_loudness(parser: argparse._ActionsContainer) -> None:
    """Add the options for how much is reported on stderr; without defaults, since two parsers may have them."""
    loud = parser.add_mutually_exclusive_group()
    loud.add_argument(
        "-q",
        "--quiet",
        action="store_true",
        default=argparse.SUPPRESS,
        help="report only warnings and errors on stderr: no progress, no plan",
    )
    loud.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        default=argparse.SUPPRESS,
        help="report versions, compiled kernels and times on stderr; print the traceback of an error",
    )


def add_json(parser: argparse._ActionsContainer) -> None:
    """Add the option that prints JSON instead of text."""
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else on stdout")


def add_seed(parser: argparse._ActionsContainer, help: str = "same scenario and seed: same result") -> None:
    """Add the option for the seed."""
    parser.add_argument("--seed", metavar="S", type=whole, default=1, help=f"{help} (default 1)")


def add_style(parser: argparse._ActionsContainer) -> None:
    """Add the option for the size of pictures."""
    parser.add_argument(
        "--style",
        metavar="NAME",
        choices=STYLES,
        default=STYLES[0],
        help=f"style of pictures: {', '.join(STYLES)} (default column)",
    )


def add_out(
    parser: argparse._ActionsContainer, help: str, *, metavar: str = "DIR", force: bool = False
) -> None:
    """Add the option for where to save; with ``force``, also the one that replaces existing files."""
    parser.add_argument("--out", metavar=metavar, type=Path, help=help)
    if force:
        parser.add_argument(
            "--force",
            action="store_true",
            help=f"replace {metavar} if it {'holds something else' if metavar == 'DIR' else 'exists'}",
        )


def add_settings(parser: argparse._ActionsContainer, help: str) -> None:
    """Add the option that sets fields of a scenario."""
    parser.add_argument(
        "--set",
        metavar="FIELD=VALUE",
        action="append",
        default=[],
        dest="settings",
        help=f"{help}; may be repeated",
    )


def add_motion(parser: argparse._ActionsContainer) -> None:
    """Add the option for the engine."""
    parser.add_argument(
        "--motion",
        metavar="NAME",
        default="event",
        help="engine: event (default), fixed-step, mujoco, mujoco-planar, or FILE.py:NAME",
    )


def add_execution_options(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options for workers and executor; return their group."""
    group = parser.add_argument_group("execution")
    group.add_argument(
        "--workers", metavar="N", type=whole, help="threads or processes (default: all processors)"
    )
    group.add_argument(
        "--executor",
        metavar="WHERE",
        default="threads",
        help="threads (default), processes, dask://HOST:PORT, or a Dask scheduler file",
    )
    group.add_argument(
        "--mixed", action="store_true", help="resume results of other versions; the report says so"
    )
    return group


def add_scenario_options(
    parser: argparse.ArgumentParser, *, robots: Callable[[str], Any] = whole
) -> argparse._ArgumentGroup:
    """Add the options from which ``scenario_options.scenario_from`` makes a scenario; return their group.

    Args:
        robots: type of ``--robots``.
    """
    group: argparse._ArgumentGroup = parser.add_argument_group("scenario")
    base = group.add_mutually_exclusive_group()
    base.add_argument(
        "--preset",
        metavar="NAME",
        help="paper (default), paper-empirical, text, calibrated; found by searches: optimised-cost, optimised-error, "
        "optimised-error-patterns, optimised-places",
    )
    base.add_argument(
        "--scenario", metavar="FILE", type=Path, help="scenario in TOML, such as the one in a result"
    )
    group.add_argument("--floor", metavar="FLOOR", help="pattern (diagonal:0.46), random:0.48, or file")
    group.add_argument(
        "--tiles", metavar="RxC", help="rows x columns of a random floor, coordinate list or picture"
    )
    group.add_argument("--robots", metavar="N", type=robots, help="number of robots")
    group.add_argument(
        "--strategy",
        metavar="NAME",
        help="what robots send each other: none, positive, soft, a published strategy, or FILE.py:NAME",
    )
    group.add_argument(
        "--network",
        metavar="NAME",
        help="which messages arrive, and when: ideal, loss, loss_by_size, bursts, range, delay, tree, or FILE.py:NAME",
    )
    group.add_argument("--task", metavar="NAME", help="question about the floor: fill_ratio, or FILE.py:NAME")
    group.add_argument(
        "--energies", metavar="FILE", type=Path, help="draw readings from these measured energies (CSV)"
    )
    add_settings(group, "set any field of the scenario, such as walk.walk_duration_scale_ms=9000")
    return group


def read_result(folder: Path) -> Result:
    """Read a recording or a result."""
    from vibroswarm.recordings.recording import Recording
    from vibroswarm.result import Result

    return Recording.read(folder) if (folder / "recording.json").is_file() else Result.read(folder)
