"""Notebook views of searches and calibrations, and of everything else its document."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import polars as pl

from vibroswarm.core.notebook_view import short_value
from vibroswarm.documents.notebook import html_of as document_html
from vibroswarm.notebook.elements import image, paragraph, table
from vibroswarm.plots.picture import Picture, picture_bytes

MOST_ROWS: Final = 20
"""Largest number of robots, runs, cells or other rows that are listed."""
MOST_COLUMNS: Final = 12
"""Largest number of columns that are listed."""
MOST_LETTERS: Final = 80
"""Longest text in a table."""

LAZY: Final = ("optimize", "calibrate")
"""Packages whose views are in ``lazy_views``."""


def html_of(value: object) -> str:
    """Return the view of an object as HTML: that of its class or nearest base class, or else its document."""
    # All base classes are tried, as the class may be defined outside of this package. The final dots keep a longer name
    # with the same beginning from matching. ``lazy_views`` imports this module, so it is imported only here.
    lazy = tuple(f"vibroswarm.{package}." for package in LAZY)
    if any(f"{kind.__module__}.".startswith(lazy) for kind in type(value).__mro__):
        from vibroswarm.notebook.lazy_views import lazy_view_of

        if (view := lazy_view_of(value)) is not None:
            return view(value)
    return document_html(value)


def picture_image(value: Picture, width_px: int) -> str:
    """Return a picture as an image element of at most this width."""
    return image(picture_bytes(value.figure, "svg"), "svg+xml", value.caption, width_px)


def frame(content: pl.DataFrame, names: Mapping[str, str] | None = None) -> str:
    """Return the first ``MOST_ROWS`` rows of a data frame as an HTML table.

    A line below says how many rows are omitted and, unless ``names`` chooses the columns, how many columns.

    Args:
        names: headings of the columns to show, by column; by default the first ``MOST_COLUMNS`` with their own names.
    """
    headings = names or {name: name for name in content.columns[:MOST_COLUMNS]}
    chosen = content.select(list(headings))
    # Columns before the first numeric one are aligned as text.
    texts = next(
        (place for place, kind in enumerate(chosen.dtypes) if kind.is_numeric()), len(chosen.columns)
    )
    body = [[_cell(value) for value in row] for row in chosen.head(MOST_ROWS).iter_rows()]
    left = []
    if content.height > MOST_ROWS:
        left.append(f"{content.height - MOST_ROWS:,} more rows")
    if not names and content.width > MOST_COLUMNS:
        left.append(f"{content.width - MOST_COLUMNS} more columns")
    return table(list(headings.values()), body, texts=texts) + (
        paragraph(f"... and {', '.join(left)}") if left else ""
    )


def _cell(value: Any) -> str:
    """Write a value for a cell of a table: short, and a dash for None."""
    if value is None:
        return "-"
    return value[:MOST_LETTERS] if isinstance(value, str) else short_value(value)
