"""Colours, markers and sizes of pictures.

Colours of series lie at CIE L* 17 to 76 (grey print), as far apart as can be with protanopia and deuteranopia too.
Every colour has a name, which ``picture.themed_svg`` writes as a CSS variable, for dark pages.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

from vibroswarm.errors import check_choice

INK: Final = "#1b1e23"
"""Colour of text, axes and dark lines."""
FAINT: Final = "#6f747b"
"""Colour of less important words and lines."""
LINE: Final = "#d4d0c6"
"""Grid lines."""
PAPER: Final = "#ffffff"
"""Colour of the background."""
BAND: Final = "#efece4"
"""Background of the band for values later than the end of the runs."""
ON_DARK: Final = "#fffffd"
"""Colour of numbers and lines on dark parts of a heat map; see ``ON_LIGHT``."""
ON_LIGHT: Final = "#010101"
"""Colour of numbers and lines on light parts of a heat map. Neither colour has a name in ``NAMES``, since a dark page
does not change the colours of the map."""

SERIES: Final = ("#33027f", "#e48c07", "#14716d", "#2ecde9", "#8a1c00", "#1384f0")
"""Colours of series 0 to 5; series 6 to 11 repeat them with open markers."""

OUTCOMES: Final = {
    "right": "#1d4e89",
    "wrong": "#e0562b",
    "split": "#fdc482",
    "incomplete": "#f2efe8",
    "truth_undefined": "#58b7ad",
}
"""Colour of each outcome of a run, and its order in a bar."""

OUTCOME_HATCHES: Final = {
    "right": "",
    "wrong": "///",
    "split": "xxx",
    "incomplete": "...",
    "truth_undefined": "\\\\",
}
"""Hatch of each outcome in a bar, as matplotlib takes it."""

RUN: Final = {
    "still": "#00639c",
    "vibrating": "#b54a00",
    "tile-still": "#fdfcf8",
    "tile-vibrating": "#f9e9db",
    "ripple": "#e5b48f",
    "trail": "#878c93",
}
"""Colours of a picture of one run: those of the replay page (``run_page/assets/page.css``)."""

KINDS: Final = (
    (RUN["tile-still"], RUN["still"]),
    (RUN["tile-vibrating"], RUN["vibrating"]),
    ("#dcebdc", "#1d7a3a"),
    ("#e9def2", "#7a3fa0"),
    ("#f6eec2", "#8a6d00"),
    ("#d9ecf2", "#00707f"),
    ("#f5d9e4", "#a8295c"),
    ("#e3e3e3", "#4d4d4d"),
)
"""Colours of tiles of each kind, and of readings and decisions; further kinds use them again, and their number."""


def kind_colours(kind: int) -> tuple[str, str]:
    """Return the colour of tiles of a kind, and that of readings of it and of robots that decided for it."""
    return KINDS[kind % len(KINDS)]


KIND_HATCHES: Final = (
    "", "////", "....", "xxxx", "\\\\\\\\", "||||", "----", "++++",
    "oo", "**", "//..", "\\\\..", "||..", "--..", "xx..", "++..",
)  # fmt: skip
"""Hatch of tiles of each kind, as matplotlib takes it. From kind 8 on colours repeat; hatches do not."""


def kind_hatch(kind: int) -> str:
    """Return the hatch of tiles of a kind."""
    return KIND_HATCHES[kind % len(KIND_HATCHES)]


NAMES: Final[dict[str, str]] = {
    "ink": INK,
    "faint": FAINT,
    "line": LINE,
    "paper": PAPER,
    "band": BAND,
    **{f"series-{index}": colour for index, colour in enumerate(SERIES)},
    **{kind.replace("_", "-"): colour for kind, colour in OUTCOMES.items()},
    **RUN,
    **{f"tile-kind-{kind}": tile for kind, (tile, _) in enumerate(KINDS) if kind > 1},
    **{f"kind-{kind}": reading for kind, (_, reading) in enumerate(KINDS) if kind > 1},
}
"""Name of each colour that a dark page may replace."""

COLOUR_MAP: Final = "cividis"
"""Of heat maps: perceptually uniform, its luminance rises steadily, and nearly the same for the colour-blind."""

MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "h", "*")
"""Markers of series 0 to 11, by their names in matplotlib."""
HATCHES: Final = ("", "////", "....", "xxxx", "\\\\\\\\", "----", "||||", "oo", "++", "**", "//", "xx")
"""Hatches of series 0 to 11, as matplotlib takes them."""
LINES: Final[tuple[tuple[int, tuple[float, ...]], ...]] = (
    (0, ()),
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (3, 1)),
    (0, (6, 1.5, 1.2, 1.5, 1.2, 1.5)),
)
"""Lines of series 0 to 5: for each the offset, and the lengths of dashes and gaps."""
SERIES_UP_TO: Final = len(MARKERS)
"""Series that have markers of their own."""


class Look(NamedTuple):
    """How one series is drawn."""

    colour: str
    """As ``#rrggbb``."""
    marker: str
    """Marker by its name in matplotlib."""
    line: tuple[int, tuple[float, ...]]
    """Dashes of lines, as matplotlib takes them: the offset, and the lengths of dashes and gaps."""
    hatch: str
    """Hatch of areas, by its name in matplotlib."""
    hollow: bool
    """Whether markers are open, as for series 6 to 11, which repeat the colours of 0 to 5."""


def look(index: int) -> Look:
    """Return the look of a series by its index; they repeat from 12 on."""
    return _look(index % len(SERIES), index % len(MARKERS))


class Style(NamedTuple):
    """Sizes of a picture, as in the file of the same name."""

    name: str
    width_in: float
    height_in: float
    """Height of a picture with two numeric axes; one with a row for each cell grows."""
    font_pt: float
    small_pt: float
    """Size of ticks, legends and names of rows."""
    line_pt: float
    marker_pt: float
    row_in: float
    """Height of a row."""
    dots_per_inch: int = 300


STYLES: Final = {
    "column": Style("column", 3.5, 2.5, 8, 7, 1.1, 3.6, 0.22),
    "page": Style("page", 7.2, 3.8, 9, 8, 1.2, 4.5, 0.24),
    "slide": Style("slide", 13.333, 7.5, 20, 16, 2.6, 10, 0.55, 150),
}
"""``column`` is 89 mm wide with type of 8 pt, ``page`` 183 mm with 9 pt, ``slide`` is 16:9 with 20 pt."""

MATPLOTLIB_LOCK: Final = threading.RLock()
"""Held by a thread that draws or saves, since matplotlib has one set of settings for the whole process."""


def style_named(name: str) -> Style:
    """Return the style of this name: "column", "page" or "slide"."""
    check_choice(name, "style", STYLES)
    return STYLES[name]


@contextmanager
def settings(style: Style = STYLES["page"]) -> Iterator[None]:
    """Use matplotlib's defaults with the changes of a style until the end of the block; other threads wait."""
    from matplotlib import style as styles

    files = [Path(__file__).with_name(f"{name}.mplstyle") for name in ("base", style.name)]
    with MATPLOTLIB_LOCK, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"Glyph \d+")  # readers' programs have other fonts
        with styles.context(["default", *files]):
            yield


BUILT_IN: Final[dict[str, tuple[int, int]]] = {
    "none": (0, 0),
    "positive": (1, 1),
    "soft": (2, 2),
    "bayes_bots": (4, 4),
    "places": (5, 5),
    "mcp": (0, 6),
    "dc": (4, 10),
    "dmvd": (5, 11),
    "dmmd": (0, 3),
    "explore": (4, 7),
    "dirichlet": (5, 8),
    "dirichlet_positive": (0, 9),
    "dirichlet_soft": (1, 10),
    "forget": (2, 0),
    "reset": (3, 1),
    "fading": (4, 2),
    "averaging": (5, 3),
}
"""For each strategy, its indices in ``SERIES`` (colour) and ``MARKERS``. Never change them: readers compare pictures
that were drawn at different times."""

SOURCES: Final = {
    "published": 0,
    "real robots": 0,
    "paper": 1,
    "calibrated": 2,
    "text": 3,
    "authors' simulator": 5,
}
"""For each source of a reproduction of the paper (recordings, published numbers, presets) the index of its look. Never
change them. In a picture with two sources of the same index, looks are given in order instead."""


def looks_of(names: Sequence[str]) -> list[Look]:
    """Return the look of each series: its own if it is a strategy or a source, else one that these do not have."""
    fixed = BUILT_IN | {name: (index, index) for name, index in SOURCES.items()}
    taken = {fixed[name] for name in names if name in fixed}
    places = [(k % len(SERIES), k) for k in range(len(MARKERS))]
    free = [
        pair for pair in (*places, *product(range(len(SERIES)), range(len(MARKERS)))) if pair not in taken
    ]
    others = [name for name in names if name not in fixed]
    return [
        _look(*(fixed[name] if name in fixed else free[others.index(name) % len(free)])) for name in names
    ]


def row_looks(names: Sequence[str]) -> dict[str, Look]:
    """Return the looks of rows by name, if any is a strategy; else none."""
    return dict(zip(names, looks_of(names), strict=True)) if not set(names).isdisjoint(BUILT_IN) else {}


def _look(colour: int, marker: int) -> Look:
    return Look(SERIES[colour], MARKERS[marker], LINES[colour], HATCHES[marker], hollow=marker >= len(SERIES))
