"""Fit the angles of the rays and their start ahead of the centre, from where robots turned away from walls.

A robot at incidence i on a wall turns when one of its rays is shorter than theta_c, at the distance

    d(i) = F cos i + max over rays of (R cos b_k cos i - (s_k + R sin b_k) sin i)

with R = theta_c (as the robots were told), b_k and s_k a ray's angle and lateral offset, F the robot's
``rays.forward_each_m``. Given the angles, F is a weighted median (least absolute error); the outermost angle is found
on a grid, the others are in proportion as in the base. Cones, modelled as a fan of rays, explain the study's
recordings
no better (docs/calibration.md). The largest turn at the end of a leg is that of a uniform distribution whose angles
beyond a_0 (``wall_approach.LEAST_TURN``) have the observed mean: 2 mean - a_0. Errors: bootstrap over approaches (of
each robot) and over turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.wall_approach import LEAST_TURN
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.scenario.scenario import Scenario

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAST_APPROACHES: Final = 20
"""Fewest approaches of each robot."""
LEAST_TURNS: Final = 30
ALONE_M: Final = 0.2
"""A closer robot may be what was avoided."""
MOST_M: Final = 0.2
GRID_DEG: Final = np.arange(5.0, 76.0, 1.0)
CLIP_M: Final = 0.03
"""Largest error that counts: an approach that is off by more was none."""
DRAWS: Final = 60
_SEED: Final = 35


@dataclass(frozen=True)
class RaysFit:
    """Estimates by name and their bootstrap draws, (draws,); empty if the paths do not determine them."""

    values: dict[str, float]
    draws: dict[str, Floats]
    forward_m: tuple[float, ...]
    """F of each robot; empty if undetermined."""

    def fields(self, base: Scenario) -> dict[str, object]:
        """Return the fields of the scenario."""
        fields: dict[str, object] = {}
        if self.forward_m:
            fields["rays.angle_deg"] = _angles(base, self.values["ray_deg"])
            fields["rays.forward_m"] = round(float(np.mean(self.forward_m)), 4)
            fields["rays.forward_each_m"] = [round(forward_m, 4) for forward_m in self.forward_m]
        if "turn_max_deg" in self.values:
            fields["walk.turn_max_deg"] = round(self.values["turn_max_deg"], 1)
        return fields


def fit_rays(found: Dataset, base: Scenario, draws: int = DRAWS) -> RaysFit:
    """Fit the angles and starts of the rays, and the largest turn at the end of a leg.

    A robot's number is taken to mean the same robot, with the same sensors, in all sessions. What too few approaches or
    turns determine is left out.
    """
    values: dict[str, float] = {}
    bootstrap: dict[str, Floats] = {}
    forward: tuple[float, ...] = ()
    approaches = found.approaches.filter(
        (pl.col("nearest_robot_m") > ALONE_M)
        & (pl.col("distance_m") < MOST_M)
        & (pl.col("incidence_rad").abs() < np.radians(95.0))
    )
    robot = approaches["robot"].to_numpy().astype(np.int64)
    robots = int(found.samples["robot"].max() or 0) + 1  # type: ignore[arg-type]
    if robot.size and np.bincount(robot, minlength=robots).min() >= LEAST_APPROACHES:
        distance, incidence = approaches["distance_m"].to_numpy(), approaches["incidence_rad"].to_numpy()
        angle, ahead = _fit(distance, incidence, robot, base)
        rows = [
            _fit(distance[k], incidence[k], robot[k], base)
            for k in (_resampled(robot, n) for n in range(draws))
        ]
        forward_draws_m = np.array([row[1] for row in rows])
        forward = tuple(float(forward_m) for forward_m in ahead)
        values |= {"ray_deg": angle, "forward_m": float(ahead.mean())}
        bootstrap |= {
            "ray_deg": np.array([row[0] for row in rows]),
            "forward_m": forward_draws_m.mean(axis=1),
        }
        if robots > 1:
            values["forward_between_m"] = float(ahead.std(ddof=1))
            bootstrap["forward_between_m"] = forward_draws_m.std(axis=1, ddof=1)
    turned = np.abs(found.turns["turned_rad"].to_numpy())
    if turned.size >= LEAST_TURNS:
        values["turn_max_deg"] = _most(turned)
        u = uniforms(_SEED, 0, 1, Purpose.BOOTSTRAP, draws * turned.size).reshape(draws, -1)
        bootstrap["turn_max_deg"] = np.array(
            [_most(turned[(ranks * turned.size).astype(int)]) for ranks in u]
        )
    return RaysFit(values, bootstrap, forward)


def _most(turned: Floats) -> float:
    return float(np.degrees(np.clip(2 * turned.mean() - LEAST_TURN, 2 * LEAST_TURN, np.pi)))


def _resampled(robot: Ints, draw: int) -> Ints:
    """Return the row that each row is replaced by in a bootstrap draw: one of the same robot, (rows,)."""
    u = uniforms(_SEED, draw, 0, Purpose.BOOTSTRAP, robot.size)
    picked = np.empty(robot.size, dtype=np.int64)
    for number in np.unique(robot):
        own = np.flatnonzero(robot == number)
        picked[own] = own[(u[own] * own.size).astype(np.int64)]
    return picked


def _fit(distance: Floats, incidence: Floats, robot: Ints, base: Scenario) -> tuple[float, Floats]:
    """Return the outermost angle, deg, and F of each robot, (robots,)."""
    losses = [_ahead(distance, incidence, robot, base, ray_deg)[1] for ray_deg in GRID_DEG.tolist()]
    best = float(GRID_DEG[int(np.argmin(losses))])
    return best, _ahead(distance, incidence, robot, base, best)[0]


def _ahead(
    distance: Floats, incidence: Floats, robot: Ints, base: Scenario, ray_deg: float
) -> tuple[Floats, float]:
    """Return F of each robot by weighted medians, m, and the mean absolute error, m."""
    reach = base.walk.avoidance_threshold_mm / 1000.0
    bent = np.radians(_angles(base, ray_deg))[:, None]
    side = np.array(base.rays.side_m)[:, None]
    rays = reach * np.cos(bent) * np.cos(incidence) - (side + reach * np.sin(bent)) * np.sin(incidence)
    rest, weight = distance - rays.max(axis=0), np.maximum(np.cos(incidence), 1e-3)
    own = [robot == number for number in range(int(robot.max()) + 1)]
    ahead = np.clip([_weighted_median(rest[k] / weight[k], weight[k]) for k in own], 0.0, 0.5)
    error = np.abs(rest - ahead[robot] * weight)
    return ahead, float(np.minimum(error, CLIP_M).mean())


def _weighted_median(values: Floats, weights: Floats) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def _angles(base: Scenario, ray_deg: float) -> list[float]:
    """Return the base's rays, turned in proportion so that the outermost is at ``ray_deg``."""
    most = max(abs(angle_deg) for angle_deg in base.rays.angle_deg) or 1.0
    return [round(angle_deg / most * ray_deg, 2) for angle_deg in base.rays.angle_deg]
