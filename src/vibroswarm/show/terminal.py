"""A document in a terminal: the answer, then texts and tables; no figures.

A table that is too wide for the terminal has its headings broken into several lines, then the texts in its cells; then
it is turned, if it has few rows; then its columns stand in several tables, each with the names of the rows; and if not
even that fits, each value has a line. No name and no number is ever cut.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from itertools import accumulate
from textwrap import wrap
from typing import TYPE_CHECKING, Final, NamedTuple, NoReturn, TextIO

from vibroswarm.core.numbers import count
from vibroswarm.show.cells import Cell, written
from vibroswarm.show.document import Document, Part, Section, Table, Text

if TYPE_CHECKING:
    from rich.console import Console

TEXT_WIDTH: Final = 100
"""Most characters in a line of a paragraph."""
MOST_ROWS: Final = 60
"""Most rows of a table that are printed unless everything is asked for."""
MOST_TURNED: Final = 4
"""Most rows of a table that may be turned."""
GAP: Final = 2
"""Blanks between columns."""
STYLES: Final = {"": "", "good": "green", "fair": "yellow", "bad": "red", "open": ""}
"""Colours of tones, where there are colours."""
UNBROKEN: Final = "\u00a0"
"""A space at which no line is broken; it is printed as a space."""


def print_document(document: Document, file: TextIO, width: int, *, wide: bool = False) -> None:
    """Print a document.

    Args:
        file: where to; only a terminal gets colours. width: of the terminal, characters.
        wide: whether everything is printed: all columns and rows, and what is folded.
    """
    from rich.console import Console

    class Printed(Console):
        def on_broken_pipe(self) -> NoReturn:
            """Leave the error to the command; rich would silence what ``sys.stdout`` is now, and exit."""
            raise BrokenPipeError

    console = Printed(
        file=file, width=width, highlight=False, markup=False, emoji=False, legacy_windows=False
    )
    _Printer(console, width, wide).document(document)


def printable(text: str) -> str:
    """Return text as one line that a terminal does not act on: white space becomes spaces, the rest ``?``.

    The text may quote a file.
    """
    return "".join(c if c.isprintable() or c == UNBROKEN else " " if c.isspace() else "?" for c in text)


def paragraph(text: str, width: int) -> list[str]:
    """Break text between words into lines of at most ``width`` characters; a number and its unit stay together."""
    return _lines(_unbroken(printable(text)), width)


def _unbroken(text: str) -> str:
    """Return text in which no line is broken between a number and its unit, or within limits such as ``[1, 2]``."""
    text = re.sub(r"(?<=\d) (?=(?:%|s|ms|m|mm|points)(?!\w))", UNBROKEN, text)
    return re.sub(r"\[[^][ ]+, [^][ ]+\]", lambda limits: limits[0].replace(" ", UNBROKEN), text)


def _lines(text: str, width: int) -> list[str]:
    lines = wrap(text, max(width, 1), break_long_words=False, break_on_hyphens=False) or [""]
    return [line.replace(UNBROKEN, " ") for line in lines]


class _Printer:
    """Prints parts one after the other."""

    def __init__(self, console: Console, width: int, wide: bool) -> None:
        self.console, self.width, self.wide = console, width, wide
        self.below_table = False

    def document(self, document: Document) -> None:
        """Print what the robots knew beyond others, the answer, warnings, and the parts."""
        for words in document.knew:
            self.paragraph(words)
        for place, words in enumerate(document.answer):
            self.paragraph(words, "bold" if place == 0 else "")
        for words in document.warnings:
            self.paragraph(f"Warning: {words}", "yellow")
        if document.parts and isinstance(document.parts[0], Text):  # other parts begin with an empty line
            self.line()
        self.parts(document.parts)

    def parts(self, parts: tuple[Part, ...]) -> None:
        """Print parts, each after an empty line unless it is a text; a section under its heading."""
        for part in filter(self.is_shown, parts):
            if isinstance(part, Text):
                self.text(part)
            elif isinstance(part, Table):
                self.table(part)
            elif isinstance(part, Section):
                self.line()
                self.paragraph(part.title, "bold")
                self.parts(part.parts)

    def is_shown(self, part: Part) -> bool:
        """Return whether anything of a part is printed: no figure, nor a section of figures and asides about them."""
        if isinstance(part, Section):
            is_open = self.wide or not (part.folded or part.wide)
            alone = (one for one in part.parts if not (isinstance(one, Text) and one.kind == "aside"))
            return is_open and any(map(self.is_shown, alone))
        return isinstance(part, Text) or (isinstance(part, Table) and (self.wide or not part.folded))

    def text(self, text: Text) -> None:
        """Print a paragraph, or lines of code as they are."""
        if text.kind == "code":
            for line in text.words.splitlines():
                self.line(printable(line))
        else:
            self.paragraph(text.words)

    def paragraph(self, words: str, style: str = "") -> None:
        """Print a paragraph, whose lines are indented like the first, after an empty line if it follows a table."""
        if self.below_table:
            self.line()
        indent = words[: len(words) - len(words.lstrip())]
        for line in paragraph(words.strip(), min(TEXT_WIDTH, self.width) - len(indent)):
            self.line(indent + line, style)

    def line(self, text: str = "", style: str = "") -> None:
        """Print one line."""
        from rich.text import Text as Line

        self.below_table = False
        self.console.print(Line(text, style=style, no_wrap=True, overflow="ignore"), soft_wrap=True)

    def table(self, table: Table) -> None:
        """Print a table under its caption, in the first layout that fits."""
        self.line()
        if table.caption:
            self.paragraph(table.caption)
        grid, left_out = grid_of(table, None if self.wide else MOST_ROWS, wide=self.wide)
        for place, part in enumerate(layouts(grid, self.width)):
            if place:
                self.line()
            self.grid(part)
        self.below_table = not left_out
        if left_out:
            self.paragraph(f"... and {count(left_out, 'more row')}; --wide prints all.")

    def grid(self, grid: Grid) -> None:
        """Print a grid that fits, or each of its values on a line if it does not."""
        widths = grid.widths(self.width)
        if widths is None:
            self.records(grid)
            return
        if any(grid.heads):
            self.row([(head, "") for head in grid.heads], grid, widths, is_heading=True)
        for row in grid.rows:
            self.row(row, grid, widths)

    def row(
        self, cells: list[tuple[str, str]], grid: Grid, widths: list[int], *, is_heading: bool = False
    ) -> None:
        """Print a row, whose cells may have several lines; those of headings stand at the bottom."""
        from rich.text import Text as Line

        columns = [_lines(text, width) for (text, _), width in zip(cells, widths, strict=True)]
        height = max(map(len, columns))
        if is_heading:
            columns = [[""] * (height - len(lines)) + lines for lines in columns]
        for k in range(height):
            line = Line()
            for lines, (_, tone), is_number, width in zip(columns, cells, grid.numbers, widths, strict=True):
                text = lines[k] if k < len(lines) else ""
                blank = " " * (width - _width(text))
                line.append(
                    blank + text if is_number else text + blank, style="bold" if is_heading else STYLES[tone]
                )
                line.append(" " * GAP)
            line.rstrip()
            self.console.print(line, soft_wrap=True)

    def records(self, grid: Grid) -> None:
        """Print the names of each row on lines of their own, and below them a line for each value."""
        for row in grid.rows:
            self.paragraph(" ".join(text for text, _ in row[: grid.names] if text))
            for head, (text, tone) in list(zip(grid.heads, row, strict=True))[grid.names :]:
                self.paragraph(f"  {head}: {text}" if head else f"  {text}", STYLES[tone])


class Grid(NamedTuple):
    """A table of texts, each with its tone; texts are broken at spaces only."""

    heads: list[str]
    rows: list[list[tuple[str, str]]]
    names: int
    """How many of the first columns name a row."""
    numbers: list[bool]
    """Whether each column has numbers."""

    def texts(self) -> list[list[str]]:
        """Return the texts of each column, without its heading."""
        return [[row[column][0] for row in self.rows] for column in range(len(self.heads))]

    def least(self) -> list[int]:
        """Return the width of the longest word of each column."""
        return [
            _longest(word for text in (head, *texts) for word in text.split(" "))
            for head, texts in zip(self.heads, self.texts(), strict=True)
        ]

    def widths(self, width: int) -> list[int] | None:
        """Return the widths of the columns in a table of at most ``width`` characters; None if it does not fit.

        Every column has the width of its longest word at least. What is left goes to short names of rows, then to
        numbers, then to other texts, then to headings. Where it is not enough, it goes to the longest texts, so that
        all of them get about as many lines.
        """
        widths = self.least()
        spare = width - sum(widths) - GAP * (len(widths) - 1)
        if spare < 0:
            return None
        whole = [_longest(texts) for texts in self.texts()]
        is_short_name = [column < self.names and size <= width // 2 for column, size in enumerate(whole)]
        of_names = [size if is_short else 0 for size, is_short in zip(whole, is_short_name, strict=True)]
        of_numbers = [size if is_number else 0 for size, is_number in zip(whole, self.numbers, strict=True)]
        heads = [_width(head) for head in self.heads]
        for wanted in (of_names, of_numbers, whole, heads):
            spare = _widen(widths, wanted, spare)
        return widths

    def breaks_cells(self, width: int) -> bool:
        """Return whether a table of ``width`` characters has cells of several lines."""
        widths = self.widths(width)
        return widths is None or any(
            _width(text) > widths[column] for row in self.rows for column, (text, _) in enumerate(row)
        )

    def turned(self) -> Grid:
        """Return the grid with rows and columns exchanged; the names of a row are the heading of its column."""
        heads = [" ".join(text for text, _ in row[: self.names] if text) for row in self.rows]
        corner = " ".join(filter(None, self.heads[: self.names]))
        rows = [
            [(self.heads[column], ""), *(row[column] for row in self.rows)]
            for column in range(self.names, len(self.heads))
        ]
        return Grid([corner, *heads], rows, 1, [False] + [True] * len(heads))

    def part(self, columns: list[int]) -> Grid:
        """Return the names and some of the other columns."""
        chosen = [*range(self.names), *columns]
        rows = [[row[column] for column in chosen] for row in self.rows]
        return Grid([self.heads[c] for c in chosen], rows, self.names, [self.numbers[c] for c in chosen])


def _widen(widths: list[int], wanted: list[int], spare: int) -> int:
    """Widen columns up to what is wanted, those with the longest texts for their width first; return what is left."""
    while spare and (narrow := [place for place, size in enumerate(wanted) if widths[place] < size]):
        longest = max(narrow, key=lambda place: wanted[place] / widths[place])
        widths[longest] += 1
        spare -= 1
    return spare


def _longest(texts: Iterator[str] | list[str]) -> int:
    return max(map(_width, texts), default=0)


def _width(text: str) -> int:
    """Return how many columns of a terminal a text takes; wide characters, such as Chinese ones, take two."""
    from rich.cells import cell_len

    return len(text) if text.isascii() else cell_len(text)


def grid_of(table: Table, rows_up_to: int | None, *, wide: bool) -> tuple[Grid, int]:
    """Return the texts of a table, and how many of its rows are left out."""
    found = written(table, rows_up_to, wide=wide)
    heads = [printable(f"{head.title}, {head.unit}" if head.unit else head.title) for head in found.headings]
    rows: list[list[tuple[str, str]]] = [
        [(_in_terminal(cell), cell.tone) for cell in row] for row in found.rows
    ]
    return Grid(heads, rows, table.names, [head.is_number for head in found.headings]), found.left_out


def _in_terminal(cell: Cell) -> str:
    return _unbroken(printable(f"{cell.text} {cell.limits}" if cell.limits else cell.text))


def layouts(grid: Grid, width: int) -> Iterator[Grid]:
    """Yield the grid, turned or in parts if it is too wide."""
    if not grid.breaks_cells(width):
        yield grid
        return
    only_numbers = all(grid.numbers[grid.names :])
    if len(grid.rows) <= MOST_TURNED and only_numbers and not grid.turned().breaks_cells(width):
        yield grid.turned()
        return
    if grid.widths(width) is not None:
        yield grid
        return
    least = [size + GAP for size in grid.least()]
    room = width + GAP - sum(least[: grid.names])
    remaining = list(range(grid.names, len(grid.heads)))
    while remaining:
        fitting = bisect_right(list(accumulate(least[column] for column in remaining)), room)
        if fitting == 0:
            yield grid.part(remaining)
            return
        yield grid.part(remaining[:fitting])
        remaining = remaining[fitting:]
