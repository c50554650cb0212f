"""Names at the ends of curves instead of a legend, where they fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vibroswarm.plots.layout import plain, width_pt
from vibroswarm.plots.style import INK, PAPER, Look, Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST: int = 8
WIDEST: float = 0.22
"""Most of the picture's width that names may take."""
FARTHEST: float = 1.3
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
    if not 1 < len(names) <= MOST or wide_pt > WIDEST * style.width_in * 72:
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
