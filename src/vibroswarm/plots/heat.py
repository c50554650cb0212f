"""Heat maps of one value over two fields, and the density of samples over the floor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import count, decimals_of, verb
from vibroswarm.errors import InputError, shown
from vibroswarm.floors.floor import as_tiles
from vibroswarm.plots.inputs import check_frame, run_counts, tidy
from vibroswarm.plots.layout import (
    LINE_SPACING,
    axes_size_pt,
    colour_bar,
    few_ticks,
    fitted_names,
    new_figure,
    number,
    of_runs,
    percent_axis,
    to_scale,
    width_pt,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import COLOUR_MAP, FAINT, ON_DARK, ON_LIGHT, PAPER, Style, style_named

VECTORS_UP_TO = 2500
"""Most cells drawn as vectors in SVG and PDF; more are drawn as an image."""
MARKS_UP_TO = 5000
"""Most dots, or lines between tiles, drawn as vectors; more are drawn as an image."""


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
    percent: bool = False,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw one cell for each pair of x and y, coloured by its value; y grows upwards.

    Args:
        frame: one row per cell with the columns ``x`` and ``y`` (numbers, which are sorted, or text, in order of
            appearance), ``value`` (null: no value), and if known ``runs``. Cells without value or row are hatched.
        x_label: of x. y_label: of y. label: of the value; all with their units.
        best: which value is best, "low" (the lowest) or "high" (the highest): all cells with this value are outlined.
            None: no cell is outlined.
        best_within: also outline all cells whose values are at most this far from the best.
        digits: significant digits of the numbers in the cells; the numbers are left out if they do not fit.
        percent: whether values are shares, written in percent.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``x, y, value, runs, best`` (whether outlined).

    Raises:
        InputError: the frame is not as described, a number of x or y is missing, a cell is repeated, or ``best`` is
            neither "low" nor "high" nor None.
    """
    sizes = style_named(style)
    if best not in (None, "low", "high"):
        raise InputError(f"'{best}' is neither low nor high", field="best")
    check_frame(frame)
    texts = [name for name in ("x", "y") if name in frame.columns and not frame.schema[name].is_numeric()]
    frame = tidy(
        frame, other=("x", "y"), texts=texts, numbers=("value",), optional_numbers=("runs",), once=("x", "y")
    )
    xs, ys = (_order(frame[name]) for name in ("x", "y"))
    grid = np.full((len(ys), len(xs)), np.nan)
    column_of, row_of = ({value: place for place, value in enumerate(values)} for values in (xs, ys))
    for x, y, value in frame.select("x", "y", "value").iter_rows():
        grid[row_of[y], column_of[x]] = np.nan if value is None else value
    chosen = best_cells(grid, best, best_within)
    figure = _draw_heat(sizes, grid, chosen, xs, ys, (x_label, y_label, label), digits, percent, title)
    numbers = frame.select("x", "y", "value", "runs").with_columns(
        best=pl.Series([bool(chosen[row_of[y], column_of[x]]) for x, y in frame.select("x", "y").iter_rows()])
    )
    runs = run_counts(frame)
    missing = int(np.isnan(grid).sum())
    axes = " and ".join(name for name in (x_label, y_label) if name)
    within = f" and all within {number(best_within)} of it" if best_within else ""
    caption = (
        f"{label} over {axes}{', ' + of_runs(runs) if runs else ''}."
        + (f" Outlined: the {'lowest' if best == 'low' else 'highest'}{within}." if chosen.any() else "")
        + (
            f" Hatched: {missing} of {grid.size} cells {verb(missing, 'have', 'has')} no value."
            if missing
            else ""
        )
    )
    return Picture(figure, numbers, caption)


def _order(column: pl.Series) -> list[Any]:
    """Return the distinct values of a column in their order along the axis: numbers sorted, texts as they appear."""
    if column.dtype.is_numeric():
        if column.has_nulls() or column.cast(pl.Float64).is_nan().any():
            raise InputError("has a missing number", field=column.name)
        return column.unique().sort().to_list()
    return column.unique(maintain_order=True).to_list()


def best_cells(grid: NDArray[np.float64], best: str | None, within: float) -> NDArray[np.bool_]:
    """Return which cells of ``grid`` differ from the best cell by at most ``within``, in the shape of the grid.

    ``best`` says whether the "low" or the "high" value is best. With None, or if all cells are nan, no cells are
    chosen.
    """
    if best is None or np.isnan(grid).all():
        return np.zeros(grid.shape, dtype=bool)
    signed = grid if best == "low" else -grid  # the lowest is best
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
    percent: bool,
    title: str,
) -> Any:
    """Draw the map of a grid of values.

    Args:
        grid: (rows, columns), row 0 at the bottom; nan: no value. chosen: cells to outline, in the same shape.
        xs, ys: values of the columns and rows. labels: of x, y and the values.
        digits: significant digits of the numbers in the cells. percent: whether values are written in percent.
    """
    from matplotlib.patches import Rectangle

    rows, columns = grid.shape
    # Many rows get little more than the least height, so that the map does not become tall. 0.45 of the usual height is
    # for the title and the labels of the axis. A map is never taller than ``tallest_in``: its rows become lower.
    row_in = style.row_in if rows <= 12 else style.least_row_in * 1.15
    height = max(style.height_in, min(style.tallest_in, style.height_in * 0.45 + rows * row_in))
    figure = new_figure(style, height_in=height, title=title)
    axes = figure.add_subplot()
    axes.spines[:].set_visible(True)
    axes.set(xlim=(0, columns), ylim=(0, rows))
    # A cell is 1 wide and 1 high; the ground is visible where cells have no value.
    ground: dict[str, Any] = {
        "facecolor": PAPER,
        "edgecolor": FAINT,
        "hatch": "////",
        "linewidth": 0,
        "zorder": 1,
    }
    axes.add_patch(Rectangle((0, 0), columns, rows, **ground))
    known = np.isfinite(grid)
    low, high = (float(np.nanmin(grid)), float(np.nanmax(grid))) if known.any() else (0.0, 1.0)
    # The scale of colours needs a range above 0. For large values it is relative, since 0.5 could be less than their
    # rounding error.
    if high == low:
        half_range = max(0.5, abs(low) / 100)
        low, high = low - half_range, high + half_range
    mesh = axes.pcolormesh(
        np.ma.masked_invalid(grid), cmap=COLOUR_MAP, vmin=low, vmax=high, zorder=2, linewidth=0,
        rasterized=grid.size > VECTORS_UP_TO,
    )  # fmt: skip
    # The names of y, and the bar, take from the width that those of x have, and these from the height of the labels.
    axes.set(xlabel=labels[0], ylabel=labels[1])
    if known.any():
        bar = colour_bar(figure, axes, style, mesh).ax
        bar.set_ylabel(labels[2])
        if percent:
            percent_axis(bar.yaxis)
    _name_ticks(axes.yaxis, style, ys, axes_size_pt(figure, axes)[1], upright=True)
    _name_ticks(axes.xaxis, style, xs, axes_size_pt(figure, axes)[0], upright=False)
    scale = 100 if percent else 1
    _write_numbers(figure, axes, style, scale * grid, limits=(scale * low, scale * high), digits=digits)
    _outline(axes, _borders(chosen), (3.4 * style.line_pt, 1.8 * style.line_pt), zorder=5, clip_on=False)
    return figure


def _name_ticks(axis: Any, style: Style, values: list[Any], room_pt: float, *, upright: bool) -> None:
    """Label the cells along an axis.

    If numbers do not fit, only every second, third, ... cell has a label. Texts are all written, shortened or in
    smaller letters if necessary. Labels of x that are wider than a cell are rotated; but numbers are not, if there are
    more than six cells and the cells are narrow.

    Args:
        axis: of matplotlib. style: sizes of the picture. values: of the cells along the axis.
        room_pt: length of the axis, points. upright: whether it is the y axis.
    """
    size = style.small_pt
    numeric = not isinstance(values[0], str)
    texts = [number(value, 4) for value in values] if numeric else [str(value) for value in values]
    pitch = room_pt / len(values)  # width of a cell along the axis
    line = size * LINE_SPACING
    longest = max(width_pt(text, size) for text in texts) + size * 0.6  # with space to the next
    turned = not upright and longest > pitch
    # Many numbers in narrow cells: level labels of some cells are easier to read than rotated labels of all cells.
    if turned and numeric and len(values) > 6 and pitch < line * 2.2:
        turned = False
    # room: length that a label may have, points; step: every step-th cell has a label
    if upright or turned:  # along the axis a label takes the height of a line
        # across the axis, labels of y take at most 0.3 of the picture's width, rotated labels of x at most 0.25
        room = style.width_in * 72 * (0.3 if upright else 0.25)
        step = max(1, int(np.ceil(line / pitch)))
    else:
        room = room_pt
        step = max(1, int(np.ceil(longest / pitch)))
    # Each text is written, since it does not follow from its neighbours, as a number does.
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
            # Labels at 45 degrees are easier to read than at 90 degrees, but need cells wider than a line.
            label.set_rotation(45 if pitch > line else 90)
            label.set_ha("right" if pitch > line else "center")
            label.set_rotation_mode("anchor" if pitch > line else "default")


def _write_numbers(
    figure: Any, axes: Any, style: Style, grid: NDArray[np.float64], limits: tuple[float, float], digits: int
) -> None:
    """Write the values into the cells, in smaller letters if necessary, or none if they would be too small to read.

    Args:
        grid: (rows, columns); nan: no value. limits: values at the ends of the scale of colours, which is dark at the
            lower end: letters are light in its lower half, and dark in the upper.
        digits: significant digits of the largest number.
    """
    rows, columns = grid.shape
    width, height = axes_size_pt(figure, axes)
    wide, high = width / columns, height / rows  # size of a cell, points
    decimals = decimals_of(grid.flat, digits)
    texts = [
        [number(value, digits, decimals) if np.isfinite(value) else "" for value in line] for line in grid
    ]
    widest = max(width_pt(text, style.small_pt) for line in texts for text in line)
    # Letters take at most 0.9 of the width of a cell and 0.85 of its height. ``widest`` is 0 if no cell has a value.
    shrink = min(1.0, 0.9 * wide / max(widest, 1e-9), 0.85 * high / (style.small_pt * LINE_SPACING))
    if shrink < 0.7:  # too small to read
        return
    for (row, column), value in np.ndenumerate(grid):
        if np.isfinite(value):
            bright = (value - limits[0]) / (limits[1] - limits[0]) > 0.5
            axes.text(
                column + 0.5, row + 0.5, texts[row][column], ha="center", va="center", zorder=4,
                color=ON_LIGHT if bright else ON_DARK, fontsize=style.small_pt * shrink,
            )  # fmt: skip


def _borders(chosen: NDArray[np.bool_]) -> list[list[tuple[int, int]]]:
    """Return the border between chosen cells and all others as line segments, each [(x, y), (x, y)].

    ``chosen`` is (rows, columns), row 0 at the bottom; a cell is 1 wide and 1 high.
    """
    # Cells that are not chosen are added around the grid, so that its edge can be a border too.
    padded = np.pad(chosen, 1)
    # A segment lies between two neighbouring cells of which one is chosen. The vertical one at x lies between the cells
    # x - 1 and x of a row, which have the indices x and x + 1 in ``padded``; horizontal ones likewise.
    vertical = [[(x, y), (x, y + 1)] for y, x in np.argwhere(padded[1:-1, 1:] != padded[1:-1, :-1])]
    horizontal = [[(x, y), (x + 1, y)] for y, x in np.argwhere(padded[1:, 1:-1] != padded[:-1, 1:-1])]
    return vertical + horizontal


def _outline(axes: Any, lines: Sequence[Any], widths_pt: tuple[float, float], **how: Any) -> None:
    """Draw double lines: a dark one on a wider light one, so that they are visible on every colour.

    Args:
        widths_pt: of the light line, and of the dark one. how: for ``LineCollection``.
    """
    from matplotlib.collections import LineCollection

    for colour, width in zip((ON_DARK, ON_LIGHT), widths_pt, strict=True):
        axes.add_collection(
            LineCollection(lines, colors=colour, linewidths=width, capstyle="projecting", **how)
        )


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
    """Draw the density of samples (samples per area) over the arena, with the tiles on top.

    The density is relative to that of uniform sampling, which is 1 everywhere. Vibrating tiles have a dot, and tiles of
    further kinds other marks; a double line separates kinds, and what lies outside the floor.

    Args:
        frame: one row per sample with the columns ``x_m, y_m``; or one row per place, with the number of samples there
            in ``count`` (null: 0). A column ``count`` of nulls alone counts as absent.
        width_m: of the arena. height_m: of the arena.
        bins: number of bins along the longer side; bins are nearly square.
        tiles: (rows, columns), 1 vibrating and 0 still, row 0 at the top; None: no tiles are drawn.
        tile_size_m: width and height of a tile; None: the tiles fill the arena.
        corner_m: lower left corner of the floor in the arena.
        highest: density at the upper end of the colours; None or 0: the highest density of a bin. Bins above it have
            the colour of the end, and the caption counts them.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``x_low_m, x_high_m, y_low_m, y_high_m, count, density``.

    Raises:
        InputError: the frame is not as described, the arena has no area, ``bins`` is below 1, a sample is outside the
            arena, a count is negative, or the number of samples is 0.
    """
    sizes = style_named(style)
    frame = tidy(frame, numbers=("x_m", "y_m"), optional_numbers=("count",), complete=("x_m", "y_m"))
    x, y = frame["x_m"].to_numpy(), frame["y_m"].to_numpy()
    # Without the column ``count``, each row is one sample. With it, a missing count is 0.
    weights = frame["count"].fill_null(0 if frame["count"].is_not_null().any() else 1).to_numpy()
    tiles = None if tiles is None else as_tiles(tiles)
    for name, length_m in (("width_m", width_m), ("height_m", height_m)):
        if not 0 < length_m < np.inf:
            raise InputError("the arena needs an area; give a length above 0", field=name)
    if bins < 1:
        raise InputError(f"{shown(bins)} is wrong; give 1 or more", field="bins")
    if (x < 0).any() or (x > width_m).any() or (y < 0).any() or (y > height_m).any():
        raise InputError(f"a sample lies outside the arena of {width_m:g} m x {height_m:g} m", field="x_m")
    longer = max(width_m, height_m)
    shape = (max(1, round(bins * width_m / longer)), max(1, round(bins * height_m / longer)))
    counts, x_edges, y_edges = np.histogram2d(
        x, y, bins=shape, range=((0, width_m), (0, height_m)), weights=weights
    )
    if weights.min() < 0 or not counts.sum():
        raise InputError("counts must be 0 or more, and one of them above 0", field="count")
    density = counts / counts.sum() * counts.size  # relative to the same number in each bin
    top = highest or float(density.max())
    figure = _draw_density(
        sizes, density, edges=(x_edges, y_edges), top=top, floor=(tiles, tile_size_m, corner_m), title=title
    )
    caption = _density_caption(int(counts.sum()), density, top)
    if tiles is not None:
        caption += f" Double line: border between {_words_of_tiles(tiles)}."
    return Picture(figure, _bins(counts, density, x_edges, y_edges), caption)


def _density_caption(samples: int, density: NDArray[np.float64], top: float) -> str:
    """Return how many samples there are in how many bins, the extremes, and how many bins are above the colours."""
    caption = (
        f"Samples per area over the arena, {count(samples, 'sample')} in {density.shape[0]} x {density.shape[1]} bins; "
        f"1 is what even sampling gives; least {number(float(density.min()))}, most {number(float(density.max()))}."
    )
    above = int((density > top * (1 + 1e-12)).sum())  # the factor allows for rounding errors
    if above:
        caption += f" {count(above, 'bin')} {verb(above, 'lie')} above the colours' end at {number(top)}."
    return caption


KIND_MARKERS: Final = {
    "o": "circles", "s": "squares", "^": "triangles", "D": "diamonds", "v": "triangles down", "P": "plus signs",
}  # fmt: skip
"""Markers of tiles of kind 1, 2 and so on, and what they are called; further kinds have them again."""


def _words_of_tiles(tiles: NDArray[np.uint8]) -> str:
    """Return which kinds of tile the double line separates, and how they are marked."""
    most = int(tiles.max(initial=0))
    if most < 2:
        return "vibrating (dots) and still tiles"
    names = list(KIND_MARKERS.values())
    marks = [f"{names[(kind - 1) % len(names)]}: kind {kind}" for kind in range(1, most + 1)]
    return f"kinds of tile (no mark: kind 0, {', '.join(marks)})"


def _bins(
    counts: NDArray[np.float64],
    density: NDArray[np.float64],
    x_edges: NDArray[np.float64],
    y_edges: NDArray[np.float64],
) -> pl.DataFrame:
    """Return a table with one row per bin: its edges, m, its number of samples, and its relative density.

    Args:
        counts, density: (columns, rows), column 0 at the left and row 0 at the bottom. x_edges: (columns + 1,).
        y_edges: (rows + 1,).
    """
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
    """Draw a map of the density of samples over the arena.

    Args:
        style: sizes of the picture. density: (columns, rows), relative to uniform sampling.
        edges: of the bins along x and along y, m. top: density at the upper end of the colours.
        floor: tiles (None: not drawn), tile size and lower left corner, as in ``draw_density``. title: of the picture.
    """
    tiles, tile_size_m, corner_m = floor
    width_m, height_m = float(edges[0][-1]), float(edges[1][-1])
    figure = new_figure(style, title=title)
    axes = figure.add_subplot()
    axes.spines[:].set_visible(True)
    mesh = axes.pcolormesh(
        *edges,
        density.T,
        cmap=COLOUR_MAP,
        vmin=0,
        vmax=top,
        linewidth=0,
        rasterized=density.size > VECTORS_UP_TO,
    )
    axes.set(xlim=(0, width_m), ylim=(0, height_m), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    # an arrow at the end of the colour bar: values lie beyond; the factor allows for rounding errors
    extended = "max" if density.max() > top * (1 + 1e-12) else "neither"
    bar = colour_bar(figure, axes, style, mesh, extend=extended)
    bar.ax.set_ylabel("samples per area (even: 1)")
    if top > 1:  # mark the density of uniform sampling on the scale
        bar.ax.axhline(1, color=ON_LIGHT, linewidth=style.line_pt)
        bar.ax.axhline(1, color=ON_DARK, linewidth=style.line_pt, linestyle=(0, (2, 2)))
    if tiles is not None:
        _tiles(axes, style, tiles, tile_size_m, corner_m, arena_m=(width_m, height_m))
    few_ticks(axes.xaxis, style)
    few_ticks(axes.yaxis, style)
    # the label of the colour bar needs room also beside the map of a very wide arena
    to_scale(figure, style, [axes], height_m / width_m, least_in=0.65 * style.height_in)
    return figure


def _tiles(
    axes: Any,
    style: Style,
    tiles: NDArray[np.uint8],
    size_m: tuple[float, float] | None,
    corner_m: tuple[float, float],
    arena_m: tuple[float, float],
) -> None:
    """Draw a line around each area of tiles of a kind above 0, and a mark in each of these tiles.

    Args:
        tiles: (rows, columns) of kinds, such as 1 vibrating and 0 still, row 0 at the top.
        size_m: width and height of a tile; None: the tiles fill the arena.
        corner_m: lower left corner of the floor in the arena. arena_m: width and height of the arena.
    """
    rows, columns = tiles.shape
    wide, high = size_m or (arena_m[0] / columns, arena_m[1] / rows)  # size of a tile
    kinds = range(1, max(int(tiles.max()), 1) + 1)
    # rows in reverse order: ``_borders`` has row 0 at the bottom
    of_kind = [tiles[::-1] == kind for kind in kinds]
    # Two kinds share a border, which is drawn once.
    lines = list(dict.fromkeys(tuple(line) for chosen in of_kind for line in _borders(chosen)))
    # from units of tiles to m: (segments, 2 ends, x and y)
    placed = np.array(lines, dtype=float).reshape(-1, 2, 2) * (wide, high) + np.asarray(corner_m)
    widths_pt = 2.6 * style.line_pt, 1.2 * style.line_pt
    _outline(axes, list(placed), widths_pt, rasterized=len(lines) > MARKS_UP_TO)
    markers = list(KIND_MARKERS)
    for kind, chosen in zip(kinds, of_kind, strict=True):
        centres = (np.argwhere(chosen)[:, ::-1] + 0.5) * (wide, high) + np.asarray(corner_m)
        axes.plot(
            centres[:, 0], centres[:, 1], ls="", marker=markers[(kind - 1) % len(markers)],
            markersize=style.marker_pt * 0.8, markerfacecolor=ON_DARK, markeredgecolor=ON_LIGHT,
            markeredgewidth=style.line_pt * 0.7, rasterized=len(centres) > MARKS_UP_TO,
        )  # fmt: skip
