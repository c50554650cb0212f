"""Compute confidence intervals of shares, means, quantiles and paired differences; the run is the unit in all of them.

| name | figure | method | source |
|---|---|---|---|
| ``wilson`` | share of runs | (k + z^2/2 +- z sqrt(k(n-k)/n + z^2/4)) / (n + z^2) | Wilson 1927 |
| ``cluster_share`` | share of robots | Wilson's, with an effective number of robots | Korn & Graubard 1998 |
| ``mean_interval`` | mean over runs | mean +- t s / sqrt(n) | Student 1908 |
| ``bounded_mean`` | mean of values in a range | the same, within the range, and ``allowing_for_rare`` | Student 1908 |
| ``rate_interval`` | mean rate of events | Garwood's limits of K / c events, times c; c = variance / mean | \
Garwood 1936; McCullagh & Nelder 1989, 6.2 |
| ``allowing_for_rare`` | mean, where few runs differ | Wilson's limits of how often they do, squared and added | \
Newcombe 1998 |
| ``student_test`` | mean of differences | Student's limits and paired t-test | Student 1908 |
| ``quantile_interval`` | quantile over runs | order statistics, binomial | Thompson 1936 |

Random numbers come from Philox with a key of (seed, purpose), so that they do not depend on other draws.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtr, bdtrc, gammaincinv, ndtri, stdtr, stdtrit

FEW: Final = 10
"""Values of a mean that differ from the usual one are rare if they are fewer than this; so are runs with a share other
than 0, or other than 1."""
FAR: Final = 9.0
"""A value is far from the others if it is this many median deviations from their median: six standard deviations of a
normal law. Where half of the values are equal, or nearly so, the deviation of nine in ten stands for the median one."""
OF_NINE_IN_TEN: Final = 0.41
"""Median deviation of a normal law, in deviations that nine in ten do not exceed."""

Values = NDArray[np.float64]
"""Floats, of any shape."""


class Interval(NamedTuple):
    """An estimate, its lower and upper limit, their confidence level, the number of units, and the method's name.

    ``n`` is the number of independent units (runs, pairs); ``how`` names the method. Estimate and limits are nan if the
    figure is undefined; the limits are infinite if there are too few data.
    """

    estimate: float
    low: float
    high: float
    level: float
    n: int
    how: str

    def excludes(self, value: float) -> bool:
        """Return whether the value lies outside the limits; False if the limits are nan."""
        return self.high < value or self.low > value


def plain(value: Any) -> Any:
    """Return a value for JSON: a float that is not finite becomes None, any other value stays as it is."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def columns_of(name: str, found: Sequence[Any]) -> dict[str, Any]:
    """Return an interval as the columns NAME, NAME_low and NAME_high of a table, None if not finite."""
    return {f"{name}{end}": plain(value) for end, value in zip(("", "_low", "_high"), found, strict=False)}


def jackknife_error(without: ArrayLike) -> float:
    """Return the standard error of an estimate, from the estimates without each unit (or group of units) in turn."""
    left_out = np.asarray(without, dtype=np.float64)
    n = left_out.size
    return float(np.sqrt((n - 1) / n * ((left_out - left_out.mean()) ** 2).sum()))


def pseudo_values(means: ArrayLike) -> Values:
    """Return values whose interval is that of a mean over all pairs of units, such as sessions, by the jackknife.

    A unit is in several pairs, so its mean over them varies less than what it contributes. Each pseudo-value is n times
    the mean over all pairs less n - 1 times that over the pairs without one unit. Two units have one pair, and so one
    value, which has no limits.

    Args:
        means: of each unit, the mean over its pairs with the others, (units,), at least two.
    """
    of_units = np.asarray(means, dtype=np.float64)
    n, mean = of_units.size, of_units.mean()
    return mean + 2 * (n - 1) / (n - 2) * (of_units - mean) if n > 2 else of_units[:1]


def student_factor(n: float, level: float) -> float:
    """Return the ratio of the quantiles of Student's and of the normal law, for n >= 2 units."""
    tail = 0.5 + level / 2
    return float(stdtrit(n - 1, tail) / ndtri(tail))


def few_factor(n: int, level: float) -> float:
    """Return the factor that widens deviations of bootstrap draws of few units, n.

    The factor sqrt(n / (n - 1)) makes the variance of the draws unbiased; ``student_factor`` allows for the few units
    that it is estimated from. ``n`` is at least 2.
    """
    return math.sqrt(n / (n - 1)) * student_factor(n, level)


def draw_limits(draws: Values, n: int, level: float) -> tuple[float, float]:
    """Return percentile limits of bootstrap draws of n units, with deviations ``few_factor`` times as wide."""
    if n < 2:
        return -math.inf, math.inf
    finite = draws[np.isfinite(draws)]
    wider, centre = few_factor(n, level), finite.mean()
    method: Any = "linear" if finite.size == draws.size else "nearest"  # no mean of a number and infinity
    low, high = np.quantile(
        centre + wider * (draws - centre), [0.5 - level / 2, 0.5 + level / 2], method=method
    )
    return float(low), float(high)


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Create the random generator for a seed and a purpose, independent of all others."""
    return np.random.Generator(np.random.Philox(key=[seed % 2**64, zlib.crc32(purpose.encode())]))


def wilson_limits(successes: ArrayLike, n: ArrayLike, level: float = 0.95) -> tuple[Values, Values]:
    """Compute Wilson's limits of shares; numbers need not be whole, and broadcast; nan where n is 0."""
    k, total = np.asarray(successes, dtype=np.float64), np.asarray(n, dtype=np.float64)
    z = float(ndtri(0.5 + level / 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        # Wilson 1927. k, which need not be whole, may exceed the total by rounding: then 0 replaces a negative product.
        half = z * np.sqrt(np.maximum(k * (total - k) / total, 0.0) + z * z / 4)
        low, high = (k + z * z / 2 - half) / (total + z * z), (k + z * z / 2 + half) / (total + z * z)
    # Rounding must not exclude a share of 0 or 1.
    known = np.where(total > 0, 0.0, np.nan)
    return np.where(k <= 0, known, low), np.where(k >= total, known + 1.0, high)


def wilson(successes: int, n: int, level: float = 0.95) -> Interval:
    """Compute a share of runs with Wilson's limits; undefined (nan) for no runs."""
    low, high = wilson_limits(successes, n, level)
    return Interval(successes / n if n else math.nan, float(low), float(high), level, n, "wilson")


def cluster_share(count: ArrayLike, of: ArrayLike, level: float = 0.95) -> Interval:
    """Compute a share of robots from counts by run, (runs,), with the limits of ``cluster_shares``."""
    robots = np.asarray(of, dtype=np.float64)
    share, low, high = (float(value) for value in cluster_shares(count, robots, level))
    return Interval(share, low, high, level, int((robots > 0).sum()), "cluster wilson")


def cluster_shares(count: ArrayLike, of: ArrayLike, level: float = 0.95) -> tuple[Values, Values, Values]:
    """Compute shares of robots, sum(count) / sum(of), with limits that treat the run as the independent unit.

    Limits are Wilson's, with an effective number of independent robots in place of n: p (1 - p) / Var(share), less
    where few runs give the variance (Korn and Graubard 1998). Where fewer than ``FEW`` runs have a share other than 0,
    or other than 1, it is at most the number of robots. If the variance is 0, the effective number is the number of
    runs, as if each run were a single robot.

    Args:
        count: number of robots with the outcome, (..., runs). of: number of all robots of a run, (runs,).
    Returns: shares and their lower and upper limits, (...,) each; nan without robots.
    """
    counts, sizes = np.asarray(count, dtype=np.float64), np.asarray(of, dtype=np.float64)
    n, robots = int((sizes > 0).sum()), float(sizes.sum())
    with np.errstate(invalid="ignore", divide="ignore"):
        share = counts.sum(axis=-1) / robots
        # Variance of the share between runs, by linearisation of the ratio of sums.
        variance = ((counts - share[..., None] * sizes) ** 2).sum(axis=-1) / robots**2
        if n > 1:  # unbiased; and Student's factor in place of the normal one, as n runs give the variance
            variance *= n / (n - 1) * student_factor(n, level) ** 2
        few = np.minimum((counts > 0).sum(axis=-1), (counts < sizes).sum(axis=-1)) < FEW
        independent = share * (1.0 - share) / variance
        independent = np.where(few, np.minimum(independent, robots), independent)
    effective = np.where(variance > 0.0, independent, n)
    low, high = wilson_limits(share * effective, effective, level)
    # Rounding must not put the share outside its limits.
    return share, np.minimum(low, share), np.maximum(high, share)


def without_nan(values: ArrayLike) -> Values:
    """Return the values as a flat array without nan (runs in which a figure is undefined); infinite values stay."""
    array = np.asarray(values, dtype=np.float64).ravel()
    return array[~np.isnan(array)]


def mean_interval(values: ArrayLike, level: float = 0.95) -> Interval:
    """Compute a mean over runs with Student's limits, infinite for one run; values of nan are left out."""
    runs = without_nan(values)
    if runs.size == 0:
        return Interval(math.nan, math.nan, math.nan, level, 0, "t")
    # clipped, so that rounding cannot put the mean outside the range of the values
    mean = float(np.clip(runs.mean(), runs.min(), runs.max()))
    if runs.size == 1:
        return Interval(mean, -math.inf, math.inf, level, 1, "t")
    # Student 1908
    half = float(stdtrit(runs.size - 1, 0.5 + level / 2)) * float(runs.std(ddof=1)) / math.sqrt(runs.size)
    return Interval(mean, mean - half, mean + half, level, runs.size, "t")


def within(found: Interval, least: float, most: float) -> Interval:
    """Clip limits of a mean to what its values can be, which costs no confidence; a bound of nan is none."""
    return found._replace(low=max(found.low, least), high=min(found.high, most))


def bounded_mean(
    values: ArrayLike, least: float = 0.0, most: float = 1.0, level: float = 0.95, unseen: float = math.nan
) -> Interval:
    """Compute a mean over runs of values within a range, with Student's limits and ``allowing_for_rare``.

    Args:
        least, most: the range; infinite or nan: not known. unseen: by how much runs may differ; nan: by its width.
    """
    apart = most - least if math.isnan(unseen) else unseen
    return within(allowing_for_rare(mean_interval(values, level), values, apart), least, most)


def rate_interval(values: ArrayLike, of_one_event: float = math.nan, level: float = 0.95) -> Interval:
    """Compute a mean over runs of rates of events, such as events an hour, with limits that are not below 0.

    Events of a run may come together. So Garwood's limits are those of a Poisson count of clusters, whose size is the
    variance of the rates over their mean (quasi-Poisson), at least that of one event.

    Args:
        values: rate of each run; those of nan are left out. of_one_event: the rate of a run with one event; nan:
            unknown, then the upper limit is infinite if there is no event, or only one run.
    """
    runs = without_nan(values)
    if runs.size == 0:
        return Interval(math.nan, math.nan, math.nan, level, 0, "quasi-Poisson")
    mean = float(runs.mean())
    dispersion = float(runs.var(ddof=1)) / mean if runs.size > 1 and mean > 0.0 else math.nan
    size = float(np.fmax(dispersion, of_one_event)) / runs.size
    if math.isnan(size):
        return Interval(mean, 0.0, math.inf, level, runs.size, "quasi-Poisson")
    clusters, tail = (mean / size if size > 0.0 else math.inf), (1.0 - level) / 2
    if math.isinf(clusters):  # the same rate in all runs, and the rate of one event is unknown
        return Interval(mean, mean, mean, level, runs.size, "quasi-Poisson")
    low = size * float(gammaincinv(clusters, tail)) if clusters > 0.0 else 0.0
    high = size * float(gammaincinv(clusters + 1.0, 1.0 - tail))
    return Interval(mean, low, high, level, runs.size, "quasi-Poisson")


def allowing_for_rare(found: Interval, of_runs: ArrayLike, most: float) -> Interval:
    """Widen the limits of a mean over runs, most of which have nearly the same value, by how rarely others occur.

    Student's limits know no value that did not occur: where scenarios differ in one run of 200, a third of such
    comparisons sees none. So if fewer than ``FEW`` values are far from the usual one, the median, the limits are at
    least those of rare events: shares of runs with a far larger and with a far smaller value, with Wilson's limits,
    times how much these differ from the usual one; and Student's limits of the other values. If these are all equal,
    an amount that was not seen is that of the other side, or ``most``. If they are not, limits allow for far values
    only on a side on which there are some.

    Args:
        found: the mean with limits. of_runs: values of the runs, such as paired differences; nan is left out.
        most: by how much runs can differ; if it is not finite, an amount that was not seen does not widen the limits.
    """
    d = without_nan(of_runs).round(9)
    if not np.isfinite(d).all() or not d.size:
        return found
    usual = float(np.median(d))
    apart = d - usual
    spread = np.median(np.abs(apart))
    if (
        np.abs(apart) > FAR * spread
    ).sum() >= FEW:  # most are not rare, but equal to each other, or nearly so
        spread = OF_NINE_IN_TEN * np.quantile(np.abs(apart), 0.9, method="lower")
    far = np.abs(apart) > FAR * spread
    if far.sum() >= FEW or (spread > 0.0 and not far.any()):
        return found
    near = mean_interval(np.where(far, usual, d), found.level)
    unseen = 0.0
    if spread == 0.0:
        unseen = float(np.abs(apart[far]).mean()) if far.any() else (most if math.isfinite(most) else 0.0)
    larger, smaller = (
        _rare_mean(sign * apart[far & (sign * apart > 0)], d.size, unseen, found.level) for sign in (1, -1)
    )
    half, mean = near.high - near.estimate, near.estimate + larger[0] - smaller[0]
    low = mean - math.hypot(larger[0] - larger[1], smaller[2] - smaller[0], half)  # Newcombe 1998
    high = mean + math.hypot(larger[2] - larger[0], smaller[0] - smaller[1], half)
    return found._replace(low=min(found.low, low), high=max(found.high, high))


def _rare_mean(amounts: Values, n: int, unseen: float, level: float) -> tuple[float, float, float]:
    """Return the mean over n runs of a few amounts above 0 (``unseen`` without any), and limits by their number."""
    amount = float(amounts.mean()) if amounts.size else unseen
    low, high = wilson_limits(amounts.size, n, level)
    return amount * amounts.size / n, amount * float(low), amount * float(high)


class Tested(NamedTuple):
    """The interval of a mean of paired differences, and the two-sided p-value of "no difference"."""

    interval: Interval
    p_value: float


def student_test(differences: ArrayLike, level: float = 0.95) -> Tested:
    """Estimate the mean of paired differences with Student's limits, and test it by a paired t-test.

    The p-value is nan for fewer than 2 pairs. If all differences are equal, it is 1 if they are 0, else 2 / 2^n, that
    of n equal signs: what robots decide takes few values, so that a few equal differences do not say that no others
    occur.
    """
    d = without_nan(differences)
    if d.size < 2:
        p_value = math.nan
    elif np.ptp(d) <= 1e-12 * float(np.abs(d).max()):  # equal but for rounding
        p_value = 1.0 if d[0] == 0.0 else 2.0 ** (1 - min(d.size, 1000))  # a float below 2^-1074 is 0
    else:
        p_value = 2.0 * float(stdtr(d.size - 1, -abs(d.mean()) / (d.std(ddof=1) / math.sqrt(d.size))))
    return Tested(mean_interval(d, level), p_value)


def quantile_interval(values: ArrayLike, share: float = 0.5, level: float = 0.95) -> Interval:
    """Compute a quantile over runs with distribution-free limits from order statistics.

    Args:
        values: of the runs; infinite for a run that never reached the event. share: of runs below the quantile.
    """
    runs = np.sort(without_nan(values))
    n, tail = runs.size, 0.5 - level / 2
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, level, 0, "order statistics")
    # Thompson 1936: the number B of values below the quantile is binomial. The r-th smallest value is above the
    # quantile with the probability P(B <= r - 1), and below it with P(B >= r) = P(B > r - 1).
    below = np.arange(n)
    lower = int((bdtr(below, n, share) <= tail).sum())  # the largest r whose P(B <= r - 1) <= tail; 0: none
    upper = int(
        (bdtrc(below, n, share) > tail).sum()
    )  # the smallest r whose P(B > r - 1) <= tail, less 1; n: none
    low = float(runs[lower - 1]) if lower else -math.inf
    high = float(runs[upper]) if upper < n else math.inf
    # 1e-9: .55 of 100 values are 55, although the product is a little more in binary numbers.
    middle = (
        runs[[n // 2 - 1, n // 2]]
        if share == 0.5 and n % 2 == 0
        else runs[[max(math.ceil(share * n - 1e-9), 1) - 1]]
    )
    estimate = float(middle.mean()) if np.isfinite(middle).all() else math.inf
    return Interval(estimate, low, high, level, n, "order statistics")
