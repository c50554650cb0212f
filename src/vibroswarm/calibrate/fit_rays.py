"""Fit the angles of the rays and their start ahead of the centre, from where robots turned away from walls.

A ray is the line along which a distance sensor looks; its length is the distance to the first obstacle. A robot that
approaches a wall at incidence i (the angle of its course to the wall's normal) turns when one of its rays is shorter
than theta_c. Its distance from the wall is then

    d(i) = F cos i + max over rays of (R cos b_k cos i - (s_k + R sin b_k) sin i)

with R = theta_c (the value that the robots were programmed with), b_k and s_k the angle (anticlockwise positive) and
the lateral offset (to the left positive) of ray k, and F how far ahead of the robot's centre its rays start
(``rays.forward_each_m``). For given angles, the F of least absolute error is a weighted median. The outermost angle is
found on a grid; the ratios between the rays' angles are those of the base scenario. Cones instead of rays explain the
study's recordings no better.

Turns at the end of a leg are uniform up to a largest angle A, of which robots leave out the tolerance T
(``walk.turn_tolerance_deg``). Those beyond a_0 (``wall_approach.LEAST_TURN``) have the mean (a_0 + A - T) / 2, so A is
estimated by 2 mean - a_0 + T. Standard errors come from bootstraps: of the approaches of each robot for the rays, and
of all turns for A. Limits of how far robots differ hold for other robots too: chi-square of so many robots.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.few_groups import drawn_variances, evenly_drawn
from vibroswarm.calibrate.wall_approach import LEAST_TURN
from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.scenario.scenario import Scenario

LEAST_APPROACHES: Final = 20
"""Fewest approaches of each robot."""
LEAST_TURNS: Final = 30
"""Fewest turns at the ends of legs, of all robots."""
ALONE_M: Final = 0.2
"""If another robot was closer, the robot may have avoided it instead of the wall."""
MOST_M: Final = 0.2
"""A robot farther from the wall did not turn because of it."""
GRID_DEG: Final = np.arange(5.0, 76.0, 1.0)
"""Outermost angles that are tried first."""
NEAR_DEG: Final = np.arange(-1.0, 1.05, 0.1)
"""Differences of those that are tried next from the best one. In whole degrees alone, an angle is off by more than its
limits allow."""
CLIP_M: Final = 0.03
"""Errors are clipped to this: a turn at a distance with a larger error had another cause than the wall."""
DRAWS: Final = 60
"""Bootstrap resamples."""
_SEED: Final = 35
"""Seed of the bootstrap."""


@dataclass(frozen=True)
class RaysFit:
    """Estimates of the rays and of the largest turn, as far as the paths determine them."""

    values: dict[str, float]
    """Estimates by name: ray_deg (outermost angle), forward_m (mean F), forward_between_m (standard deviation of F
    between robots), turn_max_deg. Names that the paths do not determine are missing."""
    draws: dict[str, Floats]
    """Draws by the same names, (draws,) each."""
    forward_m: tuple[float, ...]
    """F of each robot, by its number; empty if undetermined."""

    def fields(self, base: Scenario) -> dict[str, object]:
        """Return the scenario's fields for these estimates, by dotted name, without those that are undetermined."""
        fields: dict[str, object] = {}
        if self.forward_m:
            fields["rays.angle_deg"] = scaled_angles(base, self.values["ray_deg"])
            fields["rays.forward_m"] = round(float(np.mean(self.forward_m)), 4)
            fields["rays.forward_each_m"] = [round(forward_m, 4) for forward_m in self.forward_m]
        if "turn_max_deg" in self.values:
            fields["walk.turn_max_deg"] = round(self.values["turn_max_deg"], 1)
        return fields


def fit_rays(found: Dataset, base: Scenario, draws: int = DRAWS) -> RaysFit:
    """Fit the angles and starts of the rays, and the largest turn at the end of a leg.

    A robot's number is taken to mean the same sensors in all sessions. (In the study's recordings the starts of the
    rays belong to the number, but speed and veer do not, so ``fit_drive`` matches robots instead.) The estimates of the
    rays are left out if a robot has fewer than ``LEAST_APPROACHES`` approaches. The estimate of the largest turn is
    left out if there are fewer than ``LEAST_TURNS`` turns.

    Args:
        found: sessions, with positions corrected for the camera.
        base: scenario with theta_c, the lateral offsets and the ratios of the rays' angles.
        draws: number of draws.
    """
    values: dict[str, float] = {}
    drawn: dict[str, Floats] = {}
    forward: tuple[float, ...] = ()
    approaches = found.approaches.filter(
        (pl.col("nearest_robot_m") > ALONE_M)
        & (pl.col("distance_m") < MOST_M)
        # A robot beyond 90 degrees does not approach the wall; 5 degrees more allow for errors of courses.
        & (pl.col("incidence_rad").abs() < np.radians(95.0))
    )
    robot = approaches["robot"].to_numpy().astype(np.int64)
    # One more than the largest robot number; 1 without samples, where the maximum is None.
    robots = int(found.samples["robot"].max() or 0) + 1  # type: ignore[arg-type]
    if robot.size and np.bincount(robot, minlength=robots).min() >= LEAST_APPROACHES:
        distance, incidence = approaches["distance_m"].to_numpy(), approaches["incidence_rad"].to_numpy()
        # A ray is read once a control period: robots drive on for half of one, in the mean, before they turn.
        speed_m_s = float(found.drives["speed_m_s"].mean() or 0.0)  # type: ignore[arg-type]
        distance = distance + 0.5 * speed_m_s * base.run.control_period_ms / 1000.0 * np.cos(incidence)
        ray_deg, forward_m = _fit(distance, incidence, robot, base)
        # The same fit to each bootstrap draw of the approaches: (ray_deg, forward_m) of each draw.
        fits = [
            _fit(distance[rows], incidence[rows], robot[rows], base)
            for rows in (_resampled(robot, draw) for draw in range(draws))
        ]
        forward_draws_m = np.array([fit[1] for fit in fits]).reshape(draws, robots)
        forward = tuple(float(of_robot_m) for of_robot_m in forward_m)
        values |= {"ray_deg": ray_deg, "forward_m": float(forward_m.mean())}
        drawn |= {
            "ray_deg": np.array([fit[0] for fit in fits]),
            "forward_m": forward_draws_m.mean(axis=1),
        }
        if robots > 1:
            variance = float(forward_m.var(ddof=1))
            u = evenly_drawn(draws, _SEED, "forward_between_m")
            values["forward_between_m"] = math.sqrt(variance)
            drawn["forward_between_m"] = np.sqrt(drawn_variances(variance, robots - 1, u))
    turned = np.abs(found.turns["turned_rad"].to_numpy())
    if turned.size >= LEAST_TURNS:
        tolerance_deg = base.walk.turn_tolerance_deg
        values["turn_max_deg"] = _largest_turn_deg(turned, tolerance_deg)
        # Another robot number than in ``_resampled`` gives independent random numbers.
        # A uniform number times the number of turns, rounded down, is the index of a drawn turn.
        u = uniforms(_SEED, run=0, robot=1, purpose=Purpose.BOOTSTRAP, count=draws * turned.size)
        drawn["turn_max_deg"] = np.array(
            [
                _largest_turn_deg(turned[(of_draw * turned.size).astype(int)], tolerance_deg)
                for of_draw in u.reshape(draws, turned.size)
            ]
        )
    return RaysFit(values, drawn, forward)


def _largest_turn_deg(turned: Floats, tolerance_deg: float) -> float:
    """Return the largest turn at the end of a leg, deg, from the observed turns without sign, rad.

    The estimate 2 mean - a_0 + T is clipped: to 180 degrees at most, and to twice ``LEAST_TURN`` (a_0) at least,
    because with a smaller largest turn fewer than half of the turns would exceed a_0 and be observed.
    """
    largest = 2 * turned.mean() - LEAST_TURN + np.radians(tolerance_deg)
    return float(np.degrees(np.clip(largest, 2 * LEAST_TURN, np.pi)))


def _resampled(robot: Ints, draw: int) -> Ints:
    """Return the numbers of the rows in a bootstrap draw, (rows,): each row is replaced by a row of the same robot.

    So every robot keeps its number of approaches.

    Args:
        robot: robot of each row, (rows,). draw: number of the bootstrap draw; each has random numbers of its own.
    """
    u = uniforms(_SEED, run=draw, robot=0, purpose=Purpose.BOOTSTRAP, count=robot.size)
    picked = np.empty(robot.size, dtype=np.int64)
    for number in np.unique(robot):
        own = np.flatnonzero(robot == number)
        picked[own] = own[(u[own] * own.size).astype(np.int64)]
    return picked


def _fit(distance: Floats, incidence: Floats, robot: Ints, base: Scenario) -> tuple[float, Floats]:
    """Return the outermost angle of smallest error, deg, and F of each robot at this angle, m, (robots,).

    Args:
        distance, incidence, robot: distance (m), incidence (rad) and robot's number of each approach, (approaches,).
            Each robot from 0 to the largest number has an approach, which ``fit_rays`` has checked.
        base: scenario with theta_c, the lateral offsets and the ratios of the rays' angles.
    """

    def best_of(angles_deg: Floats) -> float:
        errors = [
            _fit_forward(distance, incidence, robot, base, angle_deg)[1] for angle_deg in angles_deg.tolist()
        ]
        return float(angles_deg[int(np.argmin(errors))])

    near_deg = np.clip(best_of(GRID_DEG) + NEAR_DEG, GRID_DEG[0], GRID_DEG[-1])
    best_deg = best_of(near_deg)
    return best_deg, _fit_forward(distance, incidence, robot, base, best_deg)[0]


def _fit_forward(
    distance: Floats, incidence: Floats, robot: Ints, base: Scenario, ray_deg: float
) -> tuple[Floats, float]:
    """Return F of each robot, m, (robots,), given the outermost angle; and the mean absolute error of distances, m.

    Let M be the maximum over rays in the equation of d(i). The errors |d - M - F cos i| are smallest in total if F is
    the median of (d - M) / cos i with the weights cos i. In the mean that is returned, errors above ``CLIP_M`` count as
    ``CLIP_M``.

    Args:
        distance, incidence, robot: distance (m), incidence (rad) and robot's number of each approach, (approaches,).
        base: scenario with theta_c, the lateral offsets and the ratios of the rays' angles.
        ray_deg: the outermost angle.
    """
    reach = base.walk.avoidance_threshold_mm / 1000.0  # R = theta_c, m
    # Columns of angles and of lateral offsets, (rays, 1), so that ``rays`` below is (rays, approaches).
    angle = np.radians(scaled_angles(base, ray_deg))[:, None]
    side = np.array(base.rays.side_m)[:, None]
    rays = reach * np.cos(angle) * np.cos(incidence) - (side + reach * np.sin(angle)) * np.sin(incidence)
    rest, weight = distance - rays.max(axis=0), np.maximum(np.cos(incidence), 1e-3)  # d - M; cos i, above 0
    own_rows = [robot == number for number in range(int(robot.max()) + 1)]
    # Between 0 and 0.5 m, far more than the size of a robot.
    forward = np.clip([_weighted_median(rest[own] / weight[own], weight[own]) for own in own_rows], 0.0, 0.5)
    error = np.abs(rest - forward[robot] * weight)
    return forward, float(np.minimum(error, CLIP_M).mean())


def _weighted_median(values: Floats, weights: Floats) -> float:
    """Return the smallest value at which the sum of weights, in the order of values, reaches half of the total.

    There must be at least one value, and weights must be above 0.
    """
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def scaled_angles(base: Scenario, ray_deg: float) -> list[float]:
    """Return the angles of the base's rays, deg, multiplied by one factor so that the largest is ``ray_deg``."""
    # If all rays point straight ahead, all angles are 0 and stay 0; 1.0 avoids a division by 0.
    largest = max(abs(angle_deg) for angle_deg in base.rays.angle_deg) or 1.0
    return [round(angle_deg / largest * ray_deg, 2) for angle_deg in base.rays.angle_deg]
