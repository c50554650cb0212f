"""Histograms of samples, feature by feature, and their pictures: of several sources in one, or side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import number
from vibroswarm.lab.calibrate.features import FEATURES, values_of
from vibroswarm.lab.calibrate.samples import sample_table
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
ACROSS: Final = 2
"""Maps side by side."""


def histograms_of(sources: Mapping[str, Result]) -> pl.DataFrame:
    """Return the histograms of all features: one row for each source, feature and bin.

    Columns: source; feature; x and y, the centre of the bin (y is null for a feature with one column); share, the
    number of values in the bin divided by the number of all values of the source, those beyond the bins included.

    Args:
        sources: results by name; their sessions are pooled.
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
                "y": grid[1].ravel() if len(grid) > 1 else np.full(counts.size, np.nan),
                "share": counts.ravel() / max(len(values), 1),
            }
            named = {"source": pl.lit(source), "feature": pl.lit(feature)}
            frames.append(pl.DataFrame(columns).select(**named, **{name: pl.col(name) for name in columns}))
    return pl.concat(frames).with_columns(pl.col("y").fill_nan(None))


@drawn
def draw_shares(frame: pl.DataFrame, *, x_label: str = "", title: str = "", style: str = "column") -> Picture:
    """Draw histograms of one variable over each other, a step line for each series.

    Args:
        frame: one row per bin: ``x`` (its centre), ``share``, ``series``. x_label: label of the x axis.
        title: text above the picture. style: "column", "page" or "slide".
    Returns:
        Picture; its numbers are ``series, x, share``.
    """
    sizes = style_named(style)
    series = frame["series"].unique(maintain_order=True).to_list()
    figure, axes = plain_axes(sizes, x_label, "share of samples", title=title)
    handles: list[Any] = []
    for index, name in enumerate(series):
        part, looks = frame.filter(pl.col("series") == name).sort("x"), look(index)
        handles += axes.step(
            part["x"].to_numpy(), part["share"].to_numpy(), where="mid", color=looks.colour, linestyle=looks.line,
            linewidth=sizes.line_pt,
        )  # fmt: skip
    axes.set_ylim(bottom=0.0)
    legend_below(figure, sizes, handles, series)
    caption = f"Share of samples by {x_label}, of {len(series)} sources."
    return Picture(figure, frame.select("series", "x", "share"), caption)


@drawn
def draw_maps(frame: pl.DataFrame, feature: str, *, title: str = "", style: str = "column") -> Picture:
    """Draw histograms of two variables side by side, on one grey scale.

    Args:
        frame: one row per bin: ``panel`` (its title), ``x`` and ``y`` (centre of the bin), ``share``.
        feature: name of a feature with two columns, which gives the labels and ranges of the axes.
        title: text above the picture. style: "column", "page" or "slide".
    Returns:
        Picture; its numbers are ``panel, x, y, share``.
    """
    sizes = style_named(style)
    panels = frame.partition_by("panel", maintain_order=True)
    # A panel is about half as wide as the figure, so 0.48 of the width as height makes it nearly square.
    figure = new_figure(sizes, height_in=math.ceil(len(panels) / ACROSS) * sizes.width_in * 0.48, title=title)
    # A single extreme bin of a map must not make all others pale.
    highest = float(np.quantile(frame["share"].to_numpy(), 0.999))
    (left, right), (bottom, top) = SPANS[feature]
    aspect: Any = "auto" if feature == "distances" else "equal"  # both axes of the others are lengths
    for place, axes in enumerate(panels_of(figure, len(panels), ACROSS, sharex=True, sharey=True)):
        # One row per y, ascending, and one column per x, in the order of the frame.
        shares = panels[place].pivot("x", index="y", values="share").sort("y").drop("y").to_numpy()
        axes.imshow(
            shares, origin="lower", extent=(left, right, bottom, top), aspect=aspect, cmap="Greys", vmin=0.0,
            vmax=highest, interpolation="nearest",
        )  # fmt: skip
        axes.set_title(panels[place]["panel"][0], fontsize=sizes.small_pt)
        axes.locator_params(nbins=4)
        axes.xaxis.set_tick_params(labelbottom=place + ACROSS >= len(panels))  # if no panel is below
        axes.tick_params(labelsize=sizes.small_pt)
    figure.supxlabel(AXES[feature][0], fontsize=sizes.font_pt)
    figure.supylabel(AXES[feature][1], fontsize=sizes.font_pt)
    caption = (
        f"Shares of samples by {AXES[feature][0]} and {AXES[feature][1]}; darker is more, up to "
        f"{number(highest, digits=3)}."
    )
    return Picture(figure, frame.select("panel", "x", "y", "share"), caption)
