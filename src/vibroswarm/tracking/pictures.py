"""Pictures of a tracking: paths over the floor, when each robot was seen, and errors of the clock and of the lens.

Each function returns a ``Picture``: the figure, the numbers that it shows as a table, and a caption.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import count, number, stated, verb
from vibroswarm.plots.layout import legend_below, new_figure, plain_axes, rows_of, to_scale
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, INK, LINE, SERIES_UP_TO, Look, Style, look, style_named
from vibroswarm.tracking.track import GAP_S

DRAWN_S: Final = 0.2
"""Shortest time between two points of a path as it is drawn."""
NEAR_M: Final = 0.004
"""Shortest distance between two points of a path as it is drawn, so that a robot that stands adds none."""


def looks_for(robots: Sequence[int]) -> dict[int, Look]:
    """Return colour, line and marker for each robot (by name); they repeat after ``SERIES_UP_TO`` robots."""
    return {robot: look(k % SERIES_UP_TO) for k, robot in enumerate(robots)}


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
    Returns: the picture; its numbers are ``robot, time_s, x_m, y_m`` of the points that are drawn.
    """
    sizes = style_named(style)
    robots = positions["robot"].unique(maintain_order=True).to_list()
    looks = looks_for(robots)
    # Centres of the floor's markers (``corners``, as they are near the arena's corners); if there are none, the arena's
    # lower left corner, so that the limits below are defined.
    corners = np.array([[x, y] for x, y, _ in floor_markers.values()] or [[0.0, 0.0]])
    seen = positions.select("x_m", "y_m").to_numpy()
    margin_m = 0.03  # around positions and floor markers
    low = np.minimum(corners.min(axis=0), seen.min(axis=0)) - margin_m
    high = np.maximum(corners.max(axis=0), seen.max(axis=0)) + margin_m
    figure = new_figure(sizes)
    axes: Any = figure.add_subplot()
    axes.set(xlabel="x (m)", ylabel="y (m)")
    handles, parts = [], []
    for robot in robots:
        all_of_robot = positions.filter(pl.col("robot") == robot)
        own = _thinned(all_of_robot)
        parts.append(own)
        at = own.select("time_s", "x_m", "y_m").to_numpy()
        # First positions after a gap; positions are also left out where a robot stands, which is no gap.
        time_s = all_of_robot["time_s"].to_numpy()
        breaks = np.flatnonzero(np.isin(at[:, 0], time_s[1:][np.diff(time_s) > GAP_S]))
        line = np.insert(at[:, 1:], breaks, np.nan, axis=0)  # a line breaks at nan
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
    drawn_at = corners[: len(floor_markers)]
    (square,) = axes.plot(drawn_at[:, 0], drawn_at[:, 1], ls="", marker="s", ms=sizes.marker_pt, color=FAINT)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    names = [f"robot {robot}" for robot in robots]
    for handle, name, is_there in (
        (stood, "stop", stops.height),
        (square, "marker of the floor", floor_markers),
    ):
        if is_there:
            handles.append(handle)
            names.append(name)
    legend_below(figure, sizes, handles, names)
    to_scale(figure, sizes, [axes], float((high - low)[1] / (high - low)[0]))
    caption = (
        f"Where {count(len(robots), 'robot')} {verb(len(robots), 'were', 'was')} seen; larger marks: where each was "
        f"seen first. Lines break where a robot was not seen for more than {stated(GAP_S)} s."
        + (f" Circles: {count(stops.height, 'stop')}." if stops.height else "")
    )
    return Picture(figure, pl.concat(parts), caption, style)


def _thinned(own: pl.DataFrame) -> pl.DataFrame:
    """Return the positions of one robot that a picture needs: at least ``DRAWN_S`` and ``NEAR_M`` apart.

    The first and the last position, and those before and after a gap, are always among them.

    Args:
        own: ``track.POSITIONS`` of the robot, sorted by time.
    Returns: robot, time_s, x_m, y_m.
    """
    at = own.select("time_s", "x_m", "y_m").to_numpy()
    drawn_rows = [0]
    for k in range(1, len(at)):
        last = at[drawn_rows[-1]]  # the last position that is drawn
        has_moved = np.hypot(*(at[k, 1:] - last[1:])) >= NEAR_M
        after_gap = at[k, 0] - at[k - 1, 0] > GAP_S
        if after_gap or k == len(at) - 1 or (has_moved and at[k, 0] - last[0] >= DRAWN_S):
            if after_gap and drawn_rows[-1] != k - 1:
                drawn_rows.append(k - 1)  # the position before the gap
            drawn_rows.append(k)
    return own[drawn_rows].select("robot", "time_s", "x_m", "y_m")


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
    """Draw a row for each robot: when it was seen, when it stood, when it was not seen, and doubtful moments.

    Args:
        robots: their names. gaps: result of ``Tracking.gaps``, which are in the order of time for each robot.
        stops: ``stops.STOPS``.
        span_s: when the video begins and ends. moments: robot and time of each doubt that is not about a gap.
    Returns: the picture; its numbers are ``robot, mark, start_s, end_s``, with the marks gap, stop and doubtful.
    """
    sizes = style_named(style)
    rows = rows_of(sizes, [f"robot {robot}" for robot in robots], "time in the video (s)")
    axes: Any = rows.axes
    numbers: list[tuple[int, str, float, float]] = []
    handles: dict[str, Any] = {}
    for row, robot in enumerate(robots):
        away = gaps.filter(pl.col("robot") == robot).select("start_s", "end_s").rows()
        stood = stops.filter(pl.col("robot") == robot).select("start_s", "end_s").rows()
        height = (row - 0.3, 0.6)  # lower end and height of the bars of this row
        # The robot was seen from the beginning to the first gap, between gaps, and from the last gap to the end.
        edges_s = [span_s[0], *(edge_s for gap in away for edge_s in gap), span_s[1]]
        seen = [
            (start_s, end_s)
            for start_s, end_s in zip(edges_s[::2], edges_s[1::2], strict=True)
            if end_s > start_s
        ]
        for words, spans, looks in (
            ("seen", seen, {"color": LINE}),
            ("stands", stood, {"color": FAINT, "lw": 0}),
            ("not seen", away, {"facecolor": "none", "edgecolor": INK, "hatch": "////", "lw": 0.8}),
        ):
            if spans:
                bars = [(start_s, end_s - start_s) for start_s, end_s in spans]
                handles[words] = axes.broken_barh(bars, height, **looks)
        times_s = [time_s for name, time_s in moments if name == robot]
        if times_s:
            (handles["doubtful"],) = axes.plot(
                times_s,
                [row] * len(times_s),
                ls="",
                marker="v",
                ms=1.4 * sizes.marker_pt,
                color=INK,
                mfc="none",
            )
        numbers += [(robot, "gap", start_s, end_s) for start_s, end_s in away]
        numbers += [(robot, "stop", start_s, end_s) for start_s, end_s in stood]
        numbers += [(robot, "doubtful", time_s, time_s) for time_s in times_s]
    if span_s[0] < span_s[1]:  # a video of one frame has no length
        axes.set_xlim(*span_s)
    legend_below(rows.figure, sizes, list(handles.values()), list(handles))
    schema = {"robot": pl.Int64, "mark": pl.String, "start_s": pl.Float64, "end_s": pl.Float64}
    caption = (
        f"When each robot was seen and stood. Gaps of more than {stated(GAP_S)} s are hatched ({gaps.height}); "
        f"triangles "
        "mark what else is doubtful."
    )
    return Picture(rows.figure, pl.DataFrame(numbers, schema=schema, orient="row"), caption, style)


@drawn
def draw_clock(matched: pl.DataFrame, *, style: str = "page") -> Picture:
    """Draw how much later than expected samples were taken, after the clocks were matched.

    A sample is expected one control period before the end of its stop.

    Args:
        matched: ``stops.SAMPLES_MATCHED``.
    Returns: the picture; its numbers are the rows of ``matched`` that have a stop whose end was seen.
    """
    sizes = style_named(style)
    paired = matched.drop_nulls("residual_s")
    robots = sorted(paired["robot"].unique().to_list())
    looks = looks_for(robots)
    names = [f"robot {robot}" for robot in robots]
    figure, axes = plain_axes(sizes, "time in the video (s)", "sample later than expected (ms)")
    axes.axhline(0.0, color=FAINT, lw=sizes.line_pt)
    handles = [
        _points(axes, sizes, paired.filter(pl.col("robot") == robot), looks[robot]) for robot in robots
    ]
    legend_below(figure, sizes, handles, names)
    caption = (
        f"Each of the {paired.height} samples that match a stop, on the fitted clock. A robot is expected to sample "
        "one control period before its stop ends: this is 0. A slope means that the log's clock runs faster or slower "
        "than the video's; a robot away from the others has a clock of its own."
    )
    return Picture(figure, paired, caption, style)


def _points(axes: Any, sizes: Style, own: pl.DataFrame, robot_look: Look) -> Any:
    """Draw the residuals, ms, of one robot's samples over time; return the handle for the legend."""
    (handle,) = axes.plot(
        own["time_s"].to_numpy(), 1000 * own["residual_s"].to_numpy(), ls="", marker=robot_look.marker,
        color=robot_look.colour, ms=sizes.marker_pt, fillstyle="none" if robot_look.hollow else "full",
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
    """Draw the errors of the fitted camera at the places in the image where markers were seen.

    Each corner of a floor marker has an arrow, magnified, in the direction from where the fitted camera has the corner
    to where it was seen. Each detection of a robot's marker has a circle that grows with its error.

    Args:
        size_px: width and height of the image.
        floor_px: corners of each floor marker as seen, (4, 2), by its number.
        residuals_px: errors of these corners (``doubts.floor_residuals``), (4, 2), by the marker's number.
        robots_px: centres of robots' markers in several frames (``doubts.square_residuals``), (detections, 2).
        robot_errors_mm: root mean square distance of the corners of each from those of a square, (detections,).
    Returns: the picture; its numbers are ``what, marker, x_px, y_px, error``. ``what`` is floor (a row per corner; the
        error is in px) or robot (a row per detection; the marker is null, and the error is in mm).
    """
    sizes = style_named(style)
    width, height = size_px
    figure = new_figure(sizes)
    axes: Any = figure.add_subplot()
    axes.set(xlabel="across the picture (px)", ylabel="down the picture (px)")
    # The area of a circle (points^2) grows with the error of the marker, up to an error of 2 mm.
    dots = axes.scatter(
        robots_px[:, 0], robots_px[:, 1], s=8.0 + 60.0 * np.minimum(robot_errors_mm, 2.0), marker="o",
        facecolors="none", edgecolors=FAINT, linewidths=0.6,
    )  # fmt: skip
    rows: list[tuple[str, int | None, float, float, float]] = [  # rows of the picture's numbers
        ("robot", None, float(x), float(y), float(error_mm))
        for (x, y), error_mm in zip(robots_px, robot_errors_mm, strict=True)
    ]
    largest = max(
        (float(np.linalg.norm(errors, axis=1).max()) for errors in residuals_px.values()), default=1.0
    )
    # The longest arrow takes 6 % of the width. The maximum avoids a division by 0 if all errors are 0.
    magnified = 0.06 * width / max(largest, 1e-9)
    for marker, corners in floor_px.items():
        error = residuals_px[marker]
        axes.quiver(
            corners[:, 0], corners[:, 1], error[:, 0] * magnified, error[:, 1] * magnified, angles="xy",
            scale_units="xy", scale=1, color=INK, width=0.003,
        )  # fmt: skip
        rows += [
            ("floor", marker, float(x), float(y), float(np.hypot(*e)))
            for (x, y), e in zip(corners, error, strict=True)
        ]
    axes.set(xlim=(0, width), ylim=(height, 0), aspect="equal")
    legend_below(figure, sizes, [dots], ["robot's marker; larger: less square"])
    to_scale(figure, sizes, [axes], height / width)
    schema = {
        "what": pl.String,
        "marker": pl.Int64,
        "x_px": pl.Float64,
        "y_px": pl.Float64,
        "error": pl.Float64,
    }
    caption = (
        "Arrows: corners of the floor's markers, from where the fitted camera has them to where they were seen, "
        f"{number(magnified, 0)} times as long (longest: {number(largest, 2)} px). Circles: robots' markers; "
        f"larger ones are less "
        "square. Circles that grow towards the edge are a lens that does not fit there."
    )
    return Picture(figure, pl.DataFrame(rows, schema=schema, orient="row"), caption, style)
