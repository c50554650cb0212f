"""Picture of a tracking: paths over the floor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.core.numbers import stated
from vibroswarm.lab.tracking.track import GAP_S
from vibroswarm.plots.layout import legend_below, new_figure, to_scale
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import INK, SERIES_UP_TO, look, style_named


@drawn
def draw_tracks(
    positions: pl.DataFrame,
    stops: pl.DataFrame,
    floor_markers: Mapping[int, tuple[float, float, float]],
    *,
    style: str = "page",
) -> Picture:
    """Draw the robots' paths over the floor, to scale; lines break where a robot was not seen for more than a second.

    Args:
        positions: ``track.POSITIONS``, at least one row. stops: ``stops.STOPS``.
        floor_markers: x, y (m) and angle of each floor marker, by its number.
    """
    sizes = style_named(style)
    figure = new_figure(sizes)
    axes: Any = figure.add_subplot()
    handles, names = [], []
    for k, own in enumerate(positions.partition_by("robot", maintain_order=True)):
        time_s, x_m, y_m = (own[name].to_numpy() for name in ("time_s", "x_m", "y_m"))
        breaks = np.flatnonzero(np.diff(time_s) > GAP_S) + 1
        x_m, y_m = (np.insert(each, breaks, np.nan) for each in (x_m, y_m))  # a line breaks at nan
        looks = look(k % SERIES_UP_TO)
        handles += axes.plot(x_m, y_m, color=looks.colour, ls=looks.line, lw=0.7 * sizes.line_pt)
        names.append(f"robot {own['robot'][0]}")
    markers_m = np.array([[x, y] for x, y, _ in floor_markers.values()]).reshape(-1, 2)
    marks = {"stop": stops.select("x_m", "y_m").to_numpy(), "marker of the floor": markers_m}
    for at, shape in zip(marks.values(), ("o", "s"), strict=True):
        handles += axes.plot(*at.T, ls="", marker=shape, ms=0.8 * sizes.marker_pt, color=INK, mfc="none")
    names += marks
    places = np.concatenate([positions.select("x_m", "y_m").to_numpy(), *marks.values()])
    low, high = places.min(axis=0) - 0.03, places.max(axis=0) + 0.03
    axes.set(xlabel="x (m)", ylabel="y (m)", xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    legend_below(figure, sizes, handles, names)
    to_scale(figure, sizes, [axes], float((high - low)[1] / (high - low)[0]))
    caption = f"Lines break where a robot was not seen for more than {stated(GAP_S)} s."
    return Picture(figure, positions.select("robot", "time_s", "x_m", "y_m"), caption, style)
