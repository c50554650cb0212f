"""One control period of robots on wheels in MuJoCo: sense, control, drive, sample.

The robots' program is that of the other engines (``control_step.control``). Its commands turn the driven wheels; it
reads MuJoCo's rays and MuJoCo's gyro.

| name | unit | equation |
|---|---|---|
| wheel | rad/s | (speed -+ turn rate track / 2) / rolling radius: the commands of Eq. 19, as speeds of wheels |
| gyro | deg | sum of the gyro's reading over the steps of a period, times their duration |
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel
from vibroswarm.motion.control_step import Swarm, account, control
from vibroswarm.motion.fixed_step import sample
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.physics.arcs import fit_period, note_arcs
from vibroswarm.motion.physics.sensing import World, freeze, has_warned, sense, stand
from vibroswarm.motion.recorder import Record, room
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE


class Wheels(NamedTuple):
    """Where a robot's numbers lie in MuJoCo's arrays."""

    rolling_m: float
    positions: int
    """Positions of a robot: x, y, z, a quaternion, the wheels."""
    controls: int
    """Controls of a robot: left and right motor, the magnets."""
    sensors: int
    """Numbers of a robot's sensors: gyro (x, y, z), accelerometer."""


@inner
def turn_wheels(world: World, wheels: Wheels, swarm: Swarm, setup: Setup) -> None:
    """Set the wheels' speeds to those that the robots command."""
    for i in range(swarm.size):
        row, place = swarm[i], wheels.controls * i
        track_m = setup.drive_track_m if row.mode == DRIVE else setup.turn_track_m
        apart_m_s = 0.5 * row.rate_rad_s * track_m
        world.control[place] = (row.speed_m_s - apart_m_s) / wheels.rolling_m
        world.control[place + 1] = (row.speed_m_s + apart_m_s) / wheels.rolling_m


@inner
def yaw_rad(qpos: NDArray[np.float64], place: int) -> float:
    """Return the heading of the quaternion that begins at ``place``, rad."""
    w, x, y, z = qpos[place], qpos[place + 1], qpos[place + 2], qpos[place + 3]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@inner
def move_wheels(world: World, wheels: Wheels, swarm: Swarm, setup: Setup) -> None:
    """Let MuJoCo move the robots through one control period; set poses, gyro, and speeds as they were."""
    turn_wheels(world, wheels, swarm, setup)
    for i in range(swarm.size):
        swarm[i].gyro_deg = 0.0
    for _ in range(world.steps):
        world.calls.step(world.model, world.data)
        for i in range(swarm.size):
            swarm[i].gyro_deg += math.degrees(world.sensors[wheels.sensors * i + 2] * world.step_s)
    for i in range(swarm.size):
        row, place = swarm[i], wheels.positions * i
        row.from_x_m, row.from_y_m, row.from_heading_rad = row.x_m, row.y_m, row.heading_rad
        row.x_m, row.y_m = world.qpos[place], world.qpos[place + 1]
        row.heading_rad += wrapped_rad(yaw_rad(world.qpos, place + 3) - row.heading_rad)
    fit_period(swarm, setup)


@kernel
def wheels_steps(
    world: World,
    wheels: Wheels,
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
        sampling = control(swarm, setup, seed, run, now)
        if world.frozen[0]:
            stand(swarm)
        else:
            move_wheels(world, wheels, swarm, setup)
            if has_warned(world):
                freeze(world, swarm, now)
                until = now + 1
        note_arcs(record, opened, swarm, setup, run, now)
        if sampling > 0:
            sample(swarm, setup, speeds, record, seed, run, now)
        account(swarm)
        if now + 1 >= until:
            break
    return max(tick, until)
