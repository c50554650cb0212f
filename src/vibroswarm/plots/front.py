"""Time against error of several choices, and their Pareto front."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.plots.curves import thinned
from vibroswarm.plots.inputs import check_bounds, run_counts, tidy
from vibroswarm.plots.labels import label_points
from vibroswarm.plots.layout import few_ticks, legend_below, legend_lines, of_runs, percent_axis, plain_axes
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, PAPER, SERIES, Look, Style, row_looks, style_named

NAMED_UP_TO = {"column": 24, "page": 45, "slide": 24}
"""Most points of the front that are numbered and named below, if their names do not fit beside them; of more, an even
selection."""
DIRECT_UP_TO = 12
"""Most points of which the names stand beside them."""
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
    """Draw time and error of each choice; those on the Pareto front are full, named, and joined by steps.

    Names stand beside the points, or numbers beside them and the names below where they are many or long.

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
    looks = row_looks(known["name"].unique(maintain_order=True).to_list())
    figure, axes = plain_axes(sizes, time_label, error_label, title=title)
    few_ticks(axes.xaxis, sizes)
    if percent:
        percent_axis(axes.yaxis)
    _points(axes, sizes, known, looks)
    _steps(axes, sizes, chosen)
    _write_names(figure, axes, sizes, known, chosen, named)
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


def _write_names(
    figure: Any, axes: Any, sizes: Style, known: pl.DataFrame, chosen: pl.DataFrame, named: pl.DataFrame
) -> None:
    """Write names beside points, or numbers beside them and the names below where they are many or long.

    Args:
        known: what is drawn. chosen: what lies on the front. named: what of it has a name if not all can have one.
    """
    beside = known if known.height <= DIRECT_UP_TO else chosen
    if beside.height > DIRECT_UP_TO or not label_points(
        figure, axes, sizes, _labels(beside, "name"), known, always=False
    ):
        names = [f"{place}  {name}" for place, name in named.select("number", "name").iter_rows()]
        more = max(0, legend_lines(sizes, names) - (7 if sizes.fixed_height else 2))
        figure.set_figheight(figure.get_figheight() + more * sizes.small_pt * 1.4 / 72)
        legend_below(figure, sizes, [_empty_handle() for _ in names], names)
        label_points(figure, axes, sizes, _labels(named, "number"), known, always=True)


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
    """Return the frame with ``front``, whether a choice is on the front, and ``number``, its place there or null.

    A column ``front`` that it has already is kept; choices without time or error are never on the front.
    """
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


def _points(axes: Any, style: Style, known: pl.DataFrame, looks: dict[str, Look]) -> None:
    """Draw the points, those on the front last."""
    many = known.height > VECTORS_UP_TO
    line = style.line_pt
    for front, plain_colour, order in ((False, FAINT, 2), (True, SERIES[0], 3)):
        of_kind = known.filter(pl.col("front") == front)
        parts = of_kind.partition_by("name", maintain_order=True) if looks else [of_kind]
        for part in parts:
            look = looks.get(part["name"][0]) if part.height else None
            edge = plain_colour if look is None else look.colour
            axes.plot(
                part["time"].to_numpy(), part["error"].to_numpy(), ls="", zorder=order, rasterized=many,
                marker=("o" if front else "s") if look is None else look.marker,
                markersize=style.marker_pt * (1.0 if front else 0.8) * (0.5 if many and not front else 1),
                markerfacecolor=edge if front else PAPER, markeredgecolor=edge, markeredgewidth=line * 0.7,
            )  # fmt: skip
            if many and not front:
                continue
            for low, high, other, lines in (
                ("time_low", "time_high", "error", axes.hlines),
                ("error_low", "error_high", "time", axes.vlines),
            ):
                bars = part.drop_nulls([low, high])
                lines(
                    bars[other], bars[low], bars[high], color=edge, linewidth=line * 0.7, zorder=order - 0.5
                )


def _steps(axes: Any, style: Style, chosen: pl.DataFrame) -> None:
    """Join the points of the front by steps."""
    if chosen.height > 1:
        axes.step(
            chosen["time"], chosen["error"], where="post", color=FAINT, linewidth=style.line_pt, zorder=1.5,
            linestyle=(0, (4, 2)),
        )  # fmt: skip


def _empty_handle() -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="")


def _labels(points: pl.DataFrame, column: str) -> list[tuple[float, float, str]]:
    """Return time, error and text of points."""
    return [
        (time, error, str(text)) for time, error, text in points.select("time", "error", column).iter_rows()
    ]
