"""Making a floor of given difficulty: fill ratio, Moran index, and where both can be had, entropy.

The three are not free of each other. Small clusters have long borders, so a low entropy keeps the Moran
index low; a single cluster has its tiles side by side, so an entropy of 1 keeps the Moran index up.
``make_floor`` anneals from a random floor, then from the regular floors nearest to what is asked, and stops
at the first that is within the tolerance. The work is bounded by a number of moves, never by a clock: the
same arguments give the same floor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.anneal import Goal, Schedule, anneal
from vibroswarm.floors.constructions import constructions
from vibroswarm.floors.difficulty import Difficulty, measure
from vibroswarm.floors.floor import check_size
from vibroswarm.floors.random import check_fill_ratio, check_seed, random_tiles

TOLERANCE: Final = 0.02
"""How far a measure may be from what was asked."""

TILE_LIMIT: Final = 10_000
"""The largest floor that is made: beyond it the moves are too few."""

_MOVES: Final = 150_000
_LONGER: Final = 3
_INSIST: Final = 20.0  # weight of the one measure that is insisted on
_ENOUGH: Final = 0.002  # a search stops here, well within the tolerance
_REGULAR_STARTS: Final = 4
_WITHIN_SIGHT: Final = 0.1  # a miss beyond this is not mended by a longer search


@dataclass(frozen=True)
class Made:
    """A floor that was made.

    Args:
        tiles: uint8, (rows, columns): the nearest found, whether it is near enough or not.
        difficulty: its measures.
        reached: whether all that was asked is met to ``TOLERANCE``.
        words: what was reached; if not what was asked, what is nearest.
    """

    tiles: NDArray[np.uint8]
    difficulty: Difficulty
    reached: bool
    words: str


@dataclass(frozen=True)
class _Wish:
    rows: int
    columns: int
    fill_ratio: float
    ones: int
    moran_index: float
    entropy: float | None
    seed: int

    def miss(self, found: Difficulty) -> float:
        """The larger of the misses of Moran index and entropy."""
        miss = abs(found.moran_index - self.moran_index)
        return miss if self.entropy is None else max(miss, abs(found.entropy - self.entropy))

    def met(self, found: Difficulty) -> bool:
        """Whether all that was asked, the fill ratio included, is met."""
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
) -> Made:
    """A floor of given size and difficulty, each measure to ``TOLERANCE``; or the nearest found.

    Args:
        rows, columns: number of tiles, at most ``TILE_LIMIT`` in all.
        fill_ratio: share of vibrating tiles, strictly between 0 and 1. The number of vibrating tiles is exact
            where the tiles can give it, and else the nearest.
        moran_index: E_MI, in [-1, 1]. entropy: E_e, in [0, 1]; None: any.
        seed: in [0, 2^63); another seed makes another floor.
    Raises:
        InputError: any of these is not so, or a measure that has no value with so few vibrating tiles.
    """
    wish = _wish(rows, columns, fill_ratio, moran_index, entropy, seed)
    best: _Found | None = None
    for search, (start, hot, moves) in enumerate(_searches(wish)):
        if moves > _MOVES and best is not None and best.miss > _WITHIN_SIGHT:
            continue
        best = _better(best, _anneal(wish, wish.goal(), start, hot, moves, search))
        if best.miss <= TOLERANCE:
            break
    assert best is not None
    traded = _traded(wish, best.tiles) if entropy is not None and best.miss > TOLERANCE else []
    for found in traded:
        best = _better(best, found)
    reached = wish.met(best.difficulty)
    words = _reached(wish, best.difficulty) if reached else _nearest(wish, best.difficulty, traded)
    return Made(best.tiles, best.difficulty, reached, words)


def _better(one: _Found | None, other: _Found) -> _Found:
    return other if one is None or other.miss < one.miss else one


def _wish(
    rows: int, columns: int, fill_ratio: float, moran_index: float, entropy: float | None, seed: int
) -> _Wish:
    check_size(rows, columns)
    check_seed(seed)
    check_fill_ratio(fill_ratio)
    if rows * columns > TILE_LIMIT:
        raise InputError(
            f"{rows} x {columns} tiles are too many to make; at most {TILE_LIMIT}", field="tiles"
        )
    if not -1 <= moran_index <= 1:
        raise InputError(
            f"{moran_index!r} is no Moran index; give a number from -1 to 1", field="moran_index"
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
            raise InputError(f"{entropy!r} is no entropy; give a number from 0 to 1", field="entropy")
        if ones < 2:
            raise InputError(
                "one vibrating tile has no entropy; give a higher fill ratio, or no entropy", field="entropy"
            )
    entropy = None if entropy is None else float(entropy)
    return _Wish(rows, columns, float(fill_ratio), ones, float(moran_index), entropy, seed)


def _searches(wish: _Wish) -> Iterator[tuple[NDArray[np.uint8], float, int]]:
    """Where to start, how hot (in steps of the Moran index), and the number of moves."""
    scattered = random_tiles(wish.rows, wish.columns, wish.ones / (wish.rows * wish.columns), wish.seed, 0)
    yield scattered, 10.0, _MOVES
    regular = constructions(wish.rows, wish.columns, wish.ones)
    ranked = sorted(
        ((wish.miss(measure(tiles)), i, tiles) for i, tiles in enumerate(regular)), key=lambda r: r[:2]
    )
    for _, _, tiles in ranked[:_REGULAR_STARTS]:
        yield tiles, 1.0, _MOVES
    yield scattered, 3.0, _LONGER * _MOVES
    yield ranked[0][2], 1.0, _LONGER * _MOVES


def _traded(wish: _Wish, start: NDArray[np.uint8]) -> list[_Found]:
    """The nearest if the Moran index is insisted on, and if the entropy is."""
    weights = (_INSIST, 1.0), (1.0, _INSIST)
    hot = _INSIST
    return [_anneal(wish, wish.goal(*pair), start, hot, _MOVES, 100 + i) for i, pair in enumerate(weights)]


def _anneal(wish: _Wish, goal: Goal, start: NDArray[np.uint8], hot: float, moves: int, search: int) -> _Found:
    fill = wish.ones / (wish.rows * wish.columns)
    pairs = wish.rows * (wish.columns - 1) + wish.columns * (wish.rows - 1)
    step = 1.0 / (pairs * fill * (1.0 - fill))  # what one pair of neighbours is worth in the Moran index
    schedule = Schedule(hot * step, 0.05 * step, moves, _ENOUGH)
    cells = np.pad(start.astype(np.int64), 1).ravel()
    best, _ = anneal(cells, wish.rows, wish.columns, goal, schedule, wish.seed, search)
    tiles = best.reshape(wish.rows + 2, wish.columns + 2)[1:-1, 1:-1].astype(np.uint8)
    difficulty = measure(tiles)
    return _Found(tiles, difficulty, wish.miss(difficulty))


def _reached(wish: _Wish, found: Difficulty) -> str:
    words = f"made: {_size(wish)}, fill ratio {found.fill_ratio:.4g}, Moran index {found.moran_index:.3f}"
    return words + ("" if math.isnan(found.entropy) else f", entropy {found.entropy:.3f}")


def _nearest(wish: _Wish, found: Difficulty, traded: list[_Found]) -> str:
    asked = f"Moran index {wish.moran_index:g}"
    has = f"fill ratio {found.fill_ratio:.4g}, Moran index {found.moran_index:.3f}"
    if wish.entropy is not None:
        asked += f" with entropy {wish.entropy:g}"
        has += f", entropy {found.entropy:.3f}"
    words = (
        f"not found: fill ratio {wish.fill_ratio:g} and {asked}, each to {TOLERANCE:g}, on {_size(wish)}. "
        f"The nearest found has {has}"
    )
    if traded:
        moran, entropy = (floor.difficulty for floor in traded)
        words += (
            f". With Moran index {moran.moran_index:.3f} the nearest entropy found is {moran.entropy:.3f}; "
            f"with entropy {entropy.entropy:.3f} the nearest Moran index found is {entropy.moran_index:.3f}"
        )
    return words


def _size(wish: _Wish) -> str:
    return f"{wish.rows} x {wish.columns} tiles of which {wish.ones} vibrate"
