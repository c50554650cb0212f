"""Train boosted trees to tell real from simulated undisturbed intervals, by turn and distance alone.

Two splits of two sessions: other robots (train on all but one, test on it, each in turn), and the same robots (train on
all minutes but every fifth, test on these, in turn). The second sees each robot's own veer and speed, and is the harder
test for a simulator. Real sessions of the same robots differ too: how well they are told from each other is the figure
to hold it against. Reported is the balanced accuracy; 0.5 is chance.

The trees are small regression trees: they see what a linear classifier cannot, in a few columns.

| name | symbol | equation |
|---|---|---|
| score of a row | f | sum over rounds of ``RATE`` x the tree's value; above 0: the second kind |
| gradient, curvature | g, h | w (p - y), w p (1 - p), p = 1 / (1 + exp(-f)); w weighs both kinds equally |
| value of a leaf | - | -G / (H + ``RIDGE``), G and H sums over its rows |
| gain of a split | - | G_l^2 / (H_l + ridge) + G_r^2 / (H_r + ridge) - G^2 / (H + ridge) |

Gradient boosting with second-order leaves (Chen and Guestrin, "XGBoost", KDD 2016) over ``BINS`` quantiles of each
column.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import expit

from vibroswarm.calibrate.drive import undisturbed

Floats = NDArray[np.float64]
FEATURES: Final = ("turn_rad", "distance_m")
MINUTE_S: Final = 60.0
FOLDS: Final = 5
LEAST: Final = 200
"""Fewest undisturbed intervals of a session."""


@dataclass(frozen=True)
class Told:
    """Balanced accuracies of pairs of sessions, by split."""

    same_robots: tuple[float, ...]
    other_robots: tuple[float, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"same_robots": list(self.same_robots), "other_robots": list(self.other_robots)}


@dataclass(frozen=True)
class IntervalAccuracy:
    """How well undisturbed intervals are told apart: real from simulated, and real sessions from each other.

    ``by_feature``: real from simulated with the same robots, by one feature alone; mean over pairs.
    """

    simulated: Told
    real: Told
    by_feature: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "simulated": self.simulated.as_dict(),
            "real": self.real.as_dict(),
            "by_feature": self.by_feature,
        }


def interval_accuracy(
    real: Sequence[pl.DataFrame], simulated: Sequence[pl.DataFrame]
) -> IntervalAccuracy | None:
    """Train and test on all pairs of sessions; None if one has fewer than ``LEAST`` undisturbed intervals.

    Args:
        real, simulated: sessions (``features.sessions_of``).
    """
    a, b = ([undisturbed(session) for session in sessions] for sessions in (real, simulated))
    if min(session.height for session in (*a, *b)) < LEAST:
        return None
    across = [(one, other) for one in a for other in b]
    return IntervalAccuracy(
        simulated=_told(across),
        real=_told(list(combinations(a, 2))),
        by_feature={
            name: float(np.mean([same_robots(one, other, (name,)) for one, other in across]))
            for name in FEATURES
        },
    )


def _told(pairs: Sequence[tuple[pl.DataFrame, pl.DataFrame]]) -> Told:
    return Told(
        tuple(same_robots(one, other) for one, other in pairs),
        tuple(other_robots(one, other) for one, other in pairs),
    )


def same_robots(one: pl.DataFrame, other: pl.DataFrame, features: Sequence[str] = FEATURES) -> float:
    """Return the accuracy between two sessions on minutes not trained on, of the same robots; NaN if too short.

    Args:
        one, other: from ``undisturbed``.
    """
    rows = [session.select(features).to_numpy() for session in (one, other)]
    folds = [(session["time_s"] // MINUTE_S).to_numpy() % FOLDS for session in (one, other)]
    return _mean_accuracy(
        tuple(
            tuple(own[(of == fold) == held] for own, of in zip(rows, folds, strict=True))
            for held in (False, True)
        )
        for fold in range(FOLDS)
    )


def other_robots(one: pl.DataFrame, other: pl.DataFrame) -> float:
    """Return the accuracy between two sessions on robots that were not trained on; NaN with fewer than two in common.

    Args:
        one, other: from ``undisturbed``.
    """
    robots = [pl.col("robot") == robot for robot in sorted(set(one["robot"]) & set(other["robot"]))]
    return _mean_accuracy(
        tuple(
            tuple(session.filter(chosen).select(FEATURES).to_numpy() for session in (one, other))
            for chosen in (~held, held)
        )
        for held in robots
    )


def _mean_accuracy(splits: Iterable[Sequence[Sequence[Floats]]]) -> float:
    """Return the mean accuracy over splits in which no part is empty; nan without any.

    Args:
        splits: of each, the rows of both sessions to train on, and those to test on.
    """
    shares = [
        boosted_accuracy((train[0], train[1]), (test[0], test[1]))
        for train, test in splits
        if min(map(len, (*train, *test)))
    ]
    return float(np.mean(shares)) if shares else np.nan


Codes = NDArray[np.int64]

BINS: Final = 32
ROUNDS: Final = 40
RATE: Final = 0.2
DEPTH: Final = 3
RIDGE: Final = 5.0
LEAST_CURVATURE: Final = 5.0
"""Least sum of curvatures on each side of a split: about twenty undecided rows."""


class Node(NamedTuple):
    """A split at a bin of a column, or a leaf (column -1)."""

    column: int
    last_left: int
    value: float
    left: Node | None
    right: Node | None


def boosted_accuracy(train: tuple[Floats, Floats], test: tuple[Floats, Floats]) -> float:
    """Return the balanced accuracy on the test rows; each pair holds the rows of both kinds, (rows, columns)."""
    rows = np.concatenate(train)
    label = np.r_[np.zeros(len(train[0])), np.ones(len(train[1]))]
    weight = np.where(label == 1.0, 0.5 / label.mean(), 0.5 / (1.0 - label.mean()))
    edges = [np.unique(np.quantile(column, np.linspace(0.0, 1.0, BINS + 1)[1:-1])) for column in rows.T]
    codes, tested = _codes(rows, edges), [_codes(each, edges) for each in test]
    score, scores = np.zeros(len(rows)), [np.zeros(len(each)) for each in test]
    for _ in range(ROUNDS):
        p = expit(score)
        tree = _grown(codes, weight * (p - label), weight * p * (1.0 - p), DEPTH)
        score += RATE * _values(tree, codes)
        for each, coded in zip(scores, tested, strict=True):
            each += RATE * _values(tree, coded)
    return float(np.mean([(scores[0] <= 0.0).mean(), (scores[1] > 0.0).mean()]))


def _codes(rows: Floats, edges: list[Floats]) -> Codes:
    """Return the bin of each value, (rows, columns)."""
    return np.stack(
        [np.searchsorted(edge, column, side="right") for edge, column in zip(edges, rows.T, strict=True)],
        axis=1,
    )


def _grown(codes: Codes, gradient: Floats, curvature: Floats, depth: int) -> Node:
    """Grow a tree on these rows; it is a leaf if ``depth`` is 0 or no split gains anything."""
    total, curved = float(gradient.sum()), float(curvature.sum())
    best, at = 0.0, (-1, 0)
    for column in range(codes.shape[1] if depth else 0):
        left = np.bincount(codes[:, column], gradient, BINS).cumsum()
        left_curved = np.bincount(codes[:, column], curvature, BINS).cumsum()
        gain = left**2 / (left_curved + RIDGE) + (total - left) ** 2 / (curved - left_curved + RIDGE)
        gain -= total**2 / (curved + RIDGE)
        gain[np.minimum(left_curved, curved - left_curved) < LEAST_CURVATURE] = 0.0
        k = int(gain.argmax())
        if gain[k] > best:
            best, at = float(gain[k]), (column, k)
    if at[0] < 0:
        return Node(-1, 0, -total / (curved + RIDGE), None, None)
    is_left = codes[:, at[0]] <= at[1]
    sides = [_grown(codes[side], gradient[side], curvature[side], depth - 1) for side in (is_left, ~is_left)]
    return Node(*at, 0.0, *sides)


def _values(node: Node, codes: Codes) -> Floats:
    """Return the value of the tree for each row."""
    if node.left is None or node.right is None:
        return np.full(len(codes), node.value)
    is_left = codes[:, node.column] <= node.last_left
    return np.where(is_left, _values(node.left, codes), _values(node.right, codes))
