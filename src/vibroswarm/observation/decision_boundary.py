"""The share of ones against which robots test their readings: the boundary as seen through their sensors.

| name | symbol | unit | equation |
|---|---|---|---|
| decision boundary | x | - | the question: does more than this share of the tiles vibrate? |
| false positive, false negative | a, b | - | of the sensor, away from edges |
| share sensed | h(x) | - | probability that a sample at a uniformly random place in the arena senses vibration |
| boundary of readings | q(x) | - | h (1 - b) + (1 - h) a; for a plain sensor on a tiled arena x (1 - b) + (1 - x) a |
| assumed rates | a', b' | - | q = v (1 - b') + (1 - v) a', v = x times the tiled share of the arena |

With ``decision.boundary_of = "readings"`` (the study) robots test the share of ones against x itself, which asks the
question of the tiles only where the errors balance at x. With "tiles" they test it against q(x).

h is a mean over random floors: floors of this grid, every choice of x N vibrating tiles among the N alike (between
whole numbers of tiles the same formula is used). A place near edges senses the tile below it or the nearest tile of the
other kind (``edge_response``), so that only the order of the tiles near it, by distance, matters.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, inner, kernel
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.edge_response import FAR, Place, place_of, share_past, vibration_probability
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.scenario.fields import Arena, FloorField, Sensor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import is_neutral_at_half_only

GRID = 40
"""Points along a tile's side at which sensing is averaged, or along each part of it that lies near an edge."""
MAX_NEIGHBOURS = 400
"""Limit on the tiles near one place in the mean over random floors."""

Geometry = tuple[int, int, float, float, float, float]
"""``Floor.geometry``."""
Size = tuple[float, float]
"""Width and height of the arena, m."""


class SensedShares(NamedTuple):
    """Shares of the arena's area: vibrating; vibrating and sensed as such; still but sensed as vibrating."""

    vibrating: float
    detected: float
    spillover: float


def readings_boundary(scenario: Scenario) -> float:
    """Return the share of ones that a robot's belief is about, in (0, 1).

    Raises:
        InputError: ``boundary_of = "tiles"`` and error rates that sum to 1 or more; or soft feedback with a boundary
            other than 1/2.
    """
    decision = scenario.decision
    x = decision.decision_boundary
    if decision.boundary_of == "readings":
        return x
    assumed = (decision.assumed_false_positive, decision.assumed_false_negative)
    tested = _expected_at(scenario, x, assumed)
    if is_neutral_at_half_only(scenario) and tested != 0.5:
        raise InputError(
            f"{scenario.strategy.name} feedback is neutral at a boundary of 0.5 only, and this one is tested at "
            f"{tested:.4f} of the readings; "
            'set decision.boundary_of = "readings", or another strategy',
            field="strategy.name",
        )
    return tested


def expected_ones(scenario: Scenario, fill_ratio: float) -> float:
    """Return q: the share of ones expected of random floors of this fill ratio, by the sensor's own rates.

    Raises:
        InputError: edges that reach over too many tiles.
    """
    return _expected(scenario.sensor, geometry_of(scenario), _size(scenario), fill_ratio)


def expected_ones_on(sensor: Sensor, floor: Floor, size: Size) -> float:
    """Return the expected share of ones among samples at uniformly random places in an arena of this size (m)."""
    false_alarm, miss = error_rates(sensor)
    sensed = sensed_shares_on(sensor, floor, size)
    felt = sensed.detected + sensed.spillover
    return felt * (1.0 - miss) + (1.0 - felt) * false_alarm


def sensed_shares_on(sensor: Sensor, floor: Floor, size: Size, grid: int = GRID) -> SensedShares:
    """Return the sensed shares of an arena of this size (m) with one floor; ``grid``: points per tile side near
    edges."""
    rows, columns, width_m, height_m, left_m, bottom_m = floor.geometry
    tiled = tiled_share(floor.geometry, size)
    fill = floor.fill_ratio_within(*size)
    if not _edges(sensor):
        return SensedShares(tiled * fill, tiled * fill, 0.0)
    reach_m, blur_m = sensor.edge_reach_m or 0.0, sensor.edge_blur_m or 0.0
    within_m = abs(reach_m) + FAR * blur_m
    x = _points(columns, width_m, left_m, size[0], within_m, grid, every=True)
    y = _points(rows, height_m, bottom_m, size[1], within_m, grid, every=True)
    detected, spillover = _sensed_areas(*x, *y, place_of(floor), floor.tiles.ravel(), reach_m, blur_m)
    return SensedShares(tiled * fill, detected / (size[0] * size[1]), spillover / (size[0] * size[1]))


def mean_sensed_shares(
    sensor: Sensor, geometry: Geometry, size: Size, fill_ratio: float, grid: int = GRID
) -> SensedShares:
    """Return the mean of ``sensed_shares_on`` over random floors of this grid and fill ratio.

    Raises:
        InputError: edges that reach over too many tiles.
    """
    rows, columns, width_m, height_m, left_m, bottom_m = geometry
    vibrating = tiled_share(geometry, size) * fill_ratio
    if not _edges(sensor):
        return SensedShares(vibrating, vibrating, 0.0)
    reach_m, blur_m = sensor.edge_reach_m or 0.0, sensor.edge_blur_m or 0.0
    within_m = abs(reach_m) + FAR * blur_m
    neighbours = (2 * within_m / width_m + 2) * (2 * within_m / height_m + 2)
    if min(neighbours, rows * columns) > MAX_NEIGHBOURS:
        raise InputError(
            f"edges sensed {within_m:g} m away reach over too many tiles of {width_m:g} m x {height_m:g} m for "
            'decision.boundary_of = "tiles"; give decision.assumed_false_positive and assumed_false_negative',
            field="sensor.edge_reach_m",
        )
    x = _points(columns, width_m, left_m, size[0], within_m, grid)
    y = _points(rows, height_m, bottom_m, size[1], within_m, grid)
    place = Place(rows, columns, width_m, height_m, left_m, bottom_m + rows * height_m)
    detected, spillover = _mean_sensed_areas(
        *x, *y, place, fill_ratio * rows * columns, reach_m, blur_m, within_m
    )
    return SensedShares(vibrating, detected / (size[0] * size[1]), spillover / (size[0] * size[1]))


def tiled_share(geometry: Geometry, size: Size) -> float:
    """Return the share of the arena's area (width and height in m, from 0, 0) that lies on tiles."""
    rows, columns, tile_width, tile_height, left, bottom = geometry
    across = min(left + columns * tile_width, size[0]) - max(left, 0.0)
    up = min(bottom + rows * tile_height, size[1]) - max(bottom, 0.0)
    return min(max(across, 0.0) * max(up, 0.0) / (size[0] * size[1]), 1.0)


def _expected_at(scenario: Scenario, x: float, given: tuple[float | None, float | None]) -> float:
    """Return q(x) by the rates that robots assume.

    A rate that is not given is the sensor's, averaged over uniformly random places on floors at the boundary.
    """
    sensor, size = scenario.sensor, _size(scenario)
    sensed = _mean_sensed_shares_cached(sensor, geometry_of(scenario), size, x)
    v = sensed.vibrating
    a, b = error_rates(sensor)
    of_still = sensed.spillover / (1.0 - v) if v < 1.0 else 0.0
    of_vibrating = sensed.detected / v if v > 0.0 else 1.0
    positive, negative = given
    if positive is None:
        positive = of_still * (1.0 - b) + (1.0 - of_still) * a
    if negative is None:
        negative = of_vibrating * b + (1.0 - of_vibrating) * (1.0 - a)
    if positive + negative >= 1.0:
        raise InputError(
            f'"tiles" needs readings that tell: the rates of false positives ({positive:.3g}) and of false negatives '
            f"({negative:.3g}) have to sum to less than 1; change sensor.rms_threshold, or the assumed rates",
            field="decision.boundary_of",
        )
    return v * (1.0 - negative) + (1.0 - v) * positive


def _expected(sensor: Sensor, geometry: Geometry, size: Size, fill_ratio: float) -> float:
    a, b = error_rates(sensor)
    sensed = _mean_sensed_shares_cached(sensor, geometry, size, fill_ratio)
    share = sensed.detected + sensed.spillover
    return share * (1.0 - b) + (1.0 - share) * a


@lru_cache(maxsize=256)
def _mean_sensed_shares_cached(
    sensor: Sensor, geometry: Geometry, size: Size, fill_ratio: float
) -> SensedShares:
    return mean_sensed_shares(sensor, geometry, size, fill_ratio)


def geometry_of(scenario: Scenario) -> Geometry:
    """Return the rows, columns, tile size and position of a scenario's grid of tiles, m."""
    return _geometry(scenario.floor, scenario.arena)


@lru_cache(maxsize=64)
def _geometry(floor: FloorField, arena: Arena) -> Geometry:
    return floor.placed_in(arena, 0, 0).geometry


def _size(scenario: Scenario) -> Size:
    return scenario.arena.width_m, scenario.arena.height_m


def _edges(sensor: Sensor) -> bool:
    return sensor.edge_reach_m is not None or sensor.edge_blur_m is not None


Points = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]
"""Coordinates along one side of the arena, m; the length that each represents, m; its lane of tiles, -1: none."""


def _points(
    count: int, size_m: float, first_m: float, arena_m: float, within_m: float, grid: int, every: bool = False
) -> Points:
    """Return midpoints along one side; lanes with equal surroundings are represented by one unless ``every``.

    Lanes are counted from the lower end. Beyond ``within_m`` off the floor nothing is sensed, and there are no
    points.
    """
    reach_tiles = int(np.ceil(within_m / size_m))
    at: list[NDArray[np.float64]] = []
    length: list[NDArray[np.float64]] = []
    lane: list[NDArray[np.int64]] = []
    alike: int | None = None
    repeated = 1
    for number in range(count):
        low, high = first_m + number * size_m, first_m + (number + 1) * size_m
        fits = low >= -1e-12 * arena_m and high <= arena_m * (1 + 1e-12)
        if fits and not every and reach_tiles <= number < count - reach_tiles:
            if alike is not None:
                repeated += 1
                continue
            alike, repeated = len(at), 1
        points = _within_lane(low, high, max(low, 0.0), min(high, arena_m), within_m, grid)
        at.append(points[0])
        length.append(points[1])
        lane.append(np.full(points[0].size, number))
    if alike is not None:
        length[alike] *= repeated
    end_m = first_m + count * size_m
    for low, high in ((max(first_m - within_m, 0.0), first_m), (end_m, min(end_m + within_m, arena_m))):
        if high > low:
            at.append(_midpoints(low, high, grid))
            length.append(np.full(grid, (high - low) / grid))
            lane.append(np.full(grid, -1))
    return np.concatenate(at), np.concatenate(length), np.concatenate(lane)


def _within_lane(
    low: float, high: float, first: float, last: float, within_m: float, grid: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return midpoints of a lane from ``low`` to ``high``, clipped to ``first`` and ``last``, and their lengths.

    Farther than ``within_m`` from both sides their edges are not sensed: one point represents all places there,
    so that points are dense only where it matters, however large the tile.
    """
    if high - low > 2 * within_m:
        ends = (low, low + within_m, high - within_m, high)
        parts = [(ends[0], ends[1], grid), (ends[1], ends[2], 1), (ends[2], ends[3], grid)]
    else:
        parts = [(low, high, grid)]
    at, length = [np.empty(0)], [np.empty(0)]
    for start, end, points in parts:
        start, end = max(start, first), min(end, last)
        if end > start:
            at.append(_midpoints(start, end, points))
            length.append(np.full(points, (end - start) / points))
    return np.concatenate(at), np.concatenate(length)


def _midpoints(low: float, high: float, grid: int) -> NDArray[np.float64]:
    return low + (np.arange(grid) + 0.5) * (high - low) / grid


@kernel
def _sensed_areas(
    x_m: NDArray[np.float64],
    x_length_m: NDArray[np.float64],
    column: NDArray[np.int64],
    y_m: NDArray[np.float64],
    y_length_m: NDArray[np.float64],
    lane: NDArray[np.int64],
    place: Place,
    tiles: NDArray[np.uint8],
    reach_m: float,
    blur_m: float,
) -> tuple[float, float]:
    """Return two areas, m2, that are sensed as vibrating: that which vibrates, and that which does not.

    ``lane`` counts rows from below.
    """
    detected = spillover = 0.0
    for j in range(y_m.size):
        for i in range(x_m.size):
            at = -1
            if column[i] >= 0 and lane[j] >= 0:
                at = (place.rows - 1 - lane[j]) * place.columns + column[i]
            share, _ = vibration_probability(x_m[i], y_m[j], at, place, tiles, reach_m, blur_m)
            area = share * x_length_m[i] * y_length_m[j]
            if at >= 0 and tiles[at] == 1:
                detected += area
            else:
                spillover += area
    return detected, spillover


@allocating_kernel
def _mean_sensed_areas(
    x_m: NDArray[np.float64],
    x_length_m: NDArray[np.float64],
    column: NDArray[np.int64],
    y_m: NDArray[np.float64],
    y_length_m: NDArray[np.float64],
    lane: NDArray[np.int64],
    place: Place,
    vibrating: float,
    reach_m: float,
    blur_m: float,
    within_m: float,
) -> tuple[float, float]:
    """Return the mean of ``_sensed_areas`` over all placements of ``vibrating`` tiles on the grid."""
    tiles = float(place.rows * place.columns)
    detected = spillover = 0.0
    distance = np.empty(MAX_NEIGHBOURS)
    for j in range(y_m.size):
        for i in range(x_m.size):
            row = place.rows - 1 - lane[j] if lane[j] >= 0 else -1
            on = column[i] >= 0 and row >= 0
            distances = _distances(
                x_m[i], y_m[j], row if on else -1, column[i] if on else -1, within_m, place, distance
            )
            area = x_length_m[i] * y_length_m[j]
            # The tile below, if any, is not among the others.
            other_tiles = tiles - 1.0 if on else tiles
            if on:
                share = vibrating / tiles
                inside = _nearest(
                    distance, distances, other_tiles - (vibrating - 1.0), other_tiles, reach_m, blur_m, 1.0
                )
                detected += area * share * inside
                area *= 1.0 - share
            spillover += area * _nearest(distance, distances, vibrating, other_tiles, reach_m, blur_m, -1.0)
    return detected, spillover


@inner
def _distances(
    x_m: float, y_m: float, row: int, column: int, within_m: float, place: Place, out: NDArray[np.float64]
) -> int:
    """Fill in increasing distances to the tiles within ``within_m`` except (row, column); return their number."""
    count = 0
    first_column = max(int(np.floor((x_m - within_m - place.left_m) / place.width_m)), 0)
    last_column = min(int(np.floor((x_m + within_m - place.left_m) / place.width_m)), place.columns - 1)
    first_row = max(int(np.floor((place.top_m - y_m - within_m) / place.height_m)), 0)
    last_row = min(int(np.floor((place.top_m - y_m + within_m) / place.height_m)), place.rows - 1)
    for r in range(first_row, last_row + 1):
        above = y_m - (place.top_m - r * place.height_m)
        up = max(above, -place.height_m - above, 0.0)
        for c in range(first_column, last_column + 1):
            if r == row and c == column:
                continue
            before = place.left_m + c * place.width_m - x_m
            across = max(before, -place.width_m - before, 0.0)
            d = np.sqrt(across * across + up * up)
            if d <= within_m and count < out.size:
                k = count
                while k > 0 and out[k - 1] > d:
                    out[k] = out[k - 1]
                    k -= 1
                out[k] = d
                count += 1
    return count


@inner
def _nearest(
    distance: NDArray[np.float64],
    near: int,
    of_kind: float,
    tiles: float,
    reach_m: float,
    blur_m: float,
    sign: float,
) -> float:
    """Return the probability of sensing vibration at a place, averaged over the placements of tiles.

    It depends on the nearest tile of the other kind than the place. If none of the ``near`` tiles is of that kind, it
    is 1 on a vibrating tile and 0 elsewhere.

    Args:
        distance: increasing distances to tiles, m, of which the first ``near`` count.
        of_kind: how many of ``tiles`` tiles are of the other kind. sign: 1 on a vibrating tile, -1 elsewhere.
    """
    total, none_before = 0.0, 1.0
    for k in range(near):
        is_of_kind = min(max(of_kind / (tiles - k), 0.0), 1.0) if tiles > k else 0.0
        total += none_before * is_of_kind * share_past(reach_m + sign * distance[k], blur_m)
        none_before *= 1.0 - is_of_kind
    return total + (none_before if sign > 0.0 else 0.0)
