"""Distances of many points from many others, summed up."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import allocating_kernel

LANES: Final = 8
"""So many sums are taken side by side, of which a compiler makes one vector."""


@allocating_kernel
def sum_of_distances(points: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """The sum of the distances of all pairs, without a table of them.

    Args:
        points: (n, columns). others: (columns, m).
    """
    count = others.shape[1]
    apart = np.zeros(count + LANES)  # those beyond the last stay 0
    sums = np.zeros(LANES)
    for i in range(points.shape[0]):
        for j in range(count):
            apart[j] = 0.0
        for column in range(others.shape[0]):
            here, row = points[i, column], others[column]
            for j in range(count):
                apart[j] += (row[j] - here) * (row[j] - here)
        for j in range(count):
            apart[j] = math.sqrt(apart[j])
        for block in range((count + LANES - 1) // LANES):
            for lane in range(LANES):
                sums[lane] += apart[LANES * block + lane]
    return float(sums.sum())
