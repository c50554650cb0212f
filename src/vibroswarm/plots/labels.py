"""Labels of pictures: what fields of a scenario are called, in words with symbol and unit, never by names in files;
names at the ends of curves instead of a legend; and labels beside points, where they hide the fewest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import polars as pl
from numpy.typing import NDArray

from vibroswarm.plots.layout import plain, width_pt
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
        named = f"{self.words} {self.symbol}".strip()
        return f"{named} ({self.unit})" if self.unit else named

    @property
    def short(self) -> str:
        """The symbol, or the words."""
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
"""Of the fields to which the paper gives a symbol, see ``scenario.fields``."""
UNITS: Final = {
    "_ms": "ms",
    "_mm": "mm",
    "_m_s": "m/s",
    "_m": "m",
    "_s": "s",
    "_rad": "rad",
    "_deg": "degrees",
}


def label_of(field: str) -> Label:
    """Return the label of a field; those without symbol are called by the words in their names.

    Args:
        field: ``walk.avoidance_threshold_mm``.
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
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{label_of(field).short} {text}"


MOST_NAMES: Final = 8
WIDEST_NAMES: Final = 0.22
"""Most of the picture's width that names may take."""
FARTHEST: Final = 1.3
"""Farthest that a name stands from the end of its curve, in lines of text."""


def label_ends(
    figure: Figure,
    axes: Axes,
    style: Style,
    names: Sequence[str],
    looks: Sequence[Look],
    ends: Sequence[float],
) -> bool:
    """Write each name, behind its mark, right of the axes at the height at which its curve ends.

    Call it when the axes have their limits. Nothing is written where names do not fit: then a legend is needed.

    Args:
        ends: of the curves, in the unit of y. names, looks: of the curves.
    Returns: whether they were written.
    """
    size = style.small_pt
    wide_pt = max((width_pt(plain(name), size) for name in names), default=0.0) + 2.2 * size
    if not 1 < len(names) <= MOST_NAMES or wide_pt > WIDEST_NAMES * style.width_in * 72:
        return False
    figure.draw_without_rendering()
    box = axes.get_window_extent()
    to_pt = 72 / figure.dpi
    at = [float(axes.transData.transform((0.0, end))[1]) * to_pt for end in ends]
    placed = spread(at, size * 1.15)
    low, high = box.y0 * to_pt - size, box.y1 * to_pt + size
    if any(abs(a - b) > FARTHEST * size for a, b in zip(at, placed, strict=True)):
        return False
    if not all(low <= place <= high for place in placed):
        return False
    for name, look, place in zip(names, looks, placed, strict=True):
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
    """Move places apart until neighbours are ``gap`` away from each other; each group keeps its mean.

    Args:
        places: in any order, kept in the result.
    """
    order = sorted(range(len(places)), key=lambda k: places[k])
    groups: list[tuple[float, int]] = []  # mean of the places wanted, and how many share it
    for k in order:
        groups.append((places[k], 1))
        while len(groups) > 1:
            (below, m), (above, n) = groups[-2:]
            if above - below >= gap * (m + n) / 2:
                break
            groups[-2:] = [((below * m + above * n) / (m + n), m + n)]
    moved = [mean + gap * (j - (n - 1) / 2) for mean, n in groups for j in range(n)]
    found = [0.0] * len(places)
    for k, place in zip(order, moved, strict=True):
        found[k] = place
    return found


WIDEST_LABEL: Final = 0.34
"""Widest label, relative to the axes."""
HIDES: Final = 30
"""Cost of hiding another label; that of hiding a point is 1."""


def label_points(
    figure: Any,
    axes: Any,
    style: Style,
    labels: Sequence[tuple[float, float, str]],
    known: pl.DataFrame,
    *,
    always: bool,
) -> bool:
    """Write each label near its point.

    Args:
        labels: x, y and text of each. known: all points, ``time`` and ``error``.
        always: whether they are written even if they do not fit.
    Returns: whether they were written.
    """
    figure.draw_without_rendering()
    to_pt = 72 / figure.dpi
    marks = axes.transData.transform(known.select("time", "error").to_numpy()) * to_pt
    box = axes.get_window_extent()
    inside = (box.x0 * to_pt, box.y0 * to_pt, box.x1 * to_pt, box.y1 * to_pt)
    size, gap = style.small_pt, style.marker_pt * 0.9 + 1
    if not always and any(
        width_pt(plain(text), size) > WIDEST_LABEL * box.width * to_pt for _, _, text in labels
    ):
        return False
    placed: list[tuple[float, float, float, float]] = []
    offsets = []
    for at_x, at_y, text in labels:
        x, y = axes.transData.transform((at_x, at_y)) * to_pt
        spots = _spots(x, y, width_pt(plain(text), size), size * 0.75, gap)
        costs = [_cost(spot, placed, marks, inside, gap) for spot in spots]
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


def _spots(
    x: float, y: float, wide: float, high: float, gap: float
) -> list[tuple[float, float, float, float]]:
    """Return places for a label about a point, the best first: left, bottom, right, top."""
    spots = []
    for reach in (1.0, 1.8, 2.8, 4.0):
        for right, up in ((1, 1), (-1, -1), (1, -1), (-1, 1), (0, 1), (0, -1), (1, 0), (-1, 0)):
            left = x + right * gap * reach - wide * (1 - right) / 2
            bottom = y + up * gap * reach - high * (1 - up) / 2
            spots.append((left, bottom, left + wide, bottom + high))
    return spots


def _cost(
    spot: tuple[float, float, float, float],
    placed: list[tuple[float, float, float, float]],
    marks: NDArray[Any],
    inside: tuple[float, float, float, float],
    gap: float,
) -> float:
    """Return the cost of a place for a label, for overlap with other labels, marks and the border; 0 is best."""
    left, bottom, right, top = spot
    out = left < inside[0] or bottom < inside[1] or right > inside[2] or top > inside[3] + gap
    covered = sum(
        left < other[2] + 1 and other[0] < right + 1 and bottom < other[3] + 1 and other[1] < top + 1
        for other in placed
    )
    reach = gap * 0.6
    hidden = (
        (marks[:, 0] > left - reach) & (marks[:, 0] < right + reach)
        & (marks[:, 1] > bottom - reach) & (marks[:, 1] < top + reach)
    )  # fmt: skip
    return 100 * out + HIDES * covered + float(hidden.sum())
