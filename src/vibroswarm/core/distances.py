"""Distances between many points, and of many points from tiles."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, kernel

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


@kernel
def nearest_tiles(
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    wanted: NDArray[np.bool_],
    corners_m: NDArray[np.float64],
    sought: NDArray[np.bool_],
    size_m: tuple[float, float],
    distance_m: NDArray[np.float64],
    tile: NDArray[np.int64],
) -> None:
    """Find the nearest tile of the sought kind for each place; the first one of those equally near.

    Args:
        x_m, y_m: the places, m, and wanted: whether tiles of kind 1 are sought for each, (places,) each.
        corners_m: lower left corner of each tile, m, (tiles, 2). sought: whether each tile is of kind 1, (tiles,).
        size_m: width and height of a tile, m.
        distance_m, tile: filled with the distance of each place from that tile, m, and its index; inf and -1 where
            there is none. (places,) each.
    """
    for i in range(x_m.size):
        nearest_m, found = math.inf, -1
        for j in range(sought.size):
            if sought[j] == wanted[i]:
                left, bottom = corners_m[j, 0], corners_m[j, 1]
                dx = max(max(left - x_m[i], x_m[i] - left - size_m[0]), 0.0)
                dy = max(max(bottom - y_m[i], y_m[i] - bottom - size_m[1]), 0.0)
                if dx >= nearest_m or dy >= nearest_m:  # no nearer: roots take most of the time
                    continue
                away_m = math.hypot(dx, dy)
                if away_m < nearest_m:
                    nearest_m, found = away_m, j
        distance_m[i], tile[i] = nearest_m, found
