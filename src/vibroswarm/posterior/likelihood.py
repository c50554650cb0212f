"""The likelihood of a run's bits given its floor: which tiles each sample may have sensed.

| name | symbol | equation |
|---|---|---|
| tile below, its kind | t, T_t | 1 vibrates, 0 does not; off all tiles 0 |
| nearest tile of the other kind | u, d | within abs(reach) + 6 blurs, at the distance d (``observation.sensed``) |
| sensed as vibrating | g | Phi((reach - d) / blur) from a still place, Phi((reach + d) / blur) from a vibrating tile |
| factor | c | exp(l_r + l_t) of the robot and of the tile that is sensed; l ~ N(-s^2 / 2, s^2) |
| one | P(1) | g [1 - F_v(theta_E / c_v)] + (1 - g) [1 - F_s(theta_E / c_s)]; c_v, c_s of the tile sensed as that kind |

This is the likelihood of the model that draws the bits. Each sample has its own random numbers for the tile that it
senses and for its reading, so both are summed over. P(1) as a function of ln c is read from a table by linear
interpolation.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.edge_response import FAR, Place, place_of, share_past, tile_below
from vibroswarm.observation.energy_model import shares_below
from vibroswarm.scenario.fields import Sensor

MAX_NEAR: Final = 16
"""Limit on the other tiles within reach of a sample, on average; more take longer than some seconds per run."""
TABLE: Final = 8193
"""Points of the table over ln c; an odd number, so that ln c = 0 is one of them."""
DEVIATIONS: Final = 9.0
"""Range of the table on either side, in standard deviations of ln c; beyond, its end values apply."""
LEAST: Final = 1e-60
"""Lower bound of a bit's likelihood: practically impossible, but safe to divide by."""


class Evidence(NamedTuple):
    """The samples of one run, in order of time.

    ``near[first[s] : first[s + 1]]`` are the other tiles within reach of sample s, the nearest first, each with the
    probability that the sample senses vibration if that tile is the nearest of the other kind, with a still and with a
    vibrating tile below. ``of_tile[of_first[t] : of_first[t + 1]]`` are the samples that tile t matters to,
    ``of_robot`` likewise; both in order of time.
    """

    at: NDArray[np.int64]
    robot: NDArray[np.int64]
    bit: NDArray[np.uint8]
    first: NDArray[np.int64]
    near: NDArray[np.int64]
    if_still: NDArray[np.float64]
    if_vibrating: NDArray[np.float64]
    of_first: NDArray[np.int64]
    of_tile: NDArray[np.int64]
    of_robot_first: NDArray[np.int64]
    of_robot: NDArray[np.int64]
    ones: NDArray[np.float64]
    """(2, TABLE): P(1) of still and of vibrating tiles over ln c."""
    lowest: float
    per_step: float
    """Of the table: ln c at its first point, points to 1 of ln c."""
    tile_spread: float
    robot_spread: float
    """Standard deviations of ln c; 0 where tiles or robots do not differ."""


def evidence_of(
    sensor: Sensor,
    floor: Floor,
    robots: int,
    robot: NDArray[np.integer],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    bit: NDArray[np.uint8],
) -> Evidence:
    """Return the samples of a run as evidence.

    Args:
        floor: only its geometry is used. robot, x_m, y_m, bit: (samples,), in order of time.
    Raises:
        InputError: edges reach over too many tiles.
    """
    place, count, tiles = place_of(floor), bit.size, floor.tiles.size
    x, y = (np.ascontiguousarray(values, dtype=np.float64) for values in (x_m, y_m))
    edges = sensor.edge_reach_m is not None or sensor.edge_blur_m is not None
    reach_m, blur_m = sensor.edge_reach_m or 0.0, sensor.edge_blur_m or 0.0
    within_m = abs(reach_m) + FAR * blur_m if edges else -1.0
    at, numbers = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    _count_near(x, y, within_m, place, at, numbers)
    first = np.append(0, np.cumsum(numbers))
    if first[-1] > MAX_NEAR * count:
        raise InputError(
            f"edges of {first[-1] / count:.0f} other tiles may be sensed from a place: too many for the posterior of "
            f"the floor, which takes up to {MAX_NEAR}; give a shorter edge_reach_m or edge_blur_m, or larger tiles",
            field="sensor.edge_reach_m",
        )
    neighbour = np.empty(first[-1], dtype=np.int64)
    if_still, if_vibrating = np.empty(first[-1]), np.empty(first[-1])
    _fill_near(x, y, within_m, reach_m, blur_m, place, at, first, neighbour, if_still, if_vibrating)
    tile_of_entry = np.concatenate([at[at >= 0], neighbour])
    sample = np.concatenate([np.flatnonzero(at >= 0), np.repeat(np.arange(count), numbers)])
    of_first, of_tile = _gathered(tile_of_entry, sample, tiles)
    number = robot.astype(np.int64)
    ones, lowest, per_step = _table(sensor)
    return Evidence(
        at, number, np.ascontiguousarray(bit), first, neighbour, if_still, if_vibrating, of_first, of_tile,
        *_gathered(number, np.arange(count), robots), ones, lowest, per_step,
        sensor.tile_spread or 0.0, sensor.robot_spread or 0.0,
    )  # fmt: skip


def _gathered(
    whose: NDArray[np.int64], sample: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Group samples by owner: return the start of each owner's part, (count + 1,), and the samples in this order."""
    order = np.lexsort((sample, whose))
    return np.searchsorted(whose[order], np.arange(count + 1)), np.ascontiguousarray(sample[order])


def _table(sensor: Sensor) -> tuple[NDArray[np.float64], float, float]:
    """Tabulate the shares of ones on still and vibrating tiles over the log factor: shares (2, TABLE), first node,
    nodes per unit."""
    spreads = (sensor.tile_spread or 0.0, sensor.robot_spread or 0.0)
    half = sum(DEVIATIONS * s + 0.5 * s**2 for s in spreads) or 1.0
    log_factor = np.linspace(-half, half, TABLE)
    log_factor[TABLE // 2] = 0.0
    factors = np.exp(log_factor)
    ones = np.array([1.0 - shares_below(sensor, kind, factors) for kind in (False, True)])
    return ones, -half, (TABLE - 1) / (2.0 * half)


@inner
def _distance(x_m: float, y_m: float, tile: int, place: Place) -> float:
    """Return the distance to the nearest point of a tile, m; 0 on it. As in ``edge_response.nearest_of_kind``."""
    above = y_m - (place.top_m - (tile // place.columns) * place.height_m)
    up = max(above, -place.height_m - above, 0.0)
    before = place.left_m + (tile % place.columns) * place.width_m - x_m
    across = max(before, -place.width_m - before, 0.0)
    return math.sqrt(across * across + up * up)


@inner
def _window(x_m: float, y_m: float, within_m: float, place: Place) -> tuple[int, int, int, int]:
    """Return the first and last row and column of the tiles that may be within reach."""
    return (
        max(int(np.floor((place.top_m - y_m - within_m) / place.height_m)), 0),
        min(int(np.floor((place.top_m - y_m + within_m) / place.height_m)), place.rows - 1),
        max(int(np.floor((x_m - within_m - place.left_m) / place.width_m)), 0),
        min(int(np.floor((x_m + within_m - place.left_m) / place.width_m)), place.columns - 1),
    )


@kernel
def _count_near(
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    within_m: float,
    place: Place,
    at: NDArray[np.int64],
    numbers: NDArray[np.int64],
) -> None:
    """Fill in the tile below each sample and the number of other tiles within reach; none if ``within_m`` is
    negative."""
    for s in range(x_m.size):
        at[s], numbers[s] = tile_below(x_m[s], y_m[s], place), 0
        if within_m >= 0.0:
            top, bottom, left, right = _window(x_m[s], y_m[s], within_m, place)
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    tile = row * place.columns + column
                    if tile != at[s] and _distance(x_m[s], y_m[s], tile, place) <= within_m:
                        numbers[s] += 1


@kernel
def _fill_near(
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    within_m: float,
    reach_m: float,
    blur_m: float,
    place: Place,
    at: NDArray[np.int64],
    first: NDArray[np.int64],
    near: NDArray[np.int64],
    if_still: NDArray[np.float64],
    if_vibrating: NDArray[np.float64],
) -> None:
    """List the tiles within reach of each sample, nearest first, ties by number, with sensing probabilities.

    Args:
        at: tile below each sample. first: index of each sample's first entry, (samples + 1,).
        near, if_still, if_vibrating: entries to write: the tile, and the probability that vibration crosses its edge
            if the tile below is still, and if it vibrates.
    """
    for s in range(x_m.size):
        if first[s + 1] == first[s]:
            continue
        end = first[s]
        top, bottom, left, right = _window(x_m[s], y_m[s], within_m, place)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                tile = row * place.columns + column
                distance = _distance(x_m[s], y_m[s], tile, place)
                if tile == at[s] or distance > within_m:
                    continue
                k = end
                while (
                    k > first[s] and if_still[k - 1] > distance
                ):  # if_still holds distances until they are sorted
                    near[k], if_still[k] = near[k - 1], if_still[k - 1]
                    k -= 1
                near[k], if_still[k] = tile, distance
                end += 1
        for k in range(first[s], end):
            distance = if_still[k]
            if_still[k] = share_past(reach_m - distance, blur_m)
            if_vibrating[k] = share_past(reach_m + distance, blur_m)


@inner
def share_of_ones(evidence: Evidence, vibrates: int, log_factor: float) -> float:
    """Return P(1) of a tile sensed as this kind, from the table."""
    place = (log_factor - evidence.lowest) * evidence.per_step
    place = min(max(place, 0.0), TABLE - 1.000001)
    k = int(place)
    low = evidence.ones[vibrates, k]
    share: float = low + (place - k) * (evidence.ones[vibrates, k + 1] - low)
    return share


@inner
def bit_likelihood(
    evidence: Evidence,
    s: int,
    tiles: NDArray[np.uint8],
    log_tile: NDArray[np.float64],
    log_robot: NDArray[np.float64],
) -> float:
    """Return the probability of the bit that sample s read, on a floor ``tiles`` (tiles,) with these ln c.

    Args:
        log_tile: (tiles + 1,), the last 0: off all tiles. log_robot: (robots,).
    """
    below = evidence.at[s]
    vibrates = int(tiles[below]) if below >= 0 else 0
    edge_tile, share = -1, 0.0
    for k in range(evidence.first[s], evidence.first[s + 1]):
        if tiles[evidence.near[k]] != vibrates:
            edge_tile = evidence.near[k]
            share = evidence.if_vibrating[k] if vibrates else evidence.if_still[k]
            break
    of_robot, own = log_robot[evidence.robot[s]], log_tile[below if below >= 0 else log_tile.size - 1]
    if edge_tile < 0:
        chance_of_one = share_of_ones(evidence, vibrates, of_robot + own)
    else:
        changed = 1.0 - share if vibrates else share  # sensed as the other kind
        chance_of_one = 0.0
        if changed < 1.0:
            chance_of_one += (1.0 - changed) * share_of_ones(evidence, vibrates, of_robot + own)
        if changed > 0.0:
            chance_of_one += changed * share_of_ones(evidence, 1 - vibrates, of_robot + log_tile[edge_tile])
    return max(chance_of_one if evidence.bit[s] else 1.0 - chance_of_one, LEAST)
