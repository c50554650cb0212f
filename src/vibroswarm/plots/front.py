"""Time against error of several choices, and their Pareto front: the choices that no other one dominates.

A choice dominates another if it is at least as good in time and error, and better in one of them; less is better.
"""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.plots.curves import thinned
from vibroswarm.plots.inputs import run_counts, tidy
from vibroswarm.plots.labels import label_points
from vibroswarm.plots.layout import few_ticks, legend_below, of_runs, percent_axis, plain_axes
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, PAPER, SERIES, Look, Style, row_looks, style_named
from vibroswarm.statistics.fronts import pareto_front

NAMED_UP_TO = {"column": 24, "page": 45, "slide": 24}
"""Most points of the front that get a number and a name below the picture, if the names do not fit beside the points.
Of more points, an evenly spaced selection is named."""
DIRECT_UP_TO = 12
"""Most points that have their names beside them."""
VECTORS_UP_TO = 2000
"""Most points drawn as vectors in SVG and PDF. More are drawn as an image, those off the front smaller and without
intervals."""

_COLUMNS = ("name", "time", "time_low", "time_high", "error", "error_low", "error_high")
"""Columns of the numbers of ``draw_front``, besides ``runs``, ``front`` and ``number``."""


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
    """Draw time and error of each choice; those on the Pareto front have full marks and are joined by steps.

    Names stand beside the points: of all choices if there are at most ``DIRECT_UP_TO``, else of those on the front. If
    they do not fit there, only choices on the front have names: numbers stand beside the points, and numbers with names
    stand below the picture.

    A choice is on the front if no other choice is at least as good in both time and error, and better in one of them.
    Only the estimates are compared: where intervals overlap, it is not certain which choice is better.

    Args:
        frame: one row per choice with the columns ``name`` (text) and ``time, error`` (less is better; a choice with
            null is not drawn, only counted in the caption), if known ``time_low, time_high, error_low, error_high`` and
            ``runs``, and optionally ``front`` (true or false; null: false), which then says what is on the front.
        time_label: of time, with its unit. error_label: of error, with its unit.
        interval: what low and high are, for the caption.
        percent: whether errors are shares, written in percent.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are the columns named above with ``front`` and ``number``, the place on the front by time,
        from 1 (null: not on the front). They include the choices that are not drawn.

    Raises:
        InputError: the frame is not as described, or a time or an error lies outside its interval.
    """
    sizes = style_named(style)
    frame = tidy(
        frame, texts=("name",), numbers=("time", "error"),
        optional_numbers=("time_low", "time_high", "error_low", "error_high", "runs"),
        bounds=[("time_low", "time", "time_high"), ("error_low", "error", "error_high")],
    )  # fmt: skip
    numbers = _numbered(frame)
    known = numbers.drop_nulls(["time", "error"])  # the choices that are drawn
    chosen = known.filter("front").sort("number")  # those on the front
    named = thinned(chosen, NAMED_UP_TO[sizes.name])  # those whose names have room below the picture
    looks = row_looks(known["name"].unique(maintain_order=True).to_list())
    figure, axes = plain_axes(sizes, time_label, error_label, title=title)
    few_ticks(axes.xaxis, sizes)
    if percent:
        percent_axis(axes.yaxis)
    _points(axes, sizes, known, looks)
    _steps(axes, sizes, chosen)
    _write_names(figure, axes, sizes, known, chosen, named)
    runs = run_counts(frame)
    shown = count(known.height, "choice") + (f", {of_runs(runs)}" if runs else "")
    lost = numbers.height - known.height
    caption = (
        f"{error_label} against {time_label}, {shown}; less is better in both. Full and joined: the {chosen.height} "
        f"that no other beats in both; cross lines: {interval}."
        + (f" {named.height} of them are named." if named.height < chosen.height else "")
        + (f" {lost} without a value are not drawn." if lost else "")
    )
    return Picture(figure, numbers.select(*_COLUMNS, "runs", "front", "number"), caption)


def _write_names(
    figure: Any, axes: Any, sizes: Style, known: pl.DataFrame, chosen: pl.DataFrame, named: pl.DataFrame
) -> None:
    """Write names beside points. If they do not fit there, write numbers beside the points and the names below.

    Names do not fit if there are more than ``DIRECT_UP_TO``, or if ``label_points`` writes none: one of them is too
    wide, or would leave the axes or hide a point or another name.

    Args:
        sizes: the style. known: all points that are drawn. chosen: the points on the front.
        named: the points of ``chosen`` that get numbers and names if the names stand below.
    """
    from matplotlib.lines import Line2D

    # If there are few points, all get their names, also those that are not on the front.
    beside = known if known.height <= DIRECT_UP_TO else chosen
    if beside.height > DIRECT_UP_TO or not label_points(
        figure, axes, sizes, _labels(beside, "name"), known, always=False
    ):
        names = [f"{place}  {name}" for place, name in named.select("number", "name").iter_rows()]
        legend_below(figure, sizes, [Line2D([], [], ls="") for _ in names], names)  # of text alone
        label_points(figure, axes, sizes, _labels(named, "number"), known, always=True)


def _numbered(frame: pl.DataFrame) -> pl.DataFrame:
    """Add the columns ``front``, whether a choice is on the front, and ``number``, its place there.

    Places are counted by time, from 1; the number of a choice that is not on the front is null. If the frame already
    has a column ``front``, this column decides. Choices without time or error are never on the front.
    """
    known = (frame["time"].is_not_null() & frame["error"].is_not_null()).to_numpy()
    if "front" in frame.columns:
        front = frame["front"].cast(pl.Boolean).fill_null(False).to_numpy() & known
    else:
        front = pareto_front(frame["time"].to_numpy(), frame["error"].to_numpy())
    frame = frame.with_columns(front=pl.Series(front))
    places = frame.with_row_index("row").filter("front").sort("time", "error", "row")["row"].to_list()
    number_of = {row: place for place, row in enumerate(places, start=1)}
    return frame.with_columns(number=pl.Series(map(number_of.get, range(frame.height)), dtype=pl.UInt32))


def _points(axes: Any, style: Style, known: pl.DataFrame, looks: dict[str, Look]) -> None:
    """Draw the points and their intervals. The points on the front are drawn last, so that they are on top.

    If there are many points, those off the front are smaller and have no intervals.

    Args:
        known: the points. looks: look of each choice by name, if the choices are strategies. If it is empty, all points
            on the front have one colour, and all others another one.
    """
    many = known.height > VECTORS_UP_TO
    line = style.line_pt
    for front, plain_colour, order in ((False, FAINT, 2), (True, SERIES[0], 3)):
        of_kind = known.filter(front=front)
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
    """Join the points of the front by steps, which show the least error that is reached up to each time.

    ``chosen`` has these points, sorted by time.
    """
    if chosen.height > 1:
        axes.step(
            chosen["time"], chosen["error"], where="post", color=FAINT, linewidth=style.line_pt, zorder=1.5,
            linestyle=(0, (4, 2)),
        )  # fmt: skip


def _labels(points: pl.DataFrame, column: str) -> list[tuple[float, float, str]]:
    """Return (time, error, text) for each point, where the text is that of ``column``; see ``label_points``."""
    return [
        (time, error, str(text)) for time, error, text in points.select("time", "error", column).iter_rows()
    ]
