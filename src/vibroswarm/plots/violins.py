"""Violin pictures: the shape of a value's spread over runs, the undecided runs as a bar of the same ink.

| name | symbol | equation |
|---|---|---|
| density | g(v) | Gaussian kernels at the decided runs, over all runs: it integrates to the share decided |
| bandwidth | h | 0.9 min(sd, IQR / 1.34) n^(-1/5), Silverman (1986), eq. 3.31 |
"""

from __future__ import annotations

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.plots.boxes import QUANTILES
from vibroswarm.plots.canvas import hatched
from vibroswarm.plots.palette import INK, PAPER, look
from vibroswarm.plots.per_run import Group, Plane, group_caption, plane_of, quantile, series_legend
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import Style, style_named

POINTS = 120
"""Along each violin."""
LEAST_WIDTH = 0.5 / POINTS
"""Of a kernel, of the breadth of the values: narrower ones would fall between the points."""


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
    """One violin for each cell and series; its area is the share of runs decided.

    The undecided stand as a bar in the band behind ``t_end``, as high as their share of the row. The arguments
    ``frame``, ``label``, ``t_end``, ``missing``, ``title`` and ``style`` are those of ``draw_boxes``.

    Returns:
        Picture; its numbers have ``cell, series, runs, undecided, median, q25, q75`` (null: later than t_end)
        and the outline, ``value`` and ``density`` (per unit of the value; null where one value alone was seen).

    Raises:
        InputError: the frame is not as asked.
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
    """Places along the value and the density there, between the least and the greatest run; empty for one value."""
    values = group.values
    if values.size < 2 or values[0] == values[-1]:
        return values[:1], np.empty(0)
    breadth = float(values[-1] - values[0])
    scaled = (values - values[0]) / breadth  # so that no square of a value overflows
    spread = float(scaled.std(ddof=1))
    middle = float(np.subtract(*np.quantile(scaled, [0.75, 0.25]))) / 1.34
    width = max(0.9 * min(spread, middle or spread) * values.size**-0.2, LEAST_WIDTH)
    places = np.linspace(0, 1, POINTS)
    # Binned to a fine grid first, so that 100,000 runs cost no more than 1000.
    counts, edges = np.histogram(scaled, bins=min(values.size * 4, 1000), range=(0, 1))
    centres = (edges[1:] + edges[:-1]) / 2
    kernels = np.exp(-0.5 * ((places[:, None] - centres) / width) ** 2) / (width * np.sqrt(2 * np.pi))
    return values[0] + places * breadth, kernels @ counts / group.runs / breadth


def _draw(
    plane: Plane,
    style: Style,
    group: Group,
    values: NDArray[np.float64],
    relative: NDArray[np.float64],
    at: dict[str, float | None],
) -> None:
    axes, y, looks = plane.rows.axes, plane.place(group), look(group.series_index)
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
