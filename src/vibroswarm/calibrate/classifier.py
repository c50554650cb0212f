"""Train a classifier to distinguish real robots' samples from simulated ones, and test it on other robots and sessions.

A session is one run. A stretch is ``STRETCH`` consecutive samples of one robot in one session, about a minute. The
classifier is a logistic regression, with a ridge and classes of equal weight, on standardised features of a stretch:
mean and standard deviation of energies by kind of tile, distances, times, avoidance, positions, turns from step to
step, and the correlation of neighbouring samples. A single sample says little; a stretch shows that a robot keeps its
speed, veers, or reads similar energies twice in a row.

The classifier is tested on other robots and other sessions than it was trained on, so it cannot recognise a robot by
its speed or a session by its battery. The result is the balanced accuracy, the mean of the two classes' shares of
correct predictions; 0.5 is chance. The accuracy for real sessions against each other, tested on other robots, shows
how far sessions alone differ. (It is below 0.5 where the difference between two sessions has opposite sign for
different robots.)

The classifiers of n held-out sessions share most of their training, so that accuracies vary together. The variance of
their mean is taken as s^2 (1 / n + 1 / (n - 1)), s their standard deviation: 1 session is tested, n - 1 are trained on
(Nadeau and Bengio 2003).

Classifier, splits and accuracy are scikit-learn's (extra ``lab``).

All accuracies are balanced: the mean of the two classes' shares of correct predictions; 0.5 is chance.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from threadpoolctl import threadpool_limits

from vibroswarm.calibrate.features import lag_one
from vibroswarm.calibrate.similarity import over_sessions
from vibroswarm.core.angles import wrapped
from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.core.optional_library import needed
from vibroswarm.errors import InputError
from vibroswarm.statistics.intervals import (
    Interval,
    allowing_for_rare,
    bounded_mean,
    finite_limits,
    pseudo_values,
    student_test,
    within,
)
from vibroswarm.statistics.paired import differences, holm


def scikit_learn(module: str) -> Any:
    """Return a module of scikit-learn, such as "linear_model".

    Raises:
        InputError: scikit-learn is not installed.
    """
    return needed(f"sklearn.{module}", "lab", "calibrate")


def _mean_accuracy(rows: Floats, label: Ints, splits: Iterable[tuple[Ints, Ints]]) -> float:
    """Return the mean balanced accuracy over the splits, or NaN if there is none.

    A split that trains or tests a single class is left out.

    Args:
        rows: features, (rows, columns). label: class of each row, 0 or 1.
        splits: indices of the rows that are trained on, and of those that are tested.
    """
    whole = [split for split in splits if all(np.unique(label[part]).size == 2 for part in split)]
    if not whole:
        return np.nan
    # Threads cost more than they save with so few rows: fifty times as much on a busy machine.
    with threadpool_limits(1):
        shares = scikit_learn("model_selection").cross_val_score(
            stretch_classifier(), rows, label, cv=whole, scoring="balanced_accuracy", error_score="raise"
        )
    return float(np.mean(shares))


Stretches = dict[int, Floats]
"""Features of one session's stretches by robot: ``columns_of`` each, (stretches, columns)."""
Classes = tuple[Sequence[Stretches], Sequence[Stretches]]
"""Sessions of the first and of the second class."""
STRETCH: Final = 20
"""Samples of a stretch."""
RIDGE: Final = 3.0
"""Penalty on weights of standardised columns: a prior of standard deviation 0.6."""


@dataclass(frozen=True)
class ClassifierAccuracy:
    """Balanced accuracy of the classifier; intervals over sessions."""

    simulated: Interval
    """Real against simulated, tested on other robots and, if there are several, other sessions than trained on."""
    simulated_by_robot: Interval
    """Real against simulated, trained and tested on the same two sessions but on different robots, as ``real`` is."""
    real: Interval | None
    """Real sessions against each other, tested on other robots than trained on; None with one real session."""
    by_session: tuple[float, ...]
    """``simulated`` of each real session."""
    simulations: int
    """Number of simulated sessions."""

    def as_dict(self) -> dict[str, Any]:
        """Return estimate and finite limits of each interval, for JSON; None where there is no interval."""
        intervals = {name: finite_limits(getattr(self, name)) for name in INTERVALS}
        return intervals | {"by_session": list(self.by_session)}


INTERVALS: Final = ("simulated", "simulated_by_robot", "real")
"""The fields of ``ClassifierAccuracy`` that are intervals."""


FEWEST: Final = 3
"""Sessions below which no simulation is shown to be recognised less than another."""


def least_recognised(found: Sequence[ClassifierAccuracy]) -> tuple[int, list[int]]:
    """Return the place of the least recognised of several simulations, and of those not shown to be recognised more.

    Accuracies are compared session by session, with Student's test. Holm's correction is for all pairs of simulations,
    since it is the accuracies that tell which one is compared with the others.
    """
    pairs = list(combinations(range(len(found)), 2))
    p_values = holm([_p_value(found[i], found[j]) for i, j in pairs])
    least = min(range(len(found)), key=lambda k: found[k].simulated.estimate)
    alike = [
        i + j - least for (i, j), p in zip(pairs, p_values, strict=True) if least in (i, j) and not p <= 0.05
    ]
    return least, alike


def _p_value(one: ClassifierAccuracy, other: ClassifierAccuracy) -> float:
    """Return the p-value of whether two simulations are recognised equally often; nan with too few sessions.

    Real sessions that are tested against the same simulated session are not independent, and count as one.
    """
    apart = differences(one.by_session, other.by_session)
    sessions = min(apart.size, one.simulations, other.simulations)
    if sessions < FEWEST:
        return math.nan
    return student_test(_trained_together([apart[k::sessions].mean() for k in range(sessions)])).p_value


def _trained_together(by_session: Sequence[float]) -> Floats:
    """Return values of held-out sessions, further apart by what their common training takes from their variance."""
    values, n = np.asarray(by_session), len(by_session)
    return np.asarray(values.mean() + math.sqrt(1.0 + n / max(n - 1, 1)) * (values - values.mean()))


def columns_of(samples: pl.DataFrame) -> Floats:
    """Return the features of a robot's stretches, (stretches, columns); shape (0, 0) without a complete stretch.

    Samples without a previous sample or without a time spent avoiding are left out, and so is an incomplete last
    stretch. Energies, times and distances from the wall have skewed distributions, so their logarithms are used. Before
    a logarithm is taken, values are raised to a smallest value, which keeps the logarithm finite. Constant factors do
    not matter, because ``stretch_classifier`` standardises the columns.

    Args:
        samples: samples of one robot in one session, ordered by time (``features.sample_table``).
    """
    stepped = samples.filter(pl.col("dx_m").is_not_null() & pl.col("avoid_s").is_not_null())
    wall, avoid, vibrating = (
        stepped[name].to_numpy().astype(float) for name in ("wall_m", "avoid_s", "vibrating")
    )
    # The smallest values (0.05 of energy, 0.1 s, 5 mm) are far below the usual ones, so few values are raised.
    energy = np.log(np.maximum(stepped["energy"].to_numpy(), 0.05))
    distance, spacing = stepped["distance_m"].to_numpy(), stepped["spacing_s"].to_numpy()
    course = np.arctan2(stepped["dy_m"].to_numpy(), stepped["dx_m"].to_numpy())
    # Change of the course from the previous step, in [-pi, pi); 0 for the first step.
    turned = np.append(0.0, wrapped(np.diff(course)))
    rows = []
    for first in range(0, len(wall) - STRETCH + 1, STRETCH):
        k = slice(first, first + STRETCH)
        on_vibrating = vibrating[k] == 1
        rows.append(
            [
                *_mean_and_spread(energy[k][on_vibrating]),
                *_mean_and_spread(energy[k][~on_vibrating]),
                *_mean_and_spread(distance[k] / 0.1),  # in units of 0.1 m, about the usual distance
                float(np.median(distance[k])) / 0.1,
                *_mean_and_spread(np.log(np.maximum(spacing[k], 0.1))),
                float((avoid[k] > 1e-9).mean()),  # share of the samples before which the robot avoided
                # Times spent avoiding are often 0, so 1 s is added before the logarithm; negative ones count as 0.
                *_mean_and_spread(np.log1p(np.maximum(avoid[k], 0.0))),
                *_mean_and_spread(np.log(np.maximum(wall[k], 0.005))),
                *_mean_and_spread(turned[k]),
                float(np.median(turned[k])),
                float(np.median(np.abs(turned[k]))),
                lag_one(energy[k]) or 0.0,
                lag_one(distance[k]) or 0.0,
                float(on_vibrating.mean()),
            ]
        )
    return np.array(rows).reshape(len(rows), -1) if rows else np.empty((0, 0))


def _mean_and_spread(values: Floats) -> tuple[float, float]:
    """Return the mean and standard deviation; zeros without values, as in a stretch without tiles of one kind."""
    return (float(values.mean()), float(values.std())) if values.size else (0.0, 0.0)


def stretch_classifier() -> Any:
    """Return the untrained classifier of stretches: standardised columns, and a logistic regression with a ridge."""
    return scikit_learn("pipeline").make_pipeline(
        scikit_learn("preprocessing").StandardScaler(),
        # Its penalty is |w|^2 / (2 C): C is the inverse of the ridge.
        scikit_learn("linear_model").LogisticRegression(
            C=1.0 / RIDGE, class_weight="balanced", max_iter=1000
        ),
    )


def classifier_accuracy(
    real: Sequence[pl.DataFrame], simulated: Sequence[pl.DataFrame]
) -> ClassifierAccuracy:
    """Measure how well a classifier distinguishes real sessions from simulated ones, and from each other.

    Every classifier is tested on one robot and trained on the other robots. The result has three figures.
    ``simulated``: real session i is tested against simulated session i, by a classifier trained on the other sessions;
    if there are fewer simulated sessions than real ones, the simulated ones are used again from the first. A real or
    simulated session that is the only one of its kind is used for the training too.
    ``simulated_by_robot``: each pair of a real and a simulated session is distinguished by a classifier trained on the
    other robots of this pair. ``real``: each pair of real sessions is distinguished in the same way.

    Args:
        real, simulated: samples of each session (``features.sessions_of``), at least one session each.
            Intervals, at 95 % confidence, are over the real sessions, that of ``simulated_by_robot`` over the simulated
            ones too (with one simulated session, for that one); with one real session the limits are 0 and 1.
    Raises:
        InputError: a session has no times spent avoiding, or is too short for one stretch of each robot; or fewer than
            two robots took part in all sessions; or scikit-learn is not installed.
    """
    if any(session["avoid_s"].null_count() == session.height for session in (*real, *simulated)):
        raise InputError(
            "a session has no times spent avoiding, which the classifier needs; let robots log avoid_total_s",
            field="sessions",
        )
    real_stretches = [_stretches_by_robot(session) for session in real]
    simulated_stretches = [_stretches_by_robot(session) for session in simulated]
    sessions = [*real_stretches, *simulated_stretches]
    robots = sorted(set.intersection(*(set(session) for session in sessions)))
    if len(robots) < 2:
        raise InputError("a classifier split by robot needs at least two robots", field="robots")
    short = [robot for session in sessions for robot in robots if not len(session[robot])]
    if short:
        raise InputError(
            f"robot {short[0]} has fewer than {STRETCH} intervals between samples in a session; the classifier needs "
            "longer sessions",
            field="sessions",
        )
    by_session = [_held_out(real_stretches, simulated_stretches, i, robots) for i in range(len(real))]
    pairs = np.array(
        [[_accuracy_between(own, other, robots) for other in simulated_stretches] for own in real_stretches]
    )
    return ClassifierAccuracy(
        simulated=bounded_mean(_trained_together(by_session)),
        simulated_by_robot=within(allowing_for_rare(over_sessions(pairs), pairs.mean(axis=1), 1.0), 0.0, 1.0),
        real=_accuracy_among(real_stretches, robots),
        by_session=tuple(by_session),
        simulations=len(simulated),
    )


def _stretches_by_robot(samples: pl.DataFrame) -> Stretches:
    """Return the features of all stretches of one session, by robot."""
    return {int(key[0]): columns_of(own) for key, own in samples.group_by("robot", maintain_order=True)}


class _Rows(NamedTuple):
    """Stretches of several sessions of two classes."""

    features: Floats
    """(rows, columns)."""
    label: Ints
    """0 for the first class, 1 for the second, (rows,)."""
    robot: Ints
    """(rows,)."""


def _rows(classes: Classes, robots: Sequence[int]) -> _Rows:
    """Return the stretches of these robots in all sessions of two classes."""
    each = [
        (session[robot], label, robot)
        for label, sessions in enumerate(classes)
        for session in sessions
        for robot in robots
    ]
    counts = [len(features) for features, _, _ in each]
    return _Rows(
        np.concatenate([features for features, _, _ in each]),
        np.repeat([label for _, label, _ in each], counts),
        np.repeat([robot for _, _, robot in each], counts),
    )


def _held_out(real: list[Stretches], simulated: list[Stretches], session: int, robots: list[int]) -> float:
    """Return the accuracy on real session number ``session`` and one simulated session, trained on the other sessions.

    The accuracy is the mean over robots, each tested by a classifier trained on the other robots. If there is only one
    real session, or only one simulated one, the classifier is trained on that session too.

    Args:
        real, simulated: features of the stretches of each session.
        session: index of the real session that is held out for the test.
        robots: robots that take part in all sessions.
    """
    other = session % len(simulated)  # simulated sessions are used again where there are fewer of them
    rest_real = [table for i, table in enumerate(real) if i != session] or real
    rest_simulated = [table for i, table in enumerate(simulated) if i != other] or simulated
    return _accuracy_over_robots((rest_real, rest_simulated), ([real[session]], [simulated[other]]), robots)


def _accuracy_over_robots(train: Classes, test: Classes, robots: Sequence[int]) -> float:
    """Return the mean accuracy over robots, each tested by a classifier trained on the other robots.

    Args:
        train, test: sessions of the first and of the second class.
        robots: robots that take part in all sessions.
    """
    trained, tested = _rows(train, robots), _rows(test, robots)
    both = [np.concatenate(parts) for parts in zip(trained, tested, strict=True)]
    splits = [
        (np.flatnonzero(trained.robot != robot), len(trained.robot) + np.flatnonzero(tested.robot == robot))
        for robot in robots
    ]
    return _mean_accuracy(both[0], both[1], splits)


def _accuracy_between(one: Stretches, other: Stretches, robots: Sequence[int]) -> float:
    """Return the mean accuracy over robots between two sessions, both of which are trained and tested on."""
    classes = ([one], [other])
    return _accuracy_over_robots(classes, classes, robots)


def _accuracy_among(sessions: list[Stretches], robots: list[int]) -> Interval | None:
    """Return the mean balanced accuracy between pairs of sessions, with its interval; None with one session.

    For each session, the accuracies of the pairs that contain it are averaged. The interval is of their pseudo-values.
    """
    if len(sessions) < 2:
        return None
    numbers = range(len(sessions))
    accuracies = {
        (i, j): _accuracy_between(sessions[i], sessions[j], robots) for i, j in combinations(numbers, 2)
    }
    by_session = [
        float(np.mean([accuracy for pair, accuracy in accuracies.items() if i in pair])) for i in numbers
    ]
    return bounded_mean(pseudo_values(by_session))
