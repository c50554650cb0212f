"""Write labels beside points, where they hide the fewest points and other labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import polars as pl
from numpy.typing import NDArray

from vibroswarm.plots.layout import plain, width_pt
from vibroswarm.plots.style import INK, PAPER, Style

WIDEST = 0.34
"""Widest label, relative to the axes."""
HIDES = 30
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
    if not always and any(width_pt(plain(text), size) > WIDEST * box.width * to_pt for _, _, text in labels):
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
    """Score a place for a label: overlap with labels and marks, and with the border."""
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
