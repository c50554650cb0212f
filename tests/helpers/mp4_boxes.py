"""Change an MP4 file of OpenCV's writer as a phone would have written it: uneven frames, a rotation, or neither."""

from __future__ import annotations

import struct
from collections.abc import Sequence

PARENTS = (b"moov", b"trak", b"mdia", b"minf", b"stbl")


def with_steps(data: bytes, steps: Sequence[int]) -> bytes:
    """Set how long each frame lasts, in the file's own units of time; one number a frame.

    The index must come after the pictures, as it does in OpenCV's files: they then stay where they are.
    The sum must be as before, which other boxes state.
    """
    table = struct.pack(">II", 0, len(steps)) + b"".join(struct.pack(">II", 1, step) for step in steps)
    return _replaced(data, b"stts", lambda old: table)


def units_per_s(data: bytes) -> int:
    """Units of time per second of the track."""
    found: list[int] = []
    _replaced(data, b"mdhd", lambda old: found.append(struct.unpack(">I", old[12:16])[0]) or old)
    return found[0]


def _replaced(data: bytes, name: bytes, change) -> bytes:  # type: ignore[no-untyped-def]
    """Replace the content of boxes of a name, and the sizes of all around them."""
    out, at = b"", 0
    while at + 8 <= len(data):
        (size,), kind = struct.unpack(">I", data[at : at + 4]), data[at + 4 : at + 8]
        size = size or len(data) - at
        content = data[at + 8 : at + size]
        if kind == name:
            content = change(content)
        elif kind in PARENTS:
            content = _replaced(content, name, change)
        out += struct.pack(">I", len(content) + 8) + kind + content
        at += size
    return out
