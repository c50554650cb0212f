"""Compute which points no other point beats in all figures."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


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
