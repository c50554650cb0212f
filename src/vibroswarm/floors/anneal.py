"""Simulated annealing over floors with a fixed number of vibrating tiles, by swaps of two tiles, compiled.

| name | symbol | unit | equation |
|---|---|---|---|
| links2 | sum w_ij c_i c_j | - | vibrating neighbours of vibrating tiles, each pair twice |
| sides | sum w_ij c_i | - | neighbours of vibrating tiles, of either kind |
| pairs2 | sum w_ij = W | - | 2 (rows (columns - 1) + columns (rows - 1)) |
| Moran index | E_MI | - | (links2 - 2 f sides) / (W f (1 - f)) + f / (1 - f) |
| entropy | E_e | - | S / (N_v log2 N_v), S of ``clusters`` |
| energy | | - | hypot(moran_weight * miss of E_MI, entropy_weight * miss of E_e) |

A swap is taken when the energy stays below its old value - temperature * log(u) (Metropolis). As the energy
is at least the Moran index's part of it, many swaps are refused before any cluster is touched.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroswarm.compiled import allocating_kernel, kernel
from vibroswarm.draws import FLOOR, uniform
from vibroswarm.floors.clusters import Cells, Clusters, no_clusters, put, take


class Goal(NamedTuple):
    """What is asked for, and how much a miss weighs; with ``entropy_weight`` 0 any entropy is right."""

    moran_index: float
    entropy: float
    moran_weight: float
    entropy_weight: float


class Schedule(NamedTuple):
    """First and last temperature (units of energy, geometric in between), swaps to try, energy to stop at."""

    hot: float
    cold: float
    moves: int
    enough: float


@kernel
def _vibrating_around(tile: Cells, stride: int, cell: int) -> int:
    return int(tile[cell - 1] + tile[cell + 1] + tile[cell - stride] + tile[cell + stride])


@allocating_kernel
def _degrees(rows: int, columns: int) -> Cells:
    """Number of neighbours of each cell, in the grid with its border; 0 on the border."""
    stride = columns + 2
    degree = np.zeros((rows + 2) * stride, dtype=np.int64)
    for row in range(1, rows + 1):
        for column in range(1, columns + 1):
            around = (row > 1) + (row < rows) + (column > 1) + (column < columns)
            degree[row * stride + column] = around
    return degree


@kernel
def _partner(u: float, p: int, zeros: Cells, blanks: int, tile: Cells, rows: int, columns: int) -> int:
    """The still cell to swap with ``p``: half of the time any, else one within two steps of ``p`` (or -1)."""
    if u < 0.5:
        return int(zeros[int(2.0 * u * blanks)])
    stride = columns + 2
    pick = int((2.0 * u - 1.0) * 25.0)
    row = p // stride + pick // 5 - 2
    column = p % stride + pick % 5 - 2
    if row < 1 or row > rows or column < 1 or column > columns or tile[row * stride + column] == 1:
        return -1
    return row * stride + column


@kernel
def _lay(state: Clusters, degree: Cells, ones: Cells, zeros: Cells, place: Cells) -> tuple[int, int, float]:
    """Make all ``ones`` vibrate and note each cell's place in its list; links2, sides and S."""
    links2, sides, whole = 0, 0, 0.0
    for i in range(zeros.size):
        place[zeros[i]] = i
    for i in range(ones.size):
        place[ones[i]] = i
        sides += degree[ones[i]]
        links2 += 2 * _vibrating_around(state.tile, state.stride, ones[i])
        whole += put(state, ones[i])
    return links2, sides, whole


@allocating_kernel
def anneal(
    start: Cells, rows: int, columns: int, goal: Goal, schedule: Schedule, seed: int, search: int
) -> tuple[Cells, float]:
    """Swap vibrating and still tiles until the floor is as asked for, or the moves are spent.

    Args:
        start: 0 and 1 with a border of 0, row after row, shape ((rows + 2) * (columns + 2),); at least one
            tile of each kind.
        seed, search: address of the uniform numbers: (seed, 0, 0, floor, index, 1 + search).
    Returns: the best floor in the form of ``start``, and its energy.
    """
    stride = columns + 2
    state = no_clusters(start.size, stride)
    tile, degree = state.tile, _degrees(rows, columns)
    place = np.zeros(start.size, dtype=np.int64)  # where a cell stands in ``ones`` or ``zeros``
    ones, zeros = np.nonzero(start == 1)[0], np.nonzero((start == 0) & (degree > 0))[0]
    count, blanks = ones.size, zeros.size
    links2, sides, whole = _lay(state, degree, ones, zeros, place)
    fill = count / (rows * columns)
    scale = 1.0 / (2 * (rows * (columns - 1) + columns * (rows - 1)) * fill * (1.0 - fill))
    offset = fill / (1.0 - fill) - goal.moran_index
    most = max(count * math.log2(count), 1.0)
    energy = math.hypot(
        goal.moran_weight * ((links2 - 2.0 * fill * sides) * scale + offset),
        goal.entropy_weight * (whole / most - goal.entropy),
    )
    best, best_energy = tile.copy(), energy
    cooling = (schedule.cold / schedule.hot) ** (1.0 / schedule.moves)
    temperature = schedule.hot
    for move in range(schedule.moves):
        if best_energy <= schedule.enough:
            break
        temperature *= cooling
        pick = uniform(seed, 0, 0, FLOOR, 2 * move, 1 + search) * count
        p = ones[int(pick)]
        q = _partner(pick - int(pick), p, zeros, blanks, tile, rows, columns)
        if q < 0:
            continue
        beside = 1 if abs(q - p) == 1 or abs(q - p) == stride else 0
        gained = _vibrating_around(tile, stride, q) - beside - _vibrating_around(tile, stride, p)
        new_links2, new_sides = links2 + 2 * gained, sides + degree[q] - degree[p]
        miss = goal.moran_weight * ((new_links2 - 2.0 * fill * new_sides) * scale + offset)
        limit = energy - temperature * math.log(uniform(seed, 0, 0, FLOOR, 2 * move + 1, 1 + search))
        if abs(miss) > limit:
            continue
        new_whole = whole + take(state, p) + put(state, q)
        new_energy = math.hypot(miss, goal.entropy_weight * (new_whole / most - goal.entropy))
        if new_energy > limit:
            take(state, q)
            put(state, p)
            continue
        links2, sides, whole, energy = new_links2, new_sides, new_whole, new_energy
        ones[place[p]], zeros[place[q]] = q, p
        place[p], place[q] = place[q], place[p]
        if energy < best_energy:
            best_energy = energy
            best[:] = tile
    return best, best_energy
