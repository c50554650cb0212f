"""Train a classifier to distinguish stretches of a real robot's samples from simulated ones, split by robot and
session.

Ridge logistic regression on features of ``STRETCH`` consecutive samples of one robot (about a minute): mean and
standard
deviation of energies by kind of tile, distances, times, avoidance, positions, turns from step to step, and
correlation of
neighbours. A single sample says little; a stretch shows that a robot keeps its speed, veers, or reads alike twice
in a row.
The classifier is tested on other robots and other sessions than it was trained on, so it cannot recognise a robot
by its
speed or a session by its battery. Reported is the balanced accuracy; 0.5 is chance. The accuracy for real
sessions against
each other, split by robot, shows what differences between sessions alone give. (It is below 0.5 where the difference
between two sessions has opposite sign for different robots.)

With some hundred rows and some ten columns scipy's optimiser is enough, so no machine-learning library is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError

Floats = NDArray[np.float64]
Stretches = dict[int, Floats]
"""Figures of a session's stretches by robot, (stretches, columns) each."""
STRETCH: Final = 20
"""Samples of a stretch."""
RIDGE: Final = 3.0
"""Penalty on weights of standardised columns: a prior of standard deviation 0.6."""


@dataclass(frozen=True)
class ClassifierAccuracy(NotebookView):
    """Balanced accuracy of the classifier; intervals over sessions."""

    simulated: Interval
    """Real against simulated, tested on other robots and, if there are several, other sessions than trained on."""
    simulated_by_robot: Interval
    """The same split by robot only, session by session, comparable with ``real``."""
    real: Interval | None
    """Real sessions against each other, split by robot; None with one session."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""

        def plain(one: Interval | None) -> dict[str, float] | None:
            return None if one is None else {"estimate": one.estimate, "low": one.low, "high": one.high}

        return {name: plain(value) for name, value in self.__dict__.items()}


def columns_of(samples: pl.DataFrame) -> Floats:
    """Return the features of a robot's stretches, (stretches, columns).

    Samples without a step or a time spent avoiding, and an incomplete last stretch, are left out; (0, 0) if there is
    no complete stretch.

    Args:
        samples: of one robot and session, ordered by time (``features.sample_table``).
    """
    stepped = samples.filter(pl.col("dx_m").is_not_null() & pl.col("avoid_s").is_not_null())
    x, y, avoid, kind = (
        stepped[name].to_numpy().astype(float) for name in ("x_m", "y_m", "avoid_s", "vibrating")
    )
    energy = np.log(np.maximum(stepped["energy"].to_numpy(), 0.05))
    distance, spacing = stepped["distance_m"].to_numpy(), stepped["spacing_s"].to_numpy()
    course = np.arctan2(stepped["dy_m"].to_numpy(), stepped["dx_m"].to_numpy())
    turned = np.append(0.0, (np.diff(course) + np.pi) % (2 * np.pi) - np.pi)
    wall = np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
    rows = []
    for first in range(0, len(x) - STRETCH + 1, STRETCH):
        k = slice(first, first + STRETCH)
        shaking = kind[k] == 1
        rows.append(
            [
                *_mean_and_spread(energy[k][shaking]),
                *_mean_and_spread(energy[k][~shaking]),
                *_mean_and_spread(distance[k] / 0.1),
                float(np.median(distance[k])) / 0.1,
                *_mean_and_spread(np.log(np.maximum(spacing[k], 0.1))),
                float((avoid[k] > 1e-9).mean()),
                *_mean_and_spread(np.log1p(np.maximum(avoid[k], 0.0))),
                *_mean_and_spread(np.log(np.maximum(wall[k], 0.005))),
                *_mean_and_spread(turned[k]),
                float(np.median(turned[k])),
                float(np.median(np.abs(turned[k]))),
                _alike(energy[k]),
                _alike(distance[k]),
                float(shaking.mean()),
            ]
        )
    return np.array(rows).reshape(len(rows), -1) if rows else np.empty((0, 0))


def _mean_and_spread(values: Floats) -> tuple[float, float]:
    return (float(values.mean()), float(values.std())) if values.size else (0.0, 0.0)


def _alike(values: Floats) -> float:
    """Return the correlation of each value with the next; 0 if all are equal."""
    deviation = values - values.mean()
    square = float((deviation**2).mean())
    return float((deviation[1:] * deviation[:-1]).mean()) / square if square > 0 else 0.0


def fit_logistic(columns: Floats, label: NDArray[np.bool_]) -> Floats:
    """Fit a logistic regression with a ridge penalty; return its coefficients, the intercept first.

    Both labels weigh the same in all. The intercept is not penalised; columns should be standardised.
    """
    design = np.column_stack([np.ones(len(columns)), columns])
    weight = np.where(label, 0.5 / max(label.mean(), 1e-9), 0.5 / max(1 - label.mean(), 1e-9))
    sign = np.where(label, 1.0, -1.0)
    ridge = np.append(0.0, np.full(columns.shape[1], RIDGE))

    def loss(w: Floats) -> float:
        return float(weight @ np.logaddexp(0.0, -sign * (design @ w))) + 0.5 * float(ridge @ w**2)

    def slope(w: Floats) -> Floats:
        return np.asarray(ridge * w - design.T @ (weight * sign * expit(-sign * (design @ w))))

    def curvature(w: Floats) -> Floats:
        share = expit(design @ w)
        return np.asarray((design.T * (weight * share * (1.0 - share))) @ design + np.diag(ridge))

    optimum = minimize(
        loss,
        np.zeros(design.shape[1]),
        jac=slope,
        hess=curvature,
        method="trust-exact",
        options={"gtol": 1e-4},
    )
    return np.asarray(optimum.x)


def balanced_accuracy(train: tuple[Floats, Floats], test: tuple[Floats, Floats]) -> float:
    """Train a classifier on rows of two kinds, and return its balanced accuracy on other rows.

    Args:
        train, test: rows of the first and of the second kind, (rows, columns).
    """
    columns = np.concatenate(train)
    mean, spread = columns.mean(axis=0), columns.std(axis=0)
    spread = np.where(spread > 1e-9, spread, 1.0)
    label = np.r_[np.zeros(len(train[0]), dtype=np.bool_), np.ones(len(train[1]), dtype=np.bool_)]
    weights = fit_logistic((columns - mean) / spread, label)
    shares = []
    for kind, rows in enumerate(test):
        says = (rows - mean) / spread @ weights[1:] + weights[0] > 0
        shares.append(float((says == bool(kind)).mean()))
    return float(np.mean(shares))


def classifier_accuracy(
    real: Sequence[pl.DataFrame], simulated: Sequence[pl.DataFrame], level: float = 0.95
) -> ClassifierAccuracy:
    """Train and test for every session, with one robot at a time held out.

    Args:
        real, simulated: sessions (``features.sessions_of``).
    Raises:
        InputError: fewer than two robots, or a session too short for one stretch of each.
    """
    if any(session["avoid_s"].null_count() == session.height for session in (*real, *simulated)):
        raise InputError(
            "a session has no times spent avoiding, which the classifier needs; let robots log avoid_total_s",
            field="sessions",
        )
    a, b = [_by_robot(session) for session in real], [_by_robot(session) for session in simulated]
    robots = sorted(set.intersection(*(set(session) for session in (*a, *b))))
    if len(robots) < 2:
        raise InputError("a classifier split by robot needs at least two robots", field="robots")
    short = [robot for session in (*a, *b) for robot in robots if not len(session[robot])]
    if short:
        raise InputError(
            f"robot {short[0]} has fewer than {STRETCH} intervals between samples in a session; the classifier needs "
            "longer sessions",
            field="sessions",
        )
    return ClassifierAccuracy(
        simulated=_share_interval([_held_out(a, b, i, robots) for i in range(len(a))], level),
        simulated_by_robot=_share_interval(
            [
                float(np.mean([_by_robot_share(session, other_session, robots) for other_session in b]))
                for session in a
            ],
            level,
        ),
        real=_among(a, robots, level),
    )


def _share_interval(shares: list[float], level: float) -> Interval:
    """Return ``mean_interval`` of shares, clipped to [0, 1]."""
    interval = mean_interval(shares, level)
    return interval._replace(low=max(interval.low, 0.0), high=min(interval.high, 1.0))


def _by_robot(samples: pl.DataFrame) -> Stretches:
    return {int(key[0]): columns_of(own) for key, own in samples.group_by("robot", maintain_order=True)}


def _rows(sessions: Sequence[Stretches], robots: Sequence[int]) -> Floats:
    return np.concatenate([session[robot] for session in sessions for robot in robots])


def _held_out(real: list[Stretches], simulated: list[Stretches], session: int, robots: list[int]) -> float:
    """Return the accuracy on one real and one simulated session, mean over robots, trained on the other sessions.

    Where there is only one session of a kind, it is trained on too, without the robot that is tested.
    """
    other = session % len(simulated)
    rest_real = [table for i, table in enumerate(real) if i != session] or real
    rest_simulated = [table for i, table in enumerate(simulated) if i != other] or simulated
    return _by_robot_share(real[session], simulated[other], robots, (rest_real, rest_simulated))


def _by_robot_share(
    one: Stretches,
    other: Stretches,
    robots: list[int],
    train: tuple[list[Stretches], list[Stretches]] | None = None,
) -> float:
    """Return the accuracy on two sessions, mean over robots; each is tested by a classifier trained on the others.

    Args:
        train: sessions of both kinds to train on; None: the two sessions themselves.
    """
    train = train or ([one], [other])
    shares = []
    for robot in robots:
        others = [each for each in robots if each != robot]
        rows = (_rows(train[0], others), _rows(train[1], others))
        shares.append(balanced_accuracy(rows, (one[robot], other[robot])))
    return float(np.mean(shares))


def _among(sessions: list[Stretches], robots: list[int], level: float) -> Interval | None:
    """Return the accuracy between pairs of real sessions, averaged for each session; None with one session."""
    if len(sessions) < 2:
        return None
    numbers = range(len(sessions))
    pairs = {(i, j): _by_robot_share(sessions[i], sessions[j], robots) for i, j in combinations(numbers, 2)}
    by_session = [float(np.mean([share for pair, share in pairs.items() if i in pair])) for i in numbers]
    return _share_interval(by_session, level)
