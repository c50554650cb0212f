"""Write a report as one self-contained HTML file: text, sortable tables, and pictures with their numbers.

    write_report("report.html", Report("What feedback buys", sections=(
        Section("Outcomes", text=("Soft feedback decides sooner.",), parts=(
            ReportTable(frame, {"right": Column("right", percent=True)}),
            picture_of(draw_outcomes(counts), "outcomes"),
        )),
    )))

All text is plain and is escaped; words between backticks become code.
"""

from __future__ import annotations

import base64
import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, Protocol

import polars as pl

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.tables import csv_bytes
from vibroswarm.report.parts import Column as Column
from vibroswarm.report.parts import (
    ReportAnswer,
    ReportFrames,
    answers_html,
    decimals_of,
    frames_html,
    number_text,
)
from vibroswarm.show.markup import code_html, escape, inline_svg

TONES: Final = ("good", "fair", "bad", "open")
"""Marks of cells; each has its own sign and colour in the style sheet."""
WORDY_FROM: Final = 26
"""A heading of numbers with more letters than this gets extra width; otherwise each word would take a line."""
CSV_UP_TO: Final = 500_000
"""Largest size in bytes of a table as CSV that is included in the page."""


def table_html(table: ReportTable, key: str) -> str:
    """Write a table whose headings are buttons that sort it.

    Columns with the limits of another column have no column of their own: the limits stand in brackets behind each
    number of that other column.

    Args:
        key: id of the HTML element.
    """
    visible = table.frame.head(table.rows_up_to)
    limits = {name for column in table.columns.values() for name in column.limits or ()}
    kinds = {name: table.columns.get(name, Column()) for name in table.frame.columns if name not in limits}
    numeric = {name: table.frame.schema[name].is_numeric() for name in kinds}
    # All numbers of a column, and their limits, have the same number of decimals.
    decimals = {
        name: decimals_of(
            pl.concat([visible[n].cast(pl.Float64) for n in (name, *(column.limits or ()))]), column
        )
        for name, column in kinds.items()
        if numeric[name]
    }
    head = "".join(_heading(name, kind, numeric[name]) for name, kind in kinds.items())
    body = "".join(
        "<tr>"
        + "".join(_cell(name, row, kind, numeric[name], decimals.get(name)) for name, kind in kinds.items())
        + "</tr>\n"
        for row in visible.iter_rows(named=True)
    )
    caption = f"<caption><span>{code_html(table.caption)}</span></caption>" if table.caption else ""
    label = escape(table.caption or table.name)
    note = (
        f"First {visible.height:,} of {table.frame.height:,} rows. "
        if visible.height < table.frame.height
        else ""
    )
    return (
        f'<div class="part">\n<div class="sideways" role="region" tabindex="0" aria-label="{label}">\n'
        f'<table class="sortable" id="{key}">{caption}\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody>\n'
        f'</table>\n</div>\n<p class="below">{note}{csv_link(table.frame, table.name)}</p>\n</div>\n'
    )


def _heading(name: str, column: Column, numeric: bool) -> str:
    """Write a column's heading with its unit, as a button that sorts the table."""
    unit = f' <span class="unit">({escape(column.units)})</span>' if column.units else ""
    title = column.title or name
    classes = ' class="number wordy"' if numeric and len(title) > WORDY_FROM else _classes(column, numeric)
    return (
        f'<th scope="col" aria-sort="none"{classes}><button type="button">{_breakable(title)}{unit}'
        '<span class="arrow" aria-hidden="true"></span></button></th>'
    )


def _classes(column: Column, numeric: bool, words: str = "") -> str:
    """Return the attribute ``class`` of a cell or heading, with a space before it; empty without classes.

    Args:
        numeric: whether the column has numbers. words: text of the cell; empty for a heading, which has no tone.
            ``column.tones`` maps beginnings of texts to tones; the longest beginning that matches gives the tone.
            Only ``TONES`` have a style, so any other tone gives no class.
    """
    fitting = [start for start in column.tones if words.startswith(start)] if words else []
    tone = column.tones[max(fitting, key=len)] if fitting else ""
    kinds = [
        kind
        for kind, applies in (("number", numeric), ("prose", column.prose), (tone, tone in TONES))
        if applies
    ]
    return f' class="{" ".join(kinds)}"' if kinds else ""


def _cell(name: str, row: Mapping[str, Any], column: Column, numeric: bool, decimals: int | None) -> str:
    """Write the cell of column ``name`` in a row; a number is followed by its limits, if these are finite.

    The page's script sorts numbers by ``data-value`` and other cells by their text, and puts ``data-missing`` last.

    Args:
        row: values by column name, limits included. column: format of the column. numeric: whether it has numbers.
        decimals: number of decimals of the column's numbers; None: each number has as many as it needs.
    """
    value = row[name]
    missing = value is None or (isinstance(value, float) and math.isnan(value))
    if not numeric:
        words = "–" if missing else "yes" if value is True else "no" if value is False else value
        classes = _classes(column, numeric, "" if missing else str(words))
        return f"<td{classes}{' data-missing' if missing else ''}>{_breakable(words)}</td>"
    if missing:
        return '<td class="number" data-missing>–</td>'
    text = number_text(value, column, decimals)
    ends = [row[end] for end in column.limits or ()]
    if ends and all(end is not None and math.isfinite(end) for end in ends):
        brackets = ", ".join(number_text(end, column, decimals) for end in ends)
        text += f' <span class="limits">[{brackets}]</span>'
    return f'<td class="number" data-value="{value!r}">{text}</td>'


def _breakable(text: object) -> str:
    """Escape text, and allow line breaks after underscores in long words, so that names do not widen a column.

    A word is long from 13 characters on; shorter ones are never broken.
    """
    return re.sub(r"\w{13,}", lambda name: name[0].replace("_", "_<wbr>"), escape(text))


def picture_html(picture: ReportPicture, key: str) -> str:
    """Write a picture with its caption and a link to save its numbers.

    Args:
        key: id of the HTML element, and prefix of the ids in the picture.
    Raises:
        InputError: the picture is not a plain SVG or too large.
    """
    svg, width = inline_svg(picture.svg, f"{key}-", picture.caption)
    # The picture fills the page's width within limits: at most 1.5 times its own width, and at least 0.8 times, so that
    # its text stays legible. In a narrower frame it scrolls.
    size = f"clamp({0.8 * width:.0f}px, 100%, {1.5 * width:.0f}px)"
    return (
        f'<figure class="part" id="{key}">\n<div class="sideways" role="region" tabindex="0" '
        f'aria-label="{escape(picture.name)}">\n<div style="width: {size}">'
        f"{svg}</div>\n</div>\n"
        f"<figcaption>{code_html(picture.caption)} {csv_link(picture.numbers, picture.name)}</figcaption>\n</figure>\n"
    )


def lines_html(code: ReportCode, key: str) -> str:
    """Write preformatted text, line by line, in a frame that scrolls sideways; ``key`` is the element's id."""
    return (
        f'<pre class="part" id="{key}" role="region" tabindex="0" aria-label="{escape(code.name)}">'
        f"<code>{escape(code.text)}</code></pre>\n"
    )


def csv_link(frame: pl.DataFrame, name: str) -> str:
    """Write a link that saves a table as CSV; the link itself contains the CSV.

    If the table is too large for the page, write a note with its number of rows instead.

    Args:
        name: name of the file without suffix; characters that do not suit a file name are replaced by hyphens.
    """
    # CSV is rarely 20 times smaller than its table in memory, so a table of more than 20 times the limit is not even
    # converted.
    if frame.estimated_size() <= 20 * CSV_UP_TO:
        data = csv_bytes(_flat(frame))
        if len(data) <= CSV_UP_TO:
            coded = base64.b64encode(data).decode("ascii")
            file = re.sub(r"[^\w.-]+", "-", name) or "numbers"
            return (
                f'<a class="csv" download="{escape(file)}.csv" href="data:text/csv;charset=utf-8;base64,{coded}">'
                f'Numbers<span class="unseen"> of {escape(name)}</span> (CSV)</a>'
            )
    return f'<span class="csv">{frame.height:,} rows of numbers, too many to include in this page.</span>'


def _flat(frame: pl.DataFrame) -> pl.DataFrame:
    """Return a table with its nested columns, which CSV cannot hold, converted to text."""
    nested = [name for name, kind in frame.schema.items() if kind.is_nested()]
    return frame.with_columns(
        pl.Series(name, [None if value is None else str(value) for value in frame[name].to_list()])
        for name in nested
    )


CONTENTS_FROM = 4
"""Entries from which there is a table of contents."""
LONG_FROM = 30
"""Entries of a table of contents from which only the current part is unfolded."""


@dataclass(frozen=True)
class ReportTable(NotebookView):
    """A table of a section; missing values are dashes and are sorted last."""

    frame: pl.DataFrame
    """The rows of the table, limits included."""
    columns: Mapping[str, Column] = field(default_factory=dict)
    """Formats of columns by name; columns without one are formatted as ``Column()``."""
    caption: str = ""
    """Text above the table; empty: none."""
    name: str = "table"
    """File name of the CSV that can be saved, without suffix."""
    rows_up_to: int = 500
    """Rows shown; the CSV has all."""


@dataclass(frozen=True)
class ReportPicture(NotebookView):
    """A picture of a section, with its numbers to be saved as CSV."""

    svg: str
    """An SVG document; ``vibroswarm.plots.Picture.svg()`` gives one that follows light and dark."""
    caption: str
    """Text below the picture."""
    numbers: pl.DataFrame
    name: str = "picture"
    """File name of the CSV that can be saved, without suffix."""


@dataclass(frozen=True)
class ReportCode(NotebookView):
    """Preformatted text of a section, such as a file or a command."""

    text: str
    name: str = "text"
    """What it is, for screen readers."""


class _Drawn(Protocol):
    """What ``picture_of`` uses of a ``vibroswarm.plots.Picture``."""

    @property
    def numbers(self) -> pl.DataFrame: ...
    @property
    def caption(self) -> str: ...
    def svg(self) -> str: ...


def picture_of(drawn: _Drawn, name: str) -> ReportPicture:
    """Return a picture for a report.

    Args:
        drawn: result of a function ``draw_*`` of ``vibroswarm.plots``. name: of its CSV file, without suffix.
    """
    return ReportPicture(svg=drawn.svg(), caption=drawn.caption, numbers=drawn.numbers, name=name)


@dataclass(frozen=True)
class Section(NotebookView):
    """A part of a report with a heading; sections may hold sections, down to three levels."""

    title: str
    text: tuple[str, ...] = ()
    """Paragraphs."""
    parts: tuple[ReportTable | ReportPicture | ReportCode | ReportFrames, ...] = ()
    sections: tuple[Section, ...] = ()
    folded: bool = False
    """Whether it is closed until the reader opens it (in print it is open)."""
    side_by_side: bool = False
    """Whether its subsections stand two in a row where there is room, except for folded ones."""


@dataclass(frozen=True)
class Report(NotebookView):
    """A whole report."""

    title: str
    lead: tuple[str, ...] = ()
    """First paragraphs: the question and the findings."""
    warnings: tuple[str, ...] = ()
    """Reasons not to trust the findings; each stands in a frame above everything else."""
    sections: tuple[Section, ...] = ()
    details: Mapping[str, str] = field(default_factory=dict)
    """How the report was made, such as seed, versions and command: texts by name, at the end of the page."""
    answers: tuple[ReportAnswer, ...] = ()
    """Comparisons that answer the question; they stand below the lead."""


def write_report(path: Path | str, report: Report) -> None:
    """Write a report as an HTML file to ``path``, completely or not at all; an existing file is replaced.

    Raises:
        InputError: a picture is not a plain SVG or too large, the address of a photograph is not a data URI of a JPEG
            or PNG, or the folder cannot be written.
        RunError: the disk is full or failed.
    """
    text = report_html(report)
    with whole_file(Path(path)) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def report_html(report: Report) -> str:
    """Return the report as a complete HTML document that needs no server, no network and no other file.

    The same report always gives the same text.

    Raises:
        InputError: a picture is not a plain SVG or too large, or the address of a photograph is not a data URI of a
            JPEG or PNG.
    """
    script = _asset("page.js", "show")
    # The page's content security policy allows only the script with this hash: the template's script element contains
    # it between two line feeds.
    digest = base64.b64encode(hashlib.sha256(f"\n{script}\n".encode()).digest()).decode()
    parts = {
        "title": escape(report.title),
        "script_hash": f"sha256-{digest}",
        "style": _asset("page.css", "show"),
        "script": script,
        "contents": _contents(report.sections),
        "warnings": "".join(
            f'<aside class="warning" role="note"><strong>Warning.</strong> {code_html(text)}</aside>\n'
            for text in report.warnings
        ),
        "lead": _paragraphs(report.lead, "lead"),
        "answers": answers_html(report.answers),
        "sections": "".join(
            _section(section, key=f"s{place}", level=2)
            for place, section in enumerate(report.sections, start=1)
        ),
        "details": _details(report.details),
    }
    # The template has a place ``{{name}}`` for each part.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _asset("report.html", "report"))


def _asset(name: str, package: str) -> str:
    """Read a file that is shipped with a package, without white space around its text."""
    return files(f"vibroswarm.{package}").joinpath("assets", name).read_text(encoding="utf-8").strip()


def _paragraphs(texts: tuple[str, ...], kind: str = "") -> str:
    """Write paragraphs with the class ``kind``, if given."""
    opening = f'<p class="{kind}">' if kind else "<p>"
    return "".join(f"{opening}{code_html(text)}</p>\n" for text in texts)


def _section(section: Section, key: str, level: int) -> str:
    """Write a section with its parts and subsections.

    Args:
        key: id of its heading, from which the ids of its parts and subsections are made. level: of the heading, 2 to 4.
    """
    heading = f'<h{level} id="{key}">{escape(section.title)}</h{level}>'
    body = _paragraphs(section.text)
    for place, part in enumerate(section.parts, start=1):
        part_key = f"{key}p{place}"
        if isinstance(part, ReportTable):
            body += table_html(part, part_key)
        elif isinstance(part, ReportFrames):
            body += frames_html(part, part_key)
        elif isinstance(part, ReportPicture):
            body += picture_html(part, part_key)
        else:
            body += lines_html(part, part_key)
    below = "".join(
        _section(subsection, f"{key}-{place}", min(level + 1, 4))
        for place, subsection in enumerate(section.sections, start=1)
    )
    body += f'<div class="beside">\n{below}</div>\n' if section.side_by_side else below
    folded = f"<details>\n<summary>{heading}</summary>\n{body}</details>\n"
    body = folded if section.folded else f"{heading}\n{body}"
    return f'<section aria-labelledby="{key}">\n{body}</section>\n'


def _contents(sections: tuple[Section, ...]) -> str:
    """Write the table of contents; empty if it would have fewer than ``CONTENTS_FROM`` entries.

    Entries are sections and their subsections, but nothing below these. In contents of the class "long", the style
    sheet hides the subsections; in a wide window those of the current section are shown.
    """
    count = sum(1 + len(section.sections) for section in sections)
    if count < CONTENTS_FROM:
        return ""
    kind = "contents long" if count >= LONG_FROM else "contents"
    return (
        f'<nav class="{kind}" aria-labelledby="contents">\n<h2 id="contents">Contents</h2>\n'
        f"{_entries(sections, 's')}</nav>\n"
    )


def _entries(sections: tuple[Section, ...], key: str) -> str:
    """Write the entries of the table of contents: sections and their subsections, but nothing below these.

    Args:
        key: beginning of the ids of the headings, to which the number of the section is added: "s" for the sections of
            the report ("s1"), "s1-" for the subsections of its first section ("s1-1").
    """
    lines = []
    for place, section in enumerate(sections, start=1):
        heading = f"{key}{place}"
        below = _entries(section.sections, f"{heading}-") if section.sections and key == "s" else ""
        lines.append(f'<li><a href="#{heading}">{escape(section.title)}</a>{below}</li>\n')
    return f"<ol>\n{''.join(lines)}</ol>\n"


def _details(details: Mapping[str, str]) -> str:
    """Write the section with the details of how a report was made; empty without details."""
    if not details:
        return ""
    rows = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(text)}</dd></div>\n" for name, text in details.items()
    )
    return (
        '<section class="made" aria-labelledby="made">\n<h2 id="made">How this was made</h2>\n'
        f"<dl>\n{rows}</dl>\n</section>\n"
    )
