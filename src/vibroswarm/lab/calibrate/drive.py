"""Measure how robots drive: speed, its variation between and within robots, its drop as the battery empties, and veer;
and how robots turn and how far they get in undisturbed intervals.

An interval lies between two successive samples of a robot. It is undisturbed if the robot only drove in it, without
avoidance and without a turn on the spot.

| name | symbol | unit | equation |
|---|---|---|---|
| speed | v | m/s | distance / time of the steps between tracked positions; without tracks, of the whole drive |
| speed at the start | v_0 | m/s | v at t = 0, from v = v_0 (1 - t / life) by least squares for each robot and session |
| veer | w | rad/s | slope of the course against time while driving, anticlockwise positive |
| turn | D | rad | direction from sample to sample minus that in the interval before (both undisturbed) |
| own misalignment | m | - | D track / (2 L), L the length of the arc; 0 for a robot that drives straight |
| spread | s | - | interquartile range of D about the robot's median, / 1.349: insensitive to undetected turns |
| slow share | c | - | share of the variance that changes slowly, from the autocorrelation of D over ``SLOW_LAGS`` |
| spread from sample to sample | - | - | s sqrt(2 (1 - c)): D is the mean of two intervals' turns |
| slow spread | - | - | s sqrt(c) |
| variation of distance | - | - | interquartile range about a line in time, / 1.435 (triangular law) / the median |

An undisturbed interval is recognised by its duration: intervals without avoidance usually have no turn either, so
those within ``CALM_S`` of their median duration count as undisturbed if the samples are more than ``LEAST_M`` apart.
The drive is the part of the interval before the robot stops to sample. Speed and veer are measured without the first
and last tracked steps of the drive, in which the robot starts and stops.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.lab.calibrate.samples import ROUNDING_S
from vibroswarm.lab.recordings.recording import Recording
from vibroswarm.motion.pose import pose
from vibroswarm.result import Result

CALM_S: Final = 0.3
"""An undisturbed interval lasts the median of the intervals without avoidance, within this tolerance."""
LEAST_M: Final = 0.05
"""Shortest distance between the two samples of an undisturbed interval."""
STEP_S: Final = 0.22
"""Interval at which simulated paths are sampled, as a camera does."""
MOST_VEER: Final = np.radians(40.0)
"""Largest veer of a drive, rad/s; a faster change of the course is an undetected turn."""
MOST_TURN: Final = np.radians(40.0)
"""A larger turn between undisturbed intervals is a turn on the spot that was too short to be recognised by time."""
LEAST_DRIVES: Final = 10
"""Robots with fewer drives are left out, and those with fewer measured veers have no veer."""
LEAST_TURNS: Final = 30
"""Fewest turns of a robot in a session."""
BLOCKS: Final = 10
"""Parts of a session, of which the deviations from a robot's line of speed are taken as independent."""
SLOW_LAGS: Final = (4, 6, 8, 10, 12)
"""Lags of the autocorrelation, in samples: longer than what neighbouring intervals share, shorter than the time in
which a slow variation changes."""
CLIPPED: Final = 2.5
"""Deviations are clipped to this many spreads for autocorrelations."""
IQR: Final = 1.349
"""Interquartile range of a standard normal distribution."""
IQR_TRIANGULAR: Final = 2.0 * (np.sqrt(6.0) - np.sqrt(3.0))
"""Interquartile range of a triangular distribution of variance 1."""
DRIVES: Final = {
    "run": pl.UInt32, "robot": pl.UInt16, "time_s": pl.Float64, "speed_m_s": pl.Float64, "veer_rad_s": pl.Float64,
}  # fmt: skip
"""Columns of the table of drives; time_s is the time of the sample at the end of the drive."""


def calm_intervals(samples: pl.DataFrame, least_m: float = -1.0) -> pl.DataFrame:
    """Return the samples before which the robot neither avoided nor turned: the interval is about as long as usual.

    Args:
        samples: table ``sample_table``. least_m: intervals over shorter distances do not count for what is usual.
    """
    unavoided = samples.filter((pl.col("avoid_s") < ROUNDING_S) & (pl.col("distance_m") > least_m))
    return unavoided.filter((pl.col("spacing_s") - pl.col("spacing_s").median()).abs() <= CALM_S)


def drive_table(result: Result, samples: pl.DataFrame) -> pl.DataFrame:
    """Return one row per drive in an undisturbed interval: run, robot, time_s of the sample at its end, speed and veer.

    A drive that cannot be measured on the robot's track, or that veers by ``MOST_VEER`` or more, is left out. For a
    robot without a track, the speed is the distance between the two samples divided by the time of the drive, and the
    veer is null. Columns and units are those of ``DRIVES``.
    """
    rows: list[tuple[int, int, float, float, float | None]] = []
    drives = calm_intervals(samples, LEAST_M)
    for (run, robot), own in drives.group_by("run", "robot", maintain_order=True):
        track = track_of(result, int(run), int(robot))
        columns = own.select("time_s", "spacing_s", "stop_start_s", "distance_m")
        for time_s, spacing_s, stop_s, distance_m in columns.iter_rows():
            since_s = time_s - spacing_s
            untracked = (distance_m / (stop_s - since_s), None)
            measured = untracked if track is None else _on_track(track, since_s, stop_s)
            if measured is not None:
                rows.append((int(run), int(robot), time_s, *measured))
    return pl.DataFrame(rows, schema=DRIVES, orient="row")


def track_of(result: Result, run: int, robot: int) -> Floats | None:
    """Return a robot's path at the rate of a camera: rows of time (s), x (m) and y (m); None if it is not known.

    The path of a recording is what the camera tracked; that of a simulation is true, at intervals of ``STEP_S``.
    """
    if isinstance(result, Recording):
        own = result.tracks.filter(run=run, robot=robot)
        return own.select("time_s", "x_m", "y_m").to_numpy() if own.height else None
    if result.poses is None:
        return None
    times = np.arange(0.0, float(result.ends.filter(run=run, robot=robot)["end_s"][0]), STEP_S)
    return np.column_stack([times, pose(result.poses, run, robot, times)[:, :2]])


def _on_track(track: Floats, since_s: float, until_s: float) -> tuple[float, float] | None:
    """Return the speed (m/s) and veer (rad/s) of one drive; None if it is too short, or has a stop or a turn."""
    first, last = np.searchsorted(track[:, 0], [since_s, until_s])
    time, x, y = track[first:last].T
    # Seven positions give six steps. Without the first and the last step, a slope has four points.
    if time.size < 7:
        return None
    dx, dy, dt = (np.diff(each)[1:-1] for each in (x, y, time))
    step = np.hypot(dx, dy)
    # A step much shorter than the others means that the robot stood, so this was no undisturbed drive.
    if step.min() < 0.2 * np.median(step) or step.min() <= 0.0:
        return None
    course = np.unwrap(np.arctan2(dy, dx))
    middle_s = ((time[1:] + time[:-1]) / 2)[1:-1]
    middle_s = middle_s - middle_s.mean()
    veer = float(middle_s @ course / (middle_s @ middle_s))  # least-squares slope of the course against time
    return (float(step.sum() / dt.sum()), veer) if abs(veer) < MOST_VEER else None


def line_of(own: pl.DataFrame) -> dict[str, float | None]:
    """Return how fast one robot drives in one session: its line v(t), and its veer in the middle of drives.

    ``start_error_m_s`` is the standard error of the speed at the start, of ``BLOCKS`` stretches that deviate
    independently; ``lag_one`` the correlation between deviations from the line in one drive and in the next.

    Args:
        own: rows of ``drive_table`` of the robot, in the order of time, at least ``LEAST_DRIVES``.
    """
    time, speed = own["time_s"].to_numpy(), own["speed_m_s"].to_numpy()
    slope, start = np.polyfit(time, speed, 1)
    deviations = speed - start - slope * time
    squares = float((deviations**2).sum())
    # The line's value at time 0 is the sum of these weights times the values.
    off = time - time.mean()
    weights = 1.0 / time.size - time.mean() * off / (off**2).sum()
    sums = [part.sum() for part in np.array_split(weights * deviations, BLOCKS)]
    veer = own["veer_rad_s"].drop_nulls()
    is_known = veer.len() >= LEAST_DRIVES
    return {
        "speed_m_s": float(speed.mean()),
        "start_speed_m_s": float(start),
        "lost_per_s": float(-slope / start),
        "within_m_s": float(np.sqrt(squares / (time.size - 2))),  # the line takes two degrees of freedom
        "lag_one": float((deviations[1:] * deviations[:-1]).mean() * time.size / max(squares, 1e-30)),
        "start_error_m_s": float(np.sqrt(np.square(sums).sum() * BLOCKS / (BLOCKS - 2))),
        "veer_rad_s": float(veer.to_numpy().mean()) if is_known else None,
        "veer_within_rad_s": float(veer.to_numpy().std(ddof=1)) if is_known else None,
    }


def undisturbed(samples: pl.DataFrame) -> pl.DataFrame:
    """Return the undisturbed intervals whose previous interval is undisturbed too, so that a turn is defined.

    Intervals with a turn of ``MOST_TURN`` or more are left out, because it is taken to be a turn on the spot.

    Args:
        samples: ``sample_table``, of any number of sessions.
    Returns:
        One row per interval: run, robot; index and time_s of the sample that ends the interval (the index counts a
        robot's samples in a run from 0); turn_rad, the direction of the interval's step minus that of the previous
        interval's; and distance_m. Rows are ordered by run, robot and time.
    """
    key = ["run", "robot"]
    without_avoidance = pl.col("avoid_s") < ROUNDING_S
    usual_s = samples.filter(without_avoidance)[
        "spacing_s"
    ].median()  # None without rows: no interval is chosen
    calm = (
        without_avoidance
        & ((pl.col("spacing_s") - usual_s).abs() <= CALM_S)
        & (pl.col("distance_m") > LEAST_M)
    )
    turn = pl.arctan2("dy_m", "dx_m").diff().over(key)
    marked = samples.sort("run", "robot", "time_s").with_columns(
        calm=calm.fill_null(False),
        turn_rad=(turn + np.pi) % (2.0 * np.pi) - np.pi,
        index=pl.int_range(pl.len()).over(key),
    )
    calm_twice = pl.col("calm") & pl.col("calm").shift(1).over(key).fill_null(False)
    chosen = marked.filter(calm_twice & (pl.col("turn_rad").abs() < MOST_TURN))
    return chosen.select("run", "robot", "index", "time_s", "turn_rad", "distance_m")


def course_of(own: pl.DataFrame) -> dict[str, float | None]:
    """Return how one robot drives in one session, from its undisturbed intervals; empty with too few of them.

    A value in 1/m, multiplied by half the track (m), is a misalignment. ``samples`` are those up to the last turn.

    Args:
        own: rows of ``undisturbed`` of the robot in the session, in the order of time; ``LEAST_TURNS`` are needed.
    """
    if own.height < LEAST_TURNS:
        return {}
    turn, distance, time = (own[name].to_numpy() for name in ("turn_rad", "distance_m", "time_s"))
    middle, usual_m = float(np.median(turn)), float(np.median(distance))
    # An arc of angle a has the length chord x (a / 2) / sin(a / 2); the chord is the distance between two samples.
    half = max(abs(middle) / 2.0, 1e-9)
    arc_m = usual_m * half / np.sin(half)
    spread = quartile_spread(turn - middle)
    line = np.polyval(np.polyfit(time, distance, 1), time)
    return {
        "turn_rad": middle,
        "bend_per_m": float(middle / arc_m),
        "spread_per_m": float(spread / arc_m),
        "correlation": _slow_correlation(own["index"].to_numpy(), turn - middle, spread),
        "distance_spread": float(quartile_spread(distance - line) * IQR / IQR_TRIANGULAR / usual_m),
        "turns": float(own.height),
        "samples": float(own["index"][-1]) + 1.0,
    }


def quartile_spread(values: Floats) -> float:
    """Return the standard deviation of a normal distribution with the interquartile range of these values."""
    low, high = np.quantile(values, [0.25, 0.75])
    return float(high - low) / IQR


def _slow_correlation(index: Ints, deviation: Floats, spread: float) -> float | None:
    """Return the autocorrelation of turns over all pairs that are one of ``SLOW_LAGS`` apart; None without any."""
    clipped = np.clip(deviation, -CLIPPED * spread, CLIPPED * spread)
    clipped = clipped - clipped.mean()
    by_index = np.full(int(index[-1]) + 1, np.nan)  # NaN: no turn was measured at this sample
    by_index[index] = clipped
    products = [by_index[lag:] * by_index[:-lag] for lag in SLOW_LAGS if lag < by_index.size]
    pairs = np.concatenate([np.zeros(0), *products])
    pairs, variance = pairs[np.isfinite(pairs)], float((clipped**2).mean())
    return float(pairs.mean() / variance) if pairs.size and variance > 0.0 else None
