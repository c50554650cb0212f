"""Heat maps of a value over two fields, of the density of samples, and of the probability of damage on a surface."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import count, decimals_of, verb
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import as_tiles
from vibroswarm.plots.inputs import run_counts, tidy
from vibroswarm.plots.layout import few_ticks, new_figure, number, of_runs, percent_axis, to_scale
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import COLOUR_MAP, FAINT, INK, ON_DARK, ON_LIGHT, PAPER, Style, style_named

VECTORS_UP_TO: Final = 2500
"""Most cells drawn as vectors in SVG and PDF; more are drawn as an image."""
NUMBERS_UP_TO: Final = {"column": 8, "page": 14, "slide": 14}
"""Most columns of a map whose cells have their numbers."""


@drawn
def draw_heat(
    frame: pl.DataFrame,
    *,
    x_label: str = "x",
    y_label: str = "y",
    label: str = "value",
    best: str | None = None,
    digits: int = 3,
    percent: bool = False,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw one cell for each pair of x and y, coloured by its value; y grows upwards."""
    sizes = style_named(style)
    frame = tidy(frame, numbers=("value",), optional=("runs",))
    xs, ys = (_order(frame[name]) for name in ("x", "y"))
    grid = np.full((len(ys), len(xs)), np.nan)
    for x, y, value in frame.select("x", "y", "value").iter_rows():
        grid[ys.index(y), xs.index(x)] = np.nan if value is None else value
    chosen = best_cells(grid, best)
    height_in = max(sizes.height_in, sizes.height_in * 0.45 + len(ys) * sizes.row_in)
    figure = new_figure(sizes, height_in=height_in, title=title)
    axes = figure.add_subplot()
    mesh = _draw_grid(axes, grid, chosen, sizes)
    axes.set(xlabel=x_label, ylabel=y_label)
    for axis, values in ((axes.xaxis, xs), (axes.yaxis, ys)):
        texts = [value if isinstance(value, str) else number(value, 4) for value in values]
        axis.set_ticks(np.arange(len(values)) + 0.5, labels=texts)
        axis.set_tick_params(length=0)
    if sum(map(len, (str(x) for x in xs))) * 0.7 * sizes.small_pt > 0.7 * 72 * sizes.width_in:
        axes.tick_params(axis="x", rotation=90)
    if np.isfinite(grid).any():
        bar = figure.colorbar(mesh, ax=axes, pad=0.02, label=label).ax
        if percent:
            percent_axis(bar.yaxis)
    if len(xs) <= NUMBERS_UP_TO[sizes.name]:
        _write_numbers(axes, 100 * grid if percent else grid, digits)
    places = [(ys.index(y), xs.index(x)) for x, y in frame.select("x", "y").iter_rows()]
    numbers = frame.select("x", "y", "value", "runs").with_columns(
        best=pl.Series([bool(chosen[p]) for p in places])
    )
    runs, missing = run_counts(frame), int(np.isnan(grid).sum())
    caption = (
        f"{label} over {x_label} and {y_label}{', ' + of_runs(runs) if runs else ''}."
        + (f" Outlined: the {'lowest' if best == 'low' else 'highest'}." if chosen.any() else "")
        + (
            f" Hatched: {missing} of {grid.size} cells {verb(missing, 'have', 'has')} no value."
            if missing
            else ""
        )
    )
    return Picture(figure, numbers, caption)


def _order(column: pl.Series) -> list[Any]:
    """Return the distinct values of a column in their order along the axis: numbers sorted, texts as they appear."""
    return (
        column.unique().sort() if column.dtype.is_numeric() else column.unique(maintain_order=True)
    ).to_list()


def best_cells(grid: NDArray[np.float64], best: str | None) -> NDArray[np.bool_]:
    """Return which cells of ``grid`` have the best value: "low", "high", or None."""
    if best is None or np.isnan(grid).all():
        return np.zeros(grid.shape, dtype=bool)
    chosen: NDArray[np.bool_] = grid == (np.nanmin(grid) if best == "low" else np.nanmax(grid))
    return chosen


def _draw_grid(axes: Any, grid: NDArray[np.float64], chosen: NDArray[np.bool_], style: Style) -> Any:
    from matplotlib.patches import Rectangle

    rows, columns = grid.shape
    axes.spines[:].set_visible(True)
    axes.set(xlim=(0, columns), ylim=(0, rows))
    axes.add_patch(
        Rectangle((0, 0), columns, rows, facecolor=PAPER, edgecolor=FAINT, hatch="////", lw=0, zorder=1)
    )
    mesh = axes.pcolormesh(
        np.ma.masked_invalid(grid), cmap=COLOUR_MAP, zorder=2, rasterized=grid.size > VECTORS_UP_TO
    )
    for row, column in np.argwhere(chosen):
        for colour, width in ((ON_DARK, 3.4), (ON_LIGHT, 1.8)):  # visible on every colour
            looks: dict[str, Any] = {
                "fill": False,
                "edgecolor": colour,
                "lw": width * style.line_pt,
                "zorder": 5,
            }
            axes.add_patch(Rectangle((column, row), 1, 1, clip_on=False, **looks))
    return mesh


def _write_numbers(axes: Any, grid: NDArray[np.float64], digits: int) -> None:
    decimals, low, high = (
        decimals_of(grid.flat, digits),
        np.nanmin(grid, initial=np.inf),
        np.nanmax(grid, initial=0.0),
    )
    for (row, column), value in np.ndenumerate(grid):
        if np.isfinite(value):
            colour = ON_LIGHT if value > 0.5 * (low + high) else ON_DARK
            text = number(value, digits, decimals)
            axes.text(
                column + 0.5,
                row + 0.5,
                text,
                ha="center",
                va="center",
                zorder=4,
                color=colour,
                fontsize="small",
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
    """Draw the density of samples over the arena, relative to uniform sampling, with the borders of vibrating tiles."""
    sizes = style_named(style)
    frame = tidy(frame, numbers=("x_m", "y_m"), optional=("count",))
    x, y = frame["x_m"].to_numpy(), frame["y_m"].to_numpy()
    weights = frame["count"].fill_null(0 if frame["count"].is_not_null().any() else 1).to_numpy()
    longer = max(width_m, height_m)
    shape = (max(1, round(bins * width_m / longer)), max(1, round(bins * height_m / longer)))
    limits = ((0, width_m), (0, height_m))
    counts, x_edges, y_edges = np.histogram2d(x, y, bins=shape, range=limits, weights=weights)
    if not counts.sum():
        raise InputError("no sample lies in the arena", field="x_m")
    density = counts / counts.sum() * counts.size
    figure = new_figure(sizes, title=title)
    axes = figure.add_subplot()
    axes.spines[:].set_visible(True)
    looks: dict[str, Any] = {"cmap": COLOUR_MAP, "vmin": 0, "vmax": highest or float(density.max())}
    mesh = axes.pcolormesh(x_edges, y_edges, density.T, rasterized=density.size > VECTORS_UP_TO, **looks)
    axes.set(xlim=limits[0], ylim=limits[1], aspect="equal", xlabel="x (m)", ylabel="y (m)")
    above = highest is not None and density.max() > highest
    label = "samples per area (even: 1)"
    figure.colorbar(mesh, ax=axes, pad=0.02, label=label, extend="max" if above else "neither")
    few_ticks(axes.xaxis, sizes)
    few_ticks(axes.yaxis, sizes)
    caption = (
        f"Samples per area over the arena, {count(int(counts.sum()), 'sample')} in {shape[0]} x {shape[1]} bins; "
        f"1 is what even sampling gives; least {number(float(density.min()))}, most {number(float(density.max()))}."
    )
    if tiles is not None:
        _draw_borders(axes, as_tiles(tiles), tile_size_m, corner_m, (width_m, height_m))
        caption += " Double line: border of kinds of tile; dots: tiles that are not still."
    to_scale(figure, sizes, [axes], height_m / width_m)
    column, row = (index.ravel() for index in np.indices(counts.shape))
    numbers = {
        "x_low_m": x_edges[column], "x_high_m": x_edges[column + 1], "y_low_m": y_edges[row],
        "y_high_m": y_edges[row + 1], "count": counts.ravel(), "density": density.ravel(),
    }  # fmt: skip
    return Picture(figure, pl.DataFrame(numbers), caption)


def _draw_borders(
    axes: Any,
    tiles: NDArray[np.uint8],
    size_m: tuple[float, float] | None,
    corner_m: tuple[float, float],
    arena_m: tuple[float, float],
) -> None:
    from matplotlib.collections import LineCollection

    rows, columns = tiles.shape
    size = np.array(size_m or (arena_m[0] / columns, arena_m[1] / rows))
    padded = np.pad(tiles[::-1], 1)  # row 0 at the bottom; what lies outside is still
    vertical = [[(x, y), (x, y + 1)] for y, x in np.argwhere(padded[1:-1, 1:] != padded[1:-1, :-1])]
    level = [[(x, y), (x + 1, y)] for y, x in np.argwhere(padded[1:, 1:-1] != padded[:-1, 1:-1])]
    lines = np.array(vertical + level, dtype=float).reshape(-1, 2, 2) * size + corner_m
    for colour, width in ((ON_DARK, 2.8), (ON_LIGHT, 1.3)):
        axes.add_collection(LineCollection(list(lines), colors=colour, linewidths=width))
    centres = (np.argwhere(tiles[::-1] > 0)[:, ::-1] + 0.5) * size + corner_m
    axes.plot(*centres.T, ls="", marker="o", markersize=3, markerfacecolor=ON_DARK, markeredgecolor=ON_LIGHT)


@drawn
def draw_certainty(
    probability: NDArray[np.float64],
    size_m: tuple[float, float],
    places_m: NDArray[np.float64],
    *,
    marked_m: Sequence[tuple[float, float, float, float]] = (),
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw the probability of damage, and its standard deviation with the places of the samples."""
    from matplotlib.patches import Rectangle

    sizes = style_named(style)
    figure = new_figure(sizes, title=title)
    doubt = np.sqrt(probability * (1.0 - probability))
    panels: Any = figure.subplots(1, 2)
    shown = (("probability", probability, 1.0), ("standard deviation", doubt, 0.5))
    for axes, (name, values, most) in zip(panels, shown, strict=True):
        image = _image(axes, values, size_m, most)
        axes.set_xlabel("x (m)")
        few_ticks(axes.xaxis, sizes)
        figure.colorbar(image, ax=axes, location="top", pad=0.03, label=name)
    panels[0].set_ylabel("y (m)")
    # Places outside the surface must not make this map smaller than the one beside it.
    panels[1].plot(
        *places_m.T, ls="", marker=".", ms=1.2, color=PAPER, markeredgecolor=INK, mew=0.15, rasterized=True,
        scalex=False, scaley=False,
    )  # fmt: skip
    for axes, (left, bottom, width, height) in product(panels, marked_m):
        for line in ({"edgecolor": PAPER, "lw": 1.6}, {"edgecolor": INK, "lw": 0.8, "ls": "--"}):
            outline = Rectangle((left, bottom), width, height, fill=False)
            outline.set(**line)
            axes.add_patch(outline)
    to_scale(figure, sizes, panels[:1], size_m[1] / size_m[0])
    row, column = (index.ravel() for index in np.indices(probability.shape))
    cells = {"probability": probability.ravel(), "standard_deviation": doubt.ravel()}
    caption = "Left: probability of damage. Right: its standard deviation, and the places of the samples."
    caption = f"{caption} Outlined: called patches." if marked_m else caption
    return Picture(figure, pl.DataFrame({"row": row, "column": column, **cells}), caption)


def _image(axes: Any, values: NDArray[np.float64], size_m: tuple[float, float], most: float) -> Any:
    extent = (0.0, size_m[0], 0.0, size_m[1])
    return axes.imshow(values, cmap=COLOUR_MAP, vmin=0.0, vmax=most, extent=extent, interpolation="nearest")
