"""The cells of a table as text: what terminal, page and notebook have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import polars as pl

from vibroswarm.core.numbers import MISSING, decimals_of, few_decimals_of, is_missing, number, p_value
from vibroswarm.show.document import Column, Table, Tone


class Cell(NamedTuple):
    """A value as text."""

    text: str
    limits: str = ""
    """Its limits in brackets; empty: none."""
    value: float | None = None
    """The number; None of texts and of missing values."""
    ends: tuple[float, float] | None = None
    """The limits as numbers."""
    tone: Tone = ""
    is_missing: bool = False


class Heading(NamedTuple):
    """A column that is shown."""

    name: str
    """The column's name in the frame."""
    title: str
    unit: str
    is_number: bool
    column: Column


class Written(NamedTuple):
    """A table whose cells are texts."""

    headings: list[Heading]
    rows: list[list[Cell]]
    left_out: int
    """How many rows are left out at the end."""


def written(table: Table, rows_up_to: int | None = None, *, wide: bool = True) -> Written:
    """Write the cells of a table.

    Args:
        rows_up_to: how many rows; None: all. wide: whether it has its wide columns.
    """
    frame = table.frame if rows_up_to is None else table.frame.head(rows_up_to)
    limits = {name for column in table.columns.values() for name in column.limits or ()}
    headings = []
    for name in table.frame.columns:
        column = table.columns.get(name, Column())
        if name not in limits and (wide or not column.wide):
            is_number = frame.schema[name].is_numeric()
            headings.append(Heading(name, column.title or name, column.units, is_number, column))
    decimals = {head.name: _decimals(frame, head) for head in headings if head.is_number}
    rows = [
        [
            _number_cell(row, head, decimals[head.name]) if head.is_number else _text_cell(row, head)
            for head in headings
        ]
        for row in frame.iter_rows(named=True)
    ]
    return Written(headings, rows, table.frame.height - frame.height)


def _decimals(frame: pl.DataFrame, head: Heading) -> int | None:
    """Return with how many decimals all numbers of a column and their limits are written."""
    column = head.column
    values = pl.concat([frame[name].cast(pl.Float64) for name in (head.name, *(column.limits or ()))])
    if column.decimals == 0:
        return few_decimals_of(100 * values if column.share else values)
    if column.decimals is not None or column.mixed:
        return column.decimals
    return 1 if column.share else decimals_of(values)


def _number_cell(row: Mapping[str, Any], head: Heading, decimals: int | None) -> Cell:
    """Write a number, and its limits if these are finite."""
    column, value = head.column, row[head.name]
    if is_missing(value):
        return Cell(MISSING, is_missing=True)
    scale = 100 if column.share else 1

    def text_of(each: float) -> str:
        return p_value(each) if column.p_value else number(scale * each, decimals, sign=column.sign)

    ends = [row[name] for name in column.limits or ()]
    if not ends or any(end is None or not math.isfinite(end) for end in ends):
        return Cell(text_of(value), value=value)
    low, high = ends
    # beside wider or far larger numbers it would seem to be exact
    if low < high and text_of(low) == text_of(high):
        decimals = max(decimals or 0, few_decimals_of([scale * (high - low)]))
    return Cell(text_of(value), f"[{text_of(low)}, {text_of(high)}]", value, (low, high))


def _text_cell(row: Mapping[str, Any], head: Heading) -> Cell:
    value = row[head.name]
    if is_missing(value):
        return Cell(MISSING, is_missing=True)
    text = "yes" if value is True else "no" if value is False else str(value)
    fitting = [start for start in head.column.tones if text.startswith(start)]
    return Cell(text, tone=head.column.tones[max(fitting, key=len)] if fitting else "")
