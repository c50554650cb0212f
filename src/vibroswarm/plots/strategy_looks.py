"""One colour and marker for each strategy in all pictures, whichever others are drawn beside it.

A series belongs to a strategy if a part of its name is the strategy's: ``soft``, ``random:0.48, soft``,
``soft (gate own)``. Strategies of users get one of the free pairs by a hash of their name. Sources of a reproduction
have looks of their own; other series are drawn in order.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from typing import Final

from vibroswarm import strategies
from vibroswarm.plots.style import HATCHES, LINES, MARKERS, SERIES, Look, look

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
    """Return the colour and marker of a strategy."""
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
