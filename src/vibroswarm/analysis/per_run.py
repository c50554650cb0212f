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

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError


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

    def sum(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums of a value of each robot, shape (runs,)."""
        sums: NDArray[np.float64] = np.add.reduceat(values, self.first) if self.first.size else np.zeros(0)
        return sums

    def mean(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Means over the robots that have the value; not a number where none has."""
        there = ~np.isnan(values)
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.sum(np.where(there, values, 0.0)) / self.sum(there.astype(np.float64))


def capped_time_s(robots: pl.DataFrame, t_end_s: float) -> NDArray[np.float64]:
    """min(decision time, t_end) of each robot; t_end where there is no decision."""
    times_s: NDArray[np.float64] = robots["decision_time_s"].fill_null(t_end_s).to_numpy()
    return np.minimum(times_s, t_end_s)


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
    of_robots = pl.DataFrame(
        {
            "run": by_run.runs,
            "robots": by_run.count,
            "decision_time_s": by_run.mean(capped_time_s(by_run.robots, t_end_s)),
            "belief_in_truth": by_run.mean(by_run.robots["belief_in_truth"].to_numpy()),
        }
    ).with_columns(pl.col("belief_in_truth").fill_nan(None))
    joined = runs.join(of_robots, on="run", how="inner").sort("run")
    if joined.height != runs.height or of_robots.height != runs.height:
        raise InputError("the tables of robots and of runs are not of the same runs", field="runs")
    known = pl.col("truth").is_not_null()
    count = pl.col("robots")
    table = joined.with_columns(
        right=pl.when(known).then(pl.col("right").cast(pl.Int64)),
        wrong=pl.when(known).then(pl.col("wrong").cast(pl.Int64)),
        undecided=pl.col("undecided").cast(pl.Int64),
        swarm_right=pl.when(known).then((pl.col("consensus") == "right").cast(pl.Float64)),
        swarm_wrong=pl.when(known).then((pl.col("consensus") == "wrong").cast(pl.Float64)),
        swarm_time_s=pl.min_horizontal(pl.col("consensus_time_s").fill_null(t_end_s), pl.lit(t_end_s)),
    )
    return table.with_columns(
        right_share=pl.col("right") / count,
        wrong_share=pl.col("wrong") / count,
        undecided_share=pl.col("undecided") / count,
    ).select(
        *("run", "truth", "consensus", "robots", "right", "wrong", "undecided"),
        *("decision_time_s", "belief_in_truth", "consensus_time_s"),
        *("right_share", "wrong_share", "undecided_share", "swarm_right", "swarm_wrong", "swarm_time_s"),
    )
