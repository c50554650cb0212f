"""Energy distance of a feature: a measure that is 0 only where two distributions are the same.

| name | symbol | equation |
|---|---|---|
| squared distance | D^2 | 2 E abs(X - Y) - E abs(X - X') - E abs(Y - Y'), pairs of one sample without themselves |
| effect size | H | D^2 / (2 E abs(X - Y)): 0 alike, 1 apart as far as can be |

(The "energy" of the name is that of statistics, not of vibration.) Without a value's pair with itself D^2 is unbiased: for equal
distributions it is 0 on average, whatever the counts, and may be slightly negative. Each column is divided by its standard
deviation over the real sessions, so that seconds and metres weigh alike. The session is the unit: H is the mean over
pairs of sessions, and its interval is over real sessions (t, so with three of them wide).
"""  # noqa: E501

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.distances import sum_of_distances

Floats = NDArray[np.float64]
MOST: Final = 4000
"""Values of a session that are taken, evenly spread over it: 16 million pairs."""


@dataclass(frozen=True)
class EnergyDistance:
    """Effect size of a feature, real against simulated, and real against real."""

    feature: str
    effect: Interval
    """H, mean over pairs, interval over real sessions."""
    real: Interval | None
    """The same of each real session against the other real ones; None with one session."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""

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
    """E abs(X - Y); of one sample: without each value's pair with itself."""
    if one.shape[1] == 1:
        return _mean_along_a_line(one[:, 0], None if other is None else other[:, 0])
    columns = one if other is None else other
    pairs = len(one) * (len(columns) - (other is None))
    return sum_of_distances(np.ascontiguousarray(one), np.ascontiguousarray(columns.T)) / pairs


def _mean_along_a_line(one: Floats, other: Floats | None) -> float:
    """``mean_distance`` of single numbers: in their order, each is above so many others and below the rest."""
    others = np.sort(one if other is None else other)
    below = np.searchsorted(others, one)
    sums = np.append(0.0, np.cumsum(others))
    n = others.size
    total = float((one * (2 * below - n) + sums[n] - 2.0 * sums[below]).sum())
    return total / (one.size * (n - (other is None)))


class Inside(NamedTuple):
    """What a comparison finds of the real sessions alone."""

    each: tuple[float, ...]
    """Mean distance within each."""
    against: Interval | None
    """Effect size of each against the others; None of one."""


Known = dict[str, Inside]
"""By feature."""


def effect_size(one: Floats, other: Floats) -> float:
    """H of two samples, each (n, columns) with n of at least 2; nan where all values are equal."""
    across = mean_distance(one, other)
    if across == 0.0:
        return math.nan
    return (2 * across - mean_distance(one) - mean_distance(other)) / (2 * across)


def compare_distance(
    feature: str,
    real: Sequence[Floats],
    simulated: Sequence[Floats],
    level: float = 0.95,
    known: Known | None = None,
) -> EnergyDistance | None:
    """One feature of two sources, session by session; None where a session has fewer than 10 values.

    Args:
        known: what was found of the same real sessions before, at the same level; added to.
    """
    if min(len(one) for one in (*real, *simulated)) < 10:
        return None
    scale = np.concatenate(real).std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    a, b = ([_thinned(one) / scale for one in each] for each in (real, simulated))
    known = {} if known is None else known
    if feature not in known:
        known[feature] = _inside(a, level)
    inside = known[feature]
    inside_b = [mean_distance(one) for one in b]
    against = [
        float(np.mean([_effect(x, y, of_x, of_y) for y, of_y in zip(b, inside_b, strict=True)]))
        for x, of_x in zip(a, inside.each, strict=True)
    ]
    return EnergyDistance(feature, mean_interval(against, level), inside.against)


def _inside(sessions: Sequence[Floats], level: float) -> Inside:
    each = tuple(mean_distance(one) for one in sessions)
    if len(sessions) < 2:
        return Inside(each, None)
    pairs = np.full((len(sessions), len(sessions)), np.nan)
    for i in range(len(sessions)):
        for j in range(i):
            pairs[i, j] = pairs[j, i] = _effect(sessions[i], sessions[j], each[i], each[j])
    return Inside(each, mean_interval(np.nanmean(pairs, axis=1).tolist(), level))


def _effect(x: Floats, y: Floats, of_x: float, of_y: float) -> float:
    across = mean_distance(x, y)
    return (2 * across - of_x - of_y) / (2 * across) if across > 0 else math.nan


def _thinned(values: Floats) -> Floats:
    if len(values) <= MOST:
        return values
    return np.asarray(values[np.linspace(0, len(values) - 1, MOST).astype(int)])
