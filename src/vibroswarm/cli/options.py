"""Options that several commands share, and the types of option values."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from vibroswarm.cli.command_line import Option, add_group, reader
from vibroswarm.core.child_python import MOST_WORKERS
from vibroswarm.core.registry import written_names
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.result import Result

Style = Literal["column", "page", "slide"]
"""Styles of pictures; the first is the default."""
STYLES: Final = ("column", "page", "slide")
"""The same, for messages."""


def refuse_both(options: object, first: str, second: str) -> None:
    """Refuse two options of a group that exclude each other.

    Args:
        first, second: names of the fields; their default is false.
    Raises:
        InputError: both are given.
    """
    if getattr(options, first) and getattr(options, second):
        one, other = (f"--{name.replace('_', '-')}" for name in (first, second))
        raise InputError(f"conflicts with {one}; use one of them", field=other)


@dataclass(kw_only=True)
class Printing:
    """How much is printed on stdout and stderr; all commands have these options."""

    wide: Annotated[bool, Option("print all columns and rows of tables")] = False
    quiet: Annotated[
        bool, Option("report only warnings and errors on stderr: no progress, no plan", short="-q")
    ] = False
    verbose: Annotated[
        bool,
        Option(
            "report versions, compiled kernels and times on stderr; print the traceback of an error",
            short="-v",
        ),
    ] = False

    def __post_init__(self) -> None:
        """Refuse options that exclude each other."""
        refuse_both(self, "quiet", "verbose")


@dataclass(kw_only=True)
class UserCode:
    """Whether and how code of the user is run; all commands have these options."""

    trust: Annotated[bool, Option("run code named in scenario and study files (FILE.py:NAME)")] = False
    plain: Annotated[bool, Option("run as plain, slow Python, for debuggers")] = False


Tiles = Annotated[str | None, Option("rows x columns of a random floor, coordinate list or picture", "RxC")]
ImageThreshold = Annotated[
    str | None, Option("tiles of a picture vibrate from this mean brightness (default 50%)", "P")
]


@dataclass(kw_only=True)
class ScenarioOptions:
    """What a scenario is made of: a preset or file, and what differs from it."""

    preset: Annotated[
        str | None,
        Option("{names} (default paper)", names=partial(written_names, "scenario/presets", ".toml")),
    ] = None
    scenario: Annotated[Path | None, Option("scenario in TOML, such as the one in a result")] = None
    floor: Annotated[str | None, Option("pattern (diagonal:0.46), random:0.48, or file", "FLOOR")] = None
    tiles: Tiles = None
    image_threshold: ImageThreshold = None
    robots: Annotated[int | None, Option("number of robots")] = None
    strategy: Annotated[
        str | None,
        Option(
            "what robots send each other: {names}, or FILE.py:NAME",
            names=partial(written_names, "strategies"),
        ),
    ] = None
    network: Annotated[
        str | None,
        Option(
            "which messages arrive, and when: {names}, or FILE.py:NAME",
            names=partial(written_names, "networks"),
        ),
    ] = None
    task: Annotated[
        str | None,
        Option("question about the floor: {names}, or FILE.py:NAME", names=partial(written_names, "tasks")),
    ] = None
    energies: Annotated[Path | None, Option("draw readings from these measured energies (CSV)")] = None
    settings: Annotated[
        Sequence[str],
        Option(
            "set any field of the scenario, such as walk.walk_duration_scale_ms=9000; may be repeated",
            "FIELD=VALUE",
            name="--set",
        ),
    ] = ()

    def __post_init__(self) -> None:
        """Refuse options that exclude each other."""
        refuse_both(self, "preset", "scenario")


MOTIONS: Final = ("event", "fixed-step", "mujoco", "mujoco-planar")
"""Sources of motion of this package, as ``vibroswarm.motion`` registers them; a test compares them."""
Seed = Annotated[int, Option("same scenario and seed: same result", "S")]
Motion = Annotated[
    str, Option("engine: {names} (default event), or FILE.py:NAME", names=partial(list, MOTIONS))
]
Json = Annotated[bool, Option("print JSON and nothing else on stdout")]
Force = Annotated[bool, Option("replace what is there, if vibroswarm wrote it")]
OutFile = Annotated[Path | None, Option("write this file")]


@dataclass(kw_only=True)
class Simulated(ScenarioOptions):
    """A scenario, its seed and the source of its motion."""

    seed: Seed = 1
    motion: Motion = "event"


@dataclass(kw_only=True)
class Saved:
    """Where results go."""

    json: Json = False
    out: Annotated[
        Path | None, Option("save everything here; the same command resumes or repeats it", "DIR")
    ] = None
    force: Annotated[bool, Option("replace DIR if it holds something else")] = False


@dataclass(kw_only=True)
class Paged(Saved):
    """Where results go that have a page."""

    open: Annotated[bool, Option("open the page in the browser")] = False

    def __post_init__(self) -> None:
        """Refuse to open a page that is not saved."""
        if self.open and self.out is None:
            raise InputError("needs --out DIR, where the page is saved", field="--open")


@dataclass(kw_only=True)
class Drawn(Paged):
    """Where results go that have a page with pictures."""

    pictures: Annotated[
        bool, Option("also write the report's pictures as files, and their numbers as CSV")
    ] = False
    no_pictures: Annotated[bool, Option("numbers only, without pictures")] = False
    style: Annotated[Style, Option("style of picture files: column, page, slide (default column)")] = "column"

    def __post_init__(self) -> None:
        """Refuse options that exclude each other."""
        super().__post_init__()
        refuse_both(self, "pictures", "no_pictures")


Workers = Annotated[
    int | None, Option("threads or processes (default: all processors)", low=1, high=MOST_WORKERS)
]


@dataclass(kw_only=True)
class Execution:
    """Where and how runs are executed."""

    workers: Workers = None
    executor: Annotated[
        str, Option("threads (default), processes, dask://HOST:PORT, or a Dask scheduler file", "WHERE")
    ] = "threads"
    mixed: Annotated[bool, Option("resume results of other versions; the report says so")] = False


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


def add_json(parser: argparse._ActionsContainer) -> None:
    """Add the option that prints JSON instead of text."""
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else on stdout")


def add_seed(parser: argparse._ActionsContainer, help: str = "same scenario and seed: same result") -> None:
    """Add the option for the seed."""
    parser.add_argument("--seed", metavar="S", type=whole, default=1, help=f"{help} (default 1)")


def add_style(parser: argparse._ActionsContainer) -> None:
    """Add the option for the style of picture files, which sets their size and fonts."""
    action = parser.add_argument(
        "--style",
        metavar="NAME",
        type=reader(Style, Option("")),
        default=STYLES[0],
        help=f"style of picture files: {', '.join(STYLES)} (default column)",
    )
    vars(action)["option"] = Option(str(action.help), names=partial(list, STYLES))


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
    parser: argparse.ArgumentParser, *, robots: Callable[[str], Any] | None = None
) -> argparse._ArgumentGroup:
    """Add the options of ``ScenarioOptions`` to the parser of a command that adds its options itself.

    Args:
        robots: function that converts the text of ``--robots``, for commands that vary the number of robots.
    """
    group = add_group(parser, "scenario", ScenarioOptions)
    for action in group._group_actions:
        if robots is not None and action.dest == "robots":
            action.type = robots
    return group


def read_result(folder: Path) -> Result:
    """Read a result from its folder: the ``Result`` of a simulation, or a ``Recording`` of real robots (a subclass)."""
    from vibroswarm.recordings.recording import Recording
    from vibroswarm.result import Result

    return Recording.read(folder) if (folder / "recording.json").is_file() else Result.read(folder)
