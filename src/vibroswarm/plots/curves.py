"""Curves: cumulative incidence, belief over time, detection.

* Cumulative incidence: right decisions rise from the middle line, wrong ones fall from it; the rest is undecided.
* Belief over time: quantiles over robots or runs as nested bands, with the decision thresholds.
* Detection: probability of missing a floor (no right consensus by the horizon) over its fill ratio, for each horizon or
  number of robots.

A frame with a column ``series`` draws several curves or panels; without it there is one series with an empty name.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import polars as pl

from vibroswarm.core.numbers import percent, stated_percent
from vibroswarm.errors import InputError
from vibroswarm.plots.error_bars import checked_estimates, draw_along, series_handle
from vibroswarm.plots.inputs import check_frame, most, run_counts, tidy, with_series
from vibroswarm.plots.labels import label_ends
from vibroswarm.plots.layout import (
    few_ticks,
    fitted,
    legend_below,
    new_figure,
    number,
    of_runs,
    percent_axis,
    plain_axes,
    share,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, INK, OUTCOMES, PAPER, SERIES, Look, Style, looks_of, style_named

STEPS_UP_TO = 1000
"""Rows of a curve; more are thinned evenly, with the first and the last kept."""

_BOUNDS = ("right_low", "right_high", "wrong_low", "wrong_high")
"""Optional columns of ``draw_incidence``: limits of the shares."""


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
    """Draw the share of runs decided right (upwards) and wrong (downwards) by each time, as steps.

    Args:
        frame: one row per time with the columns ``time_s`` and ``right, wrong`` (shares so far, 0 to 1), if known their
            limits ``right_low, right_high, wrong_low, wrong_high``, and for several curves ``series`` (text). Each
            share holds from its time to the next.
        runs: number of runs, for the caption.
        unit: what is counted, "run" or "robot".
        interval: what the limits are, for the caption.
        t_end: time to which the curves are continued level, s; None, or an earlier time: the last time of the frame.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``series, time_s, right, right_low, right_high, wrong, wrong_low, wrong_high``, at the
        times that are drawn: at most ``STEPS_UP_TO`` for each series.

    Raises:
        InputError: the frame is not as described, shares fall with time, are below 0 or add up to more than 1, or a
            share lies outside its limits.
    """
    sizes = style_named(style)
    frame = tidy(
        frame, numbers=("time_s", "right", "wrong"), optional_numbers=_BOUNDS,
        complete=("time_s", "right", "wrong"),
        bounds=[("right_low", "right", "right_high"), ("wrong_low", "wrong", "wrong_high")],
    )  # fmt: skip
    frame, series = with_series(frame)
    named = series if len(series) > 1 else []  # a single series needs no name
    figure, axes = plain_axes(sizes, "time (s)", f"share of {unit}s decided", title=title)
    few_ticks(axes.xaxis, sizes)
    end = max(most(frame["time_s"]), t_end or 0.0)
    parts = [thinned(_checked(frame.filter(series=name).sort("time_s"))) for name in series]
    looks = looks_of(series)
    for index, part in enumerate(parts):
        _curve(axes, sizes, part, looks[index], index=index, series=len(series), end=end)
    _finish(axes, sizes, parts, end)
    # The names of the series stand at the ends of the curves if they fit there, otherwise in a legend. Lists are cut to
    # the length of ``named``, so that a single series has neither.
    if not label_ends(figure, axes, sizes, named, looks, [part["right"][-1] for part in parts][: len(named)]):
        legend_below(figure, sizes, [series_handle(sizes, one) for one in looks[: len(named)]], named)
    is_thinned = sum(part.height for part in parts) < frame.height
    rest = "Undecided" if unit == "robot" else "Without consensus"  # a split run is not undecided
    caption = (
        f"Share of {unit}s that had decided rightly (upwards) and wrongly (downwards) by each time"
        + (f", {of_runs([runs], unit)}" if runs else "")
        + (" each" if runs and len(series) > 1 else "")
        + (f"; bands: {interval}" if frame["right_low"].is_not_null().any() else "")
        + f". {rest} at {number(end, 6)} s: {_undecided(series, parts)}."
        + (f" Drawn at {STEPS_UP_TO} of the times." if is_thinned else "")
    )
    numbers = pl.concat(parts).select(
        "series", "time_s", "right", "right_low", "right_high", "wrong", "wrong_low", "wrong_high"
    )
    return Picture(figure, numbers, caption)


def thinned(part: pl.DataFrame, up_to: int = STEPS_UP_TO) -> pl.DataFrame:
    """Return at most ``up_to`` rows of the frame, evenly spaced by index, including the first and the last."""
    if part.height <= up_to:
        return part
    return part[[round(index * (part.height - 1) / (up_to - 1)) for index in range(up_to)]]


def _undecided(series: Sequence[str], parts: Sequence[pl.DataFrame]) -> str:
    """Write the share of runs or robots that are undecided at the end of each series: "soft 12 %; none 40 %"."""
    # as exact as ``_checked``: rounding makes a rest of 0 a little more or less
    undecided = [round(1 - part["right"][-1] - part["wrong"][-1], 9) for part in parts]
    return "; ".join(
        (f"{name} " if name else "") + share(max(rest, 0.0), 1.0)
        for name, rest in zip(series, undecided, strict=True)
    )


def _checked(part: pl.DataFrame) -> pl.DataFrame:
    """Refuse shares of a series that fall with time, or do not add up; but for rounding, up to 1e-9."""
    for name in ("right", "wrong"):
        if (part[name].diff().drop_nulls() < -1e-9).any():
            raise InputError("falls with time, which a cumulative share cannot", field=name)
    total = part["right"] + part["wrong"]
    if (total > 1 + 1e-9).any() or (part["right"] < 0).any() or (part["wrong"] < 0).any():
        raise InputError("right and wrong are shares from 0 to 1 that add up to at most 1", field="right")
    return part


def _curve(
    axes: Any, style: Style, part: pl.DataFrame, looks: Look, index: int, series: int, end: float
) -> None:
    """Draw the curves of right (upwards) and wrong decisions (downwards) of one series, with their bands.

    Args:
        part: rows of the series, sorted by time. looks: look of the series; with one series, the colours of the
            outcomes are used instead. index: of this series. series: number of all series.
        end: time to which the last shares are continued, s.
    """
    times = [*part["time_s"], end]
    for kind, sign in (("right", 1.0), ("wrong", -1.0)):
        colour = looks.colour if series > 1 else OUTCOMES[kind]
        # The last value is repeated at ``end``.
        heights = [sign * value for value in [*part[kind], part[kind][-1]]]
        bounds = part.select(f"{kind}_low", f"{kind}_high")
        # A band is drawn only if all its limits are known.
        if not bounds.select(pl.any_horizontal(pl.all().is_null().any())).item():
            low, high = (
                [sign * value for value in [*bounds[name], bounds[name][-1]]] for name in bounds.columns
            )
            # the bands of many series overlap, and must not hide the curves
            opacity = 0.22 if series < 3 else 0.13
            axes.fill_between(times, low, high, step="post", color=colour, alpha=opacity, linewidth=0)
        if series > 1:  # a pale strip below each line, to be seen where the bands of several series overlap
            axes.step(
                times,
                heights,
                where="post",
                color=PAPER,
                alpha=0.8,
                linewidth=style.line_pt * 2.2,
                zorder=2.5,
            )
        # a single series has a solid line for right decisions, and a dashed one for wrong decisions
        axes.step(
            times, heights, where="post", color=colour, zorder=3,
            linestyle=looks.line if series > 1 else ("-" if sign > 0 else (0, (4, 1.5))),
        )  # fmt: skip
        if series > 1:
            # Three marks per curve distinguish the series in grey print. Each series has its marks at other times, so
            # that they do not hide each other.
            # They are at 1/7, 3/7 and 5/7 of the rows for the first series, and a little later for each further one.
            marked = [round((place + 0.5 + 0.08 * index) / 3.5 * (len(times) - 1)) for place in range(3)]
            # There are no marks at 0, where the curves of all series coincide.
            marked = [i for i in marked if heights[i]]
            axes.plot(
                [times[i] for i in marked], [heights[i] for i in marked], ls="", marker=looks.marker,
                color=looks.colour, markerfacecolor=PAPER if looks.hollow else looks.colour,
                markersize=style.marker_pt, zorder=3,
            )  # fmt: skip


def _finish(axes: Any, style: Style, parts: list[pl.DataFrame], end: float) -> None:
    """Set the limits of the axes, draw the middle line, and write "right" above and "wrong" below it.

    Args:
        parts: the curves of each series. end: the latest time drawn, s.
    """
    up = most(*(part[name] for part in parts for name in ("right", "right_high")))  # greatest height above 0
    down = most(*(part[name] for part in parts for name in ("wrong", "wrong_high")))  # greatest depth below 0
    span = up + down or 1.0
    # Each side is high enough for its word, "right" or "wrong", also if no decision was right, or none was wrong.
    axes.set_ylim(-max(1.06 * down, 0.13 * span), max(1.06 * up, 0.13 * span))
    axes.set_xlim(0, end or 1.0)
    axes.axhline(0, color=INK, linewidth=style.line_pt * 0.8, zorder=2)
    percent_axis(axes.yaxis)
    for kind, y, align in (("right", 0.98, "top"), ("wrong", 0.02, "bottom")):
        axes.annotate(
            kind, (0.015, y), xycoords="axes fraction", va=align, ha="left", fontsize=style.small_pt,
            color=INK, fontweight="bold", zorder=4,
        )  # fmt: skip


PANELS_UP_TO = 8
"""Most series of ``draw_belief``."""


@drawn
def draw_belief(
    frame: pl.DataFrame,
    *,
    label: str = "belief",
    thresholds: Sequence[float] = (0.95, 0.05),
    boundary: float | None = 0.5,
    runs: int | None = None,
    unit: str = "run",
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw quantiles over time, one panel per series: bands from pairs of quantiles, a line for the median.

    The axis of values shows 0 to 1. Values outside are not refused, but lie outside the panel.

    Args:
        frame: one row per time with the column ``time_s``, columns of quantiles, and for several panels ``series``
            (text). A quantile is named by its percentage in two digits, ``q05, q25, q50, q75, q95``, or with a decimal
            as a third digit: ``q025`` is 2.5 %. Null is no value. ``q50`` is required; every other quantile needs its
            partner on the other side of the median, such as ``q25`` and ``q75``.
        label: of the values.
        thresholds: levels at which robots decide, drawn dashed.
        boundary: one more level, drawn dotted; None: no such line.
        runs: number of runs, for the caption.
        unit: what the quantiles are taken over, "run" or "robot".
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``series, time_s`` and the quantiles, at the times that are drawn: at most
        ``STEPS_UP_TO`` for each series.

    Raises:
        InputError: the frame is not as described, a quantile is on the wrong side of the median, or there are more than
            ``PANELS_UP_TO`` series.
    """
    sizes = style_named(style)
    check_frame(frame)
    pairs = quantile_pairs(frame)
    columns = ["q50", *(name for pair in pairs for name in pair)]
    frame, series = with_series(tidy(frame, numbers=("time_s", *columns), complete=("time_s",)))
    _check_order(frame, pairs)
    if len(series) > PANELS_UP_TO:
        raise InputError(f"{len(series)} panels; at most {PANELS_UP_TO}", field="series")
    panel_in = sizes.height_in * (0.62 if len(series) > 1 else 0.8)  # several panels are lower
    around = sizes.font_pt * (4 if title else 2.5) / 72  # height of the axis label and the title
    figure = new_figure(sizes, height_in=panel_in * len(series) + around, title=title)
    panels = figure.subplots(len(series), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    parts = [thinned(frame.filter(series=name).sort("time_s")) for name in series]
    for axes, part, name in zip(panels, parts, series, strict=True):
        _panel(axes, sizes, part, pairs, thresholds, boundary)
        axes.set_ylabel(label)
        axes.margins(0.03)
        if name:
            # The title begins at the axis, so that it has less than the width of the picture: 60 of 72 points per inch.
            room_pt = sizes.width_in * 60
            axes.set_title(fitted(name, sizes.small_pt, room_pt), fontsize=sizes.small_pt, loc="left")
    panels[-1].set_xlabel("time (s)")
    panels[0].set_xlim(0, most(frame["time_s"]) or 1.0)
    panels[0].set_ylim(-0.02, 1.02)  # a margin, so that lines at 0 and 1 are visible
    few_ticks(panels[-1].xaxis, sizes)
    over = f"{label} over time{': ' + of_runs([runs], 'run') if runs else ''}"
    ordered = sorted(columns, key=_share_of_quantile)
    return Picture(
        figure,
        pl.concat(parts).select("series", "time_s", *ordered),
        f"{over}. {_lines_of_belief(pairs, unit, thresholds, boundary)}.",
    )


def _lines_of_belief(
    pairs: list[tuple[str, str]], unit: str, thresholds: Sequence[float], boundary: float | None
) -> str:
    """Return what the lines and bands of ``draw_belief`` are, for its caption."""
    bands = " and ".join(f"{_percent(low)} to {_percent(high)}" for low, high in pairs)
    return (
        "Line: median"
        + (f"; bands: {bands} of the {unit}s" if bands else "")
        + (f"; dashed: {' and '.join(number(level) for level in thresholds)}" if thresholds else "")
        + (f"; dotted: {number(boundary)}" if boundary is not None else "")
    )


def quantile_pairs(frame: pl.DataFrame) -> list[tuple[str, str]]:
    """Return the names of the quantile columns in pairs (lower, upper) about the median, the outermost first.

    ``frame`` has columns such as ``q05, q25, q50, q75, q95``, see ``draw_belief``.

    Raises:
        InputError: q50 is missing, two columns are the same quantile, or a quantile has no partner at the same distance
            from the median.
    """
    names = [name for name in frame.columns if re.fullmatch(r"q\d{2,3}", name)]
    if "q50" not in names:
        raise InputError("the frame has no median; name it q50", field="q50")
    by_share = {round(_share_of_quantile(name), 6): name for name in names}
    for name in names:
        same = by_share[round(_share_of_quantile(name), 6)]
        if same != name:  # such as q05 and q050
            raise InputError(f"is the same quantile as {same}", field=name)
    pairs = []
    for level, name in sorted(by_share.items()):
        if level == 0.5:
            continue
        other = by_share.get(round(1 - level, 6))
        if other is None:
            raise InputError(f"has no partner at {100 * (1 - level):g} %", field=name)
        if level < 0.5:
            pairs.append((name, other))
    return pairs


def _share_of_quantile(name: str) -> float:
    return int(name[1:]) / 10.0 ** len(name[1:])


def _percent(name: str) -> str:
    return percent(_share_of_quantile(name), None, digits=6)


def _check_order(frame: pl.DataFrame, pairs: Sequence[tuple[str, str]]) -> None:
    """Refuse a quantile on the wrong side of the median; those on the same side are not compared."""
    for low, high in pairs:
        if frame.select(((pl.col(low) > pl.col("q50")) | (pl.col("q50") > pl.col(high))).any()).item():
            raise InputError(f"quantiles are out of order: {low}, q50, {high}", field=low)


def _panel(
    axes: Any,
    style: Style,
    part: pl.DataFrame,
    pairs: list[tuple[str, str]],
    thresholds: Sequence[float],
    boundary: float | None,
) -> None:
    """Draw the panel of one series: bands between the pairs of quantiles, the median, the thresholds and the boundary.

    Args:
        part: rows of the series, sorted by time. pairs: names of the quantile columns (lower, upper), the outermost
            first; inner bands are darker. thresholds: levels of dashed lines.
        boundary: level of a dotted line; None: no line.
    """
    times = part["time_s"].to_numpy()
    for depth, (low, high) in enumerate(pairs):
        axes.fill_between(
            times, part[low].to_numpy(), part[high].to_numpy(), color=SERIES[5], linewidth=0,
            alpha=0.2 + 0.25 * depth / max(len(pairs) - 1, 1), zorder=1 + 0.1 * depth,
        )  # fmt: skip
    marker = "o" if part["q50"].drop_nulls().len() < 2 else ""  # a line through a single point is invisible
    axes.plot(
        times, part["q50"].to_numpy(), color=SERIES[0], linewidth=style.line_pt * 1.3, marker=marker, zorder=3
    )
    for level in thresholds:
        axes.axhline(level, color=INK, linewidth=style.line_pt * 0.7, linestyle=(0, (4, 2)), zorder=2)
    if boundary is not None:
        axes.axhline(boundary, color=FAINT, linewidth=style.line_pt * 0.7, linestyle=(0, (1, 2)), zorder=2)
    axes.set_yticks([0, 0.5, 1])


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
    """Draw the probability of missing a floor over its fill ratio, with a curve for each horizon or number of robots.

    Args:
        frame: one row per mark with the columns ``fill_ratio`` and ``missed, low, high`` (0 to 1; null: no value), for
            several curves ``series`` (text, such as "600 s" or "10 robots"), and if known ``runs``.
        label: of the probability. x_label: of the fill ratio.
        boundary: the decision boundary, drawn as a vertical line. tolerated: a probability that is tolerated, drawn as
            a horizontal line. None: no line.
        interval: what low and high are, for the caption.
        log: whether the fill ratio is drawn logarithmically.
        percent: whether fill ratios are written in percent, as probabilities always are.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``fill_ratio, series, missed, low, high, runs``.

    Raises:
        InputError: the frame is not as described, ``missed`` is not in 0 to 1 or not in its interval, a curve has two
            rows of the same fill ratio, or ``log`` is true and a fill ratio is not above 0.
    """
    sizes = style_named(style)
    frame = tidy(frame, numbers=("fill_ratio", "missed", "low", "high"))
    if frame.select(((pl.col("missed") < 0) | (pl.col("missed") > 1)).any()).item():
        raise InputError("contains a number outside 0 to 1, which is not a probability", field="missed")
    # The columns get the names that error bars have.
    frame, series = checked_estimates(frame.rename({"fill_ratio": "x", "missed": "estimate"}))
    figure = draw_along(sizes, frame, series, (x_label, label), log=log, percent=True, title=title)
    (axes,) = figure.axes
    axes.set_ylim(-0.02, 1.02)  # a margin, so that marks at 0 and 1 are visible
    lines = []
    if tolerated is not None:
        axes.axhline(tolerated, color=FAINT, linewidth=sizes.line_pt, linestyle=(0, (4, 2)), zorder=1)
        lines.append(f"horizontal line: {number(100 * tolerated)} % tolerated")
    if boundary is not None:
        axes.axvline(boundary, color=FAINT, linewidth=sizes.line_pt, linestyle=(0, (1.5, 1.5)), zorder=1)
        at = stated_percent(boundary) if percent else number(boundary)
        lines.append(f"vertical line: decision boundary {at}")
    if percent:
        percent_axis(axes.xaxis)
    runs = run_counts(frame)
    caption = f"{label} over {x_label}: estimate and {interval}" + (f" over {of_runs(runs)}" if runs else "")
    caption = "; ".join([caption, *lines]) + "."
    numbers = frame.rename({"x": "fill_ratio", "estimate": "missed"})
    return Picture(figure, numbers.select("fill_ratio", "series", "missed", "low", "high", "runs"), caption)
