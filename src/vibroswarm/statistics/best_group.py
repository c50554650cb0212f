"""Name the best of several contestants with all that cannot be told apart from it, as the best is partly lucky.

| name | symbol | equation |
|---|---|---|
| figure of contestant i | m_i | less is better |
| its bootstrap draws | m_i* | the same draws of runs for all contestants, so that comparisons are paired |
| difference, its standard error | d_ij, s_ij | m_i - m_j; standard deviation of d_ij* over the draws |
| critical value | c | 95 % quantile over draws of the maximum of abs(d_ij* - d_ij) / s_ij over all pairs |
| of n units | c_n | sqrt(n / (n - 1)) times the quantile of Student's law, n - 1 degrees of freedom, that c is of the \
normal law: s_ij is estimated from n units |
| of few units | c_n | at least Bonferroni's for the pairs that differ in some unit: n units have n - 1 directions at \
most in which contestants vary, so that the maximum over many pairs comes out too small |
| interval | - | d_ij - c_n s_ij to d_ij + c_n s_ij |
| best group | - | every i for which no interval of d_ij lies above 0 |

All intervals hold together with 95 % (max-t; Romano and Wolf 2005), since the maximum is over all pairs. So the best
contestant is left out of the group in at most 5 % of all experiments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, stdtrit

from vibroswarm.inference.outcomes import Array

LEVEL: Final = 0.95
"""Confidence level of all intervals together."""
FEWEST: Final = 10
"""Least number of units to tell contestants apart: with fewer, all intervals hold in less than 95 % of leagues."""
FEW: Final = 4
"""Units per contestant below which c_n is at least Bonferroni's."""


@dataclass(frozen=True)
class BestGroup:
    """The best contestant, and which others cannot be told apart from it."""

    best: int
    """Index of the contestant with the smallest estimate."""
    member: NDArray[np.bool_]
    """Whether each contestant is in the best group, (contestants,)."""
    difference: Array
    """Each contestant - best, with limits, (contestants, 3); infinite for too few units."""


def best_group(figures: Array, units: int) -> BestGroup:
    """Compare contestants pairwise, see the head of this module.

    Args:
        figures: estimates, then bootstrap draws, which may be nan, (contestants, 1 + draws). units: number of runs.
    """
    estimate, drawn = figures[:, 0], figures[:, 1:]
    best = int(estimate.argmin())
    difference = estimate[:, None] - estimate[None, :]
    margin = _margins(difference, drawn, units) if units >= FEWEST else np.full(difference.shape, np.inf)
    member = np.asarray(~((difference - margin) > 0.0).any(axis=1))
    limits = (difference - margin)[:, best], (difference + margin)[:, best]
    return BestGroup(best, member, np.column_stack([difference[:, best], *limits]))


def _margins(difference: Array, drawn: Array, units: int) -> Array:
    """Return c_n s_ij of all pairs, (contestants, contestants)."""
    error, largest, pairs = np.zeros(difference.shape), np.full(drawn.shape[1], np.nan), 0
    for one in range(len(drawn) - 1):  # not all pairs at once, which may be many
        apart, own = drawn[one] - drawn[one + 1 :], difference[one, one + 1 :]
        spread = np.nanstd(apart, axis=1, ddof=1)
        error[one, one + 1 :] = error[one + 1 :, one] = spread
        varies = spread > 0.0  # contestants that are alike in every run do not
        pairs += int(varies.sum())
        away = np.abs(apart - own[:, None])[varies] / spread[varies][:, None]
        # over pairs; a pair that is nan in a draw does not count in it
        largest = np.fmax(largest, np.fmax.reduce(away, axis=0, initial=np.nan))
    if np.isnan(largest).all():  # all are alike
        return np.zeros(difference.shape)
    tail = ndtr(-np.nanquantile(largest, LEVEL))  # that of the normal law beyond c
    if units < FEW * len(drawn):
        tail = min(tail, (1.0 - LEVEL) / (2 * pairs))
    critical = -stdtrit(units - 1, tail) * math.sqrt(units / (units - 1))
    return np.asarray(critical * error)


def pareto_front(*figures: ArrayLike) -> NDArray[np.bool_]:
    """Return which points are on the Pareto front, (points,): less is better in each figure; nan never is."""
    rows = np.column_stack([np.asarray(figure, dtype=np.float64) for figure in figures])
    front = np.zeros(len(rows), dtype=np.bool_)
    # By the first figure, at equal ones by the second and so on: no point is dominated by a later one only.
    for k in np.lexsort(rows.T[::-1]):
        best, own = rows[front], rows[k]
        dominates = (best <= own).all(axis=1) & (best < own).any(axis=1)
        front[k] = not (dominates.any() or np.isnan(own).any())
    return front
