"""Simulated annealing over floors with a fixed number of vibrating tiles, compiled.

The clusters of vibrating tiles are updated with each change of a tile:

| name | symbol | shape | meaning |
|---|---|---|---|
| tile | c_i | (cells,) | 1 vibrating, 0 still; the grid with a border of 0 around it, row after row |
| label | | (cells,) | the cluster of each vibrating cell; 0: none |
| size | abs(C_i) | (cells + 1,) | tiles of the cluster with this label |
| terms | n log2 n | (cells + 1,) | the sum of ``terms[size]`` over the clusters is S = N_v (H_c^max - H_c) |
| free | | (cells + 1,) | the unused labels are ``free[1:1 + free[0]]`` |
| stack | | (cells,) | scratch |

The entropy is S / (N_v log2 N_v). Removing a tile can split its cluster only if its neighbours are not connected
around it, so most changes cost a handful of additions.

Annealing swaps two tiles at a time:

| name | symbol | unit | equation |
|---|---|---|---|
| links2 | sum w_ij c_i c_j | - | vibrating neighbours of vibrating tiles, each pair twice |
| sides | sum w_ij c_i | - | neighbours of vibrating tiles, of either kind |
| pairs2 | sum w_ij = W | - | 2 (rows (columns - 1) + columns (rows - 1)) |
| Moran index | E_MI | - | (links2 - 2 f sides) / (W f (1 - f)) + f / (1 - f) |
| entropy | E_e | - | S / (N_v log2 N_v), S as above |
| energy | | - | hypot(moran_weight * miss of E_MI, entropy_weight * miss of E_e) |

A swap is accepted if the energy stays below its old value - temperature * log(u) (Metropolis). As the energy
is at least its Moran part, many swaps are rejected before any cluster is updated.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, kernel
from vibroswarm.core.rng import FLOOR, uniform

Cells = NDArray[np.int64]


class Clusters(NamedTuple):
    """The arrays of the table above; ``stride`` is the distance from a cell to the one below it."""

    tile: Cells
    label: Cells
    size: Cells
    terms: NDArray[np.float64]
    free: Cells
    stack: Cells
    stride: int


@allocating_kernel
def no_clusters(cells: int, stride: int) -> Clusters:
    """Return the clusters of a grid in which no tile vibrates yet.

    Args:
        cells: cells of the grid with its border. stride: cells of a row.
    """
    terms = np.zeros(cells + 1)
    free = np.zeros(cells + 1, dtype=np.int64)
    free[0] = cells - 1
    for n in range(1, cells):
        free[n] = cells - n
        terms[n] = n * math.log2(n)
    tile = np.zeros(cells, dtype=np.int64)
    label = np.zeros(cells, dtype=np.int64)
    size = np.zeros(cells + 1, dtype=np.int64)
    stack = np.zeros(cells, dtype=np.int64)
    return Clusters(tile, label, size, terms, free, stack, stride)


@kernel
def add_tile(state: Clusters, cell: int) -> float:
    """Make the still ``cell`` vibrate; return the change of S, bits times tiles."""
    label, size, stride = state.label, state.size, state.stride
    keep = 0
    for step in (1, -1, stride, -stride):
        neighbour = label[cell + step]
        if neighbour > 0 and (keep == 0 or size[neighbour] > size[keep]):
            keep = neighbour
    if keep == 0:
        keep = _new_label(state)
    change = -state.terms[size[keep]]
    for step in (1, -1, stride, -stride):
        neighbour_label = label[cell + step]
        if neighbour_label > 0 and neighbour_label != keep:
            change -= state.terms[size[neighbour_label]]
            size[keep] += _flood(state, cell + step, neighbour_label, keep)
            _free_label(state, neighbour_label)
    state.tile[cell] = 1
    label[cell] = keep
    size[keep] += 1
    return float(change + state.terms[size[keep]])


@kernel
def remove_tile(state: Clusters, cell: int) -> float:
    """Make the vibrating ``cell`` still; return the change of S, bits times tiles."""
    tile, label, size, stride = state.tile, state.label, state.size, state.stride
    old = label[cell]
    change = -state.terms[size[old]]
    tile[cell] = 0
    label[cell] = 0
    size[old] -= 1
    if size[old] > 0 and _groups_around(tile, stride, cell) <= 1:
        return float(change + state.terms[size[old]])
    for step in (1, -1, stride, -stride):
        neighbour = cell + step
        if tile[neighbour] == 1 and label[neighbour] == old:
            new = _new_label(state)
            size[new] = _flood(state, neighbour, old, new)
            change += state.terms[size[new]]
    _free_label(state, old)
    return float(change)


@kernel
def _new_label(state: Clusters) -> int:
    new = state.free[state.free[0]]
    state.free[0] -= 1
    return int(new)


@kernel
def _free_label(state: Clusters, label: int) -> None:
    state.free[0] += 1
    state.free[state.free[0]] = label
    state.size[label] = 0


@kernel
def _flood(state: Clusters, start: int, old: int, new: int) -> int:
    """Relabel the cells connected to ``start`` from ``old`` to ``new``; return their number."""
    label, stack, stride = state.label, state.stack, state.stride
    label[start] = new
    stack[0] = start
    waiting = 1
    count = 0
    while waiting > 0:
        waiting -= 1
        cell = stack[waiting]
        count += 1
        for step in (1, -1, stride, -stride):
            neighbour = cell + step
            if label[neighbour] == old:
                label[neighbour] = new
                stack[waiting] = neighbour
                waiting += 1
    return count


@kernel
def _groups_around(tile: Cells, stride: int, cell: int) -> int:
    """Return the number of groups of vibrating neighbours of ``cell``, connected within the ring of eight around
    it.

    0 if all eight vibrate, as the ring closes: treat it as one.
    """
    north, south, west, east = tile[cell - stride], tile[cell + stride], tile[cell - 1], tile[cell + 1]
    joined = (
        north * tile[cell - stride + 1] * east
        + east * tile[cell + stride + 1] * south
        + south * tile[cell + stride - 1] * west
        + west * tile[cell - stride - 1] * north
    )
    return int(north + south + west + east - joined)


class Goal(NamedTuple):
    """The measures asked for, and the weights of misses; with ``entropy_weight`` 0 any entropy will do."""

    moran_index: float
    entropy: float
    moran_weight: float
    entropy_weight: float


class Schedule(NamedTuple):
    """First and last temperature (in energy, geometric in between), number of swaps, energy at which to stop."""

    hot: float
    cold: float
    moves: int
    enough: float


@kernel
def _vibrating_around(tile: Cells, stride: int, cell: int) -> int:
    return int(tile[cell - 1] + tile[cell + 1] + tile[cell - stride] + tile[cell + stride])


@allocating_kernel
def _degrees(rows: int, columns: int) -> Cells:
    """Return the number of neighbours of each cell, in the grid with its border; 0 on the border."""
    stride = columns + 2
    degree = np.zeros((rows + 2) * stride, dtype=np.int64)
    for row in range(1, rows + 1):
        for column in range(1, columns + 1):
            around = (row > 1) + (row < rows) + (column > 1) + (column < columns)
            degree[row * stride + column] = around
    return degree


@kernel
def _partner(u: float, p: int, zeros: Cells, blanks: int, tile: Cells, rows: int, columns: int) -> int:
    """Return a still cell to swap with ``p``: half the time any, else one at most two rows and columns from ``p``.

    -1 if the cell that was drawn near ``p`` vibrates or is outside the floor.

    Args:
        u: uniform number. zeros: the still cells. blanks: their number.
    """
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
def _place_tiles(
    state: Clusters, degree: Cells, ones: Cells, zeros: Cells, place: Cells
) -> tuple[int, int, float]:
    """Make all ``ones`` vibrate and note each cell's index in its list, ``ones`` or ``zeros``, in ``place``.

    Returns: twice the number of pairs of vibrating neighbours, the number of neighbours of all vibrating tiles, and S.
    """
    links2, sides, cluster_bits = 0, 0, 0.0
    for i in range(zeros.size):
        place[zeros[i]] = i
    for i in range(ones.size):
        place[ones[i]] = i
        sides += degree[ones[i]]
        links2 += 2 * _vibrating_around(state.tile, state.stride, ones[i])
        cluster_bits += add_tile(state, ones[i])
    return links2, sides, cluster_bits


@allocating_kernel
def anneal(
    start: Cells, rows: int, columns: int, goal: Goal, schedule: Schedule, seed: int, search: int
) -> tuple[Cells, float]:
    """Swap vibrating and still tiles until the floor meets the goal or the swaps are used up.

    Args:
        start: 0 and 1 with a border of 0, row after row, shape ((rows + 2) * (columns + 2),); at least one
            tile of each kind.
        seed, search: address of the uniform numbers: (seed, 0, 0, floor, index, 1 + search).
    Returns: the best floor in the form of ``start``, and its energy.
    """
    stride = columns + 2
    state = no_clusters(start.size, stride)
    tile, degree = state.tile, _degrees(rows, columns)
    place = np.zeros(start.size, dtype=np.int64)  # index of a cell in ``ones`` or ``zeros``
    ones, zeros = np.nonzero(start == 1)[0], np.nonzero((start == 0) & (degree > 0))[0]
    count, blanks = ones.size, zeros.size
    links2, sides, cluster_bits = _place_tiles(state, degree, ones, zeros, place)
    fill = count / (rows * columns)
    scale = 1.0 / (2 * (rows * (columns - 1) + columns * (rows - 1)) * fill * (1.0 - fill))
    offset = fill / (1.0 - fill) - goal.moran_index
    most = max(count * math.log2(count), 1.0)
    energy = math.hypot(
        goal.moran_weight * ((links2 - 2.0 * fill * sides) * scale + offset),
        goal.entropy_weight * (cluster_bits / most - goal.entropy),
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
        adjacent = 1 if abs(q - p) == 1 or abs(q - p) == stride else 0
        gained = _vibrating_around(tile, stride, q) - adjacent - _vibrating_around(tile, stride, p)
        new_links2, new_sides = links2 + 2 * gained, sides + degree[q] - degree[p]
        miss = goal.moran_weight * ((new_links2 - 2.0 * fill * new_sides) * scale + offset)
        limit = energy - temperature * math.log(uniform(seed, 0, 0, FLOOR, 2 * move + 1, 1 + search))
        if abs(miss) > limit:
            continue
        new_cluster_bits = cluster_bits + remove_tile(state, p) + add_tile(state, q)
        new_energy = math.hypot(miss, goal.entropy_weight * (new_cluster_bits / most - goal.entropy))
        if new_energy > limit:
            remove_tile(state, q)
            add_tile(state, p)
            continue
        links2, sides, cluster_bits, energy = new_links2, new_sides, new_cluster_bits, new_energy
        ones[place[p]], zeros[place[q]] = q, p
        place[p], place[q] = place[q], place[p]
        if energy < best_energy:
            best_energy = energy
            best[:] = tile
    return best, best_energy
