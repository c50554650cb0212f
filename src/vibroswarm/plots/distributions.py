"""Box pictures: the distribution of a value over the runs of each cell, including undecided runs.

The runs of one cell and series are a group. A run without a value is undecided. If the end of the runs is known, an
undecided run counts as later than the end. A quantile is then exact if it falls among the decided runs; if it falls
among the undecided ones, it is later than the end as well, and drawn in a shaded band right of the end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import verb
from vibroswarm.errors import InputError
from vibroswarm.plots.inputs import tidy, with_series
from vibroswarm.plots.layout import (
    Rows,
    crowded,
    hatched,
    lay_out,
    legend_below,
    number,
    of_runs,
    patch_handle,
    rows_of,
    share,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import BAND, FAINT, INK, PAPER, Look, Style, looks_of, row_looks, style_named

QUANTILES = {"q05": 0.05, "q25": 0.25, "median": 0.5, "q75": 0.75, "q95": 0.95}
"""Quantiles of a box, by the names of their columns."""
POINTS_BELOW = 5
"""Fewer runs than this are drawn one by one, without a box."""
BAND_SHARE = 0.07
"""Width of the band after the end of the runs, relative to the axis before it."""


class Group(NamedTuple):
    """The runs of one cell and series."""

    cell: str
    series: str
    y: float
    """Height at which it is drawn."""
    look: Look
    values: NDArray[np.float64]
    """Values of the decided runs, sorted."""
    runs: int
    """Number of runs, including undecided ones."""

    @property
    def undecided(self) -> int:
        """Number of runs without a value."""
        return self.runs - self.values.size


@drawn
def draw_boxes(
    frame: pl.DataFrame,
    *,
    label: str = "decision time (s)",
    t_end: float | None = None,
    missing: str = "undecided",
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw one box per cell and series: median, quartiles, and 5 % to 95 % of the runs.

    Args:
        frame: one row per run with the columns ``cell`` (text), ``value`` (number; null or NaN: undecided), and for
            several boxes in a cell ``series`` (text). Cells and series are drawn in order of appearance.
        label: of the axis, with its unit.
        t_end: end of the runs, in the unit of the axis. Undecided runs then count as later than ``t_end``, and
            quantiles that fall among them are drawn in the shaded band. If it is None, quantiles are those of the
            decided runs, and undecided runs are not drawn; only their share is written at the right.
        missing: word for runs without a value.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers have one row per box and one per run that is drawn by itself: ``cell, series, mark`` ("box"
        or "run"), ``runs, undecided``, the quantiles ``q05, q25, median, q75, q95`` of a box (null: later than t_end;
        or, without t_end, no run is decided) and the ``value`` of a run (null: undecided).

    Raises:
        InputError: the frame is not as described, or a value is later than ``t_end``.
    """
    sizes = style_named(style)
    frame, series = with_series(tidy(frame, numbers=("value",), texts=("cell",)))
    cells = frame["cell"].unique(maintain_order=True).to_list()
    looks = looks_of(series)
    rows = rows_of(sizes, cells, label, series=len(series), title=title)
    groups = _groups(frame, cells, series, looks, rows)
    latest = max((group.values[-1] for group in groups if group.values.size), default=None)
    if t_end is not None and latest is not None and latest > t_end:
        raise InputError(f"holds {latest:g}, later than the end at {t_end:g}", field="value")
    in_band = _limits(rows, groups, t_end)
    if any(group.undecided for group in groups):
        for group in groups:
            rows.note(group.y, share(group.undecided, group.runs))
        rows.heading(missing)
    numbers: list[dict[str, object]] = []
    for group in groups:
        is_single = group.runs < POINTS_BELOW
        numbers += _runs(rows, sizes, group, in_band) if is_single else [_box(rows, sizes, group, in_band)]
    # For each group, whether its runs are drawn one by one.
    single = [group.runs < POINTS_BELOW for group in groups]
    handles = _handles(sizes, looks, marks=all(single))
    legend_below(rows.figure, sizes, handles, series if len(series) > 1 else [])
    rows.settle(sizes)  # sets the height of the figure, now that all else is drawn
    boxes = "Line: median; box: 25 % to 75 %; whiskers: 5 % to 95 % of the runs. "
    marks = f"Fewer than {POINTS_BELOW} runs are drawn one by one. "
    counted = _counted(groups, t_end, missing)
    caption = f"{label}. {'' if all(single) else boxes}{marks if any(single) else ''}{counted}"
    return Picture(rows.figure, pl.DataFrame(numbers, schema=_SCHEMA), caption)


def _groups(
    frame: pl.DataFrame, cells: Sequence[str], series: Sequence[str], looks: Sequence[Look], rows: Rows
) -> list[Group]:
    """Split the runs into groups, sorted by cell, then by series.

    With one series, cells that are named after strategies have the looks of these.
    """
    of_rows = row_looks(cells) if len(series) == 1 else {}
    parts = frame.partition_by("cell", "series", as_dict=True)
    return [
        Group(
            cell,
            name,
            y=rows.place(row, index, len(series)),
            look=of_rows.get(cell, looks[index]),
            values=np.sort(parts[cell, name]["value"].drop_nulls().to_numpy()),
            runs=parts[cell, name].height,
        )
        for (row, cell), (index, name) in product(enumerate(cells), enumerate(series))
        if (cell, name) in parts
    ]


def _limits(rows: Rows, groups: Sequence[Group], end: float | None) -> float | None:
    """Set the limits and ticks of the axis, and draw the band for undecided runs if the end of the runs is known.

    Returns:
        x of the middle of the band, where values later than the end are drawn; None if the end is unknown.
    """
    values = np.concatenate([group.values for group in groups])
    axes = rows.axes
    low = float(values.min()) if values.size else 0.0
    high = end if end is not None else (float(values.max()) if values.size else 1.0)
    if 0 <= low <= 0.5 * high:  # the axis starts at 0 unless all values are far from it
        low = 0.0
    span = (high - low) or abs(high) or 1.0  # above 0, also if all values are equal
    left = low - (0.02 if low == 0 else 0.04) * span  # a margin, so that no mark lies on the edge
    if end is None:
        axes.set_xlim(left, high + 0.04 * span)
        return None
    band = BAND_SHARE * span
    axes.axvspan(high, high + band, color=BAND, linewidth=0, zorder=0)
    axes.axvline(high, color=FAINT, linewidth=axes.spines["bottom"].get_linewidth(), zorder=0.5)
    axes.set_xlim(left, high + band)
    # The end gets a tick. The last of the other ticks are left out where labels would overlap.
    ticks = [tick for tick in axes.get_xticks() if left <= tick < high]
    axes.set_xticks([*ticks, high], labels=[number(tick, 4) for tick in [*ticks, high]])
    lay_out(rows.figure)
    while ticks and crowded(axes.xaxis):
        ticks.pop()
        axes.set_xticks([*ticks, high], labels=[number(tick, 4) for tick in [*ticks, high]])
    return high + band / 2


def _handles(style: Style, looks: Sequence[Look], *, marks: bool) -> list[Any]:
    """Return the entries of the series for a legend: their hatches or, if ``marks``, their markers."""
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], ls="", marker=look.marker, markeredgecolor=look.colour, markerfacecolor="none")
        if marks
        else patch_handle(style, look, edge=look.colour, filled=False)
        for look in looks
    ]


def _counted(groups: Sequence[Group], end: float | None, missing: str) -> str:
    """Write the part of a caption with the number of runs, how many of them have no value, and how those are drawn."""
    counts = of_runs([group.runs for group in groups])
    total, lost = sum(group.runs for group in groups), sum(group.undecided for group in groups)
    if not lost:
        return f"{counts}, none {missing}."
    drawn = "not drawn" if end is None else "counted as later than the end of the runs (shaded)"
    return f"{counts}; {lost} of {total} {verb(lost, 'are', 'is')} {missing}, {drawn}, with the share at the right."


_SCHEMA = {
    "cell": pl.String,
    "series": pl.String,
    "mark": pl.String,
    "runs": pl.UInt32,
    "undecided": pl.UInt32,
    **dict.fromkeys(QUANTILES, pl.Float64),
    "value": pl.Float64,
}
"""Columns of the numbers of a picture of boxes, see ``draw_boxes``."""


def _row(group: Group, mark: str, **values: float | None) -> dict[str, object]:
    """Return a row of the picture's numbers for a group.

    ``mark`` is "box" or "run". ``values`` are its quantiles, or the value of a run; the other columns are null.
    """
    empty: dict[str, object] = dict.fromkeys(_SCHEMA)
    return empty | {
        "cell": group.cell, "series": group.series, "mark": mark, "runs": group.runs,
        "undecided": group.undecided, **values,
    }  # fmt: skip


def quantile(group: Group, q: float, *, censored: bool) -> float | None:
    """Return a quantile of a group's runs, interpolated linearly between neighbouring runs.

    Args:
        q: which quantile, 0 to 1. censored: whether undecided runs count as later than all others, or are left out.
    Returns:
        The quantile; None if one of the neighbouring runs is undecided, or if there are no runs.
    """
    size = group.runs if censored else group.values.size
    if size == 0:
        return None
    place = q * (size - 1)  # among the sorted runs, from 0; undecided runs are the last
    low, high = math.floor(place), math.ceil(place)
    if high >= group.values.size:  # an undecided run
        return None
    return float(group.values[low] + (place - low) * (group.values[high] - group.values[low]))


def _box(rows: Rows, style: Style, group: Group, in_band: float | None) -> dict[str, object]:
    """Draw the quantiles of a group as a box with whiskers; return its row of numbers.

    If no run of the group has a value and the end of the runs is unknown, no quantile is known, and nothing is drawn.

    Args:
        in_band: x of quantiles later than the end of the runs; None: the end is unknown.
    """
    from matplotlib.patches import Rectangle

    quantiles = {name: quantile(group, q, censored=in_band is not None) for name, q in QUANTILES.items()}
    row = _row(group, "box", **quantiles)
    if in_band is None and not group.values.size:
        return row
    axes, y, colour = rows.axes, group.y, group.look.colour
    half = rows.band * 0.36  # half of the height of the box, which leaves space between boxes
    x: dict[str, Any] = {name: in_band if value is None else value for name, value in quantiles.items()}
    axes.add_patch(
        Rectangle(
            (x["q25"], y - half), x["q75"] - x["q25"], 2 * half, facecolor=PAPER, edgecolor=colour,
            hatch=hatched(style, group.look.hatch), linewidth=rows.line_pt, zorder=2,
        )
    )  # fmt: skip
    line: dict[str, Any] = {
        "color": colour, "linewidth": rows.line_pt, "zorder": 2, "solid_capstyle": "butt",
    }  # fmt: skip
    # the whiskers, each with a bar at its tip
    for low, high, tip in (("q05", "q25", "q05"), ("q75", "q95", "q95")):
        axes.plot([x[low], x[high]], [y, y], **line)
        axes.plot([x[tip]] * 2, [y - half / 2, y + half / 2], **line)
    axes.plot(
        [x["median"]] * 2, [y - half, y + half], color=INK, linewidth=rows.line_pt * 2, zorder=3,
        solid_capstyle="butt",
    )  # fmt: skip
    return row


def _runs(rows: Rows, style: Style, group: Group, in_band: float | None) -> list[dict[str, object]]:
    """Draw each run of a group as a mark; return a row of numbers for each mark.

    Undecided runs are drawn in the band after the end. If the end is unknown, they are not drawn. A group without marks
    has one row without a value.
    """
    values: list[float | None] = group.values.tolist()
    if in_band is not None:
        values += [None] * group.undecided
    x: list[Any] = [in_band if value is None else value for value in values]
    rows.axes.plot(
        x, [group.y] * len(values), ls="",
        marker=group.look.marker, markersize=style.marker_pt, markerfacecolor="none",
        markeredgecolor=group.look.colour, zorder=3, markeredgewidth=rows.line_pt, clip_on=False,
    )  # fmt: skip
    return [_row(group, "run", value=value) for value in (values or [None])]
