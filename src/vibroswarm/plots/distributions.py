"""Box and violin pictures: the distribution of a value over the runs of each cell, including undecided runs.

The runs of one cell and series are a group. Undecided runs have no value. If the end of the runs is known, undecided
runs count as later than the end, and a shaded band right of the end stands for all later values (see ``inputs``).

| name | symbol | equation |
|---|---|---|
| density | g(v) | sum of Gaussian kernels at the decided runs / all runs; its integral over all v: the share decided |
| bandwidth | h | 0.9 min(sd, IQR / 1.34) n^(-1/5), Silverman (1986), eq. 3.31 |
"""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

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


POINTS = 120
"""Points along each violin."""
LEAST_WIDTH = 0.5 / POINTS
"""Least width of a kernel, relative to the range of values: a narrower one could lie between two points unseen."""


@drawn
def draw_violins(
    frame: pl.DataFrame,
    *,
    label: str = "decision time (s)",
    t_end: float | None = None,
    missing: str = "undecided",
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw one violin per cell and series: its area shows which share of the runs is decided.

    A violin ends at its least and its greatest run. The tails of the density beyond them are cut off, so that with few
    runs its area is clearly smaller than that of a violin of many runs with the same share. A group whose decided runs
    all have the same value is drawn as a line, without area.

    A bar in the band after ``t_end`` shows the share of undecided runs. The arguments ``frame``, ``label``, ``t_end``,
    ``missing``, ``title`` and ``style`` are those of ``draw_boxes``.

    Returns:
        Picture; its numbers have one row per point of an outline: ``cell, series, runs, undecided``, the quantiles
        ``median, q25, q75`` (null: later than t_end; or, without t_end, no run is decided), and the outline's ``value``
        and ``density`` (per unit of the value; null if all decided runs have the same value). A group without decided
        runs has one row, without value and density.

    Raises:
        InputError: the frame is not as described, or a value is later than ``t_end``.
    """
    sizes = style_named(style)
    plane = plane_of(sizes, frame, label, t_end, missing, title)
    shapes = [violin(group) for group in plane.groups]
    # All violins have the same scale of density, so that their areas can be compared. If no violin has a density, the
    # default has no effect, since only empty arrays are divided by it.
    peak = max((float(density.max()) for _, density in shapes if density.size), default=1.0)
    tables = []
    for group, (values, density) in zip(plane.groups, shapes, strict=True):
        quantiles = {name: quantile(group, QUANTILES[name], censored=t_end is not None) for name in _MARKED}
        _draw(plane, sizes, group, values, density / peak, quantiles)
        tables.append(_numbers(group, values, density, quantiles))
    series_legend(plane, sizes)
    plane.rows.settle(sizes)  # sets the height of the figure, now that all else is drawn
    caption = (
        f"{label}. Outline: density over runs (Gaussian kernel, Silverman's bandwidth), all to one scale, its "
        "area the share decided; thick line: median; thin line: 25 % to 75 %. "
        f"{group_caption(plane, missing)}"
    )
    return Picture(plane.rows.figure, pl.concat(tables), caption)


_MARKED = ("median", "q25", "q75")
"""The quantiles that a violin shows."""


def violin(group: Group) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the outline of a violin: ``POINTS`` values from the least to the greatest run, and the density at each.

    The density is per unit of the value, over all runs: from minus to plus infinity it integrates to the share of
    decided runs. The outline has a smaller area, since it lacks the tails beyond the least and the greatest run.

    If all decided runs have the same value, or there is one only, the first array has this value alone, and the second
    is empty. Without decided runs both are empty.
    """
    values = group.values
    if values.size < 2 or values[0] == values[-1]:
        return values[:1], np.empty(0)
    value_range = float(values[-1] - values[0])
    scaled = (values - values[0]) / value_range  # 0 to 1, so that no square of a value overflows
    spread = float(scaled.std(ddof=1))
    # the interquartile range, divided by that of a normal distribution of standard deviation 1
    from_quartiles = float(np.subtract(*np.quantile(scaled, [0.75, 0.25]))) / 1.34
    # If half of the runs have the same value, the interquartile range may be 0. Then the standard deviation is used.
    width = max(0.9 * min(spread, from_quartiles or spread) * values.size**-0.2, LEAST_WIDTH)
    places = np.linspace(0, 1, POINTS)
    # The kernels are placed at the centres of at most 1000 fine bins, not at the runs, so that the work is bounded.
    # Each kernel has the area 1, with its tails, and counts as often as its bin has runs, so that
    # ``kernels @ counts / group.runs`` has the share decided as its area. Division by the range makes it a density per
    # unit of the value.
    counts, edges = np.histogram(scaled, bins=min(values.size * 4, 1000), range=(0, 1))
    centres = (edges[1:] + edges[:-1]) / 2
    kernels = np.exp(-0.5 * ((places[:, None] - centres) / width) ** 2) / (width * np.sqrt(2 * np.pi))
    return values[0] + places * value_range, kernels @ counts / group.runs / value_range


def _draw(
    plane: Plane,
    style: Style,
    group: Group,
    values: NDArray[np.float64],
    relative: NDArray[np.float64],
    quantiles: dict[str, float | None],
) -> None:
    """Draw the violin of a group, the bar of its undecided runs, its quartiles and its median.

    Args:
        values: of the points of the outline; none if no run is decided. relative: density at these points, relative to
            the highest density of all groups; empty if all values are the same, which is drawn as a line.
        quantiles: by name; None: later than the end.
    """
    axes, y, looks = plane.rows.axes, plane.place(group), plane.look(group)
    # half of the greatest height of a violin, which leaves space between violins
    half = plane.rows.band * 0.46
    line = plane.rows.line_pt
    if relative.size:
        axes.fill_between(
            values, y - half * relative, y + half * relative, facecolor=PAPER, edgecolor=looks.colour,
            hatch=hatched(style, looks.hatch), linewidth=line, zorder=2,
        )  # fmt: skip
    elif values.size:
        axes.plot([values[0]] * 2, [y - half, y + half], color=looks.colour, linewidth=line * 1.5, zorder=2)
    if plane.end is not None and group.undecided:
        half_bar = half * group.undecided / group.runs
        axes.plot(
            [plane.in_band] * 2, [y - half_bar, y + half_bar], color=looks.colour, linewidth=line * 3, zorder=2,
            solid_capstyle="butt",
        )  # fmt: skip
    if plane.end is None and not group.values.size:  # no quantile is known
        return
    x = {name: plane.at(value) for name, value in quantiles.items()}
    axes.plot([x["q25"], x["q75"]], [y, y], color=INK, linewidth=line, zorder=3, solid_capstyle="butt")
    axes.plot(
        [x["median"]] * 2, [y - half / 3, y + half / 3], color=INK, linewidth=line * 2, zorder=3,
        solid_capstyle="butt",
    )  # fmt: skip


def _numbers(
    group: Group,
    values: NDArray[np.float64],
    density: NDArray[np.float64],
    quantiles: dict[str, float | None],
) -> pl.DataFrame:
    """Tabulate the outline of a group (see ``violin``), one row per point.

    Each quantile of the group is a column with the same value in all rows. A group without values has one row, without
    value and density.
    """
    places: list[float | None] = values.tolist() or [None]
    heights = density.tolist() or [None] * len(places)
    return pl.DataFrame(
        {
            "cell": [group.cell] * len(places),
            "series": [group.series] * len(places),
            "runs": pl.Series([group.runs] * len(places), dtype=pl.UInt32),
            "undecided": pl.Series([group.undecided] * len(places), dtype=pl.UInt32),
            **{name: pl.Series([value] * len(places), dtype=pl.Float64) for name, value in quantiles.items()},
            "value": pl.Series(places, dtype=pl.Float64),
            "density": pl.Series(heights, dtype=pl.Float64),
        }
    )
