"""Decide whether a figure is precise enough in all cells of a group."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import Interval, mean_interval, wilson
from vibroswarm.study.plan import Group
from vibroswarm.study.precision import Precision
from vibroswarm.study.store import Store


class Settled(NamedTuple):
    """A group that needs no more runs, or has reached the limit."""

    look: int
    runs: int
    level: float
    """Level of the interval at that look, which is the one to report."""
    reached: bool


def settled(store: Store, group: Group, precision: Precision) -> Settled | None:
    """Find the look at which a group is precise enough in all cells; None if it needs runs that do not exist yet.

    It depends only on the first runs, so that a study that was interrupted, or extended by others, stops at the same
    look as an uninterrupted one.
    """
    available, look, runs = store.runs(group.number), 0, 0
    for look, runs in enumerate(precision.looks()):
        if runs > available:
            return None
        if _is_precise(store, group, precision, look, runs):
            return Settled(look, runs, precision.level_at(look), True)
    return Settled(look, runs, precision.level_at(look), False)


def _is_precise(store: Store, group: Group, precision: Precision, look: int, runs: int) -> bool:
    """Return whether the interval is narrow enough in each cell of the group."""
    rows, level = store.scan(group.number, runs), precision.level_at(look)
    assert rows is not None
    # Equal cells have equal rows: the first of each is enough.
    for cell in (equal_cells[0] for observed in group.observed for equal_cells in observed):
        interval = figure_of(
            rows.filter(pl.col("cell") == cell.number), precision.figure, cell.scenario.run.t_end_s, level
        )
        if not precision.reached(interval.estimate, interval.low, interval.high):
            return False
    return True


def figure_of(rows: pl.LazyFrame, figure: str, t_end_s: float, level: float) -> Interval:
    """Compute a figure of one cell with its interval; the run is the unit.

    Args:
        rows: as in the store. figure: one of ``precision.FIGURES``.
    """
    if figure.startswith("consensus_") and figure != "consensus_time_s":
        outcome = figure.removeprefix("consensus_")
        of_runs = (
            rows.filter(pl.col("robot") == 0).select(hit=pl.col("consensus") == outcome).collect()["hit"]
        )
        return wilson(int(of_runs.sum()), of_runs.len(), level)
    of_robot = {
        "decision_time_s": pl.col("decision_time_s").fill_null(t_end_s),
        "consensus_time_s": pl.col("consensus_time_s").fill_null(t_end_s),
        "belief_in_truth": pl.col("belief_in_truth"),
        "right": pl.col("decision") == pl.col("truth"),
        "wrong": (pl.col("decision") != pl.col("truth")) & (pl.col("decision") != -1),
        "undecided": pl.col("decision") == -1,
    }[figure]
    values = rows.select("run", "robot", value=of_robot.cast(pl.Float64)).sort("run", "robot").collect()
    robots = values["robot"].n_unique()
    # Summed robot by robot, so that the last bit does not depend on how runs are divided into shards.
    table = values["value"].to_numpy().reshape(-1, max(robots, 1))
    known = np.isfinite(table)
    count, total = known.sum(axis=1), np.where(known, table, 0.0).sum(axis=1)
    return mean_interval(total[count > 0] / count[count > 0], level)


def runs_that_count(store: Store, group: Group, precision: Precision) -> int:
    """Return the runs after which a group was settled; if it is not, those of the last complete look."""
    stop, done = settled(store, group, precision), store.runs(group.number)
    return stop.runs if stop else max((runs for runs in precision.looks() if runs <= done), default=done)
