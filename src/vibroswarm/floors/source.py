"""Floors by name: a pattern with its fill ratio, a random floor, or a file.

| source | floor |
|---|---|
| ``diagonal:0.46`` | a pattern of the paper, 10 x 10 tiles, top row first |
| ``random:0.48`` | a share of vibrating tiles at random places: a new floor for each run |
| ``random:0.4,0.36,0.24`` | shares of the kinds 0, 1, 2 of tile at random places, likewise |
| ``patch:0.10`` | patches, see ``surfaces`` |
| ``floors/mine.csv`` | a file, see ``io`` |
| ``values:floors/mine.csv`` | a file of numbers from 0 to 1, or a grey picture |
| ``values:3..12:floors/mine.csv`` | a file of numbers from 3 to 12, which are the values 0 and 1 |

Random floors have an exact number of tiles of each kind.

The paper's table has five patterns at two fill ratios. Two names differ from the table:

- the paper's ``alternating`` floor of 0.46 has 48 vibrating tiles, not 46. That floor is ``alternating:paper-0.46``;
  the correct pattern with 46, made by the rule of the floor of 0.48, is ``alternating:0.46``.
- the paper's ``random`` is one fixed floor. It is ``random-fixed`` here; ``random:0.48`` is a new floor for each run.
"""

from __future__ import annotations

import os.path
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.rng import shuffled
from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.floors.floor import as_tiles, rows_of
from vibroswarm.floors.io import Size, read_tiles, read_values
from vibroswarm.floors.surfaces import (
    is_patches,
)

_DIAGONAL: Final = (
    "1111000000 1111000000 1111100000 1111110000 0011111000 "
    "0001111100 0000111111 0000011111 0000001111 0000001111"
)
_STRIPE: Final = "1111111111 " * 4 + "0011111111" + " 0000000000" * 5
_BLOCKS: Final = "1111110000 " * 6 + "0000001100 0000001111 0000000111 0000000111"
_ALTERNATING: Final = "1010101010 0101010101 " * 5
_RANDOM: Final = (
    "0000111011 0111011100 0001010100 1110111000 1010010100 "
    "1000000011 0000110100 0101011111 0011011010 1011001110"
)

_PATTERNS: Final[dict[str, tuple[str, tuple[tuple[int, int], ...]]]] = {
    "diagonal:0.48": (_DIAGONAL, ()),
    "diagonal:0.46": (_DIAGONAL, ((0, 3), (9, 6))),
    "stripe:0.48": (_STRIPE, ()),
    "stripe:0.46": (_STRIPE, ((4, 2), (4, 3))),
    "block-diagonal:0.48": (_BLOCKS, ()),
    "block-diagonal:0.46": (_BLOCKS, ((6, 7), (7, 6))),
    "alternating:0.48": (_ALTERNATING, ((0, 0), (9, 9))),
    "alternating:0.46": (_ALTERNATING, ((0, 0), (9, 9), (4, 4), (4, 6))),
    "alternating:paper-0.46": (_ALTERNATING, ((4, 4), (4, 6))),
    "random-fixed:0.48": (_RANDOM, ()),
    "random-fixed:0.46": (_RANDOM, ((7, 6), (7, 8))),
}
"""By name: a drawing, and (row, column) of each tile that vibrates in the drawing but is still in this pattern."""

NAMES: Final = tuple(_PATTERNS)
"""Names of all patterns, as ``pattern`` takes them."""

FAMILIES: Final = tuple(dict.fromkeys(name.partition(":")[0] for name in NAMES))
"""Names of the patterns without their fill ratios."""


RANDOM: Final = "random"
"""Name of random floors, before the colon."""
DEFAULT_SIZE: Final = (5, 5)
"""Rows and columns of a random floor of unspecified size: the paper's."""
SUM_TO_1: Final = 1e-6
"""Largest difference from 1 of the sum of shares, which are written with few digits."""
_FIELD: Final = "floor.source"
"""Field of errors about the name of a floor."""
_VALUES: Final = re.compile(
    r"(?P<prefix>values:(?:(?P<low>-?\d*\.?\d+)\.\.(?P<high>-?\d*\.?\d+):)?)(?P<path>.*)", re.DOTALL
)
"""Name of a file with values of tiles, with the numbers that are the values 0 and 1."""


# Kinds of names


def is_random(spec: str) -> bool:
    """Return whether ``spec`` names a random floor (``random:0.48``), which is a new one for each run."""
    return spec.partition(":")[0] == RANDOM


def is_generated(spec: str) -> bool:
    """Return whether ``spec`` names a floor of any size, another in each run: a random one, or patches."""
    return is_random(spec) or is_patches(spec)


def family(name: str) -> str | None:
    """Return the pattern that ``name`` refers to, without its fill ratio (``diagonal``); None if it is no pattern."""
    known = name.partition(":")[0]
    return known if known in FAMILIES else None


def source_of(kind: str, *shares: float) -> str:
    """Return the name of a floor of shares, such as ``random:0.48`` or ``random:0.5,0.3,0.2``."""
    return f"{kind}:{','.join(f'{share:g}' for share in shares)}"


# Floors of names


def resolve(
    spec: str, tiles: Size | None = None, seed: int = 0, run: int = 0, *, threshold: float | None = None
) -> tuple[NDArray[Any], str]:
    """Return the levels of a pattern, random floor or file, (rows, columns), top row first, and its name."""
    if not is_generated(spec) and family(spec) is None:
        match = _VALUES.fullmatch(spec)
        if match is not None:
            ends = float(match["low"] or 0.0), float(match["high"] or 1.0)
            return read_values(match["path"], tiles, ends).round(6), Path(match["path"]).name
        if not os.path.exists(spec):  # noqa: PTH110 - which raises no error, whatever the text
            raise _unknown(spec)
        return read_tiles(spec, tiles, threshold), Path(spec).name
    grid = named_tiles(spec, *(tiles or DEFAULT_SIZE), seed, run)
    if tiles is not None and grid.shape != tiles:
        raise InputError(f"'{spec}' has {grid.shape[0]}x{grid.shape[1]} tiles; omit --tiles", field="--tiles")
    return grid, spec


def fields_of_file(spec: str, tiles: Size | None = None, threshold: float | None = None) -> dict[str, Any]:
    """Return the fields of the section ``floor`` of a scenario with the floor of a pattern or a file."""
    levels, name = resolve(spec, tiles, threshold=threshold)
    if levels.dtype == np.uint8:
        return {"source": name, "tiles": rows_of(levels), "values": None}
    return {"source": name, "tiles": None, "values": tuple(map(tuple, levels.tolist()))}


def named_tiles(source: str, rows: int, columns: int, seed: int, run: int) -> NDArray[np.uint8]:
    """Return the tiles of a pattern or a random floor, and the still ones below patches."""
    if is_patches(source):
        return np.zeros((rows, columns), dtype=np.uint8)
    if is_random(source):
        return random_tiles(rows, columns, _shares(source), seed, run)
    if family(source) is not None:
        return pattern(source)
    raise _unknown(source)


def pattern(name: str) -> NDArray[np.uint8]:
    """Return the tiles of a named pattern, uint8 of shape (10, 10), top row first."""
    if name not in _PATTERNS:
        raise _unknown(name)
    drawing, cleared = _PATTERNS[name]  # cleared: tiles that vibrate in the drawing but are still
    tiles = as_tiles([[int(tile) for tile in row] for row in drawing.split()])
    for row, column in cleared:
        tiles[row, column] = 0
    return tiles


def random_tiles(
    rows: int, columns: int, fill_ratio: float | Sequence[float], seed: int, run: int
) -> NDArray[np.uint8]:
    """Return the random floor that (seed, run) selects, uint8 of shape (rows, columns), of exact numbers of tiles."""
    shares = [fill_ratio] if isinstance(fill_ratio, float | int) else list(fill_ratio)[1:]
    tiles, first = np.zeros(rows * columns, dtype=np.uint8), 0
    order = shuffled(rows * columns, seed, run)
    for kind, share in enumerate(shares, start=1):  # each kind takes the next tiles of a random order
        count = exact_ones(rows, columns, share)
        tiles[order[first : first + count]] = kind
        first += count
    return tiles.reshape(rows, columns)


def exact_ones(rows: int, columns: int, fill_ratio: float) -> int:
    """Return the number of vibrating tiles that gives ``fill_ratio``, to about six digits."""
    count = rows * columns
    ones = round(fill_ratio * count) if 0 <= fill_ratio <= 1 else -1
    # The user may round the fill ratio to six digits (1e-6), but by at most 0.01 tiles, so that it is clear which whole
    # number is meant.
    if ones < 0 or abs(fill_ratio * count - ones) > min(1e-6 * count, 0.01):
        raise InputError(
            f"{fill_ratio:.9g} of {rows} x {columns} tiles is no whole number of tiles from 0 to {count}",
            field=_FIELD,
        )
    return ones


def _shares(spec: str) -> tuple[float, ...]:
    """Return the shares of kinds in a name such as ``random:0.4,0.36,0.24``; a single one is that of kind 1."""
    try:
        shares = tuple(float(part) for part in spec.partition(":")[2].split(","))
    except ValueError:
        raise _unknown(spec) from None
    if len(shares) == 1:
        return (1.0 - shares[0], shares[0])
    if abs(sum(shares) - 1.0) > SUM_TO_1:
        raise InputError(f"the shares of '{spec}' sum to {sum(shares):.12g}, and not to 1", field=_FIELD)
    return shares


def _unknown(spec: str) -> InputError:
    known = (*NAMES, f"{RANDOM}:0.48", "patch:0.10")
    return InputError(
        f"{shown(spec)} is neither a floor nor a file{nearest(spec, known)}; 'vibroswarm list floors' names them",
        field=_FIELD,
    )


# Files


def parts_of_file(spec: str) -> tuple[str, str]:
    """Return the name of a floor file in two parts: before its path, such as ``values:3..12:``, and the path."""
    match = _VALUES.fullmatch(spec)
    return (match["prefix"], match["path"]) if match else ("", spec)


def beside(spec: str, folder: Path) -> str:
    """Return the name of a floor file with its path, if the file is in ``folder``; else the name as it is."""
    prefix, path = parts_of_file(spec)
    file = folder / path
    return f"{prefix}{file}" if file.is_file() else spec
