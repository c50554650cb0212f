"""Train boosted trees to distinguish real from simulated undisturbed intervals, by turn and distance alone.

An undisturbed interval lies between two samples of a robot that only drove in between (``drive``). Two sessions, the
two classes, are split into training and test rows in two ways. Other robots: test on one robot, train on all others,
for each robot in turn. The same robots: test on every fifth minute, train on the other minutes, for each of the five
sets of minutes in turn. The second split lets the classifier learn each robot's own veer and speed, and is the harder
test for a simulator. Real sessions of the same robots differ too, so the accuracy between real and simulated sessions
is to be compared with the accuracy between real sessions. All accuracies are balanced accuracies: the mean of the two
classes' shares of correct predictions; 0.5 is chance.

The classifier is a sum of small regression trees, because a linear classifier would see only shifts of turn and
distance, not other shapes of their distributions.

| name | symbol | equation |
|---|---|---|
| score of a row | f | sum over rounds of ``RATE`` x the tree's value; above 0: the second class |
| label | y | 0 for the first class, 1 for the second |
| probability | p | 1 / (1 + exp(-f)) |
| gradient | g | w (p - y), with weights w of equal sum in both classes |
| curvature | h | w p (1 - p) |
| value of a leaf | - | -G / (H + ``RIDGE``), G and H the sums of g and h over its rows |
| gain of a split | - | G_l^2 / (H_l + ``RIDGE``) + G_r^2 / (H_r + ``RIDGE``) - G^2 / (H + ``RIDGE``), l left, r right |

The method is gradient boosting with second-order leaves (Chen and Guestrin, "XGBoost", KDD 2016). The values of each
column are replaced by their bins, bounded by quantiles (at most ``BINS``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import expit

from vibroswarm.calibrate.drive import undisturbed

Floats = NDArray[np.float64]
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

    def as_dict(self) -> dict[str, Any]:
        """Return the accuracies of all pairs by split, for JSON."""
        return {"same_robots": list(self.same_robots), "other_robots": list(self.other_robots)}


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

    def as_dict(self) -> dict[str, Any]:
        """Return nested plain values for JSON."""
        return {
            "simulated": self.simulated.as_dict(),
            "real": self.real.as_dict(),
            "by_feature": self.by_feature,
        }


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
    rows = [session.select(features).to_numpy() for session in (one, other)]
    # The set of minutes of each row.
    folds = [(session["time_s"] // MINUTE_S).to_numpy() % FOLDS for session in (one, other)]
    # For each set: the training rows of both sessions, then the test rows of both sessions.
    return _mean_accuracy(
        tuple(
            tuple(
                own_rows[(own_folds == fold) == is_test]
                for own_rows, own_folds in zip(rows, folds, strict=True)
            )
            for is_test in (False, True)
        )
        for fold in range(FOLDS)
    )


def other_robots(one: pl.DataFrame, other: pl.DataFrame) -> float:
    """Return the accuracy between two sessions, tested on robots that were not trained on.

    Each robot that is in both sessions is held out in turn, while all other robots of the two sessions are trained on.
    The result is NaN if no robot is in both sessions, or if one session has only the robot that is held out.

    Args:
        one, other: intervals of the two sessions, from ``undisturbed``.
    """
    is_robot = [pl.col("robot") == robot for robot in sorted(set(one["robot"]) & set(other["robot"]))]
    # For each robot: the training rows of both sessions, then the test rows of both sessions.
    return _mean_accuracy(
        tuple(
            tuple(session.filter(chosen).select(FEATURES).to_numpy() for session in (one, other))
            for chosen in (~held_out, held_out)
        )
        for held_out in is_robot
    )


def _mean_accuracy(splits: Iterable[Sequence[Sequence[Floats]]]) -> float:
    """Return the mean accuracy over the splits in which no part is empty; NaN if there is no such split.

    Args:
        splits: for each split, the training rows of the two sessions, then the test rows of the two sessions.
    """
    shares = [
        boosted_accuracy((train[0], train[1]), (test[0], test[1]))
        for train, test in splits
        if min(map(len, (*train, *test)))
    ]
    return float(np.mean(shares)) if shares else np.nan


Codes = NDArray[np.int64]
"""Bins of values, from 0, (rows, columns)."""

BINS: Final = 32
"""Most bins of a column."""
ROUNDS: Final = 40
"""Trees of a classifier."""
RATE: Final = 0.2
"""Learning rate."""
DEPTH: Final = 3
"""Most splits from the root of a tree to a leaf."""
RIDGE: Final = 5.0
"""Added to the sum of curvatures of a leaf, so that leaves with few rows have small values."""
LEAST_CURVATURE: Final = 5.0
"""Least sum of curvatures on each side of a split: about twenty undecided rows."""


class Node(NamedTuple):
    """A split of the rows by a column's bins, or a leaf (column -1, no children)."""

    column: int
    """Column by whose bins the rows are split; -1 for a leaf."""
    last_left: int
    """Rows of bins up to this one go left, the others right; 0 for a leaf."""
    value: float
    """Value that a leaf adds to the score of its rows; 0 for a split."""
    left: Node | None
    """Subtree of the rows that go left; None for a leaf."""
    right: Node | None
    """Subtree of the rows that go right; None for a leaf."""


def boosted_accuracy(train: tuple[Floats, Floats], test: tuple[Floats, Floats]) -> float:
    """Train boosted trees on rows of two classes, and return their balanced accuracy on other rows.

    Args:
        train, test: rows of the first and of the second class, (rows, columns) each, none of them empty.
    """
    rows = np.concatenate(train)
    label = np.r_[np.zeros(len(train[0])), np.ones(len(train[1]))]
    weight = np.where(label == 1.0, 0.5 / label.mean(), 0.5 / (1.0 - label.mean()))
    # Inner edges of each column's bins, at quantiles of the training rows; equal quantiles give fewer bins.
    edges = [np.unique(np.quantile(column, np.linspace(0.0, 1.0, BINS + 1)[1:-1])) for column in rows.T]
    codes, test_codes = _codes(rows, edges), [_codes(of_class, edges) for of_class in test]
    score, test_scores = np.zeros(len(rows)), [np.zeros(len(of_class)) for of_class in test]
    for _ in range(ROUNDS):
        p = expit(score)
        tree = _grown(codes, weight * (p - label), weight * p * (1.0 - p), DEPTH)
        score += RATE * _values(tree, codes)
        for of_class, codes_of_class in zip(test_scores, test_codes, strict=True):
            of_class += RATE * _values(tree, codes_of_class)  # in place: an array of ``test_scores``
    return float(np.mean([(test_scores[0] <= 0.0).mean(), (test_scores[1] > 0.0).mean()]))


def _codes(rows: Floats, edges: list[Floats]) -> Codes:
    """Return the bin of each value, from 0, (rows, columns).

    Args:
        rows: values, (rows, columns). edges: inner edges of the bins of each column, ascending.
    """
    return np.stack(
        [np.searchsorted(edge, column, side="right") for edge, column in zip(edges, rows.T, strict=True)],
        axis=1,
    )


def _grown(codes: Codes, gradient: Floats, curvature: Floats, depth: int) -> Node:
    """Grow a tree on these rows; it is a leaf if ``depth`` is 0 or no split gains anything.

    Args:
        codes: bins of the rows, (rows, columns). gradient, curvature: of each row, (rows,).
        depth: most splits from here to a leaf.
    """
    g_sum, h_sum = float(gradient.sum()), float(curvature.sum())
    best_gain, split_column, last_left = 0.0, -1, 0
    for column in range(codes.shape[1] if depth else 0):  # no split is tried if depth is 0
        # Entry k of these arrays is for a split after bin k: the sums over the rows that would go left, and the gain.
        g_left = np.bincount(codes[:, column], gradient, BINS).cumsum()
        h_left = np.bincount(codes[:, column], curvature, BINS).cumsum()
        gain = g_left**2 / (h_left + RIDGE) + (g_sum - g_left) ** 2 / (h_sum - h_left + RIDGE)
        gain -= g_sum**2 / (h_sum + RIDGE)
        gain[np.minimum(h_left, h_sum - h_left) < LEAST_CURVATURE] = 0.0  # too few rows on one side
        k = int(gain.argmax())
        if gain[k] > best_gain:
            best_gain, split_column, last_left = float(gain[k]), column, k
    if split_column < 0:
        return Node(column=-1, last_left=0, value=-g_sum / (h_sum + RIDGE), left=None, right=None)
    is_left = codes[:, split_column] <= last_left
    left, right = (
        _grown(codes[side], gradient[side], curvature[side], depth - 1) for side in (is_left, ~is_left)
    )
    return Node(split_column, last_left, value=0.0, left=left, right=right)


def _values(node: Node, codes: Codes) -> Floats:
    """Return the value of the leaf that each row reaches, (rows,).

    Args:
        node: root of the tree. codes: bins of the rows, (rows, columns).
    """
    if node.left is None or node.right is None:
        return np.full(len(codes), node.value)
    is_left = codes[:, node.column] <= node.last_left
    return np.where(is_left, _values(node.left, codes), _values(node.right, codes))
