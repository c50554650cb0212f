"""Read the results of a study as tables of cells, robots, runs and samples, and simulate some of its runs again.

MuJoCo takes far longer than the other sources of motion. Fewer of its runs are simulated again for pictures, and they
are cached.
"""

from __future__ import annotations

import json
import shutil
import weakref
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.answers_over_time import is_followed
from vibroswarm.analysis.figures import BY_NAME, OF_READ, READ, Swarms, figures_table, stacked
from vibroswarm.analysis.map_figures import keeps_map
from vibroswarm.core.notebook_view import NotebookView, study_verbs
from vibroswarm.core.numbers import count, some, whole
from vibroswarm.core.optional_library import needed
from vibroswarm.errors import (
    InputError,
    check_choice,
    named,
    nearest,
    shown,
    whole_number_of,
)
from vibroswarm.inference.outcomes import ROBOTS, RUNS, Array, Columns, costs_of
from vibroswarm.result import Result
from vibroswarm.scenario import plugins
from vibroswarm.scenario.fields import rows_as_text
from vibroswarm.simulation import check_runs, simulate
from vibroswarm.study.batch import FURTHER, SAMPLES
from vibroswarm.study.batch_table import (
    AGREED_TABLE,
    FAILED_TABLE,
    MAPS_TABLE,
    REPORTED_TABLE,
    ROWS,
    arrays_of,
    tables_of,
)
from vibroswarm.study.plan import Group, Plan, missing, plan_of, samples_of_run
from vibroswarm.study.settled import Settled, runs_that_count, settled
from vibroswarm.study.spec import MOST_RUNS, TILES, Cell, Study
from vibroswarm.study.store import Store

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from vibroswarm.plots.picture import Picture
    from vibroswarm.study.evaluation import Comparison, ReportFile


TABLES: Final = ("robots", "runs", "samples", "cells")
"""Tables of a result that can be converted to other libraries."""


class _TemporaryFolder:
    """A new temporary folder, removed when the last result that refers to this object is garbage."""

    def __init__(self) -> None:
        self.folder = Path(mkdtemp(prefix="vibroswarm-"))
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)


ROWS_AT_A_TIME: Final = 400_000
"""Rows of a study (one per robot of a run) that are read at once by ``StudyResult.arrays``, to limit memory."""
ROWS_IN_A_PART: Final = 10_000
"""Rows of a cell, or of several small ones, that are read at once to compute the figures of their runs."""
AGAIN_S: Final = 30.0
"""Longest time for which runs of a cell of a slow source are simulated again for pictures, s."""
MUJOCO_S: Final = 1.1
"""Rough processor time to simulate one robot for 1200 s in MuJoCo, s."""
AGAIN_SAMPLES: Final = 5_000_000
"""Most samples of a cell that are simulated again for pictures, which take about 0.3 kB of memory each."""


@dataclass(frozen=True)
class StudyResult(NotebookView):
    """A study and its store.

    Tables begin with the columns ``cell`` and the varied fields, by their dotted names; they hold the names of a user's
    own strategies, sensors and tasks (files and hashes are in ``study.toml``). Those of ``rows``, ``unsorted_rows`` and
    ``tables`` have no varied fields, and those of ``tables`` have no ``cell`` either.
    """

    study: Study
    store: Store
    selected: tuple[int, ...]
    """Numbers of the cells that this result is about: all, or those that ``where`` selected."""
    _kept: _TemporaryFolder | None = field(default=None, repr=False)
    """The temporary folder of a study that is not saved, removed when no result refers to it; None if it is saved."""

    def __repr__(self) -> str:
        cells, chosen, table = len(self.study.cells), len(self.selected), self.cells
        some = "" if chosen == cells else f"{chosen} of "
        varied = f", varied: {', '.join(self.study.varied)}" if self.study.varied else ""
        done, wanted = int(table["there"].sum()), int(table["wanted"].sum())
        runs = ("" if done == wanted else f"{whole(done)} of ") + count(wanted, "run")
        where = f"in {shown(str(self.store.folder))}" if self.is_saved else "not saved"
        return f"StudyResult({some}{count(cells, 'cell')}, {runs}, {where}{varied})"

    @property
    def is_saved(self) -> bool:
        """Whether the study has a folder that stays."""
        return self._kept is None

    @classmethod
    def open(cls, folder: str | Path) -> StudyResult:
        """Open the study in a folder, see ``Store.open``."""
        store = Store.open(Path(folder))
        return cls(store.study, store, tuple(cell.number for cell in store.study.cells))

    @cached_property
    def plan(self) -> Plan:
        """The plan of the study."""
        return plan_of(self.study)

    @property
    def cells(self) -> pl.DataFrame:
        """One row per selected cell: number, varied values, name, scenario hash, group, runs wanted and stored.

        The column ``wanted`` is the number of runs that enter the cell's figures (``runs_of``); the column ``there`` is
        how many of these are stored.
        """
        rows = []
        for cell in self._cells():
            group = self._group_of[cell.number]
            requested = self.runs_of(cell.number)
            gaps = missing((0, requested), self.store.ranges(group.number))
            stored = requested - sum(last - first for first, last in gaps)
            rows.append((cell.number, cell.name, cell.hash, group.number, requested, stored))
        schema = {
            "cell": pl.UInt32,
            "name": pl.String,
            "scenario_hash": pl.String,
            "group": pl.UInt32,
            "wanted": pl.UInt32,
            "there": pl.UInt32,
        }
        frame = pl.DataFrame(rows, schema=schema, orient="row")
        return frame.select("cell").hstack(self._varied_columns).hstack(frame.drop("cell"))

    def cell(self, number: int) -> Cell:
        """Return a selected cell by its number.

        Raises:
            InputError: no selected cell has this number.
        """
        self._check_cells(number)
        if number not in self.selected:
            raise InputError(f"there is no cell {number} here", field="cell")
        return self.study.cells[number]

    def _check_cells(self, *numbers: int) -> None:
        for number in numbers:
            if not isinstance(number, int | np.integer) or number not in self._group_of:
                raise InputError(f"there is no cell {shown(number)} here", field="cell")

    def where(self, **values: Any) -> StudyResult:
        """Return the result for the selected cells in which varied fields have these values.

        Args:
            values: the value of each field, or a list of values of which a cell has one; so a value that is itself a
                list is given in a list. None: the cell does not set the field. The dot of a field's name is written as
                two underscores: ``where(strategy__name="soft")``. The last part of the name is enough if no other
                varied field ends with it: ``where(name="soft")``. A user's own code is selected by its name.
        Raises:
            InputError: a field is not varied, several varied fields end with the name, or no cell has these values.
        """
        chosen = self.selected
        for key, choices in values.items():
            name = self._field(key.replace("__", "."))
            any_of = [
                _plain(rows_as_text(one) if name == TILES else one)
                for one in (choices if isinstance(choices, list | tuple | set) else [choices])
            ]
            there = {n: _plain(self.study.cells[n].point.get(name)) for n in chosen}
            chosen = tuple(n for n in chosen if there[n] in any_of or _without_code(there[n]) in any_of)
            if not chosen:
                known = some(list(dict.fromkeys(shown(_without_code(one)) for one in there.values())), 12)
                raise InputError(f"no cell has {shown(choices)}; there is {known}", field=name)
        return StudyResult(self.study, self.store, chosen, self._kept)

    def runs_of(self, cell: int) -> int:
        """Return how many runs of a cell, counted from run 0, enter its figures.

        It is the study's number of runs, whether they are stored or not. A study with a precision has no such number:
        it is checked ("a look") after 100, 200, 400, ... runs. Once the cell's group needs no more runs (``settled``),
        the number is that of the look at which this is so. Until then, it is that of the last look whose runs are all
        stored; before the first look, it is the number of runs stored without a gap (``precision.runs_that_count``).
        """
        self._check_cells(cell)
        if self.study.runs is not None:
            return self.study.runs
        assert self.study.until is not None  # a study has either a number of runs or a precision
        group = self._group_of[cell]
        if group.number not in self._runs:
            self._runs[group.number] = runs_that_count(self.store, group, self.study.until)
        return self._runs[group.number]

    def settled(self, cell: int) -> Settled | None:
        """Return after how many runs the cell's group needed no more, and the level of the interval to report.

        A group needs no more runs if its figure is precise enough, or if it has the most runs that are allowed.

        Returns: None if the study has no precision, or if the group needs runs that are not stored yet.
        """
        self._check_cells(cell)
        until = self.study.until
        return None if until is None else settled(self.store, self._group_of[cell], until)

    @cached_property
    def _group_of(self) -> dict[int, Group]:
        """The group of each cell, by the cell's number."""
        return {cell.number: group for group in self.plan.groups for cell in group.cells}

    @cached_property
    def _runs(self) -> dict[int, int]:
        """Cache of ``precision.runs_that_count``, by number of the group."""
        return {}

    def rows(self, *cells: int) -> pl.LazyFrame:
        """Return a lazy table with one row for each cell, run and robot, sorted by cell, run and robot.

        Columns of the run are repeated for each robot. To limit memory use, collect one cell at a time. Of a study that
        is not saved, collect it while the result is there.

        Args:
            cells: by number; by default all selected cells.
        Raises:
            InputError: none of these cells has runs yet.
        """
        return self.unsorted_rows(*cells).sort("cell", "run", "robot")

    def unsorted_rows(self, *cells: int, start: int = 0, end: int = MOST_RUNS) -> pl.LazyFrame:
        """Return the table of ``rows`` in the order of the store instead, which is faster.

        Args:
            cells: by number; by default all selected cells.
            start, end: first run, and one past the last; files of other runs are not opened.
        Raises:
            InputError: none of these cells has these runs yet.
        """
        return self._scan("robots", cells, start, end)

    def _scan(self, table: str, cells: Sequence[int], start: int = 0, end: int = MOST_RUNS) -> pl.LazyFrame:
        """Return a table of the store, not read yet; the arguments are those of ``_scans``."""
        if frames := self._scans(table, cells, start, end):
            return pl.concat(frames)
        raise InputError("holds no runs of these cells yet", field=str(self.store.folder))

    def _scans(
        self, table: str, cells: Sequence[int], start: int = 0, end: int = MOST_RUNS
    ) -> list[pl.LazyFrame]:
        """Return a lazy table of the store for each group with stored rows, limited to the cells with these numbers.

        Args:
            table: ``robots``, ``samples``, ``failures``, ``agreements``, ``maps`` or ``reported``.
            cells: by number; if empty, all selected cells. start, end: first run, and one past the last.
        """
        self._check_cells(*cells)
        of_groups: dict[int, list[int]] = {}
        for cell in sorted(set(cells or self.selected)):
            of_groups.setdefault(self._group_of[cell].number, []).append(cell)
        frames = []
        for group, numbers in sorted(of_groups.items()):
            # All cells of a group have the same number of runs.
            frame = self.store.scan(group, min(self.runs_of(numbers[0]), end), table, start)
            if frame is not None:
                frames.append(frame.filter(pl.col("cell").is_in(numbers)))
        return frames

    def cells_together(self, most_rows: int = 0) -> Iterator[list[Cell]]:
        """Yield the selected cells in blocks of cells that share motion, each of one cell, or of several small ones.

        Reading cell by cell would take long, since each read scans the whole study.

        Args:
            most_rows: of a block of several cells; 0: as many as ``parts`` reads at once.
        """
        selected = set(self.selected)
        for group in self.plan.groups:
            cells = [cell for cell in group.cells if cell.number in selected]
            rows = (self.runs_of(cells[0].number) if cells else 0) * group.first.swarm.robots
            step = max((most_rows or ROWS_IN_A_PART) // max(rows, 1), 1)
            for first in range(0, len(cells), step):
                yield cells[first : first + step]

    def arrays(self, columns: Sequence[str]) -> Iterator[tuple[list[Cell], Columns, Columns]]:
        """Yield the selected cells in blocks of cells that share motion, with their columns as arrays (``arrays_of``).

        Args:
            columns: those that are read, besides run and robot.
        Raises:
            InputError: runs of a cell are missing, for example because some failed.
        """
        read = list(dict.fromkeys(["cell", "run", "robot", *columns]))
        for cells in self.cells_together(ROWS_AT_A_TIME):
            numbers, robots = [cell.number for cell in cells], cells[0].scenario.swarm.robots
            runs, stored = self.runs_of(numbers[0]), self.unsorted_rows(*numbers)
            for name in columns:
                check_choice(name, "columns", stored.collect_schema())
            rows = stored.select(read).collect()
            if rows.height != runs * robots * len(cells):
                self._refuse_missing(rows, cells)
            yield cells, *arrays_of(rows, numbers, runs, robots)

    def by_run(self, figures: Sequence[str]) -> dict[str, Array]:
        """Compute figures that need only the columns ``figures.READ``, of each run of the selected cells.

        Args:
            figures: names, of ``figures.OF_READ``; method ``figures`` has all others.
        Returns: an array (cells, runs) for each, nan where a run does not have the figure.
        Raises:
            InputError: another figure, runs of a cell are missing, or cells have different numbers of runs.
        """
        for name in figures:
            check_choice(name, "figures", OF_READ)
        places = {number: place for place, number in enumerate(self.selected)}
        if len(set(map(self.runs_of, self.selected))) > 1:
            raise InputError(
                "have different numbers of runs; select cells with the same number", field="cells"
            )
        found: dict[str, Array] = {}
        for cells, robots, of_runs in self.arrays(READ):
            ends_s = [cell.scenario.run.t_end_s for cell in cells]
            swarms = Swarms.of_arrays(robots, of_runs, ends_s, [costs_of(cell.scenario) for cell in cells])
            for name in figures:
                values = BY_NAME[name].of_run(swarms).reshape(len(cells), -1)
                shape = (len(self.selected), values.shape[1])
                found.setdefault(name, np.empty(shape))[[places[cell.number] for cell in cells]] = values
        return found

    def figures(self, cell: int) -> pl.DataFrame:
        """Return all figures of each run of a cell (``figures.run_figures``), one row per run."""
        # A list, not a generator: no Ctrl-C is raised below a call of polars.
        parts = self.parts([self.cell(cell)])
        return pl.concat(
            [figures_table(swarms, runs.select("run", "truth", "consensus")) for swarms, _, runs in parts]
        )

    def parts(self, cells: Sequence[Cell]) -> Iterator[tuple[Swarms, pl.DataFrame, pl.DataFrame]]:
        """Yield the swarms, rows and first rows of some runs of cells at a time, sorted by cell, run and robot.

        So the rows of all robots are never in memory at once. The first row of a run has all columns of the run.

        Args:
            cells: a block of ``cells_together``, or one cell.
        Raises:
            InputError: the cells have no runs yet.
        """
        numbers, agreements = [cell.number for cell in cells], self._agreements(cells)
        ends_s = np.array([cell.scenario.run.t_end_s for cell in cells])
        costs = stacked([costs_of(cell.scenario) for cell in cells])
        for rows in self._rows_in_parts(cells):
            first = np.flatnonzero(rows["robot"].to_numpy() == 0)
            runs = rows[first]
            place = np.searchsorted(numbers, runs["cell"].to_numpy())
            if agreements is not None:
                runs = runs.join(agreements, on=("cell", "run"), how="left", maintain_order="left")
            of_runs = None if costs is None else costs[place]
            yield Swarms.of_sorted(rows, runs, first, ends_s[place], of_runs), rows, runs

    def _rows_in_parts(self, cells: Sequence[Cell], columns: Sequence[str] = ()) -> Iterator[pl.DataFrame]:
        """Yield the rows of some runs of cells that share motion at a time, sorted by cell, run and robot.

        Args:
            columns: those that are read, besides cell, run and robot; empty: all.
        Raises:
            InputError: the cells have no runs yet.
        """
        read = pl.col("cell", "run", "robot", *columns) if columns else pl.all()
        numbers = [cell.number for cell in cells]
        step, is_empty = max(ROWS_IN_A_PART // (cells[0].scenario.swarm.robots * len(cells)), 1), True
        for start in range(0, self.runs_of(numbers[0]), step):
            for rows in self._scans("robots", numbers, start, start + step):
                is_empty = False
                yield rows.select(read).collect().sort("cell", "run", "robot")
        if is_empty:
            self._scan("robots", numbers)  # which raises

    def _refuse_missing(self, rows: pl.DataFrame, cells: Sequence[Cell]) -> None:
        """Raise an error about the first of these cells that has not all its runs."""
        there = dict(rows.group_by("cell").agg(pl.col("run").n_unique()).rows())
        for cell in cells:
            if there.get(cell.number, 0) < (wanted := self.runs_of(cell.number)):
                raise InputError(
                    f"has {there.get(cell.number, 0)} of {count(wanted, 'run')}; run it again",
                    field=cell.name,
                )

    def robots(self, *cells: int) -> pl.DataFrame:
        """Return the table of robots of ``cells`` (by default all selected), with ``cell`` and the varied fields."""
        return self._with_varied(self.rows(*cells).select("cell", *ROBOTS).collect())

    def runs(self, *cells: int) -> pl.DataFrame:
        """Return the table of runs of ``cells`` (by default all selected), with ``cell`` and the varied fields.

        Its last columns are the figures of how the robots of a run sampled.
        """
        # Columns of the run are the same for each robot, so one robot's rows are enough.
        rows = self.rows(*cells).filter(pl.col("robot") == 0)
        names = rows.collect_schema().names()
        extra = [name for name in names if name not in ("cell", *ROBOTS, *RUNS)]
        return self._with_varied(rows.select("cell", *RUNS, *extra).collect())

    def tables(self, cell: int, columns: Sequence[str] = ()) -> tuple[pl.DataFrame, pl.DataFrame]:
        """Return the tables of robots and of runs of one cell, as in a ``Result``.

        The table of runs also has the figures of how the robots of a run sampled.

        Args:
            columns: those that are read, besides run and robot; empty: all.
        Raises:
            InputError: the cell has no runs yet, or there is no such column.
        """
        for name in columns:
            check_choice(name, "columns", ROWS)
        parts = self._rows_in_parts([self.cell(cell)], columns)
        robots, runs = zip(*map(tables_of, parts), strict=True)
        return pl.concat(robots), pl.concat(runs)

    def samples(self, *cells: int) -> pl.DataFrame:
        """Return the table of samples of ``cells`` (by default all selected), with the varied fields.

        Rows are in the order of the store: they are not sorted by cell and run.

        Raises:
            InputError: the study does not save samples, or none of these cells has runs yet.
        """
        if "samples" not in self.study.keep:
            raise InputError(
                'saves no samples; set keep = ["samples"], or simulate them again with result()', field="keep"
            )
        return self._with_varied(self._scan("samples", cells).select(list(SAMPLES)).collect())

    def maps(self, *cells: int) -> pl.DataFrame:
        """Return how good the robots' maps are in the runs of ``cells`` (by default all selected) that keep them.

        There are no rows if no robots keep maps.
        """
        return self._stored(MAPS_TABLE, cells)

    def reported(self, *cells: int) -> pl.DataFrame:
        """Return what robots reported at the end of the runs of ``cells`` (by default all selected), means over robots.

        There are no rows if no robots report anything.
        """
        return self._stored(REPORTED_TABLE, cells)

    def failed_runs(self, *cells: int) -> pl.DataFrame:
        """Return the failed runs of ``cells`` (by default all selected), which the source of motion gave up.

        The table has the varied fields too; there are no rows if no run failed.
        """
        return self._with_varied(self._stored(FAILED_TABLE, cells))

    def agreements(self, cell: int) -> pl.DataFrame | None:
        """Return agreements and the scores of maps of one cell, sorted by run.

        The table has the columns of agreements if decisions of this cell's robots or its floor may change, and those of
        maps if its robots keep maps. It is None if neither is so, or if the runs were made before the tables existed.
        """
        found = self._agreements([self.cell(cell)])
        return None if found is None else found.drop("cell")

    def _agreements(self, cells: Sequence[Cell]) -> pl.DataFrame | None:
        """Return the table of ``agreements`` of some cells, sorted by cell and run, with the column ``cell``."""
        found = []
        for name, has in ((AGREED_TABLE, is_followed), (MAPS_TABLE, keeps_map)):
            if numbers := [cell.number for cell in cells if has(cell.scenario)]:
                found += [table for table in [self._stored(name, numbers)] if table.height]
        if not found:
            return None
        key = ["cell", "run"]
        both = found[0] if len(found) == 1 else found[0].join(found[1], on=key, how="full", coalesce=True)
        return both.sort(key)

    def saved_tables(self, cell: int) -> dict[str, pl.DataFrame]:
        """Return the tables of a shard (``batch.do_batch``) by name, with all saved rows of a cell, sorted by run."""
        further = {name: self._stored(name, (cell,)) for name in FURTHER}
        return {"robots": self.rows(cell).select(list(ROWS)).collect(), **further}

    def _stored(self, table: str, cells: Sequence[int]) -> pl.DataFrame:
        """Return one of the tables ``batch_table.OF_SOME`` for some cells; without rows if they have none."""
        scans, schema = self._scans(table, cells), FURTHER[table]
        if not scans:
            return pl.DataFrame(schema=dict(schema.columns))
        return pl.concat(scans).sort(schema.key).collect()

    def result(self, cell: int, runs: int | Iterable[int], *, poses: bool = False) -> Result:
        """Simulate runs of a cell again from the seed, with all their samples; runs of a slow source are cached.

        Args:
            cell: its number. runs: how many, from run 0, or the numbers of the runs: ``[17]`` for run 17 alone.
            poses: whether the result includes the poses between samples.
        """
        scenario, study = self.cell(cell).scenario, self.study
        if not self._is_slow:
            return simulate(scenario, study.seed, runs, motion=study.motion, poses=poses)
        numbers = check_runs(study.seed, runs)
        chosen = (cell, tuple(numbers), poses)
        if chosen not in self._again:
            self._again[chosen] = simulate(scenario, study.seed, numbers, motion=study.motion, poses=poses)
        return self._again[chosen]

    def runs_there(self, cell: int, most: int) -> list[int]:
        """Return the numbers of the first ``most`` stored runs of a cell that enter its figures, ascending."""
        self.cell(cell)  # raises if it is not selected
        most = whole_number_of(most, "most", 0, MOST_RUNS)
        ranges = self.store.ranges(self._group_of[cell].number)
        # Of each range the first ``most`` runs are enough; a set, since ranges may overlap.
        stored = sorted({run for first, last in ranges for run in range(first, min(last, first + most))})
        return [run for run in stored if run < self.runs_of(cell)][:most]

    def runs_again(self, cell: int, most: int) -> list[int]:
        """Return the numbers of the runs of a cell that are simulated again for a picture.

        These are its first ``most`` stored runs. They are fewer, at least one, if they would have more samples than
        ``AGAIN_SAMPLES``, or with a slow source of motion take longer than about ``AGAIN_S``.
        """
        scenario, again = self.cell(cell).scenario, self.runs_there(cell, most)
        if scenario.run.stop == "t_end":  # other runs may end long before
            again = again[: max(1, int(AGAIN_SAMPLES / samples_of_run(scenario)))]
        if self._is_slow:
            run_s = MUJOCO_S * scenario.swarm.robots * scenario.run.t_end_s / 1200.0
            again = again[: max(1, int(AGAIN_S / run_s))]
        return again

    @cached_property
    def _is_slow(self) -> bool:
        """Whether the source of motion takes far longer than the event engine."""
        return self.study.motion == "mujoco"

    @cached_property
    def _again(self) -> dict[tuple[int, tuple[int, ...], bool], Result]:
        """Cache of ``result`` for a slow source, by cell, runs, and whether there are poses."""
        return {}

    def to_pandas(self, table: str = "runs") -> pd.DataFrame:
        """Convert the table ``robots``, ``runs``, ``cells`` or ``samples`` to pandas.

        Raises:
            InputError: pandas or pyarrow is not installed, there is no such table, the study does not save samples, or
                no run of the selected cells is stored (only the table ``cells`` needs none).
        """
        return _pandas_of(self._table(table))

    def to_xarray(self, table: str = "runs") -> xr.Dataset:
        """Convert a table to an xarray Dataset.

        Its dimensions are the varied fields, or ``cell`` if a selected cell does not set one of them; also ``run`` for
        the tables ``runs``, ``robots`` and ``samples``, ``robot`` for the last two of them, and ``sample`` for the
        table ``samples``. Values are missing where the table has no row, for instance if no cell has a combination of
        varied values.

        Args:
            table: name of the table, as ``to_pandas`` takes it.
        Raises:
            InputError: several cells have the same varied values, so that their rows have the same place in the
                dimensions; xarray is not installed; or ``to_pandas`` raises it.
        """
        of_table = {"runs": ["run"], "robots": ["run", "robot"], "samples": ["run", "robot", "sample"]}
        rows, further = self._table(table), of_table.get(table, [])
        # xarray would give cells without a value the place of another cell.
        if any(column.null_count() for column in self._varied_columns):
            return _dataset_of(rows, ["cell", *further])
        return _dataset_of(rows.drop("cell"), [*self.study.varied, *further])

    def summary(self) -> pl.DataFrame:
        """Return one row per selected cell that has runs (``Outcome.table``): varied values, figures and their limits.

        Raises:
            InputError: no selected cell has runs.
        """
        table: pl.DataFrame = study_verbs().outcome_of(self, compare=False).table
        return table

    def compare(self, reference: str | None = None) -> Comparison:
        """Compare the cells run by run, in sentences with intervals and in a table.

        Args:
            reference: a value of a compared field, such as a strategy, with which the field's other values are
                compared; by default, every two strategies are compared, and each value of another field is compared
                with the field's first value.
        Raises:
            InputError: no compared field has the value ``reference``, or no selected cell has runs.
        """
        with named("reference", of="--reference"):
            comparison: Comparison = study_verbs().compared(self, reference)
        return comparison

    def plot(self, name: str = "outcomes", *, style: str = "column") -> Picture:
        """Draw a picture of the study.

        Args:
            name: such as ``outcomes``, ``decision_time_s``, ``robots_wrong``. style: one of ``plots.style``.
        Raises:
            InputError: there is no such style, or the study has no such picture; the message lists those it has.
        """
        picture: Picture = study_verbs().plotted(self, name, style)
        return picture

    def report(self, folder: str | Path | None = None, *, replace: bool = False) -> ReportFile:
        """Write the report, its pictures and tables.

        Args:
            folder: where; by default into the study's folder, in which an earlier report is always overwritten.
            replace: whether ``folder`` may exist; it is then replaced as a whole, with everything in it.
        Raises:
            InputError: ``folder`` exists and may not be replaced, or cannot be written.
            RunError: the disk is full or failed.
        """
        own = None if folder is None else Path(folder)
        written: ReportFile = study_verbs().reported(self, own, replace)
        return written

    def _table(self, table: str) -> pl.DataFrame:
        """Return one of ``TABLES``."""
        check_choice(table, "table", TABLES)
        return self.cells if table == "cells" else getattr(self, table)()

    def _cells(self) -> list[Cell]:
        """List the selected cells."""
        return [self.study.cells[number] for number in self.selected]

    def _field(self, name: str) -> str:
        """Return the full name of a varied field that is given by its full name or by the last part of it.

        Raises:
            InputError: no varied field, or several, have this name.
        """
        varied = self.study.varied
        if name in varied:
            return name
        with_last_part = [field for field in varied if field.rpartition(".")[2] == name]
        if len(with_last_part) > 1:
            raise InputError(
                f"is the end of several fields; give one of {', '.join(with_last_part)}", field=name
            )
        if not with_last_part:
            raise InputError(
                f"is not varied{nearest(name, varied)} (varied are {', '.join(varied)})", field=name
            )
        return with_last_part[0]

    @cached_property
    def _varied_columns(self) -> pl.DataFrame:
        """Return the varied fields as columns, one row per selected cell; null where a cell does not set a field."""
        return pl.DataFrame(
            [
                _column(name, [_without_code(cell.point.get(name)) for cell in self._cells()])
                for name in self.study.varied
            ]
        )

    def _with_varied(self, frame: pl.DataFrame) -> pl.DataFrame:
        """Return a table with the varied fields inserted after its column ``cell``."""
        varied = self._varied_columns
        if not varied.width:
            return frame
        keys = pl.DataFrame({"cell": pl.Series(self.selected, dtype=pl.UInt32)}).hstack(varied)
        joined = frame.join(keys, on="cell", how="left", maintain_order="left")
        return joined.select("cell", *varied.columns, *(c for c in frame.columns if c != "cell"))


def _plain(value: Any) -> Any:
    """Return a value that can be compared: rows of numbers in place of an array, as of tiles."""
    return value.tolist() if isinstance(value, np.ndarray) else value


def _without_code(value: Any) -> Any:
    """Return the name of code, ``voter`` of ``voter.py:voter sha256:...``, and any other value as it is."""
    return plugins.name_in(value) if plugins.is_code(value) else value


def _column(name: str, values: list[Any]) -> pl.Series:
    """Return values as a column, with null for None.

    If the values are integers and floats, they become floats. Values of otherwise mixed types, lists and tables become
    text: strings stay as they are, and other values are written as JSON.
    """
    kinds = {type(value) for value in values if value is not None}
    if kinds == {int, float}:
        return pl.Series(name, [None if v is None else float(v) for v in values])
    if len(kinds) <= 1 and not kinds & {list, tuple, dict}:
        # A column without any value becomes a column of text; otherwise polars finds the type (``dtype=None``).
        return pl.Series(name, values, dtype=pl.String if not kinds else None)
    return pl.Series(name, [v if v is None or isinstance(v, str) else json.dumps(v) for v in values])


def _pandas_of(frame: pl.DataFrame) -> pd.DataFrame:
    """Convert a table to pandas.

    Raises:
        InputError: pandas or pyarrow is not installed.
    """
    for library in ("pandas", "pyarrow"):  # the ``to_pandas`` of polars needs both
        needed(library, "frames", "to_pandas")
    return frame.to_pandas()


def _dataset_of(table: pl.DataFrame, index: Sequence[str]) -> xr.Dataset:
    """Convert a table to an xarray Dataset.

    Args:
        index: the columns that become its dimensions, in order; empty: the only dimension is ``index``.
    Raises:
        InputError: several rows have the same place in the dimensions, or xarray, pandas or pyarrow is not installed.
    """
    xarray = needed("xarray", "frames", "to_xarray")
    frame = _pandas_of(table)
    for name in frame.select_dtypes("category"):  # xarray has no categories
        frame[name] = frame[name].astype(str)
    indexed = frame.set_index(list(index)) if index else frame
    if not indexed.index.is_unique:
        raise InputError("several cells have the same varied values", field="to_xarray")
    dataset: xr.Dataset = xarray.Dataset.from_dataframe(indexed)
    return dataset
