"""Belief over time: quantiles over robots or runs as nested bands, with the thresholds of the decision."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.plots.canvas import few_ticks, name_axes, new_figure
from vibroswarm.plots.frames import most, tidy, with_series
from vibroswarm.plots.incidence import thinned
from vibroswarm.plots.palette import FAINT, INK, SERIES
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import Style, style_named
from vibroswarm.plots.words import fitted, number, of_runs

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
    """Quantiles over time, one panel for each series: bands from pairs of quantiles, a line for the median.

    Args:
        frame: one row a time: ``time_s``, and quantiles named by their percent, ``q05, q25, q50, q75, q95`` (two
            digits, or one more behind: ``q025`` is 2.5 %; null: none), where there are several ``series`` (text).
            Columns must be pairs about ``q50``, which must be there.
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
        InputError: the frame is not as asked, quantiles are out of order, or there are more than 8 series.
    """
    sizes = style_named(style)
    pairs = quantile_pairs(frame)
    columns = ["q50", *(name for pair in pairs for name in pair)]
    frame, series = with_series(tidy(frame, numbers=("time_s", *columns), complete=("time_s",)))
    for low, high in pairs:
        if frame.select(((pl.col(low) > pl.col("q50")) | (pl.col("q50") > pl.col(high))).any()).item():
            raise InputError(f"quantiles are out of order: {low}, q50, {high}", field=low)
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
        f"{label} over time{': ' + of_runs([runs], unit) if runs else ''}. Line: median"
        + (f"; bands: {bands} of the {unit}s" if bands else "")
        + (f"; dashed: {' and '.join(number(level) for level in thresholds)}" if thresholds else "")
        + (f"; dotted: {number(boundary)}" if boundary is not None else "")
        + "."
    )
    ordered = sorted(columns, key=_share)
    return Picture(figure, pl.concat(parts).select("series", "time_s", *ordered), caption)


def quantile_pairs(frame: pl.DataFrame) -> list[tuple[str, str]]:
    """The quantile columns in pairs about the median, the outermost first.

    Raises:
        InputError: there is no q50, or a quantile has no partner.
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


def _panel(
    axes: Any,
    style: Style,
    part: pl.DataFrame,
    pairs: list[tuple[str, str]],
    thresholds: Sequence[float],
    boundary: float | None,
) -> None:
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
