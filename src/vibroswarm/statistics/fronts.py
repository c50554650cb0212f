"""Compute fronts of points: of time against error, with straight lines between them, and of any figures.

Every strategy can be made faster by letting it err more often. Each of its settings is a point (decision time, error).
The front consists of the points for which no other point is at least as good in both. Every point of a line between two
of them can be reached: a swarm that draws one of two settings for each run has a weighted mean of their times and of
their errors.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibroswarm.inference.outcomes import Array

METHOD: Final = "bootstrap of fronts"
"""Name of the method by which limits are computed."""


def front_of(time_s: Array, error: Array) -> tuple[Array, Array]:
    """Return the times and errors of the points on the front, sorted by rising time.

    A point is left out if another point is at least as good in both figures; of equal points one is kept.

    Args:
        time_s, error: of each point, (points,) each.
    """
    order = np.lexsort((error, time_s))  # by time, at equal times by error
    x, y = time_s[order], error[order]
    best = np.minimum.accumulate(y)
    # The fastest point is on the front. Any other point is on it if its error is below the errors of all faster points.
    on_front = np.append(True, y[1:] < best[:-1])
    return x[on_front], y[on_front]


def on_line(value: float, x: Array, y: Array) -> float:
    """Interpolate y linearly at x = ``value``; nan outside the range of ``x``, which rises."""
    return float(np.interp(value, x, y)) if x[0] <= value <= x[-1] else np.nan


def pareto_front(*figures: ArrayLike) -> NDArray[np.bool_]:
    """Return which points are on the Pareto front, (points,).

    Args:
        figures: one or more figures of the points, (points,) each; less is better. A point with a figure of nan is not
            on the front.
    """
    rows = np.column_stack([np.asarray(figure, dtype=np.float64) for figure in figures])
    front = np.zeros(len(rows), dtype=np.bool_)
    # By the first figure, at equal ones by the second and so on: no point is dominated by a later one only.
    for k in np.lexsort(rows.T[::-1]):
        best, own = rows[front], rows[k]
        dominates = (best <= own).all(axis=1) & (best < own).any(axis=1)
        front[k] = not (dominates.any() or np.isnan(own).any())
    return front
