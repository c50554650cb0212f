"""The page as one file: the assets put into the template, the run's numbers beside them."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from importlib.resources import files
from pathlib import Path
from typing import Any

from vibroswarm.files import whole_file
from vibroswarm.page.payload import payload
from vibroswarm.page.record import RunRecord

SCRIPTS = (
    "decode.js",
    "run.js",
    "beta.js",
    "rays.js",
    "words.js",
    "theme.js",
    "canvas.js",
    "glyphs.js",
    "floor_layer.js",
    "samples_layer.js",
    "trails.js",
    "robots.js",
    "arena.js",
    "belief_axes.js",
    "belief_chart.js",
    "posteriors.js",
    "verdict.js",
    "roster.js",
    "details.js",
    "tooltip.js",
    "arena_tooltip.js",
    "player.js",
    "keyboard.js",
    "address.js",
    "main.js",
)
"""The scripts, in the order in which they are put into the page: each uses only what stands before it."""


def page_html(record: RunRecord) -> str:
    """One run as a whole HTML document that needs nothing else: no server, no network, no other file."""
    script = "\n".join(_asset(name) for name in SCRIPTS)
    document = _asset("page.html")
    parts = {
        "title": html.escape(record.title.encode("utf-8", "replace").decode("utf-8")),
        "style": _asset("page.css"),
        "script": script,
        "script_hash": _script_hash(document, script),
        "data": script_json(payload(record)),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], document)


def _script_hash(document: str, script: str) -> str:
    """Of all that stands in the page's script element, so that no other script runs in it."""
    (inner,) = re.findall(r"<script>(.*?)</script>", document, flags=re.DOTALL)
    digest = hashlib.sha256(inner.replace("{{script}}", script).encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def write_page(record: RunRecord, path: Path) -> None:
    """Write ``page_html`` to ``path``, whole or not at all; a file that is there is replaced.

    Raises:
        InputError: the folder cannot be written.
        RunError: the disk is full or failed.
    """
    text = page_html(record)
    with whole_file(Path(path)) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def script_json(value: Any) -> str:
    """JSON that can stand in a script element: nothing in it can end the element or open a comment.

    Raises:
        ValueError: a number is not finite.
    """
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))  # ASCII only: U+2028 is escaped too
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _asset(name: str) -> str:
    return files("vibroswarm.page").joinpath("assets", name).read_text(encoding="utf-8")
