"""Simulated annealing over floors with a fixed number of vibrating tiles, compiled by Numba.

The clusters of vibrating tiles are updated with each change of a tile:

| name | symbol | shape | meaning |
|---|---|---|---|
| tile | c_i | (cells,) | 1 vibrating, 0 still; the grid with a border of 0 around it, row after row |
| label | | (cells,) | number of the cluster of each vibrating cell; 0 for still cells |
| size | abs(C_i) | (cells + 1,) | number of tiles of the cluster with this label |
| terms | n log2 n | (cells + 1,) | the sum of ``terms[size]`` over the clusters is S = N_v (H_c^max - H_c) |
| free | | (cells + 1,) | a stack of the unused labels: ``free[1:1 + free[0]]``, so ``free[0]`` is their number |
| stack | | (cells,) | scratch of ``_flood`` |

The entropy is S / (N_v log2 N_v). Removing a tile can split its cluster only if the tile's vibrating neighbours are not
connected around it, so most changes cost a few additions. Cells are indexed in the grid with its border, row after row.

Annealing swaps a vibrating and a still tile at a time. f is the share of tiles that vibrate; w_ij is 1 for neighbours
i, j and 0 for other pairs:

| name | symbol | unit | equation |
|---|---|---|---|
| links2 | sum w_ij c_i c_j | - | number of pairs of vibrating neighbours, each counted twice |
| sides | sum w_ij c_i | - | number of neighbours, vibrating or still, of all vibrating tiles |
| pairs2 | sum w_ij = W | - | 2 (rows (columns - 1) + columns (rows - 1)) |
| Moran index | E_MI | - | (links2 - 2 f sides) / (W f (1 - f)) + f / (1 - f) |
| entropy | E_e | - | S / (N_v log2 N_v), S as above |
| energy | | - | hypot(E_MI - its target, entropy_weight * (E_e - its target)) |

A swap is accepted if the new energy is at most the old energy - temperature * log(u), with a uniform number u
(Metropolis). The energy is at least its first term, that of the Moran index, which is cheap to compute. So many
swaps are rejected by this term alone, before any cluster is updated.
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
    """The arrays of the module's first table; ``stride`` is the number of cells of a row of the grid with its
    border."""

    tile: Cells
    """(cells,): 1 vibrating, 0 still."""
    label: Cells
    """(cells,): number of the cluster of each vibrating cell, 0 for still cells."""
    size: Cells
    """(cells + 1,): number of tiles of the cluster with each label."""
    terms: NDArray[np.float64]
    """(cells + 1,): n log2 n of each number n."""
    free: Cells
    """(cells + 1,): number of unused labels, then the labels; the last one is taken first."""
    stack: Cells
    """(cells,): scratch of ``_flood``."""
    stride: int
    """Number of cells of a row, with the border."""


@allocating_kernel
def no_clusters(cells: int, stride: int) -> Clusters:
    """Return the state of a grid in which no tile vibrates.

    Args:
        cells: number of cells of the grid with its border. stride: number of cells of a row with its border.
    """
    terms = np.zeros(cells + 1)  # n log2 n; 0 for n = 0, a label that is not used
    free = np.zeros(cells + 1, dtype=np.int64)
    free[0] = cells - 1
    for n in range(1, cells):
        free[n] = cells - n  # label 1 is on top of the stack
        terms[n] = n * math.log2(n)
    tile = np.zeros(cells, dtype=np.int64)
    label = np.zeros(cells, dtype=np.int64)
    size = np.zeros(cells + 1, dtype=np.int64)
    stack = np.zeros(cells, dtype=np.int64)
    return Clusters(tile, label, size, terms, free, stack, stride)


@kernel
def add_tile(state: Clusters, cell: int) -> float:
    """Make the still ``cell`` vibrate, joining the clusters beside it; return the change of S, bits times tiles."""
    label, size, stride = state.label, state.size, state.stride
    keep = 0  # label of the largest neighbouring cluster; smaller ones are relabelled, which costs less
    for step in (1, -1, stride, -stride):
        neighbour = label[cell + step]
        if neighbour > 0 and (keep == 0 or size[neighbour] > size[keep]):
            keep = neighbour
    if keep == 0:  # the tile is a cluster of its own, so far of size 0, as are all unused labels
        keep = _new_label(state)
    # S changes by the term of the new, joined cluster less the terms of the clusters that it joins.
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
    """Make the vibrating ``cell`` still, and split its cluster if it connected parts; return the change of S.

    S is in bits times tiles.
    """
    tile, label, size, stride = state.tile, state.label, state.size, state.stride
    old = label[cell]
    # S changes by the terms of the clusters that are left less the term of the old cluster.
    change = -state.terms[size[old]]
    tile[cell] = 0
    label[cell] = 0
    size[old] -= 1
    if size[old] > 0 and _groups_around(tile, stride, cell) <= 1:
        return float(change + state.terms[size[old]])  # the cluster stays connected
    # Give each part of the old cluster a label of its own; there is no part if the tile was alone.
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
    """Relabel all cells that are connected to ``start`` and have label ``old`` to ``new``; return their number."""
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
    """Return the number of groups that the vibrating neighbours of ``cell`` form within the eight cells around it.

    Two neighbours are in one group if the corner cell between them vibrates too. With 0 or 1 groups the neighbours stay
    connected without ``cell``. If all eight cells vibrate, they form a ring, and the result is 0 instead of 1.
    """
    north, south, west, east = tile[cell - stride], tile[cell + stride], tile[cell - 1], tile[cell + 1]
    # joined: number of corners that connect two neighbours; each of them makes one group less
    joined = (
        north * tile[cell - stride + 1] * east
        + east * tile[cell + stride + 1] * south
        + south * tile[cell + stride - 1] * west
        + west * tile[cell - stride - 1] * north
    )
    return int(north + south + west + east - joined)


class Goal(NamedTuple):
    """Target values of the measures; if ``entropy_weight`` is 0, any entropy is accepted."""

    moran_index: float
    """Target of E_MI."""
    entropy: float
    """Target of E_e."""
    entropy_weight: float
    """Weight of the error of E_e in the energy."""


class Schedule(NamedTuple):
    """First and last temperature (units of energy, falling geometrically), number of swaps, energy at which to stop.

    Both temperatures are above 0, and there is at least one swap.
    """

    hot: float
    """First temperature."""
    cold: float
    """Last temperature."""
    moves: int
    """Number of swaps to try."""
    enough: float
    """Energy at which the search stops."""


@kernel
def _vibrating_around(tile: Cells, stride: int, cell: int) -> int:
    return int(tile[cell - 1] + tile[cell + 1] + tile[cell - stride] + tile[cell + stride])


@allocating_kernel
def _degrees(rows: int, columns: int) -> Cells:
    """Return the number of neighbouring tiles of each cell of the grid with its border; 0 for cells of the border."""
    stride = columns + 2
    degree = np.zeros((rows + 2) * stride, dtype=np.int64)
    for row in range(1, rows + 1):
        for column in range(1, columns + 1):
            around = (row > 1) + (row < rows) + (column > 1) + (column < columns)
            degree[row * stride + column] = around
    return degree


@kernel
def _partner(u: float, p: int, zeros: Cells, blanks: int, tile: Cells, rows: int, columns: int) -> int:
    """Draw a still cell to swap with the vibrating cell ``p``.

    With probability 1/2 it is drawn from all still cells, else from the cells at most two rows and columns from ``p``.

    Args:
        u: uniform number in [0, 1). zeros: indices of all still cells. blanks: number of still cells.
    Returns: index of the cell; -1 if the cell that was drawn near ``p`` vibrates or is outside the floor.
    """
    # u < 1/2 selects from all still cells, u >= 1/2 from the cells near p. Within its half u is uniform, and selects
    # the cell.
    if u < 0.5:
        return int(zeros[int(2.0 * u * blanks)])
    stride = columns + 2
    pick = int((2.0 * u - 1.0) * 25.0)  # a cell of the 5 x 5 square around p
    row = p // stride + pick // 5 - 2
    column = p % stride + pick % 5 - 2
    if row < 1 or row > rows or column < 1 or column > columns or tile[row * stride + column] == 1:
        return -1
    return row * stride + column


@kernel
def _place_tiles(
    state: Clusters, degree: Cells, ones: Cells, zeros: Cells, place: Cells
) -> tuple[int, int, float]:
    """Make all cells of ``ones`` vibrate, and write the index of each cell in ``ones`` or ``zeros`` to ``place``.

    Args:
        state: clusters of a floor without vibrating tiles; changed. degree: number of neighbours of each cell.
        ones, zeros: indices of the cells that shall vibrate, and of the other cells of the floor.
        place: (cells,): overwritten; the border's entries stay.
    Returns: links2, sides and S of the module's tables.
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
        goal: target values of the measures. schedule: temperatures, number of swaps, energy at which to stop.
        seed, search: select the uniform numbers, at the addresses (seed, 0, 0, FLOOR, index, 1 + search). So each
            search draws other numbers than all others; random floors use the addresses that end in 0.
    Returns: the best floor found, in the form of ``start``, and its energy.
    """
    stride = columns + 2
    state = no_clusters(start.size, stride)
    tile, degree = state.tile, _degrees(rows, columns)
    place = np.zeros(start.size, dtype=np.int64)  # position of each cell in ``ones`` or ``zeros``
    ones, zeros = np.nonzero(start == 1)[0], np.nonzero((start == 0) & (degree > 0))[0]
    count, blanks = ones.size, zeros.size
    links2, sides, cluster_bits = _place_tiles(state, degree, ones, zeros, place)
    fill = count / (rows * columns)
    # E_MI - goal = (links2 - 2 fill sides) scale + offset
    scale = 1.0 / (2 * (rows * (columns - 1) + columns * (rows - 1)) * fill * (1.0 - fill))
    offset = fill / (1.0 - fill) - goal.moran_index
    most = max(count * math.log2(count), 1.0)  # S of a single cluster; not 0 if only one tile vibrates
    energy = math.hypot(
        (links2 - 2.0 * fill * sides) * scale + offset,
        goal.entropy_weight * (cluster_bits / most - goal.entropy),
    )
    best, best_energy = tile.copy(), energy
    # With this factor per swap the temperature falls from ``hot`` to ``cold`` in the course of the search.
    cooling = (schedule.cold / schedule.hot) ** (1.0 / schedule.moves)
    temperature = schedule.hot
    for move in range(schedule.moves):
        if best_energy <= schedule.enough:
            break
        temperature *= cooling
        pick = uniform(seed, 0, 0, FLOOR, 2 * move, 1 + search) * count
        p = ones[int(pick)]
        # The fraction of ``pick`` is uniform too, and independent of the cell that its integer part selects.
        q = _partner(pick - int(pick), p, zeros, blanks, tile, rows, columns)
        if q < 0:
            continue
        # Moving the vibrating tile from p to q: if they are neighbours, p is no longer a vibrating neighbour of q.
        adjacent = 1 if abs(q - p) == 1 or abs(q - p) == stride else 0
        gained = _vibrating_around(tile, stride, q) - adjacent - _vibrating_around(tile, stride, p)
        new_links2, new_sides = links2 + 2 * gained, sides + degree[q] - degree[p]
        miss = (new_links2 - 2.0 * fill * new_sides) * scale + offset
        # limit: the largest energy at which this swap is accepted (Metropolis)
        limit = energy - temperature * math.log(uniform(seed, 0, 0, FLOOR, 2 * move + 1, 1 + search))
        if abs(miss) > limit:  # rejected by the Moran index alone
            continue
        new_cluster_bits = cluster_bits + remove_tile(state, p) + add_tile(state, q)
        new_energy = math.hypot(miss, goal.entropy_weight * (new_cluster_bits / most - goal.entropy))
        if new_energy > limit:  # rejected: undo the swap
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
