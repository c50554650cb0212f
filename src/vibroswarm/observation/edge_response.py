"""Which tile a sample senses, and the factor of its energy: extensions that the paper's sensor lacks.

| name | symbol | unit | shape | equation |
|---|---|---|---|---|
| distance to the edge | d | m | scalar | to the nearest vibrating tile; on one: minus that to the nearest still tile |
| sensed as vibrating | - | 0, 1 | scalar | v < Phi((reach - d) / blur), v a uniform number of the sample's own |
| factor | c | - | (rows,) | exp(s z - s^2 / 2) of the tile sensed, times that of the robot |

A sample near an edge senses the tile below or the nearest one of the other kind, never a mixture of both. What the
recordings show: on still tiles within 10 mm of a vibrating one energies are those of either kind, not in between.
The floor's outer edge is none: seen from within, there is nothing beyond it.

The edges of preset `calibrated` were fitted to tiles of one size; on smaller ones they are an extrapolation, of which
``edge_warnings`` warns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.core.rng import HARDWARE, OF_EDGE, OF_SENSOR, OF_TILE, SENSING, uniform
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.energy_model import share_below, shares_below
from vibroswarm.scenario.fields import FloorField, Sensor
from vibroswarm.scenario.scenario import Scenario, preset

FAR = 6.0
"""Number of blurs beyond the reach from which an edge is not sensed at all (one sample in 10^9)."""
CLEAR: Final = 2.4
CLEAR_SHARE: Final = 0.0083
"""This many blurs from its middle, all but this share of samples sense the same side: Phi(-2.4) = 0.0082."""


class Place(NamedTuple):
    """Position of a floor; lengths in m."""

    rows: int
    columns: int
    width_m: float
    height_m: float
    left_m: float
    top_m: float


def place_of(floor: Floor) -> Place:
    """Return the position of a floor."""
    rows, columns, width_m, height_m, left_m, bottom_m = floor.geometry
    return Place(rows, columns, width_m, height_m, left_m, bottom_m + rows * height_m)


class Response(NamedTuple):
    """Sensor response, as the kernels read it.

    Args:
        edges: whether edges matter; reach_m and blur_m how. first: (runs,), where each run's rows begin in factors
            (rows,) and shares_below (rows, 2), F(theta_E) of still and of vibrating tiles. Rows of a run: robots (or
            one for all) by no tile and each tile (or one for all).
    """

    edges: bool
    reach_m: float
    blur_m: float
    robots_differ: bool
    first: NDArray[np.int64]
    per_robot: NDArray[np.int64]
    factors: NDArray[np.float64]
    shares_below: NDArray[np.float64]


@kernel
def tile_below(x_m: float, y_m: float, place: Place) -> int:
    """Return the index of the tile under a point; -1 if there is none (as ``Floor.tile_at``, with the top edge)."""
    column = np.floor((x_m - place.left_m) / place.width_m)
    row = np.floor((place.top_m - y_m) / place.height_m)
    if column >= 0 and row >= 0 and column < place.columns and row < place.rows:
        index: int = int(row) * place.columns + int(column)
        return index
    return -1


@kernel
def nearest_of_kind(
    x_m: float, y_m: float, kind: int, within_m: float, place: Place, tiles: NDArray[np.uint8]
) -> tuple[int, float]:
    """Return the nearest tile of this kind and its distance, m; (-1, inf) if none is ``within_m``."""
    best, tile = np.inf, -1
    first_column = max(int(np.floor((x_m - within_m - place.left_m) / place.width_m)), 0)
    last_column = min(int(np.floor((x_m + within_m - place.left_m) / place.width_m)), place.columns - 1)
    first_row = max(int(np.floor((place.top_m - y_m - within_m) / place.height_m)), 0)
    last_row = min(int(np.floor((place.top_m - y_m + within_m) / place.height_m)), place.rows - 1)
    for row in range(first_row, last_row + 1):
        above = y_m - (place.top_m - row * place.height_m)
        up = max(above, -place.height_m - above, 0.0)
        for column in range(first_column, last_column + 1):
            index = row * place.columns + column
            if tiles[index] == kind:
                before = place.left_m + column * place.width_m - x_m
                across = max(before, -place.width_m - before, 0.0)
                distance = math.sqrt(across * across + up * up)  # ten times faster than math.hypot
                if distance < best and distance <= within_m:
                    best, tile = distance, index
    return tile, best


@kernel
def vibration_probability(
    x_m: float, y_m: float, at: int, place: Place, tiles: NDArray[np.uint8], reach_m: float, blur_m: float
) -> tuple[float, int]:
    """Return the probability that a sample here senses vibration, and the nearest tile of the other kind (-1: none
    near)."""
    past_m, edge_tile = past_edge(x_m, y_m, at, place, tiles, reach_m, blur_m)
    if edge_tile < 0:
        return (1.0 if at >= 0 and tiles[at] == 1 else 0.0), edge_tile
    return share_past(past_m, blur_m), edge_tile


@kernel
def past_edge(
    x_m: float, y_m: float, at: int, place: Place, tiles: NDArray[np.uint8], reach_m: float, blur_m: float
) -> tuple[float, int]:
    """Return how far a sample lies within the vibrating region as sensed, m, and the nearest tile of the other kind.

    The distance is negative outside that region. If no tile of the other kind is near, it is infinite and the tile -1.
    """
    on_vibrating = at >= 0 and tiles[at] == 1
    within_m = abs(reach_m) + FAR * blur_m
    edge_tile, distance = nearest_of_kind(x_m, y_m, 0 if on_vibrating else 1, within_m, place, tiles)
    return reach_m + distance if on_vibrating else reach_m - distance, edge_tile


@kernel
def share_past(past_m: float, blur_m: float) -> float:
    """Return the probability that a sample this far past the middle of an edge senses vibration."""
    if blur_m > 0.0:
        return 0.5 * math.erfc(-past_m / blur_m * math.sqrt(0.5))
    return 1.0 if past_m > 0.0 else 0.0


@kernel
def sensed_tile(
    x_m: float, y_m: float, at: int, place: Place, tiles: NDArray[np.uint8], response: Response,
    seed: int, run: int, robot: int, sample: int,
) -> int:  # fmt: skip
    """Return the tile that a sample senses: the one below (``at``) or, near an edge, the nearest of the other
    kind."""
    if not response.edges:
        return at
    past_m, edge_tile = past_edge(x_m, y_m, at, place, tiles, response.reach_m, response.blur_m)
    if edge_tile < 0:
        return at
    u = uniform(seed, run, robot, SENSING, sample, OF_EDGE)
    # Far from the edge nearly all draws can do without the error function.
    if abs(past_m) > CLEAR * response.blur_m and CLEAR_SHARE < u < 1.0 - CLEAR_SHARE:
        vibrates = past_m > 0.0
    else:
        vibrates = u < share_past(past_m, response.blur_m)
    return at if vibrates == (at >= 0 and tiles[at] == 1) else edge_tile


@kernel
def factor_row(response: Response, r: int, robot: int, sensed: int) -> int:
    """Return the row of factors and shares of a robot on a tile in the r-th run."""
    row: int = response.first[r]
    if response.robots_differ:
        row += robot * response.per_robot[r]
    if response.per_robot[r] > 1:
        row += sensed + 1
    return row


def factors_differ(sensor: Sensor) -> bool:
    """Return whether tiles or robots have factors of their own."""
    return sensor.tile_spread is not None or sensor.robot_spread is not None


def response_of(scenario: Scenario, seed: int, runs: NDArray[np.int64], tiles: Sequence[int]) -> Response:
    """Return the sensor response in these runs; ``tiles``: number of tiles of each run's floor."""
    sensor = scenario.sensor
    count = len(tiles)
    if not factors_differ(sensor):
        first, per_robot, factors = np.zeros(count, np.int64), np.ones(count, np.int64), np.ones(1)
        shares = np.array([[share_below(sensor, False), share_below(sensor, True)]])
    else:
        rows = []
        for run, size in zip(runs.tolist(), tiles, strict=True):
            rows.append(_factors(scenario, seed, run, size))
        factors = np.concatenate(rows) if rows else np.ones(1)
        first = np.cumsum([0, *(len(row) for row in rows)])[:count]
        per_robot = np.array([size + 1 if sensor.tile_spread else 1 for size in tiles], dtype=np.int64)
        shares = np.column_stack([shares_below(sensor, kind, factors) for kind in (False, True)])
    return Response(
        edges=sensor.edge_reach_m is not None or sensor.edge_blur_m is not None,
        reach_m=sensor.edge_reach_m or 0.0,
        blur_m=sensor.edge_blur_m or 0.0,
        robots_differ=sensor.robot_spread is not None,
        first=first,
        per_robot=per_robot,
        factors=factors,
        shares_below=np.ascontiguousarray(shares),
    )


def _factors(scenario: Scenario, seed: int, run: int, tiles: int) -> NDArray[np.float64]:
    """Return the factors of a run: robots (or one) x no tile and tiles (or one), flattened."""
    sensor = scenario.sensor
    of_tile, of_robot = np.ones(1), np.ones(1)
    if sensor.tile_spread is not None:
        number = run if scenario.floor.redraw == "run" else 0
        of_tile = np.append(1.0, _log_normal(factor_numbers(seed, number, tiles, False), sensor.tile_spread))
    if sensor.robot_spread is not None:
        of_robot = _log_normal(factor_numbers(seed, run, scenario.swarm.robots, True), sensor.robot_spread)
    return np.asarray(np.outer(of_robot, of_tile).ravel())


def _log_normal(u: NDArray[np.float64], spread: float) -> NDArray[np.float64]:
    from scipy.special import ndtri

    return np.asarray(np.exp(spread * ndtri(u) - 0.5 * spread**2))


def factor_numbers(seed: int, run: int, count: int, robots: bool) -> NDArray[np.float64]:
    """Return the uniform numbers of the factors of ``count`` robots or tiles."""
    out = np.empty(count)
    _fill_factor_numbers(seed, run, robots, out)
    return out


@kernel
def _fill_factor_numbers(seed: int, run: int, robots: bool, out: NDArray[np.float64]) -> None:
    for k in range(out.size):
        robot, tile = (k, 0) if robots else (0, k)
        out[k] = uniform(seed, run, robot, HARDWARE, tile, OF_SENSOR if robots else OF_TILE)


FITTED_ON_M: Final = 0.2
"""Side of the tiles of the recordings."""


def edge_warnings(scenario: Scenario) -> list[str]:
    """Return a warning if the scenario has the fitted edges on tiles smaller than ``FITTED_ON_M``."""
    if not _has_fitted_edges(scenario.sensor):
        return []
    side_m = shorter_side_m(scenario.floor, scenario.arena.width_m, scenario.arena.height_m)
    if side_m >= FITTED_ON_M * (1.0 - 1e-9):
        return []
    reach_mm = 1000.0 * (scenario.sensor.edge_reach_m or 0.0)
    return [
        f"vibration reaches {reach_mm:.0f} mm beyond edges, as fitted on tiles of {1000 * FITTED_ON_M:.0f} mm; on "
        f"these of {1000 * side_m:.3g} mm that is an extrapolation"
    ]


def shorter_side_m(floor: FloorField, width_m: float, height_m: float) -> float:
    """Return the shorter side of a tile, m, in an arena of this size."""
    tiles, _ = floor.tiles_for(0, 0)
    rows, columns = tiles.shape
    return min(floor.tile_width_m or width_m / columns, floor.tile_height_m or height_m / rows)


@cache
def _has_fitted_edges(sensor: Sensor) -> bool:
    fitted = preset("calibrated").sensor
    return (sensor.edge_reach_m, sensor.edge_blur_m) == (fitted.edge_reach_m, fitted.edge_blur_m)
