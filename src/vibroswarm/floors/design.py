"""Floors of given difficulty: regular constructions, then simulated annealing.

The regular constructions cover any size and fill ratio. Each is an order in which the tiles are made to vibrate;
the first ``ones`` of them do. They mark the extremes of what is possible: stripes and corners (high Moran index,
one cluster), checkerboards of ever larger squares (the highest Moran index that small clusters allow), combs (one
cluster, yet a low Moran index).

Fill ratio, Moran index and entropy depend on each other. Small clusters have long borders, so a low entropy keeps
the Moran index low; a single cluster has its tiles side by side, so an entropy of 1 keeps the Moran index up.
``make_floor`` anneals from a random floor, then from the regular floors nearest to the target, and stops at the
first result within the tolerance. The work is bounded by a number of moves, never by a clock: the same arguments
give the same floor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from numbers import Real
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, shown, whole_number_of
from vibroswarm.floors.anneal import Goal, Schedule, anneal
from vibroswarm.floors.difficulty import Difficulty, measure
from vibroswarm.floors.floor import check_size
from vibroswarm.floors.source import check_fill_ratio, random_tiles


def constructions(rows: int, columns: int, ones: int) -> Iterator[NDArray[np.uint8]]:
    """Yield all regular floors of this size and number of vibrating tiles, each uint8 of shape (rows, columns)."""
    r, c = np.indices((rows, columns))
    for first, second in ((r, c), (c, r)):
        yield _filled(ones, first, second)  # stripe
        yield _filled(ones, (second > 0) & (first % 2), first, second)  # comb
        yield _filled(ones, first % 2, first, second)  # separate lines
    yield _filled(ones, np.maximum(r, c), r)  # square in a corner
    yield _filled(ones, np.maximum(r * columns, c * rows), r)  # rectangle in a corner
    yield _filled(ones, r + c, r)  # triangle in a corner
    # square in the middle
    yield _filled(ones, np.maximum(abs(2 * r - rows + 1), abs(2 * c - columns + 1)), r)
    for side in range(1, max(2, max(rows, columns) // 2 + 1)):
        for first, second in ((r, c), (c, r)):
            yield _filled(ones, (r // side + c // side) % 2, first // side, second)  # checkerboard of squares
        yield _filled(ones, (r // side + c // side + 1) % 2, r // side, c)
        gap = (r % (side + 1) == side).astype(int) + (c % (side + 1) == side)
        yield _filled(ones, gap, r // (side + 1), c)  # squares with gaps of one tile


def _filled(ones: int, *keys: NDArray[np.int_]) -> NDArray[np.uint8]:
    """Return the floor whose first ``ones`` tiles in the order of ``keys`` (first key first) vibrate."""
    order = np.lexsort([np.ravel(key) for key in reversed(keys)])
    tiles = np.zeros(keys[0].shape, dtype=np.uint8)
    tiles.ravel()[order[:ones]] = 1
    return tiles


TOLERANCE: Final = 0.02
"""Allowed deviation of a measure from its target."""

TILE_LIMIT: Final = 10_000
"""Size of the largest floor that is designed: for larger ones the moves are too few."""

_MOVES: Final = 150_000
_LONGER: Final = 3
_MUST_WEIGHT: Final = 20.0  # weight of a measure that must be met
_ENOUGH: Final = 0.002  # miss at which a search stops, well within the tolerance
_REGULAR_STARTS: Final = 4
_MENDABLE_MISS: Final = 0.1  # a longer search does not mend a larger miss


@dataclass(frozen=True)
class FloorDesign(NotebookView):
    """A designed floor.

    Args:
        tiles: uint8, (rows, columns): the nearest found, whether it is near enough or not.
        difficulty: its measures.
        reached: whether all targets are met within ``TOLERANCE``.
        words: the measures reached; if they miss the targets, the nearest found.
    """

    tiles: NDArray[np.uint8]
    difficulty: Difficulty
    reached: bool
    words: str


@dataclass(frozen=True)
class _Target:
    rows: int
    columns: int
    fill_ratio: float
    ones: int
    moran_index: float
    entropy: float | None
    seed: int

    def miss(self, found: Difficulty) -> float:
        """Return the larger of the misses of Moran index and entropy."""
        miss = abs(found.moran_index - self.moran_index)
        return miss if self.entropy is None else max(miss, abs(found.entropy - self.entropy))

    def is_met(self, found: Difficulty) -> bool:
        """Return whether all targets are met, including the fill ratio."""
        slack = 1e-9  # 12 of 25 tiles are within 0.02 of 0.5
        return max(self.miss(found), abs(found.fill_ratio - self.fill_ratio)) <= TOLERANCE + slack

    def goal(self, moran_weight: float = 1.0, entropy_weight: float = 1.0) -> Goal:
        if self.entropy is None:
            return Goal(self.moran_index, 0.0, 1.0, 0.0)
        return Goal(self.moran_index, self.entropy, moran_weight, entropy_weight)


class _Found(NamedTuple):
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
    """Design a floor of given size and difficulty, each measure within ``TOLERANCE``; or the nearest found.

    Args:
        rows, columns: number of tiles, at most ``TILE_LIMIT`` in all.
        fill_ratio: share of vibrating tiles, strictly between 0 and 1. The number of vibrating tiles is exact
            where the tiles can give it, and else the nearest.
        moran_index: E_MI, in [-1, 1]. entropy: E_e, in [0, 1]; None: any.
        seed: in [0, 2^63); another seed makes another floor.
    Raises:
        InputError: any of these is not so, or a measure that has no value with so few vibrating tiles.
    """
    target = _target(rows, columns, fill_ratio, moran_index, entropy, seed)
    best: _Found | None = None
    for search, (start, hot, moves) in enumerate(_searches(target)):
        if moves > _MOVES and best is not None and best.miss > _MENDABLE_MISS:
            continue
        best = _better(best, _anneal(target, target.goal(), start, hot, moves, search))
        if best.miss <= TOLERANCE:
            break
    assert best is not None
    traded = _traded(target, best.tiles) if entropy is not None and best.miss > TOLERANCE else []
    for candidate in traded:
        best = _better(best, candidate)
    reached = target.is_met(best.difficulty)
    words = _reached(target, best.difficulty) if reached else _nearest(target, best.difficulty, traded)
    return FloorDesign(best.tiles, best.difficulty, reached, words)


def _better(one: _Found | None, other: _Found) -> _Found:
    return other if one is None or other.miss < one.miss else one


def _target(
    rows: int, columns: int, fill_ratio: float, moran_index: float, entropy: float | None, seed: int
) -> _Target:
    """Check the requested measures and return them as a target."""
    rows = whole_number_of(rows, "rows", -(2**31), 2**31 - 1)
    columns = whole_number_of(columns, "columns", -(2**31), 2**31 - 1)
    seed = whole_number_of(seed, "seed", 0, 2**63 - 1)
    numbers = {"fill_ratio": fill_ratio, "moran_index": moran_index, "entropy": entropy}
    for name, value in numbers.items():
        if not isinstance(value, Real) and (name != "entropy" or value is not None):
            raise InputError(f"{shown(value)} is not a number", field=name)
    check_size(rows, columns)
    check_fill_ratio(fill_ratio)
    if rows * columns > TILE_LIMIT:
        raise InputError(
            f"{rows} x {columns} tiles are too many to make; at most {TILE_LIMIT}", field="tiles"
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
    """Yield where to start, how hot (in steps of the Moran index), and the number of moves."""
    scattered = random_tiles(
        target.rows, target.columns, target.ones / (target.rows * target.columns), target.seed, 0
    )
    yield scattered, 10.0, _MOVES
    regular = constructions(target.rows, target.columns, target.ones)
    ranked = sorted(
        ((target.miss(measure(tiles)), i, tiles) for i, tiles in enumerate(regular)), key=lambda r: r[:2]
    )
    for _, _, tiles in ranked[:_REGULAR_STARTS]:
        yield tiles, 1.0, _MOVES
    yield scattered, 3.0, _LONGER * _MOVES
    yield ranked[0][2], 1.0, _LONGER * _MOVES


def _traded(target: _Target, start: NDArray[np.uint8]) -> list[_Found]:
    """Return the nearest floors if the Moran index must be met, and if the entropy must be met."""
    weights = (_MUST_WEIGHT, 1.0), (1.0, _MUST_WEIGHT)
    hot = _MUST_WEIGHT
    return [
        _anneal(target, target.goal(*pair), start, hot, _MOVES, 100 + i) for i, pair in enumerate(weights)
    ]


def _anneal(
    target: _Target, goal: Goal, start: NDArray[np.uint8], hot: float, moves: int, search: int
) -> _Found:
    """Run simulated annealing from a start floor; return the best floor with its measures."""
    fill = target.ones / (target.rows * target.columns)
    pairs = target.rows * (target.columns - 1) + target.columns * (target.rows - 1)
    step = 1.0 / (pairs * fill * (1.0 - fill))  # change of the Moran index by one pair of neighbours
    schedule = Schedule(hot * step, 0.05 * step, moves, _ENOUGH)
    cells = np.pad(start.astype(np.int64), 1).ravel()
    best, _ = anneal(cells, target.rows, target.columns, goal, schedule, target.seed, search)
    tiles = best.reshape(target.rows + 2, target.columns + 2)[1:-1, 1:-1].astype(np.uint8)
    difficulty = measure(tiles)
    return _Found(tiles, difficulty, target.miss(difficulty))


def _reached(target: _Target, found: Difficulty) -> str:
    words = f"made: {_size(target)}, fill ratio {found.fill_ratio:.4g}, Moran index {found.moran_index:.3f}"
    return words + ("" if math.isnan(found.entropy) else f", entropy {found.entropy:.3f}")


def _nearest(target: _Target, found: Difficulty, traded: list[_Found]) -> str:
    """Explain that no floor reaches the target, and describe the closest one."""
    target_text = f"Moran index {target.moran_index:g}"
    has = f"fill ratio {found.fill_ratio:.4g}, Moran index {found.moran_index:.3f}"
    if target.entropy is not None:
        target_text += f" with entropy {target.entropy:g}"
        has += f", entropy {found.entropy:.3f}"
    words = (
        f"not found: fill ratio {target.fill_ratio:g} and {target_text}, each to {TOLERANCE:g}, on {_size(target)}. "
        f"The nearest found has {has}"
    )
    if traded:
        moran, entropy = (floor.difficulty for floor in traded)
        words += (
            f". With Moran index {moran.moran_index:.3f} the nearest entropy found is {moran.entropy:.3f}; "
            f"with entropy {entropy.entropy:.3f} the nearest Moran index found is {entropy.moran_index:.3f}"
        )
    return words


def _size(target: _Target) -> str:
    return f"{target.rows} x {target.columns} tiles of which {target.ones} vibrate"
