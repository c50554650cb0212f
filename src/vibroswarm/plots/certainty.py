"""A map of probabilities and how uncertain it is, side by side, legible in grey and for the colour-blind."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.plots.layout import few_ticks, new_figure, to_scale
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import COLOUR_MAP, INK, PAPER, style_named


@drawn
def draw_certainty(
    probability: NDArray[np.float64],
    size_m: tuple[float, float],
    places_m: NDArray[np.float64],
    *,
    marked_m: Sequence[tuple[float, float, float, float, bool]] = (),
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw the probability of damage, and its standard deviation with the places of the samples."""
    from matplotlib.patches import Ellipse, Rectangle

    sizes = style_named(style)
    figure = new_figure(sizes, title=title)
    doubt = np.sqrt(probability * (1.0 - probability))
    panels: Any = figure.subplots(1, 2)
    shown = (("probability", probability, 1.0), ("standard deviation", doubt, 0.5))
    for axes, (name, values, most) in zip(panels, shown, strict=True):
        image = _image(axes, values, size_m, most)
        axes.set_xlabel("x (m)")
        few_ticks(axes.xaxis, sizes)
        figure.colorbar(image, ax=axes, location="top", pad=0.03, label=name)
    panels[0].set_ylabel("y (m)")
    # Places outside the surface must not make this map smaller than the one beside it.
    panels[1].plot(
        *places_m.T, ls="", marker=".", ms=1.2, color=PAPER, markeredgecolor=INK, mew=0.15, rasterized=True,
        scalex=False, scaley=False,
    )  # fmt: skip
    for axes, (left, bottom, width, height, is_disc) in product(panels, marked_m):
        for line in ({"edgecolor": PAPER, "lw": 1.6}, {"edgecolor": INK, "lw": 0.8, "ls": "--"}):
            centre = (left + 0.5 * width, bottom + 0.5 * height)
            outline = Ellipse(centre, width, height) if is_disc else Rectangle((left, bottom), width, height)
            outline.set(fill=False, **line)
            axes.add_patch(outline)
    to_scale(figure, sizes, panels[:1], size_m[1] / size_m[0])
    row, column = (index.ravel() for index in np.indices(probability.shape))
    cells = {"probability": probability.ravel(), "standard_deviation": doubt.ravel()}
    caption = "Left: probability of damage. Right: its standard deviation, and the places of the samples."
    caption = f"{caption} Outlined: called patches." if marked_m else caption
    return Picture(figure, pl.DataFrame({"row": row, "column": column, **cells}), caption)


def _image(axes: Any, values: NDArray[np.float64], size_m: tuple[float, float], most: float) -> Any:
    extent = (0.0, size_m[0], 0.0, size_m[1])
    return axes.imshow(values, cmap=COLOUR_MAP, vmin=0.0, vmax=most, extent=extent, interpolation="nearest")
