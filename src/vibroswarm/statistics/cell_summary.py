"""Summarise a cell: the figures of one scenario's runs (``statistics.figures``), with intervals.

Right and wrong are shares of the runs with a truth; without such runs they are undefined. Whether agreement lasted is
known only of strategies whose opinions may change after the swarm has decided (``answers_over_time``). The median
consensus time is undefined (None) if fewer than half of the runs reach a consensus.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.statistics.figures import FIGURES, Swarms, columns_of, figures_table, interval
from vibroswarm.statistics.intervals import Interval, plain
from vibroswarm.statistics.intervals import columns_of as interval_columns


@dataclass(frozen=True)
class CellSummary:
    """Figures of a cell; times in s. Each figure is an attribute too: ``summary.decision_time_s``."""

    runs: int
    robots: int
    """Robots in all runs."""
    t_end_s: float
    level: float
    """Confidence level of each single interval."""
    figures: Mapping[str, Interval]
    """By name, in the order of ``figures.FIGURES``."""

    def __getattr__(self, name: str) -> Any:
        """Return a figure."""
        figures = self.__dict__.get("figures", {})  # not yet set while the object is being copied
        if name not in figures:
            raise AttributeError(f"'{type(self).__name__}' has no figure '{name}'")
        return figures[name]

    def as_row(self) -> dict[str, float | int | None]:
        """Return the figures as one flat row: ``name`` (the estimate), ``name_low``, ``name_high`` of each.

        A value that is not finite becomes None.
        """
        row: dict[str, float | int | None] = {
            name: plain(getattr(self, name)) for name in ("runs", "robots", "t_end_s", "level")
        }
        for name, found in self.figures.items():
            row |= interval_columns(name, found)
        return row


def summary(
    robots: pl.DataFrame,
    runs: pl.DataFrame,
    t_end_s: float,
    level: float = 0.95,
    *,
    agreements: pl.DataFrame | None = None,
    costs: NDArray[np.float64] | None = None,
) -> CellSummary:
    """Compute all figures of a cell.

    Args:
        robots, runs: tables of one scenario's runs, as a ``Result`` has them. t_end_s: the end of a run, s.
        level: confidence level of each single interval.
        agreements: table of agreements (``statistics.answers_over_time.AGREEMENTS``); None: decisions are final.
        costs: of the scenario (``outcomes.costs_of``); None: two answers, mistakes that cost the same.
    """
    swarms = Swarms.of_tables(robots, runs, t_end_s, agreements, costs)
    table = figures_table(swarms, runs.sort("run").select("run", "truth", "consensus"))
    return summaries_of(table, [table.height], [t_end_s], level)[0]


def summaries_of(
    table: pl.DataFrame, runs: Sequence[int], ends_s: Sequence[float], level: float = 0.95
) -> list[CellSummary]:
    """Compute all figures of cells from those of their runs.

    Args:
        table: of ``figures.figures_table``, cell by cell.
        runs: number of runs of each cell. ends_s: end of the runs of each cell, s. level: as of ``summary``.
    """
    bounds = np.cumsum([0, *runs]).tolist()
    cells = [slice(low, high) for low, high in pairwise(bounds)]
    figures: list[dict[str, Interval]] = [{} for _ in cells]
    for figure in FIGURES:
        # Anew for each figure, so that few floats of many runs are in memory at a time.
        columns = columns_of(table)
        for found, cell, end_s in zip(figures, cells, ends_s, strict=True):
            by_run = {name: columns[name][cell] for name in figure.read}
            found[figure.name] = interval(figure.name, by_run, level, end_s)
    return [
        CellSummary(cell.stop - cell.start, int(table["robots"][cell].sum()), end_s, level, found)
        for found, cell, end_s in zip(figures, cells, ends_s, strict=True)
    ]
