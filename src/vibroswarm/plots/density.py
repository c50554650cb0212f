"""Where robots sampled: a histogram over the floor, in units of what even sampling would give."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.plots.canvas import colour_bar, few_ticks, new_figure
from vibroswarm.plots.frames import tidy
from vibroswarm.plots.palette import COLOUR_MAP, ON_DARK, ON_LIGHT
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import Style, style_named
from vibroswarm.plots.words import number


@drawn
def draw_density(
    frame: pl.DataFrame,
    *,
    width_m: float = 1.0,
    height_m: float = 1.0,
    bins: int = 20,
    tiles: NDArray[np.uint8] | None = None,
    tile_size_m: tuple[float, float] | None = None,
    corner_m: tuple[float, float] = (0.0, 0.0),
    highest: float | None = None,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Samples per area over the arena, 1 where as many fell as even sampling would give; tiles on top.

    Borders between vibrating and still tiles are drawn as a double line, vibrating tiles hold a sign.

    Args:
        frame: one row a sample: ``x_m, y_m``; or one row a place with ``count`` samples.
        width_m: of the arena. height_m: of the arena.
        bins: along the longer side; the shorter gets as many as make them square, nearly.
        tiles: (rows, columns) of 0 and 1, row 0 at the top; None: no tiles are drawn.
        tile_size_m: width and height of a tile; None: the tiles fill the arena.
        corner_m: the floor's lower left corner.
        highest: where the colours end; None: at the highest density. What lies above is told in the caption.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``x_low_m, x_high_m, y_low_m, y_high_m, count, density``.

    Raises:
        InputError: the frame is not as asked, a sample lies outside, or there are none.
    """
    sizes = style_named(style)
    frame = tidy(frame, numbers=("x_m", "y_m"), optional_numbers=("count",), complete=("x_m", "y_m"))
    x, y = frame["x_m"].to_numpy(), frame["y_m"].to_numpy()
    weights = frame["count"].fill_null(0 if frame["count"].is_not_null().any() else 1).to_numpy()
    if bins < 1 or width_m <= 0 or height_m <= 0:
        raise InputError("the arena needs an area, and at least 1 bin", field="bins")
    if (x < 0).any() or (x > width_m).any() or (y < 0).any() or (y > height_m).any():
        raise InputError(f"a sample lies outside the arena of {width_m:g} m x {height_m:g} m", field="x_m")
    longer = max(width_m, height_m)
    shape = (max(1, round(bins * width_m / longer)), max(1, round(bins * height_m / longer)))
    counts, x_edges, y_edges = np.histogram2d(
        x, y, bins=shape, range=((0, width_m), (0, height_m)), weights=weights
    )
    if not counts.sum():
        raise InputError("there are no samples to count", field="count")
    density = counts / counts.sum() * counts.size
    top = highest or float(density.max())
    figure = _draw(sizes, density, (x_edges, y_edges), top, (tiles, tile_size_m, corner_m), title)
    above = int((density > top * (1 + 1e-12)).sum())
    caption = (
        f"Samples per area over the arena, {int(counts.sum())} samples in {shape[0]} x {shape[1]} bins; "
        f"1 is what even sampling gives; least {number(float(density.min()))}, most {number(float(density.max()))}."
        + (f" {above} bins lie above the colours' end at {number(top)}." if above else "")
        + (" Double line: border between vibrating (dots) and still tiles." if tiles is not None else "")
    )
    columns, rows = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij")
    numbers = pl.DataFrame(
        {
            "x_low_m": x_edges[columns.ravel()],
            "x_high_m": x_edges[columns.ravel() + 1],
            "y_low_m": y_edges[rows.ravel()],
            "y_high_m": y_edges[rows.ravel() + 1],
            "count": counts.ravel(),
            "density": density.ravel(),
        }
    )
    return Picture(figure, numbers, caption)


def _draw(
    style: Style,
    density: NDArray[np.float64],
    edges: tuple[NDArray[np.float64], NDArray[np.float64]],
    top: float,
    floor: tuple[NDArray[np.uint8] | None, tuple[float, float] | None, tuple[float, float]],
    title: str,
) -> Any:
    width_m, height_m = float(edges[0][-1]), float(edges[1][-1])
    map_in = style.width_in * 0.65
    height = min(style.tallest_in, map_in * height_m / width_m + style.font_pt * (5.5 if title else 3.5) / 72)
    height = max(height, 0.6 * style.height_in)
    figure = new_figure(style, height_in=height, title=title)
    axes = figure.add_subplot()
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    mesh = axes.pcolormesh(
        *edges, density.T, cmap=COLOUR_MAP, vmin=0, vmax=top, linewidth=0, rasterized=density.size > 2500
    )
    axes.set(xlim=(0, width_m), ylim=(0, height_m), aspect="equal", xlabel="x (m)")
    extended = "max" if density.max() > top * (1 + 1e-12) else "neither"
    bar = colour_bar(figure, axes, style, mesh, "samples per area (even: 1)", "y (m)", extend=extended)
    if top > 1:
        bar.ax.axhline(1, color=ON_LIGHT, linewidth=style.line_pt)
        bar.ax.axhline(1, color=ON_DARK, linewidth=style.line_pt, linestyle=(0, (2, 2)))
    if floor[0] is not None:
        _tiles(axes, style, floor[0], floor[1], floor[2], (width_m, height_m))
    few_ticks(axes.xaxis, style)
    few_ticks(axes.yaxis, style)
    return figure


def _tiles(
    axes: Any,
    style: Style,
    tiles: NDArray[np.uint8],
    size_m: tuple[float, float] | None,
    corner_m: tuple[float, float],
    arena_m: tuple[float, float],
) -> None:
    from matplotlib.collections import LineCollection

    rows, columns = tiles.shape
    wide, high = size_m or (arena_m[0] / columns, arena_m[1] / rows)
    upwards = np.pad(tiles[::-1] == 1, 1)
    lines = [[(x, y), (x, y + 1)] for y, x in np.argwhere(upwards[1:-1, 1:] != upwards[1:-1, :-1])]
    lines += [[(x, y), (x + 1, y)] for y, x in np.argwhere(upwards[1:, 1:-1] != upwards[:-1, 1:-1])]
    placed = np.array(lines, dtype=float).reshape(-1, 2, 2) * (wide, high) + np.asarray(corner_m)
    for colour, width in ((ON_DARK, 2.6), (ON_LIGHT, 1.2)):
        axes.add_collection(
            LineCollection(
                list(placed), colors=colour, linewidths=style.line_pt * width, capstyle="projecting",
                rasterized=len(lines) > 5000,
            )
        )  # fmt: skip
    centres = (np.argwhere(tiles[::-1] == 1)[:, ::-1] + 0.5) * (wide, high) + np.asarray(corner_m)
    axes.plot(
        centres[:, 0], centres[:, 1], ls="", marker="o", markersize=style.marker_pt * 0.8,
        markerfacecolor=ON_DARK, markeredgecolor=ON_LIGHT, markeredgewidth=style.line_pt * 0.7,
        rasterized=len(centres) > 5000,
    )  # fmt: skip
