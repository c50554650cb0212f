"""The paper's floors: 10 x 10 tiles, top row first, each named with its fill ratio.

The paper's table has five patterns at two fill ratios. Two entries differ from it:

- its ``alternating`` 0.46 has 48 vibrating tiles, not 46. What the paper used is ``alternating:paper-0.46``; the
pattern that has 46, and follows the rule of the 0.48 one, is ``alternating:0.46``.

- its ``random`` is one fixed floor. It is ``random-fixed`` here; ``random:0.48`` is a new one for each run.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError, nearest
from vibroswarm.floors.floor import as_tiles

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

# Name, drawing, and the tiles (row, column) of the drawing that are still in this pattern.
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

NAMES: Final = tuple(_PATTERNS)
"""Names of all patterns, as ``pattern`` takes them."""

FAMILIES: Final = tuple(dict.fromkeys(name.partition(":")[0] for name in NAMES))
"""Names without fill ratios."""


def pattern(name: str) -> NDArray[np.uint8]:
    """Return the tiles of a named pattern, uint8 of shape (10, 10), top row first.

    Args:
        name: one of ``NAMES``; '_' is read as '-', capitals as small letters.
    Raises:
        InputError: no such pattern.
    """
    drawing, cleared = _PATTERNS[canonical(name)]
    tiles = as_tiles([[int(tile) for tile in row] for row in drawing.split()])
    for row, column in cleared:
        tiles[row, column] = 0
    return tiles


def family(name: str) -> str | None:
    """Return the pattern that ``name`` refers to, whatever its fill ratio, or None."""
    known = name.partition(":")[0].strip().lower().replace("_", "-")
    return known if known in FAMILIES else None


def canonical(name: str) -> str:
    """Return ``name`` as it stands in ``NAMES``.

    Raises:
        InputError: no such pattern, or not at this fill ratio; names those that there are.
    """
    kind = family(name)
    if kind is None:
        raise InputError(
            f"'{name}' is not a pattern{nearest(name, NAMES)}; there are {', '.join(NAMES)}", field="--floor"
        )
    fill = name.partition(":")[2].strip().lower().replace("_", "-")
    fills = [known.partition(":")[2] for known in NAMES if known.startswith(f"{kind}:")]
    if fill not in fills:
        fill = next((known for known in fills if _same_number(known, fill)), fill)
    if fill not in fills:
        wrong = f"has no fill ratio '{fill}'" if fill else "needs a fill ratio"
        these = " or ".join(f"{kind}:{known}" for known in fills)
        raise InputError(f"'{name}' {wrong}; say {these}", field="--floor")
    return f"{kind}:{fill}"


def _same_number(known: str, given: str) -> bool:
    try:
        return float(known) == float(given)
    except ValueError:
        return False
