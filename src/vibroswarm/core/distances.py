"""Sums of distances between many points."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel

LANES: Final = 8
"""Number of partial sums, which compilers turn into one vector."""


@allocating_kernel
def sum_of_distances(points: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """Return the sum of the Euclidean distances from each of ``points`` to each of ``others``, without storing them.

    Args:
        points: (n, columns). others: (columns, m), transposed, so that inner loops run along rows.
    """
    count = others.shape[1]
    squared = np.zeros(count + LANES)  # the padding stays 0
    sums = np.zeros(LANES)
    for i in range(points.shape[0]):
        for j in range(count):
            squared[j] = 0.0
        for column in range(others.shape[0]):
            coordinate, row = points[i, column], others[column]
            for j in range(count):
                squared[j] += (row[j] - coordinate) * (row[j] - coordinate)
        for j in range(count):
            squared[j] = math.sqrt(squared[j])
        for block in range((count + LANES - 1) // LANES):
            for lane in range(LANES):
                sums[lane] += squared[LANES * block + lane]
    return float(sums.sum())
