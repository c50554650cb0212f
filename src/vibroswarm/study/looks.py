"""Whether a figure is known well enough in all cells of a group."""

from __future__ import annotations

from collections.abc import Iterable

import polars as pl

from vibroswarm.analysis.intervals import Interval, mean_interval, wilson
from vibroswarm.study.plan import Group
from vibroswarm.study.precision import Precision
from vibroswarm.study.store import Store


def unsettled(store: Store, group: Group, precision: Precision, look: int) -> bool:
    """Whether some cell of the group needs more runs after look 0, 1, ..."""
    runs = list(precision.looks())[look]
    level = precision.level_at(look)
    rows = store.scan(group.number, runs)
    if rows is None:
        return True
    for same in (same for observed in group.observed for same in observed):
        found = figure_of(
            rows.filter(pl.col("cell") == same[0].number),
            precision.figure,
            same[0].scenario.run.t_end_s,
            level,
        )
        if not precision.reached(found.estimate, found.low, found.high):
            return True
    return False


def figure_of(rows: pl.LazyFrame, figure: str, t_end_s: float, level: float) -> Interval:
    """A figure of one cell with its interval; the run is the unit.

    Args:
        rows: as the store has them. figure: one of ``precision.FIGURES``.
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
    means = (
        rows.group_by("run")
        .agg(of_robot.cast(pl.Float64).mean().alias("value"))
        .sort("run")
        .collect()["value"]
    )
    return mean_interval(means.drop_nulls().to_numpy(), level)


def settled_runs(store: Store, groups: Iterable[Group], precision: Precision) -> dict[int, int]:
    """With how many runs each group was settled, or had the most."""
    looks = list(precision.looks())
    found = {}
    for group in groups:
        there = store.runs(group.number)
        found[group.number] = max((runs for runs in looks if runs <= there), default=there)
    return found
