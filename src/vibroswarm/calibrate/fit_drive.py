"""Fit speed, battery and veer in closed form.

| field | equation |
|---|---|
| robot.speed_factor_location, _scale (shape 100: nearly normal) | from the mean and sd between robots of v_0 / full speed |
| robot.speed_factor_min, _max | mean -+ 3 sd |
| robot.speed_redraw | "robot" if more than half of the variance is between robots |
| robot.speed_wander | variation of distances within robots, if speed_redraw is "robot" (``undisturbed``) |
| robot.speed_run_spread | sd of a robot's v_0 between sessions, relative, minus what the error of v_0 explains |
| robot.battery_life_s | 1 / (share of v_0 lost per second): v = v_0 (1 - t / life), least squares for each robot and session |
| robot.misalignment_min, _max | m = bend track / 2; uniform of the same mean and sd: mean -+ sqrt(3) sd |
| robot.misalignment_wander | variation of m from sample to sample (``undisturbed``) |
| robot.misalignment_drift | slow variation of m (``undisturbed``) |
| robot.misalignment_run_spread | sd of a robot's m between sessions, minus what the variation within sessions explains |
| robot.speed_factors, misalignments | of each robot: mean over sessions, if robots can be matched and speed_redraw is "robot" |

The bend is the turn per distance driven, 1/m; the track is the distance between the wheels; a body is one robot's speed
and bend; "wander" is variation from sample to sample.

The same robot may have different numbers in different sessions (in the study's recordings all but one do). Robots are
therefore matched to the robots of the first session by speed and veer, minimising the sum of squared differences in
units of ``APART``.

Robots that are alike are matched to whichever looks most alike, so that their variation between sessions comes out too
small: by 9 % for five robots 2 mm/s apart, by half for twenty. The means of sessions need
no match, but an estimate from these few numbers is further off.

Variation of speed within a robot is taken as independent between samples, but not for the error of v_0: real speeds also
change slowly. It is the error of a line of which the deviations of ``drive.BLOCKS`` parts of a session are independent, not
those of its drives.

Errors: of the mean and spread of robots, and of variation within them, Student's t and chi-square of so many robots
(``few_groups``), which count once in each session if they cannot be matched; of the variation of v_0 between sessions,
chi-square of robots in sessions; of the slow share, bootstrap over robots in sessions, which is widened for few of them
(``few_groups.limits_of_bootstrap``).
"""  # noqa: E501

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from scipy.optimize import linear_sum_assignment

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.drive import (
    LEAST_DRIVES,
    LEAST_M,
    SLOW_LAGS,
    calm_intervals,
    course_of,
    line_of,
    undisturbed,
)
from vibroswarm.calibrate.few_groups import drawn_means, drawn_variances, evenly_drawn
from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError
from vibroswarm.motion.robot_params import DRIFT_SAMPLES
from vibroswarm.recordings.threshold import resample
from vibroswarm.scenario.scenario import Scenario

SHAPE: Final = 100.0
"""Shape of the Gamma law of speed factors: large, so that it is nearly normal."""
DRAWS: Final = 200
"""Draws of each estimate."""
_SEED: Final = 32
"""Seed of the bootstrap."""
APART: Final = (0.003, np.radians(1.5))
"""Largest plausible difference of a robot's speed (m/s) and veer (rad/s) between sessions. With larger differences the
sessions are taken to have different robots, and no field of individual robots is set."""
LEAST_VARIATION: Final = 1e-3
"""Variations of misalignments, and of speeds between sessions, below this are left out of the scenario."""
MOST_VARIATION: Final = 0.08
"""Larger variations of misalignments are cut to this."""


BETWEEN: Final = ("between_m_s", "veer_between_rad_s", "bend_between_per_m")
"""Spreads between robots."""


@dataclass(frozen=True)
class DriveFit:
    """Estimates by name and their draws, (draws,)."""

    values: dict[str, float]
    """Estimates by name, see ``_estimates``; SI units. ``between_sessions`` is the sd of a robot's speed at the start
    between sessions, relative: 0 if the error of these speeds explains all of it. It is missing with one session, or
    if robots cannot be matched."""
    draws: dict[str, Floats]
    """Draws by the same names, (draws,) each; shorter where some resamples do not determine the estimate."""
    distance_ratio: float
    """Distance driven between the samples of an undisturbed interval, divided by that at driving speed: below 1
    because of starts, stops and clocks. The speeds of the scenario are multiplied by it."""
    bodies: Floats
    """Speed at the start, m/s, and bend, 1/m, of each robot, (robots, 2); (0, 2) if robots cannot be matched."""
    bend_between_sessions_per_m: float
    """Standard deviation of a robot's bend between sessions; 0 if it is unknown, or if the variation within sessions
    explains all of it."""

    def fields(self, base: Scenario) -> dict[str, object]:
        """Return the scenario's fields for these estimates, by dotted name; None: robots do not have it.

        Values are clipped to what robots can have: speed factors are positive, a battery outlasts the run, and
        misalignments are between -0.5 and 0.5. Variations are clipped to what the scenario allows. Fields of individual
        robots are given only if speeds vary more between robots than within them, because the list of their speed
        factors requires ``speed_redraw`` "robot"; their misalignments go with it.

        Args:
            base: scenario with the full speed, the track and the end of a run.
        """
        robot, values = base.robot, self.values
        mean = self.distance_ratio * values["start_speed_m_s"] / robot.full_speed_m_s  # speed factor
        by_robot = values["share_between"] > 0.5  # one speed factor per robot, not one per sample
        spread = (values["between_m_s"] if by_robot else values["within_m_s"]) / robot.full_speed_m_s
        spread = max(spread, 1e-3)  # the scale of a Gamma distribution must be above 0
        # Clip of the speed factors: 3 sd on both sides, but no robot slower than a fifth of the mean.
        low, high = _round(max(mean - 3 * spread, 0.2 * mean)), _round(mean + 3 * spread)
        run_spread = values.get("between_sessions", 0.0)
        varies = by_robot and run_spread >= LEAST_VARIATION
        # A Gamma law has the mean location + shape x scale and the standard deviation sqrt(shape) x scale.
        fields: dict[str, object] = {
            "robot.speed_factor_shape": SHAPE,
            "robot.speed_factor_scale": _round(spread / np.sqrt(SHAPE)),
            "robot.speed_factor_location": _round(mean - spread * np.sqrt(SHAPE)),
            "robot.speed_factor_min": low,
            "robot.speed_factor_max": high,
            "robot.speed_redraw": "robot" if by_robot else "sample",
            # 0.4 is the largest value that the field accepts.
            "robot.speed_wander": _round(min(self.speed_wander, 0.4)) if by_robot else None,
            "robot.speed_run_spread": _round(min(run_spread, 0.4)) if varies else None,
            "robot.battery_life_s": _round(max(values["battery_life_s"], 1.01 * base.run.t_end_s), 0),
        }
        if "bend_per_m" in values:
            half_track_m = robot.drive_track_m / 2.0  # bend times half the track is misalignment
            middle = values["bend_per_m"] * half_track_m
            half = np.sqrt(3.0) * values["bend_between_per_m"] * half_track_m  # half-width of a uniform law
            fields["robot.misalignment_min"] = _round(max(middle - half, -0.5))
            fields["robot.misalignment_max"] = _round(min(middle + half, 0.5))
            # Spread s (as a misalignment) and slow share c of a robot's turns D, see ``drive``.
            within, slow = values["bend_within_per_m"] * half_track_m, values["slow_share"]
            variation = {
                # D is the mean of the turns in two successive intervals. A mean of two independent values has half the
                # variance of one value, hence the 2.
                "wander": within * np.sqrt(2.0 * (1.0 - slow)),
                "drift": within * np.sqrt(slow),
                "run_spread": self.bend_between_sessions_per_m * half_track_m,
            }
            for name, size in variation.items():
                fields[f"robot.misalignment_{name}"] = (
                    _round(min(size, MOST_VARIATION)) if size >= LEAST_VARIATION else None
                )
        return fields | (self._each(base, low, high) if by_robot else {})

    @property
    def speed_wander(self) -> float:
        """Standard deviation of a robot's speed about its mean, divided by the mean.

        It is measured on the distances of undisturbed intervals; if there are none, on the speeds of drives.
        """
        values = self.values
        return values.get("distance_spread", values["within_m_s"] / values["speed_m_s"])

    def _each(self, base: Scenario, low: float, high: float) -> dict[str, object]:
        """Return the fields of individual robots; empty if robots could not be matched between sessions.

        Misalignments are left out if the bend of any robot is unknown, because the list must have an entry for each.

        Args:
            base: scenario with the full speed and the track.
            low, high: bounds of the speed factors' distribution, which are widened to include all robots.
        """
        if len(self.bodies) == 0:
            return {}
        speeds, bends = self.bodies.T
        factors = [_round(self.distance_ratio * speed / base.robot.full_speed_m_s) for speed in speeds]
        fields: dict[str, object] = {
            "robot.speed_factors": factors,
            "robot.speed_factor_min": min(low, *factors),
            "robot.speed_factor_max": max(high, *factors),
        }
        if np.isfinite(bends).all():
            bent = bends * base.robot.drive_track_m / 2.0
            fields["robot.misalignments"] = [
                _round(misalignment) for misalignment in np.clip(bent, -0.5, 0.5)
            ]
        return fields


def _round(value: float, digits: int = 5) -> float:
    """Return the value rounded, as a Python float, which a scenario file can hold."""
    return round(float(value), digits)


def fit_drive(found: Dataset, base: Scenario, draws: int = DRAWS) -> DriveFit:
    """Fit speed, battery and veer over all robots, and speed and bend of each robot if robots can be matched.

    Args:
        found: sessions, with positions corrected for the camera.
        base: scenario with the sample interval that the robots were programmed with.
        draws: number of draws.
    Raises:
        InputError: fewer than two robots with ten drives; a robot counts once in each session.
    """
    table, runs = _table_of_robots(found)
    if len(table) < 2:
        raise InputError(
            "at least two robots with ten drives each are needed to fit speeds; a drive is an interval between samples "
            "without avoidance, which logs with avoid_total_s show",
            field="REAL",
        )
    values = _estimates(table)
    # Each bootstrap draw takes as many rows (robots in sessions) as the table has, with replacement.
    resampled = [
        _estimates(table[resample(_SEED, draw, stream=0, count=len(table))]) for draw in range(draws)
    ]
    # A resample may lack an estimate that only few robots determine, such as the bend.
    draws_by_name = {
        name: np.array([estimates[name] for estimates in resampled if name in estimates]) for name in values
    }
    matched = _matched(table, runs)
    robots = table if matched is None else _mean_of_known(matched)
    independent = robots if len(robots) > 1 else table
    of_robots = _estimates(independent)
    # The robots' spread is that of so many robots, not of their rows, which are alike where robots are the same.
    values |= {name: of_robots[name] for name in BETWEEN if name in of_robots}
    values["share_between"] = float(_share_between(values["between_m_s"], values["within_m_s"]))
    draws_by_name |= _drawn_laws(independent, draws)
    draws_by_name["share_between"] = _share_between(draws_by_name["between_m_s"], draws_by_name["within_m_s"])
    if matched is not None and len(matched) > 1:
        values["between_sessions"], draws_by_name["between_sessions"] = _speed_between_sessions(
            matched, draws
        )
    return DriveFit(
        values=values,
        draws=draws_by_name,
        distance_ratio=_distance_ratio(found, table, base),
        bodies=np.zeros((0, 2)) if matched is None else robots[:, [START, BEND]],
        bend_between_sessions_per_m=0.0 if matched is None else _between_sessions(matched, values, table),
    )


def _share_between(between: Floats | float, within: Floats | float) -> Floats:
    """Return the share of the variance that is between robots, from standard deviations between and within them."""
    return np.asarray(between**2 / np.maximum(between**2 + within**2, 1e-30))


def timed_drive_ms(base: Scenario) -> float:
    """Return how long a robot drives from a sample to the next stop, without turns: until its timer exceeds tau, ms.

    It is the first multiple of the control period above the sample interval tau.
    """
    period = base.run.control_period_ms
    return period * (math.floor(base.sample.sample_interval_ms / period) + 1.0)


def _distance_ratio(found: Dataset, table: Floats, base: Scenario) -> float:
    """Return the distance driven in undisturbed intervals, divided by the distance at driving speed.

    The distance driven is the arc of the robot's bend whose chord is the mean distance between the two samples, without
    intervals in which something held the robot up. The distance at driving speed is the mean speed times the time of a
    drive from sample to sample. Both are means over robots in sessions. The result is 1, no correction, with fewer than
    50 undisturbed intervals, if a robot has none, and if the ratio is not between 0.8 and 1.25, which is not plausible.

    Args:
        table: from ``_table_of_robots``.
    """
    calm = calm_intervals(found.samples).filter(pl.col("distance_m") > LEAST_M)
    drive_s = timed_drive_ms(base) / 1000.0
    by_robot = calm.sort("run", "robot").group_by("run", "robot", maintain_order=True)
    chords = by_robot.agg(pl.col("distance_m").mean())["distance_m"].to_numpy()
    # If the numbers of robots in sessions differ, the two means would be over different robots.
    if calm.height < 50 or chords.size != len(table):
        return 1.0
    # Half the angle of the arc, of which the distance is the chord; 1e-9 keeps 0 / sin(0) from being NaN.
    half = np.arcsin(np.clip(np.abs(np.nan_to_num(table[:, BEND])) * chords / 2.0, 1e-9, 1.0))
    arcs = chords * half / np.sin(half)
    ratio = float(arcs.mean()) / (float(table[:, MEAN].mean()) * drive_s)
    return ratio if 0.8 < ratio < 1.25 else 1.0


def _matched(table: Floats, runs: Ints) -> Floats | None:
    """Match the robots of all sessions; return the row of each robot in each session, (sessions, robots, 12).

    Robots of every session are in the order of the first session's. The result is None if sessions have different
    numbers of robots, or if matched robots differ too much between sessions: their variance, in units of ``APART``
    squared, exceeds 1 in the mean over robots, speed and bend (if all bends are known). The sessions then have
    different robots.

    Args:
        table, runs: from ``_table_of_robots``.
    """
    speed = float(table[:, MEAN].mean())
    sessions = [table[runs == run] for run in np.unique(runs)]
    bodies = [session[:, [START, BEND]] for session in sessions]
    if len({len(session) for session in sessions}) > 1:
        return None
    scale = np.array([1.0, speed])  # a bend times the speed is a veer
    matched = []
    for session, own in zip(sessions, bodies, strict=True):
        # Differences between each robot of the first session and each robot of this session, (robots, robots, 2). A
        # difference of unknown bends is NaN, and counts as 0.
        apart = np.nan_to_num((bodies[0][:, None] - own[None]) * scale / APART)
        # The row of this session's table that is matched to each robot of the first session.
        _, row_of_robot = linear_sum_assignment((apart**2).sum(axis=2))
        matched.append(session[row_of_robot])
    if len(matched) > 1:
        # Variance of a robot between sessions, in units of APART squared, mean over robots: (speed, bend). That of the
        # bend is NaN, and does not count, if a single bend is unknown.
        variance = np.var(np.array(matched)[:, :, [START, BEND]], axis=0, ddof=1).mean(axis=0)
        if np.nanmean(variance * scale**2 / np.square(APART)) > 1.0:
            return None
    return np.array(matched)


def _mean_of_known(matched: Floats) -> Floats:
    """Return the means of each robot's values over sessions, (robots, 12); of the variation within it, that of squares.

    Sessions in which a value is NaN (unknown) are left out of its mean. The mean is NaN if the value is NaN in all.

    Args:
        matched: from ``_matched``.
    """
    known = np.isfinite(matched)
    total = np.where(known, matched, 0.0).sum(axis=0)
    with np.errstate(invalid="ignore"):  # 0 / 0 gives NaN where no session has a value
        means = np.asarray(total / known.sum(axis=0))
    means[:, WITHIN] = np.sqrt((matched[:, :, WITHIN] ** 2).mean(axis=0))
    return means


def _drawn_laws(robots: Floats, draws: int) -> dict[str, Floats]:
    """Return draws of what holds for all robots of this kind, by name, (draws,) each: means and spreads of their law.

    Args:
        robots: a row for each robot, with the columns of ``_table_of_robots``.
        draws: number of draws.
    """
    laws = {
        MEAN: ("speed_m_s", None),
        START: ("start_speed_m_s", "between_m_s"),
        LOST: ("battery_life_s", None),
        VEER: ("veer_rad_s", "veer_between_rad_s"),
        BEND: ("bend_per_m", "bend_between_per_m"),
        SPREAD: ("bend_within_per_m", None),
        DISTANCE: ("distance_spread", None),
    }
    u = evenly_drawn(draws, _SEED, "within_m_s")
    drawn = {"within_m_s": np.sqrt(np.maximum(drawn_means(robots[:, WITHIN] ** 2, u), 0.0))}
    for column, (mean, spread) in laws.items():
        known = robots[np.isfinite(robots[:, column]), column]
        if known.size < 2:
            continue
        drawn[mean] = drawn_means(known, evenly_drawn(draws, _SEED, mean))
        if spread is not None:
            u = evenly_drawn(draws, _SEED, spread)
            drawn[spread] = np.sqrt(drawn_variances(float(known.var(ddof=1)), known.size - 1, u))
    drawn |= {
        name: np.maximum(drawn[name], 0.0)
        for name in ("bend_within_per_m", "distance_spread")
        if name in drawn
    }
    return drawn | {"battery_life_s": _battery_life_s(drawn["battery_life_s"])}


def _battery_life_s(lost: Floats | float) -> Floats:
    """Return the life of batteries from the share of the speed lost per second: 1e9 s where robots do not slow down."""
    return np.asarray(1.0 / np.maximum(lost, 1e-9))


def _speed_between_sessions(matched: Floats, draws: int) -> tuple[float, Floats]:
    """Return the sd of a robot's speed at the start between sessions, relative, without what its error explains.

    The result is 0 if the error explains all.

    Args:
        matched: from ``_matched``, of two sessions or more. draws: number of draws.
    Returns: the sd; and its draws, (draws,).
    """
    starts, errors = matched[:, :, START], matched[:, :, ERROR]
    own = starts.mean(axis=0)  # of each robot
    total = float((starts / own).var(axis=0, ddof=1).mean())
    noise = float(np.square(errors / own).mean())
    freedom = (len(starts) - 1) * own.size
    drawn = drawn_variances(total, freedom, evenly_drawn(draws, _SEED, "between sessions"))
    return math.sqrt(max(total - noise, 0.0)), np.sqrt(np.maximum(drawn - noise, 0.0))


def _between_sessions(matched: Floats, values: dict[str, float], table: Floats) -> float:
    """Return the standard deviation of a robot's bend between sessions, without what variation within them explains.

    The result is 0 if no robot's bend is known in two sessions, or if the variation within sessions explains all.

    Args:
        matched: from ``_matched``. values: from ``_estimates``. table: from ``_table_of_robots``.
    """
    bends = matched[:, :, BEND]  # nan: too few undisturbed intervals of this robot in this session
    in_two_sessions = np.isfinite(bends).sum(axis=0) > 1
    if not in_two_sessions.any():
        return 0.0
    # Both estimates exist, because a bend that is known in two sessions gives two known bends. ``within`` is a
    # variance.
    within, slow = values["bend_within_per_m"] ** 2, values["slow_share"]
    turns, samples = (float(np.nanmean(table[:, column])) for column in (TURNS, SAMPLES))
    # Variation from sample to sample: an interval's own turn has the variance 2 within (1 - slow), because a measured
    # turn is the mean of two intervals' turns. A session's bend is a median, with pi / 2 times the variance of a mean.
    of_median = 0.5 * np.pi * 2.0 * within * (1.0 - slow) / turns
    # Slow variation: it has a new, independent value every DRIFT_SAMPLES samples, and is linear between these values.
    # Values on the lines have 2 / 3 of the variance of the independent values, hence 1.5.
    of_drift = 1.5 * within * slow * DRIFT_SAMPLES / samples
    variance = float(np.nanvar(bends[:, in_two_sessions], axis=0, ddof=1).mean()) - of_median - of_drift
    return float(np.sqrt(max(variance, 0.0)))


MEAN, START, LOST, WITHIN, VEER, BEND, SPREAD, SLOW, DISTANCE, TURNS, SAMPLES, ERROR = range(12)
"""Columns of the table of robots in sessions, explained at ``_table_of_robots``."""


def _table_of_robots(found: Dataset) -> tuple[Floats, Ints]:
    """Return a row for each robot in each session, (rows, 12), and the session of each row, (rows,).

    Rows are ordered by session and robot. The columns, ``MEAN`` to ``ERROR``, are the first five fields of the robot's
    ``Line``, all fields of its ``Course`` but the first, and the standard error of the speed at the start. Unknown
    values are NaN. Robots with fewer than ten drives in a session are left out.
    """
    courses = {
        key: course_of(own)
        for key, own in undisturbed(found.samples).group_by("run", "robot", maintain_order=True)
    }
    rows, runs = [], []
    for key, own in found.drives.sort("run", "robot", maintain_order=True).group_by(
        "run", "robot", maintain_order=True
    ):
        if own.height < LEAST_DRIVES:
            continue
        line, course = line_of(own), courses.get(key)
        of_course = (np.nan,) * 6 if course is None else course[1:]  # from bend_per_m to samples
        rows.append((*line[:5], *of_course, line.start_error_m_s))
        runs.append(key[0])
    return np.array(rows, dtype=np.float64).reshape(-1, 12), np.array(runs, dtype=np.int64)


def _slow_share(correlation: float, turns: float, samples: float) -> float:
    """Return the share of a veer's variance that is slow, from the mean autocorrelation of turns over ``SLOW_LAGS``.

    The slow part is linear between independent values every ``DRIFT_SAMPLES`` samples. It changes over these lags, and
    deviations are those from a session's own middle, which takes a part of both parts away.

    Args:
        turns, samples: number of measured turns and of samples of a session.
    """
    lag = np.array(SLOW_LAGS) / DRIFT_SAMPLES
    kept = float(np.mean(1.0 - 1.5 * lag**2 + 0.75 * lag**3))  # correlation of the slow part over a lag
    # The variances of both parts' means over a session, see ``_between_sessions``. Turns of neighbouring intervals
    # share a part (correlation 1/2), so that their mean varies twice as much if all are measured.
    of_drift, of_turns = 1.5 * DRIFT_SAMPLES / samples, (1.0 + min(turns / samples, 1.0)) / turns
    known = correlation + of_turns * (1.0 - correlation)
    share = known / max(kept - (of_drift - of_turns) * (1.0 - correlation), 0.1)
    return float(min(max(share, 0.0), 1.0))


def _estimates(table: Floats) -> dict[str, float]:
    """Return the estimates by name, from the means and standard deviations over robots in sessions.

    If fewer than two robots have a known veer, the estimates of the veer are left out; likewise those of the bend.

    Args:
        table: from ``_table_of_robots``, or a resample of its rows.
    """
    mean, start, lost, within, veer = table.T[:5]
    between = float(start.std(ddof=1))
    inside = float(np.sqrt((within**2).mean()))
    estimates = {
        "speed_m_s": float(mean.mean()),
        "start_speed_m_s": float(start.mean()),
        "between_m_s": between,
        "within_m_s": inside,
        "share_between": float(_share_between(between, inside)),
        "battery_life_s": float(_battery_life_s(lost.mean())),
    }
    known = veer[np.isfinite(veer)]
    if known.size > 1:
        estimates |= {"veer_rad_s": float(known.mean()), "veer_between_rad_s": float(known.std(ddof=1))}
    driven = table[np.isfinite(table[:, BEND])]
    if len(driven) > 1:
        slow = driven[np.isfinite(driven[:, SLOW])]
        estimates |= {
            "bend_per_m": float(driven[:, BEND].mean()),
            "bend_between_per_m": float(driven[:, BEND].std(ddof=1)),
            "bend_within_per_m": float(driven[:, SPREAD].mean()),
            "slow_share": _slow_share(*slow[:, [SLOW, TURNS, SAMPLES]].mean(axis=0)) if len(slow) else 0.0,
            "distance_spread": float(driven[:, DISTANCE].mean()),
        }
    return estimates
