"""Floors of given difficulty: regular floors, then simulated annealing.

Fill ratio, Moran index and entropy depend on each other. Small clusters have long borders, so a low entropy keeps the
Moran index low. In a single cluster tiles are side by side, so an entropy of 1 keeps the Moran index high.

``make_floor`` anneals from a random floor, then from the regular floors nearest to the target, and stops at the first
result within the tolerance. Each swap of a vibrating and a still tile is accepted if the new energy is at most the old
energy - temperature * log(u), with a uniform number u (Metropolis):

| name | symbol | unit | equation |
|---|---|---|---|
| Moran index | E_MI | - | sum over neighbours of (c_i - f)(c_j - f), over their number and f (1 - f) |
| entropy | E_e | - | sum over clusters of abs(C_i) log2 abs(C_i), over N_v log2 N_v |
| energy | | - | hypot(E_MI - its target, E_e - its target); only the first if any entropy will do |

The work is limited by a number of swaps, never by time, so the same arguments give the same floor. The "miss" of a
floor is the larger error of its Moran index and its entropy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, kernel
from vibroswarm.core.rng import FLOOR, uniform
from vibroswarm.errors import InputError, number_of
from vibroswarm.floors.difficulty import Difficulty, measure
from vibroswarm.floors.source import random_tiles

Cells = NDArray[np.int64]
"""Tiles with a border of 0 around them, row after row."""

TOLERANCE: Final = 0.02
"""Allowed deviation of a measure from its target."""
TILE_LIMIT: Final = 10_000
"""Number of tiles of the largest floor that can be designed."""
MOVES: Final = 150_000
"""Number of swaps that a search tries."""
ENOUGH: Final = 0.002
"""Energy at which a search stops, well within the tolerance."""
REGULAR_STARTS: Final = 4
"""Number of regular floors, those nearest to the target, from which searches start."""


class FloorDesign(NamedTuple):
    """A designed floor."""

    tiles: NDArray[np.uint8]
    """(rows, columns): the floor nearest to the targets that was found."""
    difficulty: Difficulty
    reached: bool
    """Whether all targets are met within ``TOLERANCE``."""


def make_floor(
    rows: int,
    columns: int,
    fill_ratio: float,
    moran_index: float,
    entropy: float | None = None,
    seed: int = 0,
) -> FloorDesign:
    """Design a floor of given size and difficulty, with each measure within ``TOLERANCE``.

    If no such floor is found, return the nearest one that was found, with ``reached`` false. ``reached`` is also false
    if the whole number of vibrating tiles makes the fill ratio deviate by more than ``TOLERANCE``.

    Args:
        rows, columns: size of the floor, at most ``TILE_LIMIT`` tiles in all.
        fill_ratio: share of vibrating tiles, strictly between 0 and 1; their number is rounded to a whole one.
        moran_index: E_MI, in [-1, 1]. entropy: E_e, in [0, 1]; None: any.
        seed: in [0, 2^63); another seed makes another floor.
    Raises:
        InputError: an argument is out of its range, or a measure is undefined, as no tile, all tiles or, for the
            entropy, a single tile would vibrate.
    """
    count, ones = rows * columns, round(number_of(fill_ratio, "fill_ratio", 0.0, 1.0) * rows * columns)
    if not 1 <= ones < count <= TILE_LIMIT or (entropy is not None and ones < 2):
        raise InputError(
            f"{fill_ratio:g} of {count} tiles leaves a measure without a value, or these are more than {TILE_LIMIT:,}",
            field="fill_ratio",
        )
    goal = _Goal(moran_index, math.nan if entropy is None else entropy)
    regular = sorted(constructions(rows, columns, ones), key=lambda tiles: goal.miss(measure(tiles)))
    starts = [random_tiles(rows, columns, ones / count, seed, 0), *regular[:REGULAR_STARTS]]
    found: list[tuple[float, NDArray[np.uint8]]] = []  # the miss of each floor, and the floor
    for search, start in enumerate(starts):
        cells, hot = np.pad(start.astype(np.int64), 1).ravel(), 1.0 if search else 10.0
        annealed = _anneal(cells, rows, columns, goal, hot, seed, search).reshape(rows + 2, columns + 2)
        tiles = annealed[1:-1, 1:-1].astype(np.uint8)
        found.append((goal.miss(measure(tiles)), tiles))
        if found[-1][0] <= TOLERANCE:
            break
    miss, tiles = min(found, key=lambda pair: pair[0])
    difficulty = measure(tiles)
    slack = 1e-9  # rounding: |12 / 25 - 0.5| is slightly above 0.02 in double precision, and must pass
    reached = max(miss, abs(difficulty.fill_ratio - fill_ratio)) <= TOLERANCE + slack
    return FloorDesign(tiles, difficulty, reached)


class _Goal(NamedTuple):
    """Target values of the measures; an entropy of nan stands for any."""

    moran_index: float
    entropy: float

    def miss(self, found: Difficulty) -> float:
        return float(np.fmax(abs(found.moran_index - self.moran_index), abs(found.entropy - self.entropy)))


def constructions(rows: int, columns: int, ones: int) -> Iterator[NDArray[np.uint8]]:
    """Yield regular floors, extremes: stripes, a square, combs, checkerboards; uint8, (rows, columns)."""
    r, c = np.indices((rows, columns))
    for first, second in ((r, c), (c, r)):
        yield _filled(ones, first, second)  # stripe
        yield _filled(ones, (second > 0) & (first % 2), first, second)  # comb: ``second == 0`` is its back
    yield _filled(ones, np.maximum(r, c), r)  # square in a corner
    for side in range(1, max(2, max(rows, columns) // 2 + 1)):
        yield _filled(ones, (r // side + c // side) % 2, r // side, c)
        yield _filled(ones, (r // side + c // side + 1) % 2, r // side, c)


def _filled(ones: int, *keys: NDArray[np.int_]) -> NDArray[np.uint8]:
    """Return the floor whose first ``ones`` tiles vibrate, by ``keys`` (the first counts most), row, column."""
    order = np.lexsort([np.ravel(key) for key in reversed(keys)])  # which takes the most significant key last
    tiles = np.zeros(keys[0].shape, dtype=np.uint8)
    tiles.ravel()[order[:ones]] = 1
    return tiles


@allocating_kernel
def _anneal(start: Cells, rows: int, columns: int, goal: _Goal, hot: float, seed: int, search: int) -> Cells:
    """Swap vibrating and still tiles until the floor meets the goal or the swaps are used up; return the best.

    The last temperature is 0.05. Numbers are at (seed, 0, 0, FLOOR, index, 1 + search); random floors use 0.
    """
    cells, best = start.copy(), start.copy()
    stack, label = np.zeros_like(cells), np.zeros_like(cells)
    ones = np.nonzero(cells)[0]
    fill = ones.size / (rows * columns)
    step = 1.0 / ((rows * (columns - 1) + columns * (rows - 1)) * fill * (1.0 - fill))
    energy = _energy(cells, rows, columns, goal, math.inf, label, stack)
    best_energy, temperature = energy, hot * step
    for move in range(MOVES):
        if best_energy <= ENOUGH:
            break
        temperature *= (0.05 / hot) ** (1.0 / MOVES)
        pick = uniform(seed, 0, 0, FLOOR, 2 * move, 1 + search) * ones.size
        k = int(pick)
        p = ones[k]
        q = _partner(pick - k, p, rows, columns)  # the fraction of ``pick`` is uniform too
        if cells[q] == 1:
            continue
        limit = energy - temperature * math.log(uniform(seed, 0, 0, FLOOR, 2 * move + 1, 1 + search))
        cells[p], cells[q] = 0, 1
        swapped = _energy(cells, rows, columns, goal, limit, label, stack)
        if swapped > limit:
            cells[p], cells[q] = 1, 0
            continue
        ones[k], energy = q, swapped
        if energy < best_energy:
            best_energy = energy
            best[:] = cells
    return best


@kernel
def _partner(u: float, p: int, rows: int, columns: int) -> int:
    """Draw a cell of the floor: by half any, by half one at most two rows and columns from ``p``, if it is inside."""
    row, column = p // (columns + 2), p % (columns + 2)
    near = int((2.0 * u - 1.0) * 25.0)
    if u < 0.5:
        row, column = divmod(int(2.0 * u * rows * columns), columns)
        row, column = row + 1, column + 1
    elif 0 < row + near // 5 - 2 <= rows and 0 < column + near % 5 - 2 <= columns:
        row, column = row + near // 5 - 2, column + near % 5 - 2
    return int(row * (columns + 2) + column)


@kernel
def _energy(
    cells: Cells, rows: int, columns: int, goal: _Goal, limit: float, label: Cells, stack: Cells
) -> float:
    stride, ones, products = columns + 2, cells.sum(), 0.0
    fill = ones / (rows * columns)
    for row in range(1, rows + 1):
        for cell in range(row * stride + 1, row * stride + 1 + columns):
            right = cells[cell + 1] - fill if cell < row * stride + columns else 0.0
            below = cells[cell + stride] - fill if row < rows else 0.0
            products += (cells[cell] - fill) * (right + below)
    pairs = rows * (columns - 1) + columns * (rows - 1)
    miss = abs(products / (pairs * fill * (1.0 - fill)) - goal.moran_index)
    if math.isnan(goal.entropy) or miss > limit:
        return float(miss)
    return math.hypot(
        miss, _cluster_bits(cells, stride, label, stack) / (ones * math.log2(ones)) - goal.entropy
    )


@kernel
def _cluster_bits(cells: Cells, stride: int, label: Cells, stack: Cells) -> float:
    """Return the sum of n log2 n over all clusters; ``label`` and ``stack`` are overwritten."""
    total = 0.0
    for cell in range(cells.size):
        label[cell] = cells[cell]  # 1: vibrates, and was not yet reached
    for start in range(cells.size):
        if label[start] == 0:
            continue
        label[start], stack[0] = 0, start
        waiting, count = 1, 0
        while waiting > 0:
            waiting -= 1
            cell = stack[waiting]
            count += 1
            for step in (1, -1, stride, -stride):
                if label[cell + step] == 1:
                    label[cell + step] = 0
                    stack[waiting] = cell + step
                    waiting += 1
        total += count * math.log2(count)
    return total
