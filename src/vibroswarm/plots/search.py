"""Searches over their iterations: scores, and the parameters of their candidates."""

from __future__ import annotations

from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.plots.error_bars import series_handle
from vibroswarm.plots.inputs import tidy, with_series
from vibroswarm.plots.labels import label_of
from vibroswarm.plots.layout import legend_below, number, plain_axes, whole_ticks
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, SERIES, look, style_named

CURVES: Final = {"best": "best as the search believes", "mean": "mean of the candidates"}
"""Columns that are drawn as curves, and their names."""


@drawn
def draw_search(
    frame: pl.DataFrame,
    personal: pl.DataFrame | None = None,
    *,
    label: str = "score",
    true: float | None = None,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw the scores of a search over its iterations."""
    sizes = style_named(style)
    frame = tidy(frame, numbers=("iteration", "best", "mean")).sort("iteration")
    figure, axes = plain_axes(sizes, "iteration", label, title=title)
    handles = {}
    for index, (column, name) in enumerate(CURVES.items()):
        looks = look(index)
        mark = "o" if frame.height == 1 else ""
        (handles[name],) = axes.plot(
            frame["iteration"], frame[column], color=looks.colour, linestyle=looks.line, marker=mark, zorder=3
        )
    if personal is not None:
        own = tidy(personal, numbers=("iteration", "particle", "score")).sort("iteration")
        for _, part in own.group_by("particle", maintain_order=True):
            (handles["best of each particle"],) = axes.plot(
                part["iteration"], part["score"], color=FAINT, alpha=0.5, linewidth=0.5, zorder=2
            )
    if true is not None:  # in a colour and a line that no other curve has
        handles["true, on fresh runs"] = axes.axhline(true, color=SERIES[4], linestyle=look(2).line)
    if not axes.dataLim.y0 < 0:
        axes.set_ylim(bottom=0)
    whole_ticks(axes.xaxis)
    legend_below(figure, sizes, list(handles.values()), list(handles))
    caption = f"{label} over {count(frame.height, 'iteration')}: the best so far and the mean of the candidates tried."
    if true is not None:
        caption += (
            f" On fresh runs the winner's is {number(true, digits=4)}; below it: selection bias or chance."
        )
    return Picture(figure, frame.select("iteration", "best", "mean"), caption)


@drawn
def draw_parameters(frame: pl.DataFrame, *, title: str = "", style: str = "column") -> Picture:
    """Draw the mean of each field over the candidates of an iteration, as a fraction of the field's range."""
    sizes = style_named(style)
    frame, series = with_series(tidy(frame, numbers=("iteration", "share")))
    figure, axes = plain_axes(sizes, "iteration", "mean, share of its bounds", title=title)
    handles: list[Any] = [series_handle(look(index)) for index in range(len(series))]
    for name, line in zip(series, handles, strict=True):
        part = frame.filter(series=name).sort("iteration")
        line.set_data(part["iteration"], part["share"])
        line.set_markevery(max(part.height // 8, 1))
        axes.add_line(line)
    axes.autoscale_view()
    axes.set_ylim(-0.02, 1.02)
    whole_ticks(axes.xaxis)
    if any(series):
        names = [label_of(name).text if "." in name else name for name in series]
        legend_below(figure, sizes, [series_handle(look(index)) for index in range(len(series))], names)
    caption = "Mean of each field over the candidates of an iteration: 0 is its lower bound, 1 its upper."
    return Picture(figure, frame.select("iteration", "series", "share"), caption)
