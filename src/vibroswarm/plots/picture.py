"""A picture with the numbers it shows and a caption, and how it is written to files and pages.

Files are written completely or not at all, and the same picture gives the same bytes each time.
"""

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

from vibroswarm.core.atomic_io import whole_file, write_file
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import check_choice
from vibroswarm.floors.io import check_suffix
from vibroswarm.plots.layout import lay_out
from vibroswarm.plots.style import NAMES, STYLES, settings, style_named

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS: Final = ("svg", "pdf", "png")
"""Formats of picture files."""
SUFFIXES: Final = (".png", ".svg", ".pdf")
"""Suffixes of picture files."""
SVG_UP_TO: Final = 1_500_000
"""Most characters of an SVG before ``themed_svg`` replaces its colours. If it has more, marks inside the axes become an
image; text and axes do not."""

_NO_DATE: Final[
    dict[str, dict[str, None]]
] = {  # metadata that matplotlib leaves out, since they change each time
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}

P = ParamSpec("P")


@dataclass(frozen=True)
class Picture:
    """What a ``draw_*`` function returns: a ``figure`` of matplotlib in a ``style``, its numbers and its caption."""

    figure: Figure
    numbers: pl.DataFrame
    """Values of the marks, which ``write`` saves as CSV; each ``draw_*`` function documents which columns they have."""
    caption: str
    """Sentences that say what the marks are and, if the function knows it, how many runs they are from and how many of
    these are undecided."""
    style: str = "column"

    def _repr_svg_(self) -> str:
        return self.svg()

    def write(self, path: Path | str, formats: Sequence[str] | None = None) -> list[Path]:
        """Write the picture as ``path.svg``, ``path.pdf`` and ``path.png``, and its numbers as ``path.csv``.

        A path that ends in one of these three suffixes is written in that format alone, with its numbers beside it.
        ``formats`` selects formats instead; then suffixes are appended to the path as it is. Existing files are
        replaced.

        Returns:
            The paths of the files, the CSV last.
        Raises:
            InputError: an unknown format, or the folder cannot be written.
            RunError: the disk is full or failed.
        """
        path = Path(path)
        asked = path.suffix[1:]
        if formats is None and asked in FORMATS:
            path, formats = path.with_suffix(""), (asked,)
        return write_picture(
            self.figure,
            self.numbers,
            path,
            FORMATS if formats is None else formats,
            dots_per_inch=style_named(self.style).dots_per_inch,
        )

    def svg(self) -> str:
        """Return the picture as SVG for a page, see ``themed_svg``."""
        return themed_svg(self.figure)


def drawn(draw: Callable[P, Picture]) -> Callable[P, Picture]:
    """Decorate a ``draw_*`` function, so that it draws with the matplotlib settings of its argument ``style``.

    While it draws, other threads that draw wait, since matplotlib has one set of settings for the whole process. The
    decorator also writes the name of the style into the picture, and begins its caption with a capital letter.
    """

    @wraps(draw)
    def with_settings(*args: P.args, **kwargs: P.kwargs) -> Picture:
        # ``style`` is a keyword argument of all draw functions, and "column" is its default in all of them.
        style = style_named(str(kwargs.get("style", "column")))
        with settings(style):
            picture = draw(*args, **kwargs)
            lay_out(picture.figure)  # breaks labels that are longer than their axes
        # The first letter becomes a capital only if the first word has lower-case letters alone: a symbol or a name,
        # such as "theta_E", stays as it is.
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
    """Write a figure as SVG, PDF and PNG, and its numbers as CSV; each file completely or not at all.

    Existing files are replaced. The same figure gives the same bytes: no dates, no names of programs, no random ids.
    Text stays text in SVG and TrueType in PDF.

    Args:
        figure: of matplotlib. numbers: what it shows.
        path_without_suffix: the suffixes are appended to this path, whose name may contain a dot.
        formats: which of ``svg``, ``pdf`` and ``png`` are written.
        dots_per_inch: of PNG, and of images within the other formats.

    Returns:
        The paths of the files, the CSV last.

    Raises:
        InputError: an unknown format, or the folder cannot be written.
        RunError: the disk is full or failed.
    """
    for kind in formats:
        check_choice(kind, "formats", FORMATS)
    base = Path(path_without_suffix)
    paths = {suffix: base.with_name(f"{base.name}.{suffix}") for suffix in (*formats, "csv")}
    for kind in formats:
        write_file(paths[kind], picture_bytes(figure, kind, dots_per_inch=dots_per_inch))
    write_file(paths["csv"], csv_bytes(numbers))
    return list(paths.values())


def save_figure(draw: Callable[[], Figure], path: Path, *, replace: bool = True) -> None:
    """Draw a figure with the settings of pictures, and write it with 150 dots per inch.

    Args:
        draw: makes the figure. path: of the file, which ends in .svg, .pdf or .png.
        replace: whether an existing file may be replaced.

    Raises:
        InputError: another suffix, the file exists, or its folder cannot be written.
        RunError: the disk is full or failed.
    """
    kind = check_suffix(path, SUFFIXES)[1:]
    with whole_file(path, replace=replace) as part, settings():
        part.write_bytes(picture_bytes(draw(), kind, dots_per_inch=150))


def picture_bytes(figure: Figure, kind: str, *, dots_per_inch: int = 300) -> bytes:
    """Return a figure as the bytes of a file of the given ``kind``: "svg", "pdf" or "png".

    ``dots_per_inch`` is the resolution of PNG, and of images within the other formats. The same figure gives the same
    bytes: the metadata have no date.
    """
    stream = io.BytesIO()
    # matplotlib reads some settings only when it saves: how text is written, and the salt of the ids in an SVG. They
    # are the same in all styles.
    with settings(), _as_laid_out(figure), _fonts_without_layout_tables() if kind == "pdf" else nullcontext():
        figure.savefig(stream, format=kind, dpi=dots_per_inch, metadata=dict(_NO_DATE[kind]))
    return stream.getvalue()


@contextmanager
def _fonts_without_layout_tables() -> Iterator[None]:
    """Drop the layout tables from the fonts that are embedded in a PDF.

    Layout tables say how a program places letters. A PDF does not need them, since it has the place of each letter; and
    reducing them took a third of the time of writing a PDF. The option of fontTools is changed for the whole process
    during the block, and restored at its end.
    """
    options: Any = import_module("fontTools.subset").Options  # matplotlib's own dependency; without types
    before = options._drop_tables_default
    options._drop_tables_default = [*before, "GSUB", "GPOS", "GDEF", "MATH"]
    try:
        yield
    finally:
        options._drop_tables_default = before


@contextmanager
def _as_laid_out(figure: Figure) -> Iterator[None]:
    """Keep the places of the axes inside this context, if nothing has changed since ``lay_out`` found them."""
    engine, stale = figure.get_layout_engine(), figure.stale
    if not stale:
        figure.set_layout_engine(None)  # then it is not drawn twice either
    try:
        yield
    finally:
        figure.set_layout_engine(engine)
        figure.stale = stale


def themed_svg(figure: Figure) -> str:
    """Return the figure as SVG whose named colours are CSS variables, such as ``var(--fig-ink, #1b1e23)``.

    A page may set the variables ``--fig-*`` to show the figure in dark colours. If the SVG has more than ``SVG_UP_TO``
    characters before colours are replaced, it is made again with all marks drawn as an image. This limits the size of a
    page with many marks.
    """
    text = _svg(figure)
    if len(text) > SVG_UP_TO:
        text = _svg_with_image(figure)
    # The tags of the SVG: matplotlib escapes both signs in text and in attributes.
    return re.sub(r"<[^<>]*>", lambda tag: _themed(tag[0]), text)


_STYLE: Final = re.compile(r'(?<= style=")[^"]*(?=")')
"""The text of the attribute ``style`` of a tag."""
_HATCHED: Final = re.compile(r' fill="(#[0-9a-f]{6})"')
"""The attribute ``fill`` of a tag with a colour, as the background of a hatch has it."""
_COLOUR: Final = re.compile(f"({'|'.join(NAMES.values())})(?![0-9a-f])")
"""A named colour, not as the beginning of a longer number."""
_PATH: Final = re.compile(r'(?<= d=")[^"]*(?=")')
"""The points of a path."""
_UNSEEN: Final = re.compile(r"(?<=\.\d\d)\d+")
"""Digits of a place that nobody sees: from the third decimal on, in points."""
_NAME_OF: Final = {colour: name for name, colour in NAMES.items()}


def _themed(tag: str) -> str:
    """Replace the named colours in the style of an SVG ``tag`` by CSS variables, which are allowed only in a style.

    Places in it are cut to two decimals, which makes pages smaller by up to a fifth.

    The background of a hatch has its colour in the attribute ``fill``, which therefore becomes a style first.
    """
    tag = _HATCHED.sub(r' style="fill: \1"', tag)
    tag = _PATH.sub(lambda path: _UNSEEN.sub("", path[0]), tag)
    return _STYLE.sub(lambda style: _COLOUR.sub(_css_variable, style[0]), tag)


def _css_variable(match: re.Match[str]) -> str:
    return f"var(--fig-{_NAME_OF[match[0]]}, {match[0]})"


def _svg(figure: Figure) -> str:
    """Return a figure as the text of an SVG file; images in it have 150 dots per inch."""
    return picture_bytes(figure, "svg", dots_per_inch=150).decode("utf-8")


def _svg_with_image(figure: Figure) -> str:
    """Return a figure as SVG in which all marks inside the axes are drawn as images; text and axes stay vectors.

    The marks are set to be rasterised for this, and set back at the end.
    """
    artists: list[Any] = []
    for axes in figure.axes:
        artists += [*axes.collections, *axes.lines, *axes.patches]
    before = [artist.get_rasterized() for artist in artists]
    try:
        for artist in artists:
            artist.set_rasterized(True)
        return _svg(figure)
    finally:
        for artist, was_rasterized in zip(artists, before, strict=True):
            artist.set_rasterized(was_rasterized)
