"""Cosine similarity of histograms, with its null and its ceiling at equal sample counts; and energy distance.

| name | symbol | equation |
|---|---|---|
| similarity | S | a . b / (abs(a) abs(b)) of two flattened histograms |
| collision probability | C | sum c (c - 1) / (N (N - 1)) over the bins of the real data: sum of p^2 without bias |
| ceiling | S_max | expected S of n1 and n2 values from the same distribution, that of the real data |
| null | S_0 | S of the real data and values spread uniformly over the feature's range |

A histogram of n values in many bins is noisy: sum (c/n)^2 is on average C + (1 - C) / n. So even a perfect simulation
has S_max = C / sqrt((C + (1 - C) / n1) (C + (1 - C) / n2)) < 1, and a simulation without any structure may come close
to it. Where the real distribution is nearly uniform over its bins, S says almost nothing.

S also depends on the number of values. Two data sets are therefore compared at equal counts: the same number of values
is drawn from each without replacement (a subsample), and S is averaged over ``DRAWS`` such draws.

The energy distance of a feature is 0 only if two distributions are the same:

| name | symbol | equation |
|---|---|---|
| squared distance | D^2 | 2 E abs(X - Y) - E abs(X - X') - E abs(Y - Y'), X' another value of X's sample, Y' of Y's |
| effect size | H | D^2 / (2 E abs(X - Y)): 0 equal, 1 fully separated |

("Energy" is a statistician's term here; it has nothing to do with vibration.) As no value is paired with itself, D^2 is
unbiased: for equal distributions it is 0 on average, whatever the counts, and may be slightly negative. Each column is
divided by its standard deviation over the real sessions, so that seconds and metres have the same weight. The session
is the unit: H is the mean over pairs of sessions, and its interval is over sessions of both kinds (``over_sessions``);
among the real sessions it is Student's with the pseudo-values of the jackknife, since their pairs overlap. That is a
variance between sessions, whose law is skewed: these limits hold the truth in 83 to 97 % of cases, and where they do
not they are too low.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations, product
from typing import Any, Final

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import stdtrit

from vibroswarm.calibrate.features import histogram, shapeless
from vibroswarm.core.arrays import Floats
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.statistics.intervals import Interval, finite_limits, mean_interval, pseudo_values

DRAWS: Final = 20
"""Subsamples behind each similarity at equal counts."""
_SEED: Final = 20
"""Seed of the subsamples."""


@dataclass(frozen=True)
class Spread:
    """Mean and range over pairs of sessions, and the number of pairs."""

    mean: float
    least: float
    """Smallest value of a pair."""
    most: float
    """Largest value of a pair."""
    pairs: int


@dataclass(frozen=True)
class Similarity:
    """Similarity of one feature of two sources by the authors' measure, with null and ceiling."""

    feature: str
    as_published: float
    """S of all real and all simulated values, pooled over sessions, whatever their numbers."""
    count: int
    """Number of values drawn from each source for ``at_equal_counts``, ``null`` and ``ceiling``: that of the smaller
    source."""
    at_equal_counts: float
    """S of ``count`` values from each source, mean over draws."""
    null: float
    """S_0: S of real values and values spread uniformly over the feature's range."""
    ceiling: float
    """S_max: expected S if both sources had the same distribution."""
    by_session: Spread
    """Real against simulated sessions, at the smallest session's count."""
    real_by_session: Spread | None
    """Real against real sessions, at the same count; None with one session."""
    session_count: int
    """Number of values of the smallest session."""

    @property
    def share_of_way(self) -> float:
        """Position of ``at_equal_counts`` between null (0) and ceiling (1); it may lie outside of this range."""
        return (self.at_equal_counts - self.null) / (self.ceiling - self.null)

    def as_dict(self) -> dict[str, Any]:
        """Return all figures as plain values for JSON."""
        return asdict(self) | {"share_of_way": self.share_of_way}


def cosine(a: Floats, b: Floats) -> float:
    """Return the cosine similarity S of two flattened histograms; NaN if one of them has no counts."""
    norms = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / norms if norms > 0 else math.nan  # Eq. 25 of the paper


def similarity(feature: str, one: Floats, other: Floats) -> float:
    """Return the cosine similarity S of the histograms of two sets of values; NaN if one has none within its range."""
    return cosine(histogram(one, feature), histogram(other, feature))


def ceiling(feature: str, real: Floats, n1: int, n2: int) -> float:
    """Return the ceiling S_max for ``n1`` and ``n2`` values, with C estimated from the real values of a feature.

    It is NaN if fewer than two real values lie within the range of the histogram.
    """
    counts = histogram(real, feature)
    n = counts.sum()
    c = float((counts * (counts - 1)).sum() / (n * (n - 1)))
    return c / math.sqrt((c + (1 - c) / n1) * (c + (1 - c) / n2))


def subsample(values: Floats, count: int, draw: int, which: int) -> Floats:
    """Draw ``count`` of the values (rows) without replacement; return all if there are no more.

    Args:
        values: the values, (n, columns).
        draw: number of the draw. which: number of the data set. Other numbers give independent draws.
    """
    if count >= len(values):
        return values
    # ``draw`` and ``which`` take the places of a run and a robot in the address of random numbers.
    u = uniforms(_SEED, run=draw, robot=which, purpose=Purpose.BOOTSTRAP, count=len(values))
    return np.asarray(values[np.argpartition(u, count - 1)[:count]])  # the rows with the smallest numbers


FIRST, SECOND, UNIFORM = range(3)
"""Numbers of the data sets that random numbers are drawn for: ``which`` of ``subsample``, and the shapeless values."""
Drawn = dict[tuple[int, int, int, int], Floats]
"""Cache of the histograms of subsamples, by ``id`` of the array of values, count, draw and data set."""


def at_equal_counts(
    feature: str, one: Floats, other: Floats, count: int, drawn: Drawn | None = None
) -> float:
    """Return the similarity S of two sets of values, with ``count`` values drawn from each; the mean over draws.

    It is NaN if a draw has no value within the range of the histogram, as when ``count`` is 0.

    Args:
        one, other: values of the feature, (n, columns) each.
        drawn: cache of histograms, which is filled in place; None: no cache. It serves one feature only, and only as
            long as the arrays of values exist, because it recognises them by ``id``.
    """
    drawn = {} if drawn is None else drawn
    # If all values of both sets are used, all draws are equal, so one is enough.
    draws = 1 if count >= max(len(one), len(other)) else DRAWS

    def counts(values: Floats, draw: int, which: int) -> Floats:
        """Return the histogram of a subsample, from the cache if it is there."""
        key = (id(values), count, draw, which)
        if key not in drawn:
            drawn[key] = histogram(subsample(values, count, draw, which), feature)
        return drawn[key]

    return float(
        np.mean([cosine(counts(one, draw, FIRST), counts(other, draw, SECOND)) for draw in range(draws)])
    )


def null_similarity(feature: str, real: Floats, count: int) -> float:
    """Return the null S_0: S of ``count`` real values and ``count`` values without structure, mean over draws.

    The real values are the same draws as those of the first data set of ``at_equal_counts``, so that S and S_0 differ
    by the second data set only.
    """
    similarities = []
    for draw in range(DRAWS):
        # ``draw`` and ``UNIFORM`` take the places of a run and a robot in the address of random numbers.
        u = uniforms(_SEED, run=draw, robot=UNIFORM, purpose=Purpose.BOOTSTRAP, count=2 * count)
        structureless = shapeless(feature, u.reshape(count, 2))
        similarities.append(similarity(feature, subsample(real, count, draw, FIRST), structureless))
    return float(np.mean(similarities))


def compare_feature(
    feature: str,
    real: Sequence[Floats],
    simulated: Sequence[Floats],
    published: tuple[Sequence[Floats], Sequence[Floats]] | None = None,
) -> Similarity | None:
    """Compare one feature of real and simulated sessions; None if a session has fewer than 10 values.

    Args:
        real, simulated: values of each session, (n, columns) each.
        published: real and simulated values of each session as the authors computed them, for ``as_published``; by
            default ``real`` and ``simulated``.
    """
    least = min(len(values) for values in (*real, *simulated))
    if least < 10:
        return None
    all_real, all_simulated = np.concatenate(real), np.concatenate(simulated)
    count = min(len(all_real), len(all_simulated))
    drawn: Drawn = {}
    # Pairs of a real and a simulated session, and pairs of real sessions, all at the smallest session's count.
    across = [at_equal_counts(feature, a, b, least, drawn) for a, b in product(real, simulated)]
    within = [at_equal_counts(feature, a, b, least, drawn) for a, b in combinations(real, 2)]
    return Similarity(
        feature=feature,
        as_published=similarity(
            feature, *(np.concatenate(sessions) for sessions in published or (real, simulated))
        ),
        count=count,
        at_equal_counts=at_equal_counts(feature, all_real, all_simulated, count),
        null=null_similarity(feature, all_real, count),
        ceiling=ceiling(feature, all_real, count, count),
        by_session=_spread(across),
        real_by_session=_spread(within) if within else None,
        session_count=least,
    )


def _spread(found: Sequence[float]) -> Spread:
    """Return the mean, the range and the number of values, one per pair of sessions."""
    return Spread(float(np.mean(found)), min(found), max(found), len(found))


MOST: Final = 4000
"""Longer sessions are thinned evenly to this number of values, which limits the pairs to 16 million."""


@dataclass(frozen=True)
class EnergyDistance:
    """Effect size of a feature, real against simulated and real against real."""

    feature: str
    effect: Interval
    """H of real against simulated sessions: mean over pairs, interval over sessions of both kinds."""
    real: Interval | None
    """H of real sessions against each other: mean over pairs, interval over sessions; None with one session."""

    def as_dict(self) -> dict[str, Any]:
        """Return feature and intervals for JSON; limits that are not finite are left out."""
        return {
            "feature": self.feature,
            "effect": finite_limits(self.effect),
            "real": finite_limits(self.real),
        }


def mean_distance(one: Floats, other: Floats | None = None) -> float:
    """Return E abs(X - Y), the mean distance between the rows of two samples, (n, columns) each.

    Without ``other``, return E abs(X - X'), the mean over the pairs of different rows of one sample, n at least 2.
    """
    if one.shape[1] == 1:
        return _mean_along_a_line(one[:, 0], None if other is None else other[:, 0])
    others = one if other is None else other
    pairs = len(one) * (len(others) - (other is None))  # without ``other``, a row is not paired with itself
    parts = np.array_split(one, len(one) // 1000 + 1)  # all distances at once would fill the memory
    return float(sum(cdist(part, others).sum() for part in parts)) / pairs


def _mean_along_a_line(one: Floats, other: Floats | None) -> float:
    """Return ``mean_distance`` of samples of single numbers, (values,) each, in n log n steps instead of n^2.

    Of n sorted values y with the sum T, the first k are below x and have the sum S. The distances x - y of the first k
    and y - x of the others add up to x (2 k - n) + T - 2 S.
    """
    others = np.sort(one if other is None else other)
    below = np.searchsorted(others, one)  # k of each x
    sums = np.append(0.0, np.cumsum(others))  # entry k: sum of the first k values
    n = others.size
    total = float((one * (2 * below - n) + sums[n] - 2.0 * sums[below]).sum())
    # Without ``other``, a value is not paired with itself, so it has n - 1 partners.
    return total / (one.size * (n - (other is None)))


@dataclass(frozen=True)
class RealDistances:
    """Distances among the real sessions alone."""

    each: tuple[float, ...]
    """Mean distance between the values of each session."""
    against: Interval | None
    """Effect size H of the real sessions against each other; None with one session."""


RealCache = dict[str, RealDistances]
"""Distances among the real sessions, by feature: they do not change with the simulation."""


def compare_distance(
    feature: str,
    real: Sequence[Floats],
    simulated: Sequence[Floats],
    known: RealCache | None = None,
) -> EnergyDistance | None:
    """Compare real with simulated sessions by one feature's energy distance.

    The result is None if a session has fewer than 10 values.

    Args:
        real, simulated: values of each session, (n, columns) each.
        known: distances among the real sessions by feature, from earlier calls with the same real sessions; a missing
            one is added. None: they are computed.
    """
    if min(len(session) for session in (*real, *simulated)) < 10:
        return None
    scale = np.concatenate(real).std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)  # a constant column is not divided by 0
    scaled_real, scaled_simulated = (
        [_thinned(session) / scale for session in sessions] for sessions in (real, simulated)
    )
    known = {} if known is None else known
    if feature not in known:
        known[feature] = _real_distances(scaled_real)
    among_real = known[feature]
    within_simulated = [mean_distance(session) for session in scaled_simulated]
    others = list(zip(scaled_simulated, within_simulated, strict=True))
    effects = [
        [effect_size(x, y, within_x, within_y) for y, within_y in others]
        for x, within_x in zip(scaled_real, among_real.each, strict=True)
    ]
    return EnergyDistance(feature, over_sessions(np.array(effects)), among_real.against)


def over_sessions(effects: Floats) -> Interval:
    """Return the mean of effect sizes with limits that hold at least 95 % for other sessions of both kinds.

    All real sessions are compared with the same simulated ones. So the variance of the mean is the sum of two: that
    of the means of real sessions and that of the means of simulated ones, each divided by the number of sessions. The
    smaller number gives the degrees of freedom. With one simulated session the limits are for that one.

    Args:
        effects: of pairs, (real, simulated).
    """
    of_real, of_simulated = effects.mean(axis=1), effects.mean(axis=0)
    found = mean_interval(of_real)
    fewest = min(effects.shape)
    if fewest < 2 or not np.isfinite(effects).all():
        return found
    error = math.sqrt(of_real.var(ddof=1) / of_real.size + of_simulated.var(ddof=1) / of_simulated.size)
    half = float(stdtrit(fewest - 1, 0.5 + found.level / 2)) * error
    return found._replace(low=found.estimate - half, high=found.estimate + half, n=fewest)


def _real_distances(sessions: Sequence[Floats]) -> RealDistances:
    """Return the distances within and between the real sessions.

    Args:
        sessions: values of each session, (n, columns) each, divided by the standard deviations of the columns.
    """
    within = tuple(mean_distance(session) for session in sessions)
    if len(sessions) < 2:
        return RealDistances(within, None)
    pairs = np.full((len(sessions), len(sessions)), np.nan)  # NaN: a session is not compared with itself
    for i in range(len(sessions)):
        for j in range(i):
            pairs[i, j] = pairs[j, i] = effect_size(sessions[i], sessions[j], within[i], within[j])
    return RealDistances(within, mean_interval(pseudo_values(np.nanmean(pairs, axis=1))))


def effect_size(x: Floats, y: Floats, within_x: float | None = None, within_y: float | None = None) -> float:
    """Return the effect size H of two samples; NaN if all values of both are equal.

    Args:
        x, y: the samples, (n, columns) each, n at least 2.
        within_x, within_y: ``mean_distance`` of each sample alone, if it is known already.
    """
    across = mean_distance(x, y)
    within_x = mean_distance(x) if within_x is None else within_x
    within_y = mean_distance(y) if within_y is None else within_y
    return (2 * across - within_x - within_y) / (2 * across) if across > 0 else math.nan


def _thinned(values: Floats) -> Floats:
    """Return at most ``MOST`` of the values (rows), evenly spaced."""
    if len(values) <= MOST:
        return values
    return np.asarray(values[np.linspace(0, len(values) - 1, MOST).astype(int)])
