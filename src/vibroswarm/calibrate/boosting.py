"""Boost small regression trees to tell two kinds of rows apart: what a linear classifier cannot see, in a few columns.

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

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

Floats = NDArray[np.float64]
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
    """Grow a tree on these rows."""
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
