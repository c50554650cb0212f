"""Heat maps: one value over two fields, with its numbers where they fit and the best cells outlined."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.plots.canvas import LINE_SPACING, axes_size_pt, colour_bar, new_figure
from vibroswarm.plots.frames import check_once, run_counts, tidy
from vibroswarm.plots.palette import COLOUR_MAP, FAINT, ON_DARK, ON_LIGHT, PAPER
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import Style, style_named
from vibroswarm.plots.words import fitted, fitted_names, number, of_runs, width_pt

VECTORS_UP_TO = 2500
"""Cells; more are one image in SVG and PDF too."""


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
    """One cell for each x and y, coloured by its value; y grows upwards.

    Args:
        frame: one row a cell: ``x`` and ``y`` (numbers, which are sorted, or text, in the order of its coming),
            ``value`` (null: hatched), and where known ``runs``. A pair that is not there is hatched too.
        x_label: of x. y_label: of y. label: of the value; all with their units.
        best: "low" or "high": outline the cells that are best; None: none.
        best_within: outline all whose value is at most this far from the best.
        digits: of the numbers written into cells; they are left out where they do not fit.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``x, y, value, runs, best`` (whether outlined).

    Raises:
        InputError: the frame is not as asked, or a cell stands twice.
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
    figure = _draw(sizes, grid, chosen, xs, ys, (x_label, y_label, label), digits, title)
    numbers = frame.select("x", "y", "value", "runs").with_columns(
        best=pl.Series([bool(chosen[y_of[y], x_of[x]]) for x, y in frame.select("x", "y").iter_rows()])
    )
    runs = run_counts(frame)
    missing = int(np.isnan(grid).sum())
    caption = f"{label} over {x_label} and {y_label}{', ' + of_runs(runs) if runs else ''}."
    if chosen.any():
        within = f" and all within {number(best_within)} of it" if best_within else ""
        caption += f" Outlined: the {'lowest' if best == 'low' else 'highest'}{within}."
    if missing:
        caption += f" Hatched: {missing} of {grid.size} cells have no value."
    return Picture(figure, numbers, caption)


def _order(column: pl.Series) -> list[Any]:
    if column.dtype.is_numeric():
        if column.has_nulls() or column.cast(pl.Float64).is_nan().any():
            raise InputError("holds a missing number where one is needed", field=column.name)
        return column.unique().sort().to_list()
    return column.unique(maintain_order=True).to_list()


def best_cells(grid: NDArray[np.float64], best: str | None, within: float) -> NDArray[np.bool_]:
    """Which cells are at most ``within`` from the best; none where nothing has a value."""
    if best is None or np.isnan(grid).all():
        return np.zeros(grid.shape, dtype=bool)
    signed = grid if best == "low" else -grid
    chosen: NDArray[np.bool_] = signed <= np.nanmin(signed) + within
    return chosen


def _draw(
    style: Style,
    grid: NDArray[np.float64],
    chosen: NDArray[np.bool_],
    xs: list[Any],
    ys: list[Any],
    labels: tuple[str, str, str],
    digits: int,
    title: str,
) -> Any:
    rows, columns = grid.shape
    row_in = style.row_in if rows <= 12 else style.least_row_in * 1.15  # beyond, numbers would not fit anyway
    height = max(style.height_in, min(style.tallest_in, style.height_in * 0.45 + rows * row_in))
    figure = new_figure(style, height_in=height, title=title)
    axes = figure.add_subplot()
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    axes.set_xlim(0, columns)
    axes.set_ylim(0, rows)
    axes.add_patch(_nothing(columns, rows))
    known = np.isfinite(grid)
    low, high = (float(np.nanmin(grid)), float(np.nanmax(grid))) if known.any() else (0.0, 1.0)
    if high == low:
        apart = max(0.5, abs(low) / 100)
        low, high = low - apart, high + apart
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


def _nothing(columns: int, rows: int) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle(
        (0, 0), columns, rows, facecolor=PAPER, edgecolor=FAINT, hatch="////", linewidth=0, zorder=1
    )


def _name_ticks(axis: Any, style: Style, values: list[Any], room_pt: float, *, upright: bool) -> None:
    """Name the cells along an axis: all if they fit (x labels may be turned), else every second, third, ..."""
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
    shown = (
        fitted_names([texts[place] for place in places], size, room)
        if not numeric
        else [texts[place] for place in places]
    )
    axis.set_ticks([place + 0.5 for place in places], labels=shown, fontsize=size)
    axis.set_tick_params(length=0)
    if turned:
        for label in axis.get_ticklabels():
            label.set_rotation(45 if pitch > line else 90)
            label.set_ha("right" if pitch > line else "center")
            label.set_rotation_mode("anchor" if pitch > line else "default")


def _write_numbers(
    figure: Any, axes: Any, style: Style, grid: NDArray[np.float64], limits: tuple[float, float], digits: int
) -> None:
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


def _outline(axes: Any, style: Style, chosen: NDArray[np.bool_]) -> None:
    """A double line, dark on light, around the chosen cells."""
    from matplotlib.collections import LineCollection

    padded = np.pad(chosen, 1)
    lines = [[(x, y), (x, y + 1)] for y, x in np.argwhere(padded[1:-1, 1:] != padded[1:-1, :-1])]
    lines += [[(x, y), (x + 1, y)] for y, x in np.argwhere(padded[1:, 1:-1] != padded[:-1, 1:-1])]
    for colour, width in ((ON_DARK, 3.4), (ON_LIGHT, 1.8)):
        axes.add_collection(
            LineCollection(
                lines, colors=colour, linewidths=style.line_pt * width, capstyle="projecting", zorder=5,
                clip_on=False,
            )
        )  # fmt: skip
