"""Colours, markers and sizes of pictures.

Colours can be distinguished in grey print and by colour-blind readers. Every series also has a marker and a hatch of
its own. The look of a series is its colour, marker, line and hatch.

Every colour of a picture has a name. ``themed_svg`` in ``picture.py`` writes it as a CSS variable with the
colour as fallback, so that a page can show the same picture in dark colours.

The colours of series lie at CIE L* 17, 30, 43, 55, 66 and 76. Their hues were chosen by search so that the smallest
distance (CIE 1976) between any two is as large as possible, also as seen with protanopia and deuteranopia
(Machado, Oliveira and Fernandes 2009, severity 1). A test measures both.

Each strategy has the same colour and marker in all pictures, whatever is drawn beside it. A series belongs to a
strategy if a part of its name is the name of the strategy: ``soft``, ``random:0.48, soft``, ``soft (gate own)``.
Strategies of users get a pair of colour and marker that no built-in strategy has, by a hash of their name. The sources
that a reproduction of the paper compares have fixed looks. All other series get looks in their order.

There are three sizes: for a journal's column, for a page of two columns, and for a slide.

Pictures are Figure objects; pyplot is never used. matplotlib has one set of settings for the whole process. They are
changed only under a lock and restored afterwards, so that pictures may be drawn from any thread.
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
"""Largest number of series in a picture: each has a marker of its own."""


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
    """Return the look of a series by its index, 0 to 11.

    Each index has a marker and a hatch of its own. Colours and lines are repeated from 6 on.
    """
    return _look(index % len(SERIES), index)


@dataclass(frozen=True)
class Style:
    """Sizes of a picture: its width and height in inches, its type and lines in points."""

    name: str
    width_in: float
    height_in: float
    """Height of a picture with two numeric axes. A picture with a row for each cell grows, except on a slide."""
    font_pt: float
    """Font size of labels and titles."""
    small_pt: float
    """Font size of ticks, legends and names of rows."""
    line_pt: float
    """Width of lines."""
    marker_pt: float
    """Size of markers."""
    row_in: float
    """Preferred height of one row."""
    least_row_in: float
    """Least height of one row."""
    tallest_in: float
    """Greatest height of a picture. Rows shrink to keep it; once they have their least height, it is exceeded."""
    dots_per_inch: int

    @property
    def fixed_height(self) -> bool:
        """Whether pictures keep ``height_in`` as long as their rows, at their least height, fit; true of a slide."""
        return self.tallest_in == self.height_in


STYLES: Final = {
    "column": Style(
        name="column", width_in=3.5, height_in=2.5, font_pt=8, small_pt=7, line_pt=1.1, marker_pt=3.6,
        row_in=0.22, least_row_in=0.115, tallest_in=9.0, dots_per_inch=300,
    ),
    "page": Style(
        name="page", width_in=7.2, height_in=3.8, font_pt=9, small_pt=8, line_pt=1.2, marker_pt=4.5,
        row_in=0.24, least_row_in=0.125, tallest_in=9.4, dots_per_inch=300,
    ),
    "slide": Style(
        name="slide", width_in=13.333, height_in=7.5, font_pt=20, small_pt=16, line_pt=2.6, marker_pt=10,
        row_in=0.55, least_row_in=0.2, tallest_in=7.5, dots_per_inch=150,
    ),
}  # fmt: skip
"""``column`` is 89 mm wide with type of 8 pt, ``page`` 183 mm with 9 pt, ``slide`` is 16:9 with 20 pt."""

MATPLOTLIB_LOCK: Final = threading.RLock()
"""Held by a thread that draws or saves, since matplotlib has one set of settings for the whole process."""


def style_named(name: str) -> Style:
    """Return the style of this name: "column", "page" or "slide".

    Raises:
        InputError: there is no such style.
    """
    check_choice(name, "style", STYLES)
    return STYLES[name]


@contextmanager
def settings(style: Style | None = None) -> Iterator[None]:
    """Use matplotlib's own defaults with the changes of a style (by default "page") until the end of the block.

    The block holds ``MATPLOTLIB_LOCK``, so that other threads that draw wait. Warnings about letters that the font does
    not have are suppressed: in SVG and HTML, the program of the reader shows these letters in a font of its own.
    """
    from matplotlib import style as styles

    with MATPLOTLIB_LOCK, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"Glyph \d+")
        with styles.context(["default", _matplotlib_settings(style or STYLES["page"])]):
            yield


def _matplotlib_settings(style: Style) -> dict[str, Any]:
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

WORDS: Final = {"no feedback": "none", "positive feedback": "positive", "soft feedback": "soft"}
"""Other names of strategies in pictures."""


def strategy_in(name: str) -> str | None:
    """Return the strategy that the name of a series contains, or None.

    The name is divided into parts at commas and parentheses. A part names a strategy if it is the name of a strategy,
    or begins with it and continues with other words after a space. The other names of strategies in ``WORDS`` count as
    well. The first strategy found is returned.
    """
    known = strategies.known()
    for part in re.split(r"[,()]", name):
        words = part.strip().split(" ")
        for count in range(len(words), 0, -1):  # the whole part, then ever fewer of its first words
            beginning = " ".join(words[:count])
            strategy = WORDS.get(beginning, beginning)
            if strategy in known:
                return strategy
    return None


def looks_of(names: Sequence[str]) -> list[Look]:
    """Return the look of each series; no two have the same pair of marker and colour.

    Three cases: (1) Some names contain strategies. The series of a strategy has the look of this strategy; but if an
    earlier series has its marker and colour already, such as one of the same strategy, it has another marker and maybe
    another colour. The other series have colours that none of these strategies has, if such colours exist. (2) No name
    contains a strategy, and all are names of ``SOURCES`` with different indices: they have the looks of the sources.
    (3) Otherwise the k-th series has the look k.

    Args:
        names: of the series, each once, in the order in which they are drawn; at most ``SERIES_UP_TO``, as
            ``inputs.with_series`` and ``row_looks`` check.
    """
    strategy_of = [strategy_in(name) for name in names]
    if not any(strategy_of):
        fixed = [SOURCES[name] for name in names if name in SOURCES]
        all_fixed = len(set(fixed)) == len(names)
        return [look(index) for index in (fixed if all_fixed else range(len(names)))]
    used = {_colour_and_marker(strategy)[0] for strategy in strategy_of if strategy}
    free = [k for k in range(len(SERIES)) if k not in used] or list(range(len(SERIES)))
    looks: list[Look] = []
    taken: set[tuple[int, int]] = set()
    for index, strategy in enumerate(strategy_of):
        if strategy:
            colour, marker = _colour_and_marker(strategy)
        else:
            others = strategy_of[:index].count(None)  # number of earlier series without a strategy
            colour = free[others % len(free)]
            # The marker has the index of the colour, so that it is filled; or the number of earlier series if that is
            # larger, so that repeated colours have other markers.
            marker = max(colour, others % len(MARKERS))
        # If an earlier series has this pair, such as one of the same strategy, the next marker is taken. After the last
        # marker, the colour changes as well.
        while (colour, marker) in taken:
            marker = (marker + 1) % len(MARKERS)
            colour = colour if marker else (colour + 1) % len(SERIES)
        taken.add((colour, marker))
        looks.append(_look(colour, marker, again=strategy_of[:index].count(strategy) if strategy else 0))
    return looks


def row_looks(names: Sequence[str]) -> dict[str, Look]:
    """Return the looks of rows by name, if rows are named after strategies.

    The result is empty if no name contains a strategy, or if there are more rows than markers.
    """
    if len(names) > len(MARKERS) or not any(map(strategy_in, names)):
        return {}
    return dict(zip(names, looks_of(names), strict=True))


def _colour_and_marker(strategy: str) -> tuple[int, int]:
    """Return the indices of a strategy's colour and marker; a user's gets a pair that no built-in strategy has.

    A hash of its name chooses the pair, so that it is the same in all pictures.
    """
    if strategy in BUILT_IN:
        return BUILT_IN[strategy]
    used = set(BUILT_IN.values())
    free = [(c, m) for m in range(len(MARKERS)) for c in range(len(SERIES)) if (c, m) not in used]
    return free[zlib.crc32(strategy.encode()) % len(free)]


def _look(colour: int, marker: int, again: int = 0) -> Look:
    """Return the look with these indices of colour and marker; the hatch has the index of the marker.

    ``again`` is the number of earlier series of the same strategy; the line differs from theirs. A marker is filled if
    its index is that of the colour, as for the first series in ``look``; all other markers are open.
    """
    return Look(
        colour=SERIES[colour],
        marker=MARKERS[marker],
        line=LINES[(colour + again) % len(LINES)],
        hatch=HATCHES[marker],
        hollow=marker != colour,
    )
