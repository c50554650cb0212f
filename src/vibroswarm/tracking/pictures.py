"""Pictures of a tracking: paths over the floor, who was seen when, residuals of the clock and of the lens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.plots.layout import legend_below, name_axes, new_figure, plain_axes, rows_of
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, INK, LINE, SERIES_UP_TO, Look, Style, look, style_named
from vibroswarm.tracking.track import GAP_S

Floats = NDArray[np.float64]

DRAWN_S: Final = 0.2
"""Shortest time between two points of a path as it is drawn."""
NEAR_M: Final = 0.004
"""Shortest distance between two such points: a robot that stands adds none."""


def looks_for(robots: Sequence[int]) -> dict[int, Look]:
    """Return a look for each robot; from the thirteenth on they repeat."""
    return {robot: look(k % SERIES_UP_TO) for k, robot in enumerate(robots)}


@drawn
def draw_tracks(
    positions: pl.DataFrame,
    stops: pl.DataFrame,
    floor_markers: Mapping[int, tuple[float, float, float]],
    *,
    style: str = "page",
) -> Picture:
    """Draw where robots were seen, to scale; lines break where they were not seen for more than a second.

    Args:
        positions: ``track.POSITIONS``. stops: ``stops.STOPS``.
        floor_markers: to x, y (m) and angle of their centres.
    Returns: Picture; its numbers are ``robot, time_s, x_m, y_m``, thinned as they are drawn.
    """
    sizes = style_named(style)
    robots = positions["robot"].unique(maintain_order=True).to_list()
    looks = looks_for(robots)
    corners = np.array([[x, y] for x, y, _ in floor_markers.values()] or [[0.0, 0.0]])
    seen = positions.select("x_m", "y_m").to_numpy()
    low = np.minimum(corners.min(axis=0), seen.min(axis=0)) - 0.03
    high = np.maximum(corners.max(axis=0), seen.max(axis=0)) + 0.03
    wide = sizes.width_in * 0.78
    tall = min(max(wide * float(high[1] - low[1]) / float(high[0] - low[0]), 0.4 * wide), 1.6 * wide)
    figure = new_figure(sizes, height_in=tall + 1.0)
    axes: Any = figure.add_subplot()
    name_axes(axes, sizes, "x (m)", "y (m)")
    handles, parts = [], []
    for robot in robots:
        own = _thinned(positions.filter(pl.col("robot") == robot))
        parts.append(own)
        at = own.select("time_s", "x_m", "y_m").to_numpy()
        breaks = np.flatnonzero(np.diff(at[:, 0]) > GAP_S) + 1
        line = np.insert(at[:, 1:], breaks, np.nan, axis=0)
        (handle,) = axes.plot(
            line[:, 0], line[:, 1], color=looks[robot].colour, ls=looks[robot].line, lw=0.7 * sizes.line_pt
        )
        axes.plot(
            *at[0, 1:], marker=looks[robot].marker, ls="", color=looks[robot].colour, ms=1.5 * sizes.marker_pt,
            fillstyle="none" if looks[robot].hollow else "full",
        )  # fmt: skip
        handles.append(handle)
    (stood,) = axes.plot(
        stops["x_m"].to_numpy(), stops["y_m"].to_numpy(), ls="", marker="o", ms=0.8 * sizes.marker_pt,
        color=INK, mfc="none", mew=0.6,
    )  # fmt: skip
    (square,) = axes.plot(corners[:, 0], corners[:, 1], ls="", marker="s", ms=sizes.marker_pt, color=FAINT)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    names = [*(f"robot {robot}" for robot in robots), "stop", "marker of the floor"]
    legend_below(figure, sizes, [*handles, stood, square], names)
    caption = (
        f"Where {len(robots)} robots were seen; larger marks: where each was seen first. Lines break where a robot was "
        f"not seen for more than {GAP_S:g} s. Circles: {stops.height} stops."
    )
    return Picture(figure, pl.concat(parts), caption, style)


def _thinned(own: pl.DataFrame) -> pl.DataFrame:
    """Return the positions of one robot that a picture needs; the ends of its path and of gaps are always kept."""
    at = own.select("time_s", "x_m", "y_m").to_numpy()
    kept = [0]
    for k in range(1, len(at)):
        last = at[kept[-1]]
        moved = np.hypot(*(at[k, 1:] - last[1:])) >= NEAR_M
        gap = at[k, 0] - at[k - 1, 0] > GAP_S
        if gap or k == len(at) - 1 or (moved and at[k, 0] - last[0] >= DRAWN_S):
            kept += [k - 1] if gap and kept[-1] != k - 1 else []
            kept.append(k)
    return own[kept].select("robot", "time_s", "x_m", "y_m")


@drawn
def draw_time_line(
    robots: Sequence[int],
    gaps: pl.DataFrame,
    stops: pl.DataFrame,
    span_s: tuple[float, float],
    moments: Sequence[tuple[int, float]] = (),
    *,
    style: str = "page",
) -> Picture:
    """Draw for each robot when it was seen, when it stood, and when not.

    Args:
        gaps: robot, start_s, end_s. stops: ``stops.STOPS``. span_s: when the video begins and ends.
        moments: robot and time of what else is doubtful.
    Returns: Picture; its numbers are ``robot, mark`` ("gap", "stop", "doubtful")``, start_s, end_s``.
    """
    sizes = style_named(style)
    rows = rows_of(sizes, [f"robot {robot}" for robot in robots], "time in the video (s)", furniture=1)
    axes: Any = rows.axes
    numbers: list[tuple[int, str, float, float]] = []
    handles: dict[str, Any] = {}
    for row, robot in enumerate(robots):
        away = gaps.filter(pl.col("robot") == robot).select("start_s", "end_s").rows()
        stood = stops.filter(pl.col("robot") == robot).select("start_s", "end_s").rows()
        edges = [span_s[0], *(edge for pair in away for edge in pair), span_s[1]]
        seen = [(a, b - a) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a]
        handles["seen"] = axes.broken_barh(seen, (row - 0.3, 0.6), color=LINE)
        if stood:
            bars = [(a, b - a) for a, b in stood]
            handles["stands"] = axes.broken_barh(bars, (row - 0.3, 0.6), color=FAINT, lw=0)
        if away:
            bars = [(a, b - a) for a, b in away]
            handles["not seen"] = axes.broken_barh(
                bars, (row - 0.3, 0.6), facecolor="none", edgecolor=INK, hatch="////", lw=0.8
            )
        own = [time_s for name, time_s in moments if name == robot]
        if own:
            (handles["doubtful"],) = axes.plot(
                own, [row] * len(own), ls="", marker="v", ms=1.4 * sizes.marker_pt, color=INK, mfc="none"
            )
        numbers += [(robot, "gap", a, b) for a, b in away] + [(robot, "stop", a, b) for a, b in stood]
        numbers += [(robot, "doubtful", t, t) for t in own]
    axes.set_xlim(*span_s)
    legend_below(rows.figure, sizes, list(handles.values()), list(handles))
    rows.settle(sizes)
    schema = {"robot": pl.Int64, "mark": pl.String, "start_s": pl.Float64, "end_s": pl.Float64}
    caption = (
        f"When each robot was seen and stood. Gaps of more than {GAP_S:g} s are hatched ({gaps.height}); triangles "
        "mark what else is doubtful."
    )
    return Picture(rows.figure, pl.DataFrame(numbers, schema=schema, orient="row"), caption, style)


@drawn
def draw_clock(matched: pl.DataFrame, *, style: str = "page") -> Picture:
    """Draw by how much samples were logged later than their stops ended, once the clocks are matched.

    Args:
        matched: ``stops.SAMPLES_MATCHED``.
    Returns: Picture; its numbers are those of ``matched`` that have a stop.
    """
    sizes = style_named(style)
    paired = matched.drop_nulls("residual_s")
    robots = sorted(paired["robot"].unique().to_list())
    looks = looks_for(robots)
    names = [f"robot {robot}" for robot in robots]
    figure, axes = plain_axes(
        sizes, "time in the video (s)", "sample later than end of stop (ms)", legend=names
    )
    axes.axhline(0.0, color=FAINT, lw=sizes.line_pt)
    handles = [
        _points(axes, sizes, paired.filter(pl.col("robot") == robot), looks[robot]) for robot in robots
    ]
    legend_below(figure, sizes, handles, names)
    caption = (
        f"Each of {paired.height} samples that match a stop, on the clock that was fitted: earlier by the time in "
        "which a robot has sampled and still stands. A slope is a clock that runs faster; one robot away from the "
        "others is a clock of its own."
    )
    return Picture(figure, paired, caption, style)


def _points(axes: Any, sizes: Style, own: pl.DataFrame, of: Look) -> Any:
    (handle,) = axes.plot(
        own["time_s"].to_numpy(), 1000 * own["residual_s"].to_numpy(), ls="", marker=of.marker, color=of.colour,
        ms=sizes.marker_pt, fillstyle="none" if of.hollow else "full",
    )  # fmt: skip
    return handle


@drawn
def draw_lens(
    size_px: tuple[int, int],
    floor_px: Mapping[int, Floats],
    residuals_px: Mapping[int, Floats],
    robots_px: Floats,
    robot_errors_mm: Floats,
    *,
    style: str = "page",
) -> Picture:
    """Draw, over the picture, how far markers are from where the fitted camera has them.

    Args:
        size_px: width and height. floor_px, residuals_px: by marker, corners and their residuals, (4, 2).
        robots_px: (markers, 2), robots' markers. robot_errors_mm: (markers,), of their corners from a square.
    Returns: Picture; its numbers are ``what`` ("floor", "robot")``, marker, x_px, y_px, error`` (px; of robots mm).
    """
    sizes = style_named(style)
    width, height = size_px
    tall = 0.82 * sizes.width_in * height / width
    figure = new_figure(sizes, height_in=min(tall, 1.2 * sizes.width_in) + 0.9)
    axes: Any = figure.add_subplot()
    name_axes(axes, sizes, "across the picture (px)", "down the picture (px)")
    dots = axes.scatter(
        robots_px[:, 0], robots_px[:, 1], s=8.0 + 60.0 * np.minimum(robot_errors_mm, 2.0), marker="o",
        facecolors="none", edgecolors=FAINT, linewidths=0.6,
    )  # fmt: skip
    rows: list[tuple[str, int | None, float, float, float]] = [
        ("robot", None, float(x), float(y), float(e))
        for (x, y), e in zip(robots_px, robot_errors_mm, strict=True)
    ]
    largest = max((float(np.linalg.norm(r, axis=1).max()) for r in residuals_px.values()), default=1.0)
    longer = 0.06 * width / max(largest, 1e-9)
    for marker, corners in floor_px.items():
        error = residuals_px[marker]
        axes.quiver(
            corners[:, 0], corners[:, 1], error[:, 0] * longer, error[:, 1] * longer, angles="xy",
            scale_units="xy", scale=1, color=INK, width=0.003,
        )  # fmt: skip
        rows += [
            ("floor", marker, float(x), float(y), float(np.hypot(*e)))
            for (x, y), e in zip(corners, error, strict=True)
        ]
    axes.set(xlim=(0, width), ylim=(height, 0), aspect="equal")
    legend_below(figure, sizes, [dots], ["robot's marker; larger: less square"])
    schema = {
        "what": pl.String,
        "marker": pl.Int64,
        "x_px": pl.Float64,
        "y_px": pl.Float64,
        "error": pl.Float64,
    }
    caption = (
        "Arrows: corners of the floor's markers, from where the fitted camera has them to where they were seen, "
        f"{longer:.0f} times as long (longest: {largest:.2f} px). Circles: robots' markers; larger ones are less "
        "square. Circles that grow towards the edge are a lens that does not fit there."
    )
    return Picture(figure, pl.DataFrame(rows, schema=schema, orient="row"), caption, style)


@drawn
def draw_overlap(places_m: Floats, apart_m: Floats, *, most: int = 400, style: str = "page") -> Picture:
    """Draw by how much two cameras differ, over the floor where both see.

    Args:
        places_m, apart_m: (pairs, 2): where, and a camera's place less that of those before it.
        most: arrows, evenly chosen.
    Returns: Picture; its numbers are ``x_m, y_m, dx_mm, dy_mm``, of the arrows.
    """
    sizes = style_named(style)
    chosen = slice(None, None, -(-len(places_m) // most))
    at, by = places_m[chosen], 1000 * apart_m[chosen]
    figure = new_figure(sizes, height_in=0.75 * sizes.width_in)
    axes: Any = figure.add_subplot()
    name_axes(axes, sizes, "x (m)", "y (m)")
    size = float(np.quantile(np.hypot(by[:, 0], by[:, 1]), 0.95))
    span = float(max(np.ptp(at[:, 0]), np.ptp(at[:, 1]), 0.05))
    longer = 0.08 * span / max(size, 1e-9)
    axes.quiver(
        at[:, 0], at[:, 1], by[:, 0] * longer, by[:, 1] * longer, angles="xy", scale_units="xy", scale=1,
        color=INK, width=0.002,
    )  # fmt: skip
    axes.set(aspect="equal")
    axes.margins(0.12)
    numbers = pl.DataFrame({"x_m": at[:, 0], "y_m": at[:, 1], "dx_mm": by[:, 0], "dy_mm": by[:, 1]})
    caption = (
        f"{len(at)} of {len(places_m)} positions that two cameras saw: from the place by the first to that by the "
        f"second, {1000 * longer:.0f} times as long (95 % are shorter than {size:.2f} mm)."
    )
    return Picture(figure, numbers, caption, style)
