"""A report in one HTML file: text, tables that can be sorted, pictures with their numbers; nothing from outside.

    write_report("report.html", Report("What feedback buys", sections=(
        Section("Outcomes", text=("Soft feedback decides sooner.",), parts=(
            ReportTable(frame, {"right": Column("right", percent=True)}),
            picture_of(draw_outcomes(counts), "outcomes"),
        )),
    )))

All text is plain: it is escaped wherever it comes from, and only words between backticks become code.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Protocol

import polars as pl

from vibroswarm.files import whole_file
from vibroswarm.page.report_parts import code_html, escape, lines_html, picture_html, table_html

CONTENTS_FROM = 4
"""Sections, subsections counted; fewer need no table of contents."""
LONG_FROM = 30
"""Entries of a table of contents; with more, only the part that one reads is unfolded."""


@dataclass(frozen=True)
class Column:
    """How a column of a table is headed and its numbers are written."""

    title: str = ""
    """Heading; empty: the column's name."""
    unit: str = ""
    digits: int = 3
    """Significant digits of a number that is not whole; the CSV has all."""
    percent: bool = False
    """Whether a share from 0 to 1 is written in percent."""
    prose: bool = False
    """Whether it holds sentences, which are given room."""
    tones: Mapping[str, str] = field(default_factory=dict)
    """Marks of cells, beside their words: of ``TONES``, by what a cell begins with (the longest that fits)."""


@dataclass(frozen=True)
class ReportTable:
    """A table of a section; missing values are a dash, and come last however it is sorted."""

    frame: pl.DataFrame
    columns: Mapping[str, Column] = field(default_factory=dict)
    """By name; those not named are written as ``Column()`` says."""
    caption: str = ""
    name: str = "table"
    """Of the CSV that can be saved, without suffix."""
    rows_up_to: int = 500
    """Rows shown; the CSV has all."""


@dataclass(frozen=True)
class ReportPicture:
    """A picture of a section, with its numbers to be saved as CSV."""

    svg: str
    """An SVG document; ``vibroswarm.plots.Picture.svg()`` gives one that follows light and dark."""
    caption: str
    numbers: pl.DataFrame
    name: str = "picture"
    """Of the CSV that can be saved, without suffix."""


@dataclass(frozen=True)
class ReportCode:
    """Text of a section that stands as it is, line by line: a file, a command."""

    text: str
    name: str = "text"
    """What it is, for those who do not see it."""


class _Drawn(Protocol):
    @property
    def numbers(self) -> pl.DataFrame: ...
    @property
    def caption(self) -> str: ...
    def svg(self) -> str: ...


def picture_of(drawn: _Drawn, name: str) -> ReportPicture:
    """What a ``draw_*`` of ``vibroswarm.plots`` gave, for a report; ``name`` is that of its CSV."""
    return ReportPicture(drawn.svg(), drawn.caption, drawn.numbers, name)


@dataclass(frozen=True)
class Section:
    """A part of a report with a heading; sections may hold sections, down to three levels."""

    title: str
    text: tuple[str, ...] = ()
    """Paragraphs."""
    parts: tuple[ReportTable | ReportPicture | ReportCode, ...] = ()
    sections: tuple[Section, ...] = ()
    folded: bool = False
    """Whether it is closed until it is asked for (in print it is open)."""
    side_by_side: bool = False
    """Whether its sections stand two in a row where there is room, but for folded ones."""


@dataclass(frozen=True)
class Report:
    """A whole report."""

    title: str
    lead: tuple[str, ...] = ()
    """First paragraphs: what was found."""
    warnings: tuple[str, ...] = ()
    """What a reader must know before believing it; each stands in a frame above all else."""
    sections: tuple[Section, ...] = ()
    details: Mapping[str, str] = field(default_factory=dict)
    """How it was made: seed, versions, command; at the end."""


def write_report(path: Path | str, report: Report) -> None:
    """Write ``report_html`` to ``path``, whole or not at all; a file that is there is replaced.

    Raises:
        InputError: a picture is no plain SVG or too large, or the folder cannot be written.
        RunError: the disk is full or failed.
    """
    text = report_html(report)
    with whole_file(Path(path)) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def report_html(report: Report) -> str:
    """The report as a whole HTML document that needs nothing else: no server, no network, no other file.

    The same report gives the same text.

    Raises:
        InputError: a picture is no plain SVG, or too large.
    """
    script = _asset("report.js")
    digest = base64.b64encode(hashlib.sha256(f"\n{script}\n".encode()).digest()).decode()
    parts = {
        "title": escape(report.title),
        "script_hash": f"sha256-{digest}",
        "style": _asset("report.css"),
        "script": script,
        "contents": _contents(report.sections),
        "warnings": "".join(
            f'<aside class="warning" role="note"><strong>Warning.</strong> {code_html(text)}</aside>\n'
            for text in report.warnings
        ),
        "lead": _paragraphs(report.lead, "lead"),
        "sections": "".join(
            _section(section, f"s{place}", 2) for place, section in enumerate(report.sections, start=1)
        ),
        "details": _details(report.details),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _asset("report.html"))


def _asset(name: str) -> str:
    return files("vibroswarm.page").joinpath("assets", name).read_text(encoding="utf-8").strip()


def _paragraphs(texts: tuple[str, ...], kind: str = "") -> str:
    opening = f'<p class="{kind}">' if kind else "<p>"
    return "".join(f"{opening}{code_html(text)}</p>\n" for text in texts)


def _section(section: Section, key: str, level: int) -> str:
    heading = f'<h{level} id="{key}">{escape(section.title)}</h{level}>'
    inner = _paragraphs(section.text)
    for place, part in enumerate(section.parts, start=1):
        at = f"{key}p{place}"
        if isinstance(part, ReportTable):
            inner += table_html(part, at)
        else:
            inner += picture_html(part, at) if isinstance(part, ReportPicture) else lines_html(part, at)
    below = "".join(
        _section(one, f"{key}-{place}", min(level + 1, 4))
        for place, one in enumerate(section.sections, start=1)
    )
    inner += f'<div class="beside">\n{below}</div>\n' if section.side_by_side else below
    folded = f"<details>\n<summary>{heading}</summary>\n{inner}</details>\n"
    inner = folded if section.folded else f"{heading}\n{inner}"
    return f'<section aria-labelledby="{key}">\n{inner}</section>\n'


def _contents(sections: tuple[Section, ...]) -> str:
    count = sum(1 + len(section.sections) for section in sections)
    if count < CONTENTS_FROM:
        return ""
    kind = "contents long" if count >= LONG_FROM else "contents"
    return (
        f'<nav class="{kind}" aria-labelledby="contents">\n<h2 id="contents">Contents</h2>\n'
        f"{_entries(sections, 's')}</nav>\n"
    )


def _entries(sections: tuple[Section, ...], key: str) -> str:
    lines = []
    for place, section in enumerate(sections, start=1):
        at = f"{key}{place}"
        below = _entries(section.sections, f"{at}-") if section.sections and key == "s" else ""
        lines.append(f'<li><a href="#{at}">{escape(section.title)}</a>{below}</li>\n')
    return f"<ol>\n{''.join(lines)}</ol>\n"


def _details(details: Mapping[str, str]) -> str:
    if not details:
        return ""
    rows = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(text)}</dd></div>\n" for name, text in details.items()
    )
    return (
        '<section class="made" aria-labelledby="made">\n<h2 id="made">How this was made</h2>\n'
        f"<dl>\n{rows}</dl>\n</section>\n"
    )
