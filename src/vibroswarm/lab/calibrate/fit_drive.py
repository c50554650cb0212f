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

The bend is the turn per distance driven, 1/m; the track is the distance between the wheels; "wander" is variation from
sample to sample.

The same robot may have different numbers in different sessions (in the study's recordings all but one do). Robots are
therefore matched to the robots of the first session by speed and veer, minimising the sum of squared differences in
units of ``APART``. Robots that are alike are matched to whichever looks most alike, so that their variation between
sessions comes out too small: by 9 % for five robots 2 mm/s apart, by half for twenty.

Variation of speed within a robot is taken as independent between samples, but not for the error of v_0: real speeds also
change slowly. It is the error of a line of which the deviations of ``drive.BLOCKS`` parts of a session are independent.

Errors: of the mean and spread of robots, and of variation within them, Student's t and chi-square of so many robots
(``few_groups``), which count once in each session if they cannot be matched; of the variation of v_0 between sessions,
chi-square of robots in sessions; of the slow share, bootstrap over robots in sessions.
"""  # noqa: E501

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from scipy.optimize import linear_sum_assignment

from vibroswarm.core.arrays import Floats
from vibroswarm.errors import InputError
from vibroswarm.lab.calibrate.dataset import Dataset
from vibroswarm.lab.calibrate.drive import (
    LEAST_DRIVES,
    LEAST_M,
    SLOW_LAGS,
    calm_intervals,
    course_of,
    line_of,
    undisturbed,
)
from vibroswarm.lab.calibrate.few_groups import drawn_means, drawn_variances, evenly_drawn
from vibroswarm.lab.recordings.threshold import resample
from vibroswarm.motion.robot_params import DRIFT_SAMPLES
from vibroswarm.scenario.scenario import Scenario

SHAPE: Final = 100.0
"""Shape of the Gamma law of speed factors: large, so that it is nearly normal."""
DRAWS: Final = 200
"""Draws of each estimate."""
_SEED: Final = 32
APART: Final = (0.003, np.radians(1.5))
"""Largest plausible difference of a robot's speed (m/s) and veer (rad/s) between sessions. With larger differences the
sessions are taken to have different robots, and no field of individual robots is set."""
LEAST_VARIATION: Final = 1e-3
"""Variations of misalignments, and of speeds between sessions, below this are left out of the scenario."""
MOST_VARIATION: Final = 0.08
"""Larger variations of misalignments are cut to this."""
LAWS: Final = {
    "speed_m_s": ("speed_m_s", ""),
    "start_speed_m_s": ("start_speed_m_s", "between_m_s"),
    "lost_per_s": ("lost_per_s", ""),
    "veer_rad_s": ("veer_rad_s", "veer_between_rad_s"),
    "bend_per_m": ("bend_per_m", "bend_between_per_m"),
    "spread_per_m": ("bend_within_per_m", ""),
    "distance_spread": ("distance_spread", ""),
}
"""By column of the table of robots: the names of the estimates of its mean and of its spread between robots."""


@dataclass(frozen=True)
class DriveFit:
    """Estimates by name and their draws, (draws,)."""

    values: dict[str, float]
    """Estimates by name (``_estimates``), SI units. ``between_sessions`` is the sd of a robot's speed at the start
    between sessions, relative; it is missing with one session, or if robots cannot be matched."""
    draws: dict[str, Floats]
    distance_ratio: float
    """Distance driven between the samples of an undisturbed interval, divided by that at driving speed: below 1
    because of starts, stops and clocks. The speeds of the scenario are multiplied by it."""
    bodies: pl.DataFrame
    """start_speed_m_s and bend_per_m of each robot; no rows if robots cannot be matched."""
    bend_between_sessions_per_m: float
    """Standard deviation of a robot's bend between sessions; 0 if variation within sessions explains all of it."""

    def fields(self, base: Scenario) -> dict[str, object]:
        """Return the scenario's fields for these estimates, by dotted name; None: robots do not have it.

        Values are clipped to what robots can have: speed factors are positive, a battery outlasts the run, and
        misalignments are between -0.5 and 0.5. Fields of individual robots are given only if speeds vary more between
        robots than within them, because the list of their speed factors requires ``speed_redraw`` "robot".

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
        # Speed about its mean: of the distances of undisturbed intervals; without any, of the speeds of drives.
        wander = values.get("distance_spread", values["within_m_s"] / values["speed_m_s"])
        # A Gamma law has the mean location + shape x scale and the standard deviation sqrt(shape) x scale.
        fields: dict[str, object] = {
            "robot.speed_factor_shape": SHAPE,
            "robot.speed_factor_scale": _round(spread / np.sqrt(SHAPE)),
            "robot.speed_factor_location": _round(mean - spread * np.sqrt(SHAPE)),
            "robot.speed_factor_min": low,
            "robot.speed_factor_max": high,
            "robot.speed_factors": None,
            "robot.speed_redraw": "robot" if by_robot else "sample",
            # 0.4 is the largest value that the field accepts.
            "robot.speed_wander": _round(min(wander, 0.4)) if by_robot else None,
            "robot.speed_run_spread": _round(min(run_spread, 0.4)) if varies else None,
            "robot.battery_life_s": _round(max(values["battery_life_s"], 1.01 * base.run.t_end_s), 0),
        }
        half_track_m = robot.drive_track_m / 2.0  # bend times half the track is misalignment
        if "bend_per_m" in values:
            fields |= self._veers(half_track_m)
        if by_robot and self.bodies.height:
            speeds, bends = self.bodies["start_speed_m_s"], self.bodies["bend_per_m"]
            factors = [_round(self.distance_ratio * speed / robot.full_speed_m_s) for speed in speeds]
            fields["robot.speed_factors"] = factors
            fields["robot.speed_factor_min"] = min(low, *factors)
            fields["robot.speed_factor_max"] = max(high, *factors)
            if not bends.null_count():
                bent = np.clip(bends.to_numpy() * half_track_m, -0.5, 0.5)
                fields["robot.misalignments"] = [_round(one) for one in bent]
        return fields

    def _veers(self, half_track_m: float) -> dict[str, object]:
        values = self.values
        middle = values["bend_per_m"] * half_track_m
        half = np.sqrt(3.0) * values["bend_between_per_m"] * half_track_m  # half-width of a uniform law
        # Spread s (as a misalignment) and slow share c of a robot's turns D, see ``drive``. D is the mean of the turns
        # in two successive intervals. A mean of two independent values has half the variance of one, hence the 2.
        within, slow = values["bend_within_per_m"] * half_track_m, values["slow_share"]
        variation = {
            "wander": within * np.sqrt(2.0 * (1.0 - slow)),
            "drift": within * np.sqrt(slow),
            "run_spread": self.bend_between_sessions_per_m * half_track_m,
        }
        limits: dict[str, object] = {
            "robot.misalignment_min": _round(max(middle - half, -0.5)),
            "robot.misalignment_max": _round(min(middle + half, 0.5)),
            "robot.misalignments": None,
        }
        return limits | {
            f"robot.misalignment_{name}": _round(min(size, MOST_VARIATION))
            if size >= LEAST_VARIATION
            else None
            for name, size in variation.items()
        }


def _round(value: float, digits: int = 5) -> float:
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
    table = _table_of_robots(found)
    if table.height < 2:
        raise InputError(
            "at least two robots with ten drives each are needed to fit speeds; a drive is an interval between samples "
            "without avoidance, which logs with avoid_total_s show",
            field="REAL",
        )
    matched = _matched(table)
    bodies = table.clear() if matched is None else _bodies(matched)
    # The robots' spread is that of so many robots, not of their rows, which are alike where robots are the same.
    independent = bodies if bodies.height > 1 else table
    spreads = [spread for _, spread in LAWS.values() if spread]
    of_robots = _estimates(independent)
    values = _estimates(table) | {name: of_robots[name] for name in spreads if name in of_robots}
    drawn = _drawn_laws(independent, draws)
    for each in (values, drawn):
        each["share_between"] = each["between_m_s"] ** 2 / (
            each["between_m_s"] ** 2 + each["within_m_s"] ** 2
        )
        # A life of 1e9 s where robots do not slow down.
        each["battery_life_s"] = 1.0 / np.maximum(each.pop("lost_per_s"), 1e-9)
    if "slow_share" in values:
        resampled = (table[resample(_SEED, draw, stream=0, count=table.height)] for draw in range(draws))
        drawn["slow_share"] = np.array([_slow_share(rows) for rows in resampled])
    sessions = table["run"].n_unique()
    if matched is not None and sessions > 1:
        values["between_sessions"], drawn["between_sessions"] = _speed_between_sessions(matched, draws)
    return DriveFit(
        values={name: float(value) for name, value in values.items()},
        draws=drawn,
        distance_ratio=_distance_ratio(found, table, base),
        bodies=bodies,
        bend_between_sessions_per_m=0.0 if matched is None else _bend_between_sessions(matched, values),
    )


def timed_drive_ms(base: Scenario) -> float:
    """Return how long a robot drives from a sample to the next stop, without turns: until its timer exceeds tau, ms.

    It is the first multiple of the control period above the sample interval tau.
    """
    period = base.run.control_period_ms
    return period * (math.floor(base.sample.sample_interval_ms / period) + 1.0)


def _table_of_robots(found: Dataset) -> pl.DataFrame:
    """Return a row for each robot with ten drives in each session: run, and what ``line_of`` and ``course_of`` give."""
    key = ["run", "robot"]
    courses = {
        name: course_of(own) for name, own in undisturbed(found.samples).group_by(*key, maintain_order=True)
    }
    rows = [
        {"run": name[0]} | line_of(own) | courses.get(name, {})
        for name, own in found.drives.sort(*key, maintain_order=True).group_by(*key, maintain_order=True)
        if own.height >= LEAST_DRIVES
    ]
    course = ("bend_per_m", "spread_per_m", "correlation", "distance_spread", "turns", "samples")
    schema = dict.fromkeys((*(rows[0] if rows else ()), *course), pl.Float64)
    return pl.DataFrame(rows, schema=schema)


def _estimates(table: pl.DataFrame) -> dict[str, Any]:
    """Return the estimates by name: means and standard deviations over robots that have the value, at least two."""
    estimates: dict[str, Any] = {"within_m_s": math.sqrt((table["within_m_s"] ** 2).mean())}  # type: ignore[arg-type]
    for column, (mean, spread) in LAWS.items():
        known = table[column].drop_nulls().to_numpy()
        if known.size > 1:
            estimates[mean] = known.mean()
            if spread:
                estimates[spread] = known.std(ddof=1)
    if "bend_per_m" in estimates:
        estimates["slow_share"] = _slow_share(table)
    return estimates


def _drawn_laws(robots: pl.DataFrame, draws: int) -> dict[str, Any]:
    """Return draws of means and spreads of the laws of all robots of this kind, by name, (draws,) each."""
    squares = robots["within_m_s"].to_numpy() ** 2
    means = drawn_means(squares, evenly_drawn(draws, _SEED, "within_m_s"))
    drawn = {"within_m_s": np.sqrt(np.maximum(means, 0.0))}
    for column, (mean, spread) in LAWS.items():
        known = robots[column].drop_nulls().to_numpy()
        if known.size < 2:
            continue
        drawn[mean] = drawn_means(known, evenly_drawn(draws, _SEED, mean))
        if mean in ("bend_within_per_m", "distance_spread"):
            drawn[mean] = np.maximum(drawn[mean], 0.0)
        if spread:
            u = evenly_drawn(draws, _SEED, spread)
            drawn[spread] = np.sqrt(drawn_variances(float(known.var(ddof=1)), known.size - 1, u))
    return drawn


def _slow_share(table: pl.DataFrame) -> float:
    """Return the share of a veer's variance that is slow, from the mean autocorrelation of turns over ``SLOW_LAGS``.

    The slow part is linear between independent values every ``DRIFT_SAMPLES`` samples. It changes over these lags, and
    deviations are those from a session's own middle, which takes a part of both parts away.
    """
    known = table.drop_nulls("correlation")
    if known.is_empty():
        return 0.0
    correlation, turns, samples = known.select("correlation", "turns", "samples").mean().row(0)
    lag = np.array(SLOW_LAGS) / DRIFT_SAMPLES
    kept = float(np.mean(1.0 - 1.5 * lag**2 + 0.75 * lag**3))  # correlation of the slow part over a lag
    # The variances of both parts' means over a session, see ``_bend_between_sessions``. Turns of neighbouring intervals
    # share a part (correlation 1/2), so that their mean varies twice as much if all are measured.
    of_drift, of_turns = 1.5 * DRIFT_SAMPLES / samples, (1.0 + min(turns / samples, 1.0)) / turns
    own = correlation + of_turns * (1.0 - correlation)
    return float(np.clip(own / max(kept - (of_drift - of_turns) * (1.0 - correlation), 0.1), 0.0, 1.0))


def _matched(table: pl.DataFrame) -> pl.DataFrame | None:
    """Match the robots of all sessions: the table with a column ``body``, the robot of the first session.

    Returns:
        None if sessions have different numbers of robots, or if matched robots differ too much between sessions: their
        variance, in units of ``APART`` squared, exceeds 1 in the mean over robots, speed and bend (if all bends are
        known). The sessions then have different robots.
    """
    sessions = table.partition_by("run", maintain_order=True)
    if len({session.height for session in sessions}) > 1:
        return None
    scale = np.array([1.0, float(table["speed_m_s"].mean())]) / APART  # type: ignore[arg-type]  # bend x speed: a veer
    bodies = [scale * session.select("start_speed_m_s", "bend_per_m").to_numpy() for session in sessions]
    orders = []
    for own in bodies:
        # Differences between each robot of the first session and each of this one; of unknown bends they count as 0.
        apart = np.nan_to_num(bodies[0][:, None] - own[None])
        orders.append(linear_sum_assignment((apart**2).sum(axis=2))[1])
    if len(sessions) > 1:
        own = np.array([body[order] for body, order in zip(bodies, orders, strict=True)])
        if np.nanmean(own.var(axis=0, ddof=1).mean(axis=0)) > 1.0:
            return None
    ordered = [session[order] for session, order in zip(sessions, orders, strict=True)]
    return pl.concat(ordered).with_columns(body=pl.int_range(pl.len()).over("run"))


def _bodies(matched: pl.DataFrame) -> pl.DataFrame:
    """Return the means of each robot over the sessions in which it is known; of ``within_m_s``, that of squares."""
    square = pl.col("within_m_s").pow(2).mean().sqrt()
    return matched.group_by("body", maintain_order=True).agg(
        pl.all().exclude("run", "within_m_s").mean(), square
    )


def _speed_between_sessions(matched: pl.DataFrame, draws: int) -> tuple[float, Floats]:
    """Return the sd of a robot's speed at the start between sessions, relative, without what its error explains."""
    start, mean = pl.col("start_speed_m_s"), pl.col("start_speed_m_s").mean()
    robots = matched.group_by("body", maintain_order=True).agg(
        total=(start / mean).var(), noise=(pl.col("start_error_m_s") / mean).pow(2).mean()
    )
    total, noise = robots.select(pl.col("total", "noise").mean()).row(0)
    u = evenly_drawn(draws, _SEED, "between sessions")
    drawn = drawn_variances(total, matched.height - robots.height, u)
    return math.sqrt(max(total - noise, 0.0)), np.sqrt(np.maximum(drawn - noise, 0.0))


def _bend_between_sessions(matched: pl.DataFrame, values: dict[str, Any]) -> float:
    """Return the standard deviation of a robot's bend between sessions, without what variation within them explains."""
    variance = (
        matched.group_by("body", maintain_order=True).agg(pl.col("bend_per_m").var())["bend_per_m"].mean()
    )
    if variance is None:
        return 0.0
    within, slow = values["bend_within_per_m"] ** 2, values["slow_share"]
    turns, samples = matched.select(pl.col("turns", "samples").mean()).row(0)
    # Variation from sample to sample: an interval's own turn has the variance 2 within (1 - slow), because a measured
    # turn is the mean of two intervals' turns. A session's bend is a median, with pi / 2 times the variance of a mean.
    of_median = 0.5 * np.pi * 2.0 * within * (1.0 - slow) / turns
    # Slow variation: it has a new, independent value every DRIFT_SAMPLES samples, and is linear between these values.
    # Values on the lines have 2 / 3 of the variance of the independent values, hence 1.5.
    of_drift = 1.5 * within * slow * DRIFT_SAMPLES / samples
    return math.sqrt(max(float(variance) - of_median - of_drift, 0.0))  # type: ignore[arg-type]


def _distance_ratio(found: Dataset, table: pl.DataFrame, base: Scenario) -> float:
    """Return the distance driven in undisturbed intervals, divided by the distance at driving speed.

    The distance driven is the arc of the robot's bend whose chord is the mean distance between the two samples, without
    intervals in which something held the robot up. The distance at driving speed is the mean speed times the time of a
    drive from sample to sample. Both are means over robots in sessions. The result is 1, no correction, with fewer than
    50 undisturbed intervals, if a robot has none, and if the ratio is not between 0.8 and 1.25, which is not plausible.
    """
    calm = calm_intervals(found.samples).filter(pl.col("distance_m") > LEAST_M).sort("run", "robot")
    chords = calm.group_by("run", "robot", maintain_order=True).agg(pl.col("distance_m").mean())
    if calm.height < 50 or chords.height != table.height:
        return 1.0
    chord, bend = chords["distance_m"].to_numpy(), table["bend_per_m"].fill_null(0.0).to_numpy()
    # Half the angle of the arc, of which the distance is the chord.
    half = np.arcsin(np.clip(np.abs(bend) * chord / 2.0, 1e-9, 1.0))
    arcs = chord * half / np.sin(half)
    speed_m_s = float(table["speed_m_s"].mean())  # type: ignore[arg-type]
    ratio = float(arcs.mean()) / (speed_m_s * timed_drive_ms(base) / 1000.0)
    return ratio if 0.8 < ratio < 1.25 else 1.0
