"""Write a run's web page: one HTML file with its style, font and scripts and the run's data."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from vibroswarm.core.atomic_io import write_file
from vibroswarm.result import Result
from vibroswarm.run_page.payload import payload

SCRIPTS: Final = (
    "decode.js",
    "run.js",
    "beta.js",
    "rays.js",
    "words.js",
    "gate.js",
    "theme.js",
    "canvas.js",
    "glyphs.js",
    "floor_layer.js",
    "layers.js",
    "faults.js",
    "samples_layer.js",
    "trails.js",
    "robots.js",
    "places.js",
    "map_layer.js",
    "map_view.js",
    "arena.js",
    "belief_axes.js",
    "belief_band.js",
    "belief_chart.js",
    "events.js",
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
"""The scripts in the order of the page: each uses only earlier ones."""
WEIGHTS: Final = {400: "100 500", 700: "501 900"}
"""Weights of the page's font that are shipped, each with the range of weights that it is used for."""


def page_html(data: dict[str, Any]) -> str:
    """Return the data of a run (``payload``) as an HTML document that needs no server, network or other file."""
    script = "\n".join(_asset(name) for name in SCRIPTS)
    document = _asset("page.html")
    parts = {
        # Lone surrogates, which cannot be written as UTF-8, become question marks.
        "title": html.escape(data["title"].encode("utf-8", "replace").decode("utf-8")),
        "style": _font_faces() + _asset("page.css"),
        "script": script,
        "script_hash": _script_hash(document, script),
        "data": script_json(data),
    }
    # One pass over the template: text such as {{script}} in the title or in the data stays as it is.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], document)


def _font_faces() -> str:
    rules = []
    for weight, range_of in WEIGHTS.items():
        data = files("vibroswarm.run_page").joinpath("assets", f"roboto-{weight}.woff2").read_bytes()
        text = base64.b64encode(data).decode("ascii")
        rules.append(
            f'@font-face {{ font-family: "Roboto embedded"; font-weight: {range_of}; '
            f'src: url(data:font/woff2;base64,{text}) format("woff2"); }}\n'
        )
    return "".join(rules)


def _script_hash(document: str, script: str) -> str:
    """Return the hash of the page's script element; the page's content security policy allows no other script."""
    (code,) = re.findall(r"<script>(.*?)</script>", document, flags=re.DOTALL)
    digest = hashlib.sha256(code.replace("{{script}}", script).encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def script_json(value: Any) -> str:
    """Return JSON that is safe in a script element: no text in it can end the element or open a comment."""
    # ASCII only, so that U+2028, a line end in older scripts, is escaped too.
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _asset(name: str) -> str:
    return files("vibroswarm.run_page").joinpath("assets", name).read_text(encoding="utf-8")


def why_no_page(result: Result) -> str | None:
    """Return why no page can show the runs of a result, as a clause; None if one can."""
    if result.poses is None:
        return "no poses between samples were kept (simulate with poses=True)"
    return None


def write_run_page(result: Result, path: str | Path, run: int = 0, *, title: str = "") -> None:
    """Write the page of one run: a single file that a browser opens from disk; an existing file is replaced.

    Args:
        result: simulated with poses, or a recording. path: of the file. run: number of the run.
        title: heading of the page; by default the number of robots and the name of the floor.
    Raises:
        InputError: the result has no such run or no poses, or ``path`` cannot be written.
        RunError: the disk is full or failed.
    """
    write_file(Path(path), page_html(payload(result, run, title=title)))
