"""The likelihood of a run's bits given its floor, over the tiles that each sample may have sensed.

| name | symbol | equation |
|---|---|---|
| tile below, its kind | t, T_t | kind: 1 vibrating, 0 still; 0 too where no tile is below |
| nearest tile of the other kind | u, d | at the distance d, within abs(reach) + 6 blurs (``edge_response``) |
| sensed as vibrating | g | Phi((reach - d) / blur) from a still place, Phi((reach + d) / blur) from a vibrating tile |
| factor | c | exp(l_r + l_t) of the robot and of the tile that is sensed; l ~ N(-s^2 / 2, s^2) |
| one | P(1) | g [1 - F_v(theta_E / c_v)] + (1 - g) [1 - F_s(theta_E / c_s)]; c_v, c_s: factors of the tiles t and u |

This is the likelihood under the model that also draws the bits in simulations. Each sample has random numbers of its
own for the tile that it senses and for its reading, so both are summed over. P(1) as a function of ln c is read from a
table by linear interpolation. c_v is the factor of whichever of the two tiles vibrates, c_s that of the other. F_v and
F_s are the distribution functions of the energy on a vibrating and on a still tile at factor 1. s is the spread of the
factors: one value for robots, one for tiles.
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
"""Limit on the mean number of other tiles within reach of a sample; with more a run takes too long."""
TABLE: Final = 8193
"""Number of points of the table over ln c; odd, so that ln c = 0 is one of them."""
DEVIATIONS: Final = 9.0
"""Half the range of the table, in standard deviations of ln c; beyond the range its end values apply."""
LEAST: Final = 1e-60
"""Lower bound of a bit's likelihood, so that ratios and logarithms of likelihoods are finite."""


class Evidence(NamedTuple):
    """The samples of one run, in order of time.

    ``at``, ``robot`` and ``bit`` have one entry per sample: the tile below (-1: none), the robot, the bit.
    ``near[first[s] : first[s + 1]]`` are the other tiles within reach of sample s, the nearest first. For each of them
    ``if_still`` and ``if_vibrating`` hold the probability that the sample senses vibration if that tile is the nearest
    one of the other kind, and the tile below is still or vibrating. ``of_tile[of_first[t] : of_first[t + 1]]`` are the
    samples whose bits tile t may affect; ``of_robot[of_robot_first[i] : of_robot_first[i + 1]]`` are those of robot i.
    Both are in order of time.
    """

    at: NDArray[np.int64]
    """(samples,): index of the tile below; -1: none."""
    robot: NDArray[np.int64]
    """(samples,): robot of each sample."""
    bit: NDArray[np.uint8]
    """(samples,): bit of each sample."""
    first: NDArray[np.int64]
    """(samples + 1,): index of each sample's first entry in ``near``."""
    near: NDArray[np.int64]
    """(entries,): other tiles within reach, sample by sample, the nearest first."""
    if_still: NDArray[np.float64]
    """(entries,): probability of sensing vibration across this edge from a still place."""
    if_vibrating: NDArray[np.float64]
    """(entries,): probability of sensing vibration across this edge from a vibrating tile."""
    of_first: NDArray[np.int64]
    """(tiles + 1,): index of each tile's first entry in ``of_tile``."""
    of_tile: NDArray[np.int64]
    """Samples whose bits a tile may affect, tile by tile."""
    of_robot_first: NDArray[np.int64]
    """(robots + 1,): index of each robot's first entry in ``of_robot``."""
    of_robot: NDArray[np.int64]
    """(samples,): samples, robot by robot."""
    ones: NDArray[np.float64]
    """(2, TABLE): P(1) of still and of vibrating tiles over ln c."""
    lowest: float
    """ln c at the first point of the table."""
    per_step: float
    """Number of points of the table per unit of ln c."""
    tile_spread: float
    """Standard deviation of ln of the factors of tiles; 0: all are 1."""
    robot_spread: float
    """Standard deviation of ln of the factors of robots; 0: all are 1."""


def evidence_of(
    sensor: Sensor,
    floor: Floor,
    robots: int,
    robot: NDArray[np.integer],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    bit: NDArray[np.uint8],
) -> Evidence:
    """Return the samples of a run, with the tiles that each may have sensed, in the form that the chains read.

    Args:
        floor: only its geometry is used. robots: number of robots of the swarm.
        robot, x_m, y_m, bit: (samples,), in order of time: robot (from 0), place and bit of each sample.
    Raises:
        InputError: edges reach over too many tiles.
    """
    place, count, tiles = place_of(floor), bit.size, floor.tiles.size
    x, y = (np.ascontiguousarray(values, dtype=np.float64) for values in (x_m, y_m))
    edges = sensor.edge_reach_m is not None or sensor.edge_blur_m is not None
    reach_m, blur_m = sensor.edge_reach_m or 0.0, sensor.edge_blur_m or 0.0
    within_m = abs(reach_m) + FAR * blur_m if edges else -1.0  # below 0: edges do not matter
    at, numbers = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    _count_near(x, y, within_m, place, at, numbers)
    first = np.append(0, np.cumsum(numbers))  # index of each sample's first entry in ``neighbour``
    if first[-1] > MAX_NEAR * count:
        raise InputError(
            f"edges of {first[-1] / count:.0f} other tiles may be sensed from a place: too many for the posterior of "
            f"the floor, which takes up to {MAX_NEAR}; give a shorter edge_reach_m or edge_blur_m, or larger tiles",
            field="sensor.edge_reach_m",
        )
    neighbour = np.empty(first[-1], dtype=np.int64)
    if_still, if_vibrating = np.empty(first[-1]), np.empty(first[-1])
    _fill_near(x, y, within_m, reach_m, blur_m, place, at, first, neighbour, if_still, if_vibrating)
    # The tile below a sample and the other tiles within reach may affect its bit: one entry (tile, sample) for each.
    tile_of_entry = np.concatenate([at[at >= 0], neighbour])
    sample = np.concatenate([np.flatnonzero(at >= 0), np.repeat(np.arange(count), numbers)])
    of_first, of_tile = _gathered(tile_of_entry, sample, tiles)
    robot_numbers = robot.astype(np.int64)
    of_robot_first, of_robot = _gathered(robot_numbers, np.arange(count), robots)
    ones, lowest, per_step = _table(sensor)
    return Evidence(
        at=at,
        robot=robot_numbers,
        bit=np.ascontiguousarray(bit),
        first=first,
        near=neighbour,
        if_still=if_still,
        if_vibrating=if_vibrating,
        of_first=of_first,
        of_tile=of_tile,
        of_robot_first=of_robot_first,
        of_robot=of_robot,
        ones=ones,
        lowest=lowest,
        per_step=per_step,
        tile_spread=sensor.tile_spread or 0.0,
        robot_spread=sensor.robot_spread or 0.0,
    )


def _gathered(
    whose: NDArray[np.int64], sample: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sort samples by owner, which is a tile or a robot.

    Args:
        whose, sample: (entries,): an owner and one of its samples each. count: number of owners.
    Returns: (count + 1,): index of each owner's first entry; (entries,): the samples by owner, in order of time.
    """
    order = np.lexsort((sample, whose))
    return np.searchsorted(whose[order], np.arange(count + 1)), np.ascontiguousarray(sample[order])


def _table(sensor: Sensor) -> tuple[NDArray[np.float64], float, float]:
    """Tabulate the share of ones as a function of ln c, the logarithm of the factor of the energies.

    Returns: (2, TABLE): shares of ones on still and on vibrating tiles; ln c at the first point; number of points per
        unit of ln c.
    """
    spreads = (sensor.tile_spread or 0.0, sensor.robot_spread or 0.0)
    # The range covers the sum of both logarithms, whose means are -s^2 / 2. If there are no spreads, ln c is always 0,
    # and any range that is not empty will do: 1.0.
    half = sum(DEVIATIONS * s + 0.5 * s**2 for s in spreads) or 1.0
    log_factor = np.linspace(-half, half, TABLE)
    log_factor[TABLE // 2] = 0.0  # exactly, in spite of rounding
    factors = np.exp(log_factor)
    ones = np.array([1.0 - shares_below(sensor, kind, factors) for kind in (False, True)])
    return ones, -half, (TABLE - 1) / (2.0 * half)


@inner
def _distance(x_m: float, y_m: float, tile: int, place: Place) -> float:
    """Return the distance from a point to a tile, m; 0 if the point is on the tile.

    It is computed as in ``edge_response.nearest_of_kind``, so that both agree to the last bit.
    """
    above = y_m - (place.top_m - (tile // place.columns) * place.height_m)
    up = max(above, -place.height_m - above, 0.0)
    before = place.left_m + (tile % place.columns) * place.width_m - x_m
    across = max(before, -place.width_m - before, 0.0)
    return math.sqrt(across * across + up * up)


@inner
def _window(x_m: float, y_m: float, within_m: float, place: Place) -> tuple[int, int, int, int]:
    """Return first row, last row, first column and last column of the tiles that may lie near a point.

    They are all tiles of the floor that a square of half side ``within_m`` around the point touches. If there are none,
    a last number is below its first.
    """
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
    """Write the tile below each sample to ``at``, and the number of other tiles within reach to ``numbers``.

    Args:
        x_m, y_m: (samples,): place of each sample. within_m: reach, m; negative: edges do not matter, and the numbers
            are 0. place: position of the floor. at, numbers: (samples,), written; ``at`` is -1 where no tile is below.
    """
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
    """List the other tiles within reach of each sample, nearest first, with the probabilities of sensing vibration.

    Equally near tiles are in the order of their numbers.

    Args:
        x_m, y_m, at: (samples,): place of each sample, and the tile below (-1: none). within_m: distance up to which
            tiles are within reach. reach_m, blur_m: reach and blur of edges. place: position of the floor. first:
            (samples + 1,): index of each sample's first entry. near, if_still, if_vibrating: (entries,), written, as in
            ``Evidence``.
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
                # Insert the tile by its distance. Until all tiles are sorted, ``if_still`` serves to hold the
                # distances.
                k = end
                while k > first[s] and if_still[k - 1] > distance:
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
    """Return the share of ones on a kind of tile, by linear interpolation in the table.

    Args:
        vibrates: kind of the tile that is sensed: 1 vibrating, 0 still. log_factor: ln of the factor c of the energy.
    """
    place = (log_factor - evidence.lowest) * evidence.per_step
    place = min(max(place, 0.0), TABLE - 1.000001)  # just below the last point, so that k + 1 exists
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
    """Return the probability of the bit of sample ``s``, given the floor and all factors; it is at least LEAST.

    Args:
        tiles: (tiles,): kind of each tile, 1 vibrating, 0 still. log_tile: (tiles + 1,): ln of the factors of tiles;
            the last entry, 0, is for samples on no tile. log_robot: (robots,): ln of the factors of robots.
    """
    below = evidence.at[s]
    vibrates = int(tiles[below]) if below >= 0 else 0
    # edge_tile: nearest tile of the other kind. share: probability that the sample senses vibration, if there is one.
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
        changed = 1.0 - share if vibrates else share  # probability that the tile across the edge is sensed
        chance_of_one = 0.0
        if changed < 1.0:
            chance_of_one += (1.0 - changed) * share_of_ones(evidence, vibrates, of_robot + own)
        if changed > 0.0:
            chance_of_one += changed * share_of_ones(evidence, 1 - vibrates, of_robot + log_tile[edge_tile])
    return max(chance_of_one if evidence.bit[s] else 1.0 - chance_of_one, LEAST)
