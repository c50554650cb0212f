"""Compute the forced error: the share of robots that would be wrong if all had to answer at the end of the run.

| name | symbol | equation |
|---|---|---|
| wrong | W | robots that decided wrong / robots |
| leaning wrong | U | undecided robots whose belief in the truth is below 1/2; half of those at 1/2 or without one |
| forced error | e | W + U / robots |

A strategy that decides seldom is wrong seldom. The forced error charges for that: it compares strategies that decide
at different times, and a robot that guesses has 1/2. Right, wrong and undecided are still to be given beside it.
"""

from __future__ import annotations

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.inference.outcomes import Array, numbers

HALF = 0.5


def forced_errors(decision: NDArray[np.integer], belief_in_truth: Array, truth: Array) -> Array:
    """Return 1 for each robot that is wrong or leans to the wrong side, 1/2 for one that leans to neither, else 0.

    Args:
        decision: 0, 1, or -1 while undecided. belief_in_truth: at the end of the run for an undecided robot; nan: it
            has none. truth: 0 or 1; nan: neither decision is right.
    Returns: shape as they broadcast; nan where the truth is.
    """
    doubt = np.where(np.isnan(belief_in_truth), HALF, 1.0 - belief_in_truth)
    leaning = np.where(doubt > HALF, 1.0, np.where(doubt < HALF, 0.0, HALF))
    errors = np.where(decision == -1, leaning, decision != truth)
    return np.where(np.isnan(truth), np.nan, errors)


def forced_error_by_robot(robots: pl.DataFrame, runs: pl.DataFrame) -> Array:
    """Compute ``forced_errors`` of the rows of a table of robots.

    Args:
        robots, runs: tables of one cell, as a ``Result`` has them.
    Returns: (rows of robots,).
    """
    truth = robots.select("run").join(
        runs.select("run", "truth"), on="run", how="left", maintain_order="left"
    )
    return forced_errors(
        robots["decision"].to_numpy(), numbers(robots["belief_in_truth"]), numbers(truth["truth"])
    )


def forced_error_by_run(robots: pl.DataFrame, runs: pl.DataFrame) -> pl.DataFrame:
    """Average ``forced_errors`` over the robots of each run.

    Args:
        robots, runs: tables of one cell, as a ``Result`` has them.
    Returns: run, forced_error (null where no decision is right), by run.
    """
    errors = pl.Series("forced_error", forced_error_by_robot(robots, runs), nan_to_null=True)
    by_run = robots.select("run").with_columns(errors).sort("run").group_by("run", maintain_order=True)
    return by_run.agg(pl.col("forced_error").mean())
