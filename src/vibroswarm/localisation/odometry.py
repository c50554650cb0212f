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
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel
from vibroswarm.core.rng import ALONE, FIRST, ODOMETRY, OF_BIAS, OF_RAY, OF_REZERO, OF_SCALE, normal
from vibroswarm.motion.motion_tables import MOVES
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
"""One row per drive, turn, avoidance or stop as the robot notices them, sorted by run, robot and start. ``gyro_rad``:
the turn that the gyro measured. ``ray_m``: length of the shortest ray when an avoidance began, else null."""


def measure_moves(scenario: Scenario, seed: int, moves: pl.DataFrame, ends: pl.DataFrame) -> pl.DataFrame:
    """Return what the robots measured of their moves, as a table (``ODOMETER``).

    Args:
        seed: seed of the runs. moves, ends: tables of the motion. ``moves`` is sorted by run and start; ``ends`` states
            until when each robot's motion is known, for all robots that have moves.
    """
    run, robot, start_s = (moves[name].to_numpy() for name in ("run", "robot", "start_s"))
    # kind: indices into KINDS
    kind, ray_m = moves["kind"].to_physical().to_numpy(), moves["ray_m"].to_numpy()
    whose = run.astype(np.int64) * scenario.swarm.robots + robot
    order = np.argsort(whose, kind="stable")  # by run and robot; each robot's moves stay sorted by start
    whose, kind, ray_m = whose[order], kind[order].astype(np.int64), ray_m[order]
    first, turned = merged_moves(whose, kind, ray_m, moves["turned_rad"].to_numpy()[order])
    start_s, row_run, row_robot = start_s[order][first], run[order][first], robot[order][first]
    # A row ends when the robot's next row begins, and a robot's last row when its known motion ends. The slices to
    # first.size matter only if there are no rows: they drop the appended element.
    last = np.append(np.diff(whose[first]) != 0, True)[: first.size]
    # 0.0 is replaced below, as the very last row is the last one of its robot.
    end_s = np.append(start_s[1:], 0.0)[: first.size]
    # End of the known motion by run and robot.
    known_s = {(r, i): t for r, i, t in ends.select("run", "robot", "end_s").iter_rows()}
    end_s[last] = [
        known_s[r, i] for r, i in zip(row_run[last].tolist(), row_robot[last].tolist(), strict=True)
    ]
    end_s = np.maximum(end_s, start_s)  # a move may begin after the end of what is known
    gyro_rad = gyro_readings(
        seed,
        row_run.astype(np.int64),
        row_robot.astype(np.int64),
        kind[first],
        end_s - start_s,
        turned,
        *gyro_errors(scenario),
        zeroing=np.zeros(2),  # all rows of all robots are here, so no earlier call is continued
        number=0,
    )
    rays_m = measured_rays(scenario, seed, row_run, row_robot, ray_m[first], number=0)
    return pl.DataFrame(
        {
            "run": row_run,
            "robot": row_robot,
            "start_s": start_s,
            "duration_s": end_s - start_s,
            "kind": pl.Series(KINDS, dtype=MOVES["kind"]).gather(pl.Series(kind[first])),
            "gyro_rad": gyro_rad,
            "ray_m": pl.Series(rays_m, nan_to_null=True),
        },
        schema=ODOMETER,
    )


def merged_moves(
    whose: NDArray[np.int64],
    kind: NDArray[np.int64],
    ray_m: NDArray[np.float64],
    turned_rad: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Merge the pieces into which blocking divided a drive or turn, as the robot does not notice that it was blocked.

    Consecutive moves of one robot that have the same kind are merged. A stop always begins a new row, and so does an
    avoidance with a ray: the ray marks the first piece of an avoidance.

    Args:
        whose: (moves,): number of each move's robot; moves are sorted by robot and, for each robot, by time.
        kind: (moves,): indices into ``KINDS``. ray_m: (moves,): length of the ray with which an avoidance began, else
            nan.
        turned_rad: (moves,): turn of each move.
    Returns: (rows,) each: the index of the first move of each merged row, and the turn of the whole row, rad.
    """
    begins = np.ones(whose.size, dtype=np.bool_)
    begins[1:] = (np.diff(whose) != 0) | (np.diff(kind) != 0) | np.isfinite(ray_m[1:]) | (kind[1:] == STOP)
    first = np.flatnonzero(begins)
    return first, np.add.reduceat(turned_rad, first) if first.size else np.empty(0)


def gyro_errors(scenario: Scenario) -> tuple[float, float, float, float, float]:
    """Return the standard deviations of the gyro's errors, in the order of the arguments of ``gyro_readings``.

    Returns: of the scale, of the bias (rad/s), of the noise of a turn (rad), of the random walk (rad per root of s),
        and of the error of a bias that is measured at a stop (rad/s; -1 if robots do not measure the bias).
    """
    errors, rezero_deg_s = scenario.odometry.errors, scenario.odometry.rezero_noise_deg_s
    return (
        errors.scale,
        math.radians(errors.bias_deg_s),
        math.radians(errors.turn_deg),
        math.radians(errors.walk_deg_sqrt_s),
        -1.0 if rezero_deg_s is None else math.radians(rezero_deg_s),
    )


def measured_rays(
    scenario: Scenario,
    seed: int,
    run: NDArray[np.integer[Any]],
    robot: NDArray[np.integer[Any]],
    ray_m: NDArray[np.float64],
    number: int,
) -> NDArray[np.float64]:
    """Return the shortest rays as robots measure them when avoidances begin, m, (rows,): with ``rays.noise_m``.

    Args:
        seed: seed of the runs. run, robot, ray_m: (rows,), sorted by run, robot and time; rays are nan where no
            avoidance began. number: index of the first row among all rows of its robot, as in ``gyro_readings``.
    """
    if scenario.rays.noise_m == 0.0:
        return ray_m
    return noisy_rays(
        seed,
        run.astype(np.int64),
        robot.astype(np.int64),
        ray_m,
        scenario.rays.noise_m,
        scenario.rays.range_m,
        number,
    )


@allocating_kernel
def noisy_rays(
    seed: int,
    run: NDArray[np.int64],
    robot: NDArray[np.int64],
    ray_m: NDArray[np.float64],
    noise_m: float,
    range_m: float,
    number: int,
) -> NDArray[np.float64]:
    """Return rays with noise of the standard deviation ``noise_m``, limited to 0 and ``range_m``, (rows,).

    Args: as of ``measured_rays``.
    """
    out = np.empty(ray_m.size)
    for k in range(ray_m.size):
        if k > 0 and (run[k] != run[k - 1] or robot[k] != robot[k - 1]):
            number = 0
        error_m = noise_m * normal(seed, run[k], robot[k], ODOMETRY, number, OF_RAY)
        out[k] = min(max(ray_m[k] + error_m, 0.0), range_m) if np.isfinite(ray_m[k]) else ray_m[k]
        number += 1
    return out


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
    """Return the turns as the robots' gyros measure them, rad, (rows,).

    The rows may continue those of an earlier call in the middle of a robot's moves. The caller then passes the state of
    that robot in ``zeroing`` and ``number``, which it saved between the calls. If the first row is its robot's first,
    ``zeroing`` holds zeros and ``number`` is 0.

    Args:
        run, robot, kind, duration_s, turned_rad: (rows,): each row is a move; rows are sorted by run, robot and time.
            ``kind`` is an index into ``KINDS``.
        scale_spread, bias_spread_rad_s, turn_noise_rad, walk_rad_sqrt_s: standard deviations of the gyro's errors.
        rezero_rad_s: standard deviation of the error of a measured bias; below 0: the bias is not measured.
        zeroing: (2,): mean and number of the biases that the robot of the first row has measured before. Overwritten by
            those of the robot of the last row after that row.
        number: index of the first row among all rows of its robot.
    """
    out = np.empty(run.size)
    scale, bias, zero, measured = 0.0, 0.0, zeroing[0], zeroing[1]
    for k in range(run.size):
        # The next robot: draw its scale and bias, and reset its state. The first robot's state was passed in.
        if k == 0 or run[k] != run[k - 1] or robot[k] != robot[k - 1]:
            number = number if k == 0 else 0
            scale = scale_spread * normal(seed, run[k], robot[k], ODOMETRY, FIRST, OF_SCALE)
            bias = bias_spread_rad_s * normal(seed, run[k], robot[k], ODOMETRY, FIRST, OF_BIAS)
            if k > 0:
                zero, measured = 0.0, 0.0
        stands = kind[k] == STOP
        # The bias is measured at each stop, and once before the robot's first row, when it has not moved yet.
        if rezero_rad_s >= 0.0 and (stands or measured == 0.0):
            seen = bias + rezero_rad_s * normal(seed, run[k], robot[k], ODOMETRY, number, OF_REZERO)
            measured += 1.0
            zero += (seen - zero) / measured  # the mean so far
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
