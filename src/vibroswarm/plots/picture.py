"""A picture with the numbers it shows and a caption; the same picture gives the same bytes each time."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Final, ParamSpec

import polars as pl

from vibroswarm.core.atomic_io import whole_file, write_file
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import check_choice
from vibroswarm.floors.io import check_suffix
from vibroswarm.plots.style import NAMES, STYLES, settings, style_named

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS: Final = ("svg", "pdf", "png")
"""Formats of picture files."""
SUFFIXES: Final = (".png", ".svg", ".pdf")
"""Suffixes of picture files."""
_NO_DATE: Final[dict[str, dict[str, None]]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}
"""Metadata that are left out, since they change each time."""

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
        """Write the picture as ``path.svg``, ``.pdf`` and ``.png``, or by the path's suffix, and its numbers as CSV."""
        path = Path(path)
        if formats is None and path.suffix in SUFFIXES:
            path, formats = path.with_suffix(""), (path.suffix[1:],)
        paths = []
        for kind in FORMATS if formats is None else formats:
            check_choice(kind, "formats", FORMATS)
            paths.append(path.with_name(f"{path.name}.{kind}"))
            dots = STYLES[self.style].dots_per_inch
            write_file(paths[-1], picture_bytes(self.figure, kind, dots_per_inch=dots))
        paths.append(path.with_name(f"{path.name}.csv"))
        write_file(paths[-1], csv_bytes(self.numbers))
        return paths

    def svg(self) -> str:
        """Return the picture as SVG for a page, see ``themed_svg``."""
        return themed_svg(self.figure)


def drawn(draw: Callable[P, Picture]) -> Callable[P, Picture]:
    """Decorate a ``draw_*`` function, so that it draws with the settings of its argument ``style``."""

    @wraps(draw)
    def with_settings(*args: P.args, **kwargs: P.kwargs) -> Picture:
        # ``style`` is a keyword argument of all draw functions; most have the default "column".
        style = style_named(str(kwargs.get("style") or (draw.__kwdefaults__ or {}).get("style", "column")))
        with settings(style):
            picture = draw(*args, **kwargs)
        caption = re.sub(r"^[a-z](?=[a-z]*[ ,.])", lambda first: first[0].upper(), picture.caption)
        return replace(picture, style=style.name, caption=caption)

    return with_settings


def save_figure(draw: Callable[[], Figure], path: Path, *, replace: bool = True) -> None:
    """Draw a figure with the settings of pictures, and write it with 150 dots per inch."""
    kind = check_suffix(path, SUFFIXES)[1:]
    with whole_file(path, replace=replace) as part, settings():
        part.write_bytes(picture_bytes(draw(), kind, dots_per_inch=150))


def picture_bytes(figure: Figure, kind: str, *, dots_per_inch: int = 300) -> bytes:
    """Return a figure as the bytes of a file of the given ``kind``: "svg", "pdf" or "png"."""
    stream = io.BytesIO()
    with settings():  # how text is written, and the salt of ids, are read when a figure is saved
        figure.savefig(stream, format=kind, dpi=dots_per_inch, metadata=dict(_NO_DATE[kind]))
    return stream.getvalue()


_COLOUR: Final = re.compile(f"({'|'.join(NAMES.values())})(?![0-9a-f])")
"""A named colour, not as the beginning of a longer number."""
_NAME_OF: Final = {colour: name for name, colour in NAMES.items()}


def themed_svg(figure: Figure) -> str:
    """Return the figure as SVG whose named colours are CSS variables, such as ``var(--fig-ink, #1b1e23)``."""
    text = picture_bytes(figure, "svg", dots_per_inch=150).decode("utf-8")
    text = re.sub(
        r' fill="(#[0-9a-f]{6})"', r' style="fill: \1"', text
    )  # variables are allowed in styles only
    return re.sub(r'(?<= style=")[^"<>]*(?=")', lambda style: _COLOUR.sub(_variable, style[0]), text)


def _variable(colour: re.Match[str]) -> str:
    return f"var(--fig-{_NAME_OF[colour[0]]}, {colour[0]})"
