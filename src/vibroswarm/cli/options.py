"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

from vibroswarm.cli.command_line import Option, share
from vibroswarm.core.child_python import MOST_WORKERS
from vibroswarm.core.registry import written_names

RUN: Final = "run"
"""The command whose help describes the options of a scenario."""


@dataclass(kw_only=True)
class Common:
    """Options of all commands."""

    trust: Annotated[bool, Option("run code named in scenario and study files (FILE.py:NAME)", of=RUN)] = (
        False
    )
    plain: Annotated[bool, Option("run as plain, slow Python, for debuggers", of=RUN)] = False
    quiet: Annotated[bool, Option("no progress and no plan on stderr", short="-q", of=RUN)] = False
    verbose: Annotated[bool, Option("print the traceback of an error", short="-v", of=RUN)] = False


PRESETS: Final = partial(written_names, "scenario/presets", ".toml")
Tiles = Annotated[
    str | None, Option("rows x columns of a random floor, coordinate list or picture", "RxC", of=RUN)
]
ImageThreshold = Annotated[
    float | None,
    Option("tiles of a picture vibrate from this mean brightness (default 50%)", "P", read=share, of=RUN),
]


@dataclass(kw_only=True)
class SwarmOptions:
    """A scenario without its floor: a preset or file, and what differs from it."""

    preset: Annotated[str | None, Option("{names} (default paper)", names=PRESETS, of=RUN)] = None
    scenario: Annotated[Path | None, Option("scenario in TOML, such as the one in a result", of=RUN)] = None
    strategy: Annotated[
        tuple[str, ...] | None,
        Option(
            "what robots send each other (evaluate and league compare several): {names}, or FILE.py:NAME",
            names=partial(written_names, "strategies"),
            of=RUN,
        ),
    ] = None
    robots: Annotated[tuple[int, ...] | None, Option("number of robots", of=RUN)] = None
    network: Annotated[
        str | None,
        Option(
            "which messages arrive, and when: {names}, or FILE.py:NAME",
            names=partial(written_names, "networks"),
            of=RUN,
        ),
    ] = None
    task: Annotated[
        str | None,
        Option(
            "question about the floor: {names}, or FILE.py:NAME",
            names=partial(written_names, "tasks"),
            of=RUN,
        ),
    ] = None
    energies: Annotated[Path | None, Option("draw readings from these measured energies (CSV)", of=RUN)] = (
        None
    )
    settings: Annotated[
        Sequence[str],
        Option(
            "set any field of the scenario, such as walk.walk_duration_scale_ms=9000 (FIELD= leaves it out); wins over "
            "other options, except lists of values; may be repeated",
            "FIELD=VALUE",
            name="--set",
            of=RUN,
        ),
    ] = ()


@dataclass(kw_only=True)
class ScenarioOptions(SwarmOptions):
    """A scenario."""

    floor: Annotated[str | None, Option("pattern (diagonal:0.46), random:0.48, or file", "FLOOR", of=RUN)] = (
        None
    )
    tiles: Tiles = None
    image_threshold: ImageThreshold = None


Seed = Annotated[int, Option("same scenario and seed: same result", "S")]
Json = Annotated[bool, Option("print JSON and nothing else on stdout")]
Force = Annotated[bool, Option("replace the file or folder if it exists")]
OutFile = Annotated[Path | None, Option("write this file")]


@dataclass(kw_only=True)
class Simulated(ScenarioOptions):
    """A scenario, its seed and the source of its motion."""

    seed: Annotated[int | None, Option("same scenario and seed: same result (default 1)", "S")] = None
    motion: Annotated[
        str | None,
        Option("event (default), fixed-step, mujoco, or FILE.py:NAME"),
    ] = None


@dataclass(kw_only=True)
class Paged:
    """Where results go that have a page."""

    out: Annotated[Path | None, Option("save everything here; the same command continues", "DIR")] = None
    force: Annotated[bool, Option("replace what DIR holds; finished runs of studies stay")] = False
    open: Annotated[bool, Option("open the page in the browser")] = False
    json: Json = False


@dataclass(kw_only=True)
class Required(Paged):
    """Where results go that must be saved."""

    out: Annotated[Path, Option("save everything here", "DIR")]


@dataclass(kw_only=True)
class Drawn(Paged):
    """Where results go that have a page with pictures."""

    pictures: Annotated[bool, Option("also write pictures as files, with their numbers")] = False
    no_pictures: Annotated[bool, Option("numbers only, without a page")] = False


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
