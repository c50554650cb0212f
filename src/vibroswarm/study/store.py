"""A folder of Parquet files, each a block of runs, named by what was asked and by a hash of its bytes.

A file is there whole, or it is not; one whose bytes do not fit its name is computed again. So killed processes, several
writers, and folders that are merged by copying need nothing more. A block of another seed, source of motion or version
of the code is not read. ``verify`` simulates a sample of the runs again: one that differs was made by other code or
libraries, on another kind of processor, or its files were changed.
"""

from __future__ import annotations

import hashlib
import inspect
import io
import json
import re
import shutil
import sys
import tempfile
import weakref
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import polars as pl

from vibroswarm.core.atomic_io import make_folder, write_file
from vibroswarm.core.tables import parquet_bytes
from vibroswarm.core.user_code import is_known
from vibroswarm.errors import InputError
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import versions
from vibroswarm.statistics.intervals import generator
from vibroswarm.study.batch import Task, simulate_runs

FOLDER: Final = "runs"
"""Folder of the files in the folder of a study."""
SCENARIOS: Final = "scenarios"
"""Folder, within, of the scenarios of all keys."""
_NAME: Final = re.compile(r"[0-9a-f]{16}-([0-9a-f]{16})\.parquet")


class Block(NamedTuple):
    """What a file holds: successive runs of some scenarios, given by their keys."""

    keys: frozenset[str]
    first: int
    last: int
    """One past the last run."""
    path: Path
    versions: Mapping[str, str]


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


class Store:
    """Blocks of one seed, source of motion and version of the code; without a folder in a temporary one."""

    def __init__(self, folder: Path | None, seed: int, motion: str) -> None:
        if folder is None:
            folder = Path(tempfile.mkdtemp(prefix="vibroswarm-"))
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.folder = folder.absolute() / FOLDER
        self.world: dict[str, Any] = {"seed": seed, "motion": motion, "code": versions()["code"]}
        self.blocks: list[Block] = []
        self.damaged: list[Path] = []
        self.other_runs = 0
        """Number of runs that another version of the code made."""
        self.ranges: dict[str, list[tuple[int, int]]] = {}
        """First run, and one past the last, of what is there of each scenario, in order."""
        self._seen: set[Path] = set()
        self.refresh()

    def name(self, keys: Iterable[str], first: int, last: int) -> str:
        """Return the first part of a file's name."""
        return _hash(json.dumps([self.world, sorted(keys), first, last]).encode())

    def has(self, keys: Iterable[str], first: int, last: int) -> bool:
        """Return whether a block was written meanwhile, by another process."""
        return any(self.folder.glob(f"{self.name(keys, first, last)}-*.parquet"))

    def put(self, frame: pl.DataFrame, keys: Collection[str], first: int, last: int) -> None:
        """Save a block."""
        about = {**self.world, "keys": sorted(keys), "first": first, "last": last, "versions": versions()}
        data = parquet_bytes(frame, {"vibroswarm": json.dumps(about)})
        make_folder(self.folder)
        write_file(self.folder / f"{self.name(keys, first, last)}-{_hash(data)}.parquet", data)

    def put_scenarios(self, scenarios: Mapping[str, Scenario]) -> None:
        """Save scenarios by key, for ``verify``."""
        make_folder(self.folder / SCENARIOS)
        for key, scenario in scenarios.items():
            if not (path := self.folder / SCENARIOS / f"{key}.toml").exists():
                write_file(path, scenario.to_toml())

    def refresh(self) -> None:
        """Read what is new in the folder."""
        new = [path for path in sorted(self.folder.glob("*.parquet")) if path not in self._seen]
        self._seen.update(new)
        for path in new:
            if named := _NAME.fullmatch(path.name):
                self._read(path, named[1])
        self.ranges = {}
        self.blocks.sort(key=lambda block: block.first)
        for block in self.blocks:
            for key in block.keys:
                self.ranges.setdefault(key, []).append((block.first, block.last))

    def _read(self, path: Path, written: str) -> None:
        data = path.read_bytes()
        if _hash(data) != written:
            self.damaged.append(path)
            return
        about = json.loads(pl.read_parquet_metadata(io.BytesIO(data))["vibroswarm"])
        block = Block(frozenset(about["keys"]), about["first"], about["last"], path, about["versions"])
        if all(about[name] == value for name, value in self.world.items()):
            self.blocks.append(block)
        elif about["code"] != self.world["code"]:
            self.other_runs += len(block.keys) * (block.last - block.first)

    def remove_damaged(self) -> None:
        """Remove damaged files, so that their runs are computed again."""
        while self.damaged:
            path = self.damaged.pop()
            path.unlink(missing_ok=True)
            self._seen.discard(path)

    def there(self, key: str, first: int, last: int) -> int:
        """Return how many of these runs of a scenario are there."""
        at, found = first, 0
        for low, high in self.ranges.get(key, ()):
            low, high = max(low, at), min(high, last)
            found, at = found + max(high - low, 0), max(at, high)
        return found

    def scan(self, keys: Collection[str], runs: int) -> pl.LazyFrame | None:
        """Return the rows of scenarios, not read yet: each run once, in no order; None if there are none."""
        wanted = set(keys)
        paths = [block.path for block in self.blocks if block.keys & wanted and block.first < runs]
        if not paths:
            return None
        rows = pl.scan_parquet(paths, glob=False).filter(pl.col("key").is_in(wanted), pl.col("run") < runs)
        twice = any(
            high > low for key in wanted for (_, high), (low, _) in pairwise(self.ranges.get(key, ()))
        )
        return rows.unique(["key", "run"], keep="any") if twice else rows

    @staticmethod
    def worlds(folder: Path) -> list[tuple[int, str]]:
        """Return the seeds and sources of motion of the runs in a folder."""
        found = set[tuple[int, str]]()
        for path in (folder / FOLDER).glob("*.parquet"):
            with suppress(pl.exceptions.PolarsError, KeyError):  # damaged
                about = json.loads(pl.read_parquet_metadata(path)["vibroswarm"])
                found.add((about["seed"], about["motion"]))
        return sorted(found) or [(0, "event")]  # which has none, but lists damaged files

    @property
    def made_by(self) -> list[Mapping[str, str]]:
        """The different ``simulation.versions`` that made the blocks."""
        return list({json.dumps(block.versions): block.versions for block in self.blocks}.values())


def key_of(scenario: Scenario, motion: str = "event") -> str | None:
    """Return what files know a scenario by: its hash, and that of registered code; None if that has no source text."""
    sources = registered_sources([scenario], motion)
    if None in sources.values():
        return None
    return scenario.hash + (_hash(json.dumps(sources).encode()) if sources else "")


def registered_sources(scenarios: Iterable[Scenario], motion: str) -> dict[str, str | None]:
    """Return a hash of the module's source text, or None, of all that is selected and has no file of its own."""
    selected = {(one.kind, one.selected) for scenario in scenarios for one in scenario.choices}
    found: dict[str, str | None] = {}
    for kind, name in sorted(selected | {("motion", motion)}):
        declared = plugins.KINDS[kind].known().get(name) if kind in plugins.KINDS else None
        if declared is not None and not declared.code:
            modules = {module for value in vars(declared).values() if (module := _module_of(value))}
            texts = [_source_of(module) for module in sorted(modules) if not is_known(module)]
            if texts:
                found[f"{kind} {name}"] = (
                    None if None in texts else _hash("\0".join(map(str, texts)).encode())
                )
    return found


def _module_of(value: Any) -> str:
    function = getattr(value, "__func__", value)
    return str(getattr(getattr(function, "py_func", function), "__module__", "")) if callable(value) else ""


def _source_of(module: str) -> str | None:
    try:
        return inspect.getsource(sys.modules[module])
    except (OSError, TypeError, KeyError):  # it was typed at a prompt
        return None


@dataclass(frozen=True)
class Verified:
    """Runs that were simulated again."""

    folder: Path
    runs: pl.DataFrame
    """A row for each: strategy, run, same, and the columns that differ."""
    saved: int
    """Number of runs in the folder."""
    damaged: tuple[Path, ...]
    """Files that cannot be read, whose runs are not among them."""

    @property
    def holds(self) -> bool:
        """Whether all of them came out the same, and no file is damaged."""
        return bool(self.runs["same"].all()) and not self.damaged


def verify(
    folder: str | Path, runs: int = 20, seed: int = 1, progress: Callable[[float], None] = lambda share: None
) -> Verified:
    """Simulate a sample of the saved runs of studies in a folder, and in those within, again."""
    folder = Path(folder)
    places = sorted(path.parents[1] for path in folder.rglob(f"{FOLDER}/{SCENARIOS}"))
    stores = [Store(place, *world) for place in places for world in Store.worlds(place)]
    saved = [
        (store, key, run)
        for store in stores
        for key, ranges in sorted(store.ranges.items())
        for run in sorted({run for first, last in ranges for run in range(first, last)})
    ]
    damaged = tuple(dict.fromkeys(path for store in stores for path in store.damaged))
    if not saved and not damaged:
        raise InputError("holds no runs of studies of this version", field=str(folder))
    drawn = generator(seed, "runs to verify").permutation(len(saved))[:runs]
    rows = []
    for place in sorted(drawn):
        store, key, run = saved[place]
        text = (store.folder / SCENARIOS / f"{key}.toml").read_text(encoding="utf-8")
        kept = store.scan([key], run + 1)
        assert kept is not None  # it is among those that are saved
        task = Task(
            ((key, text),), run, run + 1, store.world["seed"], store.world["motion"], store.world["code"]
        )
        mine, again = kept.filter(pl.col("run") == run).collect(), simulate_runs(task)
        differing = [name for name in mine.columns if not mine[name].equals(again[name], null_equal=True)]
        rows.append((Scenario.from_toml(text).strategy.name, run, not differing, ", ".join(differing)))
        progress(len(rows) / len(drawn))
    schema = {"strategy": pl.String, "run": pl.UInt32, "same": pl.Boolean, "columns": pl.String}
    return Verified(folder, pl.DataFrame(rows, schema=schema, orient="row"), len(saved), damaged)
