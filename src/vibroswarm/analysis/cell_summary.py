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
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.figures import FIGURES, ByRun, columns_of, interval, run_figures
from vibroswarm.analysis.intervals import Interval, plain
from vibroswarm.analysis.intervals import columns_of as interval_columns
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.inference.outcomes import numbers


@dataclass(frozen=True)
class CellSummary(NotebookView):
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
    table = run_figures(robots, runs, t_end_s, agreements, costs)
    return summary_of(table.with_columns(time_within_runs(robots, t_end_s)), t_end_s, level, seed)


def summary_of(table: pl.DataFrame, t_end_s: float, level: float = 0.95, seed: int = 0) -> CellSummary:
    """Compute all figures of a cell from those of its runs.

    Args:
        table: of ``run_figures``, with the column of ``time_within_runs``. t_end_s, level, seed: as of ``summary``.
    """
    robot_counts = table["robots"].to_numpy()
    # Right and wrong are defined only in runs with a truth.
    with_truth = table.select("truth", "right", "robots").drop_nulls("truth")
    right, counts_with_truth = (with_truth[name].to_numpy() for name in ("right", "robots"))
    iccs = {
        "decision_time": icc(
            *(numbers(table[name]) for name in ("decision_time_s", "time_within", "robots"))
        ),
        "right": icc_of_counts(right, counts_with_truth),
        "undecided": icc_of_counts(table["undecided"].to_numpy(), robot_counts),
    }
    # The mean size m is that of the runs of the correlation: for "right", only runs with a truth.
    sizes = {name: counts_with_truth if name == "right" else robot_counts for name in iccs}
    return CellSummary(
        runs=table.height,
        robots=int(robot_counts.sum()),
        t_end_s=t_end_s,
        level=level,
        figures={
            figure.name: interval(figure.name, columns_of(table), level, seed, t_end_s) for figure in FIGURES
        },
        correlations={
            **{f"icc_{name}": value for name, value in iccs.items()},
            **{f"design_effect_{name}": design_effect(value, sizes[name]) for name, value in iccs.items()},
        },
    )


def time_within_runs(robots: pl.DataFrame, t_end_s: float) -> pl.Series:
    """Return sums of squares of min(decision time, t_end), s^2, of a table of robots about the mean of their run.

    The series ``time_within`` has a value for each run, sorted by run, as ``icc`` takes them.
    """
    by_run = ByRun(robots)
    time_s = by_run.capped_time_s(t_end_s)
    squares = (time_s - np.repeat(by_run.mean(time_s), by_run.count)) ** 2
    return pl.Series("time_within", by_run.sum(squares))


def icc_of_counts(count: NDArray[np.int64], of: NDArray[np.int64]) -> float:
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


def design_effect(correlation: float, of: NDArray[np.int64]) -> float:
    """Compute the ratio of a figure's variance to its variance with the same number of independent robots.

    Args:
        correlation: intra-run correlation; if it is nan (undefined), so is the result.
        of: number of robots of each run, (runs,), whose mean is m; the result is nan if there are no runs.
    """
    return 1.0 + (float(of.mean()) - 1.0) * correlation if of.size else math.nan
