"""A floor drawn in the terminal, readable without colour."""

from __future__ import annotations

from typing import Final, TextIO

import numpy as np
from numpy.typing import NDArray

DRAW_LIMIT: Final = 200
"""The most rows or columns that are drawn in text."""

_BLOCKS: Final = ("·", "█")
_ASCII: Final = (".", "#")


def draw(tiles: NDArray[np.uint8], *, blocks: bool = False, width: int = 80) -> str:
    """The floor in characters, a line a row, and a line that says what they mean.

    Args:
        tiles: (rows, columns) of 0 and 1.
        blocks: whether to use Unicode blocks; plain ASCII otherwise.
        width: of the terminal, characters. A tile is two characters wide where they fit, one elsewhere.
    """
    rows, columns = tiles.shape
    if max(rows, columns) > DRAW_LIMIT:
        return f"({rows} x {columns} tiles are too many to draw here; draw them to a file with --out)"
    still, vibrating = (mark * (2 if 2 * columns <= width else 1) for mark in (_BLOCKS if blocks else _ASCII))
    lines = ["".join(vibrating if tile else still for tile in row) for row in tiles.tolist()]
    return "\n".join([*lines, f"{vibrating} vibrating  {still} still"])


def can_draw_blocks(stream: TextIO) -> bool:
    """Whether the stream's encoding has the block characters."""
    try:
        "".join(_BLOCKS).encode(getattr(stream, "encoding", None) or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
