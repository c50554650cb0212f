"""What robots in MuJoCo sense (rays against walls and the discs that rays see of other robots), and what ends a period.

A ray is MuJoCo's (``mj_ray``). Robots near nothing cast none, as in the other engines.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner
from vibroswarm.motion.control_step import Swarm, account, is_blind, load
from vibroswarm.motion.physics.arcs import note_arcs
from vibroswarm.motion.recorder import Record
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import looks


class World(NamedTuple):
    """MuJoCo's model and data as kernels see them."""

    calls: Any
    """``library.Calls``."""
    model: int
    data: int
    """Addresses."""
    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    force: NDArray[np.float64]
    """Views of MuJoCo's memory: positions, velocities, generalised forces."""
    warnings: NDArray[np.int32]
    """How often MuJoCo has warned since its data were reset, by kind."""
    frozen: NDArray[np.int64]
    """Whether the run has failed, (1,): MuJoCo is not stepped any more."""
    groups: NDArray[np.uint8]
    """Groups of geoms that rays see."""
    point: NDArray[np.float64]
    direction: NDArray[np.float64]
    """Arguments of rays, (3,)."""
    cone_rad: NDArray[np.float64]
    """Directions of a sensor's rays about its axis, rad."""
    bodies: int
    """Bodies of a robot."""
    steps: int
    """Steps of MuJoCo in a control period."""
    step_s: float


@inner
def has_warned(warnings: NDArray[np.int32]) -> bool:
    """Return whether MuJoCo has warned since its data were reset: any of ``World.warnings`` is not 0."""
    count = 0
    for kind in range(warnings.size):
        count += warnings[kind]
    return count > 0


@inner
def stand(swarm: Swarm) -> None:
    """Leave all robots where they are for one control period."""
    for i in range(swarm.size):
        row = swarm[i]
        row.from_x_m, row.from_y_m, row.from_heading_rad = row.x_m, row.y_m, row.heading_rad
        row.speed_m_s = row.rate_rad_s = row.gyro_deg = 0.0


@inner
def freeze(world: World, swarm: Swarm, tick: int) -> None:
    """Undo the period in which MuJoCo warned, as its numbers are wrong, and let all robots stand from then on."""
    world.frozen[0] = 1
    for i in range(swarm.size):
        row = swarm[i]
        row.x_m, row.y_m, row.heading_rad = row.from_x_m, row.from_y_m, row.from_heading_rad
        row.fails_tick, row.silent_tick = min(row.fails_tick, tick), min(row.silent_tick, tick)
    stand(swarm)


@inner
def sees_something(swarm: Swarm, setup: Setup, i: int) -> bool:
    """Return whether a wall or a robot is near enough for robot ``i``'s rays."""
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
    """Return the shortest ray of robot ``i``'s sensor ``k`` by MuJoCo, m.

    It is infinite if no ray hits anything, and 0 if the sensor lies outside the arena or within another robot's disc.
    """
    row = swarm[i]
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
        length_m = world.calls.ray(
            world.model, world.data, world.point.ctypes.data, world.direction.ctypes.data,
            world.groups.ctypes.data, 1, 1 + world.bodies * i, 0, 0,
        )  # fmt: skip
        if length_m >= 0.0:
            shortest_m = min(shortest_m, length_m)
    return shortest_m


@inner
def sense(world: World, swarm: Swarm, setup: Setup) -> None:
    """Read the sensors of the robots whose program uses them in this step."""
    placed = False
    for i in range(swarm.size):
        if setup.blind_ms > 0.0 and is_blind(swarm, i):
            swarm[i].nearest_mm = math.inf
        elif looks(load(swarm, i), setup, swarm[i].gyro_deg):
            shortest_m = math.inf
            if sees_something(swarm, setup, i):
                if not placed:  # after a step, or a restored state, geoms lie where they were before
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
    opened: NDArray[np.void],
    run: int,
    tick: int,
) -> None:
    """Record a control period after its moves: arcs, and the time of each robot in its mode.

    Args:
        warned: whether MuJoCo has warned in this period. The period is then undone, and the robots stand from its
            beginning on.
    """
    if world.frozen[0]:
        stand(swarm)
    elif warned:
        freeze(world, swarm, tick)
    note_arcs(record, opened, swarm, setup, run, tick)
    account(swarm)
