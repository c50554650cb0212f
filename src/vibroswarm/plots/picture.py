"""A picture with the numbers it shows and the words below it, and how it is written: whole, the same each time."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, ParamSpec

import polars as pl

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError, shown
from vibroswarm.plots.style import NAMES, STYLES, settings, style_named

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS: Final = ("svg", "pdf", "png")
SVG_UP_TO: Final = 1_500_000
"""Characters; a themed SVG above this has what lies in its axes painted as images; words and axes stay lines."""

_NO_DATE: Final[dict[str, dict[str, None]]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}

P = ParamSpec("P")


@dataclass(frozen=True)
class Picture(NotebookView):
    """What a ``draw_*`` function gives: the ``figure`` of matplotlib, in one ``style``, with words and numbers."""

    figure: Figure
    numbers: pl.DataFrame
    """What is drawn, no more and no less: a row for each mark."""
    caption: str
    """What the marks are, of how many runs, and what was left undecided."""
    style: str = "column"

    def __repr__(self) -> str:
        return f"Picture({shown(self.caption)}, {self.numbers.height} marks)"

    def write(self, path: Path | str, formats: Sequence[str] = FORMATS) -> list[Path]:
        """Write it as ``path.svg``, ``.pdf`` and ``.png`` (``formats``), with its numbers: see ``write_picture``."""
        return write_picture(
            self.figure, self.numbers, path, formats, dots_per_inch=style_named(self.style).dots_per_inch
        )

    def svg(self) -> str:
        """Return the picture for a page; see ``themed_svg``."""
        return themed_svg(self.figure)


def drawn(draw: Callable[P, Picture]) -> Callable[P, Picture]:
    """Return a ``draw_*`` that works under the settings of its argument ``style`` ("column" if none), the lock held."""

    @wraps(draw)
    def with_settings(*args: P.args, **kwargs: P.kwargs) -> Picture:
        style = style_named(str(kwargs.get("style", "column")))
        with settings(style):
            picture = draw(*args, **kwargs)
        caption = re.sub(r"^[a-z](?=[a-z]*[ ,.])", lambda first: first[0].upper(), picture.caption)
        return replace(picture, style=style.name, caption=caption)

    return with_settings


def write_picture(
    figure: Figure,
    numbers: pl.DataFrame,
    path_without_suffix: Path | str,
    formats: Sequence[str] = FORMATS,
    *,
    dots_per_inch: int = STYLES["column"].dots_per_inch,
) -> list[Path]:
    """Write a figure as SVG, PDF and PNG, and beside them its numbers as CSV; each file whole or not at all.

    The same figure gives the same bytes: no dates, no names of programs, no random ids. Text stays text in SVG
    and TrueType in PDF. Suffixes are put behind the name as it is, which may hold a point.

    Args:
        figure, numbers: what is drawn. path_without_suffix: where. formats: ``svg``, ``pdf``, ``png``.
        dots_per_inch: of PNG, and of images within the others.

    Returns:
        The files written, the CSV last.

    Raises:
        InputError: an unknown format, or the folder cannot be written.
        RunError: the disk is full or failed.
    """
    unknown = [kind for kind in formats if kind not in FORMATS]
    if unknown:
        raise InputError(
            f"'{unknown[0]}' is not a format of a picture; {', '.join(FORMATS)}", field="formats"
        )
    base = Path(path_without_suffix)
    written = []
    for kind in formats:
        path = base.with_name(f"{base.name}.{kind}")
        with whole_file(path) as part:
            part.write_bytes(picture_bytes(figure, kind, dots_per_inch=dots_per_inch))
        written.append(path)
    path = base.with_name(f"{base.name}.csv")
    with whole_file(path) as part:
        part.write_bytes(csv_bytes(numbers))
    return [*written, path]


def picture_bytes(figure: Figure, kind: str, *, dots_per_inch: int = 300) -> bytes:
    """Return a figure as the bytes of an SVG, PDF or PNG file."""
    stream = io.BytesIO()
    with settings(), _fonts_without_layout_tables() if kind == "pdf" else nullcontext():
        figure.savefig(stream, format=kind, dpi=dots_per_inch, metadata=dict(_NO_DATE[kind]))
    return stream.getvalue()


@contextmanager
def _fonts_without_layout_tables() -> Iterator[None]:
    """Leave tables for shaping text out of the fonts in a PDF, whose letters have their places already.

    To read them and cut them down took a third of the time of a PDF.
    """
    options: Any = import_module("fontTools.subset").Options  # matplotlib's own dependency; without types
    before = options._drop_tables_default
    options._drop_tables_default = [*before, "GSUB", "GPOS", "GDEF", "MATH"]
    try:
        yield
    finally:
        options._drop_tables_default = before


def themed_svg(figure: Figure) -> str:
    """Return the figure as SVG whose named colours are CSS variables, ``var(--fig-ink, #1b1e23)``.

    A page may set ``--fig-*`` to show it in dark colours. Layers of very many marks come as an image, so that
    the text stays below some megabytes whatever is drawn.
    """
    text = _svg(figure)
    if len(text) > SVG_UP_TO:
        text = _svg_with_image(figure)
    return _TAG.sub(lambda tag: _themed(tag[0]), text)


_TAG: Final = re.compile(r"<[^<>]*>")  # matplotlib escapes both signs in text and in attributes
_STYLE: Final = re.compile(r'(?<= style=")[^"]*(?=")')
_HATCHED: Final = re.compile(r' fill="(#[0-9a-f]{6})"')
_COLOUR: Final = re.compile(f"({'|'.join(NAMES.values())})(?![0-9a-f])")
_NAME_OF: Final = {colour: name for name, colour in NAMES.items()}


def _themed(tag: str) -> str:
    """Return a tag with variables for colours in its style; the ground of a hatch has its colour elsewhere."""
    tag = _HATCHED.sub(r' style="fill: \1"', tag)
    return _STYLE.sub(lambda style: _COLOUR.sub(_variable, style[0]), tag)


def _variable(match: re.Match[str]) -> str:
    return f"var(--fig-{_NAME_OF[match[0]]}, {match[0]})"


def _svg(figure: Figure) -> str:
    return picture_bytes(figure, "svg", dots_per_inch=150).decode("utf-8")


def _svg_with_image(figure: Figure) -> str:
    """Write a figure as SVG with its many marks as one image."""
    artists: list[Any] = []
    for axes in figure.axes:
        artists += [*axes.collections, *axes.lines, *axes.patches]
    before = [artist.get_rasterized() for artist in artists]
    try:
        for artist in artists:
            artist.set_rasterized(True)
        return _svg(figure)
    finally:
        for artist, was in zip(artists, before, strict=True):
            artist.set_rasterized(was)
