"""Print a report in a terminal: answer, setting, warnings, tables. Nothing is cut."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from vibroswarm.report.format import MARKS, Entry, Heading, TextTable, clean, text_table
from vibroswarm.report.report import Report, Table

STYLES: Final = {"better": "green", "worse": "magenta"}
TEXT_WIDTH: Final = 100
"""Longest line of text."""
WORD_WIDTH: Final = 16
"""Width to which a column of text may be folded."""
GAP: Final = 2
"""Space between columns."""
ROWS_UP_TO: Final = 50
"""Most rows of a table; files have all."""


class Column(NamedTuple):
    """A column of a table as texts, and the widths that it needs: at least, and so that nothing is folded."""

    heading: Heading
    least: int
    most: int
    texts: list[Text]

    @property
    def title(self) -> str:
        """The heading with its unit."""
        return f"{self.heading.title}, {self.heading.unit}" if self.heading.unit else self.heading.title


def show(report: Report, console: Console) -> None:
    """Print a report; folded tables and pictures are left out."""
    for place, sentence in enumerate(report.answer):
        _print_text(console, Text(clean(sentence), "" if place else "bold"))
    _print_text(console, Text(clean(report.setting), "dim"))
    for warning in report.warnings:
        _print_text(console, Text("Warning: ", "bold magenta").append(clean(warning), "not bold default"))
    for table in report.tables.values():
        if not table.folded and table.frame.height:
            _print_table(console, table)


def _print_table(console: Console, table: Table) -> None:
    console.print()
    for grid in _grids(text_table(table.frame.head(ROWS_UP_TO), table.titles), console.width):
        console.print(grid)
    is_cut = table.frame.height > ROWS_UP_TO
    more = f"The first {ROWS_UP_TO} of {table.frame.height:,} rows. " if is_cut else ""
    _print_text(console, Text(more + clean(table.caption), "dim"))


def _print_text(console: Console, text: Text) -> None:
    if text.plain:
        console.print(text, highlight=False, width=min(console.width, TEXT_WIDTH))


def _grids(table: TextTable, width: int) -> Iterator[Grid]:
    """Yield a table: a line a row if it fits, else with limits below numbers, else in pieces."""
    columns: list[Column] = []
    for between in (" ", "\n"):
        columns = [_column(table, place, between) for place in range(len(table.headings))]
        if _width(columns) <= width:
            break
    names = _names(table, columns, width)
    pieces: list[list[Column]] = [[]]
    for column in columns[len(names) :]:
        if pieces[-1] and _width([*names, *pieces[-1], column]) > width:
            pieces.append([])
        pieces[-1].append(column)
    for piece in pieces:
        yield _grid([*names, *piece], width)


def _names(table: TextTable, columns: Sequence[Column], width: int) -> Sequence[Column]:
    """Return the columns that name a row, and stand in each piece: those before the first interval."""
    limits = [any(row[place].limits for row in table.rows) for place in range(len(columns))]
    names = columns[: max(limits.index(True), 1)] if True in limits else columns[:1]
    return names if _width(names) <= width / 2 else columns[:1]


def _grid(columns: Sequence[Column], width: int) -> Grid:
    """Lay out columns, each with its least width and its part of the room that is left."""
    grid = Grid(box=SIMPLE_HEAD, pad_edge=False, show_edge=False, header_style="", padding=(0, 1, 0, 0))
    spare = max(width - _width(columns), 0)
    for column in columns:
        own = min(column.most, column.least + spare)
        spare -= own - column.least
        justify = "right" if column.heading.is_number else "left"
        grid.add_column(Text(column.title), justify=justify, width=own, overflow="fold")  # type: ignore[arg-type]
    for row in zip(*(column.texts for column in columns), strict=True):
        grid.add_row(*row)
    return grid


def _width(columns: Sequence[Column]) -> int:
    return sum(column.least for column in columns) + GAP * (len(columns) - 1)


def _column(table: TextTable, place: int, between: str) -> Column:
    heading, texts = table.headings[place], [_text(row[place], between) for row in table.rows]
    column = Column(heading, 0, 0, texts)
    words = max((len(word) for word in column.title.split()), default=1)
    longest = max((line.cell_len for text in texts for line in text.split("\n")), default=0)
    cells = longest if heading.is_number else min(longest, WORD_WIDTH)
    return column._replace(least=max(min(words, WORD_WIDTH), cells), most=max(len(column.title), longest))


def _text(entry: Entry, between: str) -> Text:
    mark = f"{MARKS[entry.verdict]} " if entry.verdict else ""
    text = Text(mark + entry.text, STYLES.get(entry.verdict, ""))
    return text.append(between + entry.limits, "dim") if entry.limits else text
