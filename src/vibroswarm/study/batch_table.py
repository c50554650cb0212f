"""The tables of a batch: one with a row for each cell, run and robot, and one of the runs that failed.

Rows are collected in arrays of shape (cells, runs, robots), and turned into one table at the end: making a table for
each cell and joining these takes many times as long.

A run fails if its source of motion gives it up; MuJoCo does so when a number is no longer finite. The robots of a
failed run stand from then on and count as undecided in every figure, so a study lists and counts these runs. The files
of a batch (its shard) contain the table of failures only if a run failed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.answers_over_time import AGREEMENTS, JUDGED
from vibroswarm.analysis.map_figures import MAP_FIGURES, MAPPED
from vibroswarm.analysis.sampling import WALK as OF_WALK
from vibroswarm.core.numbers import count, number, whole
from vibroswarm.core.tables import Schema
from vibroswarm.inference.outcomes import ROBOTS, RUNS, as_series
from vibroswarm.inference.reports import REPORTED
from vibroswarm.motion.motion_tables import FAILURES

Columns = Mapping[str, NDArray[Any]]
"""Arrays by the names of columns."""

WALK: Final = {name: kind for name, kind in OF_WALK.items() if name not in ("run", "samples")}
"""Columns of the run about how its robots sampled, see ``analysis.sampling``."""
OF_ROBOTS: Final = {name: kind for name, kind in ROBOTS.items() if name not in ("run", "robot")}
"""Columns with a value for each robot."""
OF_RUNS: Final = {**{name: kind for name, kind in RUNS.items() if name != "run"}, **WALK}
"""Columns with a value for each run."""

ROWS: Final[dict[str, Any]] = {"cell": pl.UInt32, **ROBOTS, **OF_RUNS}
"""Columns of the table with one row for each cell, run and robot: those of the robot, then those of its run."""

_ARRAY_TYPES: Final = {
    pl.Float64: np.float64, pl.UInt32: np.uint32, pl.UInt16: np.uint16, pl.Int8: np.int8, pl.Boolean: np.bool_,
}  # fmt: skip
"""Type of the array in which a column of a polars type is collected; Enum columns are not listed."""
_FLOAT_COLUMNS: Final = dict.fromkeys(("truth", "alpha", "beta"), np.float64)
"""Columns of whole numbers that may be missing, and are therefore collected as floats with nan."""


class BatchRows:
    """Collects the rows of a batch, and makes a table of them.

    Args:
        cells: numbers of all cells of the batch. runs: all runs of the batch. robots: number of robots in a run.
    """

    def __init__(self, cells: Sequence[int], runs: range, robots: int) -> None:
        self.cells, self.runs, self.robots = sorted(cells), runs, robots
        self._index_of = {cell: index for index, cell in enumerate(self.cells)}  # along the first axis
        shape = (len(self.cells), len(runs))
        self._of_robots = _empty(OF_ROBOTS, (*shape, robots))
        self._of_runs = _empty(OF_RUNS, shape)

    def put(self, cells: Sequence[Sequence[int]], first_run: int, robots: Columns, runs: Columns) -> None:
        """Store the outcomes of some cells in consecutive runs, of which ``first_run`` is the first.

        Args:
            cells: for each row of the arrays, the numbers of the cells to which the row applies.
            robots: columns ``OF_ROBOTS``, (rows, runs, robots) each.
            runs: columns ``OF_RUNS``, (rows, runs) each, or (runs,) if all cells share the values.
        """
        # For each cell, its index along the first axis of the stored arrays, and the row that applies to it.
        place = [self._index_of[cell] for equal_cells in cells for cell in equal_cells]
        row = [k for k, equal_cells in enumerate(cells) for _ in equal_cells]
        low = first_run - self.runs.start  # index of the first run in the stored arrays
        for name, array in self._of_robots.items():
            array[place, low : low + robots[name].shape[-2]] = robots[name][row]
        for name, array in self._of_runs.items():
            values = runs[name]
            array[place, low : low + values.shape[-1]] = values if values.ndim == 1 else values[row]

    def table(self) -> pl.DataFrame:
        """Return the table ``ROWS``, sorted by cell, run and robot; ``put`` must have stored all cells and runs."""
        cells, runs, robots = len(self.cells), len(self.runs), self.robots
        run_numbers = np.arange(self.runs.start, self.runs.stop)
        columns: dict[str, NDArray[Any]] = {
            "cell": np.repeat(np.array(self.cells, dtype=np.uint32), runs * robots),
            "run": np.tile(np.repeat(run_numbers, robots), cells),
            "robot": np.tile(np.arange(robots), cells * runs),
            **{name: array.ravel() for name, array in self._of_robots.items()},
            **{name: np.repeat(array, robots) for name, array in self._of_runs.items()},
        }
        return pl.DataFrame([as_series(name, columns[name], kind) for name, kind in ROWS.items()])


def _empty(kinds: Mapping[str, Any], shape: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """Return an uninitialised array for each column; an Enum column stores the index of its word (uint8)."""
    types = {name: _FLOAT_COLUMNS.get(name, _ARRAY_TYPES.get(kind, np.uint8)) for name, kind in kinds.items()}
    return {name: np.empty(shape, dtype=kind) for name, kind in types.items()}


def tables_of(rows: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Divide rows of one cell, one for each run and robot, into a table of robots and one of runs, as a ``Result`` has.

    Columns that the rows do not have are in neither. The table of runs also has the figures of how the robots of a run
    sampled.
    """
    # ``run`` is the only column that both tables have.
    of_run = [name for name in rows.columns if name != "cell" and (name not in ROBOTS or name == "run")]
    of_robot = [name for name in ROBOTS if name in rows.columns]
    return rows.select(of_robot), rows.filter(pl.col("robot") == 0).select(of_run)


def values_of(column: pl.Series) -> NDArray[Any]:
    """Return a column of ``ROWS`` as numbers, (rows,): nan in place of null, and an Enum's words as their index."""
    if isinstance(column.dtype, pl.Enum):
        return column.to_physical().to_numpy()
    return column.cast(pl.Float64).to_numpy() if column.null_count() else column.to_numpy()


def arrays_of(
    rows: pl.DataFrame, cells: Sequence[int], runs: int, robots: int
) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """Turn rows in any order into arrays by cell, run and robot.

    Args:
        rows: the columns cell, run and robot, and any others of ``ROWS``; each cell, run and robot has one row.
        cells: their numbers, ascending. runs: number of runs, which are numbered from 0. robots: number of robots.
    Returns: the columns of robots, run and robot included, (cells, runs, robots) each, and the columns of runs, (cells,
        runs) each. Null is nan; the consensus is its index in ``outcomes.CONSENSUS``.
    Raises:
        ValueError: the number of rows is not that of all cells, runs and robots.
    """
    shape = (len(cells), runs, robots)
    cell, run, robot = (rows[name].to_numpy().astype(np.int64) for name in ("cell", "run", "robot"))
    # Index of each row after sorting by cell, run and robot.
    place = (np.searchsorted(np.array(cells), cell) * runs + run) * robots + robot
    if rows.height != math.prod(shape):
        raise ValueError(f"{rows.height} rows for {shape} cells, runs and robots; one row for each is needed")
    of_robots: dict[str, NDArray[Any]] = {}
    of_runs: dict[str, NDArray[Any]] = {}
    for column in rows.drop("cell"):
        values = values_of(column)
        sorted_ = np.empty(rows.height, dtype=values.dtype)
        sorted_[place] = values
        if column.name in ROBOTS:
            of_robots[column.name] = sorted_.reshape(shape)
        else:  # a column of the run, the same for all robots; a copy, so that the values of all robots are freed
            of_runs[column.name] = sorted_.reshape(shape)[:, :, 0].copy()
    return of_robots, of_runs


def walked(figures: Columns, runs: range) -> dict[str, NDArray[np.float64]]:
    """Return the columns ``WALK`` with a value for each run, (runs,) each; nan for runs in which no robot sampled.

    Args:
        figures: the result of ``Walk.figures``: columns with values only for the runs in which a robot sampled.
        runs: the numbers of all runs, consecutive.
    """
    place = np.asarray(figures["run"], dtype=np.int64) - runs.start
    columns = {name: np.full(len(runs), np.nan) for name in WALK}
    for name, column in columns.items():
        column[place] = figures[name]
    return columns


AGREED_TABLE: Final = "agreements"
"""Of swarms whose opinions may change, and of answers over time where the floor changes."""
MAPS_TABLE: Final = "maps"
"""Scores of the maps of robots that keep some."""
REPORTED_TABLE: Final = "reported"
"""What robots reported at the end of their runs."""
FAILED_TABLE: Final = "failures"
"""One row per cell and failed run: since when the robots stand, and why."""


def _of_cells(columns: Mapping[str, Any], nullable: Iterable[str], *key: str) -> Schema:
    return Schema({"cell": pl.UInt32, **columns}, frozenset(nullable), ("cell", "run", *key))


OF_SOME: Final = {
    FAILED_TABLE: _of_cells(FAILURES, ()),
    AGREED_TABLE: _of_cells(AGREEMENTS | dict.fromkeys(JUDGED, pl.Float64), ("holds", *JUDGED)),
    MAPS_TABLE: _of_cells(MAP_FIGURES, MAPPED),
    REPORTED_TABLE: _of_cells(REPORTED, ("value", "error"), "name", "index"),
}
"""Schemas of the tables of a shard that only groups with cells that need them have."""


def agreed_rows(
    agreements: pl.DataFrame, answers: pl.DataFrame | None, cells: Sequence[int]
) -> list[pl.DataFrame]:
    """Return the table of agreements for each of several cells with equal scenarios.

    Args:
        agreements: of one scenario, ``answers_over_time.AGREEMENTS``. answers: ``answers_over_time.ANSWERS``; None: the
            floor stays as it is. cells: numbers of the cells.
    """
    if answers is None:
        rows = agreements.with_columns(pl.lit(None, dtype=pl.Float64).alias(name) for name in JUDGED)
    else:
        rows = answers.join(agreements, on="run", how="left", maintain_order="left")
    return of_cells(rows.select(*AGREEMENTS, *JUDGED), cells)


def of_cells(rows: pl.DataFrame, cells: Sequence[int]) -> list[pl.DataFrame]:
    """Return the same rows for each of several cells with equal scenarios, with the column ``cell`` in front."""
    return [rows.select(pl.lit(cell, dtype=pl.UInt32).alias("cell"), *rows.columns) for cell in cells]


def failed_rows(
    failures: pl.DataFrame | None, cells: Sequence[Sequence[int]], end_s: float
) -> list[pl.DataFrame]:
    """Return the failed runs of some cells with the same motion: a table for each cell, or [] if no run failed.

    The motion may be longer than the runs of these cells: a run that fails after ``end_s`` has not failed for them.

    Args:
        failures: the motion's table ``FAILURES``, None if no run failed.
        cells: for each scenario, the numbers of the cells with this scenario.
        end_s: end of the runs of these cells, s.
    Returns: the tables in the order of ``cells``. All cells have the same failed runs, since they share the motion.
    """
    if failures is None:
        return []
    failed = failures.filter(pl.col("time_s") < end_s).select(*FAILURES)
    return of_cells(failed, list(chain(*cells))) if failed.height > 0 else []


def failed_words(failed: pl.DataFrame, runs: int) -> str:
    """Write how many runs of a cell failed, with time and cause of the first failed run.

    Args:
        failed: the cell's rows of the table of failures, at least one. runs: number of all runs of the cell.
    """
    first = failed.sort("run").row(0, named=True)
    return (
        f"{whole(failed.height)} of {count(runs, 'run')} failed in the source of motion; the robots have "
        f"stood still since and count as undecided (run {first['run']} at {number(first['time_s'], digits=4)} s: "
        f"{first['reason']})."
    )
