"""A part of a report that shows small photographs, each with what it shows, in groups with what to do."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.report.text import code_html, escape

ADDRESS: Final = re.compile(r"data:image/(?:jpeg|png);base64,[A-Za-z0-9+/=]+")


@dataclass(frozen=True)
class ReportFrame(NotebookView):
    """A photograph."""

    address: str
    """The picture itself, as a data URI of a JPEG or PNG."""
    words: str
    """What it shows; stands below it."""


@dataclass(frozen=True)
class ReportFrames(NotebookView):
    """Photographs in a row."""

    words: str
    """A sentence above; empty: none."""
    frames: tuple[ReportFrame, ...]


def frames_html(group: ReportFrames, key: str) -> str:
    """Write a row of photographs that wraps where the page is narrow.

    Raises:
        InputError: an address that is not a JPEG or PNG within the page.
    """
    shots = []
    for frame in group.frames:
        if ADDRESS.fullmatch(frame.address) is None:
            raise InputError("must be a data URI of a JPEG or PNG", field="address")
        label = escape(f"{group.words} {frame.words}")
        shots.append(
            f'<figure><img src="{frame.address}" alt="{label}" width="300" height="300" loading="lazy">'
            f"<figcaption>{code_html(frame.words)}</figcaption></figure>\n"
        )
    above = f"<p>{code_html(group.words)}</p>\n" if group.words else ""
    return f'<div class="part shots" id="{key}">\n{above}<div>\n{"".join(shots)}</div>\n</div>\n'
