"""A document: what a result says, made once, and then shown in a terminal, on a page, in a notebook, or as JSON.

A document begins with its answer. Its parts are texts, tables, figures, and sections of these. How each of them looks
is decided by who shows it: ``terminal``, ``page``, ``notebook`` and ``data``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, TypeVar

import polars as pl
from pydantic import Field, PlainSerializer, PlainValidator

from vibroswarm.core.notebook_view import NotebookView


def _frame_of(values: Any) -> pl.DataFrame:
    """Check that a value is a table, or make one of what ``_values_of`` returns."""
    if isinstance(values, pl.DataFrame):
        return values
    if not isinstance(values, dict):
        raise ValueError("is not a table: the values of columns by name")
    try:
        return pl.DataFrame({name: _series_of(column) for name, column in values.items()})
    except (pl.exceptions.PolarsError, TypeError, OverflowError) as error:
        raise ValueError(f"is not a table: {error}") from None


def _series_of(column: Any) -> pl.Series:
    if isinstance(column, dict) and list(column) == ["texts"]:
        return pl.Series(column["texts"], dtype=pl.String)
    if not isinstance(column, list):
        raise ValueError("is not a table: the values of columns by name")
    series = pl.Series(column)
    return series.cast(pl.Float64) if series.dtype == pl.Null else series


def _values_of(frame: pl.DataFrame) -> dict[str, Any]:
    """Return the values of columns by name; texts that are all missing are marked, to be told from numbers."""
    return {
        series.name: {"texts": series.to_list()}
        if series.null_count() == series.len() and not series.dtype.is_numeric()
        else series.to_list()
        for series in frame
    }


Frame = Annotated[pl.DataFrame, PlainValidator(_frame_of), PlainSerializer(_values_of)]
"""A table of polars, which is kept as the values of its columns by name (``data``)."""

Tone = Literal["", "good", "fair", "bad", "open"]
"""What a text or a cell means for the reader; each has its own sign and colour."""


@dataclass(frozen=True)
class Text:
    """A paragraph. Words between backticks are code."""

    words: str
    kind: Literal["", "aside", "code"] = ""
    """"aside": in small print; "code": lines as they are, such as a file or a command."""


@dataclass(frozen=True)
class Column:
    """The heading of a column, and how its values are written."""

    title: str = ""
    """Heading; empty: the column's name."""
    unit: str = ""
    """Empty: "%" of shares."""
    share: bool = False
    """Whether a share from 0 to 1 is written in percent (with the unit "points": a difference of shares)."""
    p_value: bool = False
    """Whether numbers are p-values."""
    decimals: Annotated[int, Field(ge=0, le=20)] | None = None
    """Decimals of all numbers; by default one of shares, otherwise as many as suit all numbers of the column. 0: none,
    unless all are small (``core.numbers.few_decimals_of``)."""
    mixed: bool = False
    """Whether its numbers are of different quantities, and each is written with decimals of its own."""
    sign: bool = False
    """Whether positive numbers have a plus sign."""
    limits: tuple[str, str] | None = None
    """Names of the columns with the lower and the upper limit, which stand in brackets behind each number; by default
    NAME_low and NAME_high, where the table has them and no format of theirs (``Table``)."""
    strip: bool = False
    """Whether pages also draw each number and its limits on a line, on one scale for the column."""
    wide: bool = False
    """Whether a terminal leaves it out unless asked for everything."""
    prose: bool = False
    """Whether it holds sentences."""
    tones: Mapping[str, Tone] = field(default_factory=dict)
    """Tones of cells, by the longest matching beginning of their text."""

    @property
    def units(self) -> str:
        """The unit of the heading."""
        return self.unit or ("%" if self.share else "")


def limits_of(name: str) -> tuple[str, str]:
    """Return the names of the columns with the limits of a figure, by which a table finds them."""
    return f"{name}_low", f"{name}_high"


@dataclass(frozen=True)
class Table:
    """A table. Columns without a format are written as ``Column()`` says; limits have no column of their own.

    Formats of columns that the frame does not have are dropped, so that one set of formats serves several tables.
    """

    frame: Frame
    columns: Mapping[str, Column] = field(default_factory=dict)
    """Formats of columns by name."""
    caption: str = ""
    """Words above the table; empty: none."""
    name: str = "table"
    """Its name in JSON, and the file name of its CSV without suffix."""
    names: int = 1
    """How many of the first columns name a row."""
    folded: bool = False
    """Whether a terminal leaves it out unless asked for everything."""

    def __post_init__(self) -> None:
        """Find limits by their names; refuse limits that the frame does not have, and names beyond its columns."""
        there = set(self.frame.columns)
        columns = {
            name: replace(column, limits=limits_of(name))
            if column.limits is None and set(limits_of(name)) <= there - set(self.columns)
            else column
            for name, column in self.columns.items()
            if name in there
        }
        object.__setattr__(self, "columns", columns)
        limits = {name for column in self.columns.values() for name in column.limits or ()}
        if missing := limits - set(self.frame.columns):
            raise ValueError(f"columns of limits are missing: {', '.join(sorted(missing))}")
        if not 0 <= self.names <= self.frame.width:
            raise ValueError(f"{self.names} columns cannot name a row of {self.frame.width}")


class Drawn(Protocol):
    """A drawing, such as ``vibroswarm.plots.picture.Picture``."""

    @property
    def numbers(self) -> pl.DataFrame:
        """What it shows."""
        ...

    @property
    def caption(self) -> str:
        """What its marks are."""
        ...

    def svg(self) -> str:
        """Return it as an SVG document, which may follow light and dark."""
        ...

    def write(self, path: Path) -> object:
        """Write it and its numbers to files; ``path`` is without suffix."""
        ...


@dataclass(frozen=True, eq=False)
class Figure:
    """A figure, which is drawn when it is first looked at; a terminal does not draw it."""

    name: str
    """Name of its files without suffix."""
    draw: Callable[[str], Drawn]
    """Draws it in a style of ``vibroswarm.plots.style``."""
    title: str = ""
    """Heading above it; empty: none."""
    on_page: str = "page"
    """The style in which pages draw it; "column" suits figures side by side."""

    @cached_property
    def drawn(self) -> Drawn:
        """The drawing on a page."""
        return self.draw(self.on_page)


def _has_content(part: Part) -> bool:
    if isinstance(part, Text):
        return bool(part.words)
    return not isinstance(part, Section) or bool(part.parts)


@dataclass(frozen=True)
class Section:
    """Parts under a heading; empty texts and sections are dropped."""

    title: str
    parts: tuple[Part, ...]
    folded: bool = False
    """Whether it is closed on a page until the reader opens it (in print it is open); a terminal leaves it out unless
    asked for everything."""
    side_by_side: bool = False
    """Whether its sections and figures with titles stand two in a row on a page where there is room, except for folded
    ones."""
    wide: bool = False
    """Whether it is for pages, where it is open; a notebook leaves it out, and so does a terminal unless asked for
    everything."""

    def __post_init__(self) -> None:
        """Drop empty texts and sections."""
        object.__setattr__(self, "parts", tuple(filter(_has_content, self.parts)))


Part = Text | Table | Figure | Section


@dataclass(frozen=True)
class Document(NotebookView):
    """What a result says; empty sentences, texts and sections are dropped."""

    title: str
    answer: tuple[str, ...]
    """What the reader wants to know, in sentences; they come first everywhere."""
    knew: tuple[str, ...] = ()
    """What the robots were told that others may not know, wherever strategies stand side by side."""
    warnings: tuple[str, ...] = ()
    """Reasons not to trust the answer."""
    parts: tuple[Part, ...] = ()
    """The rest. What stands before the first section belongs to the first screen of a page."""
    made_by: Mapping[str, str] = field(default_factory=dict)
    """How it was made, such as seed, versions and command: texts by name."""
    data: Mapping[str, Frame] = field(default_factory=dict)
    """Tables of the result by name, for JSON alone; one takes the place of a table of this name among the parts."""

    def __post_init__(self) -> None:
        """Drop empty sentences and parts without content."""
        for name in ("answer", "knew", "warnings"):
            object.__setattr__(self, name, tuple(filter(None, getattr(self, name))))
        object.__setattr__(self, "parts", tuple(filter(_has_content, self.parts)))

    @property
    def tables(self) -> dict[str, Table]:
        """All tables by name, also those in sections."""
        return {part.name: part for part in walk(self.parts) if isinstance(part, Table)}

    @property
    def figures(self) -> dict[str, Figure]:
        """All figures by name, also those in sections."""
        return {part.name: part for part in walk(self.parts) if isinstance(part, Figure)}


def walk(parts: tuple[Part, ...]) -> Iterator[Part]:
    """Yield all parts in order, and after each section its own."""
    for part in parts:
        yield part
        if isinstance(part, Section):
            yield from walk(part.parts)


def if_any(found: Sized | None, make: Callable[[Any], Iterable[Part]]) -> tuple[Part, ...]:
    """Return the parts that ``make`` makes of a table or list; none if there is none, or it has no rows."""
    return () if found is None or len(found) == 0 else tuple(make(found))


_Whole = TypeVar("_Whole", Document, Section)


def without_pictures(whole: _Whole) -> _Whole:
    """Return a document without its figures, and without the sections that had nothing else."""
    kept = [part for part in whole.parts if not isinstance(part, Figure)]
    below = [without_pictures(part) if isinstance(part, Section) else part for part in kept]
    return replace(whole, parts=tuple(below))
