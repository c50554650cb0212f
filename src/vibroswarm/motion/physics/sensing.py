"""The distance sensors of robots in MuJoCo (``mj_ray``), and the end of a control period."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner
from vibroswarm.motion.control_step import Swarm, account, is_blind, load
from vibroswarm.motion.physics.arcs import note_fitted_move
from vibroswarm.motion.recorder import Record
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import looks


class World(NamedTuple):
    """MuJoCo's model and data of the whole swarm, and what rays need, as kernels use them."""

    calls: Any
    """MuJoCo's functions (``library.Calls``)."""
    model: int
    """Address of MuJoCo's structure of the model."""
    data: int
    """Address of MuJoCo's structure of the data."""
    qpos: NDArray[np.float64]
    """View of MuJoCo's positions, in the order of robots."""
    warnings: NDArray[np.int32]
    """Number of MuJoCo's warnings of each kind since its data were reset."""
    frozen: NDArray[np.int64]
    """1 if the run has failed, so that MuJoCo is not stepped any more, else 0; shape (1,)."""
    groups: NDArray[np.uint8]
    """For each of MuJoCo's six groups of geoms, 1 if rays see it, else 0."""
    point: NDArray[np.float64]
    """Start of a ray, shape (3,); x and y are written before each call of ``mj_ray``, z is the sensors' height."""
    direction: NDArray[np.float64]
    """Direction of a ray, shape (3,); x and y are written before each call of ``mj_ray``, z is 0."""
    cone_rad: NDArray[np.float64]
    """Directions of a sensor's rays, relative to its axis, rad."""
    bodies: int
    """Number of MuJoCo's bodies in a robot."""
    steps: int
    """Number of MuJoCo's steps in a control period."""
    step_s: float
    """Duration of a step, s."""


@inner
def has_warned(warnings: NDArray[np.int32]) -> bool:
    """Return whether MuJoCo has warned since its data were reset, given its number of warnings of each kind."""
    count = 0
    for kind in range(warnings.size):
        count += warnings[kind]
    return count > 0


@inner
def stand(swarm: Swarm) -> None:
    """Let all robots stand for one control period: poses stay, speeds and gyro readings are 0."""
    for i in range(swarm.size):
        row = swarm[i]
        row.from_x_m, row.from_y_m, row.from_heading_rad = row.x_m, row.y_m, row.heading_rad
        row.speed_m_s = row.rate_rad_s = row.gyro_deg = 0.0


@inner
def freeze(world: World, swarm: Swarm, tick: int) -> None:
    """Undo the motion of the control period at ``tick``, in which MuJoCo warned, and make all robots stand for good."""
    world.frozen[0] = 1
    for i in range(swarm.size):
        row = swarm[i]
        row.x_m, row.y_m, row.heading_rad = row.from_x_m, row.from_y_m, row.from_heading_rad
        # ``control_step.control`` makes the robot fail and fall silent at its next step. A robot that stands to sample
        # completes this stop first, and takes its sample.
        row.fails_tick, row.silent_tick = min(row.fails_tick, tick), min(row.silent_tick, tick)
    stand(swarm)


@inner
def sees_something(swarm: Swarm, setup: Setup, i: int) -> bool:
    """Return whether a wall or another robot may be within reach of robot ``i``'s rays."""
    row, reach_m = swarm[i], setup.ray_reach_m
    if row.x_m < reach_m or row.y_m < reach_m:
        return True
    if setup.width_m - row.x_m < reach_m or setup.height_m - row.y_m < reach_m:
        return True
    for j in range(swarm.size):
        dx, dy = swarm[j].x_m - row.x_m, swarm[j].y_m - row.y_m
        if j != i and dx * dx + dy * dy < setup.sight_m * setup.sight_m:
            return True
    return False


@inner
def shortest_ray_m(world: World, swarm: Swarm, setup: Setup, i: int, k: int) -> float:
    """Return the shortest ray of the cone of robot ``i``'s sensor ``k``, m; infinite: none hits; 0: inside a body."""
    row = swarm[i]
    # The sensor's position and, further down, its axis in the arena.
    ahead_x, ahead_y = math.cos(row.heading_rad), math.sin(row.heading_rad)
    x_m = row.x_m + row.ray_forward_m * ahead_x - setup.ray_side_m[k] * ahead_y
    y_m = row.y_m + row.ray_forward_m * ahead_y + setup.ray_side_m[k] * ahead_x
    if x_m <= 0.0 or y_m <= 0.0 or x_m >= setup.width_m or y_m >= setup.height_m:
        return 0.0
    for j in range(swarm.size):
        dx, dy = swarm[j].x_m - x_m, swarm[j].y_m - y_m
        if j != i and dx * dx + dy * dy <= setup.disc_radius_m * setup.disc_radius_m:
            return 0.0
    axis_x = ahead_x * setup.ray_cos[k] - ahead_y * setup.ray_sin[k]
    axis_y = ahead_y * setup.ray_cos[k] + ahead_x * setup.ray_sin[k]
    world.point[0], world.point[1] = x_m, y_m
    shortest_m = math.inf
    for part in range(world.cone_rad.size):
        along, aside = math.cos(world.cone_rad[part]), math.sin(world.cone_rad[part])
        world.direction[0] = axis_x * along - axis_y * aside
        world.direction[1] = axis_y * along + axis_x * aside
        # After the groups: 1, as static geoms (walls) are seen; the first body of robot i, which is left out (body 0 is
        # the world); and two zeros, as neither the geom that is hit nor its normal is requested.
        length_m = world.calls.ray(
            world.model, world.data, world.point.ctypes.data, world.direction.ctypes.data,
            world.groups.ctypes.data, 1, 1 + world.bodies * i, 0, 0,
        )  # fmt: skip
        if length_m >= 0.0:  # -1: nothing is hit
            shortest_m = min(shortest_m, length_m)
    return shortest_m


@inner
def sense(world: World, swarm: Swarm, setup: Setup) -> None:
    """Set ``nearest_mm``, the length of the shortest ray, of each robot whose program reads it at this tick."""
    placed = False  # whether MuJoCo's geoms have been moved to the robots' present positions
    for i in range(swarm.size):
        if setup.blind_ms > 0.0 and is_blind(swarm, i):
            swarm[i].nearest_mm = math.inf
        elif looks(load(swarm, i), setup, swarm[i].gyro_deg):
            shortest_m = math.inf
            if sees_something(swarm, setup, i):
                if not placed:  # a step of MuJoCo leaves the geoms where they were before that step
                    world.calls.kinematics(world.model, world.data)
                    placed = True
                for k in range(setup.ray_side_m.size):
                    shortest_m = min(shortest_m, shortest_ray_m(world, swarm, setup, i, k))
            swarm[i].nearest_mm = 1000.0 * shortest_m if shortest_m <= setup.look_m else math.inf


@inner
def end_period(
    world: World,
    warned: bool,
    swarm: Swarm,
    setup: Setup,
    record: Record,
    run: int,
    tick: int,
) -> None:
    """End the control period at ``tick``: record moves and times in each mode; if MuJoCo ``warned``, undo it."""
    if world.frozen[0]:
        stand(swarm)
    elif warned:
        freeze(world, swarm, tick)
    if record.moves.size > 0:
        for i in range(swarm.size):
            note_fitted_move(record, swarm, setup, run, tick, i)
    account(swarm)
