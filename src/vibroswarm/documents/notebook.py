"""The HTML that a notebook shows for a public object: its document, and the player of a run or a whole report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import is_dataclass
from typing import Any, Final

import polars as pl

from vibroswarm.core.notebook_view import public_values, short_text, short_value
from vibroswarm.documents import document_of
from vibroswarm.documents.objects import values_table
from vibroswarm.documents.run import run_document
from vibroswarm.result import Result
from vibroswarm.run_page.write import page_html, record_of, why_no_page
from vibroswarm.show.document import Document, Part, Table
from vibroswarm.show.markup import escape
from vibroswarm.show.page import fragment_html
from vibroswarm.study.evaluation import ReportFile

PLAYER_PX: Final = 760
"""Height of the frame with a run's page."""
REPORT_PX: Final = 900
"""Height of the frame with a report."""
MOST_COLUMNS: Final = 12
"""Largest number of columns of a table that are shown."""
MOST_LETTERS: Final = 80
"""Longest text in a table."""


def html_of(value: object) -> str:
    """Return what a notebook shows: the document of the object's class or nearest base class, or else its values."""
    html = fragment_html(document_of(value) or values_document(value))
    if isinstance(value, ReportFile):
        return html + _frame(value.path.read_text(encoding="utf-8"), "Report of a study", REPORT_PX)
    return html + _first_run(value) if isinstance(value, Result) and value.runs.height else html


def _first_run(result: Result) -> str:
    """Return the player of the first run of a result, and of several runs the first one's document before it."""
    run = int(result.runs["run"][0])
    before = fragment_html(run_document(result, run)) if result.runs.height > 1 else ""
    why_not = why_no_page(result)
    if why_not is not None:
        return before + f"<p>No player: {escape(why_not)}.</p>"
    return before + _frame(page_html(record_of(result, run)), f"Replay of run {run}", PLAYER_PX)


def _frame(page: str, title: str, height_px: int) -> str:
    """Return a frame with a whole page; it is sandboxed, so that its scripts cannot reach the notebook."""
    return (
        f'<iframe title="{escape(title)}" sandbox="allow-scripts allow-downloads" loading="lazy" '
        f'style="width: 100%; height: {height_px}px; border: 0" srcdoc="{escape(page)}"></iframe>'
    )


def values_document(value: object) -> Document:
    """Return the document of an object whose class has none of its own: what the class is, and its public values.

    A data frame, or a list of dataclass objects or named tuples of one class, is a table of its own.
    """
    values = public_values(value)
    tables = {name: content for name, content in values.items() if _is_table(content)}
    others = {name: short_value(content) for name, content in values.items() if name not in tables}
    parts: list[Part] = [values_table(others)] if others else []
    parts += [Table(_frame_of(content), caption=f"{name}:", name=name) for name, content in tables.items()]
    title = type(value).__name__ if values else short_text(value)
    return Document(title, (_first_paragraph(value),), parts=tuple(parts))


def _first_paragraph(value: object) -> str:
    """Return the first paragraph of the docstring of an object's class; empty if it has none."""
    text = (type(value).__doc__ or "").strip()
    # Python gives a dataclass without a docstring its signature as one.
    if text.startswith(f"{type(value).__name__}("):
        return ""
    # A reference to the module's docstring would be of no use in a notebook.
    return text.split("\n\n")[0].replace("``", "").replace(", see the module's docstring", "")


def _is_table(content: object) -> bool:
    """Return whether a value is shown as a table: a data frame, or dataclass objects or named tuples of one class."""
    if isinstance(content, pl.DataFrame):
        return True
    if not isinstance(content, Sequence) or isinstance(content, str) or not content:
        return False
    kind = type(content[0])
    return (is_dataclass(kind) or hasattr(kind, "_fields")) and all(type(one) is kind for one in content)


def _frame_of(content: Any) -> pl.DataFrame:
    """Return a value as a data frame of short texts and numbers, of at most ``MOST_COLUMNS`` columns.

    The columns of a list are the public fields of its objects.
    """
    if isinstance(content, pl.DataFrame):
        frame = content
    else:  # infer_schema_length: None takes the columns from all rows, not only from the first ones
        rows = [{name: _cell(part) for name, part in public_values(one).items()} for one in content]
        frame = pl.DataFrame(rows, infer_schema_length=None)
    shown = frame.select(frame.columns[:MOST_COLUMNS])
    nested = [name for name, kind in shown.schema.items() if kind.is_nested() or kind == pl.String]
    return shown.with_columns(
        pl.Series(name, [None if v is None else _cell(v) for v in shown[name].to_list()], dtype=pl.String)
        for name in nested
    )


def _cell(value: Any) -> Any:
    """Return a number as it is, and any other value as a short text."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    return value[:MOST_LETTERS] if isinstance(value, str) else None if value is None else short_value(value)
