"""Intervals of measured values, by what was measured of them.

| value | limits | source |
|---|---|---|
| a constant, marked as such | itself | - |
| a mean over n runs, with its standard error s | x -+ t(1 - c / 2; n - 1) s | Student 1908 |
| a mean of values of which many may be alike and few far off | the wider of Student's and the next | - |
| a share, or a difference d of shares, between -1 and 1 | d - w(d+, d-) to d + w(d-, d+) | Zou & Donner 2008 |
| anything else, a standard error of 0 too | none | - |

c is 1 - level. d+ and d- are the means of the positive and of the negative parts of d, so that d = d+ - d-. L and U are
Clopper and Pearson's limits (1934) of a share whose count is the sum of the parts, rounded outwards, each at c / (2 e).
The e makes them hold for all values between 0 and 1, not for 0 and 1 alone: the tail of a sum of such values is at most
e times that of a binomial of the same mean (Bentkus 2004). The widths of the two are put together as errors are:

    w(p, q)^2 = l^2 + u^2 + 2 r l u, l = p - L(p), u = U(q) - q, r = sqrt(p q / ((1 - p) (1 - q)))

with -r the correlation of two parts of which a run has one at most. So 0 of 100 runs do not give [0, 0].
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from scipy.special import betaincinv, stdtrit

Limits = tuple[float, float]
NONE: Limits = (-math.inf, math.inf)


def interval(row: Mapping[str, Any], level: float) -> Limits:
    """Limits of a row of ``claims.MEASURED``; infinite where there are none."""
    x = row["estimate"]
    if x is None or not math.isfinite(x):
        return NONE
    if row["exact"]:
        return x, x
    error, bounded = row["standard_error"], row["above"] is not None
    found = []
    if error is not None and math.isfinite(error) and error > 0.0:
        half = float(stdtrit(max(row["n"] - 1, 1), 0.5 + level / 2)) * error
        found.append((x - half, x + half))
    if bounded:
        low, high = of_parts(row["above"], row["below"], row["n"], level)
        shift = x - (row["above"] - row["below"])
        found.append((low + shift, high + shift))
    return (min(low for low, _ in found), max(high for _, high in found)) if found else NONE


def of_parts(above: float, below: float, n: int, level: float) -> Limits:
    """Limits of the mean of n independent values between -1 and 1.

    Args:
        above, below: means of their positive and negative parts.
    """
    tail = (1.0 - level) / 2
    (low_above, high_above), (low_below, high_below) = (of_share(p, n, tail) for p in (above, below))
    others = (1.0 - above) * (1.0 - below)
    alike = min(math.sqrt(above * below / others), 1.0) if others > 0.0 else 0.0
    down = _together(above - low_above, high_below - below, alike)
    up = _together(high_above - above, below - low_below, alike)
    return above - below - down, above - below + up


def _together(first: float, second: float, alike: float) -> float:
    return math.sqrt(first**2 + second**2 + 2.0 * alike * first * second)


def of_share(share: float, n: int, tail: float) -> Limits:
    """Limits of the mean of n independent values between 0 and 1, each wrong with probability ``tail`` at most."""
    total, each = share * n, tail / math.e
    least, most = math.floor(total + 1e-9), math.ceil(total - 1e-9)
    low = float(betaincinv(least, n - least + 1, each)) if least > 0 else 0.0
    high = float(betaincinv(most + 1, n - most, 1.0 - each)) if most < n else 1.0
    return low, high
