"""Decision time and belief over many runs; the run is the unit, since robots of one run share messages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import polars as pl

from vibroswarm.result import Result


class Estimate(NamedTuple):
    """A mean over runs, its standard error (over runs), and how many runs it is from."""

    mean: float
    standard_error: float
    runs: int


def _over_runs(per_run: pl.Series) -> Estimate:
    values = per_run.to_numpy()
    error = float(values.std(ddof=1) / np.sqrt(values.size)) if values.size > 1 else float("nan")
    return Estimate(float(values.mean()), error, values.size)


def restricted_mean_decision_time_s(result: Result) -> Estimate:
    """Mean over robots of min(decision time, t_end): a robot that never decides counts with t_end, s."""
    capped = pl.col("decision_time_s").fill_null(result.scenario.run.t_end_s)
    return _over_runs(
        result.robots.group_by("run", maintain_order=True).agg(capped.mean())["decision_time_s"]
    )


def belief_in_truth(result: Result) -> Estimate:
    """Mean over robots of the belief in what is so, at the decision or else at the last sample.

    The paper calls it accuracy. It is not the share of right decisions.
    """
    per_run = result.robots.group_by("run", maintain_order=True).agg(pl.col("belief_in_truth").mean())
    return _over_runs(per_run["belief_in_truth"].drop_nulls())
