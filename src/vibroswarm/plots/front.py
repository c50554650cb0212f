"""Time against error of several choices, and their Pareto front: the choices that no other one dominates."""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.plots.inputs import run_counts, tidy
from vibroswarm.plots.layout import legend_below, of_runs, percent_axis, plain_axes
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, PAPER, SERIES, Look, looks_of, style_named
from vibroswarm.statistics.best_group import pareto_front

NAMED_UP_TO = 12
"""Most points that have their names beside them: all, or those of the front."""
IN_ONE: Look = Look(SERIES[0], "o", (0, (4, 2)), "", hollow=False)
"""Look of all points of a picture without series."""
_COLUMNS = ("name", "time", "time_low", "time_high", "error", "error_low", "error_high")


@drawn
def draw_front(
    frame: pl.DataFrame,
    *,
    series: str | None = None,
    time_label: str = "decision time (s)",
    error_label: str = "share of runs not right",
    interval: str = "95 % intervals",
    percent: bool = False,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw time and error of each choice; those on a front have full marks and are joined by steps."""
    limits = ("time_low", "time_high", "error_low", "error_high", "runs")
    sizes = style_named(style)
    frame = tidy(
        frame, texts=("name", series) if series else ("name",), numbers=("time", "error"), optional=limits
    )
    parts = frame.partition_by(series, maintain_order=True) if series else [frame]
    parts = [_with_front(part) for part in parts]
    names = [part[series][0] for part in parts] if series else []
    looks = looks_of(names) if series else [IN_ONE]
    figure, axes = plain_axes(sizes, time_label, error_label, title=title)
    if percent:
        percent_axis(axes.yaxis)
    handles = [_points(axes, part, look) for part, look in zip(parts, looks, strict=True)]
    numbers = pl.concat(parts)
    known = numbers.drop_nulls(["time", "error"])
    named = known if known.height <= NAMED_UP_TO else known.filter("front")
    for name, time, error in () if series else named.select("name", "time", "error").iter_rows():
        axes.annotate(name, (time, error), xytext=(3, 3), textcoords="offset points", fontsize="small")
    legend_below(figure, sizes, handles, names)
    runs, lost = run_counts(frame), numbers.height - known.height
    shown = count(known.height, "choice") + (f", {of_runs(runs)}" if runs else "")
    caption = (
        f"{error_label} against {time_label}, {shown}; less is better in both. Full and joined: those that no other "
        f"{'of the series ' if series else ''}beats in both; cross lines: {interval}."
    )
    if lost:
        caption += f" {lost} without a value are not drawn."
    return Picture(figure, numbers.select(*filter(None, [series]), *_COLUMNS, "runs", "front"), caption)


def _with_front(part: pl.DataFrame) -> pl.DataFrame:
    """Add the column ``front`` if the frame has none; choices without time or error are never on it."""
    known = part["time"].is_not_null() & part["error"].is_not_null()
    if "front" in part.columns:
        return part.with_columns(front=part["front"].cast(pl.Boolean).fill_null(False) & known)
    return part.with_columns(
        front=pl.Series(pareto_front(part["time"].to_numpy(), part["error"].to_numpy())) & known
    )


def _points(axes: Any, part: pl.DataFrame, look: Look) -> Any:
    handle = None
    for front in (False, True):
        of_kind = part.filter(front=front)
        colour = look.colour if front or look is not IN_ONE else FAINT
        for low, high, other, lines in (
            ("time_low", "time_high", "error", axes.hlines),
            ("error_low", "error_high", "time", axes.vlines),
        ):
            bars = of_kind.drop_nulls([low, high, other])
            lines(bars[other], bars[low], bars[high], color=colour, linewidth=0.7)
        (handle,) = axes.plot(
            of_kind["time"].to_numpy(), of_kind["error"].to_numpy(), ls="", marker=look.marker, color=colour,
            markerfacecolor=colour if front else PAPER, zorder=3 if front else 2,
        )  # fmt: skip
    steps = part.filter("front").sort("time", "error")
    axes.step(steps["time"], steps["error"], where="post", color=look.colour, linewidth=0.8, ls=(0, (4, 2)))
    return handle
