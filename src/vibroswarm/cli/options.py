"""Options that several commands share, and the types of option values."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, Literal, get_args

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.option_values import refuse, share, toml_path
from vibroswarm.core.child_python import MOST_WORKERS
from vibroswarm.core.registry import written_names
from vibroswarm.errors import InputError

Style = Literal["column", "page", "slide"]
"""Styles of pictures; the first is the default."""
STYLES: Final[tuple[str, ...]] = get_args(Style)


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
    float | None,
    Option("tiles of a picture vibrate from this mean brightness (default 50%)", "P", read=share),
]


PRESETS: Final = partial(written_names, "scenario/presets", ".toml")
STRATEGIES: Final = partial(written_names, "strategies")


@dataclass(kw_only=True)
class OneStrategy:
    """The option of commands that take one strategy."""

    strategy: Annotated[
        str | None, Option("what robots send each other: {names}, or FILE.py:NAME", names=STRATEGIES)
    ] = None


@dataclass(kw_only=True)
class OneSize:
    """The option of commands that take one swarm."""

    robots: Annotated[int | None, Option("number of robots")] = None


@dataclass(kw_only=True)
class SeveralStrategies:
    """The option of commands that compare strategies."""

    strategy: Annotated[
        tuple[str, ...] | None,
        Option(
            "what robots send each other; several are compared: {names}, or FILE.py:NAME", names=STRATEGIES
        ),
    ] = None


@dataclass(kw_only=True)
class SeveralSizes:
    """The option of commands that compare swarms."""

    robots: Annotated[tuple[int, ...] | None, Option("numbers of robots")] = None


@dataclass(kw_only=True)
class ScenarioBase:
    """What a scenario is made of besides strategy and robots: a preset or file, and what differs from it."""

    preset: Annotated[
        str | None,
        Option("{names} (default paper)", names=PRESETS),
    ] = None
    scenario: Annotated[Path | None, Option("scenario in TOML, such as the one in a result")] = None
    floor: Annotated[str | None, Option("pattern (diagonal:0.46), random:0.48, or file", "FLOOR")] = None
    tiles: Tiles = None
    image_threshold: ImageThreshold = None
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
            "set any field of the scenario, such as walk.walk_duration_scale_ms=9000 (FIELD= leaves it out); wins over "
            "other options, except lists of values; may be repeated",
            "FIELD=VALUE",
            name="--set",
        ),
    ] = ()


@dataclass(kw_only=True)
class ScenarioOptions(ScenarioBase, OneSize, OneStrategy):
    """A scenario with one strategy and one number of robots."""


MOTIONS: Final = ("event", "fixed-step", "mujoco")
"""Sources of motion of this package, as ``vibroswarm.motion`` registers them; a test compares them."""
Seed = Annotated[int, Option("same scenario and seed: same result", "S")]
ENGINE: Final = "engine: {names} (default event), or FILE.py:NAME"
Motion = Annotated[str, Option(ENGINE, names=partial(list, MOTIONS))]
Json = Annotated[bool, Option("print JSON and nothing else on stdout")]
Force = Annotated[bool, Option("replace the file or folder if it exists")]


TomlFile = Annotated[Path | None, Option("write a scenario (TOML)", read=toml_path)]
OutFile = Annotated[Path | None, Option("write this file")]


@dataclass(kw_only=True)
class Simulated(ScenarioOptions):
    """A scenario, its seed and the source of its motion."""

    seed: Seed = 1
    motion: Motion = "event"


@dataclass(kw_only=True)
class Compared(ScenarioBase, SeveralSizes, SeveralStrategies):
    """Scenarios side by side, their seed and the source of their motion; a study file has its own."""

    seed: Annotated[int | None, Option("same scenario and seed: same result (default 1)", "S")] = None
    motion: Annotated[str | None, Option(ENGINE, names=partial(list, MOTIONS))] = None


@dataclass(kw_only=True)
class Printed:
    """How results are printed."""

    json: Json = False


@dataclass(kw_only=True)
class Saved:
    """Where results go."""

    out: Annotated[
        Path | None, Option("save everything here; the same command resumes or repeats it", "DIR")
    ] = None
    force: Annotated[bool, Option("replace DIR if it holds something else")] = False


@dataclass(kw_only=True)
class Opened:
    """Whether the page is opened."""

    open: Annotated[bool, Option("open the page in the browser")] = False


@dataclass(kw_only=True)
class Pictures:
    """Whether and how pictures are written."""

    pictures: Annotated[
        bool, Option("also write the report's pictures as files, and their numbers as CSV")
    ] = False
    no_pictures: Annotated[bool, Option("numbers only, without pictures")] = False
    style: Annotated[Style | None, Option("style of picture files: column, page, slide (default column)")] = (
        None
    )

    def __post_init__(self) -> None:
        """Refuse options that exclude each other."""
        refuse_both(self, "pictures", "no_pictures")


@dataclass(kw_only=True)
class Paged(Opened, Saved, Printed):
    """Where results go that have a page."""

    def __post_init__(self) -> None:
        """Refuse to open a page that is not saved."""
        refuse(self.open and self.out is None, "--open", "needs --out DIR, where the page is saved")


@dataclass(kw_only=True)
class Drawn(Pictures, Paged):
    """Where results go that have a page with pictures."""

    def __post_init__(self) -> None:
        """Refuse options that exclude each other, and a page or pictures that are not saved."""
        Pictures.__post_init__(self)
        Paged.__post_init__(self)
        for option in ("pictures", "style"):
            refuse(
                getattr(self, option) and self.out is None,
                f"--{option}",
                "needs --out DIR, where the pictures are saved",
            )


Workers = Annotated[
    int | None, Option("threads or processes (default: all processors)", low=1, high=MOST_WORKERS)
]


@dataclass(kw_only=True)
class Where:
    """Where runs are executed."""

    workers: Workers = None
    executor: Annotated[str, Option("threads (default), processes, or dask://HOST:PORT", "WHERE")] = "threads"

    @property
    def where(self) -> dict[str, Any]:
        """Executor and workers as keyword arguments of functions that simulate."""
        return {"executor": self.executor, "workers": self.workers}


@dataclass(kw_only=True)
class Parts(Where):
    """Where runs are executed, and which of them."""

    shard: Annotated[
        str | None, Option("run only part K of N; copy the folders into one to join them", "K/N")
    ] = None


@dataclass(kw_only=True)
class Comparisons:
    """How cells are compared."""

    reference: Annotated[
        str | None,
        Option("compare with this strategy (or other varied value) only; default: strategies in all pairs"),
    ] = None


def run_plain() -> None:
    """Run kernels as plain Python in this process and its children, unless they are loaded already.

    ``core.jit`` reads the environment variable only once: when it is first imported.
    """
    if "vibroswarm.core.jit" not in sys.modules:
        os.environ["VIBROSWARM_PLAIN"] = "1"
