"""Floors as text: rows of 0 and 1, with or without separators, and the lab's lists of coordinates.

A grid has one row of tiles per line, top row first: ``01010``, ``0 1 0 1 0``, ``0,1,0,1,0`` (also ';' or tab). A
list of coordinates has one vibrating tile per line, ``column,row``, counted from 0 at the top left; ``# -1`` ends
it. It does not give the number of tiles, so that must be known. Empty lines, and lines that begin with '#', are
skipped.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import TILE_LIMIT

Size = tuple[int, int]

_STILL: Final = re.compile(r"0(\.0*(e\+00)?)?")
_VIBRATING: Final = re.compile(r"1(\.0*(e\+00)?)?")
_WHOLE: Final = re.compile(r"[+-]?[0-9]{1,9}")
_END: Final = re.compile(r"#\s*-1")


MAX_LINES: Final = 500_000
"""Line limit of a floor's file; each line is kept while the file is read."""


@dataclass(frozen=True, slots=True)
class _Line:
    number: int
    cells: list[str]
    separated: bool


def parse_tiles(text: str, field: str = "--tiles") -> Size:
    """Parse rows and columns from a ``text`` such as ``"5x5"``; errors name the ``field``.

    Raises:
        InputError: not of this form, or not a possible size.
    """
    match = re.fullmatch(r"\s*([0-9]{1,9})\s*[xX×]\s*([0-9]{1,9})\s*", text)
    if match is None:
        raise InputError(f"'{_short(text)}' is not a size; give rows x columns, for example 5x5", field=field)
    rows, columns = int(match[1]), int(match[2])
    if rows < 1 or columns < 1:
        raise InputError(f"'{text}' holds no tiles; give at least 1x1", field=field)
    if rows * columns > TILE_LIMIT:
        raise InputError(f"'{text}' is too large; at most {TILE_LIMIT} tiles", field=field)
    return rows, columns


def read_text(text: str, name: str, size: Size | None = None) -> NDArray[np.uint8]:
    """Return the tiles that ``text`` describes, uint8 of shape (rows, columns), top row first.

    Args:
        name: of the file, for messages.
        size: rows and columns, if they are known: a grid must be of this size, and a list of coordinates
            needs it.
    Raises:
        InputError: names the line, what it holds, and what would be right.
    """
    lines, ended = _lines(text, name)
    pairs = all(len(line.cells) == 2 and line.separated for line in lines)
    grid_fits = size is not None and not ended and size == (len(lines), 2) and _all_bits(lines)
    if ended or (pairs and not grid_fits and (size is not None or _coordinates(lines))):
        if size is None:
            raise InputError(
                "is a list of coordinates, which does not say how many tiles there are; "
                "add --tiles ROWSxCOLUMNS, for example --tiles 5x5",
                field=name,
            )
        return _from_coordinates(lines, name, size)
    return _from_grid(lines, name, size)


def _lines(text: str, name: str) -> tuple[list[_Line], bool]:
    """Return the non-empty lines, and whether ``# -1`` ended them."""
    if text.count("\n") + text.count("\r") > 2 * MAX_LINES:
        raise InputError(f"has too many lines; a floor's file has at most {MAX_LINES:,}", field=name)
    lines: list[_Line] = []
    ended, cells = False, 0
    for number, raw in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1):
        line = raw.strip()
        if line and ended and not line.startswith("#"):
            raise InputError(f"line {number} stands after '# -1', which ends the list", field=name)
        if line.startswith("#"):
            ended = ended or _END.fullmatch(line) is not None
        elif line:
            lines.append(_split(number, raw.strip(" "), name))
            cells += len(lines[-1].cells)
            if len(lines) > MAX_LINES or cells > TILE_LIMIT:
                raise InputError(
                    f"is too large: line {number} is beyond {MAX_LINES:,} lines or {TILE_LIMIT:,} tiles",
                    field=name,
                )
    if not lines and not ended:
        raise InputError("holds no tiles; a floor file has rows of 0 and 1", field=name)
    return lines, ended


def _split(number: int, line: str, name: str) -> _Line:
    """Split a line into cells at its separator."""
    for separator in (",", ";", "\t"):
        if separator in line:
            _check_length(number, line.count(separator), name)
            return _Line(number, [cell.strip() for cell in line.split(separator)], True)
    cells = line.split(maxsplit=TILE_LIMIT)
    if len(cells) > 1:
        _check_length(number, len(cells), name)
        return _Line(number, cells, True)
    _check_length(number, len(cells[0]), name)
    return _Line(number, list(cells[0]), False)


def _check_length(number: int, cells: int, name: str) -> None:
    if cells > TILE_LIMIT:
        raise InputError(f"line {number} is too long; a floor has at most {TILE_LIMIT} tiles", field=name)


def _bit(cell: str) -> int | None:
    """Convert a cell to 0 or 1; None if it is neither."""
    if cell in {"0", "1"}:
        return int(cell)
    if _STILL.fullmatch(cell):
        return 0
    return 1 if _VIBRATING.fullmatch(cell) else None


def _all_bits(lines: list[_Line]) -> bool:
    return all(_bit(cell) is not None for line in lines for cell in line.cells)


def _coordinates(lines: list[_Line]) -> bool:
    """Return whether the cells are integers, and not all of them 0 or 1."""
    all_integers = all(_WHOLE.fullmatch(cell) for line in lines for cell in line.cells)
    return all_integers and not _all_bits(lines)


def _from_grid(lines: list[_Line], name: str, size: Size | None) -> NDArray[np.uint8]:
    """Read tiles from a grid of cells, one per tile."""
    columns = len(lines[0].cells)
    if len(lines) * columns > TILE_LIMIT:
        raise InputError(
            f"holds {len(lines)} x {columns} tiles, which is too large; at most {TILE_LIMIT}", field=name
        )
    tiles = np.zeros((len(lines), columns), dtype=np.uint8)
    for row, line in enumerate(lines):
        bits = [bit for cell in line.cells if (bit := _bit(cell)) is not None]
        if len(bits) != len(line.cells):
            column = next(i for i, cell in enumerate(line.cells) if _bit(cell) is None)
            raise InputError(
                f"line {line.number}, column {column + 1} holds '{_short(line.cells[column])}'; "
                "a tile is 0 (still) or 1 (vibrating)",
                field=name,
            )
        if len(bits) != columns:
            raise InputError(
                f"line {line.number} has {len(bits)} tiles where line {lines[0].number} has {columns}; "
                "all rows are of one length",
                field=name,
            )
        tiles[row] = bits
    if size is not None and tiles.shape != size:
        raise InputError(
            f"holds {tiles.shape[0]} x {tiles.shape[1]} tiles, not the {size[0]} x {size[1]} of --tiles",
            field=name,
        )
    return tiles


def _from_coordinates(lines: list[_Line], name: str, size: Size) -> NDArray[np.uint8]:
    """Read tiles from a list of coordinates (column, row) of vibrating tiles."""
    rows, columns = size
    tiles = np.zeros(size, dtype=np.uint8)
    for line in lines:
        at = f"line {line.number}"
        if len(line.cells) != 2 or not all(_WHOLE.fullmatch(cell) for cell in line.cells):
            raise InputError(
                f"{at} holds '{_short(','.join(line.cells))}'; a line of the list is column,row", field=name
            )
        column, row = (int(cell) for cell in line.cells)
        for value, count, axis in ((column, columns, "column"), (row, rows, "row")):
            if not 0 <= value < count:
                raise InputError(
                    f"{at}: {axis} {value} is not on a floor of {rows} x {columns} tiles; "
                    f"{axis}s are 0 to {count - 1}",
                    field=name,
                )
        if tiles[row, column]:
            raise InputError(f"{at} repeats the tile at column {column}, row {row}; name it once", field=name)
        tiles[row, column] = 1
    return tiles


def _short(text: str) -> str:
    """Return ``text`` as shown in messages: one line, printable, short."""
    printable = "".join(c if c.isprintable() else "?" for c in text)
    return printable if len(printable) <= 40 else f"{printable[:37]}..."
