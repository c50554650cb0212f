"""One row a run, from the tables of robots and runs: what all intervals and comparisons start from.

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
"""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import (
    RUNS,
    Array,
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


class ByRun:
    """Robots brought together by run; sums in one fixed order, whatever the number of threads.

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
        """Sums of a value of each robot, shape (runs,)."""
        return sum_by_run(values, self.first)

    def mean(self, values: Array) -> Array:
        """Means over the robots that have the value; not a number where none has."""
        return mean_by_run(values, self.first)

    def capped_time_s(self, t_end_s: float) -> Array:
        """min(decision time, t_end) of each robot; t_end where there is no decision."""
        return capped_time_s(numbers(self.robots["decision_time_s"]), t_end_s)


def run_figures(robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float) -> pl.DataFrame:
    """The table above, sorted by run.

    Args:
        robots, runs: tables of one cell, as a ``Result`` has them; the same runs in both. t_end_s: end of a run, s.
    Raises:
        InputError: the tables are not of the same runs, a run is there twice, or t_end is not above 0.
    """
    if not t_end_s > 0:
        raise InputError(f"{t_end_s!r} is no end of a run; give a time above 0, s", field="t_end_s")
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
    found = means | of_swarms(columns, by_run.count, t_end_s)
    figures = [pl.Series(name, found[name], nan_to_null=True) for name in FIGURES]
    counts = [one.cast(pl.Int64) if one.name in COUNTS else one for one in figures]
    return joined.select("run", "truth", "consensus", "robots").with_columns(counts)
