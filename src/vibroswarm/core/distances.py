"""Distances between many points."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel

LANES: Final = 8
"""Number of partial sums, which compilers turn into one vector. Of a single sum they may not: that would change the
order of the additions, and so the rounding."""


@allocating_kernel
def sum_of_distances(points: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """Return the sum of the Euclidean distances from each of ``points`` to each of ``others``.

    The distances are not all stored: only those from one point at a time.

    Args:
        points: shape (n, coordinates).
        others: shape (coordinates, m), transposed, so that the inner loops run along rows.
    """
    count = others.shape[1]
    # Holds the squares of the distances from one point, and then the distances themselves. The LANES elements at the
    # end stay 0, so that the last block of the sum may reach beyond ``count``.
    distances = np.zeros(count + LANES)
    sums = np.zeros(LANES)
    for i in range(points.shape[0]):
        for j in range(count):
            distances[j] = 0.0
        for column in range(others.shape[0]):
            coordinate, row = points[i, column], others[column]
            for j in range(count):
                distances[j] += (row[j] - coordinate) * (row[j] - coordinate)
        for j in range(count):
            distances[j] = math.sqrt(distances[j])
        for block in range((count + LANES - 1) // LANES):
            for lane in range(LANES):
                sums[lane] += distances[LANES * block + lane]
    return float(sums.sum())
