"""Box pictures: the distribution of a value over the runs of each cell, including undecided runs.

The runs of one cell and series are a group. Undecided runs have no value. If the end of the runs is known, undecided
runs count as later than the end, and a shaded band right of the end stands for all later values (see ``inputs``).
"""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.plots.inputs import Group, Plane, group_caption, plane_of, quantile, series_legend
from vibroswarm.plots.layout import hatched
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import INK, PAPER, Style, style_named

QUANTILES = {"q05": 0.05, "q25": 0.25, "median": 0.5, "q75": 0.75, "q95": 0.95}
"""Quantiles of a box, by the names of their columns."""
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
    plane = plane_of(sizes, frame, label, t_end, missing, title)
    rows: list[dict[str, object]] = []
    for group in plane.groups:
        rows += _runs(plane, sizes, group) if group.runs < POINTS_BELOW else [_box(plane, sizes, group)]
    # For each group, whether its runs are drawn one by one.
    single = [group.runs < POINTS_BELOW for group in plane.groups]
    series_legend(plane, sizes, marks=all(single))
    plane.rows.settle(sizes)  # sets the height of the figure, now that all else is drawn
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


def _box(plane: Plane, style: Style, group: Group) -> dict[str, object]:
    """Draw the quantiles of a group as a box with whiskers; return its row of numbers.

    If no run of the group has a value and the end of the runs is unknown, no quantile is known, and nothing is drawn.
    """
    from matplotlib.patches import Rectangle

    quantiles = {name: quantile(group, q, censored=plane.end is not None) for name, q in QUANTILES.items()}
    row = _row(group, "box", **quantiles)
    if plane.end is None and not group.values.size:
        return row
    axes, y, looks = plane.rows.axes, plane.place(group), plane.look(group)
    half = plane.rows.band * 0.36  # half of the height of the box, which leaves space between boxes
    # quantiles later than the end lie in the band
    x = {name: plane.at(value) for name, value in quantiles.items()}
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
    # the whiskers, each with a bar at its tip
    for low, high, tip in (("q05", "q25", "q05"), ("q75", "q95", "q95")):
        axes.plot([x[low], x[high]], [y, y], **line)
        axes.plot([x[tip]] * 2, [y - half / 2, y + half / 2], **line)
    axes.plot(
        [x["median"]] * 2, [y - half, y + half], color=INK, linewidth=plane.rows.line_pt * 2, zorder=3,
        solid_capstyle="butt",
    )  # fmt: skip
    return row


def _runs(plane: Plane, style: Style, group: Group) -> list[dict[str, object]]:
    """Draw each run of a group as a mark; return a row of numbers for each mark.

    Undecided runs are drawn in the band after the end. If the end is unknown, they are not drawn. A group without marks
    has one row without a value.
    """
    looks = plane.look(group)
    values: list[float | None] = [*group.values.tolist()]
    if plane.end is not None:
        values += [None] * group.undecided
    plane.rows.axes.plot(
        [plane.at(value) for value in values], [plane.place(group)] * len(values), ls="", marker=looks.marker,
        markersize=style.marker_pt, markerfacecolor="none", markeredgecolor=looks.colour, zorder=3,
        markeredgewidth=plane.rows.line_pt, clip_on=False,
    )  # fmt: skip
    return [_row(group, "run", value=value) for value in (values or [None])]
