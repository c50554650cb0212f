"""Clusters of vibrating tiles, kept step by step while tiles change, compiled.

| name | symbol | shape | meaning |
|---|---|---|---|
| tile | c_i | (cells,) | 1 vibrating, 0 still; the grid with a border of 0 around it, row after row |
| label | | (cells,) | the cluster of each vibrating cell; 0: none |
| size | abs(C_i) | (cells + 1,) | tiles of the cluster with this label |
| terms | n log2 n | (cells + 1,) | the sum of ``terms[size]`` over the clusters is S = N_v (H_c^max - H_c) |
| free | | (cells + 1,) | the unused labels are ``free[1:1 + free[0]]`` |
| stack | | (cells,) | room to work in |

The entropy is S / (N_v log2 N_v). A tile that goes can split its cluster only if its neighbours do not hang
together around it, so most changes cost a handful of additions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import allocating_kernel, kernel

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
    """Still tiles only."""
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
def put(state: Clusters, cell: int) -> float:
    """Make the still ``cell`` vibrate; the change of S, bits times tiles."""
    label, size, stride = state.label, state.size, state.stride
    keep = 0
    for step in (1, -1, stride, -stride):
        near = label[cell + step]
        if near > 0 and (keep == 0 or size[near] > size[keep]):
            keep = near
    if keep == 0:
        keep = _new_label(state)
    change = -state.terms[size[keep]]
    for step in (1, -1, stride, -stride):
        other = label[cell + step]
        if other > 0 and other != keep:
            change -= state.terms[size[other]]
            size[keep] += _flood(state, cell + step, other, keep)
            _give_back(state, other)
    state.tile[cell] = 1
    label[cell] = keep
    size[keep] += 1
    return float(change + state.terms[size[keep]])


@kernel
def take(state: Clusters, cell: int) -> float:
    """Make the vibrating ``cell`` still; the change of S, bits times tiles."""
    tile, label, size, stride = state.tile, state.label, state.size, state.stride
    old = label[cell]
    change = -state.terms[size[old]]
    tile[cell] = 0
    label[cell] = 0
    size[old] -= 1
    if size[old] > 0 and _groups_around(tile, stride, cell) <= 1:
        return float(change + state.terms[size[old]])
    for step in (1, -1, stride, -stride):
        near = cell + step
        if tile[near] == 1 and label[near] == old:
            new = _new_label(state)
            size[new] = _flood(state, near, old, new)
            change += state.terms[size[new]]
    _give_back(state, old)
    return float(change)


@kernel
def _new_label(state: Clusters) -> int:
    new = state.free[state.free[0]]
    state.free[0] -= 1
    return int(new)


@kernel
def _give_back(state: Clusters, label: int) -> None:
    state.free[0] += 1
    state.free[state.free[0]] = label
    state.size[label] = 0


@kernel
def _flood(state: Clusters, start: int, old: int, new: int) -> int:
    """Relabel what hangs together with ``start`` from ``old`` to ``new``; how many cells that were."""
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
            near = cell + step
            if label[near] == old:
                label[near] = new
                stack[waiting] = near
                waiting += 1
    return count


@kernel
def _groups_around(tile: Cells, stride: int, cell: int) -> int:
    """Into how many groups the vibrating neighbours of ``cell`` fall, seen in the ring of eight around it.

    0 where all eight vibrate, as the ring closes: read it as one.
    """
    north, south, west, east = tile[cell - stride], tile[cell + stride], tile[cell - 1], tile[cell + 1]
    joined = (
        north * tile[cell - stride + 1] * east
        + east * tile[cell + stride + 1] * south
        + south * tile[cell + stride - 1] * west
        + west * tile[cell - stride - 1] * north
    )
    return int(north + south + west + east - joined)
