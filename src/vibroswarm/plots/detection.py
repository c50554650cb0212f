"""Detection curves: how probably a floor of a given fill ratio is missed, by length or by robots."""

from __future__ import annotations

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.plots.canvas import few_ticks, legend_below, log_x, percent_axis, plain_axes
from vibroswarm.plots.error_bars import checked_estimates, draw_estimates, series_handle
from vibroswarm.plots.frames import run_counts, tidy
from vibroswarm.plots.palette import FAINT
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import style_named
from vibroswarm.plots.words import number, of_runs


@drawn
def draw_detection(
    frame: pl.DataFrame,
    *,
    label: str = "probability of missing",
    x_label: str = "fill ratio",
    boundary: float | None = None,
    tolerated: float | None = None,
    interval: str = "95 % Wilson interval",
    log: bool = False,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Probability of missing over the fill ratio, a curve for each horizon or number of robots.

    Args:
        frame: one row a mark: ``fill_ratio``, ``missed, low, high`` (0 to 1; null: none), where there are several
            ``series`` (text, such as "600 s" or "10 robots"), and where known ``runs``.
        label: of the probability. x_label: of the fill ratio.
        boundary: decision boundary, a vertical line. tolerated: a horizontal line.
        interval: what low and high are.
        log: whether the fill ratio is drawn logarithmically.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``fill_ratio, series, missed, low, high, runs``.

    Raises:
        InputError: the frame is not as asked, or a probability is none.
    """
    sizes = style_named(style)
    frame = tidy(frame, numbers=("fill_ratio", "missed", "low", "high"))
    if frame.select(((pl.col("missed") < 0) | (pl.col("missed") > 1)).any()).item():
        raise InputError("holds a number outside 0 to 1; that is no probability", field="missed")
    frame, series = checked_estimates(frame.rename({"fill_ratio": "x", "missed": "estimate"}))
    named = series if len(series) > 1 else []
    figure, axes = plain_axes(sizes, x_label, label, title=title, legend=named)
    few_ticks(axes.xaxis, sizes)
    for index, name in enumerate(series):
        draw_estimates(axes, sizes, frame.filter(pl.col("series") == name).sort("x"), index, log=log)
    axes.set_ylim(-0.02, 1.02)
    percent_axis(axes.yaxis)
    if log:
        log_x(axes, frame["x"].to_list())
    told = []
    if tolerated is not None:
        axes.axhline(tolerated, color=FAINT, linewidth=sizes.line_pt, linestyle=(0, (4, 2)), zorder=1)
        told.append(f"horizontal line: {number(100 * tolerated)} % tolerated")
    if boundary is not None:
        axes.axvline(boundary, color=FAINT, linewidth=sizes.line_pt, linestyle=(0, (1.5, 1.5)), zorder=1)
        told.append(f"vertical line: decision boundary {number(boundary)}")
    legend_below(figure, sizes, [series_handle(sizes, index) for index in range(len(named))], named)
    runs = run_counts(frame)
    caption = f"{label} over {x_label}: estimate and {interval}" + (f" over {of_runs(runs)}" if runs else "")
    caption = "; ".join([caption, *told]) + "."
    numbers = frame.rename({"x": "fill_ratio", "estimate": "missed"})
    return Picture(figure, numbers.select("fill_ratio", "series", "missed", "low", "high", "runs"), caption)
