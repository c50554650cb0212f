"""Compare real with simulated samples, feature by feature: the paper's cosine similarity, and energy distances.

| name | symbol | equation |
|---|---|---|
| similarity | S | a b / sqrt(a a b b) of two histograms of the same number of values |
| null | S_0 | S of real values and as many values spread uniformly over the feature's range |
| ceiling | S_max | S expected of two samples of one distribution: C / sqrt((C + (1 - C) / n1) (C + (1 - C) / n2)) |
| chance of one bin | C | that two real values fall into the same bin |
| energy distance | H | (2 E abs(X - Y) - E abs(X - X') - E abs(Y - Y')) / (2 E abs(X - Y)): 0 if X and Y are distributed alike, 1 without overlap |

Each run is a session. Energy distances are means over pairs of sessions, of columns divided by their standard deviation
over all real values.
"""  # noqa: E501

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import stdtrit

from vibroswarm.core.arrays import Floats
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.errors import InputError, check_kind
from vibroswarm.lab.calibrate.camera import RIGHT, Camera, seen_through
from vibroswarm.lab.calibrate.classifier import recognised
from vibroswarm.lab.calibrate.features import FEATURES, histogram, shapeless, values_of
from vibroswarm.lab.calibrate.samples import as_published, by_session
from vibroswarm.lab.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.statistics.intervals import Interval, mean_interval, pseudo_values

DRAWS: Final = 20
"""Subsamples behind each similarity at equal counts."""
FEWEST: Final = 10
"""Values of a session below which a feature is not compared."""
MOST: Final = 4000
"""Longer sessions are thinned evenly to this number of values, which limits the pairs to 16 million."""
_SEED: Final = 20
_FIRST, _SECOND, _UNIFORM = range(3)
"""Numbers of the data sets that random numbers are drawn for."""


@dataclass(frozen=True)
class Likeness:
    """How alike one feature of real and simulated sessions is."""

    feature: str
    as_published: float
    """S of all real and all simulated values, pooled over sessions, whatever their numbers."""
    count: int
    """Number of values drawn from each source for the other similarities: that of the smaller source."""
    at_equal_counts: float
    """S of ``count`` values from each source, mean over draws."""
    null: float
    ceiling: float
    distance: Interval
    """H of real against simulated sessions, interval over sessions of both kinds."""
    real_distance: Interval | None
    """H of real sessions against each other; None with one session."""


@dataclass(frozen=True)
class Comparison:
    """Result of ``compare``."""

    likenesses: tuple[Likeness, ...]
    """Of each feature of which all sessions have enough values."""
    recognised: Interval | None
    """Share of stretches that a classifier recognises as real or simulated; None if it has too little to learn from."""
    camera: Camera = RIGHT
    """The camera through which the simulated positions were seen; ``RIGHT`` is an exact camera."""


def camera_between(real: Result, simulated: Result) -> Camera:
    """Return the camera through which simulated positions are seen for a comparison with recordings.

    It is the camera that was fitted together with the simulation's scenario; an exact one (``RIGHT``) if positions need
    no change: if ``real`` is a simulation, if ``simulated`` is a recording, or if the recording's positions are
    corrected already, as those from the command ``lab track`` are.
    """
    if not isinstance(real, Recording) or isinstance(simulated, Recording) or real.places_corrected:
        return RIGHT
    return Camera.of(simulated.scenario)


def compare(real: Result, simulated: Result, *, camera: Camera | None = None) -> Comparison:
    """Compare the samples of two results; each run is a session.

    Args:
        real: recordings, or a simulation in their place.
        simulated: a simulation (or recordings) of the same floor and settings.
        camera: the camera through which simulated positions are seen; by default ``camera_between``.
    Raises:
        InputError: no energies, or too few samples to compare anything; or scikit-learn is not installed.
    """
    for words, result in (("the recording", real), ("the simulation", simulated)):
        check_kind(result, Result, words, "a Result or a Recording")
    camera = camera_between(real, simulated) if camera is None else camera
    sessions = by_session(real), by_session(seen_through(simulated, camera))
    published = as_published(real), as_published(seen_through(simulated, camera))
    values = {name: [[values_of(one, name) for one in part] for part in sessions] for name in FEATURES}
    likenesses = tuple(
        compare_feature(name, real_values, simulated_values, tuple(values_of(one, name) for one in published))
        for name, (real_values, simulated_values) in values.items()
        if min(map(len, (*real_values, *simulated_values)), default=0) >= FEWEST
    )
    if not likenesses:
        raise InputError(
            f"a session has fewer than {FEWEST} values of each feature; give longer sessions",
            field="sessions",
        )
    return Comparison(likenesses, recognised(*sessions), camera)


def compare_feature(
    feature: str,
    real: Sequence[Floats],
    simulated: Sequence[Floats],
    published: tuple[Floats, ...] = (),
) -> Likeness:
    """Compare one feature of real and simulated sessions, each with at least ``FEWEST`` values, (n, columns).

    Args:
        published: all real and all simulated values as the authors computed them, if they are others.
    """
    all_real, all_simulated = np.concatenate(real), np.concatenate(simulated)
    count = min(len(all_real), len(all_simulated))
    scale = all_real.std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    scaled = ([_thinned(one) / scale for one in sessions] for sessions in (real, simulated))
    distance, real_distance = distances(*scaled)
    return Likeness(
        feature=feature,
        as_published=similarity(feature, *(published or (all_real, all_simulated))),
        count=count,
        at_equal_counts=at_equal_counts(feature, all_real, all_simulated, count),
        null=null_similarity(feature, all_real, count),
        ceiling=ceiling(feature, all_real, count, count),
        distance=distance,
        real_distance=real_distance,
    )


def cosine(a: Floats, b: Floats) -> float:
    """Return the cosine similarity S of two flattened histograms; NaN if one of them has no counts."""
    norms = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / norms if norms > 0 else math.nan  # Eq. 25 of the paper


def similarity(feature: str, one: Floats, other: Floats) -> float:
    """Return the cosine similarity S of the histograms of two sets of values; NaN if one has none within its range."""
    return cosine(histogram(one, feature), histogram(other, feature))


def ceiling(feature: str, real: Floats, n1: int, n2: int) -> float:
    """Return the ceiling S_max for ``n1`` and ``n2`` values, with C estimated from the real values of a feature."""
    counts = histogram(real, feature)
    n = counts.sum()
    c = float((counts * (counts - 1)).sum() / (n * (n - 1)))
    return c / math.sqrt((c + (1 - c) / n1) * (c + (1 - c) / n2))


def subsample(values: Floats, count: int, draw: int, which: int) -> Floats:
    """Draw ``count`` of the values (rows) without replacement; return all if there are no more.

    Args:
        values: the values, (n, columns). draw: number of the draw. which: number of the data set.
    """
    if count >= len(values):
        return values
    # ``draw`` and ``which`` take the places of a run and a robot in the address of random numbers.
    u = uniforms(_SEED, run=draw, robot=which, purpose=Purpose.BOOTSTRAP, count=len(values))
    return np.asarray(values[np.argpartition(u, count - 1)[:count]])  # the rows with the smallest numbers


def at_equal_counts(feature: str, one: Floats, other: Floats, count: int) -> float:
    """Return the similarity S of two sets of values, with ``count`` values drawn from each; the mean over draws."""
    draws = 1 if count >= max(len(one), len(other)) else DRAWS  # if all values are used, all draws are equal
    drawn = (
        (subsample(one, count, draw, _FIRST), subsample(other, count, draw, _SECOND)) for draw in range(draws)
    )
    return float(np.mean([similarity(feature, *pair) for pair in drawn]))


def null_similarity(feature: str, real: Floats, count: int) -> float:
    """Return the null S_0: S of ``count`` real values and ``count`` values without structure, mean over draws."""
    similarities = []
    for draw in range(DRAWS):
        u = uniforms(_SEED, run=draw, robot=_UNIFORM, purpose=Purpose.BOOTSTRAP, count=2 * count)
        structureless = shapeless(feature, u.reshape(count, 2))
        similarities.append(similarity(feature, subsample(real, count, draw, _FIRST), structureless))
    return float(np.mean(similarities))


def distances(real: Sequence[Floats], simulated: Sequence[Floats]) -> tuple[Interval, Interval | None]:
    """Return the energy distances between real and simulated sessions, and among real ones, (n, columns) each.

    All real sessions are compared with the same simulated ones. So the variance of the mean is the sum of two: that
    of the means of real sessions and that of the means of simulated ones, each divided by the number of sessions. The
    smaller number gives the degrees of freedom. With one simulated session the limits are for that one.
    """
    within = {id(one): mean_distance(one) for one in (*real, *simulated)}

    def effect(x: Floats, y: Floats) -> float:
        across = mean_distance(x, y)
        return (2 * across - within[id(x)] - within[id(y)]) / (2 * across) if across > 0 else math.nan

    effects = np.array([[effect(x, y) for y in simulated] for x in real])
    of_real, of_simulated = effects.mean(axis=1), effects.mean(axis=0)
    found, fewest = mean_interval(of_real), min(effects.shape)
    if fewest > 1 and np.isfinite(effects).all():
        error = math.sqrt(of_real.var(ddof=1) / of_real.size + of_simulated.var(ddof=1) / of_simulated.size)
        half = float(stdtrit(fewest - 1, 0.5 + found.level / 2)) * error
        found = found._replace(low=found.estimate - half, high=found.estimate + half, n=fewest)
    if len(real) < 2:
        return found, None
    pairs = np.full((len(real), len(real)), np.nan)  # NaN: a session is not compared with itself
    for i, j in combinations(range(len(real)), 2):
        pairs[i, j] = pairs[j, i] = effect(real[i], real[j])
    return found, mean_interval(pseudo_values(np.nanmean(pairs, axis=1)))


def mean_distance(one: Floats, other: Floats | None = None) -> float:
    """Return E abs(X - Y), the mean distance between the rows of two samples, (n, columns) each.

    Without ``other``, return E abs(X - X'), the mean over the pairs of different rows of one sample, n at least 2.
    """
    others = one if other is None else other
    pairs = len(one) * (len(others) - (other is None))  # without ``other``, a row is not paired with itself
    parts = np.array_split(one, len(one) // 1000 + 1)  # all distances at once would fill the memory
    return float(sum(cdist(part, others).sum() for part in parts)) / pairs


def _thinned(values: Floats) -> Floats:
    if len(values) <= MOST:
        return values
    return np.asarray(values[np.linspace(0, len(values) - 1, MOST).astype(int)])
