"""Numbers as text: columns and rows of a table in base64, for the page to unpack."""

from __future__ import annotations

from base64 import b64encode

import numpy as np
from numpy.typing import NDArray

from vibroswarm.page.poses import Track

TIME_QUANTUM_S = 0.001
POSITION_QUANTUM_M = 0.0001
HEADING_QUANTUM_RAD = 2 * np.pi / 3600
"""Steps to which poses are rounded."""


def packed_column(values: NDArray[np.generic]) -> dict[str, str]:
    """A column, bit by bit: its type (little-endian, as NumPy names it) and its bytes in base64."""
    column = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    return {"type": column.dtype.str.lstrip("<|"), "bytes": b64encode(column.tobytes()).decode("ascii")}


def packed_track(track: Track) -> dict[str, int | str]:
    """A track's knots: rounded, each the difference to the one before, as variable-length integers in base64.

    Five integers a knot: time, x, y, heading (in quanta), kind (not a difference).
    """
    quanta = [TIME_QUANTUM_S, POSITION_QUANTUM_M, POSITION_QUANTUM_M, HEADING_QUANTUM_RAD]
    steps = np.diff(np.round(track.knots / quanta).astype(np.int64), axis=0, prepend=0)
    rows = np.column_stack([steps, track.kind])
    data = b64encode(varints(rows.ravel())).decode("ascii")
    return {"robot": track.robot, "knots": len(rows), "bytes": data}


def varints(values: NDArray[np.int64]) -> bytes:
    """Integers as LEB128 of their zigzag form (0, -1, 1, -2 are 0, 1, 2, 3): small ones take one byte."""
    rest = ((values << 1) ^ (values >> 63)).astype(np.uint64)
    groups = [rest & np.uint64(127)]
    while (rest := rest >> np.uint64(7)).any():
        groups.append(rest & np.uint64(127))
    table = np.stack(groups, axis=1).astype(np.uint8)
    used = table.shape[1] - np.argmax(table[:, ::-1] != 0, axis=1)
    used[~table.any(axis=1)] = 1
    place = np.arange(table.shape[1])
    table[place < used[:, None] - 1] |= 128
    return bytes(table[place < used[:, None]].tobytes())
