"""What robots report over time: one panel for each value, one line for each robot."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import count, number
from vibroswarm.plots.inputs import tidy
from vibroswarm.plots.layout import few_ticks, new_figure, panels_of
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import INK, LINES, SERIES, style_named
from vibroswarm.result import Result
from vibroswarm.statistics.over_time import (
    estimates_of,
    report_headings,
    reports_over_time,
    true_number_over_time,
)

MOST_PANELS: Final = 6
"""Most values that are drawn, the first ones."""
ACROSS: Final = 2
"""Panels side by side."""
LARGEST: Final = 1e300
"""Values below this are drawn; the axes of larger ones would overflow."""


def draw_run_reports(result: Result, run: int = 0, *, style: str = "column") -> Picture:
    """Draw what the robots of a run reported over time (``draw_reports``), with the units of reports."""
    told = reports_over_time(result, run)
    told = told.with_columns(pl.when(pl.col("value").abs() < LARGEST).then("value"))  # others cannot be drawn
    headings = report_headings(result, told["name"].unique().to_list())
    truth = true_number_over_time(result, run)
    return draw_reports(told, truth=truth, estimates=estimates_of(result), headings=headings, style=style)


@drawn
def draw_reports(
    frame: pl.DataFrame,
    *,
    truth: float | Sequence[tuple[float, float]] | None = None,
    estimates: Collection[str] = ("estimate",),
    headings: Mapping[str, str] = MappingProxyType({}),
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw what the robots of a run reported over time."""
    frame = tidy(frame, texts=("name",), numbers=("robot", "time_s", "value"))
    every_name = frame["name"].unique(maintain_order=True).to_list()
    names = every_name[:MOST_PANELS]
    sizes = style_named(style)
    down = math.ceil(len(names) / ACROSS)
    given: Any = [] if truth is None else truth
    steps = list(given) if np.ndim(given) else [(0.0, given)]
    figure = new_figure(sizes, height_in=0.62 * sizes.height_in * down + 0.4, title=title)
    for axes, name in zip(panels_of(figure, len(names), ACROSS, sharex=True), names, strict=True):
        _draw_panel(axes, frame.filter(name=name), sizes.line_pt)
        if name in estimates and steps:
            since_s, values = zip(*steps, strict=True)
            end_s = max(frame["time_s"].to_numpy().max(), since_s[-1])
            axes.step([*since_s, end_s], [*values, values[-1]], where="post", color=INK, ls="--", lw=0.8)
        axes.set_title(headings.get(name, name.replace("_", " ")), fontsize="small")
        few_ticks(axes.xaxis, sizes)
        axes.set_xlabel("time (s)")
    robots = frame["robot"].n_unique()
    caption = f"What {count(robots, 'robot')} reported, each line a robot"
    if len(names) < len(every_name):
        caption += f"; the first {len(names)} of {len(every_name)} values"
    if steps and set(names) & set(estimates):
        caption += (
            f"; dashed: the true number{f', {number(steps[0][1], digits=4)}' if len(steps) == 1 else ''}"
        )
    return Picture(figure, frame.select("name", "robot", "time_s", "value"), f"{caption}.")


def _draw_panel(axes: Any, rows: pl.DataFrame, line_pt: float) -> None:
    for k, own in enumerate(rows.sort("robot", "time_s").partition_by("robot", maintain_order=True)):
        looks = {"color": SERIES[k % len(SERIES)], "ls": LINES[k % len(LINES)], "lw": line_pt * 0.7}
        axes.plot(own["time_s"].to_numpy(), own["value"].to_numpy(), drawstyle="steps-post", **looks)
