"""Values of many runs, by cell and series, with those that never came to one: what box and violin share.

A run without a value is undecided. Where the end of the runs is known, an undecided run counts as later than
that: a quantile is exact as long as it falls among the decided ones, and else it is later than the end too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.plots.canvas import Rows, hatched, legend_below, legend_lines, rows_of
from vibroswarm.plots.frames import tidy, with_series
from vibroswarm.plots.palette import BAND, FAINT, PAPER, look
from vibroswarm.plots.style import Style
from vibroswarm.plots.words import fitted, number, of_runs, share, width_pt

BAND_SHARE = 0.07
"""Breadth of the band behind the end of the runs, of the axis before it."""


class Group(NamedTuple):
    """The runs of one cell and series; ``values`` are those decided, sorted."""

    cell: str
    series: str
    row: int
    series_index: int
    values: NDArray[np.float64]
    runs: int

    @property
    def undecided(self) -> int:
        """Runs without a value."""
        return self.runs - self.values.size


class Plane(NamedTuple):
    """Rows with the band of the undecided at the right, if the end is known."""

    rows: Rows
    groups: list[Group]
    series: list[str]
    end: float | None
    in_band: float
    """Where on the axis stands what is later than the end."""

    def place(self, group: Group) -> float:
        """y of a group."""
        return self.rows.place(group.row, group.series_index, len(self.series))

    def at(self, value: float | None) -> float:
        """x of a quantile; None is later than the end."""
        return self.in_band if value is None else value


def quantile(group: Group, q: float, *, censored: bool) -> float | None:
    """Quantile of a group's runs, linear between neighbours; None if it falls among the undecided (or on nothing).

    Args:
        group: the runs.
        q: 0 to 1.
        censored: whether undecided runs count as later than all others, or not at all.
    """
    size = group.runs if censored else group.values.size
    if size == 0:
        return None
    place = q * (size - 1)
    low, high = math.floor(place), math.ceil(place)
    if high >= group.values.size:
        return None
    return float(group.values[low] + (place - low) * (group.values[high] - group.values[low]))


def plane_of(
    style: Style, frame: pl.DataFrame, label: str, t_end: float | None, missing: str, title: str
) -> Plane:
    """Rows, groups and the band, for a frame of cell, series and value.

    Raises:
        InputError: the frame is not as asked, or a value lies behind ``t_end``.
    """
    frame, series = with_series(tidy(frame, numbers=("value",), texts=("cell",)))
    groups = _groups(frame, series)
    latest = max((group.values[-1] for group in groups if group.values.size), default=None)
    if t_end is not None and latest is not None and latest > t_end:
        raise InputError(f"holds {latest:g}, later than the end at {t_end:g}", field="value")
    cells = frame["cell"].unique(maintain_order=True).to_list()
    named = series if len(series) > 1 else []
    rows = rows_of(
        style, cells, label, series=len(series), title=title, furniture=legend_lines(style, named) + 1
    )
    plane = Plane(rows, groups, series, t_end, 0.0 if t_end is None else t_end)
    plane = plane._replace(in_band=_limits(plane, style))
    _write_shares(plane, missing)
    return plane


def _groups(frame: pl.DataFrame, series: Sequence[str]) -> list[Group]:
    row_of = {cell: row for row, cell in enumerate(frame["cell"].unique(maintain_order=True))}
    groups = []
    for (cell, name), part in frame.group_by("cell", "series", maintain_order=True):
        values = np.sort(part["value"].drop_nulls().to_numpy())
        groups.append(Group(str(cell), str(name), row_of[cell], series.index(str(name)), values, part.height))
    return sorted(groups, key=lambda group: (group.row, group.series_index))


def _limits(plane: Plane, style: Style) -> float:
    values = np.concatenate([group.values for group in plane.groups])
    axes = plane.rows.axes
    low = float(values.min()) if values.size else 0.0
    high = plane.end if plane.end is not None else (float(values.max()) if values.size else 1.0)
    if 0 <= low <= 0.5 * high:
        low = 0.0
    span = (high - low) or abs(high) or 1.0
    left = low - (0.02 if low == 0 else 0.04) * span
    if plane.end is None:
        axes.set_xlim(left, high + 0.04 * span)
        return high
    band = BAND_SHARE * span
    axes.axvspan(high, high + band, color=BAND, linewidth=0, zorder=0)
    axes.axvline(high, color=FAINT, linewidth=axes.spines["bottom"].get_linewidth(), zorder=0.5)
    axes.set_xlim(left, high + band)
    room = 2.2 * width_pt(number(high, 4), style.small_pt) / (style.width_in * 72) * span
    ticks = [tick for tick in axes.get_xticks() if left <= tick <= high - room]
    axes.set_xticks([*ticks, high], labels=[number(tick, 4) for tick in [*ticks, high]])
    return high + band / 2


def _write_shares(plane: Plane, missing: str) -> None:
    if not any(group.undecided for group in plane.groups):
        return
    for group in plane.groups:
        plane.rows.note(plane.place(group), share(group.undecided, group.runs))
    axes, size = plane.rows.axes, plane.rows.font_pt
    axes.annotate(
        fitted(missing, size, plane.rows.figure.get_figwidth() * 72 * 0.2, 2), (1, 1),
        xycoords="axes fraction", xytext=(size * 0.5, 1), textcoords="offset points", va="bottom", ha="left",
        fontsize=size, color=FAINT, annotation_clip=False,
    )  # fmt: skip


def series_legend(plane: Plane, style: Style, *, marks: bool = False) -> None:
    """Name the series below, by their hatches, or by their marks where only runs are drawn."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if len(plane.series) < 2:
        return
    looks = [look(index) for index in range(len(plane.series))]
    handles: list[Any] = [
        Line2D([], [], ls="", marker=one.marker, markeredgecolor=one.colour, markerfacecolor="none")
        if marks
        else Patch(
            facecolor=PAPER, edgecolor=one.colour, hatch=hatched(style, one.hatch), linewidth=style.line_pt
        )
        for one in looks
    ]
    legend_below(plane.rows.figure, style, handles, plane.series)


def group_caption(plane: Plane, missing: str) -> str:
    """Of how many runs, and how those without a value are shown."""
    counts = of_runs([group.runs for group in plane.groups])
    total, lost = sum(group.runs for group in plane.groups), sum(group.undecided for group in plane.groups)
    if not lost:
        return f"{counts}, none {missing}."
    tail = (
        f"they count as later than the end at {number(plane.end, 6)} (shaded)"
        if plane.end is not None
        else "they are not in the drawing"
    )
    return f"{counts}; {lost} of {total} are {missing}: {tail}, and their share stands at the right."
