"""Summarise runs and cells: one row of figures for each run, and figures of a cell with intervals.

| column | what it is |
|---|---|
| run, truth, consensus | as the table of runs has them |
| robots | how many there are |
| right, wrong, undecided | how many of them; right and wrong null where no decision is right |
| decision_time_s | mean over robots of min(decision time, t_end), s: the paper's, the restricted mean |
| belief_in_truth | mean over robots of the belief in what is so, at the decision or at the last sample |
| consensus_time_s | as the table of runs has it: null where there was none |
| right_share, wrong_share, undecided_share | shares of the robots |
| swarm_right, swarm_wrong | 1 where all decided so, else 0; null where no decision is right |
| swarm_time_s | min(consensus time, t_end), s |

What became of a cell (one scenario, many runs), with intervals; the run is the unit.

| name | what it is | interval |
|---|---|---|
| swarm_right, _wrong, _split, _incomplete, _truth_undefined | share of runs with this consensus | Wilson |
| swarm_error | share wrong among runs with a consensus that is right or wrong | Wilson |
| consensus_time_s | mean of min(consensus time, t_end): a run without consensus counts with t_end | t |
| consensus_median_s | median of the consensus time, a run without one being later than any | order statistics |
| robots_right, _wrong, _undecided | share of robots | cluster bootstrap over runs |
| robot_error | share wrong among the robots that decided | cluster bootstrap over runs |
| decision_time_s | mean of min(decision time, t_end), the restricted mean: the paper's | t over runs' means |
| belief_in_truth | mean belief in what is so, at the decision or the last sample; the paper's "accuracy" | t |
| icc | r = (B - W) / (B + (m - 1) W): intra-run correlation, B and W the mean squares between and within runs | - |
| design effect | 1 + (m - 1) r: so many robots of m-robot runs tell as much as one independent robot | - |

Right and wrong are shares of the runs in which a decision can be right (fill ratio off the boundary) and not defined
where there are none. A median that fewer than half of the runs reach is not defined either (None).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import (
    Interval,
    cluster_share,
    mean_interval,
    plain,
    quantile_interval,
    wilson,
)
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import (
    RUNS,
    Array,
    Columns,
    capped_time_s,
    mean_by_run,
    numbers,
    of_swarms,
    sum_by_run,
)

COUNTS: Final = ("right", "wrong", "undecided")
FIGURES: Final = (
    *COUNTS,
    *("decision_time_s", "belief_in_truth", "consensus_time_s"),
    *("right_share", "wrong_share", "undecided_share", "swarm_right", "swarm_wrong", "swarm_time_s"),
)
"""Columns that are computed, in order."""


class ByRun(NotebookView):
    """Robots grouped by run; sums have a fixed order, whatever the number of threads.

    Args:
        robots: table of robots, in any order.
    """

    def __init__(self, robots: pl.DataFrame) -> None:
        self.robots = robots if robots["run"].is_sorted() else robots.sort("run", "robot")
        run = self.robots["run"].to_numpy()
        self.first = np.flatnonzero(np.append(run.size > 0, run[1:] != run[:-1]))
        self.runs = run[self.first]
        self.count: NDArray[np.int64] = np.diff(np.append(self.first, run.size)).astype(np.int64)

    def sum(self, values: Array) -> Array:
        """Sum a value over the robots of each run, shape (runs,)."""
        return sum_by_run(values, self.first)

    def mean(self, values: Array) -> Array:
        """Average a value over the robots that have it; nan if none has."""
        return mean_by_run(values, self.first)

    def capped_time_s(self, t_end_s: float) -> Array:
        """Compute min(decision time, t_end) of each robot; t_end if it did not decide."""
        return capped_time_s(numbers(self.robots["decision_time_s"]), t_end_s)


def run_figures(robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float) -> pl.DataFrame:
    """Compute the table above, sorted by run.

    Args:
        robots, runs: tables of one cell, as a ``Result`` has them; the same runs in both. t_end_s: end of a run, s.
    Raises:
        InputError: the tables have different runs, a run occurs twice, or t_end is not above 0.
    """
    if not t_end_s > 0:
        raise InputError(f"{t_end_s!r} is not an end of a run; give a time above 0, s", field="t_end_s")
    by_run = ByRun(robots)
    means = {
        "decision_time_s": by_run.mean(by_run.capped_time_s(t_end_s)),
        "belief_in_truth": by_run.mean(numbers(by_run.robots["belief_in_truth"])),
    }
    of_robots = pl.DataFrame({"run": by_run.runs, "robots": by_run.count})
    joined = runs.join(of_robots, on="run", how="inner").sort("run")
    if joined.height != runs.height or of_robots.height != runs.height:
        raise InputError("the tables of robots and of runs are not of the same runs", field="runs")
    columns = {name: numbers(joined[name]) for name in ("truth", "consensus_time_s", *COUNTS)}
    columns["consensus"] = joined["consensus"].cast(RUNS["consensus"]).to_physical().to_numpy()
    values = means | of_swarms(columns, by_run.count, t_end_s)
    figures = [pl.Series(name, values[name], nan_to_null=True) for name in FIGURES]
    counts = [column.cast(pl.Int64) if column.name in COUNTS else column for column in figures]
    return joined.select("run", "truth", "consensus", "robots").with_columns(counts)


@dataclass(frozen=True)
class CellSummary(NotebookView):
    """Figures of a cell, see the head of this module; times in s."""

    runs: int
    robots: int
    """Robots in all runs."""
    t_end_s: float
    level: float
    swarm_right: Interval
    swarm_wrong: Interval
    swarm_split: Interval
    swarm_incomplete: Interval
    swarm_truth_undefined: Interval
    swarm_error: Interval
    consensus_time_s: Interval
    consensus_median_s: Interval
    robots_right: Interval
    robots_wrong: Interval
    robots_undecided: Interval
    robot_error: Interval
    decision_time_s: Interval
    belief_in_truth: Interval
    icc_decision_time: float
    icc_right: float
    icc_undecided: float
    design_effect_decision_time: float
    design_effect_right: float
    design_effect_undecided: float

    def intervals(self) -> dict[str, Interval]:
        """Return the figures that have limits, by name."""
        return {name: value for name, value in self._items() if isinstance(value, Interval)}

    def as_row(self) -> dict[str, float | int | None]:
        """Return a flat row: ``name``, ``name_low``, ``name_high`` for each interval; None if not finite."""
        row: dict[str, float | int | None] = {}
        for name, value in self._items():
            if isinstance(value, Interval):
                row[name], row[f"{name}_low"], row[f"{name}_high"] = (plain(v) for v in value[:3])
            else:
                row[name] = plain(value)
        return row

    def as_dict(self) -> dict[str, Any]:
        """Return nested plain values for JSON."""
        return {
            name: value.as_dict() if isinstance(value, Interval) else plain(value)
            for name, value in self._items()
        }

    def _items(self) -> list[tuple[str, Any]]:
        return [(field.name, getattr(self, field.name)) for field in fields(self)]


def summary(
    robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, level: float = 0.95, seed: int = 0
) -> CellSummary:
    """Compute all figures of a cell.

    Args:
        robots, runs: tables of one scenario's runs, as a ``Result`` has them. t_end_s: the end of a run, s.
        level: of confidence, each interval for itself. seed: of the bootstrap.
    Raises:
        InputError: the tables are not of the same runs, or the level is no share.
    """
    table = run_figures(robots, runs, t_end_s)
    robot_counts = table["robots"].to_numpy()
    known = table.filter(pl.col("truth").is_not_null())
    right, wrong, of_known = (known[name].to_numpy() for name in ("right", "wrong", "robots"))
    undecided = table["undecided"].to_numpy()
    figures = {name: numbers(table[name]) for name in ("robots", *OF_RUNS)}
    iccs = {
        "decision_time": icc_of_times(robots, t_end_s),
        "right": icc_of_counts(right, of_known),
        "undecided": icc_of_counts(undecided, robot_counts),
    }
    named: dict[str, Any] = {
        **{name: interval(name, figures, level, seed) for name in INTERVALS},
        **consensus_shares(table, level),
        **{f"icc_{name}": value for name, value in iccs.items()},
        **{f"design_effect_{name}": design_effect(value, robot_counts) for name, value in iccs.items()},
    }
    reached = table["consensus_time_s"].fill_null(math.inf).to_numpy()
    return CellSummary(
        runs=table.height,
        robots=int(robot_counts.sum()),
        t_end_s=t_end_s,
        level=level,
        consensus_median_s=quantile_interval(reached, 0.5, level),
        robot_error=cluster_share(wrong, right + wrong, level, seed),
        **named,
    )


MEANS: Final = {
    "decision_time_s": "decision_time_s",
    "belief_in_truth": "belief_in_truth",
    "consensus_time_s": "swarm_time_s",
}
"""Means over runs, and the figure of a run each is of."""
SHARES_OF_ROBOTS: Final = {f"robots_{name}": name for name in ("right", "wrong", "undecided")}
"""Shares of robots, and how many of each run they are of."""
SHARES_OF_RUNS: Final = ("swarm_right", "swarm_wrong")
"""Shares of runs."""
INTERVALS: Final = (*MEANS, *SHARES_OF_ROBOTS, *SHARES_OF_RUNS)
"""Names that ``interval`` accepts."""
OF_RUNS: Final = (*MEANS.values(), *SHARES_OF_ROBOTS.values(), *SHARES_OF_RUNS)


def interval(name: str, figures: Columns, level: float = 0.95, seed: int = 0) -> Interval:
    """Return a figure of a cell with its limits, from those of its runs.

    Args:
        name: of ``INTERVALS``. figures: of each run (``inference.outcomes.run_figures``) and ``robots``, how many it
            has; (runs,) each, nan where a run has none. level: of confidence. seed: of the bootstrap.
    """
    if name in MEANS:
        return mean_interval(figures[MEANS[name]], level)
    if name in SHARES_OF_ROBOTS:
        count = figures[SHARES_OF_ROBOTS[name]]
        known = ~np.isnan(count)
        return cluster_share(count[known], figures["robots"][known], level, seed)
    known = ~np.isnan(figures[name])
    return wilson(int(figures[name][known].sum()), int(known.sum()), level)


def consensus_shares(table: pl.DataFrame, level: float = 0.95) -> dict[str, Interval]:
    """Return the shares of runs that are split, incomplete or without a truth, and the consensus error.

    Args:
        table: of ``run_figures``. level: of confidence.
    """
    counts = dict(table.group_by("consensus").len().iter_rows())
    others = ("split", "incomplete", "truth_undefined")
    shares = {f"swarm_{name}": wilson(counts.get(name, 0), table.height, level) for name in others}
    right, wrong = counts.get("right", 0), counts.get("wrong", 0)
    return shares | {"swarm_error": wilson(wrong, right + wrong, level)}


def icc_of_times(robots: pl.DataFrame, t_end_s: float) -> float:
    """Compute the intra-run correlation of min(decision time, t_end)."""
    by_run = ByRun(robots)
    time_s = by_run.capped_time_s(t_end_s)
    means = by_run.mean(time_s)
    within = by_run.sum((time_s - np.repeat(means, by_run.count)) ** 2)
    return icc(means, within, by_run.count.astype(np.float64))


def icc_of_counts(count: NDArray[np.int64], of: NDArray[np.int64]) -> float:
    """Compute the intra-run correlation of a binary outcome that ``count`` of ``of`` robots of each run have."""
    count, of = count[of > 0], of[of > 0]
    size = of.astype(np.float64)
    share = count / size
    return icc(share, size * share * (1.0 - share), size)


def icc(means: NDArray[np.float64], within: NDArray[np.float64], sizes: NDArray[np.float64]) -> float:
    """Compute the intra-run correlation from each run's mean, sum of squares about it and number of robots.

    One-way analysis of variance; runs of unequal size enter with the usual mean size. It may be slightly negative.
    It is nan for fewer than 2 runs, for single robots, and without any variance.
    """
    runs, robots = means.size, float(sizes.sum())
    if runs < 2 or robots <= runs:
        return math.nan
    grand = float(sizes @ means) / robots
    between = float(sizes @ (means - grand) ** 2) / (runs - 1)  # B
    inside = float(within.sum()) / (robots - runs)  # W
    size = (robots - float(sizes @ sizes) / robots) / (runs - 1)  # m
    total = between + (size - 1.0) * inside
    return (between - inside) / total if total > 0 else math.nan  # r


def design_effect(correlation: float, of: NDArray[np.int64]) -> float:
    """Compute the ratio of a figure's variance to that with as many independent robots; nan if the correlation is."""
    return 1.0 + (float(of.mean()) - 1.0) * correlation if of.size else math.nan
