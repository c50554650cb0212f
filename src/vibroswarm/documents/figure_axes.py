"""Lay out the cells of a study in a figure.

If a numeric field is varied, it is the x axis, and cells that are equal in all other fields make a series (one line).
Otherwise each cell stands for itself.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from vibroswarm.plots.labels import label_of
from vibroswarm.study.cells import Cell
from vibroswarm.study.factors import PLAIN
from vibroswarm.study.spec import SOURCE


@dataclass(frozen=True)
class Layout:
    """The position of each cell in a figure; cells are given by their numbers."""

    field: str | None
    """The numeric field along x, None if there is no such field."""
    label: str
    """Label of the x axis."""
    x: dict[int, float] | None
    """The value of ``field`` in each cell, None if there is no such field."""
    series: dict[int, str]
    """The name of each cell's line: its other varied values, as text."""


def layout_of(cells: Sequence[Cell]) -> Layout:
    """Put the numeric field with most values along x; cells that are equal in all other fields are one series.

    Of several fields with most values, the first is taken. Cells of a series that have the same x become a series each.
    If no varied field is numeric, there is no x, and each cell is a series under its own name.
    """
    numeric = {
        name: values for name in _varied_fields(cells) if (values := _numbers(cells, name)) is not None
    }
    # A number that is the same in all cells makes no axis.
    with_several_values = {name: values for name, values in numeric.items() if len(set(values.values())) > 1}
    if not with_several_values:
        series = {cell.number: name_of(cell) for cell in cells}
        return Layout(field=None, label="", x=None, series=series)
    field = max(with_several_values, key=lambda name: len(set(with_several_values[name].values())))
    x = with_several_values[field]
    # "all" is the series of the cells that set no other field.
    series = {cell.number: _words(cell, [k for k in cell.point if k != field]) or "all" for cell in cells}
    # Two cells of a series with the same x would be two points of a line at one place: each gets a line of its own.
    cells_at = Counter((x[number], words) for number, words in series.items())
    equal_cells = {number for number, words in series.items() if cells_at[x[number], words] > 1}
    series |= {number: f"{series[number]} (cell {number})" for number in equal_cells}
    return Layout(field=field, label=label_of(field).text, x=x, series=series)


def plane_of(cells: Sequence[Cell]) -> dict[str, dict[int, float]] | None:
    """Return the two numeric fields with at least three values each, for the axes of a map.

    A field with fewer values is no axis: each of its values has a map of its own (``study_figures``).

    Returns: by name, the value in each cell by its number; None unless there are exactly two such fields.
    """
    axes = {
        name: values
        for name in _varied_fields(cells)
        if (values := _numbers(cells, name)) is not None and len(set(values.values())) > 2
    }
    return axes if len(axes) == 2 else None


def name_of(cell: Cell) -> str:
    """Name a cell in a figure: by its varied values with symbols and units, or else by ``Cell.name``."""
    # ``Cell.name`` is not just the varied values if the cell has a label, if nothing is varied (then it is the
    # strategy), or if the cell's number distinguishes it from an equal name (``factors.names_of``).
    is_named_by_values = cell.point and cell.name == cell.text_of(cell.point)
    return _words(cell, list(cell.point)) if is_named_by_values else cell.name


def _words(cell: Cell, fields: Sequence[str]) -> str:
    """Write a cell's values of these fields, with symbols and units: ``random:0.44, soft, feedback η 1250``.

    Values of the fields ``PLAIN``, such as the floor and the strategy, are written without symbol and unit.
    Fields that the cell does not set are left out.
    """
    return ", ".join(
        cell.texts[field] if field in PLAIN else label_of(field).of(cell.texts[field])
        for field in fields
        if field in cell.texts
    )


def _varied_fields(cells: Sequence[Cell]) -> list[str]:
    names = dict.fromkeys(name for cell in cells for name in cell.point)
    # ``repr``: values may be lists, which cannot be elements of a set. A cell that does not set a field counts as None.
    return [name for name in names if len({repr(cell.point.get(name)) for cell in cells}) > 1]


def _numbers(cells: Sequence[Cell], field: str) -> dict[int, float] | None:
    """Return a field's numeric value for each cell, by the cell's number; None if the field is not numeric.

    A field is numeric if it has a finite number in all cells. The floor is numeric if its sources differ only in the
    fill ratio after the colon: ``random:0.46`` and ``random:0.48``.
    """
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
