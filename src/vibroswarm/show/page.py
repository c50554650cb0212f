"""A document as HTML: a whole page that needs no server, no network and no other file, or a fragment of one.

The templates escape every text; words between backticks become code.
"""

from __future__ import annotations

import base64
import hashlib
import math
import re
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.tables import csv_bytes
from vibroswarm.show.cells import Cell, Heading, Written, written
from vibroswarm.show.document import Document, Figure, Part, Section, Table
from vibroswarm.show.markup import code_html, escape, inline_svg, minus_signs, unbroken_options
from vibroswarm.show.page_origin import with_origin

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

ROWS_UP_TO: Final = 500
"""Rows of a table on a page; its CSV has all."""
COLUMNS_UP_TO: Final = 13
"""Columns of a table on a page; those beyond stand in tables below it, each with the names of the rows."""
ROWS_IN_FRAGMENT: Final = 20
"""Rows of a table in a fragment."""
WORDY_FROM: Final = 26
"""A heading of numbers with more letters than this gets extra width; otherwise each word would take a line."""
CSV_UP_TO: Final = 500_000
"""Largest size in bytes of a table as CSV that is included in the page."""
CONTENTS_FROM: Final = 4
"""Entries from which there is a table of contents."""
LONG_FROM: Final = 30
"""Entries of a table of contents from which only the current part is unfolded."""
LONG: Final = 250
"""A certificate whose title and warnings have more characters is set in smaller letters, to print on one sheet."""


def write_page(
    path: Path | str,
    document: Document,
    progress: Callable[[float], None] = lambda share: None,
    made_from: str | None = None,
) -> None:
    """Write a document as an HTML file, completely or not at all; an existing file is replaced.

    Args:
        progress: called with the share of figures that are drawn.
        made_from: what the page shall say that it was made from (``page_origin.origin``).
    Raises:
        InputError: a figure is not a plain SVG or too large, or the folder cannot be written.
        RunError: the disk is full or failed.
    """
    for place, figure in enumerate(document.figures.values(), start=1):
        _ = figure.drawn  # it is drawn once
        progress(place / len(document.figures))
    text = page_html(document)
    if made_from is not None:
        text = with_origin(text, made_from)
    write_file(Path(path), text)


def page_html(document: Document) -> str:
    """Return a document as a complete page; the same document always gives the same text.

    Raises:
        InputError: a figure is not a plain SVG or too large.
    """
    script = _asset("page.js")
    # The page's content security policy allows only the script with this hash: the script element contains it between
    # two line feeds.
    digest = base64.b64encode(hashlib.sha256(f"\n{script}\n".encode()).digest()).decode()
    # What stands before the first section belongs to the first screen.
    place = next(
        (n for n, part in enumerate(document.parts) if isinstance(part, Section)), len(document.parts)
    )
    rest = document.parts[place:]
    return (
        _environment()
        .get_template("page.html")
        .render(
            document=document,
            first=document.parts[:place],
            rest=rest,
            contents=_contents(rest),
            style=_markup(_asset("page.css")),
            script=_markup(script),
            script_hash=f"sha256-{digest}",
        )
    )


def certificate_html(document: Document) -> str:
    """Return a document as one page without scripts that prints on one sheet of A4; with warnings: not certified."""
    is_long = len(" ".join([document.title, *document.warnings])) > LONG
    return _environment().get_template("certificate.html").render(document=document, is_long=is_long)


def fragment_html(document: Document) -> str:
    """Return a document as one HTML element without scripts, for a notebook."""
    return _environment().get_template("fragment.html").render(document=document, rows_up_to=ROWS_IN_FRAGMENT)


def _contents(parts: tuple[Part, ...]) -> dict[str, Any] | None:
    """Return the table of contents: sections and what has a heading in them; None if it is too short.

    In contents of the class "long", the style sheet hides what is in sections; in a wide window that of the current
    section is shown.
    """
    entries = _entries(parts, "s")
    for entry, part in zip(entries, [part for part in parts if isinstance(part, Section)], strict=True):
        entry["below"] = _entries(part.parts, f"{entry['key']}-")
    count = len(entries) + sum(len(entry["below"]) for entry in entries)
    if count < CONTENTS_FROM:
        return None
    return {"kind": "contents long" if count >= LONG_FROM else "contents", "entries": entries}


def _entries(parts: tuple[Part, ...], key: str) -> list[dict[str, Any]]:
    """Return title and id of each part with a heading; ids are those that the template ``parts.html`` gives."""
    return [
        {"title": part.title, "key": f"{key}{place}" if isinstance(part, Section) else f"{key}{place}-h"}
        for place, part in enumerate(parts, start=1)
        if isinstance(part, Section) or (isinstance(part, Figure) and part.title and key != "s")
    ]


def _asset(name: str) -> str:
    return files("vibroswarm.show").joinpath("assets", name).read_text(encoding="utf-8").strip()


@cache
def _environment() -> Environment:
    """Return the templates, with what they need to write cells and figures."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("vibroswarm.show"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "breakable": _breakable,
        "cells": _cells,
        "classes": _classes,
        "clean": lambda text: _markup(escape(text)),
        "code": lambda text: _markup(code_html(text)),
        "csv_link": _csv_link,
        "drawing": _drawing,
        "image": _image_address,
        "is_finite": math.isfinite,
        "kind": lambda part: type(part).__name__,
        "minus": minus_signs,
        "on_strip": _on_strip,
    }
    return environment


def _markup(html: str) -> Markup:
    from markupsafe import Markup

    return Markup(html)


def _cells(table: Table, rows_up_to: int = ROWS_UP_TO) -> dict[str, Any]:
    """Return the cells of a table, its pieces, and the scale of each column of strips: its largest absolute value."""
    laid: Written = written(table, rows_up_to)
    scales: dict[str, float] = {}
    for place, head in enumerate(laid.headings):
        cells = [row[place] for row in laid.rows] if head.column.strip else []
        sizes = [abs(v) for cell in cells for v in (cell.value, *(cell.ends or ())) if v is not None]
        scales[head.name] = max((size for size in sizes if math.isfinite(size)), default=0.0)
    return laid._asdict() | {"scales": scales, "pieces": _pieces(laid, table.names)}


def _pieces(laid: Written, names: int) -> list[Written]:
    """Split a table of more than ``COLUMNS_UP_TO`` columns into pieces of about as many; each has the names."""
    width = len(laid.headings)
    count = 1 if width <= COLUMNS_UP_TO else math.ceil((width - names) / max(COLUMNS_UP_TO - names, 1))
    step = max(math.ceil((width - names) / count), 1)
    chosen = [
        [*range(names), *range(names, width)[start : start + step]] for start in range(0, count * step, step)
    ]
    return [
        Written([laid.headings[c] for c in columns], [[row[c] for c in columns] for row in laid.rows], 0)
        for columns in chosen
    ]


def _classes(head: Heading, cell: Cell | None = None) -> str:
    """Return the classes of a heading, or of a cell, which has the tone of its text too."""
    wordy = cell is None and head.is_number and len(head.title) > WORDY_FROM
    kinds = {
        "number": head.is_number,
        "wordy": wordy,
        "prose": head.column.prose,
        cell.tone if cell else "": bool(cell and cell.tone),
    }
    return " ".join(kind for kind, applies in kinds.items() if applies)


def _breakable(text: object) -> Markup:
    """Escape text, and allow line breaks in long words, since names of fields would widen a column otherwise."""
    return _markup(
        re.sub(r"\w{13,}", lambda name: name[0].replace("_", "_<wbr>"), unbroken_options(escape(text)))
    )


def _on_strip(value: float, scale: float) -> str:
    """Return the place of a value on a strip 200 units wide that goes from -``scale`` to ``scale``."""
    return f"{100 * (1 + max(min(value, scale), -scale) / scale):.1f}"


def _drawing(figure: Figure, key: str) -> dict[str, Any]:
    """Return a figure's SVG, with ids that begin with ``key``, and a width that keeps its text legible."""
    svg, width = inline_svg(figure.drawn.svg(), f"{key}-", figure.drawn.caption)
    return {"svg": _markup(svg), "size": f"clamp({0.8 * width:.0f}px, 100%, {1.5 * width:.0f}px)"}


def _image_address(figure: Figure) -> str:
    return f"data:image/svg+xml;base64,{base64.b64encode(figure.drawn.svg().encode()).decode('ascii')}"


def _csv_link(frame: pl.DataFrame, name: str) -> dict[str, str] | None:
    """Return the file name without suffix and the CSV of a table, coded; None if it is too large for the page."""
    # CSV is rarely 20 times smaller than its table in memory, so a table of more than 20 times the limit is not even
    # converted.
    if frame.estimated_size() > 20 * CSV_UP_TO:
        return None
    data = csv_bytes(frame)
    if len(data) > CSV_UP_TO:
        return None
    return {
        "file": re.sub(r"[^\w.-]+", "-", name) or "numbers",
        "data": base64.b64encode(data).decode("ascii"),
    }
