"""Decision time and belief of a result in short; ``swarm.summary`` has all figures, with intervals."""

from __future__ import annotations

import math
from typing import NamedTuple

import polars as pl

from vibroswarm.analysis.per_run import run_figures
from vibroswarm.result import Result


class Estimate(NamedTuple):
    """A mean over runs, its standard error (over runs), and how many runs it is from."""

    mean: float
    standard_error: float
    runs: int


def _over_runs(result: Result, figure: str) -> Estimate:
    per_run = run_figures(result.robots, result.runs, result.scenario.run.t_end_s)[figure]
    values = per_run.drop_nulls().cast(pl.Float64).to_numpy()
    if not values.size:
        return Estimate(math.nan, math.nan, 0)
    error = float(values.std(ddof=1)) / math.sqrt(values.size) if values.size > 1 else math.nan
    return Estimate(float(values.mean()), error, values.size)


def restricted_mean_decision_time_s(result: Result) -> Estimate:
    """Mean over robots of min(decision time, t_end): a robot that never decides counts with t_end, s."""
    return _over_runs(result, "decision_time_s")


def belief_in_truth(result: Result) -> Estimate:
    """Mean over robots of the belief in what is so, at the decision or else at the last sample.

    The paper calls it accuracy. It is not the share of right decisions.
    """
    return _over_runs(result, "belief_in_truth")
