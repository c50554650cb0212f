"""A run's floor and sensors as kernels read them, and what one sample reads there.

The whole run and what follows a run as it moves do both by these functions; ``model`` reads whole tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import inner
from vibroswarm.draws import ALONE, SENSING, uniform
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.felt import (
    Place,
    Response,
    factor_row,
    felt_tile,
    place_of,
    response_of,
    tile_below,
)
from vibroswarm.scenario import Scenario


class Ground(NamedTuple):
    """The floor of a run, where it lies, and how the sensors respond."""

    tiles: NDArray[np.uint8]
    """(tiles,)"""
    place: Place
    response: Response
    """Of this run alone."""


def grounds_of(
    scenario: Scenario, seed: int, runs: Sequence[int], floors: Mapping[int, Floor]
) -> list[Ground]:
    """Floor and sensors of each run, in the order of ``runs``."""
    own = [floors[run] for run in runs]
    response = response_of(
        scenario, seed, np.array(runs, dtype=np.int64), [floor.tiles.size for floor in own]
    )
    first, per_robot = response.first, response.per_robot
    return [
        Ground(
            floor.tiles.ravel(),
            place_of(floor),
            response._replace(first=first[r : r + 1], per_robot=per_robot[r : r + 1]),
        )
        for r, floor in enumerate(own)
    ]


@inner
def read(
    ground: Ground, x_m: float, y_m: float, seed: int, run: int, robot: int, sample: int
) -> tuple[int, int, int, int]:
    """What a sample here reads: the tile below, the bit, the tile felt, the row of factors."""
    tile = tile_below(x_m, y_m, ground.place)
    felt = felt_tile(x_m, y_m, tile, ground.place, ground.tiles, ground.response, seed, run, robot, sample)
    vibrates = felt >= 0 and ground.tiles[felt] == 1
    row = factor_row(ground.response, 0, robot, felt)
    u = uniform(seed, run, robot, SENSING, sample, ALONE)
    return tile, (1 if u > ground.response.shares_below[row, int(vibrates)] else 0), felt, row
