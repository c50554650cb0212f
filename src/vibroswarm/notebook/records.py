"""The view of an object without one of its own: what it is, its values, and its tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from typing import Any, Final

import polars as pl

from vibroswarm.core.notebook_view import public_values, short_text, short_value
from vibroswarm.notebook.elements import card, paragraph, rows, table

MOST_ROWS: Final = 20
"""Robots, runs, cells and other rows that are listed."""
MOST_COLUMNS: Final = 12
MOST_LETTERS: Final = 80
"""Of a text in a table."""


def record(value: object) -> str:
    """Show an object: the first line of its class's docstring, its values, and its tables and lists of objects."""
    values = public_values(value)
    tables = {name: content for name, content in values.items() if _is_table(content)}
    plain = {name: short_value(content) for name, content in values.items() if name not in tables}
    parts = [paragraph(_first_line(value)), rows(plain) if plain else ""]
    for name, content in tables.items():
        parts += [paragraph(f"{name}:"), frame(_frame_of(content))]
    return card(type(value).__name__, *parts) if values else card(short_text(value), *parts)


def _first_line(value: object) -> str:
    """Return what the class says of itself; a dataclass without a docstring has its signature there."""
    text = (type(value).__doc__ or "").strip()
    if text.startswith(f"{type(value).__name__}("):
        return ""
    return text.split("\n\n")[0].replace("``", "").replace(", see the head of this module", "")


def _is_table(content: object) -> bool:
    """Return whether values are shown as a table: a frame, or objects of one class."""
    if isinstance(content, pl.DataFrame):
        return True
    if not isinstance(content, Sequence) or isinstance(content, str) or not content:
        return False
    kind = type(content[0])
    return (is_dataclass(kind) or hasattr(kind, "_fields")) and all(type(one) is kind for one in content)


def _frame_of(content: Any) -> pl.DataFrame:
    """Tabulate objects of one class, their values as short texts."""
    if isinstance(content, pl.DataFrame):
        return content
    listed = content[:MOST_ROWS]
    return pl.DataFrame(
        [{name: _cell(part) for name, part in public_values(one).items()} for one in listed],
        infer_schema_length=None,
    )


def frame(content: pl.DataFrame, names: Mapping[str, str] | None = None) -> str:
    """Return the first rows of a frame as a table.

    Args:
        names: columns to show with their headings; by default the first ones under their own names.
    """
    shown = names or {name: name for name in content.columns[:MOST_COLUMNS]}
    chosen = content.select(list(shown))
    texts = next(
        (place for place, kind in enumerate(chosen.dtypes) if kind.is_numeric()), len(chosen.columns)
    )
    body = [[_cell(value) for value in row] for row in chosen.head(MOST_ROWS).iter_rows()]
    left = [f"{content.height - MOST_ROWS:,} more rows"] if content.height > MOST_ROWS else []
    left += (
        [f"{content.width - MOST_COLUMNS} more columns"] if not names and content.width > MOST_COLUMNS else []
    )
    return table(list(shown.values()), body, texts=texts) + (
        paragraph(f"... and {', '.join(left)}") if left else ""
    )


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return value[:MOST_LETTERS] if isinstance(value, str) else short_value(value)
