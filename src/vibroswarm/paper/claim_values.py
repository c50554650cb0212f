"""Estimate the values that decide claims, with standard errors; the run is the unit.

| name | symbol | equation |
|---|---|---|
| mean | x | mean over n runs of x_r, with standard deviation s over runs |
| paired difference | d | mean over runs of first_r - second_r, of the same seed |
| share saved | - | 1 - mean(first) / mean(second); error from (first_r - (1 - share) second_r) / mean(second) |
| log ratio of sd | - | log(s1 / s2); error from ((x - mean)^2 / s1^2 - (y - mean)^2 / s2^2) / 2, run by run |
| difference from a published mean of N runs | - | error sqrt(s^2 / n + S^2 / N), n - 1 degrees of freedom |

**Error of a published mean.** The error bars of the real experiments treat robots as independent, but the robots of a
run are nearly alike (correlation r = 0.97): the bars are too short by a factor of sqrt(1 + (R - 1) r), 2.2 with R = 5
robots and 3.1 with 10. Their lengths are not in ``published.json``, so S, the standard deviation between experiments,
is estimated from our runs. For simulations S = s, that of the same cell (a prediction interval). For real experiments
S is the largest over the thresholds and gates that they may have had: at theta_E 1.55 times hardly vary, at 1.33 by
250 s. Real experiments share their robots, a pool of 16; that common error is not counted here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.paper.claims import MEASURED

Row = dict[str, Any]

REAL_EXPERIMENTS: Final = 15
"""Number of experiments behind each published mean."""
FEW: Final = 10
"""If fewer runs than this differ from the most common value, a standard error is meaningless."""
FEW_FAR: Final = 30
"""If fewer runs than this lie farther than ``FAR`` from the median, a mean of bounded values is too skewed for
Student's
limits alone.
"""
FAR: Final = 0.5


def row(
    claim: str,
    column: str,
    cell: str,
    estimate: float,
    error: float | None,
    n: int,
    cannot: str | None = None,
) -> Row:
    """Return the row of ``MEASURED``; a standard error of 0 gives no limits."""
    known = None if error is None or not math.isfinite(error) else error
    return {
        "claim": claim,
        "column": column,
        "cell": cell,
        "estimate": estimate,
        "standard_error": known,
        "n": n,
        "exact": False,
        "above": None,
        "below": None,
        "cannot": cannot,
    }


def exact(claim: str, column: str, cell: str, value: float, cannot: str | None = None) -> Row:
    """Return the row of a constant, which has no sampling error."""
    return row(claim, column, cell, value, None, 1, cannot) | {"exact": True}


def of_interval(claim: str, column: str, cell: str, found: Interval, cannot: str | None = None) -> Row:
    """Return the row of an estimate given with its 95 % limits."""
    half = (found.high - found.low) / 2
    quantile = float(stdtrit(max(found.n - 1, 1), 0.5 + found.level / 2))
    return row(claim, column, cell, found.estimate, half / quantile, found.n, cannot)


def mean(
    claim: str,
    column: str,
    cell: str,
    values: ArrayLike,
    less: float = 0.0,
    *,
    published_runs: int | None = None,
    published_sd: float | None = None,
    bounded: bool = False,
    cannot: str | None = None,
) -> Row:
    """Return the row of the mean over runs, minus a number.

    Args:
        less: a constant, or a published mean over ``published_runs`` with standard deviation ``published_sd``
            between them
            (default: that of the values).
        bounded: values lie between -1 and 1 (beliefs and their differences); where few are far from the median,
            limits
            allow for values not seen.
        cannot: why the column cannot answer the question.
    """
    runs_values = np.asarray(values, dtype=np.float64)
    estimated = of_interval(claim, column, cell, mean_interval(runs_values - less))
    runs_values = runs_values[~np.isnan(runs_values)]
    if _lumped(runs_values):
        estimated["standard_error"] = None
    if bounded and published_runs is None and runs_values.size and _few_far(runs_values):
        estimated |= _parts(runs_values)
    if published_runs is not None and estimated["standard_error"] is not None:
        sd = float(runs_values.std(ddof=1)) if published_sd is None else published_sd
        # sqrt(s^2 / n + S^2 / N)
        estimated["standard_error"] = math.hypot(estimated["standard_error"], sd / math.sqrt(published_runs))
    return estimated | {"cannot": cannot}


def share(
    claim: str, column: str, cell: str, values: ArrayLike, less: float = 0.0, *, cannot: str | None = None
) -> Row:
    """Return the row of the mean over runs of a share or a difference of shares; its limits hold for rare events
    too."""
    runs_values = np.asarray(values, dtype=np.float64)
    runs_values = runs_values[~np.isnan(runs_values)]
    if not runs_values.size:
        return row(claim, column, cell, math.nan, None, 0, cannot)
    return row(
        claim, column, cell, float(runs_values.mean()) - less, None, runs_values.size, cannot
    ) | _parts(runs_values)


def _lumped(values: NDArray[np.float64]) -> bool:
    """Return whether all but a few runs have the same value."""
    most = int(np.unique(values, return_counts=True)[1].max(initial=0))
    return most > 1 and values.size - most < min(FEW, most)


def _few_far(values: NDArray[np.float64]) -> bool:
    return bool(np.count_nonzero(np.abs(values - np.median(values)) > FAR) < FEW_FAR)


def _parts(values: NDArray[np.float64]) -> Row:
    """Return the means of the positive and of the negative part, as columns ``above`` and ``below``.

    Raises:
        ValueError: a value is not between -1 and 1.
    """
    if np.abs(values).max(initial=0.0) > 1.0 + 1e-9:
        raise ValueError("values between -1 and 1 are needed")
    return {
        "above": float(np.maximum(values, 0.0).mean()),
        "below": float(np.maximum(-values, 0.0).mean()),
    }


def share_saved(
    claim: str,
    column: str,
    cell: str,
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    less: float = 0.0,
    *,
    published_runs: int | None = None,
    cannot: str | None = None,
) -> Row:
    """Return the row of the relative saving, 1 - mean(first) / mean(second), minus a number.

    Args:
        less: a constant, or a published saving over ``published_runs`` runs of each, taken as unpaired.
    """
    saved = 1.0 - float(first.mean()) / float(second.mean())
    spread = mean_interval(saved - (first - (1.0 - saved) * second) / second.mean())
    estimated = of_interval(claim, column, cell, spread._replace(estimate=saved - less))
    if published_runs is not None and estimated["standard_error"] is not None:
        parts = first.var(ddof=1) + (1.0 - saved) ** 2 * second.var(ddof=1)
        published_error = math.sqrt(parts / published_runs) / float(second.mean())
        estimated["standard_error"] = math.hypot(estimated["standard_error"], published_error)
    return estimated | {"cannot": cannot}


def log_spread(
    claim: str,
    column: str,
    cell: str,
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    *,
    cannot: str | None = None,
) -> Row:
    """Return the row of the log ratio of standard deviations over runs; undefined where one of them is 0."""
    ends = [float(values.std(ddof=1)) for values in (first, second)]
    if min(ends) <= 0.0:
        return row(claim, column, cell, math.nan, None, first.size, cannot)
    parts = [(values - values.mean()) ** 2 / s**2 for values, s in zip((first, second), ends, strict=True)]
    spread = mean_interval((parts[0] - parts[1]) / 2)
    return of_interval(claim, column, cell, spread._replace(estimate=math.log(ends[0] / ends[1]))) | {
        "cannot": cannot
    }


def frame(rows: Sequence[Row]) -> pl.DataFrame:
    """Return the table of rows."""
    return pl.DataFrame(list(rows), schema=MEASURED)
