"""What each robot measures of its own moves: kinds and times exactly, turns by its gyro, its shortest ray at obstacles.

| name | unit | equation |
|---|---|---|
| gyro | rad | turned * (1 + scale) + (bias - zero) * duration + noise |
| zero | rad/s | measured bias: 0, or the mean of bias + ``rezero_noise_deg_s`` * normal at the start and each stop |
| noise | rad | normal; its variance is walk^2 duration, plus turn^2 for a turn in place |
| ray | m | length of the shortest ray when an avoidance begins + ``rays.noise_m`` * normal |
| scale, bias | -, rad/s | normal, drawn once per robot and run (``odometry`` fields) |

A robot does not notice that it is blocked, so the pieces of a drive or turn in which it is blocked are one row. Noise
is addressed by the number of the row among those of its robot, so it does not depend on floor, strategy or messages. A
robot knows when it stands, and measures no turn then.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.core.rng import ALONE, FIRST, ODOMETRY, OF_BIAS, OF_RAY, OF_REZERO, OF_SCALE, normal
from vibroswarm.robot.walk import DRIVE, STOP
from vibroswarm.scenario.scenario import Scenario


class Odometer(NamedTuple):
    """Standard deviations of the errors of gyro and rays."""

    scale: float
    bias_rad_s: float
    turn_rad: float
    """Noise of a turn in place."""
    walk_rad_sqrt_s: float
    """Random walk, rad per root of s."""
    rezero_rad_s: float
    """Error of a bias that is measured at a stop; below 0: it is not measured."""
    ray_m: float
    range_m: float
    """Most that a ray measures."""


class OwnMoves(NamedTuple):
    """Drives, turns, avoidances and stops of one robot as it notices them, (moves,) each, in order of time."""

    kind: NDArray[np.int64]
    """Indices into ``walk.KINDS``."""
    start_s: NDArray[np.float64]
    duration_s: NDArray[np.float64]
    turned_rad: NDArray[np.float64]
    ray_m: NDArray[np.float64]
    """Length of the shortest ray when an avoidance began, else nan."""


def odometer_of(scenario: Scenario) -> Odometer:
    """Return the errors of a scenario's gyro and rays."""
    errors, rezero_deg_s = scenario.odometry.errors, scenario.odometry.rezero_noise_deg_s
    return Odometer(
        scale=errors.scale,
        bias_rad_s=math.radians(errors.bias_deg_s),
        turn_rad=math.radians(errors.turn_deg),
        walk_rad_sqrt_s=math.radians(errors.walk_deg_sqrt_s),
        rezero_rad_s=-1.0 if rezero_deg_s is None else math.radians(rezero_deg_s),
        ray_m=scenario.rays.noise_m,
        range_m=scenario.rays.range_m,
    )


def noticed(
    kind: NDArray[np.int64],
    start_s: NDArray[np.float64],
    turned_rad: NDArray[np.float64],
    ray_m: NDArray[np.float64],
    end_s: float = math.nan,
) -> OwnMoves:
    """Merge consecutive moves of a kind, as blocking is not noticed; a stop, or an avoidance with a ray, is new."""
    begins = np.append(True, (np.diff(kind) != 0) | np.isfinite(ray_m[1:]) | (kind[1:] == STOP))
    first = np.flatnonzero(begins)
    duration_s = np.diff(np.append(start_s[first], end_s))
    return OwnMoves(kind[first], start_s[first], duration_s, np.add.reduceat(turned_rad, first), ray_m[first])


@kernel
def measure(
    odometer: Odometer, moves: OwnMoves, known: NDArray[np.float64], seed: int, run: int, robot: int
) -> None:
    """Replace turns and rays by what the robot measures of them."""
    scale = odometer.scale * normal(seed, run, robot, ODOMETRY, FIRST, OF_SCALE)
    bias = odometer.bias_rad_s * normal(seed, run, robot, ODOMETRY, FIRST, OF_BIAS)
    for k in range(moves.kind.size):
        number, kind = int(known[2]), moves.kind[k]
        known[2] += 1.0
        # The bias is measured at each stop, and once before the robot's first move, when it has not moved yet.
        if odometer.rezero_rad_s >= 0.0 and (kind == STOP or known[1] == 0.0):
            seen = bias + odometer.rezero_rad_s * normal(seed, run, robot, ODOMETRY, number, OF_REZERO)
            known[1] += 1.0
            known[0] += (seen - known[0]) / known[1]  # the mean so far
        if odometer.ray_m > 0.0 and np.isfinite(moves.ray_m[k]):
            error_m = odometer.ray_m * normal(seed, run, robot, ODOMETRY, number, OF_RAY)
            moves.ray_m[k] = min(max(moves.ray_m[k] + error_m, 0.0), odometer.range_m)
        if kind == STOP:
            moves.turned_rad[k] = 0.0
            continue
        variance = odometer.walk_rad_sqrt_s * odometer.walk_rad_sqrt_s * moves.duration_s[k]
        if kind != DRIVE:
            variance += odometer.turn_rad * odometer.turn_rad
        noise = math.sqrt(variance) * normal(seed, run, robot, ODOMETRY, number, ALONE)
        drift = (bias - known[0]) * moves.duration_s[k]
        moves.turned_rad[k] = moves.turned_rad[k] * (1.0 + scale) + drift + noise
