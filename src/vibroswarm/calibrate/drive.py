"""Measure how robots drive: speed, its variation between and within robots, battery, veer.

| name | symbol | unit | equation |
|---|---|---|---|
| speed | v | m/s | distance over time of steps between tracked positions; without tracks, of whole drives |
| speed at the start | v_0 | m/s | of v = v_0 (1 - t / life), by least squares for each robot and session |
| drop | - | - | T / life: share of the speed lost in T = 1200 s |
| sd between, within | - | m/s | standard deviation of robots' mean speeds; of a robot's speed about its line |
| share between | - | - | between^2 / (between^2 + within^2) |
| veer | w | rad/s | slope of the course against time while driving, anticlockwise positive; its sd likewise |

A drive lies between two samples of a robot without avoidance or turn in between, recognised by its usual duration
(``CALM_S``). The first and last step, in which the robot starts and stops, are left out.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.features import sample_table
from vibroswarm.motion.pose import pose
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

Floats = NDArray[np.float64]

CALM_S: Final = 0.3
"""A drive lasts the median of the intervals without avoidance, within this tolerance."""
LEAST_M: Final = 0.05
SPAN_S: Final = 1200.0
STEP_S: Final = 0.22
"""Interval at which simulated paths are sampled, as a camera does."""
MOST_VEER: Final = np.radians(40.0)
"""A steeper course is an undetected turn."""

DRIVES: Final = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "time_s": pl.Float64,
    "speed_m_s": pl.Float64,
    "veer_rad_s": pl.Float64,
}


LEAST_DRIVES: Final = 10
"""Robots with fewer drives are left out, and those with fewer measured veers have no veer."""


def drive_table(result: Result) -> pl.DataFrame:
    """Return one row per drive (``DRIVES``); veer is null where there is no track or too short a course."""
    table = sample_table(result).join(
        result.motion.select("run", "robot", "sample", "stop_start_s"), on=["run", "robot", "sample"]
    )
    table = table.with_columns(since_s=pl.col("time_s").shift(1).over("run", "robot"))
    calm = table.filter((pl.col("avoid_s") < 1e-9) & (pl.col("distance_m") > LEAST_M))
    lasting = calm["spacing_s"].median()
    drives = calm.filter((pl.col("spacing_s") - lasting).abs() <= CALM_S)
    rows: list[tuple[int, int, float, float, float | None]] = []
    for (run, robot), own in drives.group_by("run", "robot", maintain_order=True):
        track = track_of(result, int(run), int(robot))
        for time_s, since_s, stop_s, distance_m in own.select(
            "time_s", "since_s", "stop_start_s", "distance_m"
        ).iter_rows():
            seen = None if track is None else _on_track(track, since_s, stop_s)
            if track is not None and seen is None:
                continue
            speed, veer = seen if seen is not None else (distance_m / (stop_s - since_s), None)
            if veer is None or abs(veer) < MOST_VEER:
                rows.append((int(run), int(robot), time_s, speed, veer))
    return pl.DataFrame(rows, schema=DRIVES, orient="row")


def track_of(result: Result, run: int, robot: int) -> Floats | None:
    """Return a robot's path as a camera saw it or would have seen it, (positions, 3): s, m, m; None if unknown."""
    if isinstance(result, Recording):
        own = result.tracks.filter((pl.col("run") == run) & (pl.col("robot") == robot))
        return own.select("time_s", "x_m", "y_m").to_numpy() if own.height else None
    if result.segments is None:
        return None
    end_s = float(result.ends.filter((pl.col("run") == run) & (pl.col("robot") == robot))["end_s"][0])
    times = np.arange(0.0, end_s, STEP_S)
    poses = pose(result.segments, run, robot, times)
    return np.column_stack([times, poses[:, 0], poses[:, 1]])


def _on_track(track: Floats, since_s: float, until_s: float) -> tuple[float, float] | None:
    """Return the speed and veer of one drive without its first and last steps; None: too short, or the robot stood."""
    first, last = np.searchsorted(track[:, 0], [since_s, until_s])
    time, x, y = track[first:last].T
    if time.size < 7:
        return None
    dx, dy, dt = (each[2:-1] - each[1:-2] for each in (x, y, time))
    step = np.hypot(dx, dy)
    if step.min() < 0.2 * _median(step) or step.min() <= 0.0:
        return None
    course = np.arctan2(dy, dx)
    if np.abs(np.diff(course)).max() >= math.pi:  # np.unwrap is slow and rarely needed
        course = np.unwrap(course)
    middle = ((time[1:] + time[:-1]) / 2)[1:-1]
    middle = middle - middle.mean()
    slope = float(middle @ course / (middle @ middle))  # least squares
    return float(step.sum() / dt.sum()), slope


def _median(values: Floats) -> float:
    """``np.median``, faster for few numbers."""
    half, odd = divmod(values.size, 2)
    ordered = np.sort(values)
    return float(ordered[half] if odd else (ordered[half - 1] + ordered[half]) / 2)


def drive_of(drives: pl.DataFrame) -> dict[str, float | None]:
    """Return the statistics of one session's drives by name; None with too few drives, or for the veer without paths.

    ``lag_one``: correlation of a robot's speed with that of its next drive, about its own line.
    """
    own = [
        robot_drives
        for robot_drives in drives.partition_by("robot", maintain_order=True)
        if robot_drives.height >= LEAST_DRIVES
    ]
    fits = np.array([_robot(robot_drives) for robot_drives in own]).reshape(-1, 7)
    mean, start, drop, within, lag, veers, veers_within = (column[~np.isnan(column)] for column in fits.T)
    between = float(mean.std(ddof=1)) if mean.size > 1 else None
    spread = float(np.sqrt((within**2).mean())) if within.size else None
    shared = between is not None and spread is not None
    return {
        "speed_m_s": _mean(mean),
        "start_speed_m_s": _mean(start),
        "drop": _mean(drop),
        "between_m_s": between,
        "within_m_s": spread,
        "share_between": between**2 / (between**2 + spread**2) if shared else None,  # type: ignore[operator]
        "lag_one": _mean(lag),
        "veer_rad_s": _mean(veers),
        "veer_between_rad_s": float(np.std(veers, ddof=1)) if veers.size > 1 else None,
        "veer_within_rad_s": _mean(veers_within),
    }


def _mean(values: Floats) -> float | None:
    return float(values.mean()) if values.size else None


def _robot(own: pl.DataFrame) -> tuple[float, ...]:
    """Return the mean speed, speed at the start, drop, spread within, lag-1 correlation, veer and its spread (nan: too
    few)."""
    time, speed = own["time_s"].to_numpy(), own["speed_m_s"].to_numpy()
    slope, start = np.polyfit(time, speed, 1)
    rest = speed - (start + slope * time)
    square = float((rest**2).mean())
    veer = own["veer_rad_s"].drop_nulls().to_numpy()
    lag = float((rest[1:] * rest[:-1]).mean()) / square if square > 0 else 0.0
    veers = (float(veer.mean()), float(veer.std(ddof=1))) if veer.size >= LEAST_DRIVES else (math.nan,) * 2
    return (
        float(speed.mean()),
        float(start),
        float(-slope * SPAN_S / start),
        float(np.sqrt(square)),
        lag,
        *veers,
    )
