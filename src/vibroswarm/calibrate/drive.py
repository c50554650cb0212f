"""How robots drive, from recordings in closed form: speed, its spread between and within robots, battery, veer.

| name | symbol | unit | equation |
|---|---|---|---|
| speed | v | m/s | distance over time of the steps between places seen while driving; without tracks, of whole drives |
| speed at the start | v_0 | m/s | of v = v_0 (1 - t / life), by least squares for each robot and session |
| drop | - | - | T / life: share of the speed lost in T = 1200 s |
| spread between, within | - | m/s | standard deviation of robots' mean speeds; of a robot's about its line |
| share between | - | - | between^2 / (between^2 + within^2) |
| veer | w | rad/s | slope of the course against time while driving, anticlockwise positive; its spread likewise |

A drive is what lies between two samples of a robot with no avoidance and no turn between them: its length in time is
that of most (``CALM_S``). The first and last step, in which it starts and stops, are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.features import sample_table
from vibroswarm.lab.recording import Recording
from vibroswarm.motion.pose import pose
from vibroswarm.result import Result

Floats = NDArray[np.float64]

CALM_S: Final = 0.3
"""A drive lasts the median of those without avoidance, give or take this."""
LEAST_M: Final = 0.05
SPAN_S: Final = 1200.0
STEP_S: Final = 0.22
"""Of simulated paths, which are known at any time: as a camera would see them."""
MOST_VEER: Final = np.radians(40.0)
"""A steeper course is a turn that was missed."""

DRIVES: Final = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "time_s": pl.Float64,
    "speed_m_s": pl.Float64,
    "veer_rad_s": pl.Float64,
}


@dataclass(frozen=True)
class Drive:
    """How the robots of one session drive; None: it cannot be told (too few drives, or no paths)."""

    drives: int
    speed_m_s: float | None
    start_speed_m_s: float | None
    drop: float | None
    between_m_s: float | None
    within_m_s: float | None
    share_between: float | None
    lag_one: float | None
    """Correlation of a robot's speed with that of its next drive, about its own line."""
    veer_rad_s: float | None
    veer_between_rad_s: float | None
    veer_within_rad_s: float | None


def drive_table(result: Result) -> pl.DataFrame:
    """One row a drive (``DRIVES``); veer is null where paths are not known, or the course is too short."""
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
    """A robot's path as a camera saw it or would have, (places, 3): s, m, m; None where it is not known."""
    if isinstance(result, Recording):
        own = result.tracks.filter((pl.col("run") == run) & (pl.col("robot") == robot))
        return own.select("time_s", "x_m", "y_m").to_numpy() if own.height else None
    if result.segments is None:
        return None
    end_s = float(result.ends.filter((pl.col("run") == run) & (pl.col("robot") == robot))["end_s"][0])
    times = np.arange(0.0, end_s, STEP_S)
    where = pose(result.segments, run, robot, times)
    return np.column_stack([times, where[:, 0], where[:, 1]])


def _on_track(track: Floats, since_s: float, until_s: float) -> tuple[float, float] | None:
    """Speed and veer of one drive from its steps but the first and last; None: fewer than four, or it stood."""
    first, last = np.searchsorted(track[:, 0], [since_s, until_s])
    time, x, y = track[first:last].T
    if time.size < 7:
        return None
    dx, dy, dt = (each[2:-1] - each[1:-2] for each in (x, y, time))
    step = np.hypot(dx, dy)
    if step.min() < 0.2 * _median(step) or step.min() <= 0.0:
        return None
    course = np.arctan2(dy, dx)
    if np.abs(np.diff(course)).max() >= math.pi:  # for most there is nothing to unwrap
        course = np.unwrap(course)
    middle = ((time[1:] + time[:-1]) / 2)[1:-1]
    middle = middle - middle.mean()
    slope = float(middle @ course / (middle @ middle))  # least squares
    return float(step.sum() / dt.sum()), slope


def _median(values: Floats) -> float:
    """``np.median`` of some numbers, which takes long over few."""
    half, odd = divmod(values.size, 2)
    ordered = np.sort(values)
    return float(ordered[half] if odd else (ordered[half - 1] + ordered[half]) / 2)


def drive_of(drives: pl.DataFrame) -> Drive:
    """The figures of one session's drives."""
    fits = []
    for _, own in drives.group_by("robot", maintain_order=True):
        if own.height >= 10:
            fits.append(_robot(own))
    if not fits:
        return Drive(drives.height, *[None] * 10)
    names = ("mean", "start", "drop", "within", "lag")
    mean, start, drop, within, lag = (np.array([getattr(one, name) for one in fits]) for name in names)
    between = float(mean.std(ddof=1)) if len(fits) > 1 else None
    spread = float(np.sqrt((within**2).mean()))
    veers = [one.veer for one in fits if one.veer is not None]
    veers_within = [one.veer_within for one in fits if one.veer_within is not None]
    return Drive(
        drives=drives.height,
        speed_m_s=float(mean.mean()),
        start_speed_m_s=float(start.mean()),
        drop=float(drop.mean()),
        between_m_s=between,
        within_m_s=spread,
        share_between=None if between is None else between**2 / (between**2 + spread**2),
        lag_one=float(lag.mean()),
        veer_rad_s=float(np.mean(veers)) if veers else None,
        veer_between_rad_s=float(np.std(veers, ddof=1)) if len(veers) > 1 else None,
        veer_within_rad_s=float(np.mean(veers_within)) if veers_within else None,
    )


@dataclass(frozen=True)
class _Robot:
    mean: float
    start: float
    drop: float
    within: float
    lag: float
    veer: float | None
    veer_within: float | None


def _robot(own: pl.DataFrame) -> _Robot:
    time, speed = own["time_s"].to_numpy(), own["speed_m_s"].to_numpy()
    slope, start = np.polyfit(time, speed, 1)
    rest = speed - (start + slope * time)
    square = float((rest**2).mean())
    veer = own["veer_rad_s"].drop_nulls().to_numpy()
    return _Robot(
        mean=float(speed.mean()),
        start=float(start),
        drop=float(-slope * SPAN_S / start),
        within=float(np.sqrt(square)),
        lag=float((rest[1:] * rest[:-1]).mean()) / square if square > 0 else 0.0,
        veer=float(veer.mean()) if veer.size >= 10 else None,
        veer_within=float(veer.std(ddof=1)) if veer.size >= 10 else None,
    )
