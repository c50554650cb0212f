"""Write a report as one HTML file that needs no server, no network and no other file."""

from __future__ import annotations

import base64
import hashlib
import re
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.core.tables import csv_bytes
from vibroswarm.report.format import MARKS, text_table

if TYPE_CHECKING:
    from jinja2 import Environment

    from vibroswarm.report.report import Figure, Report

ROWS_UP_TO: Final = 200
"""Most rows of a table; its CSV has all."""
CSV_UP_TO: Final = 500_000
"""Most bytes of a table as CSV in a page."""


def page(report: Report, *, whole: bool = True) -> str:
    """Return a report as a page, or, unless ``whole``, as an element without scripts for a notebook."""
    script = _asset("page.js")
    template = _templates().get_template("page.html")
    return template.render(report=report, whole=whole, script=script, script_hash=_hash(script))


def _hash(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _asset(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8").strip()


@cache
def _templates() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    templates = Environment(
        loader=PackageLoader("vibroswarm", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {
        "csv": _csv_address,
        "drawing": _drawing,
        "written": lambda table: text_table(table.frame.head(ROWS_UP_TO), table.titles),
    }
    templates.tests["figure"] = lambda part: hasattr(part, "draw")
    templates.globals |= {"marks": MARKS, "rows_up_to": ROWS_UP_TO, "style": _asset("page.css")}
    return templates


def _csv_address(frame: pl.DataFrame) -> str:
    text = csv_bytes(frame)
    return f"data:text/csv;base64,{base64.b64encode(text).decode()}" if len(text) <= CSV_UP_TO else ""


def _drawing(figure: Figure, name: str) -> dict[str, Any]:
    """Return a picture as SVG, with ids that no other picture of the page has, and its width in CSS pixels."""
    text = figure.picture.svg()
    svg = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", text[text.index("<svg") :], flags=re.S)
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", svg)
    width = float(re.search(r'viewBox="0 0 ([\d.]+)', svg)[1]) * 96 / 72  # type: ignore[index]
    return {
        "svg": re.sub(r'^<svg[^>]*?(viewBox="[^"]*")[^>]*>', r'<svg \1 role="img">', svg),
        "width": round(width),
    }
