"""Random floors: an exact number of vibrating tiles, thrown at random."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vibroswarm.draws import SEED_LIMIT, shuffled
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import check_size

RUN_LIMIT = 2**32


def random_tiles(rows: int, columns: int, fill_ratio: float, seed: int, run: int) -> NDArray[np.uint8]:
    """The random floor of (seed, run), uint8 of shape (rows, columns): always the same one.

    Args:
        rows, columns: number of tiles, at least 1 each.
        fill_ratio: share of vibrating tiles, in [0, 1]; the tiles must be able to give it exactly.
        seed: in [0, 2^63). run: in [0, 2^32).
    Raises:
        InputError: any of these is not so.
    """
    check_size(rows, columns)
    check_seed(seed)
    if not 0 <= run < RUN_LIMIT:
        raise InputError(f"{run} is no run; give a whole number from 0 to 2^32 - 1", field="run")
    ones = exact_ones(rows, columns, fill_ratio)
    tiles = np.zeros(rows * columns, dtype=np.uint8)
    tiles[shuffled(rows * columns, seed, run)[:ones]] = 1
    return tiles.reshape(rows, columns)


def exact_ones(rows: int, columns: int, fill_ratio: float) -> int:
    """The number of vibrating tiles that gives exactly ``fill_ratio`` (to about six digits, as one types it).

    Raises:
        InputError: not in [0, 1], or between two numbers of tiles; names the two fill ratios that can be had.
    """
    check_fill_ratio(fill_ratio)
    count = rows * columns
    ones = round(fill_ratio * count)
    if abs(fill_ratio * count - ones) <= min(1e-6 * count, 0.01):
        return ones
    below = math.floor(fill_ratio * count)
    raise InputError(
        f"{fill_ratio:.9g} of {rows} x {columns} tiles is {fill_ratio * count:.9g} tiles; the nearest that "
        f"can be had are {below / count:.9g} ({below} of them) and {(below + 1) / count:.9g} ({below + 1})",
        field="fill_ratio",
    )


def check_fill_ratio(fill_ratio: float) -> None:
    """Refuse what is no share.

    Raises:
        InputError: not a finite number in [0, 1].
    """
    if not 0 <= fill_ratio <= 1:
        raise InputError(f"{fill_ratio!r} is no share; give a number from 0 to 1", field="fill_ratio")


def check_seed(seed: int) -> None:
    """Refuse what is no seed.

    Raises:
        InputError: not in [0, 2^63).
    """
    if not 0 <= seed < SEED_LIMIT:
        raise InputError(f"{seed} is no seed; give a whole number from 0 to 2^63 - 1", field="seed")
