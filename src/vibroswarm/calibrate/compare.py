"""Compare real with simulated samples: the paper's cosine similarity, energy distances, and a classifier.

| name | symbol | equation |
|---|---|---|
| similarity | S | a b / sqrt(a a b b) of two histograms of the same number of values |
| null | S_0 | S of real values and as many values spread uniformly over the feature's range |
| ceiling | S_max | S expected of two samples of one distribution: C / sqrt((C + (1 - C) / n1) (C + (1 - C) / n2)) |
| chance of one bin | C | that two real values fall into the same bin |
| energy distance | H | (2 E abs(X - Y) - E abs(X - X') - E abs(Y - Y')) / (2 E abs(X - Y)): 0 if X and Y are distributed alike, 1 without overlap |

Each run is a session. Energy distances are means over pairs of sessions, of columns divided by their standard deviation
over all real values. The classifier (scikit-learn's logistic regression, extra ``lab``) recognises stretches of
consecutive samples of one robot. It is tested on other robots and other sessions than it was trained on, so it cannot
recognise a robot by its speed or a session by its battery.
"""  # noqa: E501

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
import polars as pl
from scipy.spatial.distance import cdist
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from vibroswarm.calibrate.camera import RIGHT, Camera, seen_through
from vibroswarm.calibrate.samples import (
    FEATURES,
    ROUNDING_S,
    as_published,
    by_session,
    histogram,
    shapeless,
    values_of,
)
from vibroswarm.core.arrays import Floats, wrapped
from vibroswarm.core.optional_library import needed
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.statistics.intervals import Interval, bounded_mean, mean_interval, pseudo_values

DRAWS: Final = 20
"""Subsamples behind each similarity at equal counts."""
FEWEST: Final = 10
"""Values of a session below which a feature is not compared."""
STRETCH: Final = 20
"""Samples of a stretch, about a minute."""
_SEED: Final = 20
_FIRST, _SECOND, _UNIFORM = range(3)
"""Numbers of the data sets that random numbers are drawn for."""


@dataclass(frozen=True)
class Likeness:
    """How alike one feature of real and simulated sessions is."""

    feature: str
    as_published: float
    """S of all real and all simulated values, pooled over sessions, whatever their numbers."""
    at_equal_counts: float
    """S of as many values from each source as the smaller one has, mean over draws; so are null and ceiling."""
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


def compare(real: Result, simulated: Result) -> Comparison:
    """Compare the samples of two results; each run is a session.

    Args:
        real: recordings, or a simulation in their place.
        simulated: a simulation (or recordings) of the same floor and settings.
    Raises:
        InputError: no energies, or too few samples to compare anything; or scikit-learn is not installed.
    """
    camera = camera_between(real, simulated)
    both = real, seen_through(simulated, camera)
    sessions, published = [by_session(one) for one in both], [as_published(one) for one in both]
    values = {name: [[values_of(one, name) for one in part] for part in sessions] for name in FEATURES}
    likenesses = tuple(
        compare_feature(name, theirs, ours, tuple(values_of(one, name) for one in published))
        for name, (theirs, ours) in values.items()
        if min(map(len, (*theirs, *ours)), default=0) >= FEWEST
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

    ``published`` are all real and all simulated values as the authors computed them, if they are others.
    """
    all_real, all_simulated = np.concatenate(real), np.concatenate(simulated)
    count = min(len(all_real), len(all_simulated))
    scale = all_real.std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    scaled = ([_thinned(one) / scale for one in sessions] for sessions in (real, simulated))
    return Likeness(
        feature,
        similarity(feature, *(published or (all_real, all_simulated))),
        at_equal_counts(feature, all_real, all_simulated, count),
        null_similarity(feature, all_real, count),
        ceiling(feature, all_real, count, count),
        *distances(*scaled),
    )


def similarity(feature: str, one: Floats, other: Floats) -> float:
    """Return the cosine similarity S of the histograms of two sets of values; NaN if one has none within its range."""
    a, b = histogram(one, feature), histogram(other, feature)
    norms = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / norms if norms > 0 else math.nan  # Eq. 25 of the paper


def ceiling(feature: str, real: Floats, n1: int, n2: int) -> float:
    """Return the ceiling S_max for ``n1`` and ``n2`` values, with C estimated from the real values of a feature."""
    counts = histogram(real, feature)
    n = counts.sum()
    c = float((counts * (counts - 1)).sum() / (n * (n - 1)))
    return c / math.sqrt((c + (1 - c) / n1) * (c + (1 - c) / n2))


def subsample(values: Floats, count: int, draw: int, which: int) -> Floats:
    """Draw ``count`` of the rows without replacement, or all if there are no more; ``which`` is the data set."""
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
    """Return E abs(X - Y), the mean distance between the rows of two samples; of one, between its different rows."""
    others = one if other is None else other
    pairs = len(one) * (len(others) - (other is None))  # without ``other``, a row is not paired with itself
    parts = np.array_split(one, len(one) // 1000 + 1)  # all distances at once would fill the memory
    return float(sum(cdist(part, others).sum() for part in parts)) / pairs


def _thinned(values: Floats) -> Floats:
    """Return at most 4000 rows, evenly spaced, which limits the pairs to 16 million."""
    return np.asarray(values[np.linspace(0, len(values) - 1, min(len(values), 4000)).astype(int)])


def recognised(real: Sequence[pl.DataFrame], simulated: Sequence[pl.DataFrame]) -> Interval | None:
    """Return the balanced accuracy of a classifier of real and simulated sessions, with its interval over real ones.

    Real session i is tested against simulated session i, robot by robot, by classifiers trained on the other robots in
    the other sessions; simulated sessions are used again from the first if there are fewer of them. A session that is
    the only one of its kind is used for the training too. None with fewer than two robots that have a stretch in each
    session; chance is 0.5.

    The classifiers of n held-out sessions share most of their training, so that accuracies vary together. The variance
    of their mean is taken as s^2 (1 / n + 1 / (n - 1)), s their standard deviation: 1 session is tested, n - 1 are
    trained on (Nadeau and Bengio 2003).
    """
    rows: list[tuple[int, int, int, Floats]] = []
    for is_simulated, sessions in enumerate((real, simulated)):
        for session, samples in enumerate(sessions):
            for (robot,), own in samples.group_by("robot", maintain_order=True):
                rows += [(is_simulated, session, int(robot), stretch) for stretch in columns_of(own)]
    in_sessions = Counter(row[2] for row in {row[:3] for row in rows})
    robots = sorted(own for own, count in in_sessions.items() if count == len(real) + len(simulated))
    if len(robots) < 2:
        return None
    with threadpool_limits(1):  # threads cost more than they save with so few rows
        accuracies = [
            np.mean([_held_out(rows, (k, k % len(simulated)), robot, robots) for robot in robots])
            for k in range(len(real))
        ]
    n, mean = len(real), np.mean(accuracies)
    return bounded_mean(mean + math.sqrt(1.0 + n / max(n - 1, 1)) * (accuracies - mean))


def columns_of(samples: pl.DataFrame) -> Floats:
    """Return the features of the whole stretches of a robot in a session, (stretches, columns).

    A single sample says little; a stretch shows that a robot keeps its speed, veers, or reads similar energies twice
    in a row. Energies, times and distances from the wall have skewed distributions, so their logarithms are used, of
    values that are raised to a smallest value far below the usual ones.
    """
    stepped = samples.drop_nulls(["dx_m", "avoid_s"])
    course = np.arctan2(stepped["dy_m"].to_numpy(), stepped["dx_m"].to_numpy())
    columns = {name: stepped[name].to_numpy().astype(float) for name in ("vibrating", "avoid_s")} | {
        "energy": np.log(np.maximum(stepped["energy"].to_numpy(), 0.05)),
        "distance": stepped["distance_m"].to_numpy() / 0.1,  # in units of about the usual distance
        "spacing": np.log(np.maximum(stepped["spacing_s"].to_numpy(), 0.1)),
        "wall": np.log(np.maximum(stepped["wall_m"].to_numpy(), 0.005)),
        "turned": np.append(np.zeros(min(course.size, 1)), wrapped(np.diff(course))),
    }
    rows = []
    for first in range(0, stepped.height - STRETCH + 1, STRETCH):
        one = {name: column[first : first + STRETCH] for name, column in columns.items()}
        on, turned = one["vibrating"] == 1, one["turned"]
        avoided = np.log1p(np.maximum(one["avoid_s"], 0.0))  # often 0, so 1 s is added
        energies = (one["energy"][on], one["energy"][~on])
        spread = (*energies, one["distance"], one["spacing"], avoided, one["wall"], turned)
        rows.append(
            [
                *(part.mean() if part.size else 0.0 for part in spread),
                *(part.std() if part.size else 0.0 for part in spread),
                *(np.median(part) for part in (one["distance"], turned, np.abs(turned))),
                (one["avoid_s"] > ROUNDING_S).mean(),
                on.mean(),
                _lag_one(one["energy"]),
                _lag_one(one["distance"]),
            ]
        )
    return np.array(rows)


def _lag_one(values: Floats) -> float:
    """Return the correlation of successive values; 0 if all are equal."""
    deviation = values - values.mean()
    variance = float((deviation**2).mean())
    return float((deviation[1:] * deviation[:-1]).mean()) / variance if variance > 0 else 0.0


def _held_out(
    rows: Sequence[tuple[int, int, int, Floats]], sessions: tuple[int, int], robot: int, robots: Sequence[int]
) -> float:
    """Return the accuracy on a robot in two sessions, the real and the simulated one, of training on the others.

    ``rows`` have whether a stretch is simulated, its session and robot, and its features.
    """
    linear, metrics, pipeline, preprocessing = (
        needed(f"sklearn.{name}", "lab", "calibrate")
        for name in ("linear_model", "metrics", "pipeline", "preprocessing")
    )
    is_simulated, session, number = np.array([row[:3] for row in rows]).T
    features = np.array([row[3] for row in rows])
    tested = session == np.array(sessions)[is_simulated]
    is_only = np.array([session[is_simulated == kind].max() == 0 for kind in (0, 1)])[is_simulated]
    train = (~tested | is_only) & np.isin(number, [one for one in robots if one != robot])
    # Its penalty is |w|^2 / (2 C): a prior of standard deviation 0.6 on the weights of standardised columns.
    regression = linear.LogisticRegression(C=1.0 / 3.0, class_weight="balanced", max_iter=1000)
    classifier: Any = pipeline.make_pipeline(preprocessing.StandardScaler(), regression)
    classifier.fit(features[train], is_simulated[train])
    test = tested & (number == robot)
    return float(metrics.balanced_accuracy_score(is_simulated[test], classifier.predict(features[test])))
