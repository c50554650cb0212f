"""Summarise a cell: the figures of one scenario's runs, with intervals, and how alike the robots of a run are.

The figures are those of ``analysis.figures``. Besides, of the capped decision time, of deciding right and of staying
undecided:

| name | what it is |
|---|---|
| icc | r = (B - W) / (B + (m - 1) W): intra-run correlation; B, W: mean squares between, within runs |
| design effect | 1 + (m - 1) r: number of robots, in runs of m, that inform as much as one independent robot |

Right and wrong are shares of the runs with a truth; without such runs they are undefined. Whether agreement lasted is
known only of strategies whose opinions may change after the swarm has decided (``answers_over_time``). The median
consensus time is undefined (None) if fewer than half of the runs reach a consensus.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.figures import FIGURES, Swarms, columns_of, figures_table, interval
from vibroswarm.analysis.intervals import Interval, plain
from vibroswarm.analysis.intervals import columns_of as interval_columns


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
    correlations: Mapping[str, float]
    """``icc_`` and ``design_effect_`` of ``decision_time``, ``right`` and ``undecided``; nan if undefined."""

    def __getattr__(self, name: str) -> Any:
        """Return a figure or a correlation."""
        for values in ("figures", "correlations"):
            # Not yet set while the object is being copied.
            if name in self.__dict__.get(values, {}):
                return self.__dict__[values][name]
        raise AttributeError(f"'{type(self).__name__}' has no figure '{name}'")

    def as_row(self) -> dict[str, float | int | None]:
        """Return the figures as one flat row.

        An interval gives three columns: ``name`` (the estimate), ``name_low``, ``name_high``. Any other value gives the
        column ``name``. A value that is not finite becomes None.
        """
        row: dict[str, float | int | None] = self._sizes()
        for name, found in self.figures.items():
            row |= interval_columns(name, found)
        return row | {name: plain(value) for name, value in self.correlations.items()}

    def as_dict(self) -> dict[str, Any]:
        """Return the figures for JSON: intervals become dictionaries, and values that are not finite become None."""
        intervals = {name: found.as_dict() for name, found in self.figures.items()}
        return self._sizes() | intervals | {name: plain(value) for name, value in self.correlations.items()}

    def _sizes(self) -> dict[str, Any]:
        return {name: plain(getattr(self, name)) for name in ("runs", "robots", "t_end_s", "level")}


def summary(
    robots: pl.DataFrame,
    runs: pl.DataFrame,
    t_end_s: float,
    level: float = 0.95,
    seed: int = 0,
    *,
    agreements: pl.DataFrame | None = None,
    costs: NDArray[np.float64] | None = None,
) -> CellSummary:
    """Compute all figures of a cell.

    Args:
        robots, runs: tables of one scenario's runs, as a ``Result`` has them. t_end_s: the end of a run, s.
        level: confidence level of each single interval. seed: seed of the bootstrap.
        agreements: table of agreements (``analysis.answers_over_time.AGREEMENTS``); None: decisions are final.
        costs: of the scenario (``outcomes.costs_of``); None: two answers, mistakes that cost the same.
    Raises:
        InputError: the tables have different runs, a run occurs twice, t_end is not above 0, or the level is not
            between 0 and 1.
    """
    swarms = Swarms.of_tables(robots, runs, t_end_s, agreements, costs)
    table = figures_table(swarms, runs.sort("run").select("run", "truth", "consensus"))
    table = table.with_columns(time_within_runs(swarms))
    return summaries_of(table, [table.height], [t_end_s], level, seed)[0]


def summaries_of(
    table: pl.DataFrame, runs: Sequence[int], ends_s: Sequence[float], level: float = 0.95, seed: int = 0
) -> list[CellSummary]:
    """Compute all figures of cells from those of their runs.

    Args:
        table: of ``figures.figures_table``, cell by cell, with the column of ``time_within_runs``.
        runs: number of runs of each cell. ends_s: end of the runs of each cell, s. level, seed: as of ``summary``.
    """
    bounds = np.cumsum([0, *runs]).tolist()
    cells = [slice(low, high) for low, high in pairwise(bounds)]
    figures: list[dict[str, Interval]] = [{} for _ in cells]
    for figure in FIGURES:
        # Anew for each figure, so that few floats of many runs are in memory at a time.
        columns = columns_of(table)
        for found, cell, end_s in zip(figures, cells, ends_s, strict=True):
            by_run = {name: columns[name][cell] for name in figure.read}
            found[figure.name] = interval(figure.name, by_run, level, seed, end_s)
    columns = columns_of(table)
    return [
        CellSummary(
            runs=cell.stop - cell.start,
            robots=int(columns["robots"][cell].sum()),
            t_end_s=end_s,
            level=level,
            figures=found,
            correlations=_correlations(columns, cell),
        )
        for found, cell, end_s in zip(figures, cells, ends_s, strict=True)
    ]


def _correlations(columns: Mapping[str, NDArray[np.float64]], cell: slice) -> dict[str, float]:
    """Return the correlations of a cell and their design effects; ``columns`` of all runs, ``cell``: its runs."""
    robots, known = columns["robots"][cell], ~np.isnan(columns["truth"][cell])
    # Right and wrong are defined only in runs with a truth.
    with_truth = robots[known]
    iccs = {
        "decision_time": icc(columns["decision_time_s"][cell], columns["time_within"][cell], robots),
        "right": icc_of_counts(columns["right"][cell][known], with_truth),
        "undecided": icc_of_counts(columns["undecided"][cell], robots),
    }
    # The mean size m is that of the runs of the correlation: for "right", only runs with a truth.
    sizes = {name: with_truth if name == "right" else robots for name in iccs}
    return {
        **{f"icc_{name}": value for name, value in iccs.items()},
        **{f"design_effect_{name}": design_effect(value, sizes[name]) for name, value in iccs.items()},
    }


def time_within_runs(swarms: Swarms) -> pl.Series:
    """Return sums of squares of min(decision time, t_end), s^2, of the robots of each run about the mean of their run.

    The series ``time_within`` has a value for each run, as ``icc`` takes them.
    """
    squares = (swarms.time_s - swarms.by_robot(swarms.mean(swarms.time_s))) ** 2
    return pl.Series("time_within", swarms.sum(squares))


def icc_of_counts(count: NDArray[Any], of: NDArray[Any]) -> float:
    """Compute the intra-run correlation of a binary outcome, such as having decided right.

    Args:
        count: number of robots of each run that have the outcome. of: number of all robots of each run; shape (runs,)
            each. Runs without robots are left out.
    Returns: the correlation; nan for fewer than 2 runs, if every run has a single robot, or if all robots have the same
        outcome.
    """
    count, of = count[of > 0], of[of > 0]
    size = of.astype(np.float64)
    share = count / size
    squares = size * share * (1.0 - share)  # sum of squares of zeros and ones about their mean
    return icc(share, squares, size)


def icc(means: NDArray[np.float64], within: NDArray[np.float64], sizes: NDArray[np.float64]) -> float:
    """Compute the intra-run correlation by a one-way analysis of variance.

    It may be slightly negative. It is nan for fewer than 2 runs, if every run has a single robot, and if all values
    are equal.

    Args:
        means: mean over the robots of each run. within: sum of squares about this mean. sizes: number of robots;
            shape (runs,) each.
    """
    runs, robots = means.size, float(sizes.sum())
    if runs < 2 or robots <= runs:
        return math.nan
    grand = float(sizes @ means) / robots
    between = float(sizes @ (means - grand) ** 2) / (runs - 1)  # B
    inside = float(within.sum()) / (robots - runs)  # W
    # m: the number of robots of a run. For runs of unequal sizes it is the weighted mean size with which (B - W) / m
    # estimates the variance of the run effects without bias.
    size = (robots - float(sizes @ sizes) / robots) / (runs - 1)
    total = between + (size - 1.0) * inside
    return (between - inside) / total if total > 0 else math.nan  # r


def design_effect(correlation: float, of: NDArray[Any]) -> float:
    """Compute the ratio of a figure's variance to its variance with the same number of independent robots.

    Args:
        correlation: intra-run correlation; if it is nan (undefined), so is the result.
        of: number of robots of each run, (runs,), whose mean is m; the result is nan if there are no runs.
    """
    return 1.0 + (float(of.mean()) - 1.0) * correlation if of.size else math.nan
