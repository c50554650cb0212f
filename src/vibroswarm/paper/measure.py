"""Values that claims ask for, with their standard errors: the run is the unit.

| name | equation |
|---|---|
| mean | mean over runs of x_r |
| paired difference | mean over runs of first_r - second_r, of the same seed |
| share saved | 1 - mean(first) / mean(second); error from (first_r - (1 - share) second_r) / mean(second) |
| log ratio of spreads | log(s1 / s2); error from ((x - mean)^2 / s1^2 - (y - mean)^2 / s2^2) / 2, run by run |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.paper.claims import MEASURED

Row = dict[str, Any]


def row(claim: str, column: str, cell: str, estimate: float, error: float | None, n: int) -> Row:
    """One row of ``MEASURED``."""
    known = None if error is None or not math.isfinite(error) else error
    return {
        "claim": claim,
        "column": column,
        "cell": cell,
        "estimate": estimate,
        "standard_error": known,
        "n": n,
    }


def exact(claim: str, column: str, cell: str, value: float) -> Row:
    """A value that is no estimate."""
    return row(claim, column, cell, value, 0.0, 1)


def of_interval(claim: str, column: str, cell: str, found: Interval) -> Row:
    """An estimate with its 95 % limits, as another room gives it."""
    half = (found.high - found.low) / 2
    quantile = float(stdtrit(max(found.n - 1, 1), 0.5 + found.level / 2))
    return row(claim, column, cell, found.estimate, half / quantile, found.n)


def mean(claim: str, column: str, cell: str, values: ArrayLike, less: float = 0.0) -> Row:
    """The mean over runs, less a number."""
    found = mean_interval(np.asarray(values, dtype=np.float64) - less)
    return of_interval(claim, column, cell, found)


def share_saved(
    claim: str,
    column: str,
    cell: str,
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    less: float = 0.0,
) -> Row:
    """Which share the first takes less than the second."""
    share = 1.0 - float(first.mean()) / float(second.mean())
    spread = mean_interval(share - (first - (1.0 - share) * second) / second.mean())
    return of_interval(claim, column, cell, spread._replace(estimate=share - less))


def log_spread(
    claim: str, column: str, cell: str, first: NDArray[np.float64], second: NDArray[np.float64]
) -> Row:
    """The logarithm of the ratio of standard deviations over runs; cannot be told where one of them is 0."""
    ends = [float(values.std(ddof=1)) for values in (first, second)]
    if min(ends) <= 0.0:
        return row(claim, column, cell, math.nan, None, first.size)
    parts = [(values - values.mean()) ** 2 / s**2 for values, s in zip((first, second), ends, strict=True)]
    spread = mean_interval((parts[0] - parts[1]) / 2)
    return of_interval(claim, column, cell, spread._replace(estimate=math.log(ends[0] / ends[1])))


def frame(rows: Sequence[Row]) -> pl.DataFrame:
    """The rows as a table."""
    return pl.DataFrame(list(rows), schema=MEASURED)
