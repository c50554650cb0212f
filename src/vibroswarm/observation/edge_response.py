"""Which tile a sample senses, and the factor of its energy: extensions that the paper's sensor lacks.

| name | symbol | unit | shape | equation |
|---|---|---|---|---|
| distance to the edge | d | m | scalar | to the nearest vibrating tile; on one: minus that to the nearest still one |
| sensed as vibrating | - | 0, 1 | scalar | v < Phi((reach - d) / blur), with v a uniform number of this sample |
| factor | c | - | (rows,) | exp(s z - s^2 / 2) of the tile sensed, times that of the robot; z standard normal |

A sample near an edge senses the tile below or the nearest tile of the other kind, never a mixture of both: in the
recordings, energies on still tiles within 10 mm of a vibrating tile are those of one kind or the other, not in between.
On a tile, only edges between tiles count, not the floor's outer edge. A place on no tile counts as still (its tile has
index -1), so near a vibrating tile it may sense that tile.
In the functions a sample's place is (``x_m``, ``y_m``), ``place`` is the position of the floor and of its grid, and
``tiles`` holds the kinds of its tiles (1 vibrating, 0 still), row by row from the top.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.elementary import exp
from vibroswarm.core.jit import inner, kernel
from vibroswarm.core.rng import HARDWARE, OF_EDGE, OF_SENSOR, OF_TILE, SENSING, uniform
from vibroswarm.floors.floor import Floor, Place
from vibroswarm.floors.surfaces import edge_distance
from vibroswarm.observation.energy_model import factors_differ, model_of, shares_below
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.sensors import SensorModel

FAR = 6.0
"""An edge is taken not to be sensed from farther than its reach plus FAR blurs: one sample in 10^9 would sense it."""


class Response(NamedTuple):
    """Response of the sensors to edges, and the factors of their energies, as the kernels read it."""

    edges: bool
    """Whether edges matter."""
    reach_m: float
    """Distance outside a vibrating tile at which half of the samples sense vibration, m (negative: inside the tile)."""
    blur_m: float
    """Standard deviation of the transition at an edge, m."""
    robots_differ: bool
    """Whether each robot has rows of its own in ``factors`` and ``shares_below``; if not, all use the same rows."""
    per_robot: int
    """Number of rows of each robot: one for places on no tile and then one for each tile; a single row if tiles do not
    differ."""
    factors: NDArray[np.float64]
    """(rows,): factors of the energy."""
    shares_below: NDArray[np.float64]
    """(rows, levels, classes - 1): share of samples at each level that read as each class or a lower one, with values
    multiplied by the row's factor; for two kinds and classes F(theta_E) on still and on vibrating tiles."""
    levels: NDArray[np.float64]
    """(levels,): the kinds of the sensor, then the contrasts between still and vibrating that occur."""
    patches: NDArray[np.float64]
    """(patches, 6): x, y, width, height (m) of each patch, 1 if it is a disc, and the index of its level."""


@inner
def tiles_around(x_m: float, y_m: float, within_m: float, place: Place) -> tuple[int, int, int, int]:
    """Return the first and last column, and the first and last row, of a floor that a square around a point touches."""
    return (
        max(int(np.floor((x_m - within_m - place.left_m) / place.width_m)), 0),
        min(int(np.floor((x_m + within_m - place.left_m) / place.width_m)), place.columns - 1),
        max(int(np.floor((place.top_m - y_m - within_m) / place.height_m)), 0),
        min(int(np.floor((place.top_m - y_m + within_m) / place.height_m)), place.rows - 1),
    )


@kernel
def nearest_of_kind(
    x_m: float, y_m: float, kind: int, within_m: float, place: Place, tiles: NDArray[np.uint8]
) -> tuple[int, float]:
    """Return the index (the lowest of several) of the nearest tile of a kind, and its distance, m; -1 and inf: none."""
    best, tile = np.inf, -1
    first_column, last_column, first_row, last_row = tiles_around(x_m, y_m, within_m, place)
    for row in range(first_row, last_row + 1):
        # How far the point lies above the row's upper side and left of the column's left side (``above``, ``before``;
        # negative: below or right of it). ``up``, ``across``: distances to the tile along y and x, 0 within its row or
        # column.
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
    """Return the probability that a sample at a point senses vibration, and the tile beyond the nearest edge."""
    past_m, edge_tile = past_edge(x_m, y_m, at, place, tiles, reach_m, blur_m)
    if edge_tile < 0:
        return (1.0 if at >= 0 and tiles[at] == 1 else 0.0), edge_tile
    return share_past(past_m, blur_m), edge_tile


@kernel
def past_edge(
    x_m: float, y_m: float, at: int, place: Place, tiles: NDArray[np.uint8], reach_m: float, blur_m: float
) -> tuple[float, int]:
    """Return how far a point lies inside the region that is mostly sensed as vibrating, and the tile beyond the edge.

    This region consists of the vibrating tiles, grown by ``reach_m`` across the edges to still tiles (shrunk if it is
    negative). The floor's outer edge counts only for points on no tile, where a vibrating tile is near.
    """
    on_vibrating = at >= 0 and tiles[at] == 1
    within_m = abs(reach_m) + FAR * blur_m
    edge_tile, distance = nearest_of_kind(x_m, y_m, 0 if on_vibrating else 1, within_m, place, tiles)
    return reach_m + distance if on_vibrating else reach_m - distance, edge_tile


@kernel
def share_past(past_m: float, blur_m: float) -> float:
    """Return the probability that a sample senses vibration: Phi(past_m / blur_m)."""
    if blur_m > 0.0:
        return 0.5 * math.erfc(-past_m / blur_m * math.sqrt(0.5))
    return 1.0 if past_m > 0.0 else 0.0


@kernel
def sensed_tile(
    x_m: float, y_m: float, at: int, place: Place, tiles: NDArray[np.uint8], response: Response,
    seed: int, run: int, robot: int, sample: int,
) -> int:  # fmt: skip
    """Return the index of the tile that a sample senses: the one below or, near an edge, the nearest other one."""
    if not response.edges:
        return at
    past_m, edge_tile = past_edge(x_m, y_m, at, place, tiles, response.reach_m, response.blur_m)
    if edge_tile < 0:
        return at
    vibrates = uniform(seed, run, robot, SENSING, sample, OF_EDGE) < share_past(past_m, response.blur_m)
    # ``edge_tile`` is of the other kind than the tile below.
    return at if vibrates == (at >= 0 and tiles[at] == 1) else edge_tile


@inner
def patched_kind(
    x_m: float,
    y_m: float,
    kind: int,
    response: Response,
    seed: int,
    run: int,
    robot: int,
    sample: int,
) -> int:
    """Return the kind of the patch that a sample senses; ``kind``, that of the tile, if it senses none."""
    for k in range(response.patches.shape[0]):
        patch = response.patches[k]
        beyond = edge_distance(abs(x_m - patch[0]), abs(y_m - patch[1]), patch[2], patch[3], patch[4] > 0.0)
        if not response.edges:
            if beyond < 0.0:
                return int(patch[5])
        elif beyond < response.reach_m + FAR * response.blur_m:
            u = uniform(seed, run, robot, SENSING, sample, OF_EDGE)
            if u < share_past(response.reach_m - beyond, response.blur_m):
                return int(patch[5])
    return kind


@kernel
def factor_row(response: Response, robot: int, sensed: int) -> int:
    """Return the index of the row of ``response.factors`` and ``shares_below`` that a sample uses."""
    row = robot * response.per_robot if response.robots_differ else 0  # each robot has a block of rows
    # if tiles differ, the first row of a block is that of no tile, -1
    return row + sensed + 1 if response.per_robot > 1 else row


def levels_on(sensor: Sensor, floors: Iterable[Floor]) -> NDArray[np.float64]:
    """Return the levels that the sensor has, and the contrasts that occur on floors (``Response.levels``)."""
    found = [np.append(floor.levels, [patch.contrast for patch in floor.patches]) for floor in floors]
    contrasts = np.unique(np.concatenate([np.zeros(0), *found]))
    return np.append(np.arange(sensor.kinds), contrasts[contrasts % 1.0 > 0.0])


def index_of(level: ArrayLike, levels: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the index of each of some levels among all, in their shape."""
    order = np.argsort(levels)
    return order[np.searchsorted(levels, level, sorter=order)].astype(np.uint8)


def response_of(
    scenario: Scenario, seed: int, run: int, floor: Floor, levels: NDArray[np.float64]
) -> Response:
    """Return the response of the sensors in a run on its floor."""
    sensor = scenario.sensor
    # With redraw = "study" all runs use the floor of run 0, with that floor's factors. With redraw = "run" each run
    # draws its own factors, even if the floor's tiles are fixed.
    drawn = (run, run if scenario.floor.redraw == "run" else 0) if factors_differ(sensor) else (0, 0)
    of_floor = seed, *drawn, floor.levels.size, scenario.swarm.robots
    factors, shares = _factors_and_shares(sensor, model_of(sensor), tuple(levels.tolist()), *of_floor)
    patches = [
        (p.x_m, p.y_m, p.width_m, p.height_m, p.is_disc, index_of(p.contrast, levels)) for p in floor.patches
    ]
    return Response(
        edges=sensor.edge_reach_m is not None or sensor.edge_blur_m is not None,
        reach_m=sensor.edge_reach_m or 0.0,
        blur_m=sensor.edge_blur_m or 0.0,
        robots_differ=sensor.robot_spread is not None,
        per_robot=1 if sensor.tile_spread is None else floor.levels.size + 1,
        factors=factors,
        shares_below=shares,
        levels=levels,
        patches=np.array(patches, dtype=np.float64).reshape(-1, 6),
    )


@lru_cache(maxsize=256)
def _factors_and_shares(
    sensor: Sensor, model: SensorModel, levels: tuple[float, ...], seed: int, run: int, of_floor: int, tiles: int,
    robots: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """Return factors and shares of a run: a block a robot, of no tile first, then each tile; cached, as cells share
    them.
    """
    of_tile, of_robot = np.ones(1), np.ones(1)
    if sensor.tile_spread is not None:
        drawn = _log_normal(_fill_numbers(seed, of_floor, False, np.empty(tiles)), sensor.tile_spread)
        of_tile = np.append(1.0, drawn)  # 1.0 for places on no tile
    if sensor.robot_spread is not None:
        of_robot = _log_normal(_fill_numbers(seed, run, True, np.empty(robots)), sensor.robot_spread)
    factors = np.outer(of_robot, of_tile).ravel()
    # A sensor that depends on the place is read sample by sample (``observe``), so that no shares are needed.
    if model.sense is not None:
        return factors, np.zeros((1, sensor.kinds, sensor.readings - 1))
    return factors, np.ascontiguousarray(shares_below(sensor, factors, np.array(levels)))


@kernel
def _fill_numbers(seed: int, run: int, robots: bool, out: NDArray[np.float64]) -> NDArray[np.float64]:
    """Write the uniform numbers from which factors of robots, or of tiles, are drawn, and return them."""
    for k in range(out.size):
        robot, tile = (k, 0) if robots else (0, k)
        out[k] = uniform(seed, run, robot, HARDWARE, tile, OF_SENSOR if robots else OF_TILE)
    return out


def _log_normal(u: NDArray[np.float64], spread: float) -> NDArray[np.float64]:
    """Return the quantiles ``u`` of a log-normal distribution of mean 1, whose logarithm has this spread."""
    from scipy.special import ndtri

    return exp(spread * ndtri(u) - 0.5 * spread**2)
