"""Time against error of several choices, and their Pareto front."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.plots.curves import thinned
from vibroswarm.plots.inputs import check_bounds, run_counts, tidy
from vibroswarm.plots.layout import few_ticks, legend_below, of_runs, percent_axis, plain_axes, width_pt
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, INK, PAPER, SERIES, Style, style_named

NAMED_UP_TO = {"column": 8, "page": 12, "slide": 12}
"""Most points of the front that are numbered and named below; of more, an even selection."""
VECTORS_UP_TO = 2000
"""Points; more are drawn as an image in SVG and PDF, without intervals."""

_COLUMNS = ("name", "time", "time_low", "time_high", "error", "error_low", "error_high")


@drawn
def draw_front(
    frame: pl.DataFrame,
    *,
    time_label: str = "decision time (s)",
    error_label: str = "share of runs not right",
    interval: str = "95 % intervals",
    percent: bool = False,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw time and error of each choice; those on the Pareto front are full, numbered, and joined by steps.

    A choice is on the front if no other estimate is at least as good in both and better in one; overlapping
    intervals leave this open.

    Args:
        frame: one row per choice: ``name`` (text), ``time, error`` (less is better; null: counted in the
            caption), where known ``time_low, time_high, error_low, error_high`` and ``runs``, and optionally
            ``front`` (true or false) to override the front.
        time_label: of time, with its unit. error_label: of error, with its unit.
        interval: what low and high are.
        percent: whether errors are shares, written in percent.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are the columns named above with ``front`` and ``number`` (null: not on it).

    Raises:
        InputError: the frame is not as described.
    """
    sizes = style_named(style)
    frame = tidy(
        frame, texts=("name",), numbers=("time", "error"),
        optional_numbers=("time_low", "time_high", "error_low", "error_high", "runs"),
    )  # fmt: skip
    check_bounds(frame, "time_low", "time", "time_high")
    check_bounds(frame, "error_low", "error", "error_high")
    numbers = _numbered(frame)
    known = numbers.drop_nulls(["time", "error"])
    chosen = known.filter("front").sort("number")
    named = thinned(chosen, NAMED_UP_TO[sizes.name])
    names = [f"{place}  {name}" for place, name in named.select("number", "name").iter_rows()]
    figure, axes = plain_axes(sizes, time_label, error_label, title=title, legend=names)
    few_ticks(axes.xaxis, sizes)
    if percent:
        percent_axis(axes.yaxis)
    _points(axes, sizes, known)
    _steps(axes, sizes, chosen)
    legend_below(figure, sizes, [_empty_handle() for _ in names], names)
    _numbers_at_points(figure, axes, sizes, named, known)
    runs = run_counts(frame)
    lost = numbers.height - known.height
    caption = (
        f"{error_label} against {time_label}, {known.height} choices{', ' + of_runs(runs) if runs else ''}; less is "
        f"better in both. Full and joined: the {chosen.height} that no other beats in both; "
        f"cross lines: {interval}."
        + (f" {named.height} of them are named." if named.height < chosen.height else "")
        + (f" {lost} without a value are not drawn." if lost else "")
    )
    return Picture(figure, numbers.select(*_COLUMNS, "runs", "front", "number"), caption)


def on_front(time: NDArray[np.float64], error: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points no other dominates (is at least as good in both, and better in one); equal points are
    alike."""
    order = np.lexsort((error, time))
    best, best_time = np.inf, -np.inf
    front = np.zeros(time.size, dtype=bool)
    for place in order:
        if error[place] < best or (error[place] == best and time[place] == best_time):
            front[place] = True
            best, best_time = error[place], time[place]
    return front


def _numbered(frame: pl.DataFrame) -> pl.DataFrame:
    """Return the frame with the columns ``front`` and ``number``."""
    has_front = "front" in frame.columns
    known = (frame["time"].is_not_null() & frame["error"].is_not_null()).to_numpy()
    front = np.zeros(frame.height, dtype=bool)
    if has_front:
        front = frame["front"].cast(pl.Boolean).fill_null(False).to_numpy() & known
    else:
        front[known] = on_front(frame["time"].to_numpy()[known], frame["error"].to_numpy()[known])
    frame = frame.with_columns(front=pl.Series(front))
    places = frame.with_row_index("row").filter("front").sort("time", "error", "row")["row"].to_list()
    number: list[int | None] = [None] * frame.height
    for place, row in enumerate(places, start=1):
        number[row] = place
    return frame.with_columns(number=pl.Series(number, dtype=pl.UInt32))


def _points(axes: Any, style: Style, known: pl.DataFrame) -> None:
    """Draw the points, those on the front last."""
    many = known.height > VECTORS_UP_TO
    line = style.line_pt
    for front, face, edge, order in ((False, PAPER, FAINT, 2), (True, SERIES[0], SERIES[0], 3)):
        part = known.filter(pl.col("front") == front)
        axes.plot(
            part["time"].to_numpy(), part["error"].to_numpy(), ls="", marker="o" if front else "s", zorder=order,
            markersize=style.marker_pt * (1.0 if front else 0.8) * (0.5 if many and not front else 1),
            markerfacecolor=face, markeredgecolor=edge, markeredgewidth=line * 0.7, rasterized=many,
        )  # fmt: skip
        if many and not front:
            continue
        for low, high, other, lines in (
            ("time_low", "time_high", "error", axes.hlines),
            ("error_low", "error_high", "time", axes.vlines),
        ):
            bars = part.drop_nulls([low, high])
            lines(bars[other], bars[low], bars[high], color=edge, linewidth=line * 0.7, zorder=order - 0.5)


def _steps(axes: Any, style: Style, chosen: pl.DataFrame) -> None:
    """Join the points of the front by steps."""
    if chosen.height > 1:
        axes.step(
            chosen["time"], chosen["error"], where="post", color=SERIES[0], linewidth=style.line_pt, zorder=1.5,
            linestyle=(0, (4, 2)),
        )  # fmt: skip


def _empty_handle() -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="")


def _numbers_at_points(
    figure: Any, axes: Any, style: Style, named: pl.DataFrame, known: pl.DataFrame
) -> None:
    """Write each number near its point, where it hides the fewest points and other numbers."""
    figure.draw_without_rendering()
    to_pt = 72 / figure.dpi
    marks = axes.transData.transform(known.select("time", "error").to_numpy()) * to_pt
    box = axes.get_window_extent()
    size, gap = style.small_pt, style.marker_pt * 0.9 + 1
    placed: list[tuple[float, float, float, float]] = []
    for time, error, place in named.select("time", "error", "number").iter_rows():
        x, y = axes.transData.transform((time, error)) * to_pt
        wide, high = width_pt(str(place), size), size * 0.75
        spots = []
        for reach in (1.0, 1.8, 2.8, 4.0):
            for right, up in ((1, 1), (-1, -1), (1, -1), (-1, 1), (0, 1), (0, -1), (1, 0), (-1, 0)):
                left = x + right * gap * reach - wide * (1 - right) / 2
                bottom = y + up * gap * reach - high * (1 - up) / 2
                spots.append((left, bottom, left + wide, bottom + high))
        inside = (box.x0 * to_pt, box.y0 * to_pt, box.x1 * to_pt, box.y1 * to_pt)
        best = min(range(len(spots)), key=lambda spot: (_cost(spots[spot], placed, marks, inside, gap), spot))
        placed.append(spots[best])
        axes.annotate(
            str(place), (time, error), xytext=(spots[best][0] - x, spots[best][1] - y), fontsize=size,
            textcoords="offset points", ha="left", va="bottom", color=INK, zorder=5,
            bbox={"facecolor": PAPER, "edgecolor": "none", "alpha": 0.75, "pad": 0.5},
        )  # fmt: skip


def _cost(
    spot: tuple[float, float, float, float],
    placed: list[tuple[float, float, float, float]],
    marks: NDArray[np.float64],
    inside: tuple[float, float, float, float],
    gap: float,
) -> float:
    """Score a place for a label: overlap with labels and marks, and with the border."""
    left, bottom, right, top = spot
    out = left < inside[0] or bottom < inside[1] or right > inside[2] or top > inside[3] + gap
    covered = sum(
        left < other[2] + 1 and other[0] < right + 1 and bottom < other[3] + 1 and other[1] < top + 1
        for other in placed
    )
    reach = gap * 0.6
    hidden = (
        (marks[:, 0] > left - reach) & (marks[:, 0] < right + reach)
        & (marks[:, 1] > bottom - reach) & (marks[:, 1] < top + reach)
    )  # fmt: skip
    return 100 * out + 30 * covered + float(hidden.sum())
