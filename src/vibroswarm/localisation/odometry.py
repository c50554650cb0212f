"""What each robot measures of its own moves: their kinds and times exactly, turns by its gyro, rays at obstacles.

| name | unit | equation |
|---|---|---|
| gyro | rad | turned * (1 + scale) + (bias - zero) * duration + noise |
| zero | rad/s | 0, or the mean of bias + ``rezero_noise_deg_s`` * normal, measured at the start and at each stop |
| noise | rad | normal, variance walk^2 duration, and turn^2 for a turn in place |
| scale, bias | -, rad/s | normal, one a robot and run (``odometry`` fields) |

A robot does not notice that it is blocked: pieces of one drive or turn are one row. Noise is addressed by the number
of the row, so it depends on no floor, strategy or message. A robot that stands knows it, and measures no turn.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, inlined
from vibroswarm.core.rng import ALONE, FIRST, ODOMETRY, OF_BIAS, OF_REZERO, OF_SCALE, uniform
from vibroswarm.errors import InputError
from vibroswarm.motion.source import MOVES
from vibroswarm.robot.walk import DRIVE, KINDS, STOP
from vibroswarm.scenario.scenario import Scenario

ODOMETER: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "start_s": pl.Float64,
    "duration_s": pl.Float64,
    "kind": MOVES["kind"],
    "gyro_rad": pl.Float64,
    "ray_m": pl.Float64,
}
"""One row per drive, turn, avoidance or stop of a robot as it knows them, sorted by run, robot, start. ``gyro_rad``:
the turn that its gyro measured. ``ray_m``: its shortest ray when an avoidance began, else null."""


@inlined
def normal(seed: int, run: int, robot: int, purpose: int, index: int, peer: int) -> float:
    """Return the standard normal number at an address; it uses the peers ``peer`` and ``peer + 1`` (Box, Muller)."""
    radius = math.sqrt(-2.0 * math.log(uniform(seed, run, robot, purpose, index, peer)))
    return radius * math.cos(2.0 * math.pi * uniform(seed, run, robot, purpose, index, peer + 1))


def known_moves(moves: pl.DataFrame | None) -> pl.DataFrame:
    """Return the moves of a motion.

    Raises:
        InputError: there are none.
    """
    if moves is None:
        raise InputError(
            "robots that estimate their places need the moves, which this motion lacks; "
            "simulate with moves, or leave it at 'true'",
            field="localisation.method",
        )
    return moves


def measure_moves(scenario: Scenario, seed: int, moves: pl.DataFrame, ends: pl.DataFrame) -> pl.DataFrame:
    """Return what the robots measured of their moves (``ODOMETER``); tables ``moves`` and ``ends`` of a motion."""
    run, robot, start_s = (moves[name].to_numpy() for name in ("run", "robot", "start_s"))
    kind, ray_m = moves["kind"].to_physical().to_numpy(), moves["ray_m"].to_numpy()  # as in KINDS
    whose = run.astype(np.int64) * scenario.swarm.robots + robot
    order = np.argsort(whose, kind="stable")  # moves are sorted by run and start
    whose, kind, ray_m = whose[order], kind[order].astype(np.int64), ray_m[order]
    first, turned = merged_moves(whose, kind, ray_m, moves["turned_rad"].to_numpy()[order])
    start_s, row_run, row_robot = start_s[order][first], run[order][first], robot[order][first]
    # A row ends where the robot's next begins, or at the end of what is known.
    last = np.append(np.diff(whose[first]) != 0, True)[: first.size]
    end_s = np.append(start_s[1:], 0.0)[: first.size]
    known_s = {(r, i): t for r, i, t in ends.select("run", "robot", "end_s").iter_rows()}
    end_s[last] = [
        known_s[r, i] for r, i in zip(row_run[last].tolist(), row_robot[last].tolist(), strict=True)
    ]
    end_s = np.maximum(end_s, start_s)  # of moves after the end of what is known
    gyro_rad = gyro_readings(
        seed,
        row_run.astype(np.int64),
        row_robot.astype(np.int64),
        kind[first],
        end_s - start_s,
        turned,
        *gyro_errors(scenario),
        zeroing=np.zeros(2),
        number=0,
    )
    return pl.DataFrame(
        {
            "run": row_run,
            "robot": row_robot,
            "start_s": start_s,
            "duration_s": end_s - start_s,
            "kind": pl.Series(KINDS, dtype=MOVES["kind"]).gather(pl.Series(kind[first])),
            "gyro_rad": gyro_rad,
            "ray_m": pl.Series(ray_m[first], nan_to_null=True),
        },
        schema=ODOMETER,
    )


def merged_moves(
    whose: NDArray[np.int64],
    kind: NDArray[np.int64],
    ray_m: NDArray[np.float64],
    turned_rad: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Merge the pieces of drives and turns in which a robot was blocked, which it does not notice.

    Args:
        whose, kind, ray_m, turned_rad: of moves, robot by robot, in order of time, (moves,).
    Returns: the first move of each row, and the turn of the row, rad.
    """
    begins = np.ones(whose.size, dtype=np.bool_)
    begins[1:] = (np.diff(whose) != 0) | (np.diff(kind) != 0) | np.isfinite(ray_m[1:]) | (kind[1:] == STOP)
    first = np.flatnonzero(begins)
    return first, np.add.reduceat(turned_rad, first) if first.size else np.empty(0)


def gyro_errors(scenario: Scenario) -> tuple[float, float, float, float, float]:
    """Return the standard deviations of the gyro's errors, as ``gyro_readings`` takes them."""
    errors, rezero_deg_s = scenario.odometry.errors, scenario.odometry.rezero_noise_deg_s
    return (
        errors.scale,
        math.radians(errors.bias_deg_s),
        math.radians(errors.turn_deg),
        math.radians(errors.walk_deg_sqrt_s),
        -1.0 if rezero_deg_s is None else math.radians(rezero_deg_s),
    )


@allocating_kernel
def gyro_readings(
    seed: int,
    run: NDArray[np.int64],
    robot: NDArray[np.int64],
    kind: NDArray[np.int64],
    duration_s: NDArray[np.float64],
    turned_rad: NDArray[np.float64],
    scale_spread: float,
    bias_spread_rad_s: float,
    turn_noise_rad: float,
    walk_rad_sqrt_s: float,
    rezero_rad_s: float,
    zeroing: NDArray[np.float64],
    number: int,
) -> NDArray[np.float64]:
    """Return the turns as gyros measure them, rad; arrays of (rows,), by run and robot.

    Args:
        rezero_rad_s: noise of the bias measured at stops; below 0: none is measured. zeroing: (2,): mean of the biases
            measured, and how many; of the first row's robot before it, changed to those of the last row's robot.
        number: of the first row, among those of its robot.
    """
    out = np.empty(run.size)
    scale, bias, zero, measured = 0.0, 0.0, zeroing[0], zeroing[1]
    for k in range(run.size):
        if k == 0 or run[k] != run[k - 1] or robot[k] != robot[k - 1]:
            number = number if k == 0 else 0
            scale = scale_spread * normal(seed, run[k], robot[k], ODOMETRY, FIRST, OF_SCALE)
            bias = bias_spread_rad_s * normal(seed, run[k], robot[k], ODOMETRY, FIRST, OF_BIAS)
            if k > 0:
                zero, measured = 0.0, 0.0
        stands = kind[k] == STOP
        if rezero_rad_s >= 0.0 and (stands or measured == 0.0):
            seen = bias + rezero_rad_s * normal(seed, run[k], robot[k], ODOMETRY, number, OF_REZERO)
            measured += 1.0
            zero += (seen - zero) / measured
        if stands:
            out[k] = 0.0
            number += 1
            continue
        variance = walk_rad_sqrt_s * walk_rad_sqrt_s * duration_s[k]
        if kind[k] != DRIVE:
            variance += turn_noise_rad * turn_noise_rad
        noise = math.sqrt(variance) * normal(seed, run[k], robot[k], ODOMETRY, number, ALONE)
        out[k] = turned_rad[k] * (1.0 + scale) + (bias - zero) * duration_s[k] + noise
        number += 1
    zeroing[0], zeroing[1] = zero, measured
    return out
