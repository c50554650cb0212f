"""Box pictures: how a value spreads over runs, cell by cell, the undecided runs with it."""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.plots.canvas import hatched
from vibroswarm.plots.palette import INK, PAPER, look
from vibroswarm.plots.per_run import Group, Plane, group_caption, plane_of, quantile, series_legend
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import Style, style_named

QUANTILES = {"q05": 0.05, "q25": 0.25, "median": 0.5, "q75": 0.75, "q95": 0.95}
POINTS_BELOW = 5
"""Fewer runs than this are drawn one by one, without a box."""


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
    """One box for each cell and series: median, middle half, and 5 % to 95 % of the runs.

    Args:
        frame: one row a run: ``cell`` (text), ``value`` (number; null or NaN: undecided), and, where there are
            several, ``series`` (text). Cells and series are drawn in the order of their coming.
        label: of the axis, with its unit.
        t_end: end of the runs, in the axis's unit. Undecided runs then count as later than it, and quantiles
            that fall among them stand in the shaded band; without it they are in the share at the right only.
        missing: what a run without a value is called.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers have ``cell, series, mark`` ("box" or "run"), ``runs, undecided``, the quantiles
        ``q05, q25, median, q75, q95`` of a box (null: later than t_end) and the ``value`` of a run.

    Raises:
        InputError: the frame is not as asked.
    """
    sizes = style_named(style)
    plane = plane_of(sizes, frame, label, t_end, missing, title)
    rows: list[dict[str, object]] = []
    for group in plane.groups:
        rows += _runs(plane, sizes, group) if group.runs < POINTS_BELOW else [_box(plane, sizes, group)]
    single = [group.runs < POINTS_BELOW for group in plane.groups]
    series_legend(plane, sizes, marks=all(single))
    plane.rows.settle(sizes)
    boxes = "Line: median; box: 25 % to 75 %; whiskers: 5 % to 95 % of the runs. "
    marks = f"Fewer than {POINTS_BELOW} runs are drawn one by one. "
    caption = f"{label}. {'' if all(single) else boxes}{marks if any(single) else ''}{group_caption(plane, missing)}"
    return Picture(plane.rows.figure, pl.DataFrame(rows, schema=_SCHEMA), caption)


_SCHEMA = {
    "cell": pl.String,
    "series": pl.String,
    "mark": pl.String,
    "runs": pl.UInt32,
    "undecided": pl.UInt32,
    **dict.fromkeys(QUANTILES, pl.Float64),
    "value": pl.Float64,
}


def _row(group: Group, mark: str, **values: float | None) -> dict[str, object]:
    empty: dict[str, object] = dict.fromkeys(_SCHEMA)
    return empty | {
        "cell": group.cell, "series": group.series, "mark": mark, "runs": group.runs,
        "undecided": group.undecided, **values,
    }  # fmt: skip


def _box(plane: Plane, style: Style, group: Group) -> dict[str, object]:
    from matplotlib.patches import Rectangle

    at = {name: quantile(group, q, censored=plane.end is not None) for name, q in QUANTILES.items()}
    row = _row(group, "box", **at)
    if plane.end is None and not group.values.size:
        return row
    axes, y, looks = plane.rows.axes, plane.place(group), look(group.series_index)
    half = plane.rows.band * 0.36
    x = {name: plane.at(value) for name, value in at.items()}
    axes.add_patch(
        Rectangle(
            (x["q25"], y - half), x["q75"] - x["q25"], 2 * half, facecolor=PAPER, edgecolor=looks.colour,
            hatch=hatched(style, looks.hatch), linewidth=plane.rows.line_pt, zorder=2,
        )
    )  # fmt: skip
    line: dict[str, Any] = {
        "color": looks.colour,
        "linewidth": plane.rows.line_pt,
        "zorder": 2,
        "solid_capstyle": "butt",
    }
    for low, high, tip in (("q05", "q25", "q05"), ("q75", "q95", "q95")):
        axes.plot([x[low], x[high]], [y, y], **line)
        axes.plot([x[tip]] * 2, [y - half / 2, y + half / 2], **line)
    axes.plot(
        [x["median"]] * 2, [y - half, y + half], color=INK, linewidth=plane.rows.line_pt * 2, zorder=3,
        solid_capstyle="butt",
    )  # fmt: skip
    return row


def _runs(plane: Plane, style: Style, group: Group) -> list[dict[str, object]]:
    looks = look(group.series_index)
    values: list[float | None] = [*group.values.tolist()]
    if plane.end is not None:
        values += [None] * group.undecided
    plane.rows.axes.plot(
        [plane.at(value) for value in values], [plane.place(group)] * len(values), ls="", marker=looks.marker,
        markersize=style.marker_pt, markerfacecolor="none", markeredgecolor=looks.colour, zorder=3,
        markeredgewidth=plane.rows.line_pt, clip_on=False,
    )  # fmt: skip
    return [_row(group, "run", value=value) for value in (values or [None])]
