"""Cosine similarity of histograms, never alone: between its null and its ceiling, at equal sample counts.

| name | symbol | equation |
|---|---|---|
| similarity | S | a . b / (abs(a) abs(b)) of two flattened histograms |
| collision probability | C | sum c (c - 1) / (N (N - 1)) over the bins of the real data: sum of p^2 without bias |
| ceiling | S_max | S of two samples of n1 and n2 of the real data's own distribution |
| null | S_0 | S of the real data and values spread evenly over what the histogram covers |

A histogram of n samples in many bins is noisy: sum (c/n)^2 is on average C + (1 - C) / n. So even a perfect simulation
has S_max = C / sqrt((C + (1 - C) / n1) (C + (1 - C) / n2)) < 1, and a shapeless one may come near it. Where a real
distribution is nearly even over its bins, S says next to nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.calibrate.features import histogram, shapeless
from vibroswarm.draws import Purpose, uniforms

Floats = NDArray[np.float64]

DRAWS: Final = 20
"""Subsamples that a figure at equal counts is the mean of."""
_SEED: Final = 20


@dataclass(frozen=True)
class Spread:
    """A figure over pairs of sessions."""

    mean: float
    least: float
    most: float
    pairs: int


@dataclass(frozen=True)
class Similarity:
    """How alike one feature of two sources is by the authors' measure, and what that measure can say here."""

    feature: str
    as_published: float
    """Of all values of both, pooled over sessions, however many there are."""
    count: int
    """Values of each at equal counts."""
    at_equal_counts: float
    null: float
    ceiling: float
    by_session: Spread
    """Real session against simulated session, at the smallest session's count."""
    real_by_session: Spread | None
    """Real session against real session, at the same count; None with one session."""
    session_count: int

    @property
    def share_of_way(self) -> float:
        """How far from null (0) to ceiling (1)."""
        return (self.at_equal_counts - self.null) / (self.ceiling - self.null)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        found = {name: value for name, value in self.__dict__.items() if not isinstance(value, Spread)}
        found |= {
            name: dict(value.__dict__) for name, value in self.__dict__.items() if isinstance(value, Spread)
        }
        return found | {"share_of_way": self.share_of_way}


def cosine(a: Floats, b: Floats) -> float:
    """S; nan where one of them is empty."""
    norms = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / norms if norms > 0 else math.nan


def similarity(feature: str, one: Floats, other: Floats) -> float:
    """S of two sets of values."""
    return cosine(histogram(one, feature), histogram(other, feature))


def ceiling(feature: str, real: Floats, n1: int, n2: int) -> float:
    """S_max of two samples of the real data's own distribution."""
    counts = histogram(real, feature)
    n = counts.sum()
    c = float((counts * (counts - 1)).sum() / (n * (n - 1)))
    return c / math.sqrt((c + (1 - c) / n1) * (c + (1 - c) / n2))


def subsample(values: Floats, count: int, draw: int, which: int) -> Floats:
    """So many of the values without replacement; all where there are no more. ``which`` tells data sets apart."""
    if count >= len(values):
        return values
    u = uniforms(_SEED, draw, which, Purpose.BOOTSTRAP, len(values))
    return np.asarray(values[np.argpartition(u, count - 1)[:count]])


Drawn = dict[tuple[int, int, int, int], Floats]
"""Histograms of subsamples, by the place in memory of the values, count, draw and data set."""


def at_equal_counts(
    feature: str, one: Floats, other: Floats, count: int, drawn: Drawn | None = None
) -> float:
    """S of subsamples of ``count`` values each, mean over draws.

    Args:
        drawn: what was drawn before of this feature's values, which are all still there; added to.
    """
    drawn = {} if drawn is None else drawn
    draws = 1 if count >= max(len(one), len(other)) else DRAWS

    def counts(values: Floats, draw: int, which: int) -> Floats:
        key = (id(values), count, draw, which)
        if key not in drawn:
            drawn[key] = histogram(subsample(values, count, draw, which), feature)
        return drawn[key]

    return float(np.mean([cosine(counts(one, draw, 0), counts(other, draw, 1)) for draw in range(draws)]))


def null(feature: str, real: Floats, count: int) -> float:
    """S of ``count`` real values and as many spread evenly, mean over draws."""
    found = []
    for draw in range(DRAWS):
        u = uniforms(_SEED, draw, 2, Purpose.BOOTSTRAP, 2 * count).reshape(count, 2)
        found.append(similarity(feature, subsample(real, count, draw, 0), shapeless(feature, u)))
    return float(np.mean(found))


def compare_feature(
    feature: str,
    real: Sequence[Floats],
    simulated: Sequence[Floats],
    published: tuple[Sequence[Floats], Sequence[Floats]] | None = None,
) -> Similarity | None:
    """One feature of two sources, session by session; None where one of them has too few values (under 10).

    Args:
        published: the values as the authors would have had them, where those differ.
    """
    least = min(len(one) for one in (*real, *simulated))
    if least < 10:
        return None
    all_real, all_simulated = np.concatenate(real), np.concatenate(simulated)
    count = min(len(all_real), len(all_simulated))
    drawn: Drawn = {}
    across = [at_equal_counts(feature, a, b, least, drawn) for a, b in product(real, simulated)]
    within = [at_equal_counts(feature, a, b, least, drawn) for a, b in combinations(real, 2)]
    return Similarity(
        feature=feature,
        as_published=similarity(feature, *(np.concatenate(one) for one in published or (real, simulated))),
        count=count,
        at_equal_counts=at_equal_counts(feature, all_real, all_simulated, count),
        null=null(feature, all_real, count),
        ceiling=ceiling(feature, all_real, count, count),
        by_session=_spread(across),
        real_by_session=_spread(within) if within else None,
        session_count=least,
    )


def _spread(found: Sequence[float]) -> Spread:
    return Spread(float(np.mean(found)), min(found), max(found), len(found))
