"""A run's floor and sensors as kernels read them, and the reading of one sample.

Used by the closed loop; ``observe`` reads whole tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner
from vibroswarm.core.rng import ALONE, SENSING, uniform
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.edge_response import (
    Place,
    Response,
    factor_row,
    place_of,
    response_of,
    sensed_tile,
    tile_below,
)
from vibroswarm.robot.sensing import SenseProgram
from vibroswarm.scenario.scenario import Scenario


class SensedFloor(NamedTuple):
    """The floor of a run, its position, and the sensors' response."""

    tiles: NDArray[np.uint8]
    """(tiles,)"""
    place: Place
    response: Response
    """Of this run alone."""


def sensed_floors(
    scenario: Scenario, seed: int, runs: Sequence[int], floors: Mapping[int, Floor]
) -> list[SensedFloor]:
    """Return floor and sensors of each run, in the order of ``runs``."""
    own = [floors[run] for run in runs]
    response = response_of(
        scenario, seed, np.array(runs, dtype=np.int64), [floor.tiles.size for floor in own]
    )
    first, per_robot = response.first, response.per_robot
    return [
        SensedFloor(
            floor.tiles.ravel(),
            place_of(floor),
            response._replace(first=first[r : r + 1], per_robot=per_robot[r : r + 1]),
        )
        for r, floor in enumerate(own)
    ]


@inner
def read(
    ground: SensedFloor, x_m: float, y_m: float, seed: int, run: int, robot: int, sample: int
) -> tuple[int, int, int, int]:
    """Return the reading of a sample: the tile below, the bit, the tile sensed, the row of factors."""
    tile = tile_below(x_m, y_m, ground.place)
    sensed = sensed_tile(
        x_m, y_m, tile, ground.place, ground.tiles, ground.response, seed, run, robot, sample
    )
    vibrates = sensed >= 0 and ground.tiles[sensed] == 1
    row = factor_row(ground.response, 0, robot, sensed)
    u = uniform(seed, run, robot, SENSING, sample, ALONE)
    return tile, (1 if u > ground.response.shares_below[row, int(vibrates)] else 0), sensed, row


USUAL_MS = 500.0


def sense_program(scenario: Scenario) -> SenseProgram:
    """Return the sensing parameters of a scenario: the robot settles, then reads the signal at the end of the
    stop."""
    stop_ms = scenario.sample.stop_ms
    signal_ms = scenario.sample.signal_ms or min(USUAL_MS, 0.5 * stop_ms)
    return SenseProgram(settle_ms=stop_ms - signal_ms, signal_ms=signal_ms)
