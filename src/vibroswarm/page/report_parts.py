"""Tables and pictures of a report as HTML; everything that a user may have named is escaped."""

from __future__ import annotations

import base64
import html
import math
import re
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.csv_text import csv_bytes
from vibroswarm.page.svg import inline_svg

if TYPE_CHECKING:
    from vibroswarm.page.report import Column, ReportCode, ReportPicture, ReportTable

TONES: Final = ("good", "fair", "bad", "open")
"""Marks of cells; each has a sign and a colour of its own."""
WORDY_FROM: Final = 26
"""Letters of a heading above numbers; longer ones are given room, else each word has a line."""
CSV_UP_TO: Final = 500_000
"""Bytes of numbers that are put into the page to be saved; more stay beside it."""


def escape(text: object) -> str:
    """Text for HTML, in elements and in attributes; half letters are replaced, control letters left out."""
    whole = str(text).encode("utf-8", "replace").decode("utf-8")
    return html.escape(re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]", "", whole))


def code_html(text: str) -> str:
    """Escaped text in which words between backticks are code, and no line ends between a number and its unit."""
    kept = re.sub(r"(?<=\d) (?=(?:%|s|ms|m|mm)(?!\w))", "\u00a0", text)
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(kept))


def table_html(table: ReportTable, key: str) -> str:
    """A table whose headings are buttons that sort it."""
    from vibroswarm.page.report import Column

    shown = table.frame.head(table.rows_up_to)
    kinds = {name: table.columns.get(name, Column()) for name in table.frame.columns}
    numeric = {name: table.frame.schema[name].is_numeric() for name in kinds}
    head = "".join(_heading(name, kind, numeric[name]) for name, kind in kinds.items())
    body = "".join(
        "<tr>" + "".join(_cell(value, kinds[name], numeric[name]) for name, value in row.items()) + "</tr>\n"
        for row in shown.iter_rows(named=True)
    )
    caption = f"<caption><span>{code_html(table.caption)}</span></caption>" if table.caption else ""
    label = escape(table.caption or table.name)
    note = (
        f"First {shown.height:,} of {table.frame.height:,} rows. "
        if shown.height < table.frame.height
        else ""
    )
    return (
        f'<div class="part">\n<div class="sideways" role="region" tabindex="0" aria-label="{label}">\n'
        f'<table class="sortable" id="{key}">{caption}\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody>\n'
        f'</table>\n</div>\n<p class="below">{note}{csv_link(table.frame, table.name)}</p>\n</div>\n'
    )


def _heading(name: str, column: Column, numeric: bool) -> str:
    unit = "%" if column.percent else column.unit
    tail = f' <span class="unit">({escape(unit)})</span>' if unit else ""
    title = column.title or name
    kind = ' class="number wordy"' if numeric and len(title) > WORDY_FROM else _kind(column, numeric)
    return (
        f'<th scope="col" aria-sort="none"{kind}><button type="button">{_broken(title)}{tail}'
        '<span class="arrow" aria-hidden="true"></span></button></th>'
    )


def _kind(column: Column, numeric: bool, words: str = "") -> str:
    """The classes of a cell, as an attribute."""
    fitting = [start for start in column.tones if words.startswith(start)] if words else []
    tone = column.tones[max(fitting, key=len)] if fitting else ""
    kinds = [kind for kind, of in (("number", numeric), ("prose", column.prose), (tone, tone in TONES)) if of]
    return f' class="{" ".join(kinds)}"' if kinds else ""


def _cell(value: Any, column: Column, numeric: bool) -> str:
    missing = value is None or (isinstance(value, float) and math.isnan(value))
    if not numeric:
        words = (
            "–" if missing else {True: "yes", False: "no"}.get(value, value) if _hashable(value) else value
        )
        kind = _kind(column, numeric, "" if missing else str(words))
        return f"<td{kind}{' data-missing' if missing else ''}>{_broken(words)}</td>"
    if missing:
        return '<td class="number" data-missing>–</td>'
    return f'<td class="number" data-value="{value!r}">{number_text(value, column)}</td>'


def _broken(text: object) -> str:
    """Escaped text whose long names may end a line at an underscore."""
    return re.sub(r"\w{13,}", lambda name: name[0].replace("_", "_<wbr>"), escape(text))


def _hashable(value: Any) -> bool:
    return not isinstance(value, (list, dict, pl.Series))


def number_text(value: float, column: Column) -> str:
    """A number as the column says: whole numbers whole, others in significant digits, shares in percent."""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if column.percent:
        value = 100 * value
    if isinstance(value, int) or (float(value).is_integer() and abs(value) < 10**12):
        text = f"{int(value)}"
    elif abs(value) >= 10**column.digits and abs(value) < 10**12:
        text = f"{value:.0f}"
    else:
        text = f"{value:.{column.digits}g}"
    return text.replace("-", "−")


def picture_html(picture: ReportPicture, key: str) -> str:
    """A picture with its caption, and its numbers to be saved."""
    svg, width = inline_svg(picture.svg, f"{key}-", picture.caption)
    # It may grow by half, but shrinks no further than its words can be read: then it scrolls in its frame.
    size = f"clamp({0.8 * width:.0f}px, 100%, {1.5 * width:.0f}px)"
    return (
        f'<figure class="part" id="{key}">\n<div class="sideways" role="region" tabindex="0" '
        f'aria-label="{escape(picture.name)}">\n<div style="width: {size}">'
        f"{svg}</div>\n</div>\n"
        f"<figcaption>{code_html(picture.caption)} {csv_link(picture.numbers, picture.name)}</figcaption>\n</figure>\n"
    )


def lines_html(code: ReportCode, key: str) -> str:
    """Text line by line, which scrolls sideways in its frame."""
    return (
        f'<pre class="part" id="{key}" role="region" tabindex="0" aria-label="{escape(code.name)}">'
        f"<code>{escape(code.text)}</code></pre>\n"
    )


def csv_link(frame: pl.DataFrame, name: str) -> str:
    """A link that saves a frame as CSV, out of the page itself; words where it is too large for that."""
    if frame.estimated_size() <= 20 * CSV_UP_TO:
        data = csv_bytes(_flat(frame))
        if len(data) <= CSV_UP_TO:
            coded = base64.b64encode(data).decode("ascii")
            file = re.sub(r"[^\w.-]+", "-", name) or "numbers"
            return (
                f'<a class="csv" download="{escape(file)}.csv" href="data:text/csv;charset=utf-8;base64,{coded}">'
                f'Numbers<span class="unseen"> of {escape(name)}</span> (CSV)</a>'
            )
    return f'<span class="csv">{frame.height:,} rows of numbers, too many to be kept in this page.</span>'


def _flat(frame: pl.DataFrame) -> pl.DataFrame:
    """Columns that a CSV cannot hold as text."""
    nested = [name for name, kind in frame.schema.items() if kind.is_nested()]
    return frame.with_columns(
        pl.Series(name, [None if value is None else str(value) for value in frame[name].to_list()])
        for name in nested
    )
