"""One control period of planar robots in MuJoCo: sense, control, push, sample.

The robots' program is that of the other engines (``control_step.control``); what it reads are MuJoCo's rays and the
turn of MuJoCo's body, and what it commands are forces.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel
from vibroswarm.motion.control_step import Swarm, control
from vibroswarm.motion.fixed_step import sample
from vibroswarm.motion.physics.arcs import fit_period
from vibroswarm.motion.physics.sensing import World, end_period, has_warned, sense
from vibroswarm.motion.recorder import Record, room
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import STOP


class Planar(NamedTuple):
    """Mass and the most that wheels push."""

    mass_kg: float
    spin_kg_m2: float
    push_n: float
    grip_n: float
    twist_n_m: float


@inner
def within(value: float, limit: float) -> float:
    """Return the value clipped to [-limit, limit]."""
    return min(max(value, -limit), limit)


@inner
def push(world: World, body: Planar, swarm: Swarm) -> None:
    """Set the forces of the next step: those that would give each robot the commanded speeds, within their limits."""
    per_s = 1.0 / world.step_s
    for i in range(swarm.size):
        row = swarm[i]
        aim = world.qpos[3 * i + 2] + 0.5 * row.rate_rad_s * world.step_s
        ahead_x, ahead_y = math.cos(aim), math.sin(aim)
        vx, vy = world.qvel[3 * i], world.qvel[3 * i + 1]
        along_m_s, aside_m_s = vx * ahead_x + vy * ahead_y, vy * ahead_x - vx * ahead_y
        most_n = body.grip_n if row.mode == STOP else body.push_n
        along_n = within((row.speed_m_s - along_m_s) * body.mass_kg * per_s, most_n)
        aside_n = within(-aside_m_s * body.mass_kg * per_s, body.grip_n)
        world.force[3 * i] = along_n * ahead_x - aside_n * ahead_y
        world.force[3 * i + 1] = along_n * ahead_y + aside_n * ahead_x
        faster_rad_s = row.rate_rad_s - world.qvel[3 * i + 2]
        world.force[3 * i + 2] = within(faster_rad_s * body.spin_kg_m2 * per_s, body.twist_n_m)


@inner
def move_planar(world: World, body: Planar, swarm: Swarm, setup: Setup) -> None:
    """Let MuJoCo move the bodies through one control period; set their poses, gyro readings, and the speeds and turn
    rates that they actually had."""
    for _ in range(world.steps):
        push(world, body, swarm)
        world.calls.step(world.model, world.data)
    for i in range(swarm.size):
        row = swarm[i]
        row.from_x_m, row.from_y_m, row.from_heading_rad = row.x_m, row.y_m, row.heading_rad
        row.x_m, row.y_m = world.qpos[3 * i], world.qpos[3 * i + 1]
        row.heading_rad = world.qpos[3 * i + 2]
        row.gyro_deg = math.degrees(row.heading_rad - row.from_heading_rad)
    fit_period(swarm, setup)


@kernel
def planar_steps(
    world: World,
    body: Planar,
    swarm: Swarm,
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    opened: NDArray[np.void],
    seed: int,
    run: int,
    tick: int,
    until: int,
) -> int:
    """Simulate from ``tick`` to ``until``, or while the buffers surely suffice; return the tick reached.

    It stops after a period in which MuJoCo warns. From that period on the robots stand.
    """
    until = min(until, tick + room(record, swarm.size))
    for now in range(tick, until):
        sense(world, swarm, setup)
        if control(swarm, setup, seed, run, now) > 0:
            sample(swarm, setup, speeds, record, seed, run, now)  # where they are now: they may be pushed on
        warned = False
        if not world.frozen[0]:
            move_planar(world, body, swarm, setup)
            warned = has_warned(world.warnings)
        end_period(world, warned, swarm, setup, record, opened, run, now)
        if warned:
            return now + 1
    return max(tick, until)
