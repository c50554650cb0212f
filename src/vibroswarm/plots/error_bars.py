"""Error-bar pictures: estimates with their intervals, along a number or cell by cell.

A frame with a column ``series`` draws several curves or several marks per row; without it there is one series with an
empty name. The look of a series is its colour, marker and line (see ``style``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import polars as pl

from vibroswarm.core.numbers import verb
from vibroswarm.plots.inputs import check_bounds, check_frame, check_once, run_counts, tidy, with_series
from vibroswarm.plots.labels import label_ends
from vibroswarm.plots.layout import (
    few_ticks,
    legend_below,
    log_x,
    of_runs,
    percent_axis,
    plain_axes,
    rows_of,
    ticks_at,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import PAPER, Look, Style, looks_of, row_looks, strategy_in, style_named

BAND = 0.2
"""Opacity of a band that stands for a range."""
COLUMNS = ("x", "series", "estimate", "low", "high")
"""Columns of the numbers of ``draw_error_bars``, besides ``runs``."""


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

    A series that does not depend on a numeric x (a constant series) is drawn as a level line with a band across the
    picture. If all series are constant, they are drawn as curves like any others.

    Args:
        frame: one row per mark with the columns ``x`` (number or text) and ``estimate, low, high`` (null: no value),
            for several series ``series`` (text), and if known ``runs``.
        x_label: of x, with its unit; above the names of rows.
        label: of the estimate, with its unit.
        interval: what low and high are, for the caption, such as "95 % Wilson interval".
        log: whether a numeric x is drawn logarithmically.
        percent: whether estimates are shares, written in percent.
        spans: whether low and high are a range (such as that of several settings) instead of an interval of the
            estimate. Then bands are drawn instead of bars.
        constant: names of the series that do not depend on a numeric x; each is drawn with its values at the least x at
            which it has an estimate. If it is empty, they are detected by their values: see ``is_constant``.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``x, series, estimate, low, high, runs``.

    Raises:
        InputError: the frame is not as described, a series has two rows of the same x, an estimate lies outside its
            interval, or ``log`` is true and an x is not above 0.
    """
    sizes = style_named(style)
    frame, series = checked_estimates(frame)
    if frame.schema["x"].is_numeric():
        figure = draw_along(
            sizes,
            frame,
            series,
            labels=(x_label, label),
            log=log,
            percent=percent,
            spans=spans,
            constant=constant,
            title=title,
        )
    else:
        figure = _rows(
            sizes, frame, series, labels=(x_label, label), percent=percent, spans=spans, title=title
        )
    missing = frame["estimate"].null_count()
    runs = run_counts(frame)
    caption = (
        f"{label}{f' by {x_label}' if x_label else ''}: estimate and {interval}"
        + (f" over {of_runs(runs)}." if runs else ".")
        + (f" {missing} of {frame.height} {verb(missing, 'have', 'has')} no value." if missing else "")
    )
    return Picture(figure, frame.select(*COLUMNS, "runs"), caption)


def checked_estimates(frame: pl.DataFrame) -> tuple[pl.DataFrame, list[str]]:
    """Check the ``frame`` of ``draw_error_bars``, and bring its columns into one form.

    Returns:
        The frame, with the columns ``series`` and ``runs`` in any case, numbers as Float64 and missing numbers as null;
        and the names of the series in order of appearance.
    Raises:
        InputError: the frame is not as ``draw_error_bars`` describes it, a series has two rows of the same x, or an
            estimate lies outside its interval.
    """
    check_frame(frame)
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
    """Draw one series along a numeric x: a line, interrupted at missing values, with marks and bars.

    Args:
        part: rows of the series, sorted by x. looks: look of the series.
        shift: distance by which the series is moved along x, so that bars of several series do not hide each other; in
            the unit of x, or in decades if ``log``.
        log: whether x is drawn logarithmically. spans: whether bands are drawn instead of bars.
    """
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
    """Return whether a series does not depend on x: it has the same estimate and interval at three or more x.

    The interval must extend to both sides of the estimate. Otherwise the estimate may be a share of 0 or 1, which can
    be the same at all x although the series depends on x.
    """
    values = part.select("estimate", "low", "high")
    inside = (values["low"] < values["estimate"]) & (values["estimate"] < values["high"])
    return part.height > 2 and values.unique().height == 1 and bool(inside.fill_null(False).all())


def _constant(axes: Any, style: Style, part: pl.DataFrame, looks: Look) -> None:
    """Draw a series that does not depend on x as a line and a band across the picture.

    ``part`` has the rows of the series, sorted by x. The first row with an estimate is drawn: all are equal
    (``is_constant``), or the caller of ``draw_error_bars`` has named the series in ``constant``. Nothing is drawn if no
    row has an estimate.
    """
    row = _level(part).to_dicts()[0]
    if row["estimate"] is None:
        return
    axes.axhline(
        row["estimate"], color=looks.colour, linestyle=looks.line, linewidth=style.line_pt, zorder=2.2
    )
    if row["low"] is not None and row["high"] is not None and row["low"] < row["high"]:
        axes.axhspan(row["low"], row["high"], color=looks.colour, alpha=BAND, linewidth=0, zorder=1.5)


def _level(part: pl.DataFrame) -> pl.DataFrame:
    """Return the row by which a constant series is drawn: the first with an estimate, or else the first."""
    return part.sort(pl.col("estimate").is_null(), maintain_order=True).head(1)


def series_handle(style: Style, looks: Look, *, mark: bool = True) -> Any:
    """Return a line with the look of a series, for a legend; it has the marker of the series only if ``mark``."""
    from matplotlib.lines import Line2D

    return Line2D(
        [], [], color=looks.colour, linestyle=looks.line, marker=looks.marker if mark else "",
        markersize=style.marker_pt, linewidth=style.line_pt,
        markerfacecolor=PAPER if looks.hollow else looks.colour,
    )  # fmt: skip


def _nudge(frame: pl.DataFrame, series: int, log: bool) -> float:
    """Return the distance by which neighbouring series are moved apart along x, so that their bars are all visible.

    The distance is in the unit of x, or in decades if ``log``. With one series or one x it is 0. ``series`` is the
    number of series.
    """
    places = frame["x"].unique().sort()
    if log:
        places = places.filter(places > 0).log(10)  # ``log_x`` refuses places that are not above 0
    if series < 2 or places.len() < 2:
        return 0.0
    gap, span = float(places.diff().min()), float(places[-1] - places[0])  # type: ignore[arg-type]
    # All series together take at most 0.6 of the distance to the next x, so that marks stay close to their own x. If x
    # are far apart, 1.2 % of the axis is enough to see neighbouring bars apart.
    return min(0.6 * gap / series, 0.012 * span)


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
    """Draw the figure along a numeric axis.

    The other arguments are those of ``draw_error_bars``. Constant series (those that do not depend on x) are drawn as
    level lines, and those with equal values as a single line. But if all series are constant, they are drawn as curves.

    Args:
        style: sizes of the picture. frame, series: as ``checked_estimates`` returns them. labels: of x and y.
    """
    named = series if len(series) > 1 else []
    figure, axes = plain_axes(style, *labels, title=title)
    few_ticks(axes.xaxis, style)
    parts = [frame.filter(series=name).sort("x") for name in series]
    looks = looks_of(series)
    are_constant = [
        name in constant if constant else is_constant(part) for name, part in zip(series, parts, strict=True)
    ]
    # indices of the series that are drawn as curves
    varying = [k for k, is_level in enumerate(are_constant) if not is_level or all(are_constant)]
    # bands may overlap, since they are transparent
    nudge = 0.0 if spans else _nudge(frame, len(varying), log)
    merged = _merged(parts, [k for k in range(len(parts)) if k not in varying])
    for index, part in enumerate(parts):
        if index not in varying:
            # Of constant series with equal values, only the first is drawn: the others would be the same line.
            if index in merged:
                _constant(axes, style, part, looks[index])
            continue
        shift = (varying.index(index) - (len(varying) - 1) / 2) * nudge
        draw_estimates(axes, style, part, looks[index], shift=shift, log=log, spans=spans)
    if percent:
        percent_axis(axes.yaxis)
    with_name = [k for k in range(len(named)) if k in varying or k in merged]  # a single series has no name
    names = [_name_of(named[k], [named[j] for j in merged.get(k, ())]) for k in with_name]
    estimates = [parts[k]["estimate"].drop_nulls() for k in with_name]
    # Names stand at the ends of the curves only if every curve has an end: a series may have no values.
    ends = [float(values[-1]) for values in estimates if values.len()]
    of_named = [looks[k] for k in with_name]
    if len(ends) < len(names) or not label_ends(figure, axes, style, names, of_named, ends):
        handles = [series_handle(style, looks[k], mark=k in varying) for k in with_name]
        legend_below(figure, style, handles, names)
    # After the names, which take width from the axis.
    if log:
        log_x(axes, frame["x"].to_list())
    else:
        ticks_at(figure, axes.xaxis, frame["x"].to_list())
    return figure


def _merged(parts: Sequence[pl.DataFrame], constant: Sequence[int]) -> dict[int, list[int]]:
    """Group the constant series that have equal values: the first index of each group, and all its indices."""
    sets: dict[tuple[float, ...], list[int]] = {}
    for k in constant:
        sets.setdefault(_level(parts[k]).select("estimate", "low", "high").row(0), []).append(k)
    return {members[0]: members for members in sets.values()}


def _name_of(name: str, merged: Sequence[str]) -> str:
    """Return the name of a series or, of several that are drawn as one line, their common strategy or all names."""
    if len(merged) < 2:
        return name
    strategies = {strategy_in(one) for one in merged}
    common = strategies.pop() if len(strategies) == 1 else None
    return common or " = ".join(merged)


def _rows(
    style: Style,
    frame: pl.DataFrame,
    series: Sequence[str],
    labels: tuple[str, str],
    percent: bool,
    spans: bool,
    title: str,
) -> Any:
    """Draw the figure with one row for each name in ``x``.

    ``frame`` and ``series`` are as ``checked_estimates`` returns them; ``labels`` are ``x_label`` and ``label`` of
    ``draw_error_bars``, as are the other arguments.
    """
    names = frame["x"].unique(maintain_order=True).to_list()
    row_of = {name: row for row, name in enumerate(names)}
    named = list(series) if len(series) > 1 else []
    looks = looks_of(series)
    of_rows = row_looks(names) if not named else {}
    rows = rows_of(style, names, labels[1], series=len(series), title=title)
    rows.heading(labels[0], of_names=True)
    axes = rows.axes
    for values in frame.to_dicts():
        index = series.index(values["series"])
        # with one series, rows that are named after strategies have the looks of these strategies
        y, mark = rows.place(row_of[values["x"]], index, len(series)), of_rows.get(values["x"], looks[index])
        estimate = values["estimate"], values["low"], values["high"]
        line: dict[str, Any] = {"linewidth": 5 * rows.line_pt, "alpha": BAND, "marker": ""} if spans else {}
        rows.estimate(style, y, estimate, mark, solid_capstyle="butt", **line)
    if percent:
        percent_axis(axes.xaxis)
    axes.margins(x=0.05)
    legend_below(rows.figure, style, [series_handle(style, one) for one in looks[: len(named)]], named)
    rows.settle(style)  # sets the height of the figure, now that all else is drawn
    return rows.figure
