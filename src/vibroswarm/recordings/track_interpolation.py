"""Interpolate a camera's positions by straight lines, as a segment table.

Heading is the direction of the path (cameras and logs do not record it, and turning in place is invisible); a
step of less
than 2 mm counts as standing. Whether a robot turned or avoided between two positions is unknown: all but stops is
``drive``.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.motion.source import SEGMENTS

STANDING_M: Final = 0.002
"""Positions are accurate to a quarter of a millimetre; a smaller step has no usable direction."""
GAP_S: Final = 0.5
"""The camera sees a robot every 0.22 s or 0.44 s; a longer interval is a gap."""

Floats = NDArray[np.float64]


def knots_of(track: pl.DataFrame, samples: pl.DataFrame) -> pl.DataFrame:
    """time_s, x_m, y_m of one robot, ordered by time.

    Args:
        track: of the robot; if empty, the robot is known to stand at its samples' positions during each stop.
        samples: motion rows of the robot.
    """
    names = ["time_s", "x_m", "y_m"]
    if track.height:
        return track.select(names)
    stops = samples.select(pl.col("stop_start_s").alias("time_s"), "x_m", "y_m")
    return (
        pl.concat([stops, samples.select(names)])
        .sort("time_s")
        .unique("time_s", keep="last", maintain_order=True)
    )


def segments_of(run: int, robot: int, knots: pl.DataFrame, samples: pl.DataFrame) -> pl.DataFrame:
    """Segment table of one robot: straight lines between positions; it stands at the first one before."""
    time, x, y = (knots[name].to_numpy() for name in ("time_s", "x_m", "y_m"))
    if time.size and time[0] > 0.0:
        time, x, y = np.append(0.0, time), np.append(x[0], x), np.append(y[0], y)
    heading, speed = _courses(time, x, y)
    stop, end = samples["stop_start_s"].to_numpy(), samples["time_s"].to_numpy()
    middle = time + np.append(np.diff(time), 0.0) / 2
    k = np.searchsorted(end, middle)
    stands = (k < end.size) & (middle > np.append(stop, np.inf)[k])
    kind = np.where(stands, "stop", "drive")
    columns: dict[str, Any] = {
        "run": np.full(time.size, run),
        "robot": np.full(time.size, robot),
        "start_s": time,
        "x_m": x,
        "y_m": y,
        "heading_rad": heading,
        "speed_m_s": speed,
        "turn_rate_rad_s": np.zeros(time.size),
        "kind": kind.tolist(),
    }
    return pl.DataFrame(columns, schema=SEGMENTS, strict=False)


def _courses(time: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Heading and speed from each position to the next."""
    dx, dy, dt = np.diff(x), np.diff(y), np.diff(time)
    step = np.hypot(dx, dy)
    moves = step >= STANDING_M
    heading = np.append(np.where(moves, np.arctan2(dy, dx), np.nan), np.nan)
    speed = np.append(np.divide(step, dt, out=np.zeros_like(step), where=moves & (dt > 0)), 0.0)
    known = np.flatnonzero(~np.isnan(heading))
    if known.size == 0:
        return np.zeros(time.size), speed
    latest = np.maximum(np.searchsorted(known, np.arange(time.size), side="right") - 1, 0)
    return heading[known[latest]], speed


def gaps_of(time_s: Floats) -> tuple[int, float]:
    """Number of gaps in a robot's tracking, and the longest, s (0: none)."""
    gaps = np.diff(time_s)
    gaps = gaps[gaps > GAP_S]
    return gaps.size, float(gaps.max(initial=0.0))
