"""Options that several commands share, and the types of option values."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.core.child_python import MOST_WORKERS

if TYPE_CHECKING:
    from vibroswarm.result import Result

STYLES: Final = ("column", "page", "slide")
"""Styles of pictures; the first is the default."""


def whole(text: str, low: float = -math.inf, high: float = math.inf) -> int:
    """Convert the text of an option to a whole number from ``low`` to ``high``.

    Raises:
        argparse.ArgumentTypeError: the text is not a whole number in this range.
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
    """Convert the text of an option to a finite number from ``low`` to ``high``.

    Raises:
        argparse.ArgumentTypeError: the text is not a finite number in this range.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan  # refused below, as "nan" and "inf" are
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number")
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"'{text}' is not {_range(low, high)}")
    return value


def _range(low: float, high: float) -> str:
    """Describe a range in words for an error message.

    ``high`` is written with up to 10 digits, so that a limit such as 1000000 does not appear as 1e+06.
    """
    return f"{low:g} or more" if high == math.inf else f"from {low:g} to {high:.10g}"


def between(kind: Callable[..., Any], low: float, high: float = math.inf) -> Callable[[str], Any]:
    """Return a type of option values: those of ``kind`` (``whole`` or ``real``) from ``low`` to ``high``."""
    return lambda text: kind(text, low, high)


def list_of(kind: Callable[[str], Any] = str) -> Callable[[str], list[Any]]:
    """Return a type of option values: lists of values of type ``kind``, separated by commas, such as ``5,10``.

    Repeated values count once.
    """
    return lambda text: list(dict.fromkeys(kind(part.strip()) for part in text.split(",")))


def toml_file(text: str) -> Path:
    """Convert the text of an option to the path of a TOML file.

    Raises:
        argparse.ArgumentTypeError: the text does not end in .toml.
    """
    path = Path(text)
    if path.suffix != ".toml":
        raise argparse.ArgumentTypeError(f"'{text}' does not end in .toml")
    return path


def run_plain() -> None:
    """Run kernels as plain Python in this process and its children, unless they are loaded already.

    ``core.jit`` reads the environment variable only once: when it is first imported.
    """
    if "vibroswarm.core.jit" not in sys.modules:
        os.environ["VIBROSWARM_PLAIN"] = "1"


def add_printing(parser: argparse.ArgumentParser) -> None:
    """Add the options for how much is printed on stdout and stderr, which all commands have."""
    group = parser.add_argument_group("printing")
    group.add_argument("--wide", action="store_true", help="print all columns and rows of tables")
    add_loudness(group)


def add_loudness(parser: argparse._ActionsContainer) -> None:
    """Add the options for how much is reported on stderr.

    The options may be given before the command's name or after it. Therefore they have no defaults (``SUPPRESS``): a
    default of the command's parser would overwrite what the program's parser has read before.
    """
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
    """Add the option for the style of picture files, which sets their size and fonts."""
    parser.add_argument(
        "--style",
        metavar="NAME",
        choices=STYLES,
        default=STYLES[0],
        help=f"style of picture files: {', '.join(STYLES)} (default column)",
    )


def add_pictures(
    parser: argparse._ActionsContainer, *, without: str = "numbers only; the report has no pictures"
) -> None:
    """Add the options for whether the report has pictures, and whether they are written as files too.

    Args:
        without: the help of ``--no-pictures``.
    """
    drawn = parser.add_mutually_exclusive_group()
    drawn.add_argument(
        "--pictures",
        action="store_true",
        help="also write the report's pictures as files, and their numbers as CSV",
    )
    drawn.add_argument("--no-pictures", action="store_true", help=without)


def wants_picture_files(arguments: argparse.Namespace, *earlier: str) -> bool:
    """Return whether the report's pictures are to be written as files: on request, or where there are such files.

    Files that an earlier command has written are written again, since what they show may be outdated.

    Args:
        arguments: with the options of ``add_pictures`` and ``--out``, which is given.
        earlier: paths in the folder ``--out``, with ``*`` for any text; such a file exists if an earlier command has
            written pictures.
    """
    written = any(any(arguments.out.glob(path)) for path in earlier)
    return arguments.pictures or (written and not arguments.no_pictures)


def add_out(
    parser: argparse._ActionsContainer, help: str, *, metavar: str = "DIR", force: bool = False
) -> None:
    """Add the option for where to save.

    Args:
        help: what is saved there.
        metavar: "DIR" if the value is a folder, "FILE" if it is a file.
        force: whether to also add the option ``--force``, which replaces what exists there.
    """
    parser.add_argument("--out", metavar=metavar, type=Path, help=help)
    if force:
        parser.add_argument(
            "--force",
            action="store_true",
            help=f"replace {metavar} if it {'holds something else' if metavar == 'DIR' else 'exists'}",
        )


def add_image_threshold(parser: argparse._ActionsContainer) -> None:
    """Add the option for the brightness from which a tile of a picture vibrates."""
    parser.add_argument(
        "--image-threshold",
        metavar="P",
        help="tiles of a picture vibrate from this mean brightness (default 50%%)",
    )


def add_settings(parser: argparse._ActionsContainer, help: str) -> None:
    """Add the option ``--set``, which sets fields of a scenario.

    The texts FIELD=VALUE of all its uses are collected in the list ``arguments.settings``.
    """
    parser.add_argument(
        "--set",
        metavar="FIELD=VALUE",
        action="append",
        default=[],
        dest="settings",
        help=f"{help}; may be repeated",
    )


def add_motion(parser: argparse._ActionsContainer) -> None:
    """Add the option for the engine that simulates motion."""
    parser.add_argument(
        "--motion",
        metavar="NAME",
        default="event",
        help="engine: event (default), fixed-step, mujoco, mujoco-planar, or FILE.py:NAME",
    )


def add_workers(parser: argparse._ActionsContainer, help: str, default: int | None = None) -> None:
    """Add the option for the number of workers; ``help`` says what they are."""
    parser.add_argument(
        "--workers", metavar="N", type=between(whole, 1, MOST_WORKERS), default=default, help=help
    )


def add_execution_options(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options for workers, executor and results of other versions; return their group."""
    group = parser.add_argument_group("execution")
    add_workers(group, "threads or processes (default: all processors)")
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
        robots: function that converts the text of ``--robots``: to a number, or for commands that vary the number of
            robots to a list of numbers.
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
    add_image_threshold(group)
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
    """Read a result from its folder: the ``Result`` of a simulation, or a ``Recording`` of real robots (a subclass)."""
    from vibroswarm.recordings.recording import Recording
    from vibroswarm.result import Result

    return Recording.read(folder) if (folder / "recording.json").is_file() else Result.read(folder)
