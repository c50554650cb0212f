"""Train boosted trees to distinguish real from simulated undisturbed intervals, by turn and distance alone.

An undisturbed interval lies between two samples of a robot that only drove in between (``drive``). Two sessions, the
two classes, are split into training and test rows in two ways. Other robots: test on one robot, train on all others,
for each robot in turn. The same robots: test on every fifth minute, train on the other minutes, for each of the five
sets of minutes in turn. The second split lets the classifier learn each robot's own veer and speed, and is the harder
test for a simulator. Real sessions of the same robots differ too, so the accuracy between real and simulated sessions
is to be compared with the accuracy between real sessions. All accuracies are balanced accuracies: the mean of the two
classes' shares of correct predictions; 0.5 is chance.

The classifier is scikit-learn's (extra ``lab``): boosted small trees on binned values, because a linear classifier
would see only shifts of turn and distance, not other shapes of their distributions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.classifier import mean_accuracy, scikit_learn
from vibroswarm.calibrate.drive import undisturbed
from vibroswarm.core.arrays import Ints

FEATURES: Final = ("turn_rad", "distance_m")
"""Columns of ``drive.undisturbed`` that the classifier uses."""
MINUTE_S: Final = 60.0
"""Length of a minute, s: sessions are split into training and test rows minute by minute."""
FOLDS: Final = 5
"""Sets of minutes: set k has every fifth minute, from minute k."""
LEAST: Final = 200
"""Fewest undisturbed intervals of a session."""


@dataclass(frozen=True)
class Told:
    """Balanced accuracies of pairs of sessions, one value per pair, for the two ways to split them."""

    same_robots: tuple[float, ...]
    """Tested on minutes that were not trained on, so on the same robots."""
    other_robots: tuple[float, ...]
    """Tested on robots that were not trained on."""


@dataclass(frozen=True)
class IntervalAccuracy:
    """How well undisturbed intervals are distinguished: real from simulated, and real sessions from each other."""

    simulated: Told
    """Accuracies of the pairs of a real and a simulated session."""
    real: Told
    """Accuracies of the pairs of real sessions; no values with one real session."""
    by_feature: dict[str, float]
    """Accuracy between real and simulated sessions with one feature alone, by its name; split by minutes, mean over
    pairs."""


def interval_accuracy(
    real: Sequence[pl.DataFrame], simulated: Sequence[pl.DataFrame]
) -> IntervalAccuracy | None:
    """Train and test on all pairs of a real and a simulated session, and on all pairs of real sessions.

    The result is None if a session has fewer than ``LEAST`` undisturbed intervals.

    Args:
        real, simulated: samples of each session (``features.sessions_of``), at least one session each.
    """
    real_intervals = [undisturbed(session) for session in real]
    simulated_intervals = [undisturbed(session) for session in simulated]
    if min(session.height for session in (*real_intervals, *simulated_intervals)) < LEAST:
        return None
    across = list(product(real_intervals, simulated_intervals))
    return IntervalAccuracy(
        simulated=_accuracies(across),
        real=_accuracies(list(combinations(real_intervals, 2))),
        by_feature={
            name: float(np.mean([same_robots(one, other, (name,)) for one, other in across]))
            for name in FEATURES
        },
    )


def _accuracies(pairs: Sequence[tuple[pl.DataFrame, pl.DataFrame]]) -> Told:
    """Return the accuracies of each pair of sessions, split by minutes and split by robots."""
    return Told(
        same_robots=tuple(same_robots(one, other) for one, other in pairs),
        other_robots=tuple(other_robots(one, other) for one, other in pairs),
    )


def same_robots(one: pl.DataFrame, other: pl.DataFrame, features: Sequence[str] = FEATURES) -> float:
    """Return the accuracy between two sessions, tested on minutes that were not trained on.

    The result is NaN if the sessions are so short that training or test rows are missing in every fold.

    Args:
        one, other: intervals of the two sessions, from ``undisturbed``.
        features: columns that the classifier uses.
    """
    minutes = [(session["time_s"] // MINUTE_S).to_numpy() % FOLDS for session in (one, other)]
    return _accuracy(one, other, features, np.concatenate(minutes))


def other_robots(one: pl.DataFrame, other: pl.DataFrame) -> float:
    """Return the accuracy between two sessions, tested on robots that were not trained on.

    Each robot that is in both sessions is held out in turn, while all other robots of the two sessions are trained on.
    The result is NaN if no robot is in both sessions, or if one session has only the robot that is held out.

    Args:
        one, other: intervals of the two sessions, from ``undisturbed``.
    """
    return _accuracy(
        one, other, FEATURES, np.concatenate([one["robot"].to_numpy(), other["robot"].to_numpy()])
    )


def _accuracy(one: pl.DataFrame, other: pl.DataFrame, features: Sequence[str], groups: Ints) -> float:
    """Return the accuracy between two sessions on each group of rows, trained on the other groups."""
    if np.unique(groups).size < 2:
        return np.nan
    rows = np.concatenate([session.select(features).to_numpy() for session in (one, other)])
    label = np.repeat([0, 1], [one.height, other.height])
    one_out = scikit_learn("model_selection").LeaveOneGroupOut()
    return mean_accuracy(boosted_trees(), rows, label, one_out.split(rows, label, groups))


def boosted_trees() -> Any:
    """Return the untrained classifier: boosted trees of few splits, with classes of equal weight."""
    return scikit_learn("ensemble").HistGradientBoostingClassifier(
        learning_rate=0.2,
        max_iter=40,
        max_depth=3,
        max_bins=32,
        min_samples_leaf=20,
        l2_regularization=5.0,
        class_weight="balanced",
        early_stopping=False,
    )
