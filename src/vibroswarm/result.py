"""Results: the tables of some simulated or recorded runs, with their scenario, seed, versions and code hash.

On disk a result is a folder: a manifest (``core.folders``), ``scenario.toml`` and one Parquet file per table. Each
Parquet file also holds scenario, seed and versions in its metadata, so that it can be used on its own.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
import polars as pl
from polars.testing import assert_frame_equal

from vibroswarm.core.atomic_io import MANIFEST, whole_file, whole_folder
from vibroswarm.core.folders import about_file, check_definition, check_files, manifest_text, read_manifest
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.numbers import count
from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.core.tables import Schema, check_table, parquet_bytes, read_table
from vibroswarm.core.untrusted_files import entry, texts, words
from vibroswarm.errors import InputError, check_flags, check_kind, named, path_of, shown, whole_number_of
from vibroswarm.floors.changes import NO_CHANGES, Changes
from vibroswarm.floors.floor import DIGITS, Floor
from vibroswarm.inference.outcomes import ROBOTS, RUNS
from vibroswarm.inference.replay import INFERENCE
from vibroswarm.inference.reports import REPORTS
from vibroswarm.localisation.locate import PLACES
from vibroswarm.motion.source import ENDS, FAILURES, MOTION, MOVES, SEGMENTS
from vibroswarm.observation.observe import MEASURED, OBSERVATIONS
from vibroswarm.result_validation import check_result
from vibroswarm.scenario import plugins
from vibroswarm.scenario.fault_draws import FAULT_COLUMNS
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

TABLES: Final[dict[str, dict[str, Any]]] = {
    "motion": MOTION,
    "ends": ENDS,
    "segments": SEGMENTS,
    "moves": MOVES,
    "places": PLACES,
    "observations": OBSERVATIONS,
    "inference": INFERENCE,
    "reports": REPORTS,
    "robots": ROBOTS,
    "runs": RUNS,
    "floors": FLOORS,
    "changes": CHANGES,
    "faults": FAULT_COLUMNS,
    "failures": FAILURES,
}
"""Columns of each table of a result, by name of the table."""

NULLABLE: Final[dict[str, frozenset[str]]] = {
    "motion": frozenset({"heading_rad", "drive_s", "turn_s", "avoid_s", "stop_s"}),
    "ends": frozenset({"x_m", "y_m", "heading_rad", "stop_start_s"}),
    "segments": frozenset(),
    "moves": frozenset({"turn_rate_rad_s", "ray_m"}),
    "places": frozenset(name for name in PLACES if name.startswith("lagged")),
    "observations": frozenset({"energy"}),
    "reports": frozenset({"value"}),
    "inference": frozenset({"message", "alpha", "beta", "messages_received", "belief_below", "decision"}),
    "robots": frozenset(
        {"decision", "decision_time_s", "belief_at_decision", "belief_below", "belief_in_truth", "alpha", "beta",
         "estimate", "estimate_spread", "messages_received"}
    ),
    "runs": frozenset({"consensus", "consensus_time_s", "truth", "right", "wrong", "undecided"}),
    "floors": frozenset(),
    "changes": frozenset(),
    "faults": frozenset(),
    "failures": frozenset(),
}  # fmt: skip
"""Columns that may be null: events that did not happen, and values that a recording cannot know."""

OPTIONAL: Final = ("segments", "moves", "changes", "faults", "places", "reports", "failures")
"""Tables that a result may lack; it has changes if a floor changes, faults if its scenario lets robots fail, places if
robots estimate them, reports if its strategy declares any, and failures if a simulator of physics gave up a run."""

KEYS: Final[dict[str, tuple[str, ...]]] = {
    "motion": ("run", "robot", "sample"),
    "ends": ("run", "robot"),
    "segments": (),
    "moves": (),
    "places": ("run", "robot", "sample"),
    "observations": ("run", "robot", "sample"),
    "inference": ("run", "robot", "sample"),
    "reports": ("run", "robot", "sample", "name", "index"),
    "robots": ("run", "robot"),
    "runs": ("run",),
    "floors": ("run",),
    "changes": ("run", "time_s", "tile"),
    "faults": ("run", "robot", "fault"),
    "failures": ("run",),
}
"""Columns that identify a row of each table; empty if the table has no such columns."""
FURTHER: Final[dict[str, Any]] = {"observations": MEASURED}
"""Type of further columns of tables that may have some."""
SCHEMAS: Final = {
    name: Schema(columns, NULLABLE[name], KEYS[name], FURTHER.get(name)) for name, columns in TABLES.items()
}
"""Columns, nullable columns and keys of each table."""


def code_files(scenarios: Iterable[Scenario], *others: str) -> dict[str, str]:
    """Return the texts of the users' code files that are used by scenarios, or by ``others``, by name of the file.

    Others are names of what no scenario has, such as the motion source; those that are no references to code are left
    out.

    Files that are not loaded in this process are left out.

    Raises:
        InputError: two different files have one name.
    """
    files: dict[str, str] = {}
    codes = [*others, *(code for scenario in scenarios for code in scenario.codes)]
    for code, text in plugins.texts_of(codes):
        name = code.partition(plugins.HASH)[0].rpartition(":")[
            0
        ]  # a reference to code is "file.py:Name sha256:..."
        if files.setdefault(name, text) != text:
            raise InputError("two different files have this name; rename one, as a copy is kept", field=name)
    return files


def write_code(folder: Path, scenarios: Iterable[Scenario], *others: str) -> None:
    """Write copies of the users' code files of ``code_files`` into an existing folder; the copies are never run.

    Raises:
        InputError: two different files have one name. RunError: the disk is full or failed.
    """
    for file_name, text in code_files(scenarios, *others).items():
        with whole_file(folder / file_name) as part:
            part.write_text(text, encoding="utf-8")


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
    segments: pl.DataFrame | None
    """The arcs of the robots' paths; None if they were not requested."""
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
        for name in TABLES:
            mine, theirs = getattr(self, name), getattr(other, name)
            if (mine is None) != (theirs is None):
                return False
            try:
                if mine is not None:
                    assert_frame_equal(mine, theirs, check_exact=True)
            except AssertionError:
                return False
        return True

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

    def check(self, run: int | None = None) -> None:
        """Check the tables as ``read`` does, as a program may have altered them.

        Args:
            run: check the rows of this run only, which takes less time; by default those of all runs.
        Raises:
            InputError: ``run`` is not a whole number, or a table is missing or does not fit the others or the scenario;
                the message names the column.
        """
        run = None if run is None else whole_number_of(run, "run", 0, 2**32 - 1)
        frames: dict[str, Any] = {name: getattr(self, name) for name in TABLES}
        for name, frame in frames.items():
            if frame is None and name in OPTIONAL:
                continue
            check_kind(frame, pl.DataFrame, f"result.{name}", "a polars data frame")
            if run is not None and frame.schema.get("run", pl.Null()).is_integer():
                frame = frame.filter(pl.col("run") == run)
            frames[name] = check_table(frame, SCHEMAS[name], f"result.{name}", name)
        if run is not None and frames["runs"].is_empty():
            raise InputError(f"there is no run {run} in this result", field="run")
        check_result(frames, self.scenario, None, simulated=self.seed is not None)

    @contextmanager
    def check_on_error(self) -> Iterator[None]:
        """Run ``check`` if the ``with`` block fails: an altered table is a better reason than the error that it caused.

        Results that are sound cost nothing; checking first would cost more than replaying a simple strategy.

        Raises:
            InputError: as of ``check``; if the tables are sound, the error of the block is raised.
        """
        try:
            yield
        except Exception:  # of any kind: nothing is swallowed, an unsound table is only named first
            self.check()
            raise

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
        check_flags(replace=replace)
        with named("path", of="--out"), whole_folder(path_of(path), replace=replace) as part:
            self.write_into(part)

    def write_into(self, folder: Path) -> None:
        """Write scenario, manifest, users' code and all tables of this result into an existing folder."""
        files = {}
        for name, data in self._contents():
            (folder / name).write_bytes(data)
            files[name] = about_file(data)
        text = manifest_text(self.KIND, **self._about(), **self._more(), files=files)
        (folder / MANIFEST).write_text(text, encoding="utf-8")
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
        """Return the entries of the manifest that all results have."""
        return {
            "seed": self.seed,
            "source": self.source,
            "scenario_hash": self.scenario.hash,
            "tables": [name for name in TABLES if getattr(self, name) is not None],
            "versions": dict(self.versions),
        }

    def _more(self) -> dict[str, Any]:
        """Return the entries of the manifest that only this class has."""
        return {}

    @classmethod
    def read(cls, path: str | Path) -> Result:
        """Read a result from the folder ``path`` that ``write`` wrote; it equals the result that was written.

        Raises:
            InputError: the folder is not a result, its format is older or newer, a table is damaged or missing, tables
                do not fit each other or the scenario, or the scenario is not the one that the manifest names.
        """
        folder = path_of(path)
        about = head_of(folder)
        result = cls._read(folder, about)
        check_files(about, folder)  # after the checks of the values, which name the column
        return result

    @classmethod
    def _read(cls, folder: Path, about: Mapping[str, Any]) -> Result:
        """Read a result whose manifest is read already, and check its values."""
        seed, source, names = about["seed"], about["source"], about["tables"]
        frames = {name: _read_table(folder, name) if name in names else None for name in TABLES}
        missing = [name for name in TABLES if frames[name] is None and name not in OPTIONAL]
        if missing:
            raise InputError(f"its manifest names no table '{missing[0]}'", field=str(folder))
        scenario = Scenario.read(folder / SCENARIO)
        check_definition(folder / SCENARIO, scenario.hash, about["scenario_hash"], about["versions"])
        check_result(frames, scenario, folder, simulated=seed is not None)
        versions = about["versions"]
        return Result(scenario=scenario, seed=seed, source=source, versions=versions, **frames)  # type: ignore[arg-type]  # tables by name


def _read_table(folder: Path, name: str) -> pl.DataFrame:
    """Read one table of a result, and check its columns against its schema.

    Raises:
        InputError: the table is missing or damaged, or does not have the columns of its schema.
    """
    return read_table(folder / f"{name}.parquet", SCHEMAS[name], name)


def head_of(folder: Path) -> dict[str, Any]:
    """Read and check the manifest of a result.

    Returns: seed (None: recorded), source, tables, scenario_hash, versions and files by name.

    Raises:
        InputError: there is no manifest of a result, or one of its entries is missing or wrong.
    """
    path = folder / MANIFEST
    about = read_manifest(folder, "result", "recording")
    source = entry(about, "source", str, path)
    # Only recordings have no seed.
    recorded = about.get("seed") is None and source.startswith(RECORDED)
    seed = None if recorded else entry(about, "seed", int, path)
    if seed is not None and not 0 <= seed < SEED_LIMIT:
        raise InputError(f"its seed, {seed}, is not a seed", field=str(path))
    return {
        "files": entry({"files": {}, **about}, "files", dict, path),
        "seed": seed,
        "source": source,
        "tables": words(entry(about, "tables", list, path), "tables", path),
        "scenario_hash": entry(about, "scenario_hash", str, path),
        "versions": texts(entry(about, "versions", dict, path), "versions", path),
    }


def floor_frame(floors: Mapping[int, Floor]) -> pl.DataFrame:
    """Return floors as a table (``FLOORS``) with one row per run.

    Args:
        floors: the floor of each run, by run number, at least one; rows are in the order of this mapping.
    """
    digits = np.frombuffer(DIGITS.encode(), dtype=np.uint8)
    rows = [
        (run, *floor.geometry, digits[floor.tiles].tobytes().decode("ascii"), floor.name)
        for run, floor in floors.items()
    ]
    # The inner zip turns rows into columns.
    return pl.DataFrame(dict(zip(FLOORS, zip(*rows, strict=True), strict=True)), schema=FLOORS)


def change_frame(floors: Mapping[int, Floor]) -> pl.DataFrame | None:
    """Return the changes of floors as a table (``CHANGES``), run by run; None if no floor changes.

    Args:
        floors: the floor of each run, by run number; rows are in the order of this mapping.
    """
    changing = {run: floor.changes for run, floor in floors.items() if floor.is_changing}
    if not changing:
        return None
    parts = [
        pl.DataFrame({"run": np.full(changes.tile.size, run), **changes._asdict()}, schema=CHANGES)
        for run, changes in changing.items()
    ]
    return pl.concat(parts)
