"""Tables as text: every name and every number whole, at any width.

The first of these layouts that fits is used:

1. rows and columns, with headers of up to four lines;
2. transposed, if there are few rows;
3. with cells of text wrapped between words, and intervals under their estimates;
4. with each row's name on a line of its own;
5. in several parts, with the names in each;
6. a line for each value.

Only spaces are ever broken. A word or number that is longer than the whole width is printed beyond it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from textwrap import wrap
from typing import Final, NamedTuple
from unicodedata import combining, east_asian_width

GAP: Final = "  "
INDENT: Final = "  "
MOST_HEAD_LINES: Final = 4
MOST_TRANSPOSED: Final = 4
"""Rows that may become columns."""
LEAST_TEXT: Final = 16
"""Narrowest column of wrapped text, unless all its texts are shorter."""
BEFORE_LIMITS: Final = re.compile(r" (?=[\[(])")
"""Where an interval is put under its estimate: ``44.1 [41.0, 47.2]``."""


class Table(NamedTuple):
    """A table of texts.

    Args:
        columns: headers. rows: as many cells each. names: number of first columns that name a row. texts: number of
            first columns that are aligned to the left; those after the names may be wrapped.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    names: int
    texts: int


def table_of(
    columns: Sequence[str], rows: Iterable[Sequence[object]], *, names: int = 1, texts: int = 1
) -> Table:
    """Make a table from values of any type."""
    return Table(tuple(columns), tuple(tuple(map(str, row)) for row in rows), names, max(texts, names))


class _Laid(NamedTuple):
    """Lines of the header, and of each row."""

    head: list[str]
    rows: list[list[str]]

    @property
    def lines(self) -> list[str]:
        return [*self.head, *(line for row in self.rows for line in row)]


def layout(table: Table, width: int) -> list[str]:
    """Return the lines of a table in the first layout that fits ``width``."""
    if not table.columns:
        return []
    for lines in _layouts(table, width):
        if lines is not None:
            return lines
    return _records(table, width)


def _layouts(table: Table, width: int) -> Iterator[list[str] | None]:
    for wrapped, stacked in ((False, False), (True, False), (False, True), (True, True)):
        laid = _grid(table, width, wrapped=wrapped, stacked=stacked)
        yield laid and laid.lines
        if not (wrapped or stacked) and len(table.rows) <= MOST_TRANSPOSED and table.texts == table.names:
            laid = _grid(_transposed(table), width)
            yield laid and laid.lines
    if table.names:
        yield _under_names(table, width, stacked=False)
        yield _under_names(table, width, stacked=True)
        yield _parts(table, width)


def cell_width(text: str) -> int:
    """Return the number of columns that a text takes on a terminal."""
    if text.isascii():
        return len(text)
    return sum(0 if combining(c) else 2 if east_asian_width(c) in "WF" else 1 for c in text)


def _grid(table: Table, width: int, *, wrapped: bool = False, stacked: bool = False) -> _Laid | None:
    """Lay out rows and columns; None if they do not fit.

    Args:
        wrapped: break texts between words. stacked: put intervals under estimates.
    """
    columns = range(len(table.columns))
    cells = [[[row[j]] for row in table.rows] for j in columns]
    if stacked:
        for j in columns[table.texts :]:
            cells[j] = [BEFORE_LIMITS.split(row[j]) for row in table.rows]
    natural = [max((cell_width(line) for cell in of for line in cell), default=0) for of in cells]
    least = natural.copy()
    if wrapped:
        for j in columns[table.names : table.texts]:
            words = [cell_width(word) for row in table.rows for word in row[j].split()]
            least[j] = max([min(natural[j], LEAST_TEXT), *words])
    for most_lines in range(1, MOST_HEAD_LINES + 1):
        heads = [_in_lines(name, most_lines) for name in table.columns]
        widths = [max(least[j], *map(cell_width, heads[j])) for j in columns]
        spare = width - sum(widths) - len(GAP) * (len(columns) - 1)
        if spare < 0:
            continue
        for j in columns[table.names : table.texts] if wrapped else ():
            more = min(spare, max(0, natural[j] - widths[j]))
            widths[j], spare = widths[j] + more, spare - more
            cells[j] = [_wrap(row[j], widths[j]) for row in table.rows]
        head = _row(heads, widths, table.texts, bottom=True) if any(table.columns) else []
        return _Laid(head, [_row(row, widths, table.texts) for row in zip(*cells, strict=True)])
    return None


def _in_lines(text: str, most: int) -> list[str]:
    """Break a header into at most so many lines, as narrow as possible."""
    if most == 1:
        return [text]
    for width in range(max(map(len, text.split()), default=1), len(text)):
        lines = _wrap(text, width)
        if len(lines) <= most:
            return [line.rstrip(",") for line in lines[:-1]] + lines[-1:]
    return [text]


def _wrap(text: str, width: int) -> list[str]:
    return wrap(text, max(width, 1), break_long_words=False, break_on_hyphens=False) or [""]


def _row(
    cells: Sequence[Sequence[str]], widths: Sequence[int], texts: int, *, bottom: bool = False
) -> list[str]:
    """Return the lines of a row whose cells are lists of lines; with ``bottom``, shorter cells end on the last line."""
    height = max(map(len, cells))
    lines = []
    for k in range(height):
        parts = []
        for j, cell in enumerate(cells):
            place = k - (height - len(cell) if bottom else 0)
            text = cell[place] if 0 <= place < len(cell) else ""
            blank = " " * (widths[j] - cell_width(text))
            parts.append(text + blank if j < texts else blank + text)
        lines.append(GAP.join(parts).rstrip())
    return lines


def _transposed(table: Table) -> Table:
    """Return the table with rows and columns exchanged; the names of a row become the heading of its column."""
    heads = [GAP.join(filter(None, row[: table.names])) for row in table.rows]
    corner = GAP.join(filter(None, table.columns[: table.names]))
    places = range(table.names, len(table.columns))
    rows = tuple((table.columns[j], *(row[j] for row in table.rows)) for j in places)
    return Table((corner, *heads), rows, 1, 1)


def _under_names(table: Table, width: int, *, stacked: bool) -> list[str] | None:
    """Lay out a table with the first name of each row on a line above the rest; None if the rest does not fit.

    Where rows have several names, neighbours with the same first name share its line.
    """
    rest = Table(table.columns[1:], tuple(row[1:] for row in table.rows), table.names - 1, table.texts - 1)
    laid = _grid(rest, width - len(INDENT), wrapped=True, stacked=stacked) if rest.columns else None
    if laid is None:
        return None
    lines = [table.columns[0]] if table.columns[0] else []
    lines += [(INDENT + line).rstrip() for line in laid.head]
    before: str | None = None
    for row, laid_row in zip(table.rows, laid.rows, strict=True):
        if row[0] != before or table.names == 1:  # a name that is the only one may come twice
            lines += _wrap(row[0], width)
        before = row[0]
        lines += [(INDENT + line).rstrip() for line in laid_row]
    return lines


def _parts(table: Table, width: int) -> list[str] | None:
    """Lay out as many columns at a time as fit, with the names in each part; None if one column does not fit."""
    lines: list[str] = []
    left = list(range(table.names, len(table.columns)))
    while left:
        for count in range(len(left), 0, -1):
            shown = [*range(table.names), *left[:count]]
            part = Table(
                tuple(table.columns[j] for j in shown),
                tuple(tuple(row[j] for j in shown) for row in table.rows),
                table.names,
                sum(j < table.texts for j in shown),
            )
            laid = _grid(part, width, wrapped=True, stacked=True)
            if laid is not None:
                lines += [*([""] if lines else []), *laid.lines]
                left = left[count:]
                break
        else:
            return None
    return lines


def _records(table: Table, width: int) -> list[str]:
    """Lay out a table as records: the names of a row, then each value on a line, after the name of its column."""
    lines: list[str] = []
    for row in table.rows:
        lines += _wrap(GAP.join(filter(None, row[: table.names])), width)
        for name, value in zip(table.columns[table.names :], row[table.names :], strict=True):
            text = f"{name}: {value}" if name and value else value or ""
            lines += [INDENT + line for line in _wrap(text, width - len(INDENT))] if text else []
    return lines
