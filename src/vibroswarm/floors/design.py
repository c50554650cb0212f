"""Floors of given difficulty: regular constructions, then simulated annealing.

The regular constructions cover any size and fill ratio. Each is an order of the tiles, of which the first ``ones``
tiles vibrate. They mark the extremes of what is possible: stripes and corners (high Moran index, one cluster),
checkerboards of larger and larger squares (the highest Moran index that small clusters allow), combs (one cluster, yet
a low Moran index).

Fill ratio, Moran index and entropy depend on each other. Small clusters have long borders, so a low entropy keeps the
Moran index low. In a single cluster tiles are side by side, so an entropy of 1 keeps the Moran index high.
``make_floor`` anneals from a random floor, then from the regular floors nearest to the target, and stops at the first
result within the tolerance. The work is limited by a number of swaps, never by time, so the same arguments give the
same floor. The "miss" of a floor is the larger error of its Moran index and its entropy.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from numbers import Real
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError, shown, whole_number_of
from vibroswarm.floors.anneal import Goal, Schedule, anneal
from vibroswarm.floors.difficulty import Difficulty, measure
from vibroswarm.floors.source import random_tiles


def constructions(rows: int, columns: int, ones: int) -> Iterator[NDArray[np.uint8]]:
    """Yield all regular floors of this size and number of vibrating tiles, each uint8 of shape (rows, columns).

    ``_filled`` sorts the tiles by the keys given to it, the first key being the most significant; the first ``ones``
    tiles vibrate. Keys are computed from r and c, the row and the column of each tile. A floor may be yielded twice.
    """
    r, c = np.indices((rows, columns))
    for first, second in ((r, c), (c, r)):
        yield _filled(ones, first, second)  # stripe
        # comb: the line ``second == 0`` is its back, and every other line ``first`` is a tooth.
        yield _filled(ones, (second > 0) & (first % 2), first, second)
        yield _filled(ones, first % 2, first, second)  # separate lines
    yield _filled(ones, np.maximum(r, c), r)  # square in a corner
    yield _filled(ones, np.maximum(r * columns, c * rows), r)  # rectangle in a corner
    yield _filled(ones, r + c, r)  # triangle in a corner
    # Square in the middle: by the larger distance from the middle row or column, doubled so that it is whole.
    yield _filled(ones, np.maximum(abs(2 * r - rows + 1), abs(2 * c - columns + 1)), r)
    # Squares of 1 x 1 tiles up to half of the floor's longer side, so that there are at least two of them; on a floor
    # of one tile this half is 0, and squares of 1 x 1 are used all the same.
    for side in range(1, max(2, max(rows, columns) // 2 + 1)):
        for first, second in ((r, c), (c, r)):
            yield _filled(ones, (r // side + c // side) % 2, first // side, second)  # checkerboard of squares
        # Checkerboard with its colours exchanged.
        yield _filled(ones, (r // side + c // side + 1) % 2, r // side, c)
        # gap: 0 inside a square, 1 in a gap between rows or between columns of squares, 2 where such gaps cross
        gap = (r % (side + 1) == side).astype(int) + (c % (side + 1) == side)
        yield _filled(ones, gap, r // (side + 1), c)  # squares with gaps of one tile


def _filled(ones: int, *keys: NDArray[np.int_]) -> NDArray[np.uint8]:
    """Return the floor whose first ``ones`` tiles vibrate, by ``keys`` (the first counts most), row, column."""
    # Lexsort takes the most significant key last.
    order = np.lexsort([np.ravel(key) for key in reversed(keys)])
    tiles = np.zeros(keys[0].shape, dtype=np.uint8)
    tiles.ravel()[order[:ones]] = 1
    return tiles


TOLERANCE: Final = 0.02
"""Allowed deviation of a measure from its target."""

TILE_LIMIT: Final = 10_000
"""Number of tiles of the largest floor that can be designed; larger floors would need more swaps than a search has."""

_MOVES: Final = 150_000
"""Number of swaps that a search tries."""
_LONGER: Final = 3
"""Number of swaps of a longer search, as a multiple of _MOVES."""
_ENOUGH: Final = 0.002
"""Miss at which a search stops, well within the tolerance."""
_REGULAR_STARTS: Final = 4
"""Number of regular floors, those nearest to the target, from which searches start."""
_MENDABLE_MISS: Final = 0.1
"""If short searches miss by more than this, longer searches do not help."""


@dataclass(frozen=True)
class FloorDesign:
    """A designed floor.

    Args:
        tiles: uint8, (rows, columns): the floor nearest to the targets that was found.
        difficulty: measures of this floor.
        reached: whether all targets are met within ``TOLERANCE``.
    """

    tiles: NDArray[np.uint8]
    difficulty: Difficulty
    reached: bool


@dataclass(frozen=True)
class _Target:
    """What a floor shall be: the arguments of ``make_floor``, and ``ones``, the whole number of vibrating tiles."""

    rows: int
    columns: int
    fill_ratio: float
    ones: int
    moran_index: float
    entropy: float | None
    seed: int

    def miss(self, found: Difficulty) -> float:
        """Return the larger error of Moran index and entropy; if ``entropy`` is None, the error of the Moran index."""
        miss = abs(found.moran_index - self.moran_index)
        return miss if self.entropy is None else max(miss, abs(found.entropy - self.entropy))

    def is_met(self, found: Difficulty) -> bool:
        """Return whether all targets are met, including the fill ratio."""
        slack = 1e-9  # rounding: |12 / 25 - 0.5| is slightly above 0.02 in double precision, and must pass
        return max(self.miss(found), abs(found.fill_ratio - self.fill_ratio)) <= TOLERANCE + slack

    def goal(self) -> Goal:
        """Return the target of ``anneal``."""
        if self.entropy is None:
            # With a weight of 0 the target entropy has no effect.
            return Goal(self.moran_index, entropy=0.0, entropy_weight=0.0)
        return Goal(self.moran_index, self.entropy, entropy_weight=1.0)


class _Found(NamedTuple):
    """A floor, uint8 of shape (rows, columns), with its measures and its miss of the target."""

    tiles: NDArray[np.uint8]
    difficulty: Difficulty
    miss: float


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
    target = _target(rows, columns, fill_ratio, moran_index, entropy, seed)
    best: _Found | None = None
    for search, (start, first_temperature, moves) in enumerate(_searches(target)):
        is_longer = moves > _MOVES
        if is_longer and best is not None and best.miss > _MENDABLE_MISS:
            continue  # the miss is too large for a longer search to help
        found = _anneal(target, start, first_temperature, moves, search)
        best = found if best is None or found.miss < best.miss else best
        if best.miss <= TOLERANCE:
            break
    assert best is not None  # there is at least one search, and the first ones are not longer searches
    return FloorDesign(best.tiles, best.difficulty, target.is_met(best.difficulty))


def _target(
    rows: int, columns: int, fill_ratio: float, moran_index: float, entropy: float | None, seed: int
) -> _Target:
    """Check the arguments of ``make_floor``, and return them with the whole number of vibrating tiles.

    Raises:
        InputError: an argument is out of its range, or a measure is undefined, as no tile, all tiles or, for the
            entropy, a single tile would vibrate.
    """
    rows = whole_number_of(rows, "rows", 1, TILE_LIMIT)
    columns = whole_number_of(columns, "columns", 1, TILE_LIMIT)
    seed = whole_number_of(seed, "seed", 0, 2**63 - 1)
    numbers = {"fill_ratio": fill_ratio, "moran_index": moran_index, "entropy": entropy}
    for name, value in numbers.items():
        if not isinstance(value, Real) and (name != "entropy" or value is not None):
            raise InputError(f"{shown(value)} is not a number", field=name)
    if not 0 <= fill_ratio <= 1:
        raise InputError(f"{shown(fill_ratio)} is not a share; give a number from 0 to 1", field="fill_ratio")
    if rows * columns > TILE_LIMIT:
        raise InputError(
            f"{rows} x {columns} tiles are too many to make; at most {TILE_LIMIT:,}", field="tiles"
        )
    if not -1 <= moran_index <= 1:
        raise InputError(
            f"{shown(moran_index)} is not a Moran index; give a number from -1 to 1", field="moran_index"
        )
    ones = round(fill_ratio * rows * columns)
    if ones in (0, rows * columns):
        raise InputError(
            f"{fill_ratio:g} of {rows} x {columns} tiles leaves all tiles alike, and the Moran index without "
            "a value; give a fill ratio that leaves at least one tile of each kind",
            field="fill_ratio",
        )
    if entropy is not None:
        if not 0 <= entropy <= 1:
            raise InputError(
                f"{shown(entropy)} is not an entropy; give a number from 0 to 1", field="entropy"
            )
        if ones < 2:
            raise InputError(
                "one vibrating tile has no entropy; give a higher fill ratio, or no entropy", field="entropy"
            )
    entropy = None if entropy is None else float(entropy)
    return _Target(rows, columns, float(fill_ratio), ones, float(moran_index), entropy, seed)


def _searches(target: _Target) -> Iterator[tuple[NDArray[np.uint8], float, int]]:
    """Yield the start floor, the first temperature and the number of swaps of each search; longer searches come last.

    The unit of temperature is the change of the Moran index by one more pair of vibrating neighbours.
    """
    scattered = random_tiles(
        target.rows, target.columns, target.ones / (target.rows * target.columns), target.seed, 0
    )
    yield scattered, 10.0, _MOVES  # hot: nothing of the random start needs to last
    regular = constructions(target.rows, target.columns, target.ones)
    # Sort by miss; floors of equal miss stay in the order of ``constructions``.
    ranked = sorted(((target.miss(measure(tiles)), tiles) for tiles in regular), key=lambda pair: pair[0])
    # Regular floors begin at a low temperature, so that they are changed little: they are near the target already.
    for _, tiles in ranked[:_REGULAR_STARTS]:
        yield tiles, 1.0, _MOVES
    # If all of these miss: longer searches from the random floor (now cooler) and from the best regular floor.
    yield scattered, 3.0, _LONGER * _MOVES
    yield ranked[0][1], 1.0, _LONGER * _MOVES


def _anneal(target: _Target, start: NDArray[np.uint8], hot: float, moves: int, search: int) -> _Found:
    """Run simulated annealing from a start floor; return the best floor with its measures.

    Args:
        start: uint8, (rows, columns). moves: number of swaps to try. search: number of the search, which selects its
            random numbers. hot: first temperature; its unit is the change of the Moran index by one more pair of
            vibrating neighbours.
    """
    fill = target.ones / (target.rows * target.columns)
    pairs = target.rows * (target.columns - 1) + target.columns * (target.rows - 1)
    step = 1.0 / (pairs * fill * (1.0 - fill))  # change of the Moran index by one pair of neighbours
    # The search ends cold: a swap that worsens the floor by one pair of neighbours is then practically never accepted.
    schedule = Schedule(hot=hot * step, cold=0.05 * step, moves=moves, enough=_ENOUGH)
    cells = np.pad(start.astype(np.int64), 1).ravel()  # with a border of still cells, as ``anneal`` needs
    best, _ = anneal(cells, target.rows, target.columns, target.goal(), schedule, target.seed, search)
    tiles = best.reshape(target.rows + 2, target.columns + 2)[1:-1, 1:-1].astype(np.uint8)
    difficulty = measure(tiles)
    return _Found(tiles, difficulty, target.miss(difficulty))
