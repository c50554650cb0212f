"""Cosine similarity of histograms, with its null and its ceiling at equal sample counts; and energy distance.

| name | symbol | equation |
|---|---|---|
| similarity | S | a . b / (abs(a) abs(b)) of two flattened histograms |
| collision probability | C | sum c (c - 1) / (N (N - 1)) over the bins of the real data: sum of p^2 without bias |
| ceiling | S_max | S of two samples of n1 and n2 from the real data's own distribution |
| null | S_0 | S of the real data and values spread uniformly over the histogram's range |

A histogram of n samples in many bins is noisy: sum (c/n)^2 is on average C + (1 - C) / n. So even a perfect
simulation
has S_max = C / sqrt((C + (1 - C) / n1) (C + (1 - C) / n2)) < 1, and a shapeless one may come close to it. Where a
real
distribution is nearly uniform over its bins, S says almost nothing.

Energy distance of a feature is 0 only where two distributions are the same:

| name | symbol | equation |
|---|---|---|
| squared distance | D^2 | 2 E abs(X - Y) - E abs(X - X') - E abs(Y - Y'), pairs within a sample without self-pairs |
| effect size | H | D^2 / (2 E abs(X - Y)): 0 equal, 1 fully separated |

("Energy" is the statistician's term here, not that of vibration.) Without self-pairs D^2 is unbiased: for equal
distributions it is 0 on average, whatever the counts, and may be slightly negative. Each column is divided by its
standard deviation over the real sessions, so that seconds and metres weigh alike. The session is the unit: H is
the mean
over pairs of sessions, and its interval is over real sessions (t, so wide with three of them).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations, product
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.calibrate.features import histogram, shapeless
from vibroswarm.core.distances import sum_of_distances
from vibroswarm.core.notebook_view import NotebookView, html_view
from vibroswarm.core.rng import Purpose, uniforms

Floats = NDArray[np.float64]

DRAWS: Final = 20
"""Subsamples behind each similarity at equal counts."""
_SEED: Final = 20


@dataclass(frozen=True)
class Spread(NotebookView):
    """Mean and range over pairs of sessions."""

    mean: float
    least: float
    most: float
    pairs: int


@dataclass(frozen=True)
class Similarity(NotebookView):
    """Similarity of one feature of two sources by the authors' measure, with null and ceiling."""

    feature: str
    as_published: float
    """All values of both, pooled over sessions, whatever their number."""
    count: int
    """Number of values of each at equal counts."""
    at_equal_counts: float
    null: float
    ceiling: float
    by_session: Spread
    """Real against simulated sessions, at the smallest session's count."""
    real_by_session: Spread | None
    """Real against real sessions, at the same count; None with one session."""
    session_count: int

    @property
    def share_of_way(self) -> float:
        """Position between null (0) and ceiling (1)."""
        return (self.at_equal_counts - self.null) / (self.ceiling - self.null)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self) | {"share_of_way": self.share_of_way}


def cosine(a: Floats, b: Floats) -> float:
    """Return the cosine similarity S; nan if one histogram is empty."""
    norms = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / norms if norms > 0 else math.nan  # Eq. 25


def similarity(feature: str, one: Floats, other: Floats) -> float:
    """Return the cosine similarity S of the histograms of two sets of values; NaN if one has none within its range."""
    return cosine(histogram(one, feature), histogram(other, feature))


def ceiling(feature: str, real: Floats, n1: int, n2: int) -> float:
    """Return S_max of two samples from the real data's own distribution."""
    counts = histogram(real, feature)
    n = counts.sum()
    c = float((counts * (counts - 1)).sum() / (n * (n - 1)))
    return c / math.sqrt((c + (1 - c) / n1) * (c + (1 - c) / n2))


def subsample(values: Floats, count: int, draw: int, which: int) -> Floats:
    """Draw ``count`` of the values without replacement, or all if there are no more; ``which`` names the data set."""
    if count >= len(values):
        return values
    u = uniforms(_SEED, draw, which, Purpose.BOOTSTRAP, len(values))
    return np.asarray(values[np.argpartition(u, count - 1)[:count]])


Drawn = dict[tuple[int, int, int, int], Floats]
"""Histograms of subsamples, by id of the values, count, draw and data set."""


def at_equal_counts(
    feature: str, one: Floats, other: Floats, count: int, drawn: Drawn | None = None
) -> float:
    """Return S of subsamples of ``count`` values each, mean over draws.

    Args:
        drawn: earlier histograms of this feature's values, which must still exist; extended.
    """
    drawn = {} if drawn is None else drawn
    draws = 1 if count >= max(len(one), len(other)) else DRAWS

    def counts(values: Floats, draw: int, which: int) -> Floats:
        key = (id(values), count, draw, which)
        if key not in drawn:
            drawn[key] = histogram(subsample(values, count, draw, which), feature)
        return drawn[key]

    return float(np.mean([cosine(counts(one, draw, 0), counts(other, draw, 1)) for draw in range(draws)]))


def null_similarity(feature: str, real: Floats, count: int) -> float:
    """Return S of ``count`` real values and as many spread uniformly, mean over draws."""
    similarities = []
    for draw in range(DRAWS):
        u = uniforms(_SEED, draw, 2, Purpose.BOOTSTRAP, 2 * count).reshape(count, 2)
        similarities.append(similarity(feature, subsample(real, count, draw, 0), shapeless(feature, u)))
    return float(np.mean(similarities))


def compare_feature(
    feature: str,
    real: Sequence[Floats],
    simulated: Sequence[Floats],
    published: tuple[Sequence[Floats], Sequence[Floats]] | None = None,
) -> Similarity | None:
    """Compare one feature of two sources, session by session; None if a session has fewer than 10 values.

    Args:
        published: the values as the authors computed them, if different.
    """
    least = min(len(sessions) for sessions in (*real, *simulated))
    if least < 10:
        return None
    all_real, all_simulated = np.concatenate(real), np.concatenate(simulated)
    count = min(len(all_real), len(all_simulated))
    drawn: Drawn = {}
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
    return Spread(float(np.mean(found)), min(found), max(found), len(found))


MOST: Final = 4000
"""Most values of a session that are used, evenly thinned: 16 million pairs."""


@dataclass(frozen=True)
class EnergyDistance(NotebookView):
    """Effect size of a feature, real against simulated and real against real."""

    feature: str
    effect: Interval
    """H, mean over pairs, interval over real sessions."""
    real: Interval | None
    """The same for each real session against the other real ones; None with one session."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""

        def plain(one: Interval | None) -> dict[str, float] | None:
            if one is None:
                return None
            return {
                name: getattr(one, name)
                for name in ("estimate", "low", "high")
                if math.isfinite(getattr(one, name))
            }

        return {"feature": self.feature, "effect": plain(self.effect), "real": plain(self.real)}


def mean_distance(one: Floats, other: Floats | None = None) -> float:
    """Return E abs(X - Y); within one sample without self-pairs."""
    if one.shape[1] == 1:
        return _mean_along_a_line(one[:, 0], None if other is None else other[:, 0])
    columns = one if other is None else other
    pairs = len(one) * (len(columns) - (other is None))
    return sum_of_distances(np.ascontiguousarray(one), np.ascontiguousarray(columns.T)) / pairs


def _mean_along_a_line(one: Floats, other: Floats | None) -> float:
    """Return ``mean_distance`` of single numbers, (values,) each, from their ranks instead of all pairs."""
    others = np.sort(one if other is None else other)
    below = np.searchsorted(others, one)
    sums = np.append(0.0, np.cumsum(others))
    n = others.size
    total = float((one * (2 * below - n) + sums[n] - 2.0 * sums[below]).sum())
    return total / (one.size * (n - (other is None)))


class RealDistances(NamedTuple):
    """Distances among the real sessions alone."""

    each: tuple[float, ...]
    """Mean distance within each session."""
    against: Interval | None
    """Effect size of each against the others; None with one session."""

    def _repr_html_(self) -> str:
        return html_view(self)


RealCache = dict[str, RealDistances]
"""By feature."""


def compare_distance(
    feature: str,
    real: Sequence[Floats],
    simulated: Sequence[Floats],
    level: float = 0.95,
    known: RealCache | None = None,
) -> EnergyDistance | None:
    """Return the energy distance of one feature of two sources, session by session; None if a session has fewer than 10
    values.

    Args:
        known: earlier results for the same real sessions at the same level; extended.
    """
    if min(len(session) for session in (*real, *simulated)) < 10:
        return None
    scale = np.concatenate(real).std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    a, b = ([_thinned(session) / scale for session in sessions] for sessions in (real, simulated))
    known = {} if known is None else known
    if feature not in known:
        known[feature] = _inside(a, level)
    inside = known[feature]
    inside_b = [mean_distance(session) for session in b]
    against = [
        float(np.mean([effect_size(x, y, of_x, of_y) for y, of_y in zip(b, inside_b, strict=True)]))
        for x, of_x in zip(a, inside.each, strict=True)
    ]
    return EnergyDistance(feature, mean_interval(against, level), inside.against)


def _inside(sessions: Sequence[Floats], level: float) -> RealDistances:
    """Return the distances within and between the real sessions."""
    within = tuple(mean_distance(session) for session in sessions)
    if len(sessions) < 2:
        return RealDistances(within, None)
    pairs = np.full((len(sessions), len(sessions)), np.nan)
    for i in range(len(sessions)):
        for j in range(i):
            pairs[i, j] = pairs[j, i] = effect_size(sessions[i], sessions[j], within[i], within[j])
    return RealDistances(within, mean_interval(np.nanmean(pairs, axis=1).tolist(), level))


def effect_size(x: Floats, y: Floats, within_x: float | None = None, within_y: float | None = None) -> float:
    """Return the effect size H of two samples, (n, columns) each with n of at least 2; nan where all values are equal.

    Args:
        within_x, within_y: mean distance within each, where it is known already.
    """
    across = mean_distance(x, y)
    within_x = mean_distance(x) if within_x is None else within_x
    within_y = mean_distance(y) if within_y is None else within_y
    return (2 * across - within_x - within_y) / (2 * across) if across > 0 else math.nan


def _thinned(values: Floats) -> Floats:
    if len(values) <= MOST:
        return values
    return np.asarray(values[np.linspace(0, len(values) - 1, MOST).astype(int)])
