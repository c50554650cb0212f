"""Colours that are told apart in grey print and by the colour-blind, and the marks that say the same in shape.

Every colour of a picture has a name. ``themed_svg`` in ``picture.py`` writes it as a CSS variable with the
colour as fallback, so that a page can show the same picture in dark colours.

The series' colours lie at CIE L* 17, 30, 43, 55, 66 and 76; hues were chosen by search so that the smallest
distance (CIE 1976) between any two is as large as can be, also as seen with protanopia and deuteranopia
(Machado, Oliveira and Fernandes 2009, severity 1). A test measures both.
"""

from __future__ import annotations

from typing import Final, NamedTuple

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
    "agreed": "#58b7ad",
}
"""Colour of each outcome of a run, and its order in a bar."""

OUTCOME_HATCHES: Final = {"right": "", "wrong": "///", "split": "xxx", "incomplete": "...", "agreed": "\\\\"}

NAMES: Final[dict[str, str]] = {
    "ink": INK,
    "faint": FAINT,
    "line": LINE,
    "paper": PAPER,
    "band": BAND,
    **{f"series-{index}": colour for index, colour in enumerate(SERIES)},
    **OUTCOMES,
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
    """The look of series ``index`` (0 to 11); each differs from all others in marker and in hatch."""
    return Look(
        colour=SERIES[index % len(SERIES)],
        marker=MARKERS[index],
        line=LINES[index % len(LINES)],
        hatch=HATCHES[index],
        hollow=index >= len(SERIES),
    )
