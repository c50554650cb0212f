"""Summarise runs and cells: one row of figures for each run, and figures of a cell with intervals.

| column | what it is |
|---|---|
| run, truth, consensus | copied from the table of runs |
| robots | number of robots |
| right, wrong, undecided | number of robots with this outcome; right and wrong are null if the run has no truth |
| decision_time_s | mean over robots of min(decision time, t_end), s: the restricted mean, as in the paper |
| belief_in_truth | mean over robots of the belief in the true answer, at the decision or at the last sample |
| consensus_time_s | copied from the table of runs: null if the run has no consensus |
| right_share, wrong_share, undecided_share | right, wrong, undecided / robots |
| swarm_right, swarm_wrong | 1 if all robots decided right (wrong), else 0; null if the run has no truth |
| swarm_time_s | min(consensus time, t_end), s; t_end if the run has no consensus |
| agreed_on_0, agreed_on_1 | 1 if all robots made this decision, else 0; null if decisions are not logged |

A run has no truth if its fill ratio lies on the boundary, so that neither decision is right.

The figures of a cell (one scenario, many runs) have intervals that treat the run as the independent unit:

| name | what it is | interval |
|---|---|---|
| swarm_right, _wrong, _split, _incomplete, _truth_undefined | share of runs with this consensus | Wilson |
| agreed_on_0, agreed_on_1 | share of all runs in which every robot made this decision, right or not | Wilson |
| agreement_lasted | share of the runs with an agreement in which opinions agree with it at the end | Wilson |
| swarm_error | share of runs with a wrong consensus among those with a right or wrong one | Wilson |
| consensus_time_s | mean of min(consensus time, t_end): a run without consensus counts with t_end | t |
| consensus_median_s | median consensus time; a run without consensus counts as infinitely late | order statistics |
| robots_right, _wrong, _undecided | share of robots | cluster bootstrap over runs |
| robot_error | share wrong among the robots that decided | cluster bootstrap over runs |
| decision_time_s | mean of min(decision time, t_end): the restricted mean, as in the paper | t over runs' means |
| belief_in_truth | mean belief in the true answer, at the decision or the last sample; the paper's "accuracy" | t |
| icc | r = (B - W) / (B + (m - 1) W): intra-run correlation; B, W: mean squares between, within runs | - |
| design effect | 1 + (m - 1) r: number of robots, in runs of m, that inform as much as one independent robot | - |

Right and wrong are shares of the runs with a truth; without such runs they are undefined. Whether agreement lasted is
known only of strategies whose opinions may change after the swarm has decided (``analysis.agreement``). The median
consensus time is undefined (None) if fewer than half of the runs reach a consensus.
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
"""Columns with numbers of robots."""
FIGURES: Final = (
    *COUNTS,
    *("decision_time_s", "belief_in_truth", "consensus_time_s"),
    *("right_share", "wrong_share", "undecided_share", "swarm_right", "swarm_wrong", "swarm_time_s"),
    *("agreed_on_0", "agreed_on_1"),
)
"""Columns that ``run_figures`` computes, in order."""


class ByRun(NotebookView):
    """Robots grouped by run, to sum and average values of robots over each run.

    Values are added in a fixed order, whatever the number of threads, so that rounding is reproducible.

    ``robots`` is the table sorted by run; ``runs`` are the numbers of its runs, ``first`` the index of each run's first
    row and ``count`` its number of robots, shape (runs,) each. Values of robots, in and out of the methods, are in the
    order of this sorted table, which may differ from the order of the argument.

    Args:
        robots: table of robots, in any order.
    """

    def __init__(self, robots: pl.DataFrame) -> None:
        self.robots = robots if robots["run"].is_sorted() else robots.sort("run", "robot")
        run = self.robots["run"].to_numpy()
        # A run starts at row 0, if the table has rows, and wherever the run number changes.
        starts = np.append(run.size > 0, run[1:] != run[:-1])
        self.first = np.flatnonzero(starts)
        self.runs = run[self.first]
        robots_per_run = np.diff(np.append(self.first, run.size))
        self.count: NDArray[np.int64] = robots_per_run.astype(np.int64)

    def sum(self, values: Array) -> Array:
        """Sum ``values``, one for each row of the attribute ``robots``, over the robots of each run, shape (runs,)."""
        return sum_by_run(values, self.first)

    def mean(self, values: Array) -> Array:
        """Average ``values`` over the robots of each run that have one, shape (runs,); nan if no robot has one.

        ``values`` has one value for each row of the attribute ``robots``, nan for a robot without one.
        """
        return mean_by_run(values, self.first)

    def capped_time_s(self, t_end_s: float) -> Array:
        """Compute min(decision time, t_end) of each robot; t_end if it did not decide."""
        return capped_time_s(numbers(self.robots["decision_time_s"]), t_end_s)


def run_figures(robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float) -> pl.DataFrame:
    """Compute one row of figures for each run, sorted by run: the first table of the module's docstring.

    Args:
        robots, runs: tables of one cell, as a ``Result`` has them; the same runs in both. t_end_s: end of a run, s.
    Raises:
        InputError: the tables have different runs, a run occurs twice, or t_end is not above 0.
    """
    if not t_end_s > 0:
        raise InputError(f"{t_end_s!r} cannot be the end of a run; give a time above 0, s", field="t_end_s")
    by_run = ByRun(robots)
    decision = numbers(by_run.robots["decision"])
    means = {
        "decision_time_s": by_run.mean(by_run.capped_time_s(t_end_s)),
        "belief_in_truth": by_run.mean(numbers(by_run.robots["belief_in_truth"])),
        **{
            # The sum is nan if the decision of a robot is not logged.
            f"agreed_on_{answer}": np.where(
                np.isnan(by_run.sum(decision)), np.nan, by_run.sum(1.0 * (decision == answer)) == by_run.count
            )
            for answer in (0, 1)
        },
    }
    of_robots = pl.DataFrame({"run": by_run.runs, "robots": by_run.count})
    by_number = runs.sort("run")
    if by_run.runs.tolist() != by_number["run"].to_list():  # each run of the robots once, in ascending order
        raise InputError("the tables of robots and of runs must have the same runs, once each", field="runs")
    joined = by_number.join(of_robots, on="run", how="inner", maintain_order="left")
    columns = {name: numbers(joined[name]) for name in ("truth", "consensus_time_s", *COUNTS)}
    # of_swarms compares the integer codes of the categories. The cast gives a column of plain strings these codes too.
    columns["consensus"] = joined["consensus"].cast(RUNS["consensus"]).to_physical().to_numpy()
    values = means | of_swarms(columns, by_run.count, t_end_s)
    figures = [pl.Series(name, values[name], nan_to_null=True) for name in FIGURES]
    # Counts are floats so far, with nan (then null) in runs without a truth.
    typed = [column.cast(pl.Int64) if column.name in COUNTS else column for column in figures]
    return joined.select("run", "truth", "consensus", "robots").with_columns(typed)


@dataclass(frozen=True)
class CellSummary(NotebookView):
    """Figures of a cell; times in s.

    They are those of the second table of the module's docstring. Correlations and design effects (``icc_``,
    ``design_effect_``) of the capped decision time, of deciding right and of staying undecided are plain numbers, nan
    if undefined.
    """

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
    agreed_on_0: Interval
    agreed_on_1: Interval
    agreement_lasted: Interval
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
        """Return the figures as one flat row.

        An interval gives three columns: ``name`` (the estimate), ``name_low``, ``name_high``. Any other figure gives
        the column ``name``. A value that is not finite becomes None.
        """
        row: dict[str, float | int | None] = {}
        for name, value in self._items():
            if isinstance(value, Interval):
                estimate, low, high = value[:3]
                row[name], row[f"{name}_low"], row[f"{name}_high"] = plain(estimate), plain(low), plain(high)
            else:
                row[name] = plain(value)
        return row

    def as_dict(self) -> dict[str, Any]:
        """Return the figures for JSON: intervals become dictionaries, and values that are not finite become None."""
        return {
            name: value.as_dict() if isinstance(value, Interval) else plain(value)
            for name, value in self._items()
        }

    def _items(self) -> list[tuple[str, Any]]:
        """Return name and value of each field, in the order of the fields; an interval stays an ``Interval``."""
        return [(field.name, getattr(self, field.name)) for field in fields(self)]


def summary(
    robots: pl.DataFrame,
    runs: pl.DataFrame,
    t_end_s: float,
    level: float = 0.95,
    seed: int = 0,
    *,
    agreements: pl.DataFrame | None = None,
) -> CellSummary:
    """Compute all figures of a cell.

    Args:
        robots, runs: tables of one scenario's runs, as a ``Result`` has them. t_end_s: the end of a run, s.
        level: confidence level of each single interval. seed: seed of the bootstrap.
        agreements: table of agreements (``analysis.agreement.AGREEMENTS``); None: decisions are final.
    Raises:
        InputError: the tables have different runs, a run occurs twice, t_end is not above 0, or the level is not
            between 0 and 1.
    """
    table = run_figures(robots, runs, t_end_s)
    robot_counts = table["robots"].to_numpy()
    # Right and wrong are defined only in runs with a truth.
    with_truth = table.filter(pl.col("truth").is_not_null())
    right, wrong, counts_with_truth = (with_truth[name].to_numpy() for name in ("right", "wrong", "robots"))
    undecided = table["undecided"].to_numpy()
    figures = {name: numbers(table[name]) for name in ("robots", *OF_RUNS)}
    iccs = {
        "decision_time": icc_of_times(robots, t_end_s),
        "right": icc_of_counts(right, counts_with_truth),
        "undecided": icc_of_counts(undecided, robot_counts),
    }
    # The mean size m is that of the runs of the correlation: for "right", only runs with a truth.
    sizes = {name: counts_with_truth if name == "right" else robot_counts for name in iccs}
    named: dict[str, Any] = {
        **{name: interval(name, figures, level, seed) for name in INTERVALS},
        **consensus_shares(table, level),
        **{f"icc_{name}": value for name, value in iccs.items()},
        **{f"design_effect_{name}": design_effect(value, sizes[name]) for name, value in iccs.items()},
    }
    # A run without consensus counts as later than all others.
    consensus_s = table["consensus_time_s"].fill_null(math.inf).to_numpy()
    return CellSummary(
        runs=table.height,
        robots=int(robot_counts.sum()),
        t_end_s=t_end_s,
        level=level,
        consensus_median_s=quantile_interval(consensus_s, 0.5, level),
        robot_error=cluster_share(count=wrong, of=right + wrong, level=level, seed=seed),
        agreement_lasted=_lasted(agreements, level),
        **named,
    )


def _lasted(agreements: pl.DataFrame | None, level: float) -> Interval:
    """Return the share of agreements that held at the end of the run; undefined (nan) without a table or rows."""
    holds = np.zeros(0) if agreements is None else agreements["holds"].to_numpy()
    return wilson(int(holds.sum()), holds.size, level)


MEANS: Final = {
    "decision_time_s": "decision_time_s",
    "belief_in_truth": "belief_in_truth",
    "consensus_time_s": "swarm_time_s",
}
"""Means over runs: name of the mean, and the column of ``run_figures`` that is averaged."""
SHARES_OF_ROBOTS: Final = {f"robots_{name}": name for name in ("right", "wrong", "undecided")}
"""Shares of robots: name of the share, and the column of ``run_figures`` that counts the robots."""
SHARES_OF_RUNS: Final = ("swarm_right", "swarm_wrong", "agreed_on_0", "agreed_on_1")
"""Shares of runs: columns of ``run_figures`` that are 1 or 0."""
INTERVALS: Final = (*MEANS, *SHARES_OF_ROBOTS, *SHARES_OF_RUNS)
"""Figures of the summary that ``interval`` computes; it also accepts any column of 0 and 1."""
OF_RUNS: Final = (*MEANS.values(), *SHARES_OF_ROBOTS.values(), *SHARES_OF_RUNS)
"""Columns of ``run_figures`` that ``interval`` reads, besides ``robots``."""


def interval(name: str, figures: Columns, level: float = 0.95, seed: int = 0) -> Interval:
    """Compute one figure of a cell, with its limits, from the figures of the cell's runs.

    Args:
        name: one of ``INTERVALS``. Any other name must be a column of 0 and 1 in ``figures``: the figure is the share
            of runs with a 1.
        figures: columns of ``run_figures`` by name, with ``robots``, the number of robots; shape (runs,) each, nan
            where a figure is undefined in a run.
        level: confidence level. seed: seed of the bootstrap.
    """
    if name in MEANS:
        return mean_interval(figures[MEANS[name]], level)
    if name in SHARES_OF_ROBOTS:
        count = figures[SHARES_OF_ROBOTS[name]]
        known = ~np.isnan(count)
        return cluster_share(count[known], figures["robots"][known], level, seed)
    known = ~np.isnan(figures[name])  # the rest are columns of 0 and 1
    return wilson(int(figures[name][known].sum()), int(known.sum()), level)


def consensus_shares(table: pl.DataFrame, level: float = 0.95) -> dict[str, Interval]:
    """Compute the shares of runs that are split, incomplete or without a truth, and ``swarm_error``.

    Args:
        table: from ``run_figures``. level: confidence level.
    Returns: intervals named ``swarm_split``, ``swarm_incomplete``, ``swarm_truth_undefined`` (of all runs) and
        ``swarm_error`` (of the runs with a right or wrong consensus).
    """
    counts = dict(table.group_by("consensus").len().iter_rows())
    others = ("split", "incomplete", "truth_undefined")
    shares = {f"swarm_{name}": wilson(counts.get(name, 0), table.height, level) for name in others}
    right, wrong = counts.get("right", 0), counts.get("wrong", 0)
    return shares | {"swarm_error": wilson(wrong, right + wrong, level)}


def icc_of_times(robots: pl.DataFrame, t_end_s: float) -> float:
    """Compute the intra-run correlation of min(decision time, t_end) from a table of robots.

    It is nan for fewer than 2 runs, if every run has a single robot, and if all times are equal.
    """
    by_run = ByRun(robots)
    time_s = by_run.capped_time_s(t_end_s)
    means = by_run.mean(time_s)
    within = by_run.sum((time_s - np.repeat(means, by_run.count)) ** 2)
    return icc(means, within, by_run.count.astype(np.float64))


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
