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
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel
from vibroswarm.motion.control_step import Swarm, control
from vibroswarm.motion.fixed_step import sample
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.physics.arcs import fit_period
from vibroswarm.motion.physics.groups import LARGEST, Model, copy_robot, members_of, rests, set_groups
from vibroswarm.motion.physics.sensing import World, end_period, has_warned, sense
from vibroswarm.motion.recorder import Record, room
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE

MOTORS: Final = 2
"""Controls of a robot that change: left and right motor. Its magnets are always on."""


class Wheels(NamedTuple):
    """What steps of robots on wheels need, beside ``World``."""

    rolling_m: float
    gap_m: float
    """Distance of centres within which two robots may touch in one control period."""
    first: NDArray[np.int64]
    members: NDArray[np.int64]
    """Groups of robots, (robots,) each."""
    all: Model
    """All robots: their state is here."""
    groups: tuple[Model, Model, Model]
    """Models of 1, 2 and 3 robots."""


@inner
def turn_wheels(wheels: Wheels, swarm: Swarm, setup: Setup) -> None:
    """Set the wheels' speeds to those that the robots command."""
    control = wheels.all.control
    controls = control.size // swarm.size
    for i in range(swarm.size):
        row, place = swarm[i], controls * i
        track_m = setup.drive_track_m if row.mode == DRIVE else setup.turn_track_m
        apart_m_s = 0.5 * row.rate_rad_s * track_m
        control[place] = (row.speed_m_s - apart_m_s) / wheels.rolling_m
        control[place + 1] = (row.speed_m_s + apart_m_s) / wheels.rolling_m


@inner
def yaw_rad(qpos: NDArray[np.float64], place: int) -> float:
    """Return the heading of the quaternion that begins at ``place``, rad."""
    w, x, y, z = qpos[place], qpos[place + 1], qpos[place + 2], qpos[place + 3]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@inner
def step_group(world: World, group: Model, swarm: Swarm, members: NDArray[np.int64]) -> None:
    """Step the robots ``members``, which ``group`` holds, through one control period; add up their gyros' readings."""
    sensors = group.sensors.size // group.robots
    for _ in range(world.steps):
        world.calls.step(group.model, group.data)
        for k in range(group.robots):
            swarm[members[k]].gyro_deg += math.degrees(group.sensors[sensors * k + 2] * world.step_s)


@inner
def step_apart(world: World, wheels: Wheels, swarm: Swarm, size: int) -> None:
    """Step the first ``size`` of ``wheels.members`` through one control period in a model that holds only them.

    Their state is copied there and back. Nothing happens if all of them rest.
    """
    whole, part, members = wheels.all, wheels.groups[size - 1], wheels.members
    controls = whole.control.size // whole.robots
    standing = True
    for k in range(size):
        standing = standing and rests(whole, members[k])
    if standing:
        return
    for k in range(size):
        copy_robot(whole, members[k], part, k)
        for motor in range(MOTORS):
            part.control[controls * k + motor] = whole.control[controls * members[k] + motor]
    step_group(world, part, swarm, members)
    for k in range(size):
        copy_robot(part, k, whole, members[k])


@inner
def move_wheels(world: World, wheels: Wheels, swarm: Swarm, setup: Setup) -> None:
    """Let MuJoCo move the robots through one control period; set their poses, gyro readings, and the speeds and turn
    rates that they actually had.

    Groups of at most LARGEST robots are stepped apart; if one is larger, all robots are stepped together.
    """
    turn_wheels(wheels, swarm, setup)
    for i in range(swarm.size):
        swarm[i].gyro_deg = 0.0
    if set_groups(swarm, wheels.gap_m, wheels.first) <= LARGEST:
        for i in range(swarm.size):
            size = members_of(wheels.first, i, wheels.members)
            if size > 0:
                step_apart(world, wheels, swarm, size)
    else:
        for i in range(swarm.size):
            wheels.members[i] = i
        step_group(world, wheels.all, swarm, wheels.members)
    positions = world.qpos.size // swarm.size
    for i in range(swarm.size):
        row, place = swarm[i], positions * i
        row.from_x_m, row.from_y_m, row.from_heading_rad = row.x_m, row.y_m, row.heading_rad
        row.x_m, row.y_m = world.qpos[place], world.qpos[place + 1]
        row.heading_rad += wrapped_rad(yaw_rad(world.qpos, place + 3) - row.heading_rad)
    fit_period(swarm, setup)


@inner
def has_warned_in_groups(world: World, wheels: Wheels) -> bool:
    """Return whether MuJoCo has warned of robots, together or apart."""
    warned = has_warned(world.warnings)
    for k in range(LARGEST):
        warned = warned or has_warned(wheels.groups[k].warnings)
    return warned


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
        if control(swarm, setup, seed, run, now) > 0:
            sample(swarm, setup, speeds, record, seed, run, now)  # where they are now: they may be pushed on
        warned = False
        if not world.frozen[0]:
            move_wheels(world, wheels, swarm, setup)
            warned = has_warned_in_groups(world, wheels)
        end_period(world, warned, swarm, setup, record, opened, run, now)
        if warned:
            return now + 1
    return max(tick, until)
