"""Estimate the values that decide claims, with standard errors; the run is the unit.

| name | symbol | equation |
|---|---|---|
| mean | x | mean over n runs of x_r, with standard deviation s over runs |
| paired difference | d | mean over runs of first_r - second_r, of the same seed |
| share saved | - | 1 - mean(first) / mean(second); error from (first_r - (1 - share) second_r) / mean(second) |
| log ratio of sd | - | log(s1 / s2); error from ((x - mean)^2 / s1^2 - (y - mean)^2 / s2^2) / 2, run by run |
| difference from a published mean of N runs | - | error sqrt(s^2 / n + S^2 / N), n - 1 degrees of freedom |

Every public function below returns one row of the table ``claims.MEASURED``. Its first arguments name the value:
``value_name`` is what claims name (``Claim.value``), ``column`` the preset of the reproduction, and ``cell`` a label
for people. ``cannot`` is the reason why the column cannot answer the question, or None. ``less`` is a number that is
subtracted from the estimate, such as a published value.

**Error of a published mean.** The error bars of the real experiments treat robots as independent, but the results of
the robots in one run are strongly correlated (r = 0.97). The bars are therefore too short by a factor of
sqrt(1 + (R - 1) r), which is 2.2 with R = 5 robots and 3.1 with 10. The lengths of the bars are not in
``published.json``, so S, the standard deviation between experiments, is estimated from our runs. For a published
simulation S = s, the standard deviation of our runs of the same cell (a prediction interval). For a real experiment the
threshold theta_E and the gate (which observations O_c counts) are unknown, and S is the largest standard deviation over
all that the experiments may have had: times hardly vary at theta_E = 1.55, but by 250 s at 1.33. Real experiments share
their robots, a pool of 16; the error from this is not counted here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from vibroswarm.paper.claims import MEASURED
from vibroswarm.statistics.intervals import Interval, mean_interval

Row = dict[str, Any]
"""Row of the table ``claims.MEASURED``, by column."""

FEW: Final = 10
"""If fewer runs than this differ from the most common value, a standard error is meaningless, and left out."""
FEW_FAR: Final = 30
"""If fewer runs than this lie farther than ``FAR`` from the median, the distribution of bounded values is too skewed
for Student's limits alone."""
FAR: Final = 0.5
"""Distance from the median beyond which a value between -1 and 1 is rare."""


def row(
    value_name: str,
    column: str,
    cell: str,
    estimate: float,
    error: float | None,
    n: int,
    cannot: str | None = None,
) -> Row:
    """Return the row of an estimate with its standard error, over ``n`` runs.

    A standard error that is not finite becomes None. Without a standard error above 0, the value has no limits when the
    claim is decided, unless a caller also sets ``exact``, or ``above`` and ``below``.

    Args:
        value_name, column, cell, cannot: see the head of this module.
        estimate, error: the value and its standard error. n: number of runs.
    """
    known = None if error is None or not math.isfinite(error) else error
    return {
        "value": value_name,
        "column": column,
        "cell": cell,
        "estimate": estimate,
        "standard_error": known,
        "n": n,
        # The functions below replace these three values, and callers ``scattered``, where they apply.
        "exact": False,
        "above": None,
        "below": None,
        "cannot": cannot,
        "scattered": None,
    }


def exact(value_name: str, column: str, cell: str, value: float, cannot: str | None = None) -> Row:
    """Return the row of a constant, which has no sampling error."""
    return row(value_name, column, cell, value, error=None, n=1, cannot=cannot) | {"exact": True}


def of_interval(value_name: str, column: str, cell: str, found: Interval, cannot: str | None = None) -> Row:
    """Return the row of an estimate that is given as an interval with Student's limits.

    The row holds a standard error instead of limits, because a claim is decided at a level of its own, from which its
    limits follow. The standard error is half the width of the interval, divided by Student's quantile at the
    interval's level. Other intervals, such as the bootstrap intervals of the item ``search``, are treated as Student's
    intervals of the same width about the estimate.
    """
    half = (found.high - found.low) / 2
    # With one run, which has no degree of freedom, the interval is infinite whatever the quantile is.
    quantile = float(stdtrit(max(found.n - 1, 1), 0.5 + found.level / 2))
    return row(value_name, column, cell, found.estimate, error=half / quantile, n=found.n, cannot=cannot)


def mean(
    value_name: str,
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
    """Return the row of the mean over runs, minus ``less``.

    The row has no standard error if nearly all runs have the same value (``_nearly_all_equal``).

    Args:
        values: value of each run, (runs,); runs with NaN do not count.
        less: a constant, or a published mean.
        published_runs: number of runs behind a published mean, whose error is then included; None: ``less`` is exact.
        published_sd: standard deviation between the published runs; None: the one between ``values``.
        bounded: whether values lie between -1 and 1 (beliefs and their differences). If few of them are far from the
            median, and ``published_runs`` is None, the row also gets ``above`` and ``below`` (see ``share``), which
            widen its limits: rare values may not have occurred in these runs.
        cannot: why the column cannot answer the question.
    """
    runs_values = np.asarray(values, dtype=np.float64)
    estimated = of_interval(value_name, column, cell, mean_interval(runs_values - less))
    runs_values = runs_values[~np.isnan(runs_values)]
    if _nearly_all_equal(runs_values):
        estimated["standard_error"] = None  # the few other values say too little about the scatter
    # Limits from ``above`` and ``below`` would leave out the error of a published mean.
    if bounded and published_runs is None and runs_values.size and _few_far(runs_values):
        estimated |= _parts(runs_values)
    if published_runs is not None and estimated["standard_error"] is not None:
        sd = float(runs_values.std(ddof=1)) if published_sd is None else published_sd
        # sqrt(s^2 / n + S^2 / N), with s^2 / n the square of the standard error so far
        estimated["standard_error"] = math.hypot(estimated["standard_error"], sd / math.sqrt(published_runs))
    return estimated | {"cannot": cannot}


def share(
    value_name: str,
    column: str,
    cell: str,
    values: ArrayLike,
    *,
    cannot: str | None = None,
) -> Row:
    """Return the row of the mean over runs of a share or of a difference of shares.

    The row has no standard error. Its limits follow from the mean of max(value, 0), in the column ``above``, and the
    mean of max(-value, 0), in the column ``below``. Such limits hold for rare events too.

    Args:
        values: value of each run, between -1 and 1, (runs,); runs with NaN do not count.
    """
    runs_values = np.asarray(values, dtype=np.float64)
    runs_values = runs_values[~np.isnan(runs_values)]
    if not runs_values.size:
        return row(value_name, column, cell, math.nan, error=None, n=0, cannot=cannot)
    estimate = float(runs_values.mean())
    found = row(value_name, column, cell, estimate, error=None, n=runs_values.size, cannot=cannot)
    return found | _parts(runs_values)


def _nearly_all_equal(values: NDArray[np.float64]) -> bool:
    """Return whether nearly all runs have the same value.

    At least two runs must have the most common value, and the other runs must be fewer than these and than ``FEW``.
    """
    equal = int(np.unique(values, return_counts=True)[1].max(initial=0))  # runs with the most common value
    others = values.size - equal
    return equal >= 2 and others < FEW and others < equal


def _few_far(values: NDArray[np.float64]) -> bool:
    """Return whether fewer than ``FEW_FAR`` values lie farther than ``FAR`` from the median."""
    return bool(np.count_nonzero(np.abs(values - np.median(values)) > FAR) < FEW_FAR)


def _parts(values: NDArray[np.float64]) -> Row:
    """Return the means of the positive and negative parts of values, as the columns ``above`` and ``below`` of a row.

    The positive part of x is max(x, 0), the negative part max(-x, 0).

    Raises:
        ValueError: a value is not between -1 and 1.
    """
    if np.abs(values).max(initial=0.0) > 1.0 + 1e-9:  # 1e-9 allows for rounding errors
        raise ValueError("values between -1 and 1 are needed")
    return {
        "above": float(np.maximum(values, 0.0).mean()),
        "below": float(np.maximum(-values, 0.0).mean()),
    }


def share_saved(
    value_name: str,
    column: str,
    cell: str,
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    less: float = 0.0,
    *,
    published_runs: int | None = None,
    cannot: str | None = None,
) -> Row:
    """Return the row of the relative saving, 1 - mean(first) / mean(second), minus ``less``.

    Args:
        first, second: values of two cells, paired by run, (runs,) each, without NaN; the mean of ``second`` is not 0.
        less: a constant, or a published saving.
        published_runs: number of runs behind each of the two means of a published saving. The error of the published
            saving is then included, computed from our standard deviations, as if its runs were not paired. None:
            ``less`` is exact.
    """
    saved = 1.0 - float(first.mean()) / float(second.mean())
    # First-order (delta) approximation: one value for each run, with the mean ``saved``; their scatter gives the error.
    linearised = mean_interval(saved - (first - (1.0 - saved) * second) / second.mean())
    # ``of_interval`` takes only the width from the limits, so ``less`` need not be subtracted from them.
    estimated = of_interval(value_name, column, cell, linearised._replace(estimate=saved - less))
    if published_runs is not None and estimated["standard_error"] is not None:
        variance = first.var(ddof=1) + (1.0 - saved) ** 2 * second.var(ddof=1)
        published_error = math.sqrt(variance / published_runs) / float(second.mean())
        estimated["standard_error"] = math.hypot(estimated["standard_error"], published_error)
    return estimated | {"cannot": cannot}


def log_spread(
    value_name: str,
    column: str,
    cell: str,
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    *,
    cannot: str | None = None,
) -> Row:
    """Return the row of log(s1 / s2), the standard deviations over runs of two cells; NaN if one of them is 0.

    Args:
        first, second: values of the two cells, paired by run, (runs,) each.
    """
    s1, s2 = float(first.std(ddof=1)), float(second.std(ddof=1))
    if min(s1, s2) <= 0.0:
        return row(value_name, column, cell, math.nan, error=None, n=first.size, cannot=cannot)
    # First-order (delta) approximation of the log ratio: one value for each run. The scatter of these values gives the
    # standard error. Their mean is not the log ratio, so it is replaced by the log ratio below.
    first_part = (first - first.mean()) ** 2 / s1**2
    second_part = (second - second.mean()) ** 2 / s2**2
    linearised = mean_interval((first_part - second_part) / 2)
    return of_interval(value_name, column, cell, linearised._replace(estimate=math.log(s1 / s2))) | {
        "cannot": cannot
    }


def frame(rows: Sequence[Row]) -> pl.DataFrame:
    """Return the rows as a table with the columns of ``MEASURED``."""
    return pl.DataFrame(list(rows), schema=MEASURED)
