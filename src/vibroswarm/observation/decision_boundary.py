"""The share of ones against which robots test their readings: the boundary as seen through their sensors.

| name | symbol | unit | equation |
|---|---|---|---|
| decision boundary | x | - | the robots' question is: does more than this share of the tiles vibrate? |
| false positive, false negative | a, b | - | error rates of the sensor, away from edges |
| share sensed | h(x) | - | probability that a sample at a uniformly random place in the arena senses vibration |
| boundary of readings | q(x) | - | h (1 - b) + (1 - h) a; x (1 - b) + (1 - x) a without edges, on a tiled arena |
| assumed rates | a', b' | - | q = v (1 - b') + (1 - v) a', with v = x times the tiled share of the arena |

With ``decision.boundary_of = "readings"`` (the study) robots compare the share of ones among their readings with x
itself. This answers the question only if the sensor's errors balance at x, so that q(x) = x. With "tiles" they compare
the share of ones with q(x).

h is a mean over random floors with x N vibrating tiles among the N tiles of this grid; all choices of these tiles are
equally probable. If x N is not a whole number, the same formula is used. Near an edge a sample senses the tile below it
or the nearest tile of the other kind (``edge_response``). So the mean depends only on the order of the tiles near a
place, sorted by distance. "Lanes" are the columns of tiles along x, and the rows of tiles, counted from below, along y.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, inner, kernel
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, Place, place_at, place_of
from vibroswarm.observation.edge_response import FAR, share_past, tiles_around, vibration_probability
from vibroswarm.observation.energy_model import claimed_error_rates, error_rates, rates
from vibroswarm.scenario.fields import Arena, FloorField, Sensor
from vibroswarm.scenario.scenario import Scenario

GRID = 40
"""Number of points along a tile's side at which sensing is averaged. On a tile so large that its middle is out of reach
of edges, it is the number along each of the two parts near an edge."""
MAX_NEIGHBOURS = 400
"""Limit on the number of tiles near one place in the mean over random floors."""

Geometry = tuple[int, int, float, float, float, float]
"""Rows, columns, tile width and height, left and bottom of a floor (m), as ``Floor.geometry``."""
Size = tuple[float, float]
"""Width and height of the arena, m."""


class SensedShares(NamedTuple):
    """Shares of the arena's area."""

    vibrating: float
    """Share on vibrating tiles."""
    detected: float
    """Share on vibrating tiles that is sensed as vibrating."""
    spillover: float
    """Share on still tiles or no tile that is sensed as vibrating."""


def readings_boundary(scenario: Scenario) -> float:
    """Return the share of ones to test against, in (0, 1): x if ``boundary_of`` is "readings", q(x) if "tiles"."""
    decision = scenario.decision
    if decision.boundary_of == "readings":
        return decision.decision_boundary
    tested = _expected_at(scenario)
    # Sums of shares of tiles may be off by rounding.
    if scenario.strategy.entry.boundary_half and not math.isclose(tested, 0.5, rel_tol=1e-12):
        raise InputError(
            f"'{scenario.strategy.name}' is neutral at a boundary of 0.5 only, and this one is tested at "
            f'{tested:.4f} of the readings; choose another strategy, or decision.boundary_of = "readings"',
            field="strategy.name",
        )
    return tested


def expected_ones(scenario: Scenario, fill_ratio: float) -> float:
    """Return q: the share of ones expected on random floors of this fill ratio, by the sensor's true error rates."""
    geometry = geometry_of(scenario)
    sensed = mean_sensed_shares(scenario.sensor, geometry, scenario.arena.size_m, fill_ratio)
    return _ones(scenario.sensor, place_at(geometry), sensed)


def expected_ones_on(sensor: Sensor, floor: Floor, size: Size) -> float:
    """Return the expected share of ones among samples at uniformly random places of an arena with this floor."""
    if max(sensor.kinds, sensor.readings) > 2 or floor.has_contrasts or floor.patches:
        return float(expected_classes_on(sensor, floor, size)[1])
    return _ones(sensor, place_of(floor), sensed_shares_on(sensor, floor, size))


def expected_classes_on(sensor: Sensor, floor: Floor, size: Size) -> NDArray[np.float64]:
    """Return the expected share of each class among samples at uniformly random places, without edges, (classes,)."""
    tiled, (levels, share) = tiled_share(floor.geometry, size), floor.level_shares(*size)
    known, level = np.unique(levels, return_inverse=True)
    by_level = rates(sensor, place_of(floor), known)
    # ``level_shares`` has still tiles first
    return np.asarray(tiled * (share[:, None] * by_level[level]).sum(axis=0) + (1.0 - tiled) * by_level[0])


def sensed_shares_on(sensor: Sensor, floor: Floor, size: Size, grid: int = GRID) -> SensedShares:
    """Return the shares of an arena's area that vibrate and that are sensed as vibrating, for one floor."""
    return _sensed_shares(sensor, floor.geometry, size, floor.fill_ratio_within(*size), grid, floor.tiles)


@lru_cache(maxsize=256)
def mean_sensed_shares(
    sensor: Sensor, geometry: Geometry, size: Size, fill_ratio: float, grid: int = GRID
) -> SensedShares:
    """Return the mean shares of an arena's area that vibrate and are sensed so, over random floors of a fill ratio."""
    return _sensed_shares(sensor, geometry, size, fill_ratio, grid, None)


def _sensed_shares(
    sensor: Sensor, geometry: Geometry, size: Size, fill: float, grid: int, tiles: NDArray[np.uint8] | None
) -> SensedShares:
    """Return the shares of an arena's area on one floor, or without ``tiles`` their mean over random floors."""
    rows, columns, width_m, height_m, left_m, bottom_m = geometry
    vibrating = tiled_share(geometry, size) * fill
    if sensor.edge_reach_m is None and sensor.edge_blur_m is None:
        return SensedShares(vibrating, detected=vibrating, spillover=0.0)
    reach_m, blur_m = sensor.edge_reach_m or 0.0, sensor.edge_blur_m or 0.0
    within_m = abs(reach_m) + FAR * blur_m
    # Upper limit on the number of tiles that a square of side 2 within_m touches. The tiles within ``within_m`` of the
    # square's middle are among them.
    neighbours = (2 * within_m / width_m + 2) * (2 * within_m / height_m + 2)
    if tiles is None and min(neighbours, rows * columns) > MAX_NEIGHBOURS:
        raise InputError(
            f'{within_m:g} m is too far for decision.boundary_of = "tiles" on tiles of {width_m:g} m x {height_m:g} m; '
            "give decision.assumed_false_positive and assumed_false_negative",
            field="sensor.edge_reach_m",
        )
    # One floor has no symmetry, so all lanes need points of their own.
    x = _points(columns, width_m, left_m, size[0], within_m, grid, every=tiles is not None)
    y = _points(rows, height_m, bottom_m, size[1], within_m, grid, every=tiles is not None)
    if tiles is None:
        areas = _mean_sensed_areas(
            *x, *y, place_at(geometry), fill * rows * columns, reach_m, blur_m, within_m
        )
    else:
        areas = _sensed_areas(*x, *y, place_at(geometry), tiles.ravel(), reach_m, blur_m)
    return SensedShares(vibrating, *(area / (size[0] * size[1]) for area in areas))


def tiled_share(geometry: Geometry, size: Size) -> float:
    """Return the share of the arena's area that lies on tiles."""
    rows, columns, tile_width, tile_height, left, bottom = geometry
    across = min(left + columns * tile_width, size[0]) - max(left, 0.0)
    up = min(bottom + rows * tile_height, size[1]) - max(bottom, 0.0)
    # The limit is for rounding, which could give slightly more than 1.
    return min(max(across, 0.0) * max(up, 0.0) / (size[0] * size[1]), 1.0)


def _expected_at(scenario: Scenario) -> float:
    """Return q(x) by the assumed rates; a rate not given is the one claimed, with edges, over random floors."""
    sensor, decision = scenario.sensor, scenario.decision
    sensed = mean_sensed_shares(
        sensor, geometry_of(scenario), scenario.arena.size_m, decision.decision_boundary
    )
    v = sensed.vibrating
    # of false positives and of false negatives, away from edges
    a, b = claimed_error_rates(sensor, grid_of(scenario))
    positive, negative = decision.assumed_false_positive, decision.assumed_false_negative
    # A place has the bit 1 if it is sensed as vibrating and is no false negative, or if it is sensed as still and is a
    # false positive. A kind without any area gets the share that it would have without edges.
    if positive is None:
        of_still = sensed.spillover / (1.0 - v) if v < 1.0 else 0.0
        positive = of_still * (1.0 - b) + (1.0 - of_still) * a
    if negative is None:
        of_vibrating = sensed.detected / v if v > 0.0 else 1.0
        negative = of_vibrating * b + (1.0 - of_vibrating) * (1.0 - a)
    if positive + negative >= 1.0:
        raise InputError(
            f'"tiles" needs rates of false positives ({positive:.3g}) and negatives ({negative:.3g}) that sum to less '
            "than 1; change sensor.rms_threshold, or the assumed rates",
            field="decision.boundary_of",
        )
    return v * (1.0 - negative) + (1.0 - v) * positive


def _ones(sensor: Sensor, place: Place, sensed: SensedShares) -> float:
    """Return q, the share of ones expected by the sensor's true error rates."""
    a, b = error_rates(sensor, place)
    share = sensed.detected + sensed.spillover  # h
    return share * (1.0 - b) + (1.0 - share) * a


def geometry_of(scenario: Scenario) -> Geometry:
    """Return a scenario's grid of tiles: rows, columns, and tile width, tile height, left and bottom in m."""
    return _geometry(scenario.floor, scenario.arena)


def grid_of(scenario: Scenario) -> Place:
    """Return the same in the form that kernels use."""
    return place_at(geometry_of(scenario))


@lru_cache(maxsize=64)
def _geometry(floor: FloorField, arena: Arena) -> Geometry:
    """Return the geometry of the floor of seed 0 and run 0, which that of all runs equals."""
    return floor.placed_in(arena, 0, 0).geometry


Points = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]
"""Points along one side of the arena, in three arrays: coordinate, m; the length that the point represents, m; the lane
of tiles in which it lies, -1 beside the floor."""


def _points(
    count: int, size_m: float, first_m: float, arena_m: float, within_m: float, grid: int, every: bool = False
) -> Points:
    """Return the points along one side of the arena at which sensing is computed."""
    reach_tiles = int(np.ceil(within_m / size_m))
    lows_m = [first_m + number * size_m for number in range(count)]
    highs_m = [first_m + (number + 1) * size_m for number in range(count)]
    inner = [
        number
        for number in range(reach_tiles, count - reach_tiles)
        # A lane that does not lie inside the arena, up to rounding, has fewer points.
        if not every and lows_m[number] >= -1e-12 * arena_m and highs_m[number] <= arena_m * (1 + 1e-12)
    ]
    parts = [  # low, high, number of points, lane, number of lanes
        (max(low, 0.0), min(high, arena_m), points, number, len(inner) if number in inner else 1)
        for number in range(count)
        if number not in inner[1:]
        for low, high, points in _within_lane(lows_m[number], highs_m[number], within_m, grid)
    ]
    # The borders of the arena beside the floor.
    end_m = first_m + count * size_m
    parts.append((max(first_m - within_m, 0.0), first_m, grid, -1, 1))
    parts.append((end_m, min(end_m + within_m, arena_m), grid, -1, 1))
    parts = [part for part in parts if part[1] > part[0]]
    return (
        np.concatenate([low + (np.arange(n) + 0.5) * (high - low) / n for low, high, n, _, _ in parts]),
        np.concatenate([np.full(n, (high - low) / n * lanes) for low, high, n, _, lanes in parts]),
        np.concatenate([np.full(n, lane) for _, _, n, lane, _ in parts]),
    )


def _within_lane(low: float, high: float, within_m: float, grid: int) -> list[tuple[float, float, int]]:
    """Return the parts of a lane, each with its number of points."""
    if high - low <= 2 * within_m:
        return [(low, high, grid)]
    near, far = low + within_m, high - within_m
    return [(low, near, grid), (near, far, 1), (far, high, grid)]


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
    """Return the areas sensed as vibrating with one floor, m2: on vibrating tiles, and on still tiles or no tile."""
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
    """Return the mean of ``_sensed_areas`` over all placements of ``vibrating`` vibrating tiles on the grid."""
    tiles = float(place.rows * place.columns)
    detected = spillover = 0.0
    distance = np.empty(MAX_NEIGHBOURS)
    for j in range(y_m.size):
        for i in range(x_m.size):
            row = place.rows - 1 - lane[j] if lane[j] >= 0 else -1
            on = column[i] >= 0 and row >= 0  # whether a tile is below
            near = _distances(
                x_m[i], y_m[j], row if on else -1, column[i] if on else -1, within_m, place, distance
            )
            area = x_length_m[i] * y_length_m[j]
            # Number of tiles without the one below; the nearest of them that is of the other kind matters.
            other_tiles = tiles - 1.0 if on else tiles
            if on:
                share = vibrating / tiles  # probability that the tile below vibrates
                # Number of still tiles among the other tiles, if the tile below vibrates.
                still = other_tiles - (vibrating - 1.0)
                inside = _mean_probability(distance, near, still, other_tiles, reach_m, blur_m, 1.0)
                detected += area * share * inside
                area *= 1.0 - share  # the rest of the area counts for a still tile below
            spillover += area * _mean_probability(
                distance, near, vibrating, other_tiles, reach_m, blur_m, -1.0
            )
    return detected, spillover


@inner
def _distances(
    x_m: float, y_m: float, row: int, column: int, within_m: float, place: Place, out: NDArray[np.float64]
) -> int:
    """Write the distances from a place to the tiles within ``within_m``, in increasing order; return their number."""
    count = 0
    first_column, last_column, first_row, last_row = tiles_around(x_m, y_m, within_m, place)
    for r in range(first_row, last_row + 1):
        # up, across: distances to the tile along y and x, 0 where the point lies within the tile's row or column.
        above = y_m - (place.top_m - r * place.height_m)
        up = max(above, -place.height_m - above, 0.0)
        for c in range(first_column, last_column + 1):
            if r == row and c == column:
                continue
            before = place.left_m + c * place.width_m - x_m
            across = max(before, -place.width_m - before, 0.0)
            d = np.sqrt(across * across + up * up)
            # ``count < out.size`` always holds; without the check an error would write beyond ``out`` unnoticed. Then d
            # is inserted so that ``out`` stays sorted.
            if d <= within_m and count < out.size:
                k = count
                while k > 0 and out[k - 1] > d:
                    out[k] = out[k - 1]
                    k -= 1
                out[k] = d
                count += 1
    return count


@inner
def _mean_probability(
    distance: NDArray[np.float64],
    near: int,
    other_kind: float,
    tiles: float,
    reach_m: float,
    blur_m: float,
    sign: float,
) -> float:
    """Return the probability to sense vibration at a place, by the distance of the nearest tile of the other kind."""
    total, none_before = 0.0, 1.0  # none_before: probability that no nearer tile is of the other kind
    for k in range(near):
        # is_other: probability that this tile is of the other kind if the k nearer tiles are not: all ``other_kind``
        # tiles are then among the other ``tiles - k`` tiles. ``other_kind`` need not be whole and may exceed that
        # number, so the quotient is limited to 1; the limit 0 is for rounding. ``tiles > k`` always holds, as the tiles
        # near the place are among the ``tiles`` tiles.
        is_other = min(max(other_kind / (tiles - k), 0.0), 1.0) if tiles > k else 0.0
        total += none_before * is_other * share_past(reach_m + sign * distance[k], blur_m)
        none_before *= 1.0 - is_other
    # none_before: now the probability that no tile near the place is of the other kind
    return total + (none_before if sign > 0.0 else 0.0)
