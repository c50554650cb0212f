"""Grid and position of a floor in the form that kernels use, and the tile under a point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroswarm.core.jit import kernel
from vibroswarm.floors.floor import Floor


class Place(NamedTuple):
    """Grid and position of a floor."""

    rows: int
    """Number of rows of tiles."""
    columns: int
    """Number of columns of tiles."""
    width_m: float
    """Width of a tile."""
    height_m: float
    """Height of a tile."""
    left_m: float
    """Left end of the floor."""
    top_m: float
    """Upper end of the floor."""


def place_of(floor: Floor) -> Place:
    """Return the grid and the position of a floor in the form that kernels use."""
    return place_at(floor.geometry)


def place_at(geometry: tuple[int, int, float, float, float, float]) -> Place:
    """Return the same of ``Floor.geometry``: rows, columns, tile width and height, left and bottom, m."""
    rows, columns, width_m, height_m, left_m, bottom_m = geometry
    return Place(rows, columns, width_m, height_m, left_m, bottom_m + rows * height_m)


@kernel
def tile_below(x_m: float, y_m: float, place: Place) -> int:
    """Return the index of the tile under a point; -1 if no tile is there.

    A point on the edge between two tiles belongs to the tile on the right, or to the lower one. A point on the right or
    on the lower border of the floor is on no tile.
    """
    column = np.floor((x_m - place.left_m) / place.width_m)
    row = np.floor((place.top_m - y_m) / place.height_m)
    if column >= 0 and row >= 0 and column < place.columns and row < place.rows:
        index: int = int(row) * place.columns + int(column)
        return index
    return -1
