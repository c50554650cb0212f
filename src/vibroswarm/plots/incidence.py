"""Cumulative incidence: how many runs had come to a right, and how many to a wrong, decision by each time.

Right decisions rise from the middle line, wrong ones fall from it; what is missing to 100 % is undecided.
"""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.plots.canvas import few_ticks, legend_below, percent_axis, plain_axes
from vibroswarm.plots.error_bars import series_handle
from vibroswarm.plots.frames import check_bounds, most, tidy, with_series
from vibroswarm.plots.palette import INK, OUTCOMES, PAPER, look
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import Style, style_named
from vibroswarm.plots.words import number, of_runs, share

STEPS_UP_TO = 1000
"""Of a curve; more rows than this are thinned evenly, first and last kept."""

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
    """Share of runs that had decided rightly (upwards) and wrongly (downwards) by each time, as steps.

    Args:
        frame: one row a time: ``time_s``, ``right, wrong`` (shares so far, 0 to 1), where known their limits
            ``right_low, right_high, wrong_low, wrong_high``, and where there are several ``series`` (text). A
            time has the share that holds from then on.
        runs: how many, for the caption.
        unit: what is counted, "run" or "robot".
        interval: what low and high are.
        t_end: up to where the curves go on level, s.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``series, time_s, right, right_low, right_high, wrong, wrong_low, wrong_high``,
        thinned as drawn.

    Raises:
        InputError: the frame is not as asked, or shares fall with time or add up to more than 1.
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
    for index, part in enumerate(parts):
        _curve(axes, sizes, part, index, len(series), end)
    _finish(axes, sizes, parts, end, t_end)
    legend_below(figure, sizes, [series_handle(sizes, index) for index in range(len(named))], named)
    left = [1 - part["right"][-1] - part["wrong"][-1] for part in parts]
    caption = (
        f"Share of {unit}s that had decided rightly (upwards) and wrongly (downwards) by each time"
        + (f", {of_runs([runs], unit)}" if runs else "")
        + (" each" if runs and len(series) > 1 else "")
        + (f"; bands: {interval}" if frame["right_low"].is_not_null().any() else "")
        + f". Undecided at {number(end, 6)} s: "
        + "; ".join(
            (f"{name} " if name else "") + share(max(rest, 0.0), 1.0)
            for name, rest in zip(series, left, strict=True)
        )
        + "."
    )
    if sum(part.height for part in parts) < frame.height:
        caption += f" Drawn at {STEPS_UP_TO} of the times."
    numbers = pl.concat(parts).select(
        "series", "time_s", "right", "right_low", "right_high", "wrong", "wrong_low", "wrong_high"
    )
    return Picture(figure, numbers, caption)


def thinned(part: pl.DataFrame, up_to: int = STEPS_UP_TO) -> pl.DataFrame:
    """At most ``up_to`` rows, evenly taken, the first and the last among them."""
    if part.height <= up_to:
        return part
    return part[[round(index * (part.height - 1) / (up_to - 1)) for index in range(up_to)]]


def _checked(part: pl.DataFrame) -> pl.DataFrame:
    for name in ("right", "wrong"):
        if (part[name].diff().drop_nulls() < -1e-9).any():
            raise InputError("falls with time; a share of those decided so far cannot", field=name)
    total = part["right"] + part["wrong"]
    if (total > 1 + 1e-9).any() or (part["right"] < 0).any() or (part["wrong"] < 0).any():
        raise InputError("right and wrong are shares from 0 to 1 that add up to at most 1", field="right")
    return part


def _curve(axes: Any, style: Style, part: pl.DataFrame, index: int, series: int, end: float) -> None:
    looks = look(index)
    times = [*part["time_s"], end]
    for kind, sign in (("right", 1.0), ("wrong", -1.0)):
        colour = looks.colour if series > 1 else OUTCOMES[kind]
        ends = [sign * value for value in [*part[kind], part[kind][-1]]]
        bounds = part.select(f"{kind}_low", f"{kind}_high")
        if not bounds.select(pl.any_horizontal(pl.all().is_null().any())).item():
            low, high = (
                [sign * value for value in [*bounds[name], bounds[name][-1]]] for name in bounds.columns
            )
            axes.fill_between(times, low, high, step="post", color=colour, alpha=0.22, linewidth=0)
        axes.step(
            times, ends, where="post", color=colour, zorder=3,
            linestyle=looks.line if series > 1 else ("-" if sign > 0 else (0, (4, 1.5))),
        )  # fmt: skip
        if series > 1:  # three marks a curve, so that grey print tells them apart
            at = [round((place + 0.5 + 0.08 * index) / 3.5 * (len(times) - 1)) for place in range(3)]
            axes.plot(
                [times[i] for i in at], [ends[i] for i in at], ls="", marker=looks.marker, color=looks.colour,
                markerfacecolor=PAPER if looks.hollow else looks.colour, markersize=style.marker_pt, zorder=3,
            )  # fmt: skip


def _finish(axes: Any, style: Style, parts: list[pl.DataFrame], end: float, t_end: float | None) -> None:
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
