"""Read the results of a study as tables of cells, robots, runs and samples; merge jobs of a study into one store."""

from __future__ import annotations

import inspect
import json
import shutil
import weakref
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import gettempdir
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.core.atomic_io import remove_leftovers_once, tag, whole_file
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.progress_line import ProgressLine, is_watched
from vibroswarm.errors import (
    InputError,
    RunError,
    check_callable,
    check_choice,
    check_keywords,
    check_kind,
    nearest,
    path_of,
    shown,
    whole_number_of,
)
from vibroswarm.inference.outcomes import ROBOTS, RUNS
from vibroswarm.motion.source import ROBOT_S, robot_s_of
from vibroswarm.result import Result
from vibroswarm.simulation import simulate
from vibroswarm.study.batch import SAMPLES
from vibroswarm.study.batch_table import FAILED_RUNS, FAILED_TABLE
from vibroswarm.study.plan import Group, Plan, missing, plan_of
from vibroswarm.study.precision import Settled, runs_that_count, settled
from vibroswarm.study.runner import Job, Progress, StudyProgress, run_study
from vibroswarm.study.spec import MOST_RUNS, Cell, Study
from vibroswarm.study.store import SHARDS, Store

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from vibroswarm.plots.picture import Picture
    from vibroswarm.study.study_outputs import Comparison, ReportFile

TABLES: Final = ("robots", "runs", "samples", "cells")


class _TemporaryFolder:
    """A temporary folder that is removed with the last result that uses it."""

    def __init__(self) -> None:
        remove_leftovers_once(Path(gettempdir()))
        self.folder = Path(gettempdir()) / f"vibroswarm-{tag()}"
        self.folder.mkdir(mode=0o700)
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)


AGAIN_S: Final = 30.0
"""Longest time for which runs of a cell of a slow source are simulated again, for pictures and references, s."""


@dataclass(frozen=True)
class StudyResult(NotebookView):
    """A study and its store. Tables hold ``cell`` and the varied fields, by dotted names, before their columns."""

    study: Study
    store: Store
    selected: tuple[int, ...]
    """Numbers of the cells."""
    _kept: _TemporaryFolder | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        cells, chosen, table = len(self.study.cells), len(self.selected), self.cells
        count = f"{chosen}" if chosen == cells else f"{chosen} of {cells}"
        varied = f", varied: {', '.join(self.study.varied)}" if self.study.varied else ""
        done, wanted = int(table["there"].sum()), int(table["wanted"].sum())
        runs = f"{done:,} runs" if done == wanted else f"{done:,} of {wanted:,} runs"
        where = "not saved" if self._kept is not None else f"in {shown(str(self.store.folder))}"
        return f"StudyResult({count} cell{'s' * (chosen != 1)}, {runs}, {where}{varied})"

    @classmethod
    def open(cls, folder: str | Path) -> StudyResult:
        """Open the study in a folder."""
        store = Store.open(path_of(folder, "folder"))
        return cls(store.study, store, tuple(cell.number for cell in store.study.cells))

    @cached_property
    def plan(self) -> Plan:
        """The plan of the study."""
        return plan_of(self.study)

    @property
    def cells(self) -> pl.DataFrame:
        """One row per cell: number, varied values, name, scenario hash, group, runs wanted and stored (``there``)."""
        rows = []
        for cell in self._cells():
            group = self._group_of[cell.number]
            requested = self.runs_of(cell.number)
            stored = self._there(group.number, requested)
            rows.append((cell.number, cell.name, cell.scenario.hash, group.number, requested, stored))
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
        """Return a cell by its number.

        Raises:
            InputError: there is none of this ``number``.
        """
        if number not in self.selected:
            raise InputError(f"there is no cell {number} here", field="cell")
        return self.study.cells[number]

    def where(self, **values: Any) -> StudyResult:
        """Select cells in which fields have these values; a dot is two underscores: ``where(strategy__name="soft")``.

        The last part of a name is enough if no other varied field shares it: ``where(name="soft")``. A list matches
        any of its values.

        Args:
            values: values of varied fields.
        Raises:
            InputError: a field is not varied, or no cell has the value.
        """
        chosen = self.selected
        for key, choices in values.items():
            name = self._field(key.replace("__", "."))
            any_of = choices if isinstance(choices, list | tuple | set) else [choices]
            chosen = tuple(n for n in chosen if self.study.cells[n].point.get(name) in any_of)
        if not chosen:
            raise InputError(f"no cell has {values}", field="where")
        return StudyResult(self.study, self.store, chosen, self._kept)

    def runs_of(self, cell: int) -> int:
        """Return the number of runs of a cell that enter its figures.

        If the study has a number of runs, it is that number. With a precision it is the look at which the cell's group
        reached the precision (or the limit of runs); while it needs more runs, the last complete look.
        """
        if self.study.runs is not None:
            return self.study.runs
        assert self.study.until is not None
        group = self._group_of[cell]
        if group.number not in self._runs:
            self._runs[group.number] = runs_that_count(self.store, group, self.study.until)
        return self._runs[group.number]

    def settled(self, cell: int) -> Settled | None:
        """Return the look at which a cell needs no more runs, and the level at which its figure is reported.

        None if the study has no precision, or if the cell's group needs runs that do not exist yet.
        """
        until = self.study.until
        return None if until is None else settled(self.store, self._group_of[cell], until)

    @cached_property
    def _group_of(self) -> dict[int, Group]:
        return {cell.number: group for group in self.plan.groups for cell in group.cells}

    @cached_property
    def _runs(self) -> dict[int, int]:
        """Cache of the runs that count, by group."""
        return {}

    def rows(self, *cells: int) -> pl.LazyFrame:
        """Scan rows of ``cells`` (by default all), one for each cell, run and robot, sorted by these.

        Columns of the run are repeated for each robot. To limit memory use, collect one cell at a time.
        """
        return self.unsorted_rows(*cells).sort("cell", "run", "robot")

    def unsorted_rows(self, *cells: int) -> pl.LazyFrame:
        """Scan ``rows`` in the order of the store, which is faster.

        Args:
            cells: by number; by default all selected cells.
        Raises:
            InputError: none of these cells has runs yet.
        """
        return self._scan("robots", cells)

    def _scan(self, table: str, cells: Sequence[int]) -> pl.LazyFrame:
        """Scan a table of the store for these cells, or for all selected ones."""
        if frames := self._scans(table, cells):
            return pl.concat(frames)
        raise InputError("holds no runs of these cells yet", field=str(self.store.folder))

    def _scans(self, table: str, cells: Sequence[int]) -> list[pl.LazyFrame]:
        """Scan a table of the store for cells (by default all selected ones), a frame for each group that has rows."""
        chosen, frames = cells or self.selected, []
        for group in self.plan.groups:
            numbers = [cell.number for cell in group.cells if cell.number in chosen]
            frame = self.store.scan(group.number, self.runs_of(numbers[0]), table) if numbers else None
            if frame is not None:
                frames.append(frame.filter(pl.col("cell").is_in(numbers)))
        return frames

    def robots(self, *cells: int) -> pl.DataFrame:
        """Read the table of robots of ``cells`` (by default all), with ``cell`` and the varied fields."""
        return self._with_varied(self.rows(*cells).select("cell", *ROBOTS).collect())

    def runs(self, *cells: int) -> pl.DataFrame:
        """Read the table of runs of ``cells`` (by default all), with ``cell`` and the varied fields."""
        rows = self.rows(*cells).filter(pl.col("robot") == 0)
        names = rows.collect_schema().names()
        extra = [name for name in names if name not in ("cell", *ROBOTS, *RUNS)]
        return self._with_varied(rows.select("cell", *RUNS, *extra).collect())

    def tables(self, cell: int) -> tuple[pl.DataFrame, pl.DataFrame]:
        """Read the tables of robots and runs of one cell, as in a ``Result``; runs also have the sampling figures."""
        rows = self.rows(cell).collect()
        of_run = [name for name in rows.columns if name != "cell" and (name not in ROBOTS or name == "run")]
        return rows.select(list(ROBOTS)), rows.filter(pl.col("robot") == 0).select(of_run)

    def samples(self, *cells: int) -> pl.DataFrame:
        """Read the table of samples of ``cells`` (by default all).

        Raises:
            InputError: the study does not save samples.
        """
        if "samples" not in self.study.keep:
            raise InputError(
                'saves no samples; set keep = ["samples"], or simulate them again with result()', field="keep"
            )
        return self._with_varied(self._scan("samples", cells).select(list(SAMPLES)).collect())

    def failed_runs(self, *cells: int) -> pl.DataFrame:
        """List the runs of ``cells`` (by default all) that the source of motion gave up; empty if there are none.

        See ``study.batch_table``.
        """
        scans = self._scans(FAILED_TABLE, cells)
        return self._with_varied(
            pl.concat(scans).sort("cell", "run").collect() if scans else pl.DataFrame(schema=FAILED_RUNS)
        )

    def result(self, cell: int, runs: int | Sequence[int], *, segments: bool = False) -> Result:
        """Simulate runs of a cell again from the seed, with all their samples.

        Args:
            cell: its number. runs: one or several. segments: include the table from which poses are computed.
        """
        scenario, study = self.cell(cell).scenario, self.study
        if not self._is_slow:
            return simulate(scenario, study.seed, runs, motion=study.motion, segments=segments)
        chosen = (cell, (runs,) if isinstance(runs, int) else tuple(runs), segments)
        if chosen not in self._again:
            self._again[chosen] = simulate(scenario, study.seed, runs, motion=study.motion, segments=segments)
        return self._again[chosen]

    def runs_there(self, cell: int, most: int) -> list[int]:
        """List the numbers of the first ``most`` stored runs of a cell: 0, 1, ..., without failed and missing ones."""
        self.cell(cell)
        most = whole_number_of(most, "most", 0, MOST_RUNS)
        ranges = sorted(self.store.ranges(self._group_of[cell].number))
        stored = sorted({run for first, last in ranges for run in range(first, min(last, first + most))})
        return [run for run in stored if run < self.runs_of(cell)][:most]

    def runs_again(self, cell: int, most: int) -> list[int]:
        """List the runs of a cell that are simulated again for a picture or a reference.

        These are the first ``most`` stored ones. With a slow source of motion they are only as many as take
        ``AGAIN_S``, but at least one.
        """
        if self._is_slow:
            most = max(1, min(most, int(AGAIN_S / self._group_of[cell].run_s)))
        return self.runs_there(cell, most)

    @cached_property
    def _is_slow(self) -> bool:
        return robot_s_of(self.study.motion) > ROBOT_S

    @cached_property
    def _again(self) -> dict[tuple[int, tuple[int, ...], bool], Result]:
        """Runs of a slow source that were simulated again."""
        return {}

    def to_pandas(self, table: str = "runs") -> pd.DataFrame:
        """Convert the table ``robots``, ``runs``, ``cells`` or ``samples`` to pandas.

        Raises:
            InputError: pandas is not installed, or there is no such table.
        """
        from vibroswarm.study.study_outputs import pandas_of

        return pandas_of(self._table(table))

    def to_xarray(self, table: str = "runs") -> xr.Dataset:
        """Convert a table to an xarray Dataset; its dimensions are the varied fields and ``run`` (and ``robot``).

        Raises:
            InputError: the cells form no grid of the varied fields, or xarray is not installed.
        """
        from vibroswarm.study.study_outputs import dataset_of

        return dataset_of(self, table)

    def summary(self) -> pl.DataFrame:
        """Summarise the cells: one row each with the varied values, then all figures with ``_low`` and ``_high``."""
        from vibroswarm.study.summary import outcome_of

        return outcome_of(self, compare=False).table

    def compare(self, reference: str | None = None, *, confirm: bool = False) -> Comparison:
        """Compare the cells run by run, in sentences with intervals and in a table.

        Args:
            reference: a value of a compared field, such as a strategy, with which all others are compared; by default
                all pairs of strategies. confirm: run the study on other seeds too, to confirm differences.
        Raises:
            InputError: no compared field has the value ``reference``.
        """
        from vibroswarm.study.study_outputs import compared

        return compared(self, reference, confirm)

    def plot(self, name: str = "outcomes", *, style: str = "column") -> Picture:
        """Draw a picture of the study.

        Args:
            name: such as ``outcomes``, ``decision_time_s``, ``robots_wrong``. style: of ``plots.style``.
        Raises:
            InputError: the study has no such picture, and the message lists those it has; or no such style.
        """
        from vibroswarm.study.study_outputs import plotted

        return plotted(self, name, style)

    def report(self, folder: str | Path | None = None, *, replace: bool = False) -> ReportFile:
        """Write the report, its pictures and tables.

        Args:
            folder: where; by default into the study's folder. replace: whether an earlier report there is replaced.
        Raises:
            InputError: the folder exists, or cannot be written. RunError: the disk is full or failed.
        """
        from vibroswarm.study.study_outputs import reported

        return reported(self, None if folder is None else path_of(folder, "folder"), replace)

    def _table(self, table: str) -> pl.DataFrame:
        check_choice(table, "table", TABLES)
        return self.cells if table == "cells" else getattr(self, table)()

    def _cells(self) -> list[Cell]:
        return [self.study.cells[number] for number in self.selected]

    def _there(self, group: int, wanted: int) -> int:
        """Count the stored runs of a group among those wanted."""
        return wanted - sum(last - first for first, last in missing((0, wanted), self.store.ranges(group)))

    def _field(self, name: str) -> str:
        """Return the full name of a varied field; refuse unknown and ambiguous ones."""
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
        """Tabulate the varied values, one row per selected cell; values of different types become text."""
        columns: Mapping[str, list[Any]] = {
            name: [cell.point.get(name) for cell in self._cells()] for name in self.study.varied
        }
        return pl.DataFrame([_column(name, values) for name, values in columns.items()])

    def _with_varied(self, frame: pl.DataFrame) -> pl.DataFrame:
        """Add the varied fields to a table with the column ``cell``."""
        varied = self._varied_columns()
        if not varied.width:
            return frame
        keys = pl.DataFrame({"cell": pl.Series(self.selected, dtype=pl.UInt32)}).hstack(varied)
        joined = frame.join(keys, on="cell", how="left", maintain_order="left")
        return joined.select("cell", *varied.columns, *(c for c in frame.columns if c != "cell"))


def _column(name: str, values: list[Any]) -> pl.Series:
    """Return values of any types as a column; mixed types become text."""
    kinds = {type(value) for value in values if value is not None}
    if kinds == {int, float}:
        return pl.Series(name, [None if v is None else float(v) for v in values])
    if len(kinds) <= 1 and not kinds & {list, tuple, dict}:
        return pl.Series(name, values, dtype=pl.String if not kinds else None)
    return pl.Series(
        name, [None if v is None else v if isinstance(v, str) else json.dumps(v) for v in values]
    )


def run(
    study: Study,
    folder: str | Path | None = None,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    job: Job | None = None,
    mixed: bool = False,
    progress: Progress | None = None,
    allow_failures: bool = False,
) -> StudyResult:
    """Run a study and return its result; see ``runner.run_study``. Without a folder it is saved only temporarily."""
    folder = None if folder is None else path_of(folder, "folder")
    check_callable(progress, "progress")
    if job is not None:
        check_kind(job, Job, "job", "a Job")
    kept = _TemporaryFolder() if folder is None else None
    target = kept.folder / "study" if kept is not None else Path(folder or "")
    store = run_study(
        study,
        target,
        executor=executor,
        workers=workers,
        job=job,
        mixed=mixed,
        progress=progress,
        allow_failures=allow_failures,
    )
    return StudyResult(study, store, tuple(cell.number for cell in study.cells), kept)


def run_with_bar(
    study: Study, folder: str | Path | None, progress: Progress | bool, how: Mapping[str, Any]
) -> StudyResult:
    """Run a study as ``Study.run`` does; ``progress=True`` shows a bar if the output is a terminal or a notebook."""
    check_keywords(how, "run", [name for name in inspect.signature(run).parameters if name != "study"])
    if not isinstance(progress, bool):
        return run(study, folder, progress=progress, **how)
    if not (progress and is_watched()):
        return run(study, folder, **how)
    line = ProgressLine("simulating")
    try:
        return run(study, folder, progress=lambda now: line.show(now.done, now.wanted, _failed(now)), **how)
    finally:
        line.end()


def _failed(now: StudyProgress) -> str:
    return f"{now.failed} batches failed" if now.failed else ""


def merge(out: Path, shares: Sequence[Path]) -> Store:
    """Merge the stores of several jobs into one.

    Raises:
        InputError: a folder holds no study or another study, or versions differ.
        RunError: a shard is damaged or runs are missing, which are listed; the merged store is kept.
    """
    stores = [Store.open(folder) for folder in shares]
    for store in stores[1:]:
        if store.study.hash != stores[0].study.hash:
            raise InputError(f"is of another study than '{shares[0]}'", field=str(store.folder))
    for store in stores:
        if store.study.until is not None:
            raise InputError(
                "runs until a precision; such a study has no jobs to merge", field=str(store.folder)
            )
    runs = max((store.study.runs or 0 for store in stores), default=0)
    together = Store(Path(out), stores[0].study, shards=[s for store in stores for s in store.shards])
    together.check_alike()
    joined = Store.open_or_create(out, stores[0].study.with_runs(runs))
    present = {shard.name for shard in joined.shards}
    for store in stores:
        for shard in store.shards:
            if shard.name in present:
                continue
            for path in [*shard.files.values(), store.folder / SHARDS / f"{shard.name}.json"]:
                with whole_file(joined.folder / SHARDS / path.name) as part:
                    shutil.copyfile(path, part)
    joined.refresh()
    joined.check_alike()
    damaged = [f"{store.folder}: {words}" for store in stores for words in store.damaged]
    lost = [
        f"{group.number}:{first}-{last}"
        for group in plan_of(joined.study).groups
        for _, first, last in joined.missing(group, runs)
    ]
    if lost:
        damage = f" (damaged: {'; '.join(damaged[:3])})" if damaged else ""
        some = ", ".join(lost[:5]) + (f" and {len(lost) - 5} more" if len(lost) > 5 else "")
        raise RunError(
            f"'{out}' is incomplete: batches {some} are in none of the folders{damage}. Run the job that lacks them "
            f"again and merge it too, or finish here: vibroswarm sweep '{out / 'study.toml'}' --out '{out}'"
        )
    return joined
