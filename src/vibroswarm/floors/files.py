"""Floors from files and to files: text grids, CSV, lists of coordinates, PNG pictures.

What a file is, is seen from its content, not from its name. A file is data: whatever its bytes, reading gives
tiles or an ``InputError``.
"""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.files import whole_file
from vibroswarm.floors.floor import as_tiles
from vibroswarm.floors.grids import Size, parse_size, read_text
from vibroswarm.floors.pictures import PNG, read_png, write_png

FILE_LIMIT: Final = 64_000_000
"""The largest file that is read, bytes."""

SUFFIXES: Final = (".txt", ".csv", ".png")
"""What ``write_tiles`` can write."""

_OTHER_PICTURES: Final = ((b"\xff\xd8\xff", "JPEG"), (b"GIF8", "GIF"), (b"BM", "BMP"), (b"%PDF", "PDF"))


def parse_tiles(text: str) -> Size:
    """Rows and columns from a ``text`` such as ``"5x5"``, as ``--tiles`` takes them.

    Raises:
        InputError: not of this form, or not a possible size.
    """
    return parse_size(text)


def read_tiles(path: Path | str, tiles: Size | None = None) -> NDArray[np.uint8]:
    """The floor in a file, uint8 of shape (rows, columns), top row first.

    Args:
        path: a text grid, CSV, list of coordinates or PNG picture.
        tiles: rows and columns. A list of coordinates needs it, a picture is divided by it, a grid must
            be of this size.
    Raises:
        InputError: the file cannot be read, or is no floor; the message names the place, what it holds, and
            what would be right.
    """
    name = str(path)
    data = _bytes(Path(path), name)
    if data.startswith(PNG):
        return read_png(data, name, tiles)
    for first, kind in _OTHER_PICTURES:
        if data.startswith(first):
            raise InputError(f"is a {kind} file; of pictures, only PNG can be read", field=name)
    if b"\0" in data:
        raise InputError("is a binary file; give rows of 0 and 1, or a PNG picture", field=name)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"is no text in UTF-8 (byte {error.start + 1}); give rows of 0 and 1, or a PNG picture",
            field=name,
        ) from None
    return read_text(text, name, tiles)


def write_tiles(path: Path | str, tiles: NDArray[np.uint8], *, replace: bool = False) -> None:
    """Write a floor by its suffix: ``.txt`` (rows of 0 and 1), ``.csv``, ``.png`` (one pixel a tile).

    ``read_tiles`` gives the same tiles back.

    Args:
        path: the file. tiles: (rows, columns) of 0 and 1. replace: whether a file of this name may be replaced.
    Raises:
        InputError: another suffix, the file exists, or its folder cannot be written.
        RunError: the disk is full or failed.
    """
    path, grid = Path(path), as_tiles(tiles)
    kind = check_suffix(path)
    with whole_file(path, replace=replace) as part:
        if kind == ".png":
            write_png(part, grid)
        else:
            separator = "," if kind == ".csv" else ""
            rows = (separator.join(map(str, row)) for row in grid.tolist())
            part.write_text("\n".join(rows) + "\n", encoding="utf-8")


def check_new(path: Path | str, *, replace: bool = False) -> None:
    """Refuse early what ``write_tiles`` would refuse after the work.

    Raises:
        InputError: an unknown suffix, the file exists, it is a folder, or there is no folder to write into.
    """
    path = Path(path)
    check_suffix(path)
    if path.is_dir():
        raise InputError(f"'{path}' is a folder; give the name of a file", field="--out")
    if path.exists() and not replace:
        raise InputError(f"'{path}' exists already; choose another name or say --force", field="--out")
    if not path.parent.is_dir():
        raise InputError(f"there is no folder '{path.parent}' to write '{path.name}' into", field="--out")


def check_suffix(path: Path, known: tuple[str, ...] = SUFFIXES) -> str:
    """The suffix of ``path`` in small letters.

    Raises:
        InputError: not one of ``known``.
    """
    suffix = path.suffix.lower()
    if suffix not in known:
        what = f"the suffix '{path.suffix}' is not known" if path.suffix else f"'{path.name}' has no suffix"
        raise InputError(f"{what}; end the name with {', '.join(known[:-1])} or {known[-1]}", field="--out")
    return suffix


def _bytes(path: Path, name: str) -> bytes:
    try:
        about = path.stat()
        if stat.S_ISDIR(about.st_mode):
            raise InputError("is a folder; give the name of a file", field=name)
        if not stat.S_ISREG(about.st_mode):  # a pipe or a device may never end
            raise InputError("is no plain file; give the name of a file", field=name)
        if about.st_size > FILE_LIMIT:
            raise InputError(f"is {about.st_size} bytes, too large; at most {FILE_LIMIT}", field=name)
        data = path.read_bytes()
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError("there is no such file", field=name) from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"cannot be read: {reason}", field=name) from None
    if not data:
        raise InputError("is empty; a floor file has rows of 0 and 1", field=name)
    return data
