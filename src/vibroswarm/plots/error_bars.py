"""Error-bar pictures: estimates with their intervals, along a number or cell by cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.plots.inputs import check_bounds, check_once, run_counts, tidy, with_series
from vibroswarm.plots.labels import label_ends
from vibroswarm.plots.layout import (
    few_ticks,
    legend_below,
    legend_lines,
    log_x,
    of_runs,
    percent_axis,
    plain_axes,
    rows_of,
    ticks_at,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, PAPER, Look, Style, looks_of, row_looks, strategy_in, style_named

BAND = 0.2
"""Opacity of a band."""
COLUMNS = ("x", "series", "estimate", "low", "high")


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

    A series that is the same at each x is a line with a band across the picture.

    Args:
        frame: one row per mark: ``x`` (number or text), ``estimate, low, high`` (null: none), where there are
            several ``series`` (text), and where known ``runs``.
        x_label: of a numeric x, with its unit.
        label: of the estimate, with its unit.
        interval: what low and high are, such as "95 % Wilson interval".
        log: whether a numeric x is drawn logarithmically.
        percent: whether estimates are shares, written in percent.
        spans: whether low and high are a range of settings, or a scale, and no interval: drawn as bands, not bars.
        constant: series that do not depend on x; without, those whose values are the same everywhere.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``x, series, estimate, low, high, runs``.

    Raises:
        InputError: the frame is not as described.
    """
    sizes = style_named(style)
    frame, series = checked_estimates(frame)
    if frame.schema["x"].is_numeric():
        figure = _along(sizes, frame, series, (x_label, label), log, percent, spans, constant, title)
    else:
        figure = _rows(sizes, frame, series, label, percent, spans, title)
    missing = frame["estimate"].null_count()
    runs = run_counts(frame)
    caption = f"{label}{f' by {x_label}' if x_label else ''}: estimate and {interval}" + (
        f" over {of_runs(runs)}." if runs else "."
    )
    if missing:
        caption += f" {missing} of {frame.height} have no value."
    return Picture(figure, frame.select(*COLUMNS, "runs"), caption)


def checked_estimates(frame: pl.DataFrame) -> tuple[pl.DataFrame, list[str]]:
    """Check a frame of x, estimate, low, high and series; returns it with the names of the series.

    Raises:
        InputError: the frame is not as described.
    """
    numeric = "x" in frame.columns and frame.schema["x"].is_numeric()
    frame = tidy(
        frame,
        numbers=(*(("x",) if numeric else ()), "estimate", "low", "high"),
        texts=() if numeric else ("x",),
        optional_numbers=("runs",),
        complete=("x",) if numeric else (),
    )
    frame, series = with_series(frame)
    check_once(frame, ["x", "series"])
    check_bounds(frame, "low", "estimate", "high")
    return frame, series


def draw_estimates(
    axes: Any,
    style: Style,
    part: pl.DataFrame,
    looks: Look,
    *,
    shift: float = 0.0,
    log: bool = False,
    spans: bool = False,
) -> None:
    """Draw one series along a numeric x: a line, interrupted by missing values, marks and bars.

    Args:
        part: rows of the series. looks: of the series. shift: along x, in its unit (decades on a logarithmic axis).
        spans: whether bands are drawn instead of bars.
    Raises:
        InputError: x is not positive on a logarithmic axis.
    """
    if log and part["x"].min() <= 0:  # type: ignore[operator]
        raise InputError("a logarithmic axis needs numbers above 0", field="x")
    x = (part["x"] * 10**shift if log else part["x"] + shift).to_numpy()
    line = style.line_pt
    axes.plot(
        x, part["estimate"].to_numpy(), color=looks.colour, linestyle=looks.line, linewidth=line,
        marker=looks.marker, markersize=style.marker_pt, markeredgewidth=line * 0.8, zorder=3,
        markerfacecolor=PAPER if looks.hollow else looks.colour,
    )  # fmt: skip
    bars = part.select("estimate", "low", "high").with_columns(x=pl.Series(x)).drop_nulls()
    if spans:
        axes.fill_between(bars["x"], bars["low"], bars["high"], color=looks.colour, alpha=BAND, linewidth=0)
        return
    axes.vlines(bars["x"], bars["low"], bars["high"], color=looks.colour, linewidth=line, zorder=2.5)
    axes.plot(
        [*bars["x"], *bars["x"]], [*bars["low"], *bars["high"]], ls="", marker="_", color=looks.colour,
        markersize=style.marker_pt, markeredgewidth=line * 0.8, zorder=2.5,
    )  # fmt: skip


def is_constant(part: pl.DataFrame) -> bool:
    """Tell whether a series has the same estimate within the same interval at each of several x.

    A share of none or of all may be the same by chance, so its interval must reach to both sides.
    """
    values = part.select("estimate", "low", "high")
    inside = (values["low"] < values["estimate"]) & (values["estimate"] < values["high"])
    return part.height > 2 and values.unique().height == 1 and bool(inside.fill_null(False).all())


def _constant(axes: Any, style: Style, part: pl.DataFrame, looks: Look) -> None:
    """Draw a series that does not depend on x: a line and a band across the picture."""
    row = part.row(0, named=True)
    axes.axhline(
        row["estimate"], color=looks.colour, linestyle=looks.line, linewidth=style.line_pt, zorder=2.2
    )
    if row["low"] is not None and row["high"] is not None and row["low"] < row["high"]:
        axes.axhspan(row["low"], row["high"], color=looks.colour, alpha=BAND, linewidth=0, zorder=1.5)


def series_handle(style: Style, looks: Look, *, mark: bool = True) -> Any:
    """Return the line and mark of a series in a legend."""
    from matplotlib.lines import Line2D

    return Line2D(
        [], [], color=looks.colour, linestyle=looks.line, marker=looks.marker if mark else "",
        markersize=style.marker_pt, linewidth=style.line_pt,
        markerfacecolor=PAPER if looks.hollow else looks.colour,
    )  # fmt: skip


def _nudge(frame: pl.DataFrame, series: int, log: bool) -> float:
    """Return by how much series at the same x are drawn apart, in x or in decades; 0 if that is not needed."""
    places = frame["x"].unique().sort()
    if log:
        places = places.filter(places > 0).log(10)
    if series < 2 or places.len() < 2:
        return 0.0
    gap, span = float(places.diff().min()), float(places[-1] - places[0])  # type: ignore[arg-type]
    return min(0.6 * gap / series, 0.012 * span)


def _along(
    style: Style,
    frame: pl.DataFrame,
    series: Sequence[str],
    labels: tuple[str, str],
    log: bool,
    percent: bool,
    spans: bool,
    constant: Sequence[str],
    title: str,
) -> Any:
    """Draw the figure along a numeric axis."""
    named = series if len(series) > 1 else []
    figure, axes = plain_axes(style, *labels, title=title, legend=named)
    few_ticks(axes.xaxis, style)
    parts = [frame.filter(pl.col("series") == name).sort("x") for name in series]
    looks = looks_of(series)
    same = [
        name in constant if constant else is_constant(part) for name, part in zip(series, parts, strict=True)
    ]
    varying = [k for k, alike in enumerate(same) if not alike or all(same)]
    nudge = 0.0 if spans else _nudge(frame, len(varying), log)
    merged = _merged(parts, [k for k in range(len(parts)) if k not in varying])
    for index, part in enumerate(parts):
        if index not in varying:
            if index in merged:
                _constant(axes, style, part, looks[index])
            continue
        shift = (varying.index(index) - (len(varying) - 1) / 2) * nudge
        draw_estimates(axes, style, part, looks[index], shift=shift, log=log, spans=spans)
    if log:
        log_x(axes, frame["x"].to_list())
    else:
        ticks_at(axes.xaxis, style, frame["x"].to_list())
    if percent:
        percent_axis(axes.yaxis)
    drawn = [k for k in range(len(named)) if k in varying or k in merged]
    names = [_name_of(named[k], [named[j] for j in merged.get(k, ())]) for k in drawn]
    last = [parts[k]["estimate"].drop_nulls() for k in drawn]
    if all(values.len() for values in last) and label_ends(
        figure, axes, style, names, [looks[k] for k in drawn], [float(values[-1]) for values in last]
    ):
        return figure
    handles = [series_handle(style, looks[k], mark=k in varying) for k in drawn]
    legend_below(figure, style, handles, names)
    return figure


def _merged(parts: Sequence[pl.DataFrame], constant: Sequence[int]) -> dict[int, list[int]]:
    """Return the sets of constant series with equal values: all indices of a set, by its first one."""
    sets: dict[tuple[float, ...], list[int]] = {}
    for k in constant:
        sets.setdefault(parts[k].select("estimate", "low", "high").row(0), []).append(k)
    return {members[0]: members for members in sets.values()}


def _name_of(name: str, alike: Sequence[str]) -> str:
    """Return one name for series drawn as one: their strategy if they have the same, else all names joined."""
    if len(alike) < 2:
        return name
    of = {strategy_in(one) for one in alike}
    common = of.pop() if len(of) == 1 else None
    return common or " = ".join(alike)


def _rows(
    style: Style,
    frame: pl.DataFrame,
    series: Sequence[str],
    label: str,
    percent: bool,
    spans: bool,
    title: str,
) -> Any:
    """Draw the figure with one row for each name."""
    names = frame["x"].unique(maintain_order=True).to_list()
    row_of = {name: row for row, name in enumerate(names)}
    named = list(series) if len(series) > 1 else []
    looks = looks_of(series)
    of_rows = row_looks(names) if not named else {}
    rows = rows_of(style, names, label, series=len(series), title=title, furniture=legend_lines(style, named))
    axes = rows.axes
    for values in frame.to_dicts():
        index = series.index(values["series"])
        y, mark = rows.place(row_of[values["x"]], index, len(series)), of_rows.get(values["x"], looks[index])
        if values["estimate"] is None:
            axes.annotate(
                "no value", (0.02, y), xycoords=("axes fraction", "data"), va="center",
                fontsize=rows.font_pt, color=FAINT,
            )  # fmt: skip
            continue
        if values["low"] is not None and values["high"] is not None:
            axes.plot(
                [values["low"], values["high"]], [y, y], color=mark.colour, zorder=2, solid_capstyle="butt",
                linewidth=rows.line_pt * (5 if spans else 1), alpha=BAND if spans else 1.0,
                marker="" if spans else "|", markersize=style.marker_pt,
            )  # fmt: skip
        axes.plot(
            values["estimate"], y, ls="", marker=mark.marker, markersize=style.marker_pt,
            markeredgecolor=mark.colour, markerfacecolor=PAPER if mark.hollow else mark.colour, zorder=3,
        )  # fmt: skip
    if percent:
        percent_axis(axes.xaxis)
    axes.margins(x=0.05)
    legend_below(rows.figure, style, [series_handle(style, one) for one in looks[: len(named)]], named)
    rows.settle(style)
    return rows.figure
