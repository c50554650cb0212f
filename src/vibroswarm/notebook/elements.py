"""Make the HTML elements of notebook views.

Every plain text is escaped, so that no name in a scenario or file becomes markup.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

STYLE: Final = "font-family: system-ui, sans-serif; font-size: 13px; line-height: 1.45; max-width: 60em"
"""Style of a view. It sets no colours, so that text and lines have those of the notebook's theme."""
CELL: Final = "text-align: left; padding: 2px 12px 2px 0; border: 0; background: none; vertical-align: top"
"""Style of a cell with text."""
NUMBER: Final = "text-align: right; padding: 2px 12px 2px 0; border: 0; background: none; vertical-align: top"
"""Style of a cell with a number."""


def escaped(text: object) -> str:
    """Escape text for HTML elements and quoted attributes; lone surrogates are replaced."""
    return html.escape(str(text).encode("utf-8", "replace").decode("utf-8"), quote=True)


def card(title: str, *parts: str) -> str:
    """Return an HTML block with a title and further elements.

    Args:
        title: plain text. parts: HTML elements, one below the other.
    """
    return f'<div class="vibroswarm" style="{STYLE}"><strong>{escaped(title)}</strong>{"".join(parts)}</div>'


def paragraph(text: str) -> str:
    """Return a paragraph of plain text."""
    return f'<p style="margin: 4px 0">{escaped(text)}</p>'


def details(title: str, text: str) -> str:
    """Return a block of plain text that is hidden until its title is clicked."""
    return f"<details><summary>{escaped(title)}</summary><pre>{escaped(text)}</pre></details>"


def rows(values: Mapping[str, object]) -> str:
    """Return an HTML table with one row for each name and its value."""
    lines = "".join(
        f'<tr><th style="{CELL}; font-weight: normal; opacity: 0.7">{escaped(name)}</th>'
        f'<td style="{CELL}">{escaped(value)}</td></tr>'
        for name, value in values.items()
    )
    return f'<table style="margin: 4px 0; border-collapse: collapse">{lines}</table>'


def table(heads: Sequence[str], body: Iterable[Sequence[object]], texts: int = 1) -> str:
    """Return an HTML table; its first ``texts`` columns are aligned as text, the others as numbers.

    Args:
        heads: headings of the columns. body: the rows, plain values. texts: number of columns with text, from the left.
    """

    def cells(tag: str, values: Sequence[object]) -> str:
        """Return the cells of a row; ``tag``: "th" for headings, "td" for values."""
        return "".join(
            f'<{tag} style="{CELL if place < texts else NUMBER}">{escaped(value)}</{tag}>'
            for place, value in enumerate(values)
        )

    lines = "".join(f"<tr>{cells('td', values)}</tr>" for values in body)
    return (
        f'<table style="margin: 4px 0; border-collapse: collapse"><thead><tr>{cells("th", heads)}</tr></thead>'
        f"<tbody>{lines}</tbody></table>"
    )


def image(data: bytes, kind: str, words: str, width_px: int) -> str:
    """Return a picture as an image element, in which no script can run.

    Args:
        data: bytes of the file. kind: "png" or "svg+xml". words: what it shows, for screen readers. width_px: its
            largest width.
    """
    text = base64.b64encode(data).decode("ascii")
    # White: pictures are drawn for white paper, and may be transparent.
    style = f"width: {width_px}px; max-width: 100%; background: #fff"
    return f'<img alt="{escaped(words)}" style="{style}" src="data:image/{kind};base64,{text}">'


def page(document: str, title: str, height_px: int) -> str:
    """Return a frame (``iframe``) with a whole HTML document.

    The frame is sandboxed: its scripts run, but have an origin of their own and cannot reach the notebook.

    Args:
        document: the HTML document. title: what it shows, for screen readers. height_px: height of the frame.
    """
    return (
        f'<iframe title="{escaped(title)}" sandbox="allow-scripts allow-downloads" loading="lazy" '
        f'style="width: 100%; height: {height_px}px; border: 0" srcdoc="{escaped(document)}"></iframe>'
    )
