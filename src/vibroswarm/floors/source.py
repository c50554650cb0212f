"""Floors by name: a pattern with its fill ratio, a random floor, or a file.

| source | floor |
|---|---|
| ``diagonal:0.46`` | a pattern of the paper, see ``patterns`` |
| ``random:0.48`` | as many vibrating tiles, thrown at random: a fresh floor for each run |
| ``floors/mine.csv`` | a file, see ``files`` |
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError, nearest
from vibroswarm.floors.files import read_tiles
from vibroswarm.floors.grids import Size
from vibroswarm.floors.patterns import NAMES, canonical, family, pattern
from vibroswarm.floors.random import random_tiles

RANDOM: Final = "random"
DEFAULT_SIZE: Final = (5, 5)
"""Rows and columns of a random floor whose size is not given: the paper's."""

_FIELD: Final = "--floor"


def resolve(
    spec: str, tiles: Size | None = None, seed: int = 0, run: int = 0
) -> tuple[NDArray[np.uint8], str]:
    """The floor called ``spec``, and its name.

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
                f"'{spec}' has {found.shape[0]}x{found.shape[1]} tiles, not {rows}x{columns}; "
                "leave --tiles out",
                field="--tiles",
            )
        return found, spec if is_random(spec) else canonical(spec)
    if not _is_there(spec) and not _looks_like_a_file(spec):
        raise InputError(_unknown(spec), field=_FIELD)
    return read_tiles(spec, tiles), Path(spec).name


def named_tiles(source: str, rows: int, columns: int, seed: int, run: int) -> NDArray[np.uint8]:
    """The tiles of a pattern or of a random floor; ``rows`` and ``columns`` are those of a random floor.

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
    """Whether ``spec`` names a floor that is fresh for each run."""
    return spec.partition(":")[0].strip().lower() == RANDOM


def shadows(name: str, tiles: NDArray[np.uint8]) -> bool:
    """Whether a floor of this name and these tiles would stand in the place of a pattern or of a random floor."""
    if is_random(name):
        return True
    if family(name) is None:
        return False
    try:
        return not np.array_equal(pattern(name), tiles)
    except InputError:  # of that family, and not at this fill ratio
        return True


def _fill_ratio(spec: str) -> float:
    text = spec.partition(":")[2].strip()
    try:
        return float(text)
    except ValueError:
        wrong = f"'{text}' is no fill ratio" if text else f"'{spec}' needs a fill ratio"
        raise InputError(f"{wrong}; say for example {RANDOM}:0.48", field=_FIELD) from None


def _unknown(spec: str) -> str:
    known = (*NAMES, f"{RANDOM}:0.48")
    return (
        f"'{spec}' is no floor and no file{nearest(spec.lower().replace('_', '-'), known)}; "
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
