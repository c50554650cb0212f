"""Compute confidence intervals of shares, means, quantiles and paired differences; the run is the unit in all of them.

| name | figure | method | source |
|---|---|---|---|
| ``wilson`` | share of runs | (k + z^2/2 +- z sqrt(k(n-k)/n + z^2/4)) / (n + z^2) | Wilson 1927 |
| ``mean_interval`` | mean over runs | mean +- t s / sqrt(n) | Student 1908 |
| ``bootstrap_mean`` | mean over runs | percentiles of means of runs drawn anew | Efron 1979 |
| ``cluster_share`` | share of robots | the same on sum(count) / sum(of); see there | Davison & Hinkley 1997, 3.8 |
| ``sign_flip`` | mean of differences | quantiles of means of random subsets | Hartigan 1969 |
| ``quantile_interval`` | quantile over runs | order statistics, binomial | Thompson 1936 |

Random numbers come from Philox with a key of (seed, purpose), so that they do not depend on other draws.
"""

from __future__ import annotations

import math
import zlib
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri, stdtrit

from vibroswarm.core.notebook_view import html_view
from vibroswarm.errors import InputError

DRAWS: Final = 1999
"""Bootstrap and sign-flip draws; one less than 2000, so that 2.5 % and 97.5 % are whole ranks."""
FEW: Final = 10
"""With fewer runs whose share is not 0, or not 1, a bootstrap of a share is unreliable."""
_EXACT: Final = 10
"""Up to this number of differences all subsets are enumerated."""
_MANY_VALUES: Final = 2000
"""Above this number of distinct values, resampled means are replaced by their normal limit."""
_TAIL: Final = 5
"""With fewer draws as extreme as the observed sum, the p-value is that of the normal limit."""
_BLOCK: Final = 4_000_000
"""Most numbers in memory at a time."""

Values = NDArray[np.float64]


class Interval(NamedTuple):
    """An estimate with its limits.

    ``n`` counts the independent units (runs, pairs); ``how`` names the method. All are nan if the figure is undefined;
    limits are infinite if there are too few data.
    """

    estimate: float
    low: float
    high: float
    level: float
    n: int
    how: str

    def _repr_html_(self) -> str:
        return html_view(self)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; None for what is not finite."""
        return {name: plain(value) for name, value in self._asdict().items()}

    def excludes(self, value: float) -> bool:
        """Return whether the value is outside; False without limits."""
        return self.high < value or self.low > value


def plain(value: Any) -> Any:
    """Return a value for JSON: None for what is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def undefined(level: float, n: int, how: str) -> Interval:
    """Make the interval of an undefined figure."""
    return Interval(math.nan, math.nan, math.nan, level, n, how)


def generator(seed: int, purpose: str) -> np.random.Generator:
    """Create the random generator for a seed and a purpose, independent of all others."""
    return np.random.Generator(np.random.Philox(key=[seed % 2**64, zlib.crc32(purpose.encode())]))


def check_level(level: float) -> None:
    """Refuse a level outside (0, 1).

    Raises:
        InputError: it is outside.
    """
    if not 0.0 < level < 1.0:
        raise InputError(f"{level!r} is not a level of confidence; give a share such as 0.95", field="level")


def wilson_limits(successes: ArrayLike, n: ArrayLike, level: float = 0.95) -> tuple[Values, Values]:
    """Compute Wilson's limits of shares, broadcasting inputs; nan where n is 0. Counts need not be whole."""
    check_level(level)
    k, total = np.asarray(successes, dtype=np.float64), np.asarray(n, dtype=np.float64)
    z = float(ndtri(0.5 + level / 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        half = z * np.sqrt(np.maximum(k * (total - k) / total, 0.0) + z * z / 4)  # Wilson 1927
        low, high = (k + z * z / 2 - half) / (total + z * z), (k + z * z / 2 + half) / (total + z * z)
    # Rounding must not exclude a share of 0 or 1.
    return np.where(k <= 0, np.where(total > 0, 0.0, np.nan), low), np.where(
        k >= total, np.where(total > 0, 1.0, np.nan), high
    )


def wilson(successes: int, n: int, level: float = 0.95) -> Interval:
    """Compute a share of runs with Wilson's limits; undefined (nan) for no runs."""
    if n == 0:
        check_level(level)
        return undefined(level, 0, "wilson")
    low, high = wilson_limits(successes, n, level)
    return Interval(successes / n, float(low), float(high), level, n, "wilson")


def finite(values: ArrayLike) -> Values:
    """Drop nan, the value of a run in which a figure is undefined."""
    array = np.asarray(values, dtype=np.float64).ravel()
    return array[~np.isnan(array)]


def mean_interval(values: ArrayLike, level: float = 0.95) -> Interval:
    """Compute a mean over runs with Student's limits: infinite for one run, of width 0 if all runs are equal."""
    check_level(level)
    runs = finite(values)
    if runs.size == 0:
        return undefined(level, 0, "t")
    mean = _mean(runs)
    if runs.size == 1:
        return Interval(mean, -math.inf, math.inf, level, 1, "t")
    # Student 1908
    half = float(stdtrit(runs.size - 1, 0.5 + level / 2)) * float(runs.std(ddof=1)) / math.sqrt(runs.size)
    return Interval(mean, mean - half, mean + half, level, runs.size, "t")


def mean_share_interval(values: ArrayLike, level: float = 0.95) -> Interval:
    """Compute a mean of shares with Student's limits of asin(sqrt(share)), back as shares: they stay in [0, 1].

    Few shares near 0 or 1 are skew; Student's own limits leave the range there. For one run it is [0, 1].
    """
    shares = finite(values)
    plain = mean_interval(shares, level)
    if shares.size < 2:
        return plain._replace(low=max(plain.low, 0.0), high=min(plain.high, 1.0))
    of_angles = mean_interval(np.arcsin(np.sqrt(np.clip(shares, 0.0, 1.0))), level)
    low, high = (math.sin(min(max(end, 0.0), math.pi / 2)) ** 2 for end in (of_angles.low, of_angles.high))
    return plain._replace(
        low=min(low, plain.estimate), high=max(high, plain.estimate), how="t of asin(sqrt(share))"
    )


def _mean(values: Values) -> float:
    """Compute the mean, clipped to the range of the values against rounding."""
    return float(np.clip(values.mean(), values.min(), values.max()))


def bootstrap_mean(values: ArrayLike, level: float = 0.95, seed: int = 0, draws: int = DRAWS) -> Interval:
    """Compute a mean over runs with a percentile bootstrap over runs.

    Equal runs are drawn together (multinomial over the distinct values), which is equivalent and fast. For very many
    distinct values the normal limit is used. The spread is multiplied by sqrt(n / (n - 1)), which makes the variance
    unbiased.
    """
    check_level(level)
    runs = finite(values)
    if runs.size == 0:
        return undefined(level, 0, "bootstrap")
    mean = _mean(runs)
    if runs.size == 1:
        return Interval(mean, -math.inf, math.inf, level, 1, "bootstrap")
    distinct, counts = np.unique(runs, return_counts=True)
    low, high = _resampled(distinct, np.ones(distinct.size), counts, level, seed, draws)
    return Interval(mean, low, high, level, runs.size, "bootstrap")


def _resampled(
    numerators: Values, denominators: Values, counts: NDArray[np.int64], level: float, seed: int, draws: int
) -> tuple[float, float]:
    """Return the bootstrap limits of sum(numerator) / sum(denominator) over units; ``counts`` units have each value."""
    n = int(counts.sum())
    ratio = float(numerators @ counts) / float(denominators @ counts)
    widen = math.sqrt(n / (n - 1))
    if counts.size > _MANY_VALUES:
        residual = (numerators - ratio * denominators) / (denominators @ counts)
        half = float(ndtri(0.5 + level / 2)) * widen * math.sqrt(float(counts @ residual**2))
        return ratio - half, ratio + half
    random, shares, drawn = generator(seed, "bootstrap"), counts / n, []
    at_once = max(1, _BLOCK // counts.size)
    for first in range(0, draws, at_once):
        weights = random.multinomial(n, shares, size=min(at_once, draws - first))
        below = weights @ denominators
        above = weights @ numerators
        drawn.append(np.divide(above, below, out=np.full(below.size, ratio), where=below > 0))
    spread = ratio + widen * (np.concatenate(drawn) - ratio)
    low, high = np.quantile(spread, [0.5 - level / 2, 0.5 + level / 2])  # Efron 1979
    return float(low), float(high)


def cluster_share(count: ArrayLike, of: ArrayLike, level: float = 0.95, seed: int = 0) -> Interval:
    """Compute a share of robots, sum(count) / sum(of), from the counts of each run, (runs,): the run is the unit.

    Limits are percentiles of a bootstrap over runs. If fewer than ``FEW`` runs differ from 0 or from 1, these would be
    too narrow (of width 0 if all runs agree); then they are Wilson's limits for the effective number of independent
    robots, n' = p(1-p) / Var of the share: at most the number of robots, and the number of runs if all agree, since
    the robots of a run are strongly correlated.
    """
    numerator, denominator = np.asarray(count, dtype=np.int64), np.asarray(of, dtype=np.int64)
    width = int(denominator.max(initial=0)) + 1
    pairs, counts = np.unique(numerator * width + denominator, return_counts=True)  # faster than by rows
    return cluster_share_of_distinct(pairs // width, pairs % width, counts, level, seed)


def cluster_share_of_distinct(
    count: NDArray[np.int64],
    of: NDArray[np.int64],
    runs: NDArray[np.int64],
    level: float = 0.95,
    seed: int = 0,
) -> Interval:
    """Compute ``cluster_share`` from distinct pairs: ``runs`` runs have ``count`` of ``of`` robots, (distinct,) each.

    The order of the pairs does not matter. Undefined without any robot.
    """
    check_level(level)
    order = np.lexsort((of, count))  # one order, so that the same runs get the same draws
    count, of, runs = count[order], of[order], runs[order]
    valid = (of > 0) & (runs > 0)
    ones, sizes, times = count[valid].astype(np.float64), of[valid].astype(np.float64), runs[valid]
    n = int(times.sum())
    if n == 0:
        return undefined(level, 0, "cluster bootstrap")
    share = float(ones @ times) / float(sizes @ times)
    off_zero, off_one = int(times[ones > 0].sum()), int(times[ones < sizes].sum())
    if min(off_zero, off_one) < FEW:
        effective = _independent_robots(ones, sizes, times, share)
        low, high = wilson_limits(share * effective, effective, level)
        return Interval(share, min(float(low), share), max(float(high), share), level, n, "cluster wilson")
    low_, high_ = _resampled(ones, sizes, times, level, seed, DRAWS)
    return Interval(share, max(low_, 0.0), min(high_, 1.0), level, n, "cluster bootstrap")


def _independent_robots(above: Values, below: Values, runs: NDArray[np.int64], share: float) -> float:
    """Compute how many independent robots give this variance of the share; the number of runs if the variance is 0."""
    n, robots = float(runs.sum()), float(below @ runs)
    variance = float(runs @ (above - share * below) ** 2) / robots**2
    if n > 1:
        variance *= n / (n - 1)
    if variance <= 0.0:
        return n
    return min(share * (1.0 - share) / variance, robots)


class SignFlip(NamedTuple):
    """The interval of a mean of paired differences, and the two-sided p-value of "no difference"."""

    interval: Interval
    p_value: float

    def _repr_html_(self) -> str:
        return html_view(self)


def sign_flip(differences: ArrayLike, level: float = 0.95, seed: int = 0, draws: int = DRAWS) -> SignFlip:
    """Estimate the mean of paired differences, one for each run, by inverting the sign-flip test.

    If the differences are symmetric about m, each d - m is as likely to have the one sign as the other. Flipping the
    signs of a subset S gives a sum at least as large as the observed one exactly when the mean of S is at most m. So
    the limits are quantiles of the means of random subsets (each difference in or out with probability 1/2: Hartigan's
    typical values), and 0 lies outside exactly when p < 1 - level. For symmetric differences the interval is exact, for
    others it is right in the limit of many, like Student's. With fewer than 6 pairs the limits at 95 % are infinite;
    without pairs, estimate, limits and p are nan.

    If fewer than ``_TAIL`` of the drawn sums are as extreme as the observed one, p is that of the normal limit if it
    is smaller: a correction over many comparisons needs p-values smaller than the draws can give.

    Up to 10 differences all subsets are enumerated; otherwise ``draws`` subsets are drawn (equal differences
    together), and for very many distinct ones the normal limit is used.
    """
    check_level(level)
    d = finite(differences)
    if d.size == 0:
        return SignFlip(undefined(level, 0, "sign flip"), math.nan)
    mean = _mean(d)
    distinct, counts = np.unique(d, return_counts=True)
    if distinct.size > _MANY_VALUES:
        return _sign_flip_of_many(d, mean, level)
    means = _all_subsets(d) if d.size <= _EXACT else _subsets(distinct, counts, mean, seed, draws)
    means.sort()
    rank = math.floor((means.size + 1) * (0.5 - level / 2) + 1e-9)  # Hartigan 1969
    low = float(means[rank - 1]) if rank else -math.inf
    high = float(means[-rank]) if rank else math.inf
    # Rounding of a subset's mean must not put 0 on a side where all differences are 0.
    tiny = 1e-12 * float(np.abs(d).max())
    at_most, at_least = int((means <= tiny).sum()), int((means >= -tiny).sum())
    beyond = min(at_most, at_least)
    p_value = min(1.0, 2.0 * (1 + beyond) / (means.size + 1))
    if beyond < _TAIL and d.size > _EXACT:  # too far out for the draws to tell how far
        p_value = min(p_value, _far_out(d))
    return SignFlip(Interval(mean, low, high, level, d.size, "sign flip"), p_value)


def _far_out(d: Values) -> float:
    """Compute the p-value from the normal limit of the sum, but at least 2 / 2^n, the smallest that n signs allow."""
    spread = math.sqrt(float((d * d).sum()))
    if spread == 0.0:
        return 1.0
    return max(float(2.0 * ndtr(-abs(float(d.sum())) / spread)), 2.0 ** (1 - min(d.size, 1000)))


def _all_subsets(d: Values) -> Values:
    """Compute the means of all non-empty subsets, shape (2^n - 1,)."""
    chosen = (np.arange(1, 2**d.size)[:, None] >> np.arange(d.size)) & 1
    return np.asarray((chosen @ d) / chosen.sum(axis=1))


def _subsets(distinct: Values, counts: NDArray[np.int64], mean: float, seed: int, draws: int) -> Values:
    """Compute the means of random subsets, shape (draws,); an empty subset counts with the mean of all."""
    random, drawn, alone = generator(seed, "sign flip"), [], bool((counts == 1).all())
    at_once = max(1, _BLOCK // distinct.size)
    for first in range(0, draws, at_once):
        size = (min(at_once, draws - first), distinct.size)
        # One of each: a bit in place of a binomial number.
        taken = random.integers(0, 2, size, np.int8) if alone else random.binomial(counts, 0.5, size)
        number = taken.sum(axis=1, dtype=np.int64)
        drawn.append(np.divide(taken @ distinct, number, out=np.full(number.size, mean), where=number > 0))
    return np.concatenate(drawn)


def _sign_flip_of_many(d: Values, mean: float, level: float) -> SignFlip:
    """Use the normal limit: the mean of a random subset has standard deviation sqrt(sum (d - mean)^2) / n."""
    error = math.sqrt(float(((d - mean) ** 2).sum())) / d.size
    half = float(ndtri(0.5 + level / 2)) * error
    p_value = float(2.0 * ndtr(-abs(mean) / error))
    return SignFlip(Interval(mean, mean - half, mean + half, level, d.size, "sign flip"), p_value)


def sign_flip_interval(differences: ArrayLike, level: float = 0.95, seed: int = 0) -> Interval:
    """Return only the interval of ``sign_flip``."""
    return sign_flip(differences, level, seed).interval


def quantile_interval(values: ArrayLike, share: float = 0.5, level: float = 0.95) -> Interval:
    """Compute a quantile over runs with distribution-free limits from order statistics.

    Values may be infinite (a run that never reached the event). The estimate is the ceil(share n)-th smallest value,
    or the mean of the middle two for the median of an even number. Limits are infinite if there are too few values.

    Raises:
        InputError: a share or level that is not between 0 and 1.
    """
    check_level(level)
    if not 0.0 < share < 1.0:
        raise InputError(f"{share!r} is not a quantile; give a share such as 0.5", field="share")
    runs = np.sort(finite(values))
    n = runs.size
    if n == 0:
        return undefined(level, 0, "order statistics")
    from scipy import stats  # half a second, for this alone

    tail = 0.5 - level / 2
    ranks = np.arange(n + 1)
    # Thompson 1936
    lower = int(np.searchsorted(stats.binom.cdf(ranks - 1, n, share), tail, side="right")) - 1
    upper = int(np.searchsorted(-stats.binom.sf(ranks - 1, n, share), -tail))
    low = float(runs[lower - 1]) if lower >= 1 else -math.inf
    high = float(runs[upper - 1]) if upper <= n else math.inf
    middle = runs[[n // 2 - 1, n // 2]] if share == 0.5 and n % 2 == 0 else runs[[math.ceil(share * n) - 1]]
    estimate = float(middle.mean()) if np.isfinite(middle).all() else math.inf
    return Interval(estimate, low, high, level, n, "order statistics")
