"""Lay out the cells of a study in a picture: along a numeric field, in series, or one by one."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from vibroswarm.plots import labels
from vibroswarm.study.factors import PLAIN
from vibroswarm.study.spec import SOURCE, Cell


@dataclass(frozen=True)
class Layout:
    """The position of each cell.

    ``x`` is a value for each cell by its number, or None if no varied field is numeric; ``series`` names its other
    varied values.
    """

    field: str | None
    label: str
    x: dict[int, float] | None
    series: dict[int, str]


def layout_of(cells: Sequence[Cell]) -> Layout:
    """Put the numeric field with most values along x and everything else into series."""
    numeric = {name: values for name in _varied(cells) if (values := _numbers(cells, name)) is not None}
    several = {name: values for name, values in numeric.items() if len(set(values.values())) > 1}
    if not several:
        return Layout(None, "", None, {cell.number: name_of(cell) for cell in cells})
    field = max(several, key=lambda name: len(set(several[name].values())))
    x = several[field]
    series = {cell.number: _words(cell, [k for k in cell.point if k != field]) or "all" for cell in cells}
    places = Counter((x[number], words) for number, words in series.items())
    twice = {number for number, words in series.items() if places[x[number], words] > 1}
    series |= {number: f"{series[number]} (cell {number})" for number in twice}
    return Layout(field, label_of(field), x, series)


def plane_of(cells: Sequence[Cell]) -> tuple[str, str] | None:
    """Return the two numeric fields with at least three values each; None unless there are exactly two."""
    many = [
        name
        for name in _varied(cells)
        if (v := _numbers(cells, name)) is not None and len(set(v.values())) > 2
    ]
    return (many[0], many[1]) if len(many) == 2 else None


def number_of(cell: Cell, field: str) -> float:
    """Return the value of a numeric field in a cell; for a floor, its fill ratio."""
    value = cell.point[field]
    return float(value.rpartition(":")[2]) if field == SOURCE else float(value)


def label_of(field: str) -> str:
    """Write a field with symbol and unit: ``walk.avoidance_threshold_mm`` is "avoidance threshold θ_c (mm)"."""
    return labels.label_of(field).text


def name_of(cell: Cell) -> str:
    """Name a cell in a picture: with symbols and units in place of the fields' names, unless it has a label."""
    return (
        _words(cell, list(cell.point)) if cell.point and cell.name == cell.words_of(cell.point) else cell.name
    )


def _words(cell: Cell, fields: Sequence[str]) -> str:
    """Write varied values as in ``Cell.words_of``, with symbols and units."""
    return ", ".join(
        cell.words[field]
        if field in PLAIN
        else f"{labels.label_of(field).short} {cell.words[field]} {labels.label_of(field).unit}".strip()
        for field in fields
        if field in cell.words
    )


def _varied(cells: Sequence[Cell]) -> list[str]:
    names = dict.fromkeys(name for cell in cells for name in cell.point)
    return [name for name in names if len({repr(cell.point.get(name)) for cell in cells}) > 1]


def _numbers(cells: Sequence[Cell], field: str) -> dict[int, float] | None:
    """Return a field's values by cell; None unless all are finite numbers, or fill ratios of one family of floors."""
    values: dict[int, Any] = {cell.number: cell.point.get(field) for cell in cells}
    if field == SOURCE:
        parts = {number: str(value).rpartition(":") for number, value in values.items()}
        if len({family for family, _, _ in parts.values()}) != 1:
            return None
        try:
            return {number: float(fill) for number, (_, _, fill) in parts.items()}
        except ValueError:
            return None
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values.values()):
        return None
    numbers = {number: float(value) for number, value in values.items()}
    if not all(map(math.isfinite, numbers.values())):  # an unlimited range has no place on an axis
        return None
    return numbers
