"""The tables of a batch: rows of robots, and the runs that the source of motion gave up.

Rows are collected in arrays of shape (cells, runs, robots), and turned into one table at the end: making a table for
each cell and joining them takes many times as long.

The source of motion gives up runs such as those of MuJoCo at numbers that are not finite. Their robots stand from then
on and count as undecided in every figure, so a study lists and counts them. A shard has that table only if a run of it
failed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.sampling import WALK as OF_WALK
from vibroswarm.core.tables import Schema
from vibroswarm.inference.outcomes import ROBOTS, RUNS, as_series
from vibroswarm.motion.source import FAILURES
from vibroswarm.result import Result
from vibroswarm.study.spec import Cell

Columns = Mapping[str, NDArray[Any]]

WALK: Final = {name: kind for name, kind in OF_WALK.items() if name not in ("run", "samples")}
"""How the robots of a run sampled, see ``analysis.sampling``."""
OF_ROBOTS: Final = {name: kind for name, kind in ROBOTS.items() if name not in ("run", "robot")}
OF_RUNS: Final = {**{name: kind for name, kind in RUNS.items() if name != "run"}, **WALK}

ROWS: Final[dict[str, Any]] = {"cell": pl.UInt32, **ROBOTS, **OF_RUNS}
"""One row for each cell, run and robot, in this order: columns of the robot, then of its run."""

_KEPT_AS: Final = {
    pl.Float64: np.float64, pl.UInt32: np.uint32, pl.UInt16: np.uint16, pl.Int8: np.int8, pl.Boolean: np.bool_,
}  # fmt: skip
_UNKNOWN: Final = dict.fromkeys(("truth", "alpha", "beta"), np.float64)
"""Columns of whole numbers that may be missing, and therefore stored as floats; not every strategy has a posterior."""


class BatchRows:
    """The rows of some cells and runs.

    Args:
        cells: their numbers. runs: all of the batch. robots: of a swarm.
    """

    def __init__(self, cells: Sequence[int], runs: range, robots: int) -> None:
        self.cells, self.runs, self.robots = sorted(cells), runs, robots
        self._place = {cell: place for place, cell in enumerate(self.cells)}
        shape = (len(self.cells), len(runs))
        self._of_robots = _empty(OF_ROBOTS, (*shape, robots))
        self._of_runs = _empty(OF_RUNS, shape)

    def put(self, cells: Sequence[Sequence[int]], first_run: int, robots: Columns, runs: Columns) -> None:
        """Fill in the outcomes of some runs, from ``first_run`` on.

        Args:
            cells: for each row of the arrays, the cells to which it applies.
            robots: ``OF_ROBOTS``, (rows, runs, robots) each. runs: ``OF_RUNS``, (rows, runs) or (runs,) each.
        """
        place = [self._place[cell] for same in cells for cell in same]
        row = [k for k, same in enumerate(cells) for _ in same]
        low = first_run - self.runs.start
        for name, array in self._of_robots.items():
            array[place, low : low + robots[name].shape[-2]] = robots[name][row]
        for name, array in self._of_runs.items():
            values = runs[name]
            array[place, low : low + values.shape[-1]] = values if values.ndim == 1 else values[row]

    def table(self) -> pl.DataFrame:
        """Return all rows as a table, ``ROWS``."""
        count, of_swarm = len(self.cells) * len(self.runs), np.arange(self.robots)
        of_run = {name: np.repeat(array, self.robots) for name, array in self._of_runs.items()}
        columns: dict[str, NDArray[Any]] = {
            "cell": np.repeat(np.array(self.cells, dtype=np.uint32), len(self.runs) * self.robots),
            "run": np.tile(
                np.repeat(np.arange(self.runs.start, self.runs.stop), self.robots), len(self.cells)
            ),
            "robot": np.tile(of_swarm, count),
            **{name: array.ravel() for name, array in self._of_robots.items()},
            **of_run,
        }
        return pl.DataFrame([as_series(name, columns[name], kind) for name, kind in ROWS.items()])


def _empty(kinds: Mapping[str, Any], shape: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    kept = {name: _UNKNOWN.get(name, _KEPT_AS.get(kind, np.uint8)) for name, kind in kinds.items()}
    return {name: np.empty(shape, dtype=kind) for name, kind in kept.items()}


def columns_of(result: Result) -> tuple[Columns, Columns]:
    """Return a result's columns of robots, (1, runs, robots) each, and of runs without ``WALK``, (runs,) each."""
    robots = {name: values_of(result.robots[name]).reshape(1, result.runs.height, -1) for name in OF_ROBOTS}
    return robots, {name: values_of(result.runs[name]) for name in RUNS if name != "run"}


def values_of(column: pl.Series) -> NDArray[Any]:
    """Return a column of ``ROWS`` as numbers, (rows,): nan for null, and an Enum's words by their index."""
    if isinstance(column.dtype, pl.Enum):
        return column.to_physical().to_numpy()
    return column.cast(pl.Float64).to_numpy() if column.null_count() else column.to_numpy()


def arrays_of(
    rows: pl.DataFrame, cells: Sequence[int], runs: int, robots: int
) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """Sort columns of ``ROWS`` by cell, run and robot.

    Args:
        rows: of all runs of these cells, each once; cell, run, robot and any others. cells: by number, ascending.
    Returns: those of robots, (cells, runs, robots) each, and those of runs, (cells, runs) each; nan in place of null,
        the consensus by its index in ``outcomes.CONSENSUS``.
    """
    shape = (len(cells), runs, robots)
    cell, run, robot = (rows[name].to_numpy().astype(np.int64) for name in ("cell", "run", "robot"))
    place = (np.searchsorted(np.array(cells), cell) * runs + run) * robots + robot
    if rows.height != math.prod(shape):
        raise ValueError(f"{rows.height} rows of {shape} cells, runs and robots")
    of_robots: dict[str, NDArray[Any]] = {}
    of_runs: dict[str, NDArray[Any]] = {}
    for column in rows.drop("cell"):
        values = values_of(column)
        sorted_ = np.empty(rows.height, dtype=values.dtype)
        sorted_[place] = values
        if column.name in ROBOTS:
            of_robots[column.name] = sorted_.reshape(shape)
        else:
            of_runs[column.name] = sorted_.reshape(shape)[:, :, 0].copy()
    return of_robots, of_runs


def walked(figures: Columns, runs: range) -> dict[str, NDArray[np.float64]]:
    """Align figures of ``Walk.figures`` with all runs, (runs,) each; nan for runs in which no robot sampled."""
    place = np.asarray(figures["run"], dtype=np.int64) - runs.start
    columns = {name: np.full(len(runs), np.nan) for name in WALK}
    for name, column in columns.items():
        column[place] = figures[name]
    return columns


FAILED_TABLE: Final = "failures"
"""Name of the table in a shard."""
FAILED_RUNS: Final[dict[str, Any]] = {"cell": pl.UInt32, **FAILURES}
"""One row per cell and failed run: since when its robots stand, and why."""
FAILED_ROWS: Final = Schema(FAILED_RUNS, frozenset(), ("cell", "run"))


def failed_rows(
    failures: pl.DataFrame | None, cells: Sequence[Sequence[int]], end_s: float
) -> list[pl.DataFrame]:
    """Return the failed runs of some cells with the same motion, a table for each cell; empty if no run failed.

    The motion may be longer than the runs of these cells: a run that fails after ``end_s`` has not failed for them.

    Args:
        failures: of the motion, None if no run failed. cells: as ``BatchOutcomes`` has them. end_s: of their runs.
    """
    if failures is None:
        return []
    known = failures.filter(pl.col("time_s") < end_s)
    return [
        known.select(pl.lit(cell, dtype=pl.UInt32).alias("cell"), *FAILURES)
        for same in cells
        for cell in same
        if known.height > 0
    ]


def failed_words(cell: Cell, failed: pl.DataFrame, runs: int) -> str:
    """Write how many runs of a cell failed, with the first cause.

    Args:
        failed: ``FAILED_RUNS`` of the cell. runs: of the cell.
    """
    first = failed.sort("run").row(0, named=True)
    return (
        f"{failed.height:,} of {runs:,} runs of {cell.name} failed in the source of motion; their robots stand since "
        f"then and count as undecided (run {first['run']} at {first['time_s']:.4g} s: {first['reason']})."
    )
