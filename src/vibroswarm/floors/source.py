"""Floors by name: a pattern with its fill ratio, a random floor, or a file.

| source | floor |
|---|---|
| ``diagonal:0.46`` | a pattern of the paper, see ``patterns`` |
| ``random:0.48`` | a share of vibrating tiles at random places: a new floor for each run |
| ``floors/mine.csv`` | a file, see ``io`` |

Random floors have an exact number of vibrating tiles.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.rng import SEED_LIMIT, shuffled
from vibroswarm.errors import InputError, nearest
from vibroswarm.floors.floor import check_size
from vibroswarm.floors.grid_text import Size
from vibroswarm.floors.io import read_tiles
from vibroswarm.floors.patterns import NAMES, canonical, family, pattern

RANDOM: Final = "random"
DEFAULT_SIZE: Final = (5, 5)
"""Rows and columns of a random floor of unspecified size: the paper's."""

_FIELD: Final = "--floor"


def resolve(
    spec: str, tiles: Size | None = None, seed: int = 0, run: int = 0
) -> tuple[NDArray[np.uint8], str]:
    """Return the floor called ``spec``, and its name.

    Args:
        spec: a pattern (``diagonal:0.46``), ``random:0.48``, or the name of a file.
        tiles: rows and columns: of a random floor (without: 5 x 5), of a list of coordinates, or the parts
            that a picture is divided into. A pattern or grid of another size is refused.
        seed, run: which random floor.
    Returns: uint8 of shape (rows, columns), top row first; the name for titles and results.
    Raises:
        InputError: no such pattern or file (names the nearest), or one that does not fit ``tiles``.
    """
    if is_random(spec) or family(spec) is not None:
        rows, columns = tiles or DEFAULT_SIZE
        found = named_tiles(spec, rows, columns, seed, run)
        if tiles is not None and found.shape != tiles:
            raise InputError(
                f"'{spec}' has {found.shape[0]}x{found.shape[1]} tiles, not {rows}x{columns}; omit --tiles",
                field="--tiles",
            )
        return found, spec if is_random(spec) else canonical(spec)
    if not _is_there(spec) and not _looks_like_a_file(spec):
        raise InputError(_unknown(spec), field=_FIELD)
    return read_tiles(spec, tiles), Path(spec).name


def named_tiles(source: str, rows: int, columns: int, seed: int, run: int) -> NDArray[np.uint8]:
    """Return the tiles of a pattern or of a random floor, which has ``rows`` and ``columns``.

    Args:
        source: a pattern with its fill, or ``random:0.48``. seed, run: which random floor.
    Raises:
        InputError: no such pattern (names the nearest), or a fill ratio that the tiles cannot give.
    """
    if is_random(source):
        return random_tiles(rows, columns, _fill_ratio(source), seed, run)
    if family(source) is None:
        raise InputError(_unknown(source), field=_FIELD)
    return pattern(source)


def is_random(spec: str) -> bool:
    """Return whether ``spec`` names a floor that is new for each run."""
    return spec.partition(":")[0].strip().lower() == RANDOM


def shadows(name: str, tiles: NDArray[np.uint8]) -> bool:
    """Return whether this name belongs to a pattern or random floor other than these tiles."""
    if is_random(name):
        return True
    if family(name) is None:
        return False
    try:
        return not np.array_equal(pattern(name), tiles)
    except InputError:  # a pattern of that name, but not at this fill ratio
        return True


def _fill_ratio(spec: str) -> float:
    text = spec.partition(":")[2].strip()
    try:
        return float(text)
    except ValueError:
        wrong = f"'{text}' is not a fill ratio" if text else f"'{spec}' needs a fill ratio"
        raise InputError(f"{wrong}; give for example {RANDOM}:0.48", field=_FIELD) from None


def _unknown(spec: str) -> str:
    known = (*NAMES, f"{RANDOM}:0.48")
    return (
        f"'{spec}' is neither a floor nor a file{nearest(spec.lower().replace('_', '-'), known)}; "
        f"there are {', '.join(known)}"
    )


def _is_there(spec: str) -> bool:
    try:
        return bool(spec) and Path(spec).exists()
    except (OSError, ValueError):  # a name that is too long, or holds a NUL
        return False


def _looks_like_a_file(spec: str) -> bool:
    return (
        "/" in spec or "\\" in spec or Path(spec).suffix.lower() in {".txt", ".csv", ".tsv", ".png", ".dat"}
    )


RUN_LIMIT = 2**32


def random_tiles(rows: int, columns: int, fill_ratio: float, seed: int, run: int) -> NDArray[np.uint8]:
    """Return the random floor of (seed, run), uint8 of shape (rows, columns).

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
        raise InputError(f"{run} is not a run number; give a whole number from 0 to 2^32 - 1", field="run")
    ones = exact_ones(rows, columns, fill_ratio)
    tiles = np.zeros(rows * columns, dtype=np.uint8)
    tiles[shuffled(rows * columns, seed, run)[:ones]] = 1
    return tiles.reshape(rows, columns)


def exact_ones(rows: int, columns: int, fill_ratio: float) -> int:
    """Return the number of vibrating tiles that gives ``fill_ratio`` exactly, to about six digits.

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
    """Refuse an invalid fill ratio.

    Raises:
        InputError: not a finite number in [0, 1].
    """
    if not 0 <= fill_ratio <= 1:
        raise InputError(f"{fill_ratio!r} is not a share; give a number from 0 to 1", field="fill_ratio")


def check_seed(seed: int) -> None:
    """Refuse an invalid seed.

    Raises:
        InputError: not in [0, 2^63).
    """
    if not 0 <= seed < SEED_LIMIT:
        raise InputError(f"{seed} is not a seed; give a whole number from 0 to 2^63 - 1", field="seed")
