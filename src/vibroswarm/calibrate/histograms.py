"""Histograms of samples, feature by feature, and their pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.samples import FEATURES, sample_table, values_of
from vibroswarm.core.numbers import number
from vibroswarm.plots.layout import legend_below, new_figure, panels_of, plain_axes
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import look, style_named
from vibroswarm.result import Result

AXES: Final = {
    "avoidance": ("avoidance time (s)", "share of samples"),
    "vibrating": ("energy (RMS)", "share of samples"),
    "still": ("energy (RMS)", "share of samples"),
    "places": ("x (m)", "y (m)"),
    "distances": ("time (s)", "distance (m)"),
    "steps": ("dx (m)", "dy (m)"),
}
"""Labels of the x and the y axis, by feature."""
SPANS: Final = {
    "avoidance": ((0.0, 8.0),),
    "vibrating": ((0.0, 6.0),),
    "still": ((0.0, 3.0),),
    "places": ((0.0, 1.0), (0.0, 1.0)),
    "distances": ((0.0, 1200.0), (0.0, 0.2)),
    "steps": ((-0.2, 0.2), (-0.2, 0.2)),
}
"""Range of each column of a feature, as in the paper's figures."""
BINS: Final = {"avoidance": 40, "vibrating": 48, "still": 48, "places": 15, "distances": 24, "steps": 39}
"""Number of bins along each axis, by feature."""


def histograms_of(sources: Mapping[str, Result]) -> pl.DataFrame:
    """Return the histograms of all features of results by name: one row for each source, feature and bin.

    Columns: source; feature; x and y, the centre of the bin (y is null for a feature with one column); share, the
    number of values in the bin divided by the number of all values of the source, those beyond the bins included.
    """
    frames = []
    for source, result in sources.items():
        samples = sample_table(result)
        for feature in FEATURES:
            values, spans = values_of(samples, feature), SPANS[feature]
            counts, edges = np.histogramdd(values, bins=[BINS[feature]] * len(spans), range=spans)
            grid = np.meshgrid(*((edge[:-1] + edge[1:]) / 2 for edge in edges), indexing="ij")
            columns = {
                "x": grid[0].ravel(),
                "y": grid[1].ravel() if len(grid) > 1 else pl.Series([None] * counts.size, dtype=pl.Float64),
                "share": counts.ravel() / max(len(values), 1),
            }
            names = pl.lit(source).alias("source"), pl.lit(feature).alias("feature")
            frames.append(pl.DataFrame(columns).select(*names, pl.all()))
    return pl.concat(frames)


@drawn
def draw_histograms(frame: pl.DataFrame, feature: str, *, style: str = "column") -> Picture:
    """Draw the histograms of a feature: step lines over each other, or maps side by side on one grey scale.

    Args:
        frame: ``histograms_of``, also of further features. style: "column", "page" or "slide".
    Returns:
        Picture; its numbers are ``source, x, y, share``.
    """
    sizes, own = style_named(style), frame.filter(feature=feature)
    panels = {str(key[0]): part for key, part in own.group_by("source", maintain_order=True)}
    numbers, labels = own.select("source", "x", "y", "share"), AXES[feature]
    if feature in ("avoidance", "vibrating", "still"):
        figure, axes = plain_axes(sizes, *labels)
        for index, part in enumerate(panels.values()):
            looks, points = look(index), (part["x"].to_numpy(), part["share"].to_numpy())
            line: dict[str, Any] = {
                "color": looks.colour,
                "linestyle": looks.line,
                "linewidth": sizes.line_pt,
            }
            axes.step(*points, where="mid", **line)
        axes.set_ylim(bottom=0.0)
        legend_below(figure, sizes, axes.get_lines(), list(panels))
        return Picture(figure, numbers, f"Share of samples by {labels[0]}, of {len(panels)} sources.")
    # A panel is about half as wide as the figure, so 0.48 of the width as height makes it nearly square.
    figure = new_figure(sizes, height_in=math.ceil(len(panels) / 2) * sizes.width_in * 0.48)
    # A single extreme bin of a map must not make all others pale.
    highest = float(np.quantile(own["share"].to_numpy(), 0.999))
    aspect: Any = "auto" if feature == "distances" else "equal"  # both axes of the others are lengths
    all_axes = panels_of(figure, len(panels), 2, sharey=True)
    for axes, (source, part) in zip(all_axes, panels.items(), strict=True):
        shares = part["share"].to_numpy().reshape(BINS[feature], -1).T  # a row per y
        (left, right), (bottom, top) = SPANS[feature]
        axes.imshow(
            shares, origin="lower", extent=(left, right, bottom, top), aspect=aspect, cmap="Greys", vmin=0.0,
            vmax=highest, interpolation="nearest",
        )  # fmt: skip
        axes.set_title(source, fontsize=sizes.small_pt)
    figure.supxlabel(labels[0], fontsize=sizes.font_pt)
    figure.supylabel(labels[1], fontsize=sizes.font_pt)
    caption = f"Shares of samples by {labels[0]} and {labels[1]}; darker is more, up to {number(highest, digits=3)}."
    return Picture(figure, numbers, caption)
