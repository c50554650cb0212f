"""After how many runs a group of cells is settled: its figure is precise enough, or it has the most runs allowed.

The rule is that of ``precision``.
"""

from __future__ import annotations

from typing import NamedTuple

import polars as pl

from vibroswarm.analysis.figures import columns_of, interval, run_figures
from vibroswarm.analysis.intervals import Interval
from vibroswarm.inference.outcomes import Array, costs_of
from vibroswarm.study.batch_table import tables_of
from vibroswarm.study.plan import Group
from vibroswarm.study.precision import Precision
from vibroswarm.study.store import Store


class Settled(NamedTuple):
    """A group that needs no more runs: it is precise enough, or has reached the limit of runs."""

    look: int
    """The look at which it was settled, counted from 0."""
    runs: int
    """Number of runs at that look."""
    level: float
    """Level of the interval at that look, which is the one to report."""
    reached: bool
    """Whether it is precise enough."""


def settled(store: Store, group: Group, precision: Precision) -> Settled | None:
    """Find the first look at which a group is precise enough in all cells, or else the last look that is allowed.

    The result depends only on the runs up to that look, so a study that was interrupted, or extended, stops at the
    same look as an uninterrupted one.

    Returns: None if the group needs runs that are not stored yet.
    """
    available = store.runs(group.number)
    look = runs = 0  # set by the loop, which has at least one look
    for look, runs in enumerate(precision.looks()):
        if runs > available:
            return None
        if _is_precise(store, group, precision, look, runs):
            return Settled(look, runs, level=precision.level_at(look), reached=True)
    # No look was precise enough: ``look`` and ``runs`` are those of the last one.
    return Settled(look, runs, level=precision.level_at(look), reached=False)


def _is_precise(store: Store, group: Group, precision: Precision, look: int, runs: int) -> bool:
    """Return whether the figure's interval from the first ``runs`` runs is narrow enough in each cell of the group.

    Args:
        look: number of the look, counted from 0, which sets the level of the interval.
    """
    rows, level = store.scan(group.number, runs), precision.level_at(look)
    assert rows is not None  # all ``runs`` runs are stored
    # Cells with equal scenarios have equal rows, so one cell of each scenario is enough.
    for cell in (equal_cells[0] for entry in group.observed for equal_cells in entry):
        rows_of_cell = rows.filter(pl.col("cell") == cell.number)
        t_end_s, costs = cell.scenario.run.t_end_s, costs_of(cell.scenario)
        interval = figure_of(rows_of_cell, precision.figure, t_end_s, level, costs)
        if not precision.reached(interval, t_end_s):
            return False
    return True


def figure_of(
    rows: pl.LazyFrame, figure: str, t_end_s: float, level: float, costs: Array | None = None
) -> Interval:
    """Compute a figure of one cell with its interval over runs, as ``analysis.cell_summary`` does.

    Args:
        rows: the cell's rows of the store, one for each run and robot. figure: one of ``precision.FIGURES``.
        t_end_s: end of the runs, s. level: of the interval. costs: of the cell's scenario, ``outcomes.costs_of``.
    """
    # Sorted, so that the last bit of a sum over robots does not depend on how runs are divided into shards.
    robots, runs = tables_of(rows.sort("run", "robot").collect())
    table = run_figures(robots, runs, t_end_s, costs=costs)
    return interval(figure, columns_of(table), level, t_end_s=t_end_s)


def runs_that_count(store: Store, group: Group, precision: Precision) -> int:
    """Return from how many runs the figures of a group are computed: the first ones, up to a look.

    If the group is settled, the number is that of the look at which it was settled. Otherwise it is that of the last
    look whose runs are all stored. If the first look has missing runs, all runs before the first missing one count.
    """
    done_with, stored = settled(store, group, precision), store.runs(group.number)
    if done_with is not None:
        return done_with.runs
    return max((runs for runs in precision.looks() if runs <= stored), default=stored)
