"""Lay out tables as text of any width, without ever cutting a name or a number.

The first columns of a table name its rows. The first of these layouts that fits is used:

1. rows and columns, with headers of up to four lines;
2. the transposed table, if it has few rows, and no column of text but the names;
3. rows and columns, with texts wrapped between words, or each interval under its estimate, or both;
4. as layout 3, with the first name of each row on a line of its own above the row;
5. several tables, each with the names and some of the other columns;
6. records: a line for each value.

Lines are broken at spaces only. A word or number that is longer than the whole width extends beyond it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from textwrap import wrap
from typing import Final, NamedTuple
from unicodedata import combining, east_asian_width

GAP: Final = "  "
"""Space between columns."""
INDENT: Final = "  "
"""Space before the lines that stand under a row's name."""
MOST_HEAD_LINES: Final = 4
"""Greatest number of lines of a header."""
MOST_TRANSPOSED: Final = 4
"""Greatest number of rows of a table that may be transposed."""
LEAST_TEXT: Final = 16
"""Least width of a column of wrapped text, unless all its texts are shorter."""
BEFORE_LIMITS: Final = re.compile(r" (?=[\[(])")
"""The space in a text such as ``44.1 [41.0, 47.2]`` at which it is broken to put the interval under the estimate."""


class Table(NamedTuple):
    """A table whose cells are formatted already."""

    columns: tuple[str, ...]
    """Headers."""
    rows: tuple[tuple[str, ...], ...]
    """For each row, the cell of each column."""
    names: int
    """How many of the first columns name the row."""
    texts: int
    """How many of the first columns hold text, including those that name the row.

    Text is aligned to the left, and the columns of text after the names may be wrapped. All other columns hold numbers,
    aligned to the right.
    """


def table_of(
    columns: Sequence[str], rows: Iterable[Sequence[object]], *, names: int = 1, texts: int = 1
) -> Table:
    """Make a table from values of any type, which ``str`` formats; columns that name the row count as text too."""
    cells = tuple(tuple(map(str, row)) for row in rows)
    return Table(tuple(columns), cells, names=names, texts=max(texts, names))


class _Laid(NamedTuple):
    """A table that is laid out."""

    head: list[str]
    """The lines of the header."""
    rows: list[list[str]]
    """The lines of each row."""

    @property
    def lines(self) -> list[str]:
        """All lines, from top to bottom."""
        return [*self.head, *(line for row in self.rows for line in row)]


def layout(table: Table, width: int) -> list[str]:
    """Return the lines of a table in the first layout of the module's list that fits.

    Args:
        width: width of the terminal, columns.
    """
    if not table.columns:
        return []
    for lines in _layouts(table, width):
        if lines is not None:
            return lines
    return _records(table, width)


def _layouts(table: Table, width: int) -> Iterator[list[str] | None]:
    """Yield the lines of layouts 1 to 5 of the module's list, in this order; None for a layout that does not fit."""
    # Neither wrapped nor stacked is layout 1, the others are layout 3. Stacked: each interval under its estimate.
    for wrapped, stacked in ((False, False), (True, False), (False, True), (True, True)):
        laid = _grid(table, width, wrapped=wrapped, stacked=stacked)
        yield laid and laid.lines  # None if `laid` is None
        # layout 2, which is tried directly after layout 1
        if not (wrapped or stacked) and len(table.rows) <= MOST_TRANSPOSED and table.texts == table.names:
            laid = _grid(_transposed(table), width)
            yield laid and laid.lines
    if table.names:  # layouts 4 and 5 need a column that names the rows
        yield _under_names(table, width, stacked=False)
        yield _under_names(table, width, stacked=True)
        yield _parts(table, width)


def cell_width(text: str) -> int:
    """Return the number of columns that a text takes on a terminal.

    Wide characters, such as Chinese ones, take two columns; combining characters, such as accents, take none.
    """
    if text.isascii():
        return len(text)
    return sum(0 if combining(c) else 2 if east_asian_width(c) in "WF" else 1 for c in text)


def _grid(table: Table, width: int, *, wrapped: bool = False, stacked: bool = False) -> _Laid | None:
    """Lay out rows and columns; return None if the table is too wide even with headers of ``MOST_HEAD_LINES`` lines.

    Headers get as few lines as possible.

    Args:
        wrapped: whether to break the texts of columns that do not name the row, between words.
        stacked: whether to put each interval on a line under its estimate.
    """
    columns = range(len(table.columns))
    cells = [[[row[j]] for row in table.rows] for j in columns]  # cells[column][row]: the lines of the cell
    if stacked:
        for j in columns[table.texts :]:
            cells[j] = [BEFORE_LIMITS.split(row[j]) for row in table.rows]
    # for each column, the width of the widest line of its cells
    natural = [max((cell_width(line) for cell in column for line in cell), default=0) for column in cells]
    least = natural.copy()  # smallest widths; only columns of wrapped text may be narrower than their cells
    if wrapped:
        for j in columns[table.names : table.texts]:
            words = [cell_width(word) for row in table.rows for word in row[j].split()]
            least[j] = max([min(natural[j], LEAST_TEXT), *words])
    for most_lines in range(1, MOST_HEAD_LINES + 1):  # headers of more lines are narrower
        heads = [_in_lines(name, most_lines) for name in table.columns]
        widths = [max(least[j], *map(cell_width, heads[j])) for j in columns]
        spare = width - sum(widths) - len(GAP) * (len(columns) - 1)
        if spare < 0:
            continue
        # The spare width goes to the columns of wrapped text, from left to right, up to the width of their cells.
        for j in columns[table.names : table.texts] if wrapped else ():
            added = min(spare, max(0, natural[j] - widths[j]))
            widths[j], spare = widths[j] + added, spare - added
            cells[j] = [_wrap(row[j], widths[j]) for row in table.rows]
        # A table whose headers are all empty has no lines of headers.
        head = _row(heads, widths, table.texts, bottom=True) if any(table.columns) else []
        return _Laid(head, [_row(row, widths, table.texts) for row in zip(*cells, strict=True)])
    return None


def _in_lines(text: str, most: int) -> list[str]:
    """Break a header into at most ``most`` lines that are as narrow as possible.

    A comma at the end of a line is dropped, such as that in "wrong, %"; the last line is left unchanged.
    """
    if most == 1:
        return [text]
    # The narrowest width that may be enough is that of the longest word.
    for width in range(max(map(len, text.split()), default=1), len(text)):
        lines = _wrap(text, width)
        if len(lines) <= most:
            return [line.rstrip(",") for line in lines[:-1]] + lines[-1:]
    return [text]


def _wrap(text: str, width: int) -> list[str]:
    """Break a text between words into lines of at most ``width``; an empty text gives one empty line.

    A word that is longer than ``width`` is not broken.
    """
    # `wrap` refuses a width below 1, which is what an indent may leave.
    return wrap(text, max(width, 1), break_long_words=False, break_on_hyphens=False) or [""]


def _row(
    cells: Sequence[Sequence[str]], widths: Sequence[int], texts: int, *, bottom: bool = False
) -> list[str]:
    """Return the lines of a row whose cells may have several lines.

    Args:
        cells: the lines of each cell.
        widths: the widths of the columns, to which the lines are filled up with blanks.
        texts: how many of the first cells are aligned to the left; the other cells are aligned to the right.
        bottom: whether cells with fewer lines than others are put at the bottom of the row, instead of at its top.
    """
    height = max(map(len, cells))
    lines = []
    for k in range(height):
        parts = []
        for j, cell in enumerate(cells):
            i = k - (height - len(cell) if bottom else 0)  # which line of this cell is on line k of the row
            text = cell[i] if 0 <= i < len(cell) else ""
            blank = " " * (widths[j] - cell_width(text))  # none if the text is wider than the column
            parts.append(text + blank if j < texts else blank + text)
        lines.append(GAP.join(parts).rstrip())
    return lines


def _transposed(table: Table) -> Table:
    """Return the table with rows and columns exchanged; the names of a row, joined, become the header of its column."""
    # `filter(None, ...)` leaves out empty names
    heads = [GAP.join(filter(None, row[: table.names])) for row in table.rows]
    corner = GAP.join(filter(None, table.columns[: table.names]))
    others = range(table.names, len(table.columns))
    rows = tuple((table.columns[j], *(row[j] for row in table.rows)) for j in others)
    return Table((corner, *heads), rows, names=1, texts=1)  # the former headers name the new rows


def _under_names(table: Table, width: int, *, stacked: bool) -> list[str] | None:
    """Lay out a table with the first name of each row on a line above the rest of the row.

    If rows have several names, neighbouring rows with the same first name share the line of that name.

    Args:
        stacked: whether to put each interval on a line under its estimate.
    Returns:
        The lines; None if the rest of the table does not fit, or if there is no other column.
    """
    # the table without the first column
    rest = Table(
        table.columns[1:],
        tuple(row[1:] for row in table.rows),
        names=table.names - 1,
        texts=table.texts - 1,
    )
    laid = _grid(rest, width - len(INDENT), wrapped=True, stacked=stacked) if rest.columns else None
    if laid is None:
        return None
    lines = [table.columns[0]] if table.columns[0] else []
    lines += [(INDENT + line).rstrip() for line in laid.head]
    before: str | None = None
    for row, laid_row in zip(table.rows, laid.rows, strict=True):
        # If the first name is the only one, each row gets a line for it, even if the row before has the same name.
        if row[0] != before or table.names == 1:
            lines += _wrap(row[0], width)
        before = row[0]
        lines += [(INDENT + line).rstrip() for line in laid_row]
    return lines


def _parts(table: Table, width: int) -> list[str] | None:
    """Lay out several tables one under the other, each with the names and as many other columns as fit.

    Returns:
        The lines; None if a column does not fit beside the names, even if it is the only one, or if there is no other
        column than the names.
    """
    lines: list[str] = []
    remaining = list(range(table.names, len(table.columns)))
    while remaining:
        for count in range(len(remaining), 0, -1):  # the greatest number of the remaining columns that fits
            shown = [*range(table.names), *remaining[:count]]
            part = Table(
                tuple(table.columns[j] for j in shown),
                tuple(tuple(row[j] for j in shown) for row in table.rows),
                names=table.names,
                # columns of text stay the first ones, since the order of the columns is unchanged
                texts=sum(j < table.texts for j in shown),
            )
            laid = _grid(part, width, wrapped=True, stacked=True)
            if laid is not None:
                lines += [*([""] if lines else []), *laid.lines]
                remaining = remaining[count:]
                break
        else:
            return None
    return lines or None


def _records(table: Table, width: int) -> list[str]:
    """Lay out a table as records: for each row, a line with its names, then a line ``column: value`` for each value.

    If no column names the rows, the line of the names is empty, and separates the records.
    """
    lines: list[str] = []
    for row in table.rows:
        lines += _wrap(GAP.join(filter(None, row[: table.names])), width)
        for name, value in zip(table.columns[table.names :], row[table.names :], strict=True):
            # A column without a header has only its value; an empty value gets no line.
            text = f"{name}: {value}" if name and value else value
            lines += [INDENT + line for line in _wrap(text, width - len(INDENT))] if text else []
    return lines
