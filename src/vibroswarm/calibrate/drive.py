"""Measure how robots drive: speed, its variation between and within robots, its drop as the battery empties, and veer;
and how robots turn and how far they get in undisturbed intervals.

An interval lies between two successive samples of a robot. It is undisturbed if the robot only drove in it, without
avoidance and without a turn on the spot.

| name | symbol | unit | equation |
|---|---|---|---|
| speed | v | m/s | distance / time of the steps between tracked positions; without tracks, of the whole drive |
| speed at the start | v_0 | m/s | v at t = 0, from v = v_0 (1 - t / life) by least squares for each robot and session |
| drop | - | - | T / life: share of the speed lost in T = 1200 s |
| sd between | - | m/s | standard deviation over robots of the mean speed |
| sd within | - | m/s | standard deviation of a robot's speed about its line v(t) |
| share between | - | - | between^2 / (between^2 + within^2) |
| veer | w | rad/s | slope of the course against time while driving, anticlockwise positive |
| turn | D | rad | direction from sample to sample minus that in the interval before (both undisturbed) |
| own misalignment | m | - | D track / (2 L), L the length of the arc; 0 for a robot that drives straight |
| spread | s | - | interquartile range of D about the robot's median, / 1.349: insensitive to undetected turns |
| slow share | c | - | share of the variance that changes slowly, from the autocorrelation of D over ``SLOW_LAGS`` |
| spread from sample to sample | - | - | s sqrt(2 (1 - c)): D is the mean of two intervals' turns |
| slow spread | - | - | s sqrt(c) |
| variation of distance | - | - | interquartile range about a line in time, / 1.435 (triangular law) / the median |

An undisturbed interval is recognised by its duration: intervals without avoidance usually have no turn either, so their
median duration is that of an undisturbed interval, and intervals within ``CALM_S`` of this median count as undisturbed.
Intervals whose two samples are at most ``LEAST_M`` apart do not count: the robot hardly moved. ``drive_table`` leaves
them out before the median is computed, ``undisturbed`` only afterwards. The drive is the part of the interval before
the robot stops to sample. Speed and veer are measured without the first and last tracked steps of the drive, in which
the robot starts and stops.

Where a robot samples depends on the turn from sample to sample, which includes starts and stops. The veer does not: it
is the slope of the course in the middle of a drive, and is smaller.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.calibrate.features import sample_table
from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.motion.pose import pose
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

CALM_S: Final = 0.3
"""An undisturbed interval lasts the median of the intervals without avoidance, within this tolerance."""
LEAST_M: Final = 0.05
"""Shortest distance between the two samples of an undisturbed interval."""
SPAN_S: Final = 1200.0
"""Time T in which the drop of the speed is measured."""
STEP_S: Final = 0.22
"""Interval at which simulated paths are sampled, as a camera does."""
MOST_VEER: Final = np.radians(40.0)
"""Largest veer of a drive, rad/s (40 degrees per second); a faster change of the course is an undetected turn."""

DRIVES: Final = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "time_s": pl.Float64,
    "speed_m_s": pl.Float64,
    "veer_rad_s": pl.Float64,
}
"""Columns of the table of drives; time_s is the time of the sample at the end of the drive."""


LEAST_DRIVES: Final = 10
"""Robots with fewer drives are left out, and those with fewer measured veers have no veer."""


def calm_intervals(samples: pl.DataFrame) -> pl.DataFrame:
    """Return the samples before which the robot neither avoided nor turned: the interval is about as long as usual.

    Args:
        samples: table ``features.sample_table``.
    """
    unavoided = samples.filter((pl.col("avoid_s") < 1e-9) & pl.col("spacing_s").is_not_null())
    return unavoided.filter((pl.col("spacing_s") - pl.col("spacing_s").median()).abs() < CALM_S)


def drive_table(result: Result) -> pl.DataFrame:
    """Return one row per drive in an undisturbed interval: run, robot, time_s of the sample at its end, speed and veer.

    A drive that cannot be measured on the robot's track, or that veers by ``MOST_VEER`` or more, is left out. For a
    robot without a track, the speed is the distance between the two samples divided by the time of the drive, and the
    veer is null. Columns and units are those of ``DRIVES``.
    """
    table = sample_table(result).join(
        result.motion.select("run", "robot", "sample", "stop_start_s"),
        on=["run", "robot", "sample"],
        maintain_order="left",
    )
    # A drive lasts from the previous sample to the stop for this sample.
    table = table.with_columns(since_s=pl.col("time_s").shift(1).over("run", "robot"))
    # In recordings, avoidance times are differences of logged totals; 1e-9 s allows for rounding.
    unavoided = table.filter((pl.col("avoid_s") < 1e-9) & (pl.col("distance_m") > LEAST_M))
    usual_s = unavoided["spacing_s"].median()  # None without rows; the next filter then keeps none
    drives = unavoided.filter((pl.col("spacing_s") - usual_s).abs() <= CALM_S)
    rows: list[tuple[int, int, float, float, float | None]] = []
    for (run, robot), own in drives.group_by("run", "robot", maintain_order=True):
        track = track_of(result, int(run), int(robot))
        for time_s, since_s, stop_s, distance_m in own.select(
            "time_s", "since_s", "stop_start_s", "distance_m"
        ).iter_rows():
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
    end_s = float(result.ends.filter(run=run, robot=robot)["end_s"][0])
    times = np.arange(0.0, end_s, STEP_S)
    poses = pose(result.poses, run, robot, times)
    return np.column_stack([times, poses[:, 0], poses[:, 1]])


def _on_track(track: Floats, since_s: float, until_s: float) -> tuple[float, float] | None:
    """Return the speed (m/s) and veer (rad/s) of one drive; None if it is too short, or has a stop or a turn.

    Args:
        track: rows of time (s), x (m) and y (m), ``track_of``.
        since_s, until_s: beginning and end of the drive.
    """
    first, last = np.searchsorted(track[:, 0], [since_s, until_s])
    time, x, y = track[first:last].T
    # Seven positions give six steps. Without the first and the last step, a slope has four points.
    if time.size < 7:
        return None
    dx, dy, dt = (each[2:-1] - each[1:-2] for each in (x, y, time))  # without the first and the last step
    step = np.hypot(dx, dy)
    # A step much shorter than the others means that the robot stood, so this was no undisturbed drive. The second
    # condition also rejects a robot that stood all the time, whose median step is 0.
    if step.min() < 0.2 * np.median(step) or step.min() <= 0.0:
        return None
    course = np.arctan2(dy, dx)
    # np.unwrap removes jumps of the angle by 2 pi. It is slow and changes nothing if no change reaches pi.
    if np.abs(np.diff(course)).max() >= math.pi:
        course = np.unwrap(course)
    middle_s = ((time[1:] + time[:-1]) / 2)[1:-1]  # middle of each step, without the first and the last step
    middle_s = middle_s - middle_s.mean()
    veer = float(middle_s @ course / (middle_s @ middle_s))  # least-squares slope of the course against time
    return (float(step.sum() / dt.sum()), veer) if abs(veer) < MOST_VEER else None


def drive_of(drives: pl.DataFrame) -> dict[str, float | None]:
    """Return statistics of one session's drives by name, in SI units; a statistic is None if it cannot be computed.

    Robots with fewer than ``LEAST_DRIVES`` drives are left out. Without tracks the veer is unknown, and its statistics
    are None. ``lag_one`` is the correlation between the deviations of a robot's speed from its line v(t) in one drive
    and in the next drive.

    Args:
        drives: rows of ``drive_table`` of one session.
    """
    own = [
        robot_drives
        for robot_drives in drives.partition_by("robot", maintain_order=True)
        if robot_drives.height >= LEAST_DRIVES
    ]
    lines = np.array([line_of(robot_drives) for robot_drives in own]).reshape(-1, len(Line._fields))
    # Each value of the robots that have it.
    mean, start, _, within, veers, veers_within, lag, drop, _ = (
        column[~np.isnan(column)] for column in lines.T
    )
    between = float(mean.std(ddof=1)) if mean.size > 1 else None
    spread = float(np.sqrt((within**2).mean())) if within.size else None  # root mean square over robots
    both_known = between is not None and spread is not None
    return {
        "speed_m_s": _mean(mean),
        "start_speed_m_s": _mean(start),
        "drop": _mean(drop),
        "between_m_s": between,
        "within_m_s": spread,
        "share_between": between**2 / (between**2 + spread**2) if both_known else None,  # type: ignore[operator]
        "lag_one": _mean(lag),
        "veer_rad_s": _mean(veers),
        "veer_between_rad_s": float(np.std(veers, ddof=1)) if veers.size > 1 else None,
        "veer_within_rad_s": _mean(veers_within),
    }


def _mean(values: Floats) -> float | None:
    """Return the mean, or None without values."""
    return float(values.mean()) if values.size else None


BLOCKS: Final = 10
"""Parts of a session, of which the deviations from a robot's line of speed are taken as independent."""


class Line(NamedTuple):
    """How fast one robot drives in one session: its line v(t), and its veer in the middle of drives."""

    speed_m_s: float
    """Mean speed."""
    start_speed_m_s: float
    lost_per_s: float
    """Share of the speed at the start that is lost per second."""
    within_m_s: float
    """Standard deviation of the speed about the line."""
    veer_rad_s: float
    """Mean veer; NaN with fewer than ``LEAST_DRIVES`` measured veers."""
    veer_within_rad_s: float
    """Standard deviation of the veer; NaN as its mean is."""
    lag_one: float
    """Correlation between the deviations from the line in one drive and in the next drive."""
    drop: float
    """Share of the speed at the start that is lost in ``SPAN_S``."""
    start_error_m_s: float
    """Standard error of the speed at the start, of ``BLOCKS`` stretches that deviate independently."""


def line_of(own: pl.DataFrame) -> Line:
    """Return how fast one robot drives in one session.

    Args:
        own: rows of ``drive_table`` of the robot, in the order of time, at least ``LEAST_DRIVES``.
    """
    time, speed = own["time_s"].to_numpy(), own["speed_m_s"].to_numpy()
    slope, start = np.polyfit(time, speed, 1)
    deviations = speed - start - slope * time
    squares, lagged = float((deviations**2).sum()), deviations[1:] * deviations[:-1]
    veer = own["veer_rad_s"].drop_nulls().to_numpy()
    is_known = veer.size >= LEAST_DRIVES
    return Line(
        speed_m_s=float(speed.mean()),
        start_speed_m_s=start,
        lost_per_s=-slope / start,
        within_m_s=float(np.sqrt(squares / (time.size - 2))),  # the line takes two degrees of freedom
        veer_rad_s=float(veer.mean()) if is_known else np.nan,
        veer_within_rad_s=float(veer.std(ddof=1)) if is_known else np.nan,
        lag_one=float(lagged.mean()) / (squares / time.size) if squares > 0 else 0.0,
        drop=-slope * SPAN_S / start,
        start_error_m_s=_error_of_start(time, deviations),
    )


def _error_of_start(time: Floats, deviations: Floats) -> float:
    """Return the standard error of the value at time 0 of a line, of which ``BLOCKS`` stretches deviate independently.

    Args:
        time: of the values that the line was fitted to, ascending, s. deviations: of these values from the line.
    """
    off = time - time.mean()
    # The line's value at time 0 is the sum of these weights times the values.
    weights = 1.0 / time.size - time.mean() * off / (off**2).sum()
    sums = [part.sum() for part in np.array_split(weights * deviations, BLOCKS)]
    # The line has two numbers, which take two of the blocks' degrees of freedom.
    return float(np.sqrt(np.square(sums).sum() * BLOCKS / (BLOCKS - 2)))


MOST_TURN: Final = np.radians(40.0)
"""A larger turn between undisturbed intervals is a turn on the spot that was too short to be recognised by time."""
SLOW_LAGS: Final = (4, 6, 8, 10, 12)
"""Lags of the autocorrelation, in samples: longer than what neighbouring intervals share, shorter than the time in
which a slow variation changes."""
CLIPPED: Final = 2.5
"""Deviations are clipped to this many spreads for autocorrelations."""
LEAST_TURNS: Final = 30
"""Fewest turns of a robot in a session."""
IQR: Final = 1.349
"""Interquartile range of a standard normal distribution."""
IQR_TRIANGULAR: Final = 2.0 * (np.sqrt(6.0) - np.sqrt(3.0))
"""Interquartile range of a triangular distribution of variance 1."""


def undisturbed(samples: pl.DataFrame) -> pl.DataFrame:
    """Return the undisturbed intervals whose previous interval is undisturbed too, so that a turn is defined.

    Intervals with a turn of ``MOST_TURN`` or more are left out, because it is taken to be a turn on the spot.

    Args:
        samples: ``features.sample_table``, of any number of sessions.
    Returns:
        One row per interval: run, robot; index and time_s of the sample that ends the interval (the index counts a
        robot's samples in a run from 0); turn_rad, the direction of the interval's step minus that of the previous
        interval's; and distance_m. Rows are ordered by run, robot and time.
    """
    key = ["run", "robot"]
    # In recordings, avoid_s is a difference of logged totals; 1e-9 s allows for rounding.
    without_avoidance = pl.col("avoid_s") < 1e-9
    usual_s = samples.filter(without_avoidance)[
        "spacing_s"
    ].median()  # None without rows; ``usual_duration`` is then null, and no interval is chosen
    usual_duration = (pl.col("spacing_s") - usual_s).abs() <= CALM_S
    calm = without_avoidance & usual_duration & (pl.col("distance_m") > LEAST_M)
    turn = pl.arctan2("dy_m", "dx_m").diff().over(key)
    marked = samples.sort("run", "robot", "time_s").with_columns(
        calm=calm.fill_null(False),  # null at a robot's first sample, which ends no interval
        turn_rad=(turn + np.pi) % (2.0 * np.pi) - np.pi,
        index=pl.int_range(pl.len()).over(key),
    )
    calm_twice = pl.col("calm") & pl.col("calm").shift(1).over(key).fill_null(False)
    chosen = marked.filter(calm_twice & (pl.col("turn_rad").abs() < MOST_TURN))
    return chosen.select("run", "robot", "index", "time_s", "turn_rad", "distance_m")


class Course(NamedTuple):
    """How one robot drives in one session, from its undisturbed intervals.

    A value in 1/m, multiplied by half the track (m), is a misalignment.
    """

    turn_rad: float
    """Median turn from interval to interval."""
    bend_per_m: float
    """Median turn, divided by the length of the arc."""
    spread_per_m: float
    """Spread of the turns about their median, divided by the length of the arc."""
    slow_share: float
    """Mean autocorrelation of the turns over ``SLOW_LAGS``, below 0 by chance; NaN if it cannot be computed."""
    distance_spread: float
    """Standard deviation of the distances about their line in time, as a share of their median."""
    turns: int
    """Number of turns that were measured."""
    samples: int
    """Number of samples up to the last of these turns."""


def course_of(own: pl.DataFrame) -> Course | None:
    """Return how one robot drives in one session, from its undisturbed intervals; None with too few of them.

    Args:
        own: rows of ``undisturbed`` of the robot in the session, in the order of time; ``LEAST_TURNS`` are needed.
    """
    if own.height < LEAST_TURNS:
        return None
    turn, distance, time = (own[name].to_numpy() for name in ("turn_rad", "distance_m", "time_s"))
    middle = float(np.median(turn))
    # An arc of angle a has the length chord x (a / 2) / sin(a / 2); the chord is the distance between two samples.
    half = max(abs(middle) / 2.0, 1e-9)  # a / 2; 1e-9 keeps 0 / sin(0) from being NaN
    arc_m = float(np.median(distance)) * half / np.sin(half)
    spread = quartile_spread(turn - middle)
    line = np.polyval(np.polyfit(time, distance, 1), time)
    return Course(
        turn_rad=middle,
        bend_per_m=middle / arc_m,
        spread_per_m=spread / arc_m,
        slow_share=_slow_share(own["index"].to_numpy(), turn - middle, spread),
        # Becomes ``robot.speed_wander``, the sd of a triangular law, so the factor of the normal law is replaced by
        # that of a triangular one.
        distance_spread=quartile_spread(distance - line) * IQR / IQR_TRIANGULAR / float(np.median(distance)),
        turns=own.height,
        samples=int(own["index"][-1]) + 1,
    )


def quartile_spread(values: Floats) -> float:
    """Return the standard deviation of a normal distribution with the interquartile range of these values."""
    low, high = np.quantile(values, [0.25, 0.75])
    return float(high - low) / IQR


def _slow_share(index: Ints, deviation: Floats, spread: float) -> float:
    """Return the autocorrelation of turns over all pairs that are one of ``SLOW_LAGS`` apart.

    The result is NaN if no two intervals are one of these lags apart, or if all deviations are equal.

    Args:
        index: index of the sample that ends each interval, (intervals,), ascending.
        deviation: turn of each interval minus the robot's median turn, (intervals,).
        spread: standard deviation of the deviations; larger deviations are clipped to ``CLIPPED`` times this.
    """
    clipped = np.clip(deviation, -CLIPPED * spread, CLIPPED * spread)
    clipped = clipped - clipped.mean()
    by_index = np.full(int(index[-1]) + 1, np.nan)  # NaN: no turn was measured at this sample
    by_index[index] = clipped
    # Products of deviations that are ``lag`` samples apart; NaN unless both intervals are undisturbed.
    products = [by_index[lag:] * by_index[:-lag] for lag in SLOW_LAGS if lag < by_index.size]
    pairs = np.concatenate([each[np.isfinite(each)] for each in products]) if products else np.zeros(0)
    variance = float((clipped**2).mean())
    if not pairs.size or variance <= 0.0:
        return np.nan
    return float(pairs.mean() / variance)
