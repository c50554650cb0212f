"""Fit speed, battery and veer in closed form.

| field | equation |
|---|---|
| robot.speed_factor_location, _scale (shape 100: nearly normal), _min, _max | mean and sd between robots of v_0 / full speed; 3 sd |
| robot.speed_redraw | "robot" if more than half of the variance is between robots |
| robot.speed_wander | variation of distances within robots, if speed_redraw is "robot" (``undisturbed``) |
| robot.battery_life_s | 1 / (share lost a second): v = v_0 (1 - t / life), least squares for each robot and session |
| robot.misalignment_min, _max | m = bend track / 2; uniform of the same mean and sd: mean -+ sqrt(3) sd |
| robot.misalignment_wander, _drift | its variation from sample to sample, and slow (``undisturbed``) |
| robot.misalignment_run_spread | sd of a robot between sessions, less what variation within them explains |
| robot.speed_factors, misalignments | of each robot: the mean over sessions, if all sessions have the same number of robots |

A robot may have another number in another session (in the study's recordings all but one do): robots are matched
to those
of the first session by speed and veer, minimising the sum of squared differences in units of ``APART``.

Variation of speed within a robot is taken as independent between samples. Errors: bootstrap over robots in sessions.
"""  # noqa: E501

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.drive import CALM_S, course_of, undisturbed
from vibroswarm.errors import InputError
from vibroswarm.motion.robot_params import DRIFT_SAMPLES
from vibroswarm.recordings.threshold import resample
from vibroswarm.scenario.scenario import Scenario

Floats = NDArray[np.float64]
SHAPE: Final = 100.0
DRAWS: Final = 200
_SEED: Final = 32
APART: Final = (0.003, np.radians(1.5))
"""Largest difference of a robot's speed (m/s) and veer (rad/s) between sessions; beyond it, sessions had other
robots and
none is named."""
_LEAST: Final = 10
"""Fewest drives of a robot in a session."""
LEAST_VARIATION: Final = 1e-3
"""Less variation of misalignments is none."""
MOST_VARIATION: Final = 0.08


@dataclass(frozen=True)
class DriveFit:
    """Estimates by name and their bootstrap draws, (draws,)."""

    values: dict[str, float]
    draws: dict[str, Floats]
    distance_ratio: float
    """Distance between undisturbed samples divided by that at driving speed: the loss from starts, stops and clocks.
    Speeds of
    the scenario are multiplied by it."""
    bodies: Floats
    """Speed at the start, m/s, and bend, 1/m, of each robot, (robots, 2); (0, 2) if they cannot be matched."""
    bend_between_sessions_per_m: float
    """Standard deviation of a robot's bend between sessions; 0 if variation within them explains it, or unknown."""

    def fields(self, base: Scenario) -> dict[str, object]:
        """Return the fields of the scenario given by these estimates."""
        robot, values = base.robot, self.values
        mean = self.distance_ratio * values["start_speed_m_s"] / robot.full_speed_m_s
        kept = values["share_between"] > 0.5
        spread = (values["between_m_s"] if kept else values["within_m_s"]) / robot.full_speed_m_s
        spread = max(spread, 1e-3)
        low, high = _round(max(mean - 3 * spread, 0.2 * mean)), _round(mean + 3 * spread)
        fields: dict[str, object] = {
            "robot.speed_factor_shape": SHAPE,
            "robot.speed_factor_scale": _round(spread / np.sqrt(SHAPE)),
            "robot.speed_factor_location": _round(mean - spread * np.sqrt(SHAPE)),
            "robot.speed_factor_min": low,
            "robot.speed_factor_max": high,
            "robot.speed_redraw": "robot" if kept else "sample",
            "robot.speed_wander": _round(min(self.speed_wander, 0.4)) if kept else None,
            "robot.battery_life_s": _round(max(values["battery_life_s"], 1.01 * base.run.t_end_s), 0),
        }
        if "bend_per_m" in values:
            per = robot.drive_track_m / 2.0
            middle, half = values["bend_per_m"] * per, np.sqrt(3.0) * values["bend_between_per_m"] * per
            fields["robot.misalignment_min"] = _round(max(middle - half, -0.5))
            fields["robot.misalignment_max"] = _round(min(middle + half, 0.5))
            within, slow = values["bend_within_per_m"] * per, values["slow_share"]
            variation = {
                "wander": within * np.sqrt(2.0 * (1.0 - slow)),
                "drift": within * np.sqrt(slow),
                "run_spread": self.bend_between_sessions_per_m * per,
            }
            for name, size in variation.items():
                fields[f"robot.misalignment_{name}"] = (
                    _round(min(size, MOST_VARIATION)) if size >= LEAST_VARIATION else None
                )
        return fields | (self._each(base, low, high) if kept else {})

    @property
    def speed_wander(self) -> float:
        """Variation of speed within a robot: of its distances or, without undisturbed intervals, of its drives."""
        values = self.values
        return values.get("distance_spread", values["within_m_s"] / values["speed_m_s"])

    def _each(self, base: Scenario, low: float, high: float) -> dict[str, object]:
        """Return the fields of individual robots; the bounds of the speed distribution must include them."""
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
    return round(float(value), digits)


def fit_drive(found: Dataset, base: Scenario, draws: int = DRAWS) -> DriveFit:
    """Fit speed, battery and veer.

    Raises:
        InputError: fewer than two robots with ten drives.
    """
    table, runs = _by_robot(found)
    if len(table) < 2:
        raise InputError("at least two robots with ten drives each are needed to fit speeds", field="REAL")
    values = _estimates(table)
    resampled = [_estimates(table[resample(_SEED, draw, 0, len(table))]) for draw in range(draws)]
    draws_by_name = {
        name: np.array([estimates[name] for estimates in resampled if name in estimates]) for name in values
    }
    matched = _matched(table, runs)
    bodies = np.zeros((0, 2)) if matched is None else _mean_of_known(matched)
    between = 0.0 if matched is None else _between_sessions(matched, values, table)
    return DriveFit(values, draws_by_name, _distance_ratio(found, table, base), bodies, between)


def _distance_ratio(found: Dataset, table: Floats, base: Scenario) -> float:
    """Return ``DriveFit.distance_ratio``, where driving from sample to sample takes tau and a control period.

    1 with too few undisturbed intervals, or if the ratio is implausible (beyond 0.8 to 1.25).
    """
    calm = found.samples.filter((pl.col("avoid_s") < 1e-9) & pl.col("spacing_s").is_not_null())
    calm = calm.filter((pl.col("spacing_s") - pl.col("spacing_s").median()).abs() < CALM_S)
    drive_s = base.sample.sample_interval_ms / 1000.0 + base.tick_s
    distances = calm.group_by("run", "robot").agg(pl.col("distance_m").mean())["distance_m"]
    if calm.height < 50 or len(distances) != len(table):
        return 1.0
    ratio = float(distances.mean()) / (float(table[:, 0].mean()) * drive_s)  # type: ignore[arg-type]
    return ratio if 0.8 < ratio < 1.25 else 1.0


def _matched(table: Floats, runs: NDArray[np.int64]) -> Floats | None:
    """Return speed and bend of each robot in each session, (sessions, robots, 2), in the order of the first session;
    None if robots cannot be matched between sessions by speed and veer."""
    speed = float(table[:, 0].mean())
    sessions = [table[runs == run][:, [START, BEND]] for run in np.unique(runs)]
    if len({len(session) for session in sessions}) > 1:
        return None
    first = sessions[0]
    scale = np.array([1.0, speed])  # a bend times the speed is a veer
    matched = []
    for session in sessions:
        apart = np.nan_to_num((first[:, None] - session[None]) * scale / APART)
        matched.append(session[linear_sum_assignment((apart**2).sum(axis=2))[1]])
    if len(matched) > 1:
        scatter = np.nan_to_num(np.var(matched, axis=0, ddof=1).mean(axis=0)) * scale**2 / np.square(APART)
        if scatter.mean() > 1.0:
            return None
    return np.array(matched)


def _mean_of_known(matched: Floats) -> Floats:
    """Return each robot's mean speed and bend over the sessions that have them, (robots, 2); NaN if none has."""
    known = np.isfinite(matched)
    total = np.where(known, matched, 0.0).sum(axis=0)
    with np.errstate(invalid="ignore"):
        return np.asarray(total / known.sum(axis=0))


def _between_sessions(matched: Floats, values: dict[str, float], table: Floats) -> float:
    """Return the standard deviation of a robot's bend between sessions beyond what variation within them explains."""
    bends = matched[:, :, 1]  # nan: too few undisturbed intervals of this robot in this session
    often = np.isfinite(bends).sum(axis=0) > 1
    if not often.any():
        return 0.0
    within, slow = values["bend_within_per_m"] ** 2, values["slow_share"]
    turns, samples = (float(np.nanmean(table[:, column])) for column in (TURNS, SAMPLES))
    # A median of correlated turns, and a mean of that many values of the slow variation.
    of_median = 0.5 * np.pi * 2.0 * within * (1.0 - slow) / turns
    of_drift = 1.5 * within * slow * DRIFT_SAMPLES / samples
    variance = float(np.nanvar(bends[:, often], axis=0, ddof=1).mean()) - of_median - of_drift
    return float(np.sqrt(max(variance, 0.0)))


MEAN, START, LOST, WITHIN, VEER, BEND, SPREAD, SLOW, DISTANCE, TURNS, SAMPLES = range(11)
"""Columns of the table of robots in sessions."""


def _by_robot(found: Dataset) -> tuple[Floats, NDArray[np.int64]]:
    """Return a row for each robot in each session, and the session of each row; ordered by session and robot.

    The columns, ``MEAN`` to ``SAMPLES``, are mean speed, speed at the start, share lost a second, sd within, veer in
    the middle of drives, and the robot's ``Course`` without its turn. NaN: unknown. Robots with too few drives are
    left out.
    """
    courses = {
        key: course_of(own)
        for key, own in undisturbed(found.samples).group_by("run", "robot", maintain_order=True)
    }
    rows, runs = [], []
    for key, own in found.drives.sort("run", "robot", maintain_order=True).group_by(
        "run", "robot", maintain_order=True
    ):
        if own.height < _LEAST:
            continue
        time, speed = own["time_s"].to_numpy(), own["speed_m_s"].to_numpy()
        slope, start = np.polyfit(time, speed, 1)
        within = float(np.sqrt(((speed - start - slope * time) ** 2).mean()))
        veer = own["veer_rad_s"].drop_nulls().to_numpy()
        turns = float(veer.mean()) if veer.size >= _LEAST else np.nan
        course = courses.get(key)
        rows.append(
            (float(speed.mean()), start, -slope / start, within, turns)
            + ((np.nan,) * 6 if course is None else course[1:])
        )
        runs.append(key[0])
    return np.array(rows, dtype=np.float64).reshape(-1, 11), np.array(runs, dtype=np.int64)


def _estimates(table: Floats) -> dict[str, float]:
    """Return the estimates from the table of ``_by_robot``; those of veer or bend only if two or more are known."""
    mean, start, lost, within, veer = table.T[:5]
    between = float(start.std(ddof=1))
    inside = float(np.sqrt((within**2).mean()))
    estimates = {
        "speed_m_s": float(mean.mean()),
        "start_speed_m_s": float(start.mean()),
        "between_m_s": between,
        "within_m_s": inside,
        "share_between": between**2 / (between**2 + inside**2) if between + inside > 0 else 0.0,
        "battery_life_s": 1.0 / max(float(lost.mean()), 1e-9),
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
            "slow_share": float(slow[:, SLOW].mean()) if len(slow) else 0.0,
            "distance_spread": float(driven[:, DISTANCE].mean()),
        }
    return estimates
