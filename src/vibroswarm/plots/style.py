"""Colours that are told apart in grey print and by the colour-blind, and the marks that say the same in shape.

Every colour of a picture has a name. ``themed_svg`` in ``picture.py`` writes it as a CSS variable with the
colour as fallback, so that a page can show the same picture in dark colours.

The series' colours lie at CIE L* 17, 30, 43, 55, 66 and 76; hues were chosen by search so that the smallest
distance (CIE 1976) between any two is as large as can be, also as seen with protanopia and deuteranopia
(Machado, Oliveira and Fernandes 2009, severity 1). A test measures both.

Each strategy has one colour and marker in all pictures, whichever others are drawn beside it. A series belongs to a
strategy if a part of its name is the strategy's: ``soft``, ``random:0.48, soft``, ``soft (gate own)``. Strategies of
users get one of the free pairs by a hash of their name. Sources of a reproduction have looks of their own; other series
are drawn in order.

Sizes for where a picture is to stand: a journal's column, a page of two columns, a slide.

Pictures are Figure objects; pyplot is never used. matplotlib reads its settings from one place for the whole
process, so they are set under one lock and put back: pictures may be drawn from any thread.
"""

from __future__ import annotations

import re
import threading
import warnings
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vibroswarm import strategies
from vibroswarm.errors import InputError, nearest

INK: Final = "#1b1e23"
FAINT: Final = "#6f747b"
"""Words and lines of second rank."""
LINE: Final = "#d4d0c6"
"""Grid lines."""
PAPER: Final = "#ffffff"
BAND: Final = "#efece4"
"""The ground behind what was undecided at the end of a run."""
ON_DARK: Final = "#fffffd"
ON_LIGHT: Final = "#010101"
"""Numbers written into the cells of a heat map; the same in every theme, as the cells are."""

SERIES: Final = ("#33027f", "#e48c07", "#14716d", "#2ecde9", "#8a1c00", "#1384f0")

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

RUN: Final = {
    "still": "#00639c",
    "vibrating": "#b54a00",
    "tile-still": "#fdfcf8",
    "tile-vibrating": "#f9e9db",
    "ripple": "#e5b48f",
    "trail": "#878c93",
}
"""Colours of a picture of one run: those of the replay page (``run_page/assets/page.css``)."""

NAMES: Final[dict[str, str]] = {
    "ink": INK,
    "faint": FAINT,
    "line": LINE,
    "paper": PAPER,
    "band": BAND,
    **{f"series-{index}": colour for index, colour in enumerate(SERIES)},
    **{kind.replace("_", "-"): colour for kind, colour in OUTCOMES.items()},
    **RUN,
}
"""Name of each colour that a dark page may replace."""

COLOUR_MAP: Final = "cividis"
"""Of heat maps: perceptually uniform, its luminance rises steadily, and nearly the same for the colour-blind."""

MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "h", "*")
HATCHES: Final = ("", "////", "....", "xxxx", "\\\\\\\\", "----", "||||", "oo", "++", "**", "//", "xx")
LINES: Final[tuple[tuple[int, tuple[float, ...]], ...]] = (
    (0, ()),
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (3, 1)),
    (0, (6, 1.5, 1.2, 1.5, 1.2, 1.5)),
)
SERIES_UP_TO: Final = len(MARKERS)


class Look(NamedTuple):
    """How one series is drawn: by colour, and by what is left of it in grey."""

    colour: str
    marker: str
    line: tuple[int, tuple[float, ...]]
    hatch: str
    hollow: bool
    """Markers are open; so are those of series seven to twelve, whose colours come a second time."""


def look(index: int) -> Look:
    """Return the look of series ``index`` (0 to 11); each differs from all others in marker and in hatch."""
    return Look(
        colour=SERIES[index % len(SERIES)],
        marker=MARKERS[index],
        line=LINES[index % len(LINES)],
        hatch=HATCHES[index],
        hollow=index >= len(SERIES),
    )


@dataclass(frozen=True)
class Style:
    """Sizes in inches, type and lines in points."""

    name: str
    width_in: float
    height_in: float
    """Of a picture with two numeric axes; one with a row for each cell grows, except on a slide."""
    font_pt: float
    small_pt: float
    line_pt: float
    marker_pt: float
    row_in: float
    """Height of one row, where there is room."""
    least_row_in: float
    tallest_in: float
    """Rows shrink to ``least_row_in`` to stay within this; beyond, the picture grows past it."""
    dots_per_inch: int

    @property
    def fixed_height(self) -> bool:
        """Whether a picture keeps its height as long as its rows can be read in it."""
        return self.tallest_in == self.height_in


STYLES: Final = {
    "column": Style("column", 3.5, 2.5, 8, 7, 1.1, 3.6, 0.22, 0.115, 9.0, 300),
    "page": Style("page", 7.2, 3.8, 9, 8, 1.2, 4.5, 0.24, 0.125, 9.4, 300),
    "slide": Style("slide", 13.333, 7.5, 20, 16, 2.6, 10, 0.55, 0.2, 7.5, 150),
}
"""``column`` is 89 mm wide with type of 8 pt, ``page`` 183 mm with 9 pt, ``slide`` is 16:9 with 20 pt."""

MATPLOTLIB_LOCK: Final = threading.RLock()
"""Held by whoever draws or saves, since matplotlib's settings are those of the whole process."""


def style_named(name: str) -> Style:
    """Return the style of this name.

    Raises:
        InputError: there is none.
    """
    if name not in STYLES:
        known = ", ".join(STYLES)
        raise InputError(f"'{name}' is not one of {known}{nearest(name, STYLES)}", field="style")
    return STYLES[name]


@contextmanager
def settings(style: Style | None = None) -> Iterator[None]:
    """Apply matplotlib's own defaults, then this style's, for as long as the block lasts; one thread at a time.

    Letters that the font lacks are no matter for a warning: in SVG and HTML the reader's fonts have them.
    """
    from matplotlib import style as styles

    with MATPLOTLIB_LOCK, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"Glyph \d+")
        with styles.context(["default", _parameters(style or STYLES["page"])]):
            yield


def _parameters(style: Style) -> dict[str, Any]:
    """Return matplotlib's settings of a style."""
    thin = style.line_pt * 0.6
    return {
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans", "Verdana", "sans-serif"],  # the first comes with matplotlib
        "font.size": style.font_pt,
        "axes.titlesize": style.font_pt,
        "axes.labelsize": style.font_pt,
        "xtick.labelsize": style.small_pt,
        "ytick.labelsize": style.small_pt,
        "legend.fontsize": style.small_pt,
        "legend.frameon": False,
        "legend.handlelength": 2.2,
        "text.parse_math": False,  # a name may hold a dollar
        "text.color": INK,
        "axes.labelcolor": INK,
        "axes.edgecolor": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "axes.facecolor": PAPER,
        "figure.facecolor": PAPER,
        "savefig.facecolor": PAPER,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": thin,
        "xtick.major.width": thin,
        "ytick.major.width": thin,
        "xtick.minor.width": thin / 2,
        "ytick.minor.width": thin / 2,
        "xtick.major.size": style.font_pt * 0.4,
        "ytick.major.size": style.font_pt * 0.4,
        "grid.color": LINE,
        "grid.linewidth": thin,
        "axes.axisbelow": True,
        "axes.unicode_minus": True,
        "lines.linewidth": style.line_pt,
        "lines.markersize": style.marker_pt,
        "patch.linewidth": thin,
        "hatch.linewidth": thin,
        "hatch.color": INK,
        "axes.labelpad": style.font_pt * 0.4,
        "axes.titlepad": style.font_pt * 0.6,
        "svg.fonttype": "none",  # letters stay text: they can be found, read aloud and scaled
        "svg.hashsalt": "vibroswarm",
        "pdf.fonttype": 42,  # TrueType, as journals ask
        "ps.fonttype": 42,
        "path.simplify": True,
        "figure.constrained_layout.h_pad": style.font_pt * 0.4 / 72,
        "figure.constrained_layout.w_pad": style.font_pt * 0.4 / 72,
    }


BUILT_IN: Final[dict[str, tuple[int, int]]] = {
    "none": (0, 0),
    "positive": (1, 1),
    "soft": (2, 2),
    "totals": (3, 3),
    "bayes_bots": (4, 4),
    "places": (5, 5),
    "mcp": (0, 6),
    "asdf": (1, 7),
    "bayes_cpf": (2, 8),
    "dbbs": (3, 9),
    "dc": (4, 10),
    "dmvd": (5, 11),
    "dmmd": (0, 3),
    "three_valued": (1, 4),
    "distrust": (2, 5),
    "field": (3, 6),
    "explore": (4, 7),
}
"""Places in ``SERIES`` and ``MARKERS``. Never change them: readers compare pictures of different days."""

SOURCES: Final = {
    "published": 0,
    "real robots": 0,
    "paper": 1,
    "calibrated": 2,
    "text": 3,
    "authors' simulator": 5,
}
"""Looks of what the reproduction compares: recordings, published numbers and presets. Never change them."""

WORDS: Final = {"no feedback": "none", "positive feedback": "positive", "soft feedback": "soft"}
"""Other names of strategies in pictures."""


def strategy_in(name: str) -> str | None:
    """Return the strategy to which a series belongs by its name; None if to none."""
    known = strategies.known()
    for part in re.split(r"[,()]", name):
        part = WORDS.get(part.strip(), part.strip())
        if part in known:
            return part
        first, _, rest = part.partition(" ")
        if rest and WORDS.get(first, first) in known:
            return WORDS.get(first, first)
    return None


def looks_of(names: Sequence[str]) -> list[Look]:
    """Return the look of each series; no two are alike in marker and colour.

    Args:
        names: of the series, each once, in the order in which they are drawn.
    """
    of = [strategy_in(name) for name in names]
    if not any(of):
        places = [SOURCES[name] for name in names if name in SOURCES]
        fixed = len(set(places)) == len(names)
        return [look(place) for place in (places if fixed else range(len(names)))]
    used = {_place(strategy)[0] for strategy in of if strategy}
    free = [k for k in range(len(SERIES)) if k not in used] or list(range(len(SERIES)))
    found: list[Look] = []
    taken: set[tuple[int, int]] = set()
    for index, strategy in enumerate(of):
        others = index - sum(map(bool, of[:index]))  # series before it that are of no strategy
        colour, marker = _place(strategy) if strategy else (free[others % len(free)], others % len(MARKERS))
        if not strategy:
            marker = max(colour, marker)
        while (colour, marker) in taken:  # the same strategy again: its colour, the next marker
            marker = (marker + 1) % len(MARKERS)
            colour = colour if marker else (colour + 1) % len(SERIES)
        taken.add((colour, marker))
        found.append(_look(colour, marker, again=of[:index].count(strategy) if strategy else 0))
    return found


def row_looks(names: Sequence[str]) -> dict[str, Look]:
    """Return the looks of rows that are named after strategies; empty if none are, or if there are too many rows."""
    if len(names) > len(MARKERS) or not any(map(strategy_in, names)):
        return {}
    return dict(zip(names, looks_of(names), strict=True))


def _place(strategy: str) -> tuple[int, int]:
    """Return the indices of a strategy's colour and marker; those of one that is not built in follow from its name."""
    if strategy in BUILT_IN:
        return BUILT_IN[strategy]
    used = set(BUILT_IN.values())
    free = [(c, m) for m in range(len(MARKERS)) for c in range(len(SERIES)) if (c, m) not in used]
    return free[zlib.crc32(strategy.encode()) % len(free)]


def _look(colour: int, marker: int, again: int) -> Look:
    """Return a look; later series of one strategy differ in marker, line and hatch."""
    return Look(
        colour=SERIES[colour],
        marker=MARKERS[marker],
        line=LINES[(colour + again) % len(LINES)],
        hatch=HATCHES[marker],
        hollow=marker >= len(SERIES) or marker != colour,
    )
