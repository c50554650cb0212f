"""Curves: decided right and wrong over time; probability of missing a floor over its fill ratio; spectra."""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.core.numbers import count, stated_percent
from vibroswarm.plots.error_bars import draw_along, series_handle
from vibroswarm.plots.inputs import most, run_counts, tidy, with_series
from vibroswarm.plots.layout import (
    legend_below,
    number,
    of_runs,
    percent_axis,
    plain_axes,
    share,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, INK, OUTCOMES, Look, looks_of, style_named

STEPS_UP_TO = 1000
"""Rows of a curve; more are thinned evenly, with the first and the last kept."""
LIMITS = ("right_low", "right_high", "wrong_low", "wrong_high")


@drawn
def draw_incidence(
    frame: pl.DataFrame,
    *,
    runs: int | None = None,
    unit: str = "run",
    interval: str = "95 % interval",
    t_end: float | None = None,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw the share of runs decided right (upwards) and wrong (downwards) over time, as steps, up to ``t_end``, s."""
    sizes = style_named(style)
    frame, series = with_series(tidy(frame, numbers=("time_s", "right", "wrong"), optional=LIMITS))
    figure, axes = plain_axes(sizes, "time (s)", f"share of {unit}s decided", title=title)
    end = max(most(frame["time_s"]), t_end or 0.0)
    parts = [thinned(frame.filter(series=name).sort("time_s")) for name in series]
    looks = looks_of(series)
    for part, look in zip(parts, looks, strict=True):
        _incidence(axes, part, look if len(series) > 1 else None, end)
    axes.set_xlim(0, end or 1.0)
    axes.axhline(0, color=INK, linewidth=0.8, zorder=2)
    axes.margins(y=0.12)
    percent_axis(axes.yaxis)
    for kind, y, align in (("right", 0.98, "top"), ("wrong", 0.02, "bottom")):
        axes.annotate(
            kind, (0.015, y), xycoords="axes fraction", va=align, fontsize="small", fontweight="bold"
        )
    if len(series) > 1:
        legend_below(figure, sizes, [series_handle(look, mark=False) for look in looks], series)
    rest = "Undecided" if unit == "robot" else "Without consensus"  # a split run is not undecided
    left = [max(round(1 - part["right"][-1] - part["wrong"][-1], 9), 0.0) for part in parts]
    said = "; ".join(f"{name} {share(one, 1.0)}".strip() for name, one in zip(series, left, strict=True))
    caption = (
        f"Share of {unit}s that had decided rightly (upwards) and wrongly (downwards) by each time"
        + (f", {of_runs([runs], unit)}{' each' if len(series) > 1 else ''}" if runs else "")
        + (f"; bands: {interval}" if frame["right_low"].is_not_null().any() else "")
        + f". {rest} at {number(end, 6)} s: {said}."
    )
    columns = ("right", "right_low", "right_high", "wrong", "wrong_low", "wrong_high")
    return Picture(figure, pl.concat(parts).select("series", "time_s", *columns), caption)


def thinned(part: pl.DataFrame, up_to: int = STEPS_UP_TO) -> pl.DataFrame:
    """Return at most ``up_to`` rows of the frame, evenly spaced by index, including the first and the last."""
    if part.height <= up_to:
        return part
    return part[[round(index * (part.height - 1) / (up_to - 1)) for index in range(up_to)]]


def _incidence(axes: Any, part: pl.DataFrame, look: Look | None, end: float) -> None:
    times = [*part["time_s"], end]
    for kind, sign, line in (("right", 1.0, "-"), ("wrong", -1.0, (0, (4, 1.5)))):
        colour = look.colour if look else OUTCOMES[kind]
        low, middle, high = (
            [None if value is None else sign * value for value in [*part[name], part[name][-1]]]
            for name in (f"{kind}_low", kind, f"{kind}_high")
        )
        if None not in (*low, *high):
            axes.fill_between(times, low, high, step="post", color=colour, alpha=0.18, linewidth=0)
        axes.step(times, middle, where="post", color=colour, zorder=3, linestyle=look.line if look else line)


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
    percent: bool = False,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw the probability of missing a floor over its fill ratio, a curve for each horizon or number of robots."""
    frame = tidy(frame, numbers=("fill_ratio", "missed", "low", "high"), optional=("runs",))
    frame, series = with_series(frame)
    along = frame.rename({"fill_ratio": "x", "missed": "estimate"})
    figure = draw_along(
        style_named(style), along, series, (x_label, label), log=log, percent=True, title=title
    )
    (axes,) = figure.axes
    axes.set_ylim(-0.02, 1.02)
    lines = []
    if tolerated is not None:
        axes.axhline(tolerated, color=FAINT, linestyle="--", zorder=1)
        lines.append(f"horizontal line: {number(100 * tolerated)} % tolerated")
    if boundary is not None:
        axes.axvline(boundary, color=FAINT, linestyle=":", zorder=1)
        lines.append(
            f"vertical line: decision boundary {stated_percent(boundary) if percent else number(boundary)}"
        )
    if percent:
        percent_axis(axes.xaxis)
    runs = run_counts(frame)
    caption = f"{label} over {x_label}: estimate and {interval}" + (f" over {of_runs(runs)}" if runs else "")
    numbers = frame.select("fill_ratio", "series", "missed", "low", "high", "runs")
    return Picture(figure, numbers, "; ".join([caption, *lines]) + ".")


MOST_LABELS = 6
"""Lines whose frequency is written."""


@drawn
def draw_spectrum(
    frame: pl.DataFrame,
    lines: pl.DataFrame,
    *,
    label: str = "amplitude (m/s²)",
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw amplitudes over frequency, logarithmically, with a mark and an interval at each line."""
    sizes = style_named(style)
    frame, series = with_series(tidy(frame, numbers=("hz", "amplitude")))
    figure, axes = plain_axes(sizes, "frequency (Hz)", label, title=title)
    looks = looks_of(series)
    for name, look in zip(series, looks, strict=True):
        part = frame.filter(series=name).sort("hz")
        axes.plot(part["hz"], part["amplitude"], linestyle=look.line, color=look.colour)
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_ylim(low, 1.6 * high)  # room for the frequencies above the lines
    for place, row in enumerate(lines.sort("amplitude", descending=True).iter_rows(named=True)):
        axes.axvspan(row["low"], row["high"], color=FAINT, alpha=0.4, linewidth=0)
        if place < MOST_LABELS:
            at = (row["hz"], row["amplitude"])
            axes.annotate(number(row["hz"], 4), at, ha="center", va="bottom", fontsize="small")
    if len(series) > 1:
        legend_below(figure, sizes, [series_handle(look, mark=False) for look in looks], series)
    bands = f"; bands: 95 % intervals of {count(lines.height, 'line')}" if lines.height else ""
    caption = f"Amplitude of sines in the readings over frequency{bands}."
    return Picture(figure, frame.select("series", "hz", "amplitude"), caption)
