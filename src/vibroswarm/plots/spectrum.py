"""Spectra: amplitude over frequency, with the lines that were found."""

from __future__ import annotations

import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.plots.error_bars import series_handle
from vibroswarm.plots.inputs import tidy, with_series
from vibroswarm.plots.layout import legend_below, number, plain_axes
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, looks_of, style_named

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
