"""Heat maps of one value over two fields, and the density of samples over the floor."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.plots.inputs import check_once, run_counts, tidy
from vibroswarm.plots.layout import (
    LINE_SPACING,
    axes_size_pt,
    colour_bar,
    few_ticks,
    fitted,
    fitted_names,
    new_figure,
    number,
    of_runs,
    width_pt,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import COLOUR_MAP, FAINT, ON_DARK, ON_LIGHT, PAPER, Style, style_named

VECTORS_UP_TO = 2500
"""Cells; more are drawn as an image in SVG and PDF."""


@drawn
def draw_heat(
    frame: pl.DataFrame,
    *,
    x_label: str = "x",
    y_label: str = "y",
    label: str = "value",
    best: str | None = None,
    best_within: float = 0.0,
    digits: int = 3,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw one cell per x and y, coloured by its value; y grows upwards.

    Args:
        frame: one row per cell: ``x`` and ``y`` (numbers, which are sorted, or text, in order of appearance),
            ``value`` (null: hatched), and where known ``runs``. Missing pairs are hatched too.
        x_label: of x. y_label: of y. label: of the value; all with their units.
        best: "low" or "high": outline the cells that are best; None: none.
        best_within: outline all whose value is at most this far from the best.
        digits: of the numbers written into cells; they are left out where they do not fit.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``x, y, value, runs, best`` (whether outlined).

    Raises:
        InputError: the frame is not as described, or a cell is repeated.
    """
    sizes = style_named(style)
    if best not in (None, "low", "high"):
        raise InputError(f"'{best}' is neither low nor high", field="best")
    texts = [name for name in ("x", "y") if name in frame.columns and not frame.schema[name].is_numeric()]
    frame = tidy(frame, other=("x", "y"), texts=texts, numbers=("value",), optional_numbers=("runs",))
    check_once(frame, ["x", "y"])
    xs, ys = (_order(frame[name]) for name in ("x", "y"))
    grid = np.full((len(ys), len(xs)), np.nan)
    x_of, y_of = ({value: place for place, value in enumerate(values)} for values in (xs, ys))
    for x, y, value in frame.select("x", "y", "value").iter_rows():
        grid[y_of[y], x_of[x]] = np.nan if value is None else value
    chosen = best_cells(grid, best, best_within)
    figure = _draw_heat(sizes, grid, chosen, xs, ys, (x_label, y_label, label), digits, title)
    numbers = frame.select("x", "y", "value", "runs").with_columns(
        best=pl.Series([bool(chosen[y_of[y], x_of[x]]) for x, y in frame.select("x", "y").iter_rows()])
    )
    runs = run_counts(frame)
    missing = int(np.isnan(grid).sum())
    axes = " and ".join(name for name in (x_label, y_label) if name)
    caption = f"{label} over {axes}{', ' + of_runs(runs) if runs else ''}."
    if chosen.any():
        within = f" and all within {number(best_within)} of it" if best_within else ""
        caption += f" Outlined: the {'lowest' if best == 'low' else 'highest'}{within}."
    if missing:
        caption += f" Hatched: {missing} of {grid.size} cells have no value."
    return Picture(figure, numbers, caption)


def _order(column: pl.Series) -> list[Any]:
    """Return the distinct values of an axis in order."""
    if column.dtype.is_numeric():
        if column.has_nulls() or column.cast(pl.Float64).is_nan().any():
            raise InputError("has a missing number", field=column.name)
        return column.unique().sort().to_list()
    return column.unique(maintain_order=True).to_list()


def best_cells(grid: NDArray[np.float64], best: str | None, within: float) -> NDArray[np.bool_]:
    """Return which cells are at most ``within`` from the best; none if no cell has a value."""
    if best is None or np.isnan(grid).all():
        return np.zeros(grid.shape, dtype=bool)
    signed = grid if best == "low" else -grid
    chosen: NDArray[np.bool_] = signed <= np.nanmin(signed) + within
    return chosen


def _draw_heat(
    style: Style,
    grid: NDArray[np.float64],
    chosen: NDArray[np.bool_],
    xs: list[Any],
    ys: list[Any],
    labels: tuple[str, str, str],
    digits: int,
    title: str,
) -> Any:
    """Draw the map of a grid of values."""
    rows, columns = grid.shape
    # With more than 12 rows, numbers would not fit anyway.
    row_in = style.row_in if rows <= 12 else style.least_row_in * 1.15
    height = max(style.height_in, min(style.tallest_in, style.height_in * 0.45 + rows * row_in))
    figure = new_figure(style, height_in=height, title=title)
    axes = figure.add_subplot()
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    axes.set_xlim(0, columns)
    axes.set_ylim(0, rows)
    axes.add_patch(_hatched_ground(columns, rows))
    known = np.isfinite(grid)
    low, high = (float(np.nanmin(grid)), float(np.nanmax(grid))) if known.any() else (0.0, 1.0)
    if high == low:
        half_range = max(0.5, abs(low) / 100)
        low, high = low - half_range, high + half_range
    mesh = axes.pcolormesh(
        np.ma.masked_invalid(grid), cmap=COLOUR_MAP, vmin=low, vmax=high, zorder=2, linewidth=0,
        rasterized=grid.size > VECTORS_UP_TO,
    )  # fmt: skip
    _name_ticks(axes.xaxis, style, xs, style.width_in * 72 * 0.62, upright=False)
    _name_ticks(axes.yaxis, style, ys, height * 72 * 0.7, upright=True)
    axes.set_xlabel(fitted(labels[0], style.font_pt, style.width_in * 45, 2))
    if known.any():
        colour_bar(figure, axes, style, mesh, labels[2], labels[1])
    else:
        axes.set_ylabel(fitted(labels[1], style.font_pt, axes_size_pt(figure, axes)[1], 2))
    _write_numbers(figure, axes, style, grid, (low, high), digits)
    _outline(axes, style, chosen)
    return figure


def _hatched_ground(columns: int, rows: int) -> Any:
    """Return a hatched background, which shows where values are missing."""
    from matplotlib.patches import Rectangle

    return Rectangle(
        (0, 0), columns, rows, facecolor=PAPER, edgecolor=FAINT, hatch="////", linewidth=0, zorder=1
    )


def _name_ticks(axis: Any, style: Style, values: list[Any], room_pt: float, *, upright: bool) -> None:
    """Label the cells along an axis: all if they fit (x labels may be rotated), else every second, third, ..."""
    size = style.small_pt
    numeric = not isinstance(values[0], str)
    texts = [number(value, 4) for value in values] if numeric else [str(value) for value in values]
    pitch = room_pt / len(values)
    line = size * LINE_SPACING
    turned = not upright and max(width_pt(text, size) for text in texts) + size * 0.6 > pitch
    if turned and numeric and len(values) > 6 and pitch < line * 2.2:
        turned = False
    if upright or turned:
        room = style.width_in * 72 * (0.3 if upright else 0.25)
        step = max(1, int(np.ceil(line / pitch)))
    else:
        room = room_pt
        step = max(1, int(np.ceil((max(width_pt(text, size) for text in texts) + size * 0.6) / pitch)))
    if not numeric:
        step = 1
        size = min(size, pitch / LINE_SPACING) if upright or turned else size
    places = list(range(0, len(values), step))
    labels = (
        fitted_names([texts[place] for place in places], size, room)
        if not numeric
        else [texts[place] for place in places]
    )
    axis.set_ticks([place + 0.5 for place in places], labels=labels, fontsize=size)
    axis.set_tick_params(length=0)
    if turned:
        for label in axis.get_ticklabels():
            label.set_rotation(45 if pitch > line else 90)
            label.set_ha("right" if pitch > line else "center")
            label.set_rotation_mode("anchor" if pitch > line else "default")


def _write_numbers(
    figure: Any, axes: Any, style: Style, grid: NDArray[np.float64], limits: tuple[float, float], digits: int
) -> None:
    """Write the value into each cell if it fits."""
    rows, columns = grid.shape
    width, height = axes_size_pt(figure, axes)
    wide, high = width / columns, height / rows
    texts = [[number(value, digits) if np.isfinite(value) else "" for value in line] for line in grid]
    widest = max(width_pt(text, style.small_pt) for line in texts for text in line)
    shrink = min(1.0, 0.9 * wide / max(widest, 1e-9), 0.85 * high / (style.small_pt * LINE_SPACING))
    if shrink < 0.7:
        return
    for (row, column), value in np.ndenumerate(grid):
        if np.isfinite(value):
            bright = (value - limits[0]) / (limits[1] - limits[0]) > 0.5
            axes.text(
                column + 0.5, row + 0.5, texts[row][column], ha="center", va="center", zorder=4,
                color=ON_LIGHT if bright else ON_DARK, fontsize=style.small_pt * shrink,
            )  # fmt: skip


def _borders(chosen: NDArray[np.bool_]) -> list[list[tuple[int, int]]]:
    """Return line segments between chosen cells and all others; row 0 is at the bottom."""
    padded = np.pad(chosen, 1)
    upright = [[(x, y), (x, y + 1)] for y, x in np.argwhere(padded[1:-1, 1:] != padded[1:-1, :-1])]
    level = [[(x, y), (x + 1, y)] for y, x in np.argwhere(padded[1:, 1:-1] != padded[:-1, 1:-1])]
    return upright + level


def _outline(axes: Any, style: Style, chosen: NDArray[np.bool_]) -> None:
    """Draw a double line, dark on light, around the chosen cells."""
    from matplotlib.collections import LineCollection

    lines = _borders(chosen)
    for colour, width in ((ON_DARK, 3.4), (ON_LIGHT, 1.8)):
        axes.add_collection(
            LineCollection(
                lines, colors=colour, linewidths=style.line_pt * width, capstyle="projecting", zorder=5,
                clip_on=False,
            )
        )  # fmt: skip


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
    """Draw samples per area over the arena, relative to even sampling (1), with the tiles on top.

    Borders between vibrating and still tiles are double lines; vibrating tiles have a dot.

    Args:
        frame: one row per sample: ``x_m, y_m``; or one row per place with ``count`` samples.
        width_m: of the arena. height_m: of the arena.
        bins: along the longer side; bins are nearly square.
        tiles: (rows, columns) of 0 and 1, row 0 at the top; None: no tiles are drawn.
        tile_size_m: width and height of a tile; None: the tiles fill the arena.
        corner_m: the floor's lower left corner.
        highest: upper end of the colours; None: the highest density. The caption counts bins above it.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``x_low_m, x_high_m, y_low_m, y_high_m, count, density``.

    Raises:
        InputError: the frame is not as described, a sample is outside the arena, or there are none.
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
    figure = _draw_density(sizes, density, (x_edges, y_edges), top, (tiles, tile_size_m, corner_m), title)
    above = int((density > top * (1 + 1e-12)).sum())
    caption = (
        f"Samples per area over the arena, {int(counts.sum())} samples in {shape[0]} x {shape[1]} bins; "
        f"1 is what even sampling gives; least {number(float(density.min()))}, most {number(float(density.max()))}."
        + (f" {above} bins lie above the colours' end at {number(top)}." if above else "")
        + (" Double line: border between vibrating (dots) and still tiles." if tiles is not None else "")
    )
    return Picture(figure, _bins(counts, density, x_edges, y_edges), caption)


def _bins(
    counts: NDArray[np.float64],
    density: NDArray[np.float64],
    x_edges: NDArray[np.float64],
    y_edges: NDArray[np.float64],
) -> pl.DataFrame:
    """Return a row for each bin: its edges, and its count and density, each (columns, rows)."""
    columns, rows = np.meshgrid(np.arange(counts.shape[0]), np.arange(counts.shape[1]), indexing="ij")
    return pl.DataFrame(
        {
            "x_low_m": x_edges[columns.ravel()],
            "x_high_m": x_edges[columns.ravel() + 1],
            "y_low_m": y_edges[rows.ravel()],
            "y_high_m": y_edges[rows.ravel() + 1],
            "count": counts.ravel(),
            "density": density.ravel(),
        }
    )


def _draw_density(
    style: Style,
    density: NDArray[np.float64],
    edges: tuple[NDArray[np.float64], NDArray[np.float64]],
    top: float,
    floor: tuple[NDArray[np.uint8] | None, tuple[float, float] | None, tuple[float, float]],
    title: str,
) -> Any:
    """Draw a map of the density of samples over the floor."""
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
    """Draw the borders of vibrating tiles and a dot in each of them."""
    from matplotlib.collections import LineCollection

    rows, columns = tiles.shape
    wide, high = size_m or (arena_m[0] / columns, arena_m[1] / rows)
    lines = _borders(tiles[::-1] == 1)
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
