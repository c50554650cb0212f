"""The Pareto front of points: those for which no other point is at least as good in all figures and better in one."""

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
    # Element (i, j) of the two arrays: whether point i is at least as good as point j in all figures; and whether it is
    # better in at least one.
    as_good = (rows[:, None, :] <= rows[None, :, :]).all(axis=2)
    better = (rows[:, None, :] < rows[None, :, :]).any(axis=2)
    return np.asarray(~(as_good & better).any(axis=0) & ~np.isnan(rows).any(axis=1))
