"""Compute confidence intervals of shares, means, quantiles and paired differences; the run is the unit in all of them.

| name | figure | method | source |
|---|---|---|---|
| ``wilson`` | share of runs | (k + z^2/2 +- z sqrt(k(n-k)/n + z^2/4)) / (n + z^2) | Wilson 1927 |
| ``mean_interval`` | mean over runs | mean +- t s / sqrt(n) | Student 1908 |
| ``rate_interval`` | mean rate of events | Garwood's limits for K / c events, times c; c = variance / mean | \
Garwood 1936; McCullagh & Nelder 1989, 6.2 |
| ``share_interval`` | mean of shares | the same, clipped to [0, 1], and ``allowing_for_rare`` | Student 1908 |
| ``cluster_share`` | share of robots | percentiles of shares in resampled runs | Davison & Hinkley 1997, 3.8 |
| ``sign_flip`` | mean of differences | quantiles of means of random subsets | Hartigan 1969 |
| ``student_test`` | mean of differences | Student's limits and paired t-test | Student 1908 |
| ``allowing_for_rare`` | mean, where few runs differ | Wilson's limits of how often they do, squared and added | \
Newcombe 1998 |
| ``quantile_interval`` | quantile over runs | order statistics, binomial | Thompson 1936 |

Random numbers come from Philox with a key of (seed, purpose), so that they do not depend on other draws.

With very many distinct values a resampling method is replaced by the normal law that it approaches ("normal limit").
"""

from __future__ import annotations

import math
import zlib
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincinv, ndtr, ndtri, stdtr, stdtrit

from vibroswarm.analysis.binomial import probability_above, probability_at_most
from vibroswarm.errors import InputError, shown

DRAWS: Final = 1999
"""Bootstrap and sign-flip draws; one less than 2000, so that limits at 95 % are whole ranks of ``sign_flip``."""
FEW: Final = 10
"""If fewer runs than this have a share other than 0, or other than 1, a bootstrap of the share is unreliable. So are
sign flips, if fewer differences than this are other than the usual one."""
FAR: Final = 9.0
"""A value is far from the others if it is this many median deviations from their median: six standard deviations of a
normal law. Where half of the values are equal, or nearly so, the deviation of nine in ten stands for the median one."""
OF_NINE_IN_TEN: Final = 0.41
"""Median deviation of a normal law, in deviations that nine in ten do not exceed."""
_EXACT: Final = 10
"""Up to this number of differences all subsets are enumerated."""
_MANY_VALUES: Final = 2000
"""Above this number of distinct values, resampled means are replaced by their normal limit."""
_TAIL: Final = 5
"""With fewer draws as extreme as the observed sum, they say too little of the p-value (``sign_flip``)."""
_HALVES: Final = 30
"""Up to this number of differences other than 0 a small p-value is exact: the sums of each half are enumerated."""
_BLOCK: Final = 4_000_000
"""Most random numbers in memory at a time: draws are made in blocks of this size."""

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

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON; a number that is not finite becomes None."""
        return {name: plain(value) for name, value in self._asdict().items()}

    def excludes(self, value: float) -> bool:
        """Return whether the value lies outside the limits; False if the limits are nan."""
        return self.high < value or self.low > value


def plain(value: Any) -> Any:
    """Return a value for JSON: a float that is not finite becomes None, any other value stays as it is."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


class ForJson:
    """Base of results whose fields go into JSON."""

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON: intervals become dictionaries, and values that are not finite become None."""
        return {
            name: value.as_dict() if hasattr(value, "as_dict") else plain(value)
            for name, value in vars(self).items()
        }


def columns_of(name: str, found: Sequence[Any]) -> dict[str, Any]:
    """Return an interval, or an estimate and its limits, as the columns NAME, NAME_low and NAME_high of a table.

    A value that is not finite becomes None.
    """
    return {f"{name}{end}": plain(value) for end, value in zip(("", "_low", "_high"), found, strict=False)}


def finite_limits(found: Interval | None) -> dict[str, float] | None:
    """Return estimate, low and high for JSON, without those that are not finite; None if there is no interval."""
    if found is None:
        return None
    values = {"estimate": found.estimate, "low": found.low, "high": found.high}
    return {name: value for name, value in values.items() if math.isfinite(value)}


def undefined(level: float, n: int, how: str) -> Interval:
    """Make the interval of an undefined figure."""
    return Interval(math.nan, math.nan, math.nan, level, n, how)


def jackknife_error(without: ArrayLike) -> float:
    """Return the standard error of an estimate, from the estimates without each unit (or group of units) in turn."""
    left_out = np.asarray(without, dtype=np.float64)
    n = left_out.size
    return float(np.sqrt((n - 1) / n * ((left_out - left_out.mean()) ** 2).sum()))


def student_factor(n: float, level: float) -> float:
    """Return by how much limits of n units are wider because the variance is estimated from them, as Student's are.

    It is the ratio of the quantiles of Student's and of the normal law. ``n`` is at least 2.
    """
    tail = 0.5 + level / 2
    return float(stdtrit(n - 1, tail) / ndtri(tail))


def few_factor(n: int, level: float) -> float:
    """Return the factor that widens deviations of bootstrap draws of few units, n.

    The factor sqrt(n / (n - 1)) makes the variance of the draws unbiased; ``student_factor`` allows for the few units
    that it is estimated from. ``n`` is at least 2.
    """
    return math.sqrt(n / (n - 1)) * student_factor(n, level)


def draw_limits(draws: Values, n: int, level: float) -> tuple[float, float]:
    """Return percentile limits of bootstrap draws of n units, whose deviations from their mean are made wider.

    They are multiplied by ``few_factor``. The limits of one unit are infinite.

    Args:
        draws: without nan, some finite; infinite ones stay. n: number of units that were drawn from.
    """
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


def check_level(level: float) -> None:
    """Check that a level of confidence is between 0 and 1.

    Raises:
        InputError: it is not.
    """
    if not (isinstance(level, float | np.floating) and 0.0 < level < 1.0):
        raise InputError(
            f"{shown(level)} is not a level of confidence; give a share such as 0.95", field="level"
        )


def wilson_limits(successes: ArrayLike, n: ArrayLike, level: float = 0.95) -> tuple[Values, Values]:
    """Compute Wilson's limits of shares.

    Args:
        successes: number of successes. n: number of trials. Neither need be whole; both broadcast.
    Returns: lower and upper limits, in the broadcast shape; nan where n is 0.
    Raises:
        InputError: the level is not between 0 and 1.
    """
    check_level(level)
    k, total = np.asarray(successes, dtype=np.float64), np.asarray(n, dtype=np.float64)
    z = float(ndtri(0.5 + level / 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        # Wilson 1927. k, which need not be whole, may exceed the total by rounding: then 0 replaces a negative product.
        half = z * np.sqrt(np.maximum(k * (total - k) / total, 0.0) + z * z / 4)
        low, high = (k + z * z / 2 - half) / (total + z * z), (k + z * z / 2 + half) / (total + z * z)
    # Rounding must not exclude a share of 0 or 1.
    low = np.where(k <= 0, np.where(total > 0, 0.0, np.nan), low)
    high = np.where(k >= total, np.where(total > 0, 1.0, np.nan), high)
    return low, high


def wilson(successes: int, n: int, level: float = 0.95) -> Interval:
    """Compute a share of runs with Wilson's limits; undefined (nan) for no runs."""
    if n == 0:
        check_level(level)
        return undefined(level, 0, "wilson")
    low, high = wilson_limits(successes, n, level)
    return Interval(successes / n, float(low), float(high), level, n, "wilson")


def without_nan(values: ArrayLike) -> Values:
    """Return the values as a flat array without nan (runs in which a figure is undefined); infinite values stay."""
    array = np.asarray(values, dtype=np.float64).ravel()
    return array[~np.isnan(array)]


def mean_interval(values: ArrayLike, level: float = 0.95) -> Interval:
    """Compute a mean over runs with Student's limits; values of nan are left out.

    The limits are infinite for one run, and equal to the mean if all runs have the same value. If a value is infinite,
    so is the mean, and the limits of two or more runs are nan.
    """
    check_level(level)
    runs = without_nan(values)
    if runs.size == 0:
        return undefined(level, 0, "t")
    mean = _mean(runs)
    if runs.size == 1:
        return Interval(mean, -math.inf, math.inf, level, 1, "t")
    # Student 1908
    half = float(stdtrit(runs.size - 1, 0.5 + level / 2)) * float(runs.std(ddof=1)) / math.sqrt(runs.size)
    return Interval(mean, mean - half, mean + half, level, runs.size, "t")


def rate_interval(values: ArrayLike, of_one_event: float = math.nan, level: float = 0.95) -> Interval:
    """Compute a mean over runs of rates of events, such as events an hour, with limits that are not below 0.

    Events of a run may come together. So Garwood's limits are those of a Poisson count of clusters, whose size is the
    variance of the rates over their mean (quasi-Poisson), at least that of one event.

    Args:
        values: rate of each run; those of nan are left out. of_one_event: the rate of a run with one event; nan:
            unknown, then the upper limit is infinite if there is no event, or only one run.
    """
    check_level(level)
    runs = without_nan(values)
    if runs.size == 0:
        return undefined(level, 0, "quasi-Poisson")
    mean = _mean(runs)
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


def share_interval(values: ArrayLike, level: float = 0.95) -> Interval:
    """Compute a mean over runs of values between 0 and 1, with Student's limits clipped to that range.

    The true mean lies in the range, so clipping costs no confidence. For one run the limits are 0 and 1. If all runs,
    or all but a few, have the same share, the limits are at least those of how often others may occur
    (``allowing_for_rare``): 0 in all of n runs has Wilson's upper limit of 0 of n.
    """
    return within(allowing_for_rare(mean_interval(values, level), values, 1.0), 0.0, 1.0)


def time_interval(times_s: ArrayLike, t_end_s: float = math.nan, level: float = 0.95) -> Interval:
    """Compute a mean over runs of times, s, with Student's limits clipped to a run; one run has no limits.

    If all runs, or all but a few, take the same time, such as ``t_end_s``, the limits are at least those of how often
    other times may occur (``allowing_for_rare``).

    Args:
        t_end_s: end of the runs, s; nan: not known, then limits may be later.
    """
    found = mean_interval(times_s, level)
    return found if found.n < 2 else within(allowing_for_rare(found, times_s, t_end_s), 0.0, t_end_s)


def within(found: Interval, least: float, most: float) -> Interval:
    """Clip limits of a mean to what its values can be, which costs no confidence.

    A limit of nan stays, and a bound of nan is none, because max and min return their first argument then.
    """
    return found._replace(low=max(found.low, least), high=min(found.high, most))


def mean_share_interval(values: ArrayLike, level: float = 0.95) -> Interval:
    """Compute a mean over runs of shares, with limits that stay in [0, 1]; values of nan are left out.

    A few shares near 0 or 1 have a skew distribution, and Student's limits of their mean may lie outside [0, 1]. So
    Student's limits are computed for asin(sqrt(mean)), with the standard error of the mean times the slope of this
    angle, and transformed back. (The mean angle of the shares is that of another number than their mean.) For one run,
    and if all runs have the same share, limits are those of ``share_interval``.
    """
    shares = np.clip(without_nan(values), 0.0, 1.0)
    of_shares = share_interval(shares, level)
    if of_shares.n < 2 or np.ptp(shares) <= 1e-12:
        return of_shares
    mean = of_shares.estimate
    error = float(shares.std(ddof=1)) / math.sqrt(shares.size)
    half = float(stdtrit(shares.size - 1, 0.5 + level / 2)) * error / (2.0 * math.sqrt(mean * (1.0 - mean)))
    angle = math.asin(math.sqrt(mean))
    # The angle of a share is from 0 to pi / 2; limits outside that range become those of the shares 0 and 1.
    low, high = (math.sin(min(max(end, 0.0), math.pi / 2)) ** 2 for end in (angle - half, angle + half))
    # Rounding must not put the mean outside its limits.
    return of_shares._replace(low=min(low, mean), high=max(high, mean), how="t of asin(sqrt(share))")


def _mean(values: Values) -> float:
    """Compute the mean, clipped to the range of the values so that rounding cannot put it outside."""
    return float(np.clip(values.mean(), values.min(), values.max()))


def _resampled(
    numerators: Values, denominators: Values, counts: NDArray[np.int64], level: float, seed: int, draws: int
) -> tuple[float, float]:
    """Return the bootstrap limits of sum(numerator) / sum(denominator) over runs.

    Runs with equal values are drawn together (by a multinomial over the kinds of run), which is equivalent and faster.
    For very many kinds, and at levels for which there are too few draws, the normal limit is used. The deviations of
    the draws from the ratio are multiplied by sqrt(n / (n - 1)), which makes their variance unbiased.

    Args:
        numerators, denominators: of each kind of run, (distinct,); runs with equal values are of one kind. Denominators
            are above 0.
        counts: number of runs of each kind, (distinct,); 2 or more in all. draws: number of bootstrap draws.
    """
    n = int(counts.sum())
    ratio = float(numerators @ counts) / float(denominators @ counts)
    widen = math.sqrt(n / (n - 1))  # makes the variance of the draws unbiased
    # With fewer than one draw beyond a limit, the draws' own range would be the limit of every higher level.
    if counts.size > _MANY_VALUES or (0.5 - level / 2) * (draws + 1) < 1.0 - 1e-9:
        # Normal limit, with the variance of a ratio by its linearisation.
        residual = (numerators - ratio * denominators) / (denominators @ counts)
        half = float(ndtri(0.5 + level / 2)) * widen * math.sqrt(float(counts @ residual**2))
        return ratio - half, ratio + half
    random, shares, drawn = generator(seed, "bootstrap"), counts / n, []
    at_once = max(1, _BLOCK // counts.size)
    for first in range(0, draws, at_once):
        weights = random.multinomial(n, shares, size=min(at_once, draws - first))
        drawn.append((weights @ numerators) / (weights @ denominators))
    spread = ratio + widen * (np.concatenate(drawn) - ratio)
    low, high = np.quantile(spread, [0.5 - level / 2, 0.5 + level / 2])  # Efron 1979
    return float(low), float(high)


def cluster_share(count: ArrayLike, of: ArrayLike, level: float = 0.95, seed: int = 0) -> Interval:
    """Compute a share of robots, sum(count) / sum(of), with limits that treat the run as the independent unit.

    Limits are percentiles of a bootstrap over runs. These would be too narrow (of width 0 if all runs have the same
    share) if fewer than ``FEW`` runs have a share other than 0, or other than 1. In that case the limits are Wilson's,
    with an effective number of independent robots in place of n: p (1 - p) / Var(share), but at most the number of
    robots; it is less where few runs give the variance (Korn and Graubard 1998). If the variance is 0, the effective
    number is the number of runs, as if each run were a single robot. Without robots, share and limits are nan.

    Args:
        count: number of robots with an outcome, such as wrong, in each run, (runs,); it need not be whole, where the
            outcome of a robot counts in part.
        of: number of robots of the run, (runs,). level: confidence level. seed: seed of the bootstrap.
    """
    # Each pair is one complex number, whose distinct values are found faster than those of pairs.
    pairs = np.asarray(count, dtype=np.float64) + 1j * np.asarray(of, dtype=np.float64)
    distinct, runs = np.unique(pairs, return_counts=True)
    return cluster_share_of_distinct(distinct.real, distinct.imag, runs, level, seed)


def cluster_share_of_distinct(
    count: NDArray[Any],
    of: NDArray[Any],
    runs: NDArray[np.int64],
    level: float = 0.95,
    seed: int = 0,
) -> Interval:
    """Compute a share of robots as ``cluster_share`` does, from numbers of runs that have the same counts.

    Runs with the same numbers of robots and of robots with the outcome are of one kind. The kinds may be in any order;
    those without robots or without runs are left out.

    Args:
        count: number of robots with the outcome in a run of each kind. of: number of all robots in such a run.
        runs: number of runs of each kind; (kinds,) each. level: confidence level. seed: seed of the bootstrap.
    Returns: the share with its limits; undefined (nan) if there are no robots.
    """
    check_level(level)
    # A fixed order of the kinds, by count and then by size, so that the same runs get the same bootstrap draws.
    order = np.lexsort((of, count))
    count, of, runs = count[order], of[order], runs[order]
    valid = (of > 0) & (runs > 0)
    robots_with_it, sizes, number = count[valid].astype(np.float64), of[valid].astype(np.float64), runs[valid]
    n = int(number.sum())
    if n == 0:
        return undefined(level, 0, "cluster bootstrap")
    share = float(robots_with_it @ number) / float(sizes @ number)
    runs_above_0, runs_below_1 = (
        int(number[robots_with_it > 0].sum()),
        int(number[robots_with_it < sizes].sum()),
    )
    if min(runs_above_0, runs_below_1) < FEW:
        effective = _independent_robots(robots_with_it, sizes, number, share, level)
        low, high = wilson_limits(share * effective, effective, level)
        # Rounding must not put the share outside its limits.
        return Interval(share, min(float(low), share), max(float(high), share), level, n, "cluster wilson")
    low_, high_ = _resampled(robots_with_it, sizes, number, level, seed, DRAWS)
    return Interval(share, max(low_, 0.0), min(high_, 1.0), level, n, "cluster bootstrap")


def _independent_robots(
    count: Values, of: Values, runs: NDArray[np.int64], share: float, level: float
) -> float:
    """Compute how many independent robots would give the share the variance that it has between runs.

    Args:
        count, of: number of robots with the outcome, and of all robots, in a run of each kind. runs: number of runs of
            each kind; (kinds,) each. share: sum of ``count`` / sum of ``of`` over runs. level: of the limits.
    Returns: the number, at most that of all robots; the number of runs if the variance is 0.
    """
    n, robots = float(runs.sum()), float(of @ runs)
    # Variance of the share between runs, by linearisation of the ratio of sums.
    variance = float(runs @ (count - share * of) ** 2) / robots**2
    if n > 1:
        variance *= n / (n - 1)  # unbiased
    if variance <= 0.0:
        return n
    if n > 1:  # the variance is estimated from n runs: Student's factor in place of the normal one
        variance *= student_factor(n, level) ** 2  # Korn & Graubard 1998
    return min(share * (1.0 - share) / variance, robots)


class Tested(NamedTuple):
    """The interval of a mean of paired differences, and the two-sided p-value of "no difference"."""

    interval: Interval
    p_value: float


def sign_flip(differences: ArrayLike, level: float = 0.95, seed: int = 0, draws: int = DRAWS) -> Tested:
    """Estimate the mean of paired differences, one for each run, by inverting the sign-flip test.

    If the differences are symmetric about m, each d - m is equally likely to be positive or negative. Flipping the
    signs of all d - m in a subset S gives a sum at least as large as the observed sum of d - m exactly when the mean of
    the d in S is at most m. So the limits are quantiles of the means of random subsets, in which each difference is
    included with probability 1/2 (Hartigan's typical values). Unless p is replaced as described below, 0 lies outside
    the limits exactly when p is at most 1 - level. For symmetric differences the interval is exact; for others it is
    correct for many runs, like Student's. With fewer than 6 pairs the limits at 95 % are infinite; without pairs,
    estimate, limits and p are nan.

    Up to 10 differences all subsets are enumerated. For more, ``draws`` random subsets are drawn (equal differences
    together), and for very many distinct differences the normal limit is used.

    If fewer than ``_TAIL`` of the random sums are as extreme as the observed sum, p is replaced by ``_small_p_value``:
    a limited number of draws cannot give p-values as small as a correction over many comparisons needs.
    """
    check_level(level)
    d = without_nan(differences)
    if d.size == 0:
        return Tested(undefined(level, 0, "sign flip"), math.nan)
    mean = _mean(d)
    distinct, counts = np.unique(d, return_counts=True)
    if distinct.size > _MANY_VALUES:
        return _sign_flip_of_many(d, mean, level)
    means = _all_subsets(d) if d.size <= _EXACT else _subsets(distinct, counts, mean, seed, draws)
    means.sort()
    # Hartigan 1969: the rank-th smallest and rank-th largest means are the limits; with rank 0 there are too few means.
    # The 1e-9 keeps rounding from lowering a whole rank by 1.
    rank = math.floor((means.size + 1) * (0.5 - level / 2) + 1e-9)
    low = float(means[rank - 1]) if rank else -math.inf
    high = float(means[-rank]) if rank else math.inf
    # A mean that differs from 0 by rounding alone counts on both sides of 0.
    tiny = 1e-12 * float(np.abs(d).max())
    at_most, at_least = int((means <= tiny).sum()), int((means >= -tiny).sum())
    beyond = min(at_most, at_least)
    p_value = min(1.0, 2.0 * (1 + beyond) / (means.size + 1))
    if beyond < _TAIL and d.size > _EXACT:  # too few draws beyond 0 to estimate a small p-value
        p_value = _small_p_value(d)
    return Tested(Interval(mean, low, high, level, d.size, "sign flip"), p_value)


def student_test(differences: ArrayLike, level: float = 0.95, seed: int = 0) -> Tested:
    """Estimate the mean of paired differences with Student's limits, and test it by a paired t-test.

    The p-value is nan for fewer than 2 pairs. If all differences are equal (but for rounding), it is 1 if they are 0.
    Otherwise it is 2 / 2^n, that of n equal signs: what robots decide takes few values, so that a few equal differences
    do not say that no others occur.

    Args:
        seed: not used, as nothing is drawn; other tests of differences need one.
    """
    d = without_nan(differences)
    if d.size < 2:
        p_value = math.nan
    elif np.ptp(d) <= 1e-12 * float(np.abs(d).max()):
        p_value = 1.0 if d[0] == 0.0 else _least_p_value(d.size)
    else:
        # As ``scipy.stats.ttest_1samp`` computes it, which takes long to import.
        error = math.sqrt(((d - d.mean()) ** 2).mean() * (d.size / (d.size - 1)) / d.size)
        p_value = 2.0 * float(stdtr(d.size - 1, -abs(d.mean()) / error))
    return Tested(mean_interval(d, level), p_value)


def allowing_for_rare(found: Interval, of_runs: ArrayLike, most: float) -> Interval:
    """Widen the limits of a mean over runs, most of which have nearly the same value, by how rarely others occur.

    Sign flips, and Student's limits, know no value that did not occur: where scenarios differ in one run of 200, a
    third of such comparisons sees none. So if fewer than ``FEW`` values are far from the usual one, the median, the
    limits are at least those of rare events: shares of runs with a far larger and with a far smaller value, with
    Wilson's limits, times how much these differ from the usual one; and Student's limits of the other values. If these
    are all equal, an amount that was not seen is that of the other side, or ``most``. If they are not, limits allow
    for far values only on a side on which there are some.

    Args:
        found: the mean with limits. of_runs: values of the runs, such as paired differences; nan is left out.
        most: by how much runs can differ; nan: not known, then an amount that was not seen does not widen the limits.
    """
    d = without_nan(of_runs).round(9)
    if not d.size or not np.isfinite(d).all():
        return found
    usual = np.median(d)
    spread = np.median(np.abs(d - usual))
    far = np.abs(d - usual) > FAR * spread
    if far.sum() >= FEW:  # most are not rare, but equal to each other, or nearly so
        spread = OF_NINE_IN_TEN * np.quantile(np.abs(d - usual), 0.9, method="lower")
        far = np.abs(d - usual) > FAR * spread
    other = (d - usual)[far]
    if other.size >= FEW or (spread > 0.0 and not other.size):
        return found
    near = mean_interval(np.where(far, usual, d), found.level)
    amount = float(np.abs(other).mean()) if other.size else most
    unseen = amount if spread == 0.0 else 0.0
    sides = [_rare_mean(part, d.size, unseen, found.level) for part in (other[other > 0], -other[other < 0])]
    (larger, larger_low, larger_high), (smaller, smaller_low, smaller_high) = sides
    mean, half = near.estimate + larger - smaller, near.high - near.estimate
    low = mean - math.hypot(larger - larger_low, smaller_high - smaller, half)  # Newcombe 1998
    high = mean + math.hypot(larger_high - larger, smaller - smaller_low, half)
    return found._replace(low=min(found.low, float(low)), high=max(found.high, float(high)))


def _rare_mean(amounts: Values, n: int, unseen: float, level: float) -> tuple[float, float, float]:
    """Return the mean over n runs of a few amounts above 0 (``unseen`` without any), and limits by their number."""
    amount = float(amounts.mean()) if amounts.size else unseen
    low, high = wilson_limits(amounts.size, n, level)
    return amount * amounts.size / n, amount * float(low), amount * float(high)


def _small_p_value(d: Values) -> float:
    """Compute the p-value of sum(d), where draws of random signs give few sums as extreme.

    It is exact for up to ``_HALVES`` differences other than 0, and if all of these have one sign, which one choice of
    signs in 2^n does. Otherwise it is that of the saddlepoint.
    """
    apart = np.abs(d)
    apart = apart[apart > 1e-12 * apart.max()]  # not by rounding alone
    observed = abs(float(d.sum()))
    if observed >= float(apart.sum()) * (1.0 - 1e-12):
        return min(1.0, _least_p_value(apart.size))
    if apart.size <= _HALVES:
        one, other = np.sort(_signed_sums(apart[::2])), _signed_sums(apart[1::2])
        # Sums at least as large as the observed one: of each sum of one half, the sums of the other half that suffice.
        below = np.searchsorted(one, observed * (1.0 - 1e-12) - other)
        return 2.0 * float(one.size - below.mean()) / one.size
    return max(_saddlepoint_p_value(apart, observed), _least_p_value(apart.size))


def _saddlepoint_p_value(sizes: Values, observed: float) -> float:
    """Compute how probably the sum of numbers with random signs is at least ``observed`` from 0, on either side.

    By Lugannani and Rice (1980), with K(t) = sum ln cosh(t size) and K'(t) = observed: within 3 % where sizes
    differ. Where more than 30 are equal it is too large, by up to 8 % near p = .001 and 40 % at 1e-8. Possible sums of
    multiples of a unit are two units apart: half of that is the correction for continuity.
    """
    from scipy.optimize import brentq  # which takes long to import

    largest = float(sizes.max())
    sizes = sizes / largest
    aim = observed / largest - _unit(sizes)

    def slope(t: float) -> float:
        return float(sizes @ np.tanh(t * sizes)) - aim

    highest = 1.0
    while slope(highest) < 0.0:
        highest *= 2.0
    t = brentq(slope, 0.0, highest, xtol=1e-14)
    k = float(np.logaddexp(t * sizes, -t * sizes).sum()) - sizes.size * math.log(2.0)
    w = math.sqrt(2.0 * (t * aim - k))
    v = t * math.sqrt(float((sizes**2 * (1.0 - np.tanh(t * sizes) ** 2)).sum()))
    return 2.0 * float(ndtr(-w) + math.exp(-0.5 * w * w) / math.sqrt(2.0 * math.pi) * (1.0 / v - 1.0 / w))


def _unit(sizes: Values) -> float:
    """Return the unit of which all sizes are multiples, the smallest divided by 1 to 12; 0 if there is none."""
    for parts in range(1, 13):
        multiples = sizes * (parts / sizes.min())
        if np.abs(multiples - multiples.round()).max() < 1e-6:
            return float(sizes.min()) / parts
    return 0.0


def _signed_sums(values: Values) -> Values:
    """Compute the sum of n values with each choice of their signs, (2^n,)."""
    sums = np.zeros(1)
    for value in values:
        sums = np.concatenate([sums - value, sums + value])
    return sums


def _least_p_value(n: int) -> float:
    """Return 2 / 2^n, the smallest p-value that n signs can give."""
    return 2.0 ** (1 - min(n, 1000))  # n is limited, because a float below 2^-1074 rounds to 0


def _all_subsets(d: Values) -> Values:
    """Compute the means of all non-empty subsets of n differences, shape (2^n - 1,)."""
    # The bits of the numbers 1 to 2^n - 1 say which differences are in a subset.
    chosen = (np.arange(1, 2**d.size)[:, None] >> np.arange(d.size)) & 1
    return np.asarray((chosen @ d) / chosen.sum(axis=1))


def _subsets(distinct: Values, counts: NDArray[np.int64], mean: float, seed: int, draws: int) -> Values:
    """Compute the means of random subsets of the differences, shape (draws,).

    An empty subset has no mean; it gets the value ``mean``.

    Args:
        distinct: the distinct differences. counts: how often each occurs. mean: of all differences.
    """
    random, drawn, all_differ = generator(seed, "sign flip"), [], bool((counts == 1).all())
    at_once = max(1, _BLOCK // distinct.size)
    for first in range(0, draws, at_once):
        size = (min(at_once, draws - first), distinct.size)
        # How many of each difference are in the subset; if each occurs once, random bits are faster.
        taken = random.integers(0, 2, size, np.int8) if all_differ else random.binomial(counts, 0.5, size)
        number = taken.sum(axis=1, dtype=np.int64)
        drawn.append(np.divide(taken @ distinct, number, out=np.full(number.size, mean), where=number > 0))
    return np.concatenate(drawn)


def _sign_flip_of_many(d: Values, mean: float, level: float) -> Tested:
    """Compute the interval and p-value of ``sign_flip`` from the normal limit, of many distinct differences.

    The mean of a random subset has the standard deviation sqrt(sum (d - mean)^2) / n about the mean of all d. The
    p-value uses it too, unlike ``_small_p_value``, so that p and the interval agree.
    """
    error = math.sqrt(float(((d - mean) ** 2).sum())) / d.size
    half = float(ndtri(0.5 + level / 2)) * error
    p_value = float(2.0 * ndtr(-abs(mean) / error))
    return Tested(Interval(mean, mean - half, mean + half, level, d.size, "sign flip"), p_value)


def quantile_rank(share: float, n: int) -> int:
    """Return the place of a quantile among n sorted values, from 0: that of the ceil(share n)-th smallest.

    1e-9: .55 of 100 values are 55, although the product is a little more in binary numbers.
    """
    return max(math.ceil(share * n - 1e-9), 1) - 1


def quantile_interval(values: ArrayLike, share: float = 0.5, level: float = 0.95) -> Interval:
    """Compute a quantile over runs with distribution-free limits from order statistics.

    The estimate is the ceil(share n)-th smallest value, or the mean of the middle two for the median of an even number
    of values. It is infinite if one of these values is. Limits are infinite if there are too few values.

    Args:
        values: of the runs; infinite for a run that never reached the event; nan is left out.
        share: of runs below the quantile, 0.5 for the median. level: confidence level.
    Raises:
        InputError: a share or level that is not between 0 and 1.
    """
    check_level(level)
    if not 0.0 < share < 1.0:
        raise InputError(f"{share!r} is not a quantile; give a share such as 0.5", field="share")
    runs = np.sort(without_nan(values))
    n = runs.size
    if n == 0:
        return undefined(level, 0, "order statistics")
    tail = 0.5 - level / 2
    # Thompson 1936: the number B of values below the quantile is binomial. The r-th smallest value is above the
    # quantile with the probability P(B <= r - 1), and below it with P(B >= r).
    # lower: the largest rank r with P(B <= r - 1) <= tail, 0 if there is none. upper: the smallest rank r with
    # P(B >= r) <= tail, n + 1 if there is none; this falls with r, and is negated because bisect needs rising values.
    ranks = range(n + 1)
    lower = bisect_right(ranks, tail, key=lambda rank: float(probability_at_most(rank - 1, n, share))) - 1
    upper = bisect_left(ranks, -tail, key=lambda rank: -float(probability_above(rank - 1, n, share)))
    low = float(runs[lower - 1]) if lower >= 1 else -math.inf
    high = float(runs[upper - 1]) if upper <= n else math.inf
    middle = runs[[n // 2 - 1, n // 2]] if share == 0.5 and n % 2 == 0 else runs[[quantile_rank(share, n)]]
    estimate = float(middle.mean()) if np.isfinite(middle).all() else math.inf
    return Interval(estimate, low, high, level, n, "order statistics")
