"""Box and violin pictures: the distribution of a value over the runs of each cell, including undecided runs.

| name | symbol | equation |
|---|---|---|
| density | g(v) | Gaussian kernels at the decided runs, over all runs: it integrates to the share decided |
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
        frame: one row per run: ``cell`` (text), ``value`` (number; null or NaN: undecided), and, where there are
            several, ``series`` (text). Cells and series are drawn in order of appearance.
        label: of the axis, with its unit.
        t_end: end of the runs, in the axis's unit. Undecided runs then count as later than it, and quantiles
            that fall among them are in the shaded band; without it they are only in the share at the right.
        missing: name for runs without a value.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers have ``cell, series, mark`` ("box" or "run"), ``runs, undecided``, the quantiles
        ``q05, q25, median, q75, q95`` of a box (null: later than t_end) and the ``value`` of a run.

    Raises:
        InputError: the frame is not as described.
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
    """Return a row of the picture's numbers."""
    empty: dict[str, object] = dict.fromkeys(_SCHEMA)
    return empty | {
        "cell": group.cell, "series": group.series, "mark": mark, "runs": group.runs,
        "undecided": group.undecided, **values,
    }  # fmt: skip


def _box(plane: Plane, style: Style, group: Group) -> dict[str, object]:
    """Draw the quantiles of a group as a box; return its row."""
    from matplotlib.patches import Rectangle

    at = {name: quantile(group, q, censored=plane.end is not None) for name, q in QUANTILES.items()}
    row = _row(group, "box", **at)
    if plane.end is None and not group.values.size:
        return row
    axes, y, looks = plane.rows.axes, plane.place(group), plane.look(group)
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
    """Draw each run of a group as a mark; return their rows."""
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
"""Least width of a kernel, relative to the range of values: narrower ones would fall between the points."""


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
    """Draw one violin per cell and series; its area is the share of runs decided.

    A bar in the band after ``t_end`` shows the share of undecided runs. The arguments
    ``frame``, ``label``, ``t_end``, ``missing``, ``title`` and ``style`` are those of ``draw_boxes``.

    Returns:
        Picture; its numbers have ``cell, series, runs, undecided, median, q25, q75`` (null: later than t_end)
        and the outline, ``value`` and ``density`` (per unit of the value; null where one value alone was seen).

    Raises:
        InputError: the frame is not as described.
    """
    sizes = style_named(style)
    plane = plane_of(sizes, frame, label, t_end, missing, title)
    shapes = [violin(group) for group in plane.groups]
    peak = max((float(density.max()) for _, density in shapes if density.size), default=1.0)
    tables = []
    for group, (values, density) in zip(plane.groups, shapes, strict=True):
        at = {name: quantile(group, QUANTILES[name], censored=t_end is not None) for name in _MARKED}
        _draw(plane, sizes, group, values, density / peak, at)
        tables.append(_numbers(group, values, density, at))
    series_legend(plane, sizes)
    plane.rows.settle(sizes)
    caption = (
        f"{label}. Outline: density over runs (Gaussian kernel, Silverman's bandwidth), all to one scale, its "
        "area the share decided; thick line: median; thin line: 25 % to 75 %. "
        f"{group_caption(plane, missing)}"
    )
    return Picture(plane.rows.figure, pl.concat(tables), caption)


_MARKED = ("median", "q25", "q75")


def violin(group: Group) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the values between the least and the greatest run, and the density at each; empty for a single value."""
    values = group.values
    if values.size < 2 or values[0] == values[-1]:
        return values[:1], np.empty(0)
    value_range = float(values[-1] - values[0])
    scaled = (values - values[0]) / value_range  # no square of a value overflows
    spread = float(scaled.std(ddof=1))
    middle = float(np.subtract(*np.quantile(scaled, [0.75, 0.25]))) / 1.34
    width = max(0.9 * min(spread, middle or spread) * values.size**-0.2, LEAST_WIDTH)
    places = np.linspace(0, 1, POINTS)
    # Binned to a fine grid first: 100,000 runs cost no more than 1000.
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
    at: dict[str, float | None],
) -> None:
    """Draw the density, the quantiles and the median of a group."""
    axes, y, looks = plane.rows.axes, plane.place(group), plane.look(group)
    half, line = plane.rows.band * 0.46, plane.rows.line_pt
    if relative.size:
        axes.fill_between(
            values, y - half * relative, y + half * relative, facecolor=PAPER, edgecolor=looks.colour,
            hatch=hatched(style, looks.hatch), linewidth=line, zorder=2,
        )  # fmt: skip
    elif values.size:
        axes.plot([values[0]] * 2, [y - half, y + half], color=looks.colour, linewidth=line * 1.5, zorder=2)
    if plane.end is not None and group.undecided:
        high = half * group.undecided / group.runs
        axes.plot(
            [plane.in_band] * 2, [y - high, y + high], color=looks.colour, linewidth=line * 3, zorder=2,
            solid_capstyle="butt",
        )  # fmt: skip
    if plane.end is None and not group.values.size:
        return
    x = {name: plane.at(value) for name, value in at.items()}
    axes.plot([x["q25"], x["q75"]], [y, y], color=INK, linewidth=line, zorder=3, solid_capstyle="butt")
    axes.plot(
        [x["median"]] * 2, [y - half / 3, y + half / 3], color=INK, linewidth=line * 2, zorder=3,
        solid_capstyle="butt",
    )  # fmt: skip


def _numbers(
    group: Group, values: NDArray[np.float64], density: NDArray[np.float64], at: dict[str, float | None]
) -> pl.DataFrame:
    """Tabulate the density and the quantiles of a group."""
    places: list[float | None] = values.tolist() or [None]
    heights = density.tolist() or [None] * len(places)
    return pl.DataFrame(
        {
            "cell": [group.cell] * len(places),
            "series": [group.series] * len(places),
            "runs": pl.Series([group.runs] * len(places), dtype=pl.UInt32),
            "undecided": pl.Series([group.undecided] * len(places), dtype=pl.UInt32),
            **{name: pl.Series([value] * len(places), dtype=pl.Float64) for name, value in at.items()},
            "value": pl.Series(places, dtype=pl.Float64),
            "density": pl.Series(heights, dtype=pl.Float64),
        }
    )
