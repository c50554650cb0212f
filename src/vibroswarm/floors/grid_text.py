"""Floors as text: rows of kinds such as 0 and 1, with or without separators, and the lab's lists of coordinates.

A grid has one row of tiles per line, top row first: ``01010``, ``0 1 0 1 0``, ``0,1,0,1,0`` (also with ';' or tab).
Kinds above 9 need separators. A list of coordinates has one vibrating tile per line, ``column,row``, counted from 0 at
the top left, or with its kind ``column,row,kind``; a line ``# -1`` ends the list. A list of that line alone is a floor
on which no tile vibrates. A list does not state the size of the
floor, so it must be given. Empty lines, and other lines that begin with '#', are skipped.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import KIND_LIMIT, KINDS_IN_WORDS, TILE_LIMIT

Size = tuple[int, int]
"""Rows and columns of a floor."""

_KIND: Final = re.compile(r"(0|[1-9][0-9]?)(\.[0-9]*(e\+0[01])?)?")
"""Text of a kind of tile, also as a decimal; ``e+00`` is how ``numpy.savetxt`` writes it by default."""
_WHOLE: Final = re.compile(r"[+-]?[0-9]{1,9}")
"""Text of an integer of at most nine digits."""
_END: Final = re.compile(r"#\s*-1")
"""The comment that ends a list of coordinates."""


MAX_LINES: Final = 500_000
"""Limit on the number of lines of a floor's file, as all lines are in memory while it is read."""


@dataclass(frozen=True, slots=True)
class _Line:
    """A line of a file, split into cells: its number from 1, and whether there was a separator between the cells."""

    number: int
    cells: list[str]
    separated: bool


def parse_tiles(text: str, field: str = "--tiles") -> Size:
    """Return the numbers of rows and columns that a ``text`` such as ``"5x5"`` states.

    Args:
        field: name of the option or argument that held the text, for messages.
    Raises:
        InputError: the text is not of this form, or the size is impossible.
    """
    match = re.fullmatch(r"\s*([0-9]{1,9})\s*[xX×]\s*([0-9]{1,9})\s*", text)
    if match is None:
        raise InputError(f"'{_short(text)}' is not a size; give rows x columns, for example 5x5", field=field)
    rows, columns = int(match[1]), int(match[2])
    if rows < 1 or columns < 1:
        raise InputError(f"'{text}' holds no tiles; give at least 1x1", field=field)
    if rows * columns > TILE_LIMIT:
        raise InputError(f"'{text}' is too large; at most {TILE_LIMIT:,} tiles", field=field)
    return rows, columns


def read_text(text: str, name: str, size: Size | None = None) -> NDArray[np.uint8]:
    """Return the tiles that ``text`` describes, uint8 of shape (rows, columns), top row first.

    Args:
        name: name of the file, for messages.
        size: rows and columns, if they are known. A grid must be of this size; a list of coordinates cannot be read
            without it.
    Raises:
        InputError: the text is neither a grid nor a list of coordinates, is too large, does not fit ``size``, or is a
            list without ``size``. If a line is wrong, the message names it, what it holds, and what would be right.
    """
    lines, ended = _lines(text, name)
    # A text that ends with "# -1" is a list of coordinates. A text without it is a list if each line is a pair of
    # cells, unless it can be a grid of two columns. With a known size, it is a grid if it has this size and holds only
    # 0 and 1; a grid of two columns with other kinds has to be written without separators. Without a known size, it is
    # a list (which is refused below) if all cells are integers, and not all of them 0 or 1; any other text is read as a
    # grid, whose checks report the wrong cell. Triples of cells are a list if they end with "# -1", or are no grid of
    # the known size.
    pairs, triples = (all(len(line.cells) == width and line.separated for line in lines) for width in (2, 3))
    grid_fits = size is not None and not ended and size == (len(lines), 2) and _all_bits(lines)
    listed = pairs and not grid_fits and (size is not None or _coordinates(lines))
    if ended or listed or (triples and size is not None and size != (len(lines), 3)):
        if size is None:
            raise InputError(
                "is a list of coordinates, which does not say how many tiles there are; "
                "add --tiles ROWSxCOLUMNS, for example --tiles 5x5",
                field=name,
            )
        return _from_coordinates(lines, name, size)
    return _from_grid(lines, name, size)


def _lines(text: str, name: str) -> tuple[list[_Line], bool]:
    """Return the lines of a text that are neither empty nor comments, and whether a line ``# -1`` ended them.

    Raises:
        InputError: there are too many lines or tiles, other lines than comments after ``# -1``, or neither tiles nor
            ``# -1``.
    """
    # Refuse far too long a text before the split needs much memory. A line may end with two characters (\r\n), so twice
    # the limit is allowed here; the exact limit is checked below.
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
            # Strip spaces only: a tab at an end of the line separates an empty cell, which must be refused.
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
    """Split a line into cells at its commas or, if it has none, at semicolons, else at tabs, else at spaces.

    Without any of these each character is a cell.

    Args:
        number: number of the line, from 1. name: name of the file, for messages.
    Raises:
        InputError: the line has too many cells.
    """
    for separator in (",", ";", "\t"):
        if separator in line:
            # Checked before the split needs memory; n separators make n + 1 cells, which ``_lines`` counts exactly.
            _check_length(number, line.count(separator), name)
            return _Line(number, [cell.strip() for cell in line.split(separator)], separated=True)
    cells = line.split(maxsplit=TILE_LIMIT)  # limited, so that a huge line does not fill the memory
    if len(cells) > 1:
        _check_length(number, len(cells), name)
        return _Line(number, cells, separated=True)
    _check_length(number, len(cells[0]), name)
    return _Line(number, list(cells[0]), separated=False)


def _check_length(number: int, cells: int, name: str) -> None:
    if cells > TILE_LIMIT:
        raise InputError(f"line {number} is too long; a floor has at most {TILE_LIMIT:,} tiles", field=name)


def _kind(cell: str) -> int | None:
    """Convert a cell to a kind of tile, also from decimals such as ``1.0`` or ``1.0e+00``; None if it is none."""
    if cell in {"0", "1"}:  # faster than the pattern
        return int(cell)
    if not _KIND.fullmatch(cell):
        return None
    value = float(cell)
    return int(value) if value < KIND_LIMIT and value.is_integer() else None


def _all_bits(lines: list[_Line]) -> bool:
    return all(_kind(cell) in (0, 1) for line in lines for cell in line.cells)


def _coordinates(lines: list[_Line]) -> bool:
    """Return whether all cells are integers and at least one is neither 0 nor 1, so that the lines cannot be a grid."""
    all_integers = all(_WHOLE.fullmatch(cell) for line in lines for cell in line.cells)
    return all_integers and not _all_bits(lines)


def _from_grid(lines: list[_Line], name: str, size: Size | None) -> NDArray[np.uint8]:
    """Return the tiles of a grid, one cell per tile; ``size``, if given, must be the grid's size.

    There must be at least one line.

    Raises:
        InputError: a cell is no kind of tile, rows differ in length, the grid is not of this size, or it is too large.
    """
    columns = len(lines[0].cells)
    # ``_lines`` limits the number of cells. If later lines are shorter than the first, the array has more tiles.
    if len(lines) * columns > TILE_LIMIT:
        raise InputError(
            f"holds {len(lines)} x {columns} tiles, which is too large; at most {TILE_LIMIT:,}", field=name
        )
    tiles = np.zeros((len(lines), columns), dtype=np.uint8)
    for row, line in enumerate(lines):
        kinds = [kind for cell in line.cells if (kind := _kind(cell)) is not None]
        if len(kinds) != len(line.cells):
            column = next(i for i, cell in enumerate(line.cells) if _kind(cell) is None)
            raise InputError(
                f"line {line.number}, column {column + 1} holds '{_short(line.cells[column])}'; {KINDS_IN_WORDS}",
                field=name,
            )
        if len(kinds) != columns:
            raise InputError(
                f"line {line.number} has {len(kinds)} tiles where line {lines[0].number} has {columns}; "
                "all rows are of one length",
                field=name,
            )
        tiles[row] = kinds
    if size is not None and tiles.shape != size:
        raise InputError(
            f"holds {tiles.shape[0]} x {tiles.shape[1]} tiles, not the {size[0]} x {size[1]} of --tiles",
            field=name,
        )
    return tiles


def _from_coordinates(lines: list[_Line], name: str, size: Size) -> NDArray[np.uint8]:
    """Return the tiles of a floor of this size, given (column, row), or (column, row, kind), of those not of kind 0.

    Raises:
        InputError: a line is no pair of integers (with a kind), or names a tile that is outside the floor or was named
            before; the message names the line.
    """
    rows, columns = size
    tiles = np.zeros(size, dtype=np.uint8)
    named = np.zeros(size, dtype=np.bool_)
    for line in lines:
        at = f"line {line.number}"
        kind = _kind(line.cells[2]) if len(line.cells) == 3 else 1
        if (
            len(line.cells) not in (2, 3)
            or kind is None
            or not all(_WHOLE.fullmatch(cell) for cell in line.cells[:2])
        ):
            raise InputError(
                f"{at} holds '{_short(','.join(line.cells))}'; a line of the list is column,row or column,row,kind",
                field=name,
            )
        column, row = (int(cell) for cell in line.cells[:2])
        for value, count, axis in ((column, columns, "column"), (row, rows, "row")):
            if not 0 <= value < count:
                raise InputError(
                    f"{at}: {axis} {value} is not on a floor of {rows} x {columns} tiles; "
                    f"{axis}s are 0 to {count - 1}",
                    field=name,
                )
        if named[row, column]:
            raise InputError(f"{at} repeats the tile at column {column}, row {row}; name it once", field=name)
        named[row, column], tiles[row, column] = True, kind
    return tiles


def printable(text: str) -> str:
    """Return a text, such as the name of a file, with '?' for characters that cannot be printed."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _short(text: str) -> str:
    """Return ``text`` for a message: printable, and at most 40 characters."""
    shown = printable(text)
    return shown if len(shown) <= 40 else f"{shown[:37]}..."
