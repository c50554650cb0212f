"""Measure how robots drive: speed, its variation between and within robots, battery, veer; and how they turn and how
far they get in undisturbed intervals: one drive between two samples, nothing else.

| name | symbol | unit | equation |
|---|---|---|---|
| speed | v | m/s | distance over time of steps between tracked positions; without tracks, of whole drives |
| speed at the start | v_0 | m/s | of v = v_0 (1 - t / life), by least squares for each robot and session |
| drop | - | - | T / life: share of the speed lost in T = 1200 s |
| sd between, within | - | m/s | standard deviation of robots' mean speeds; of a robot's speed about its line |
| share between | - | - | between^2 / (between^2 + within^2) |
| veer | w | rad/s | slope of the course against time while driving, anticlockwise positive; its sd likewise |
| undisturbed | - | - | no avoidance, and lasting the median of such intervals within ``CALM_S``: no turn either |
| turn | D | rad | change of the direction of the step from one undisturbed interval to the next, below ``MOST_TURN`` |
| own misalignment | m | - | D track / (2 L), L the length of the arc: what a straight robot lacks |
| its spread | s | - | interquartile range of D about the robot's median, / 1.349: insensitive to hidden turns |
| slow share | c | - | autocorrelation of D, clipped, over ``SLOW_LAGS`` samples |
| from sample to sample | - | - | s sqrt(2 (1 - c)): D is the mean of two intervals' turns |
| slow | - | - | s sqrt(c) |
| variation of distance | - | - | interquartile range about its line in time / 1.435 (triangular), / its median |

A drive lies between two samples of a robot without avoidance or turn in between, recognised by its usual duration
(``CALM_S``). The first and last step, in which the robot starts and stops, are left out.

What matters to where robots sample is the turn from sample to sample, with starts and stops, not the slope of the
course in the middle of a drive, which is smaller.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

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
    """Return the median as ``np.median`` does, but faster for few numbers."""
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


MOST_TURN: Final = np.radians(40.0)
"""A larger turn is one that the clock hides."""
SLOW_LAGS: Final = (4, 6, 8, 10, 12)
"""Samples: beyond what neighbouring intervals share, within a slow variation."""
CLIPPED: Final = 2.5
"""Deviations are clipped to so many spreads for autocorrelations."""
LEAST_TURNS: Final = 30
"""Fewest turns of a robot in a session."""
IQR: Final = 1.349
"""Interquartile range of a standard normal distribution."""
IQR_TRIANGULAR: Final = 2.0 * (np.sqrt(6.0) - np.sqrt(3.0))
"""That of a triangular one of variance 1."""


def undisturbed(samples: pl.DataFrame) -> pl.DataFrame:
    """Return the undisturbed intervals that follow another one.

    Args:
        samples: of ``features.sample_table``, of any number of sessions.
    Returns:
        One row an interval: run, robot, index (of the sample that ends it), time_s, turn_rad, distance_m.
    """
    key = ["run", "robot"]
    free = pl.col("avoid_s") < 1e-9
    lasting = samples.filter(free)["spacing_s"].median()
    calm = free & ((pl.col("spacing_s") - lasting).abs() <= CALM_S) & (pl.col("distance_m") > LEAST_M)
    turn = pl.arctan2("dy_m", "dx_m").diff().over(key)
    marked = samples.sort("run", "robot", "time_s").with_columns(
        calm=calm.fill_null(False),
        turn_rad=(turn + np.pi) % (2.0 * np.pi) - np.pi,
        index=pl.int_range(pl.len()).over(key),
    )
    both = pl.col("calm") & pl.col("calm").shift(1).over(key).fill_null(False)
    chosen = marked.filter(both & (pl.col("turn_rad").abs() < MOST_TURN))
    return chosen.select("run", "robot", "index", "time_s", "turn_rad", "distance_m")


class Course(NamedTuple):
    """How one robot drives in one session, from its undisturbed intervals.

    Values in 1/m, times half the track (m), are misalignments.
    """

    turn_rad: float
    """Median turn from interval to interval."""
    bend_per_m: float
    """Median turn, divided by the length of the arc."""
    spread_per_m: float
    slow_share: float
    distance_spread: float
    """Spread of the distances about their line in time, as a share of their median."""
    turns: int
    samples: int


def course_of(own: pl.DataFrame) -> Course | None:
    """Return the course of one robot in one session from its rows of ``undisturbed``; None if there are too few."""
    if own.height < LEAST_TURNS:
        return None
    turn, distance, time = (own[name].to_numpy() for name in ("turn_rad", "distance_m", "time_s"))
    middle = float(np.median(turn))
    half = max(abs(middle) / 2.0, 1e-9)
    arc_m = float(np.median(distance)) * half / np.sin(half)
    spread = quartile_spread(turn - middle)
    line = np.polyval(np.polyfit(time, distance, 1), time)
    return Course(
        turn_rad=middle,
        bend_per_m=middle / arc_m,
        spread_per_m=spread / arc_m,
        slow_share=_slow_share(own["index"].to_numpy(), turn - middle, spread),
        distance_spread=quartile_spread(distance - line) * IQR / IQR_TRIANGULAR / float(np.median(distance)),
        turns=own.height,
        samples=int(own["index"][-1]) + 1,
    )


def quartile_spread(values: Floats) -> float:
    """Return the standard deviation of a normal distribution with the interquartile range of these values."""
    low, high = np.quantile(values, [0.25, 0.75])
    return float(high - low) / IQR


def _slow_share(index: NDArray[np.int64], deviation: Floats, spread: float) -> float:
    """Return the mean autocorrelation over ``SLOW_LAGS``, clipped to [0, 1].

    NaN if no two intervals are such a lag apart, or if all deviations are equal.

    Args:
        index: of the sample that ends each interval, (intervals,). deviation: of its turn. spread: of the deviations.
    """
    clipped = np.clip(deviation, -CLIPPED * spread, CLIPPED * spread)
    clipped = clipped - clipped.mean()
    by_index = np.full(int(index[-1]) + 1, np.nan)
    by_index[index] = clipped
    products = [by_index[lag:] * by_index[:-lag] for lag in SLOW_LAGS if lag < by_index.size]
    pairs = np.concatenate([each[np.isfinite(each)] for each in products]) if products else np.zeros(0)
    variance = float((clipped**2).mean())
    if not pairs.size or variance <= 0.0:
        return np.nan
    return float(np.clip(pairs.mean() / variance, 0.0, 1.0))
