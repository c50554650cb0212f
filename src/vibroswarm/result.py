"""Results: the tables of some simulated or recorded runs, with their scenario, seed, versions and code hash.

On disk a result is a folder: a manifest (``core.folders``), ``scenario.toml`` and one Parquet file per table. Each
Parquet file also holds scenario, seed and versions in its metadata, so that it can be used on its own.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
import polars as pl

from vibroswarm.core.atomic_io import MANIFEST, whole_folder, write_file
from vibroswarm.core.folders import about_file, check_files, manifest_text, read_manifest
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.numbers import count
from vibroswarm.core.tables import parquet_bytes, read_frame
from vibroswarm.errors import InputError, shown, whole_number_of
from vibroswarm.floors.changes import NO_CHANGES, Changes
from vibroswarm.floors.floor import DIGITS, Floor
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario

SCENARIO: Final = "scenario.toml"
"""File of a result's scenario."""

RECORDED: Final = "recording"
"""Prefix of the source of recorded results, which have no seed."""

FLOORS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "rows": pl.UInt32,
    "columns": pl.UInt32,
    "tile_width_m": pl.Float64,
    "tile_height_m": pl.Float64,
    "left_m": pl.Float64,
    "bottom_m": pl.Float64,
    "tiles": pl.String,
    "name": pl.String,
}
"""``tiles`` holds the rows from the top at time 0, as 0 and 1, without separators."""

CHANGES: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "time_s": pl.Float64,
    "tile": pl.Int32,
    "kind": pl.UInt8,
}
"""Changes of floors during runs: which tile becomes which kind, and when; in this order of run, time and tile."""

TABLES: Final = (
    "motion", "ends", "moves", "poses", "places", "observations", "inference", "reports", "robots", "runs", "floors",
    "changes", "faults", "failures",
)  # fmt: skip
"""Names of the tables of a result; docs/results.md describes their columns."""


def write_code(folder: Path, scenarios: Iterable[Scenario], *others: str) -> None:
    """Write copies of the loaded code files of scenarios and others, such as a motion source; they are never run."""
    files: dict[str, str] = {}
    for code, text in plugins.texts_of(
        [*others, *(code for scenario in scenarios for code in scenario.codes)]
    ):
        name = code.partition(plugins.HASH)[0].rpartition(":")[0]  # of "file.py:Name sha256:..."
        if files.setdefault(name, text) != text:
            raise InputError("two different files have this name; rename one, as a copy is kept", field=name)
    for name, text in files.items():
        write_file(folder / name, text)


@dataclass(frozen=True, eq=False)
class Result(NotebookView):
    """All tables of some runs of one scenario, as polars frames (docs/results.md describes the columns)."""

    KIND: ClassVar[str] = "result"
    """Kind of the folder."""

    scenario: Scenario
    """What was simulated or recorded."""
    seed: int | None
    """Seed of the runs; None for recordings (``recordings``), which draw nothing."""
    motion: pl.DataFrame
    """Where and when robots sampled: one row per sample."""
    ends: pl.DataFrame
    """Where robots are at the end of a run: one row per robot and run."""
    observations: pl.DataFrame
    """What the samples read (class, value): one row per sample."""
    inference: pl.DataFrame
    """What a robot believed, sent and decided after each sample: one row per sample."""
    robots: pl.DataFrame
    """The outcome of each robot: one row per robot and run."""
    runs: pl.DataFrame
    """The outcome of each run: one row per run."""
    floors: pl.DataFrame
    """The floor of each run: one row per run."""
    source: str = "event"
    """Name of the motion source."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of the software that made the result, by name."""
    moves: pl.DataFrame | None = None
    """The robots' drives, turns and stops; None if they were not requested."""
    poses: pl.DataFrame | None = None
    """The robots' poses at each control tick, of a recording where they were seen; None if they were not requested."""
    faults: pl.DataFrame | None = None
    """One row per fault of a robot; None if robots cannot fail in this scenario."""
    places: pl.DataFrame | None = None
    """Where robots believed that they sampled: one row per sample; None if they do not estimate it."""
    reports: pl.DataFrame | None = None
    """What robots reported after each sample, and arrays at the end; None if the strategy declares no reports."""
    failures: pl.DataFrame | None = None
    """One row per failed run; None if no run failed."""
    changes: pl.DataFrame | None = None
    """One row per change of a tile; None if no floor changes."""

    def __eq__(self, other: object) -> bool:
        """Return whether scenario, seed, source, versions and all tables are the same."""
        if not isinstance(other, Result):
            return NotImplemented
        if (self.scenario, self.seed, self.source) != (other.scenario, other.seed, other.source):
            return False
        return dict(self.versions) == dict(other.versions) and self.same_tables(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        """Return a summary on one line: runs, robots, strategy, floor, seed, runs by kind of consensus, failed runs."""
        scenario, runs = self.scenario, self.runs.height
        outcomes = self.runs["consensus"].drop_nulls().value_counts(sort=True).rows() if runs else []
        parts = [
            count(runs, "run"),
            count(scenario.swarm.robots, "robot"),
            scenario.strategy.name,
            f"floor {shown(scenario.floor.source)}",
            "recorded" if self.seed is None else f"seed {self.seed}",
            *(f"{count} {outcome}" for outcome, count in sorted(outcomes)),
            *([] if self.failures is None else [f"{self.failures.height} failed"]),
        ]
        return f"{type(self).__name__}({', '.join(parts)})"

    def same_tables(self, other: Result) -> bool:
        """Return whether every table equals that of ``other`` without tolerance, including order and types.

        Optional tables must be absent in both or in neither. nan equals nan, and 0.0 equals -0.0.
        """
        pairs = [(getattr(self, name), getattr(other, name)) for name in TABLES]
        return all(
            (mine is None and theirs is None)
            or (
                mine is not None
                and theirs is not None
                and mine.schema == theirs.schema
                and mine.equals(theirs)
            )
            for mine, theirs in pairs
        )

    def floor(self, run: int = 0) -> Floor:
        """Return the floor of a run, with its changes.

        Args:
            run: number of the run.
        Raises:
            InputError: the result has no run of that number.
        """
        run = whole_number_of(run, "run", 0, 2**32 - 1)
        rows = self.floors.filter(pl.col("run") == run).to_dicts()
        if not rows:
            raise InputError(f"there is no run {run} in this result", field="run")
        if self.scenario.floor.has_surface:  # which the scenario says; the table has kinds of tile
            return self.scenario.floor_for(self.seed or 0, run)
        row = rows[0]
        columns = row["columns"]
        # The text ``tiles`` has a hexadecimal digit for each tile, row after row from the top.
        tiles = [
            [int(c, 16) for c in row["tiles"][i * columns : (i + 1) * columns]] for i in range(row["rows"])
        ]
        geometry = (row["tile_width_m"], row["tile_height_m"], row["left_m"], row["bottom_m"])
        return Floor(tiles, *geometry, name=row["name"], changes=self._changes_of(run))  # type: ignore[arg-type]

    def _changes_of(self, run: int) -> Changes:
        """Return the changes of a run's floor."""
        if self.changes is None:
            return NO_CHANGES
        rows = self.changes.filter(pl.col("run") == run)
        return Changes(*(rows[name].to_numpy() for name in Changes._fields))

    def write(self, path: str | Path, *, replace: bool = False) -> None:
        """Write the result as a folder, which appears complete or not at all.

        Args:
            path: the folder. replace: whether an existing result at this path is replaced.
        Raises:
            InputError: ``path`` exists and may not be replaced, or it cannot be written.
            RunError: the disk is full or failed.
        """
        with whole_folder(Path(path), replace=replace) as part:
            self.write_into(part)

    def write_into(self, folder: Path) -> None:
        """Write scenario, manifest, users' code and all tables of this result into an existing folder."""
        files = {}
        for name, data in self._contents():
            write_file(folder / name, data)
            files[name] = about_file(data)
        text = manifest_text(self.KIND, **self._about(), files=files)
        write_file(folder / MANIFEST, text)
        write_code(folder, [self.scenario], self.source)

    def _contents(self) -> Iterator[tuple[str, bytes]]:
        """Yield name and content of each file that is read back."""
        scenario = self.scenario.to_toml()
        yield SCENARIO, scenario.encode()
        metadata = {"vibroswarm": json.dumps(self._about()), "scenario": scenario}
        for name in TABLES:
            frame = getattr(self, name)
            if frame is not None:
                yield f"{name}.parquet", parquet_bytes(frame, metadata)

    def _about(self) -> dict[str, Any]:
        """Return the entries of the manifest beside its files."""
        return {
            "seed": self.seed,
            "source": self.source,
            "scenario_hash": self.scenario.hash,
            "tables": [name for name in TABLES if getattr(self, name) is not None],
            "versions": dict(self.versions),
        }

    @classmethod
    def read(cls, path: str | Path) -> Result:
        """Read a result from the folder ``path`` that ``write`` wrote; it equals the result that was written.

        Raises:
            InputError: the folder is not a result, its format is older or newer, or a file is damaged or missing.
        """
        return cls._read(Path(path))

    @classmethod
    def _read(cls, folder: Path) -> Result:
        """Read what every result has, also of a recording."""
        about = read_manifest(folder, "result", "recording")
        check_files(about, folder)
        scenario = Scenario.read(folder / SCENARIO)
        frames: dict[str, Any] = dict.fromkeys(TABLES)
        for name in about["tables"]:
            frames[name] = read_frame(folder / f"{name}.parquet", name)
        head = {name: about[name] for name in ("seed", "source", "versions")}
        return Result(scenario=scenario, **head, **frames)


def floor_frame(floors: Mapping[int, Floor]) -> pl.DataFrame:
    """Return floors as a table (``FLOORS``) with one row per run."""
    digits = np.frombuffer(DIGITS.encode(), dtype=np.uint8)
    rows = [
        (run, *floor.geometry, digits[floor.tiles].tobytes().decode("ascii"), floor.name)
        for run, floor in floors.items()
    ]
    # The inner zip turns rows into columns.
    return pl.DataFrame(dict(zip(FLOORS, zip(*rows, strict=True), strict=True)), schema=FLOORS)


def change_frame(floors: Mapping[int, Floor]) -> pl.DataFrame | None:
    """Return the changes of floors as a table (``CHANGES``), run by run; None if no floor changes."""
    changing = {run: floor.changes for run, floor in floors.items() if floor.is_changing}
    if not changing:
        return None
    parts = [
        pl.DataFrame({"run": np.full(changes.tile.size, run), **changes._asdict()}, schema=CHANGES)
        for run, changes in changing.items()
    ]
    return pl.concat(parts)
