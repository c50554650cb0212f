"""Fit speed, battery and veer in closed form, from undisturbed drives and intervals (``dataset``).

| name | symbol | unit | equation |
|---|---|---|---|
| speed at the start | v_0 | m/s | v at t = 0, from v = v_0 (1 - t / life) by least squares for each robot and session |
| turn | D | rad | direction from sample to sample minus that in the interval before (both undisturbed) |
| bend | - | 1/m | D / L, L the length of the arc: times half the track a misalignment |
| spread | s | - | interquartile range of D about the robot's median, / 1.349: insensitive to undetected turns |
| slow share | c | - | share of the variance that changes slowly, from the autocorrelation of D over ``SLOW_LAGS`` |
| variation of distance | - | - | interquartile range about a line in time, / 1.435 (triangular law) / the median |

| field | equation |
|---|---|
| robot.speed_factor_location, _scale (shape 100: nearly normal) | from the mean and sd between robots of v_0 / full speed |
| robot.speed_factor_min, _max | mean -+ 3 sd |
| robot.speed_redraw | "robot" if more than half of the variance is between robots |
| robot.speed_wander | variation of distances within robots, if speed_redraw is "robot" |
| robot.speed_run_spread | sd of a robot's v_0 between sessions, relative, minus what the error of v_0 explains |
| robot.battery_life_s | 1 / (share of v_0 lost per second) |
| robot.misalignment_min, _max | m = bend track / 2; uniform of the same mean and sd: mean -+ sqrt(3) sd |
| robot.misalignment_wander | variation of m from sample to sample: s sqrt(2 (1 - c)), as D is the mean of two intervals' turns |
| robot.misalignment_drift | slow variation of m: s sqrt(c) |
| robot.misalignment_run_spread | sd of a robot's m between sessions, minus what the variation within sessions explains |
| robot.speed_factors, misalignments | of each robot: mean over sessions, if robots can be matched and speed_redraw is "robot" |

The same robot may have different numbers in different sessions (in the study's recordings all but one do). Robots are
therefore matched to the robots of the first session by speed and veer, minimising the sum of squared differences in
units of ``APART``. Robots that are alike are matched to whichever looks most alike, so that their variation between
sessions comes out too small: by 9 % for five robots 2 mm/s apart, by half for twenty.

Errors: of the mean and spread of robots, and of variation within them, Student's t and chi-square of so many robots
(``few_groups``), which count once in each session if they cannot be matched; of the variation of v_0 between sessions,
chi-square of robots in sessions.
"""  # noqa: E501

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from scipy.optimize import linear_sum_assignment

from vibroswarm.calibrate.dataset import CALM_S, LEAST_M, Dataset, calm_intervals
from vibroswarm.calibrate.few_groups import drawn_means, drawn_variances, evenly_drawn
from vibroswarm.calibrate.samples import ROUNDING_S
from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError
from vibroswarm.motion.robot_params import DRIFT_SAMPLES
from vibroswarm.scenario.scenario import Scenario

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
SHAPE: Final = 100.0
"""Shape of the Gamma law of speed factors: large, so that it is nearly normal."""
DRAWS: Final = 200
_SEED: Final = 32
APART: Final = (0.003, np.radians(1.5))
"""Largest plausible difference of a robot's speed (m/s) and veer (rad/s) between sessions. With larger differences the
sessions are taken to have different robots, and no field of individual robots is set."""
LEAST_VARIATION: Final = 1e-3
"""Variations of misalignments, and of speeds between sessions, below this are left out of the scenario."""
LAWS: Final = {
    "speed_m_s": ("speed_m_s", ""),
    "start_speed_m_s": ("start_speed_m_s", "between_m_s"),
    "lost_per_s": ("lost_per_s", ""),
    "bend_per_m": ("bend_per_m", "bend_between_per_m"),
    "spread_per_m": ("bend_within_per_m", ""),
    "distance_spread": ("distance_spread", ""),
}
"""By column of the table of robots: the names of the estimates of its mean and of its spread between robots."""


@dataclass(frozen=True)
class DriveFit:
    """Estimates, SI units, and their draws, (draws,), by name; the scenario's fields (None: robots do not have it)."""

    values: dict[str, float]
    """``between_sessions`` is relative; it is missing with one session, or if robots cannot be matched."""
    draws: dict[str, Floats]
    fields: dict[str, object]
    speed_m_s: float
    """Mean speed of the scenario's robots at the start."""


def fit_drive(found: Dataset, base: Scenario, draws: int = DRAWS) -> DriveFit:
    """Fit speed, battery and veer over all robots, and speed and bend of each robot if robots can be matched.

    Positions are corrected for the camera; ``base`` has the sample interval that the robots were programmed with.

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
    bodies = table.clear()
    if matched is not None:  # means over the sessions in which a robot is known
        square = pl.col("within_m_s").pow(2).mean().sqrt()
        means = pl.all().exclude("run", "within_m_s").mean()
        bodies = matched.group_by("body", maintain_order=True).agg(means, square)
    # The robots' spread is that of so many robots, not of their rows, which are alike where robots are the same.
    values, drawn = _laws(table, bodies if bodies.height > 1 else table, draws)
    if matched is not None and table["run"].n_unique() > 1:
        values["between_sessions"], drawn["between_sessions"] = _speed_between_sessions(matched, draws)
    ratio = _distance_ratio(found, table, base)
    bend_between = 0.0
    if matched is not None and "bend_per_m" in values:
        bend_between = _bend_between_sessions(matched, values)
    fields = _fields(values, bodies, base, ratio, bend_between)
    return DriveFit(values, drawn, fields, ratio * values["start_speed_m_s"])


def timed_drive_ms(base: Scenario) -> float:
    """Return how long a robot drives until its timer exceeds tau: the first multiple of a control period above it."""
    period = base.run.control_period_ms
    return period * (math.floor(base.sample.sample_interval_ms / period) + 1.0)


def _fields(
    values: dict[str, Any], bodies: pl.DataFrame, base: Scenario, ratio: float, bend_between_sessions: float
) -> dict[str, object]:
    """Return the scenario's fields, clipped to what robots can have; None: robots do not have it.

    Fields of individual robots are given only if speeds vary more between robots than within them, because the list of
    their speed factors requires ``speed_redraw`` "robot".
    """
    full_m_s = base.robot.full_speed_m_s
    mean = ratio * values["start_speed_m_s"] / full_m_s  # speed factor
    by_robot = values["share_between"] > 0.5  # one speed factor per robot, not one per sample
    # The scale of a Gamma distribution must be above 0.
    spread = max((values["between_m_s"] if by_robot else values["within_m_s"]) / full_m_s, 1e-3)
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
    half_track_m = base.robot.drive_track_m / 2.0  # bend times half the track is misalignment
    if "bend_per_m" in values:
        middle = values["bend_per_m"] * half_track_m
        half = np.sqrt(3.0) * values["bend_between_per_m"] * half_track_m  # half-width of a uniform law
        within, slow = values["bend_within_per_m"] * half_track_m, values["slow_share"]
        variation = {
            # D is the mean of two independent values, which has half the variance of one, hence the 2.
            "robot.misalignment_wander": within * np.sqrt(2.0 * (1.0 - slow)),
            "robot.misalignment_drift": within * np.sqrt(slow),
            "robot.misalignment_run_spread": bend_between_sessions * half_track_m,
        }
        fields |= {
            "robot.misalignment_min": _round(max(middle - half, -0.5)),
            "robot.misalignment_max": _round(min(middle + half, 0.5)),
            "robot.misalignments": None,
        } | {
            name: _round(min(size, 0.08)) if size >= LEAST_VARIATION else None
            for name, size in variation.items()
        }
    if by_robot and bodies.height:
        factors = [_round(ratio * speed / full_m_s) for speed in bodies["start_speed_m_s"]]
        fields["robot.speed_factors"] = factors
        fields["robot.speed_factor_min"] = min(low, *factors)
        fields["robot.speed_factor_max"] = max(high, *factors)
        if not bodies["bend_per_m"].null_count():
            bent = np.clip(bodies["bend_per_m"].to_numpy() * half_track_m, -0.5, 0.5)
            fields["robot.misalignments"] = [_round(one) for one in bent]
    return fields


def _round(value: float, digits: int = 5) -> float:
    return round(float(value), digits)


def _table_of_robots(found: Dataset) -> pl.DataFrame:
    """Return ``run``, ``line_of`` and ``course_of`` of each robot with ten drives in each session."""
    courses = dict(undisturbed(found.samples).group_by("run", "robot", maintain_order=True))
    rows: list[dict[str, float]] = []
    for name, own in found.drives.sort("run", "robot", maintain_order=True).group_by(
        "run", "robot", maintain_order=True
    ):
        if own.height >= 10:
            course = course_of(courses[name]) if name in courses else {}
            rows.append({"run": name[0]} | line_of(own) | course)
    names = (
        "run", "speed_m_s", "start_speed_m_s", "lost_per_s", "within_m_s", "start_error_m_s",
        "bend_per_m", "spread_per_m", "correlation", "distance_spread", "turns", "samples",
    )  # fmt: skip
    return pl.DataFrame(rows, schema=dict.fromkeys(names, pl.Float64))


def line_of(own: pl.DataFrame) -> dict[str, float]:
    """Return the line v(t) of a robot's drives in one session.

    Real speeds change slowly, too: the standard error of the speed at the start is that of ``BLOCKS`` stretches that
    deviate independently.
    """
    time, speed = own["time_s"].to_numpy(), own["speed_m_s"].to_numpy()
    slope, start = np.polyfit(time, speed, 1)
    deviations = speed - start - slope * time
    # The line's value at time 0 is the sum of these weights times the values.
    off = time - time.mean()
    weights = 1.0 / time.size - time.mean() * off / (off**2).sum()
    sums = [part.sum() for part in np.array_split(weights * deviations, BLOCKS)]
    return {
        "speed_m_s": float(speed.mean()),
        "start_speed_m_s": float(start),
        "lost_per_s": float(-slope / start),
        # The line takes two degrees of freedom.
        "within_m_s": float(np.sqrt(float((deviations**2).sum()) / (time.size - 2))),
        "start_error_m_s": float(np.sqrt(np.square(sums).sum() * BLOCKS / (BLOCKS - 2))),
    }


def undisturbed(samples: pl.DataFrame) -> pl.DataFrame:
    """Return the undisturbed intervals whose previous interval is undisturbed too, so that a turn is defined.

    Those with a turn of 40 degrees or more are left out, because it is taken to be a turn on the spot. ``index`` counts
    a robot's samples in a run; it and ``time_s`` are those of the sample that ends the interval.
    """
    key = ["run", "robot"]
    without_avoidance = pl.col("avoid_s") < ROUNDING_S
    usual_s = samples.filter(without_avoidance)["spacing_s"].median()  # None without rows: none is chosen
    like_usual = (pl.col("spacing_s") - usual_s).abs() <= CALM_S
    turn = pl.arctan2("dy_m", "dx_m").diff().over(key)
    marked = samples.sort("run", "robot", "time_s").with_columns(
        calm=(without_avoidance & like_usual & (pl.col("distance_m") > LEAST_M)).fill_null(False),
        turn_rad=(turn + np.pi) % (2.0 * np.pi) - np.pi,
        index=pl.int_range(pl.len()).over(key),
    )
    calm_twice = pl.col("calm") & pl.col("calm").shift(1).over(key).fill_null(False)
    chosen = marked.filter(calm_twice & (pl.col("turn_rad").abs() < np.radians(40.0)))
    return chosen.select("run", "robot", "index", "time_s", "turn_rad", "distance_m")


def course_of(own: pl.DataFrame) -> dict[str, Any]:
    """Return how a robot drives in one session, from ``undisturbed``; ``samples`` are those up to the last turn."""
    if own.height < 30:
        return {}
    turn, distance, time = (own[name].to_numpy() for name in ("turn_rad", "distance_m", "time_s"))
    middle, usual_m = float(np.median(turn)), float(np.median(distance))
    # An arc of angle a has the length chord x (a / 2) / sin(a / 2); the chord is the distance between two samples.
    half = max(abs(middle) / 2.0, 1e-9)
    arc_m = usual_m * half / np.sin(half)
    spread = quartile_spread(turn - middle)
    line = np.polyval(np.polyfit(time, distance, 1), time)
    return {
        "bend_per_m": float(middle / arc_m),
        "spread_per_m": float(spread / arc_m),
        "correlation": _slow_correlation(own["index"].to_numpy(), turn - middle, spread),
        "distance_spread": float(quartile_spread(distance - line) * IQR / IQR_TRIANGULAR / usual_m),
        "turns": float(own.height),
        "samples": float(own["index"][-1]) + 1.0,
    }


def quartile_spread(values: Floats) -> float:
    """Return the standard deviation of a normal distribution with the interquartile range of these values."""
    return float(np.ptp(np.quantile(values, [0.25, 0.75]))) / IQR


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


def _laws(table: pl.DataFrame, robots: pl.DataFrame, draws: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the estimates by name, of all rows of the table, and draws of their law for ``robots``, (draws,) each."""
    means = drawn_means(robots["within_m_s"].to_numpy() ** 2, evenly_drawn(draws, _SEED, "within_m_s"))
    drawn: dict[str, Any] = {"within_m_s": np.sqrt(np.maximum(means, 0.0))}
    values: dict[str, Any] = {"within_m_s": math.sqrt((table["within_m_s"] ** 2).mean())}  # type: ignore[arg-type]  # to polars a mean may be of dates
    for column, (mean, spread) in LAWS.items():
        own = robots[column].drop_nulls().to_numpy()
        if own.size < 2:
            continue
        values[mean] = float(table[column].drop_nulls().to_numpy().mean())
        drawn[mean] = drawn_means(own, evenly_drawn(draws, _SEED, mean))
        if mean in ("bend_within_per_m", "distance_spread"):
            drawn[mean] = np.maximum(drawn[mean], 0.0)
        if spread:
            values[spread] = float(own.std(ddof=1))
            u = evenly_drawn(draws, _SEED, spread)
            drawn[spread] = np.sqrt(drawn_variances(float(own.var(ddof=1)), own.size - 1, u))
    for each in (values, drawn):
        between = each["between_m_s"] ** 2
        each["share_between"] = between / (between + each["within_m_s"] ** 2)
        # A life of 1e9 s where robots do not slow down.
        each["battery_life_s"] = 1.0 / np.maximum(each.pop("lost_per_s"), 1e-9)
    if "bend_per_m" in values:
        values["slow_share"] = _slow_share(table)
    return values, drawn


def _slow_share(table: pl.DataFrame) -> float:
    """Return the share of a veer's variance that is slow, from the mean autocorrelation of turns over ``SLOW_LAGS``.

    The slow part is linear between independent values every ``DRIFT_SAMPLES`` samples. Deviations are those from a
    session's own middle, which takes a part of both parts away.
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

    None if sessions have different robots: other numbers of them, or a variance of matched robots, in units of
    ``APART`` squared, above 1 in the mean over robots, speed and bend (if all bends are known).
    """
    sessions = table.partition_by("run", maintain_order=True)
    if len({session.height for session in sessions}) > 1:
        return None
    scale = np.array([1.0, float(table["speed_m_s"].mean())]) / APART  # type: ignore[arg-type]  # bend x speed: a veer
    bodies = [scale * session.select("start_speed_m_s", "bend_per_m").to_numpy() for session in sessions]
    # Differences between each robot of the first session and each of another; of unknown bends they count as 0.
    apart = [(np.nan_to_num(bodies[0][:, None] - own[None]) ** 2).sum(axis=2) for own in bodies]
    orders = [linear_sum_assignment(of_pairs)[1] for of_pairs in apart]
    own = np.array([body[order] for body, order in zip(bodies, orders, strict=True)])
    if len(sessions) > 1 and np.nanmean(own.var(axis=0, ddof=1).mean(axis=0)) > 1.0:
        return None
    ordered = [session[order] for session, order in zip(sessions, orders, strict=True)]
    return pl.concat(ordered).with_columns(body=pl.int_range(pl.len()).over("run"))


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
    return math.sqrt(max(float(variance) - of_median - of_drift, 0.0))  # type: ignore[arg-type]  # to polars a mean may be of dates


def _distance_ratio(found: Dataset, table: pl.DataFrame, base: Scenario) -> float:
    """Return the distance driven in undisturbed intervals, divided by the distance at driving speed.

    The distance driven is the arc of the robot's bend whose chord is the mean distance between the two samples, without
    intervals in which something held the robot up. 1, no correction, with fewer than 50 such intervals, if a robot has
    none, and if the ratio is not plausible.
    """
    calm = calm_intervals(found.samples).filter(pl.col("distance_m") > LEAST_M).sort("run", "robot")
    chords = calm.group_by("run", "robot", maintain_order=True).agg(pl.col("distance_m").mean())
    if calm.height < 50 or chords.height != table.height:
        return 1.0
    chord, bend = chords["distance_m"].to_numpy(), table["bend_per_m"].fill_null(0.0).to_numpy()
    # Half the angle of the arc, of which the distance is the chord.
    half = np.arcsin(np.clip(np.abs(bend) * chord / 2.0, 1e-9, 1.0))
    arcs = chord * half / np.sin(half)
    speed_m_s = float(table["speed_m_s"].mean())  # type: ignore[arg-type]  # to polars a mean may be of dates
    ratio = float(arcs.mean()) / (speed_m_s * timed_drive_ms(base) / 1000.0)
    return ratio if 0.8 < ratio < 1.25 else 1.0
