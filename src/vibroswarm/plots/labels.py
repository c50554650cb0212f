"""Labels of pictures.

Fields of a scenario are named by words with symbol and unit, never by their names in files. Names of curves stand at
the ends of the curves if they fit, instead of a legend. Names of points stand beside the points, where they hide as few
other points as possible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.plots.layout import lay_out, number, plain, width_pt
from vibroswarm.plots.style import INK, PAPER, Look, Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class Label(NamedTuple):
    """A field's words, symbol (empty: none) and unit (empty: none)."""

    words: str
    symbol: str = ""
    unit: str = ""

    @property
    def text(self) -> str:
        """Words, symbol and unit: ``sample interval τ (ms)``."""
        return f"{self.named} ({self.unit})" if self.unit else self.named

    @property
    def named(self) -> str:
        """Words and symbol: ``sample interval τ``."""
        return f"{self.words} {self.symbol}".strip()

    def of(self, value: str) -> str:
        """A value in words: ``sample interval τ 4750 ms``."""
        return f"{self.named} {value} {self.unit}".strip()

    @property
    def short(self) -> str:
        """The symbol, or the words if there is no symbol."""
        return self.symbol or self.words


SYMBOLS: Final = {
    "walk.walk_duration_location_ms": Label("walk duration, location", "γ₀", "ms"),
    "walk.walk_duration_scale_ms": Label("walk duration, scale", "γ", "ms"),
    "walk.avoidance_threshold_mm": Label("avoidance threshold", "θ_c", "mm"),
    "sample.sample_interval_ms": Label("sample interval", "τ", "ms"),
    "sensor.rms_threshold": Label("sensor threshold", "θ_E"),
    "decision.credible_threshold": Label("credible threshold", "p_c"),
    "decision.min_observations": Label("minimum of observations", "O_c"),
    "decision.decision_boundary": Label("decision boundary"),
    "strategy.soft.eta": Label("feedback", "η"),
    "strategy.soft.kappa": Label("feedback", "κ"),
    "floor.source": Label("fill ratio"),
    "floor.fill_ratio": Label("fill ratio"),
    "swarm.robots": Label("robots"),
}
"""Labels of fields to which the paper gives a symbol (see ``scenario.fields``), and of some others. The label of
``floor.source`` is "fill ratio", since pictures of studies draw ``random:0.46, random:0.48, ...`` along an axis by
their fill ratios."""
UNITS: Final = {
    "_ms": "ms",
    "_mm": "mm",
    "_m_s": "m/s",
    "_m": "m",
    "_s": "s",
    "_rad": "rad",
    "_deg": "degrees",
}
"""Unit of each suffix of a field's name. The first suffix that fits counts, so ``_m_s`` stands before ``_s``."""


def label_of(field: str) -> Label:
    """Return the label of a field, given by its full name such as ``walk.avoidance_threshold_mm``.

    A field that is not in ``SYMBOLS`` gets the words of its name, and the unit of its suffix.
    """
    if field in SYMBOLS:
        return SYMBOLS[field]
    name = field.rpartition(".")[2]
    for suffix, unit in UNITS.items():
        if name.endswith(suffix):
            return Label(name.removesuffix(suffix).replace("_", " "), "", unit)
    return Label(name.replace("_", " "))


def setting_words(field: str, value: object) -> str:
    """Write a value of a field for a label: ``γ₀ 4000``, ``κ 2``."""
    text = number(value, 4) if isinstance(value, float) else str(value)
    return f"{label_of(field).short} {text}"


MOST_NAMES: Final = 8
"""Most names at the ends of curves."""
WIDEST_NAMES: Final = 0.22
"""Greatest share of the picture's width for these names."""
FARTHEST: Final = 1.3
"""Greatest distance of a name from the height of the end of its curve, in units of the font size."""


def label_ends(
    figure: Figure,
    axes: Axes,
    style: Style,
    names: Sequence[str],
    looks: Sequence[Look],
    ends: Sequence[float],
) -> bool:
    """Write each name, after the marker of its curve, right of the axes at the height at which the curve ends.

    Call it when the axes have their final limits, from which the heights are computed. Nothing is written if there are
    fewer than two names or more than ``MOST_NAMES``, if one is too wide, or if they cannot all stand near their ends.

    Args:
        names, looks: of the curves. ends: y of the ends of the curves, in the unit of the axis.
    Returns:
        Whether the names were written; if not, a legend is needed.
    """
    size = style.small_pt
    # width of the longest name, with its marker and space around both
    wide_pt = max((width_pt(plain(name), size) for name in names), default=0.0) + 2.2 * size
    if not 1 < len(names) <= MOST_NAMES or wide_pt > WIDEST_NAMES * style.width_in * 72:
        return False
    lay_out(figure)
    box = axes.get_window_extent()
    to_pt = 72 / figure.dpi  # pixels to points
    ends_pt = [float(axes.transData.transform((0.0, end))[1]) * to_pt for end in ends]  # from the lower edge
    placed = spread(ends_pt, gap=size * 1.15)
    low, high = box.y0 * to_pt - size, box.y1 * to_pt + size  # names may stand this far outside the axes
    is_far = any(abs(end - place) > FARTHEST * size for end, place in zip(ends_pt, placed, strict=True))
    if is_far or not all(low <= place <= high for place in placed):
        return False
    for name, look, place in zip(names, looks, placed, strict=True):
        # The marker stands 1.1, the name 1.9 font sizes right of the axes. x and y are fractions of the axes.
        y = (place - box.y0 * to_pt) / (box.height * to_pt)
        axes.annotate(
            plain(name), (1, y), xycoords="axes fraction", xytext=(1.9 * size, 0), textcoords="offset points",
            va="center", ha="left", fontsize=size, color=INK, annotation_clip=False,
        )  # fmt: skip
        x = 1 + 1.1 * size / (box.width * to_pt)
        axes.plot(
            [x], [y], transform=axes.transAxes, clip_on=False, ls="", marker=look.marker, color=look.colour,
            markerfacecolor=PAPER if look.hollow else look.colour, markersize=style.marker_pt,
        )  # fmt: skip
    return True


def spread(places: Sequence[float], gap: float) -> list[float]:
    """Move places along a line apart until neighbours are at least ``gap`` away from each other.

    Places that are too close form a group. The places of a group get the distance ``gap`` from each other, and keep
    their mean.

    Args:
        places: in any order. gap: least distance.
    Returns:
        The new places, in the order of ``places``.
    """
    order = sorted(range(len(places)), key=lambda k: places[k])
    groups: list[tuple[float, int]] = []  # (mean of the original places, number of places), from the lowest
    for k in order:
        # Each place begins as a group of its own. As long as it overlaps the group below, both are joined.
        groups.append((places[k], 1))
        while len(groups) > 1:
            (below, m), (above, n) = groups[-2:]
            if above - below >= gap * (m + n) / 2:  # a group of n places takes gap * n
                break
            groups[-2:] = [((below * m + above * n) / (m + n), m + n)]
    moved = [mean + gap * (j - (n - 1) / 2) for mean, n in groups for j in range(n)]
    found = [0.0] * len(places)
    for k, place in zip(order, moved, strict=True):
        found[k] = place
    return found


WIDEST_LABEL: Final = 0.34
"""Greatest width of a label, relative to the axes."""
HIDES: Final = 30
"""Cost of hiding another label; the cost of hiding a point is 1."""
CLEARLY: Final = 2.0
"""A label is clearly its point's if all other points are this many times as far away."""
Box = tuple[float, float, float, float]
"""Left, bottom, right and top of a rectangle, in points."""


def label_points(
    figure: Any,
    axes: Any,
    style: Style,
    labels: Sequence[tuple[float, float, str]],
    known: pl.DataFrame,
    *,
    always: bool,
) -> bool:
    """Write each label beside its point, inside the axes and where it hides the fewest points and earlier labels.

    A label that is nearly as close to another point as to its own costs as much as one that hides a point: it might be
    read as that point's name.

    Args:
        labels: (x, y, text) of each label, x and y being those of its point.
        known: all points that are drawn, with the columns ``time`` (x) and ``error`` (y).
        always: whether all labels are written even if a label is too wide, leaves the axes, or hides a point or another
            label. If not, no label is written in such a case.
    Returns:
        Whether the labels were written.
    """
    lay_out(figure)
    to_pt = 72 / figure.dpi  # pixels to points
    # ``marks``: positions of the points that are drawn. All positions below are in units of 1/72 inch, from the lower
    # left corner of the figure.
    marks = axes.transData.transform(known.select("time", "error").to_numpy()) * to_pt
    box = axes.get_window_extent()
    inside = (box.x0 * to_pt, box.y0 * to_pt, box.x1 * to_pt, box.y1 * to_pt)
    # the gap between a point and its label is larger than half a marker, so that the marker stays visible
    size, gap = style.small_pt, style.marker_pt * 0.9 + 1
    if not always and any(
        width_pt(plain(text), size) > WIDEST_LABEL * box.width * to_pt for _, _, text in labels
    ):
        return False
    placed: list[Box] = []
    offsets = []
    for at_x, at_y, text in labels:
        x, y = axes.transData.transform((at_x, at_y)) * to_pt
        # letters are about 0.75 of the font size high
        spots = _spots(x, y, wide=width_pt(plain(text), size), high=size * 0.75, gap=gap)
        costs = [_cost(spot, placed, marks, (x, y), inside, gap) for spot in spots]
        # the index of the cheapest place; of places of equal cost, the first is preferred
        best = min(range(len(spots)), key=lambda spot: (costs[spot], spot))
        if not always and costs[best] >= 1:  # it would hide a point, or another label
            return False
        placed.append(spots[best])
        offsets.append((spots[best][0] - x, spots[best][1] - y))
    for (at_x, at_y, text), offset in zip(labels, offsets, strict=True):
        axes.annotate(
            plain(text), (at_x, at_y), xytext=offset, fontsize=size, textcoords="offset points", ha="left",
            va="bottom", color=INK, zorder=5,
            bbox={"facecolor": PAPER, "edgecolor": "none", "alpha": 0.75, "pad": 0.5},
        )  # fmt: skip
    return True


def _spots(x: float, y: float, wide: float, high: float, gap: float) -> list[Box]:
    """Return places for a label around a point as (left, bottom, right, top), the preferred ones first.

    Places close to the point are preferred, and at each distance the one at the upper right.

    Args:
        x, y: the point. wide, high: size of the label. gap: distance of the closest places. All in points (1/72 inch).
    """
    spots = []
    for reach in (1.0, 1.8, 2.8, 4.0):  # distance in units of gap
        # right: 1 right of the point, -1 left of it, 0 centred; up: likewise above, below, centred. Steps of a front
        # lead right from a point and upwards, so places there come last.
        for right, up in ((1, 1), (-1, -1), (-1, 0), (1, -1), (0, -1), (-1, 1), (0, 1), (1, 0)):
            left = x + right * gap * reach - wide * (1 - right) / 2
            bottom = y + up * gap * reach - high * (1 - up) / 2
            spots.append((left, bottom, left + wide, bottom + high))
    return spots


def _cost(
    spot: Box,
    placed: list[Box],
    marks: NDArray[Any],
    own: tuple[float, float],
    inside: Box,
    gap: float,
) -> float:
    """Return the cost of a place for a label: 100 for leaving the axes, ``HIDES`` per hidden label, 1 per hidden point.

    It costs 1, too, if there are points to which the label is less than ``CLEARLY`` times as far as to its own.

    A label may extend above the axes by ``gap``, where there are no tick labels.

    All lengths are in points (1/72 inch); boxes are (left, bottom, right, top).

    Args:
        spot: the place. placed: places of the labels so far. marks: the points, (points, 2). own: the label's point.
        inside: box of the axes. gap: distance of a label from its own point. A point closer to the label than 0.6 of
            this counts as hidden.
    """
    left, bottom, right, top = spot
    out = left < inside[0] or bottom < inside[1] or right > inside[2] or top > inside[3] + gap
    covered = sum(  # number of labels that this one would overlap; labels are at least 1 point apart
        left < other[2] + 1 and other[0] < right + 1 and bottom < other[3] + 1 and other[1] < top + 1
        for other in placed
    )
    outside = np.maximum(
        [left, bottom] - marks, marks - [right, top]
    )  # (points, 2); negative: within the label
    away = np.hypot(*np.maximum(outside, 0.0).T)
    own_away = math.hypot(max(left - own[0], own[0] - right, 0.0), max(bottom - own[1], own[1] - top, 0.0))
    hidden = (outside < gap * 0.6).all(axis=1)
    unclear = ((away < CLEARLY * own_away) & ~(marks == own).all(axis=1)).any()
    return 100 * out + HIDES * covered + float(hidden.sum()) + float(unclear)
