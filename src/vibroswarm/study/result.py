"""What came of a study: its cells, robots and runs as tables that select and group by the varied fields."""

from __future__ import annotations

import json
import shutil
import weakref
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import gettempdir
from typing import TYPE_CHECKING, Any

import polars as pl

from vibroswarm.errors import InputError, nearest
from vibroswarm.inference.outcomes import ROBOTS, RUNS
from vibroswarm.leftovers import remove_leftovers_once, tag
from vibroswarm.result import Result
from vibroswarm.simulation import simulate
from vibroswarm.study.looks import Settled, runs_that_count, settled
from vibroswarm.study.plan import Group, Plan, plan_of
from vibroswarm.study.runner import Share, Tell, run_study
from vibroswarm.study.simulate_batch import SAMPLES
from vibroswarm.study.spec import Cell, Study
from vibroswarm.study.store import Store

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class _Passing:
    """A folder that goes with the last result that is in it."""

    def __init__(self) -> None:
        remove_leftovers_once(Path(gettempdir()))
        self.folder = Path(gettempdir()) / f"vibroswarm-{tag()}"
        self.folder.mkdir(mode=0o700)
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)


@dataclass(frozen=True)
class StudyResult:
    """A study and its store. Tables hold ``cell`` and the varied fields, by dotted names, before their columns."""

    study: Study
    store: Store
    selected: tuple[int, ...]
    """Numbers of the cells."""
    _kept: _Passing | None = field(default=None, repr=False)

    @classmethod
    def open(cls, folder: str | Path) -> StudyResult:
        """The study in a folder."""
        store = Store.open(folder)
        return cls(store.study, store, tuple(cell.number for cell in store.study.cells))

    @cached_property
    def plan(self) -> Plan:
        """Which cells share what."""
        return plan_of(self.study)

    @property
    def cells(self) -> pl.DataFrame:
        """One row a cell: number, what is varied, name, hash of the scenario, group, runs wanted and there."""
        rows = []
        for cell in self._cells():
            group = self._group_of[cell.number]
            wanted = self.runs_of(cell.number)
            there = self._there(group.number, wanted)
            rows.append((cell.number, cell.name, cell.scenario.hash, group.number, wanted, there))
        schema = {
            "cell": pl.UInt32,
            "name": pl.String,
            "scenario_hash": pl.String,
            "group": pl.UInt32,
            "wanted": pl.UInt32,
            "there": pl.UInt32,
        }
        frame = pl.DataFrame(rows, schema=schema, orient="row")
        return frame.select("cell").hstack(self._varied_columns()).hstack(frame.drop("cell"))

    def cell(self, number: int) -> Cell:
        """A cell by its number.

        Raises:
            InputError: there is none of this ``number``.
        """
        if number not in self.selected:
            raise InputError(f"there is no cell {number} here", field="cell")
        return self.study.cells[number]

    def where(self, **values: Any) -> StudyResult:
        """The cells in which the fields have these values; dots are two underscores: ``where(strategy__name="soft")``.

        The last part of a name is enough where no other varied field has it: ``where(name="soft")``. A list stands for
        any of its values.

        Args:
            values: what the varied fields shall be.
        Raises:
            InputError: a field is not varied, or no cell has the value.
        """
        chosen = self.selected
        for key, wanted in values.items():
            name = self._field(key.replace("__", "."))
            any_of = wanted if isinstance(wanted, list | tuple | set) else [wanted]
            chosen = tuple(n for n in chosen if self.study.cells[n].point.get(name) in any_of)
        if not chosen:
            raise InputError(f"no cell has {values}", field="where")
        return StudyResult(self.study, self.store, chosen, self._kept)

    def runs_of(self, cell: int) -> int:
        """Runs of a cell that count: as many as wanted, or as a precision took."""
        if self.study.runs is not None:
            return self.study.runs
        assert self.study.until is not None
        group = self._group_of[cell]
        if group.number not in self._runs:
            self._runs[group.number] = runs_that_count(self.store, group, self.study.until)
        return self._runs[group.number]

    def settled(self, cell: int) -> Settled | None:
        """Of a study until a precision: at which look the cell was settled, and at which level its figure is told."""
        until = self.study.until
        return None if until is None else settled(self.store, self._group_of[cell], until)

    @cached_property
    def _group_of(self) -> dict[int, Group]:
        return {cell.number: group for group in self.plan.groups for cell in group.cells}

    @cached_property
    def _runs(self) -> dict[int, int]:
        """Runs that count, by group, as they were worked out."""
        return {}

    def rows(self, *cells: int) -> pl.LazyFrame:
        """One row a cell, run and robot, with the columns of the run beside the robot's; sorted by these.

        Of the ``cells`` with these numbers; without numbers, of all. Only a cell at a time is read when the frame
        is collected cell by cell.
        """
        return self.unsorted_rows(*cells).sort("cell", "run", "robot")

    def unsorted_rows(self, *cells: int) -> pl.LazyFrame:
        """``rows`` in the order of the store, which is faster where that of the rows does not matter.

        Args:
            cells: by number; without, all that are selected.
        Raises:
            InputError: none of these cells has runs yet.
        """
        return self._scan("robots", cells)

    def _scan(self, table: str, cells: Sequence[int]) -> pl.LazyFrame:
        """The rows of a table of the store, of these cells or of all that are selected."""
        chosen, frames = cells or self.selected, []
        for group in self.plan.groups:
            mine = [cell.number for cell in group.cells if cell.number in chosen]
            frame = self.store.scan(group.number, self.runs_of(mine[0]), table) if mine else None
            if frame is not None:
                frames.append(frame.filter(pl.col("cell").is_in(mine)))
        if not frames:
            raise InputError("holds no runs of these cells yet", field=str(self.store.folder))
        return pl.concat(frames)

    def robots(self, *cells: int) -> pl.DataFrame:
        """The table of robots of these ``cells`` (without numbers, of all), with ``cell`` and the varied fields."""
        return self._with_varied(self.rows(*cells).select("cell", *ROBOTS).collect())

    def runs(self, *cells: int) -> pl.DataFrame:
        """The table of runs of these ``cells`` (without numbers, of all), with ``cell`` and the varied fields."""
        extra = [name for name in _schema(self.rows(*cells)) if name not in ("cell", *ROBOTS, *RUNS)]
        rows = self.rows(*cells).filter(pl.col("robot") == 0)
        return self._with_varied(rows.select("cell", *RUNS, *extra).collect())

    def tables(self, cell: int) -> tuple[pl.DataFrame, pl.DataFrame]:
        """The tables of robots and runs of one cell, as a ``Result`` has them (the runs with what else is kept)."""
        rows = self.rows(cell).collect()
        of_run = [name for name in rows.columns if name != "cell" and (name not in ROBOTS or name == "run")]
        return rows.select(list(ROBOTS)), rows.filter(pl.col("robot") == 0).select(of_run)

    def samples(self, *cells: int) -> pl.DataFrame:
        """The table of samples of these ``cells`` (without numbers, of all).

        Raises:
            InputError: the study does not keep it.
        """
        if "samples" not in self.study.keep:
            raise InputError(
                'keeps no samples; say keep = ["samples"], or make them again with result()', field="keep"
            )
        return self._with_varied(self._scan("samples", cells).select(list(SAMPLES)).collect())

    def result(self, cell: int, runs: int | Sequence[int], *, segments: bool = False) -> Result:
        """Runs of a cell made again from the seed, with all their samples.

        Args:
            cell: its number. runs: one, or several. segments: also keep the table from which poses can be had.
        """
        return simulate(
            self.cell(cell).scenario, self.study.seed, runs, motion=self.study.motion, segments=segments
        )

    def runs_there(self, cell: int, most: int) -> list[int]:
        """The first ``most`` runs of a cell that are there: all from 0, unless some failed."""
        ranges = sorted(self.store.ranges(self._group_of[cell].number))
        there = sorted({run for first, last in ranges for run in range(first, min(last, first + most))})
        return [run for run in there if run < self.runs_of(cell)][:most]

    def to_pandas(self, table: str = "runs") -> pd.DataFrame:
        """The table ``robots``, ``runs``, ``cells`` or ``samples`` as a pandas frame.

        Raises:
            InputError: pandas is not there, or no such table.
        """
        try:
            import pandas  # noqa: F401
        except ImportError:
            raise InputError("needs pandas: pip install 'vibroswarm[frames]'", field="to_pandas") from None
        return self._table(table).to_pandas()

    def to_xarray(self, table: str = "runs") -> xr.Dataset:
        """A table as an xarray Dataset: dimensions are the varied fields and ``run`` (and ``robot``).

        Raises:
            InputError: the cells make no grid of the varied fields, or xarray is not there.
        """
        try:
            import xarray
        except ImportError:
            raise InputError("needs xarray: pip install 'vibroswarm[frames]'", field="to_xarray") from None
        index = [
            *self.study.varied,
            *(["run"] if table in ("runs", "robots") else []),
            *(["robot"] if table == "robots" else []),
        ]
        frame = self.to_pandas(table).drop(columns="cell")
        for name in frame.select_dtypes("category"):
            frame[name] = frame[name].astype(str)
        indexed = frame.set_index(index) if index else frame
        if not indexed.index.is_unique:
            raise InputError("the cells are told apart by more than the varied fields", field="to_xarray")
        return xarray.Dataset.from_dataframe(indexed)

    def _table(self, table: str) -> pl.DataFrame:
        tables = {
            "robots": self.robots,
            "runs": self.runs,
            "samples": self.samples,
            "cells": lambda: self.cells,
        }
        if table not in tables:
            raise InputError(f"there is no table '{table}'{nearest(table, tables)}", field="table")
        return tables[table]()

    def _cells(self) -> list[Cell]:
        return [self.study.cells[number] for number in self.selected]

    def _there(self, group: int, wanted: int) -> int:
        """Runs of a group that are there, up to what is wanted."""
        count, low = 0, 0
        for first, last in sorted(self.store.ranges(group)):
            high = min(last, wanted)
            count, low = count + max(0, high - max(first, low)), max(low, high)
        return count

    def _field(self, name: str) -> str:
        varied = self.study.varied
        if name in varied:
            return name
        same = [field for field in varied if field.rpartition(".")[2] == name]
        if len(same) != 1:
            raise InputError(
                f"is not varied{nearest(name, varied)} (varied are {', '.join(varied)})", field=name
            )
        return same[0]

    def _varied_columns(self) -> pl.DataFrame:
        """What is varied, one row a selected cell; values of different types become text."""
        columns: Mapping[str, list[Any]] = {
            name: [cell.point.get(name) for cell in self._cells()] for name in self.study.varied
        }
        return pl.DataFrame([_column(name, values) for name, values in columns.items()])

    def _with_varied(self, frame: pl.DataFrame) -> pl.DataFrame:
        varied = self._varied_columns()
        if not varied.width:
            return frame
        keys = pl.DataFrame({"cell": pl.Series(self.selected, dtype=pl.UInt32)}).hstack(varied)
        joined = frame.join(keys, on="cell", how="left", maintain_order="left")
        return joined.select("cell", *varied.columns, *(c for c in frame.columns if c != "cell"))


def _column(name: str, values: list[Any]) -> pl.Series:
    kinds = {type(value) for value in values if value is not None}
    if kinds == {int, float}:
        return pl.Series(name, [None if v is None else float(v) for v in values])
    if len(kinds) <= 1 and not kinds & {list, tuple, dict}:
        return pl.Series(name, values, dtype=pl.String if not kinds else None)
    return pl.Series(
        name, [None if v is None else v if isinstance(v, str) else json.dumps(v) for v in values]
    )


def _schema(rows: pl.LazyFrame) -> list[str]:
    return rows.collect_schema().names()


def run(
    study: Study,
    folder: str | Path | None = None,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    share: Share | None = None,
    mixed: bool = False,
    tell: Tell | None = None,
    bear_failures: bool = False,
) -> StudyResult:
    """Run a study and give its result; see ``runner.run_study``. Without a folder it lasts as long as the result."""
    kept = _Passing() if folder is None else None
    where = kept.folder / "study" if kept is not None else Path(folder or "")
    store = run_study(
        study,
        where,
        executor=executor,
        workers=workers,
        share=share,
        mixed=mixed,
        tell=tell,
        bear_failures=bear_failures,
    )
    return StudyResult(study, store, tuple(cell.number for cell in study.cells), kept)
