"""Regular floors of any size and fill: where a search for a floor of given difficulty may start.

Each construction is an order in which the tiles are made to vibrate; the first ``ones`` of them do. They
stand at the ends of what can be had: stripes and corners (Moran index high, one cluster), checkerboards of
larger and larger squares (as high a Moran index as small clusters allow), combs (one cluster, and yet a low
Moran index).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


def constructions(rows: int, columns: int, ones: int) -> Iterator[NDArray[np.uint8]]:
    """All regular floors of this size and number of vibrating tiles, each uint8 of shape (rows, columns)."""
    r, c = np.indices((rows, columns))
    for first, second in ((r, c), (c, r)):
        yield _filled(ones, first, second)  # stripe
        yield _filled(ones, (second > 0) & (first % 2), first, second)  # comb
        yield _filled(ones, first % 2, first, second)  # separate lines
    yield _filled(ones, np.maximum(r, c), r)  # square in a corner
    yield _filled(ones, np.maximum(r * columns, c * rows), r)  # rectangle in a corner
    yield _filled(ones, r + c, r)  # triangle in a corner
    yield _filled(
        ones, np.maximum(abs(2 * r - rows + 1), abs(2 * c - columns + 1)), r
    )  # square in the middle
    for side in range(1, max(2, max(rows, columns) // 2 + 1)):
        for first, second in ((r, c), (c, r)):
            yield _filled(ones, (r // side + c // side) % 2, first // side, second)  # checkerboard of squares
        yield _filled(ones, (r // side + c // side + 1) % 2, r // side, c)
        gap = (r % (side + 1) == side).astype(int) + (c % (side + 1) == side)
        yield _filled(ones, gap, r // (side + 1), c)  # squares with gaps of one tile


def _filled(ones: int, *keys: NDArray[np.int_]) -> NDArray[np.uint8]:
    """The floor whose first ``ones`` tiles by ``keys`` (the first counts most) vibrate."""
    order = np.lexsort([np.ravel(key) for key in reversed(keys)])
    tiles = np.zeros(keys[0].shape, dtype=np.uint8)
    tiles.ravel()[order[:ones]] = 1
    return tiles
