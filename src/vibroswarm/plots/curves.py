"""Curves: cumulative incidence, belief over time, detection.

Cumulative incidence: right decisions rise from the middle line, wrong ones fall from it; the rest is undecided.
Belief over time: quantiles over robots or runs as nested bands, with the decision thresholds.
Detection: probability of missing a floor over its fill ratio, for each horizon or number of robots.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.plots.error_bars import checked_estimates, draw_estimates, series_handle
from vibroswarm.plots.inputs import check_bounds, most, run_counts, tidy, with_series
from vibroswarm.plots.labels import label_ends
from vibroswarm.plots.layout import (
    few_ticks,
    fitted,
    legend_below,
    log_x,
    name_axes,
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
        frame: one row per time: ``time_s``, ``right, wrong`` (shares so far, 0 to 1), where known their limits
            ``right_low, right_high, wrong_low, wrong_high``, and where there are several ``series`` (text). Each
            share holds from its time on.
        runs: how many, for the caption.
        unit: what is counted, "run" or "robot".
        interval: what low and high are.
        t_end: end of the level part of the curves, s.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``series, time_s, right, right_low, right_high, wrong, wrong_low, wrong_high``,
        thinned as drawn.

    Raises:
        InputError: the frame is not as described, or shares fall with time or add up to more than 1.
    """
    sizes = style_named(style)
    frame = tidy(
        frame, numbers=("time_s", "right", "wrong"), optional_numbers=_BOUNDS,
        complete=("time_s", "right", "wrong"),
    )  # fmt: skip
    frame, series = with_series(frame)
    check_bounds(frame, "right_low", "right", "right_high")
    check_bounds(frame, "wrong_low", "wrong", "wrong_high")
    named = series if len(series) > 1 else []
    figure, axes = plain_axes(sizes, "time (s)", f"share of {unit}s decided", title=title, legend=named)
    few_ticks(axes.xaxis, sizes)
    end = max(most(frame["time_s"]), t_end or 0.0)
    parts = [thinned(_checked(frame.filter(pl.col("series") == name).sort("time_s"))) for name in series]
    looks = looks_of(series)
    for index, part in enumerate(parts):
        _curve(axes, sizes, part, looks[index], index, len(series), end)
    _finish(axes, sizes, parts, end, t_end)
    if not label_ends(figure, axes, sizes, named, looks, [part["right"][-1] for part in parts][: len(named)]):
        legend_below(figure, sizes, [series_handle(sizes, one) for one in looks[: len(named)]], named)
    caption = (
        f"Share of {unit}s that had decided rightly (upwards) and wrongly (downwards) by each time"
        + (f", {of_runs([runs], unit)}" if runs else "")
        + (" each" if runs and len(series) > 1 else "")
        + (f"; bands: {interval}" if frame["right_low"].is_not_null().any() else "")
        + f". Undecided at {number(end, 6)} s: {_undecided(series, parts)}."
    )
    if sum(part.height for part in parts) < frame.height:
        caption += f" Drawn at {STEPS_UP_TO} of the times."
    numbers = pl.concat(parts).select(
        "series", "time_s", "right", "right_low", "right_high", "wrong", "wrong_low", "wrong_high"
    )
    return Picture(figure, numbers, caption)


def thinned(part: pl.DataFrame, up_to: int = STEPS_UP_TO) -> pl.DataFrame:
    """Return at most ``up_to`` rows, evenly spaced, including the first and the last."""
    if part.height <= up_to:
        return part
    return part[[round(index * (part.height - 1) / (up_to - 1)) for index in range(up_to)]]


def _undecided(series: Sequence[str], parts: Sequence[pl.DataFrame]) -> str:
    """Return the share of each series that is undecided at its end, in words."""
    left = [1 - part["right"][-1] - part["wrong"][-1] for part in parts]
    return "; ".join(
        (f"{name} " if name else "") + share(max(rest, 0.0), 1.0)
        for name, rest in zip(series, left, strict=True)
    )


def _checked(part: pl.DataFrame) -> pl.DataFrame:
    """Return the curves as they are.

    Raises:
        InputError: they cannot be cumulative shares.
    """
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
    """Draw the curves of right (upwards) and wrong decisions (downwards) of one series."""
    times = [*part["time_s"], end]
    for kind, sign in (("right", 1.0), ("wrong", -1.0)):
        colour = looks.colour if series > 1 else OUTCOMES[kind]
        ends = [sign * value for value in [*part[kind], part[kind][-1]]]
        bounds = part.select(f"{kind}_low", f"{kind}_high")
        if not bounds.select(pl.any_horizontal(pl.all().is_null().any())).item():
            low, high = (
                [sign * value for value in [*bounds[name], bounds[name][-1]]] for name in bounds.columns
            )
            axes.fill_between(
                times, low, high, step="post", color=colour, alpha=0.22 if series < 3 else 0.13, linewidth=0
            )
        if series > 1:  # bands of several series lie on each other: a strip of the ground below each line
            axes.step(
                times, ends, where="post", color=PAPER, alpha=0.8, linewidth=style.line_pt * 2.2, zorder=2.5
            )
        axes.step(
            times, ends, where="post", color=colour, zorder=3,
            linestyle=looks.line if series > 1 else ("-" if sign > 0 else (0, (4, 1.5))),
        )  # fmt: skip
        if series > 1:  # three marks per curve, to distinguish them in grey print
            at = [round((place + 0.5 + 0.08 * index) / 3.5 * (len(times) - 1)) for place in range(3)]
            at = [i for i in at if ends[i]]  # none has decided there: all curves are alike
            axes.plot(
                [times[i] for i in at], [ends[i] for i in at], ls="", marker=looks.marker, color=looks.colour,
                markerfacecolor=PAPER if looks.hollow else looks.colour, markersize=style.marker_pt, zorder=3,
            )  # fmt: skip


def _finish(axes: Any, style: Style, parts: list[pl.DataFrame], end: float, t_end: float | None) -> None:
    """Set limits, ticks and labels."""
    up = most(*(part[name] for part in parts for name in ("right", "right_high")))
    down = most(*(part[name] for part in parts for name in ("wrong", "wrong_high")))
    span = up + down or 1.0
    axes.set_ylim(-max(1.06 * down, 0.13 * span), max(1.06 * up, 0.13 * span))
    axes.set_xlim(0, end or 1.0)
    axes.axhline(0, color=INK, linewidth=style.line_pt * 0.8, zorder=2)
    percent_axis(axes.yaxis)
    for kind, y, align in (("right", 0.98, "top"), ("wrong", 0.02, "bottom")):
        axes.annotate(
            kind, (0.015, y), xycoords="axes fraction", va=align, ha="left", fontsize=style.small_pt,
            color=INK if len(parts) > 1 else OUTCOMES[kind], fontweight="bold", zorder=4,
        )  # fmt: skip


PANELS_UP_TO = 8


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

    Args:
        frame: one row per time: ``time_s``, and quantiles named by their percent, ``q05, q25, q50, q75, q95`` (two
            digits, or one more behind: ``q025`` is 2.5 %; null: none), where there are several ``series`` (text).
            ``q50`` is required, and all others in pairs about it.
        label: of what is drawn.
        thresholds: levels at which robots decide, dashed.
        boundary: one more level, dotted.
        runs: how many, for the caption.
        unit: what the quantiles are over.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``series, time_s`` and the quantiles, thinned as drawn.

    Raises:
        InputError: the frame is not as described, quantiles are out of order, or there are more than 8 series.
    """
    sizes = style_named(style)
    pairs = quantile_pairs(frame)
    columns = ["q50", *(name for pair in pairs for name in pair)]
    frame, series = with_series(tidy(frame, numbers=("time_s", *columns), complete=("time_s",)))
    _check_order(frame, pairs)
    if len(series) > PANELS_UP_TO:
        raise InputError(f"{len(series)} panels; at most {PANELS_UP_TO}", field="series")
    panel_in = sizes.height_in * (0.62 if len(series) > 1 else 0.8)
    around = sizes.font_pt * (4 if title else 2.5) / 72
    figure = new_figure(sizes, height_in=panel_in * len(series) + around, title=title)
    panels = figure.subplots(len(series), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    parts = [thinned(frame.filter(pl.col("series") == name).sort("time_s")) for name in series]
    for axes, part, name in zip(panels, parts, series, strict=True):
        _panel(axes, sizes, part, pairs, thresholds, boundary)
        name_axes(axes, sizes, "", label, share_of_height=0.8 / len(series))
        if name:
            axes.set_title(
                fitted(name, sizes.small_pt, sizes.width_in * 60), fontsize=sizes.small_pt, loc="left"
            )
    panels[-1].set_xlabel("time (s)")
    panels[0].set_xlim(0, most(frame["time_s"]) or 1.0)
    panels[0].set_ylim(-0.02, 1.02)
    few_ticks(panels[-1].xaxis, sizes)
    bands = " and ".join(f"{_percent(low)} to {_percent(high)}" for low, high in pairs)
    caption = (
        f"{label} over time{': ' + of_runs([runs], 'run') if runs else ''}. Line: median"
        + (f"; bands: {bands} of the {unit}s" if bands else "")
        + (f"; dashed: {' and '.join(number(level) for level in thresholds)}" if thresholds else "")
        + (f"; dotted: {number(boundary)}" if boundary is not None else "")
        + "."
    )
    ordered = sorted(columns, key=_share)
    return Picture(figure, pl.concat(parts).select("series", "time_s", *ordered), caption)


def quantile_pairs(frame: pl.DataFrame) -> list[tuple[str, str]]:
    """Return the quantile columns in pairs about the median, the outermost first.

    Raises:
        InputError: q50 is missing, or a quantile has no partner.
    """
    names = [name for name in frame.columns if re.fullmatch(r"q\d{2,3}", name)]
    if "q50" not in names:
        raise InputError("the frame has no median; name it q50", field="q50")
    by_share = {round(_share(name), 6): name for name in names}
    pairs = []
    for part, name in sorted(by_share.items()):
        if part == 0.5:
            continue
        other = by_share.get(round(1 - part, 6))
        if other is None:
            raise InputError(f"has no partner at {100 * (1 - part):g} %", field=name)
        if part < 0.5:
            pairs.append((name, other))
    return pairs


def _share(name: str) -> float:
    return int(name[1:]) / 10.0 ** len(name[1:])


def _percent(name: str) -> str:
    return f"{100 * _share(name):g} %"


def _check_order(frame: pl.DataFrame, pairs: Sequence[tuple[str, str]]) -> None:
    """Refuse quantiles of which a lower one is above a higher one.

    Raises:
        InputError: they are out of order.
    """
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
    """Draw the bands and the median of a cell, the thresholds and the boundary."""
    times = part["time_s"].to_numpy()
    for depth, (low, high) in enumerate(pairs):
        axes.fill_between(
            times, part[low].to_numpy(), part[high].to_numpy(), color=SERIES[5], linewidth=0,
            alpha=0.2 + 0.25 * depth / max(len(pairs) - 1, 1), zorder=1 + 0.1 * depth,
        )  # fmt: skip
    marker = "o" if part["q50"].drop_nulls().len() < 2 else ""
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
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw the probability of missing over the fill ratio, a curve for each horizon or number of robots.

    Args:
        frame: one row per mark: ``fill_ratio``, ``missed, low, high`` (0 to 1; null: none), where there are several
            ``series`` (text, such as "600 s" or "10 robots"), and where known ``runs``.
        label: of the probability. x_label: of the fill ratio.
        boundary: decision boundary, a vertical line. tolerated: a horizontal line.
        interval: what low and high are.
        log: whether the fill ratio is drawn logarithmically.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``fill_ratio, series, missed, low, high, runs``.

    Raises:
        InputError: the frame is not as described, or a probability is not in 0 to 1.
    """
    sizes = style_named(style)
    frame = tidy(frame, numbers=("fill_ratio", "missed", "low", "high"))
    if frame.select(((pl.col("missed") < 0) | (pl.col("missed") > 1)).any()).item():
        raise InputError("contains a number outside 0 to 1, which is not a probability", field="missed")
    frame, series = checked_estimates(frame.rename({"fill_ratio": "x", "missed": "estimate"}))
    named = series if len(series) > 1 else []
    figure, axes = plain_axes(sizes, x_label, label, title=title, legend=named)
    few_ticks(axes.xaxis, sizes)
    looks = looks_of(series)
    for one, name in zip(looks, series, strict=True):
        draw_estimates(axes, sizes, frame.filter(pl.col("series") == name).sort("x"), one, log=log)
    axes.set_ylim(-0.02, 1.02)
    percent_axis(axes.yaxis)
    if log:
        log_x(axes, frame["x"].to_list())
    lines = []
    if tolerated is not None:
        axes.axhline(tolerated, color=FAINT, linewidth=sizes.line_pt, linestyle=(0, (4, 2)), zorder=1)
        lines.append(f"horizontal line: {number(100 * tolerated)} % tolerated")
    if boundary is not None:
        axes.axvline(boundary, color=FAINT, linewidth=sizes.line_pt, linestyle=(0, (1.5, 1.5)), zorder=1)
        lines.append(f"vertical line: decision boundary {number(boundary)}")
    legend_below(figure, sizes, [series_handle(sizes, one) for one in looks[: len(named)]], named)
    runs = run_counts(frame)
    caption = f"{label} over {x_label}: estimate and {interval}" + (f" over {of_runs(runs)}" if runs else "")
    caption = "; ".join([caption, *lines]) + "."
    numbers = frame.rename({"x": "fill_ratio", "estimate": "missed"})
    return Picture(figure, numbers.select("fill_ratio", "series", "missed", "low", "high", "runs"), caption)
