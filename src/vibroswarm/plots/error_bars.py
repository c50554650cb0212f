"""Error-bar pictures: estimates with their intervals, along a number or cell by cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.core.numbers import verb
from vibroswarm.plots.inputs import run_counts, tidy, with_series
from vibroswarm.plots.layout import legend_below, log_x, of_runs, percent_axis, plain_axes, rows_of, ticks_at
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import PAPER, Look, Style, looks_of, row_looks, style_named

BAND = 0.2
"""Opacity of a band that stands for a range."""
APART = 0.02
"""Distance of neighbouring series along x, as a share of the axis, so that their bars do not hide each other."""


@drawn
def draw_error_bars(
    frame: pl.DataFrame,
    *,
    x_label: str = "",
    label: str = "decision time (s)",
    interval: str = "95 % interval",
    log: bool = False,
    percent: bool = False,
    spans: bool = False,
    constant: Sequence[str] = (),
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw estimates with intervals: over a numeric x as points joined by lines, over names as one row each.

    ``spans``: low and high are a range, drawn as a band. ``constant``: series that do not depend on x.
    """
    sizes, numeric = style_named(style), "x" in frame.columns and frame.schema["x"].is_numeric()
    numbers = ("estimate", "low", "high")
    frame = tidy(
        frame,
        numbers=("x", *numbers) if numeric else numbers,
        texts=() if numeric else ("x",),
        optional=("runs",),
    )
    frame, series = with_series(frame)
    if numeric:
        figure = draw_along(
            sizes,
            frame,
            series,
            (x_label, label),
            log=log,
            percent=percent,
            spans=spans,
            constant=constant,
            title=title,
        )
    else:
        figure = _rows(sizes, frame, series, (x_label, label), percent, spans, title)
    missing, runs = frame["estimate"].null_count(), run_counts(frame)
    caption = (
        f"{label}{f' by {x_label}' if x_label else ''}: estimate and {interval}"
        + (f" over {of_runs(runs)}." if runs else ".")
        + (f" {missing} of {frame.height} {verb(missing, 'have', 'has')} no value." if missing else "")
    )
    return Picture(figure, frame.select("x", "series", *numbers, "runs"), caption)


def draw_along(
    style: Style,
    frame: pl.DataFrame,
    series: Sequence[str],
    labels: tuple[str, str],
    *,
    log: bool,
    percent: bool,
    title: str,
    spans: bool = False,
    constant: Sequence[str] = (),
) -> Any:
    """Draw estimates along a numeric axis; the arguments are those of ``draw_error_bars``, ``labels`` of x and y."""
    figure, axes = plain_axes(style, *labels, title=title)
    looks, varying = looks_of(series), [name for name in series if name not in constant]
    span = 1.0 if log else float(np.ptp(frame["x"].drop_nulls().to_numpy()))
    for name, look in zip(series, looks, strict=True):
        part = frame.filter(series=name).sort("x")
        if name in constant:
            _level(axes, part.drop_nulls("estimate").head(1), look)
        else:
            place = varying.index(name) - (len(varying) - 1) / 2
            _curve(axes, part, look, 0.0 if spans else place * APART * span, log=log, spans=spans)
    if percent:
        percent_axis(axes.yaxis)
    if log:
        log_x(axes)
    else:
        ticks_at(axes.xaxis, frame["x"].to_list())
    if len(series) > 1:
        legend_below(figure, style, [series_handle(look) for look in looks], series)
    return figure


def _curve(axes: Any, part: pl.DataFrame, look: Look, shift: float, *, log: bool, spans: bool) -> None:
    """Draw one series: a line, interrupted at missing values, with marks and bars; ``shift`` is in x or decades."""
    x = (part["x"] * 10**shift if log else part["x"] + shift).to_numpy()
    axes.plot(
        x, part["estimate"].to_numpy(), color=look.colour, linestyle=look.line, marker=look.marker, zorder=3,
        markerfacecolor=PAPER if look.hollow else look.colour,
    )  # fmt: skip
    bars = part.select("low", "high").with_columns(x=pl.Series(x)).drop_nulls()
    if spans:
        axes.fill_between(bars["x"], bars["low"], bars["high"], color=look.colour, alpha=BAND, linewidth=0)
        return
    axes.vlines(bars["x"], bars["low"], bars["high"], color=look.colour, zorder=2.5)
    for end in ("low", "high"):
        axes.plot(bars["x"], bars[end], ls="", marker="_", color=look.colour, zorder=2.5)


def _level(axes: Any, row: pl.DataFrame, look: Look) -> None:
    for estimate, low, high in row.select("estimate", "low", "high").iter_rows():
        axes.axhline(estimate, color=look.colour, linestyle=look.line, zorder=2.2)
        if None not in (low, high):
            axes.axhspan(low, high, color=look.colour, alpha=BAND, linewidth=0, zorder=1.5)


def series_handle(look: Look, *, mark: bool = True) -> Any:
    """Return a line with the look of a series, for a legend; it has its marker only if ``mark``."""
    from matplotlib.lines import Line2D

    return Line2D(
        [], [], color=look.colour, linestyle=look.line, marker=look.marker if mark else "",
        markerfacecolor=PAPER if look.hollow else look.colour,
    )  # fmt: skip


def _rows(
    style: Style,
    frame: pl.DataFrame,
    series: Sequence[str],
    labels: tuple[str, str],
    percent: bool,
    spans: bool,
    title: str,
) -> Any:
    names = frame["x"].unique(maintain_order=True).to_list()
    looks, of_rows = looks_of(series), row_looks(names) if len(series) == 1 else {}
    rows = rows_of(style, names, labels[1], series=len(series), title=title)
    rows.heading(labels[0], of_names=True)
    line: dict[str, Any] = {"linewidth": 5 * style.line_pt, "alpha": BAND, "marker": ""} if spans else {}
    for values in frame.to_dicts():
        index = series.index(values["series"])
        y, look = (
            rows.place(names.index(values["x"]), index, len(series)),
            of_rows.get(values["x"], looks[index]),
        )
        rows.estimate(y, (values["estimate"], values["low"], values["high"]), look, **line)
    if percent:
        percent_axis(rows.axes.xaxis)
    rows.axes.margins(x=0.05)
    if len(series) > 1:
        legend_below(rows.figure, style, [series_handle(look) for look in looks], series)
    return rows.figure
