"""One control period of robots on wheels in MuJoCo: sense, control, sample, drive.

The robots' program is that of the other engines (``control_step.control``). It reads MuJoCo's rays and MuJoCo's gyro;
its commands set the speeds of the driven wheels.

| name | unit | equation |
|---|---|---|
| wheel | rad/s | (speed -+ turn rate track / 2) / rolling radius: Eq. 19 as angular speeds of left and right wheel |
| gyro | deg | sum of the gyro's readings in the steps of a period, times the duration of a step |

| name | unit | meaning |
|---|---|---|
| gap | m | distance of centres within which two robots may touch in one control period |
| group | - | robots joined by distances below the gap, directly or through other robots |
| rest | m/s, rad/s | robots with motor targets of 0 and all velocities below REST; a group of these is not stepped |

Robots that do not touch have no equation in common, so stepping each group alone gives the same motion as stepping all
robots together; it costs less, as no contacts are sought between groups. The state of all robots is in the model of the
whole swarm, in which rays are cast too. Before a step, a group is copied into a model of 1, 2 or 3 robots, and
afterwards back. If a group is larger, all robots are stepped together in that control period.
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
from vibroswarm.motion.physics.sensing import World, end_period, has_warned, sense
from vibroswarm.motion.physics.wheels_model import ROLLING_M
from vibroswarm.motion.recorder import Record, room
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE

LARGEST: Final = 3
"""Number of robots in the largest group for which there is a model."""
REST: Final = 1e-4
"""Bound on the velocities of a robot at rest, m/s and rad/s. At 1e-4 m/s, a robot moves 2 micrometres in 20 ms."""


class Model(NamedTuple):
    """MuJoCo's model and data of some or all robots, as kernels use them; arrays are in the order of robots."""

    model: int
    """Address of MuJoCo's structure of the model."""
    data: int
    """Address of MuJoCo's structure of the data."""
    qpos: NDArray[np.float64]
    """View of MuJoCo's positions."""
    qvel: NDArray[np.float64]
    """View of MuJoCo's velocities."""
    warmstart: NDArray[np.float64]
    """View of the start values of MuJoCo's solver, as many as velocities."""
    control: NDArray[np.float64]
    """View of MuJoCo's controls: per robot two motors, then four magnets."""
    sensors: NDArray[np.float64]
    """View of MuJoCo's sensor readings: per robot the gyro's three axes first."""
    warnings: NDArray[np.int32]
    """Number of MuJoCo's warnings of each kind."""
    robots: int
    """Number of robots in the model."""


@inner
def set_groups(swarm: Swarm, gap_m: float, first: NDArray[np.int64]) -> int:
    """Write the lowest number of each robot's group to ``first``, (robots,); return the size of the largest group."""
    robots = swarm.size
    for i in range(robots):
        first[i] = i
    for i in range(robots):
        for j in range(i):
            dx, dy = swarm[i].x_m - swarm[j].x_m, swarm[i].y_m - swarm[j].y_m
            if first[i] != first[j] and dx * dx + dy * dy < gap_m * gap_m:
                # Join the groups of i and j; robots after i are still alone.
                kept, removed = min(first[i], first[j]), max(first[i], first[j])
                for k in range(i + 1):
                    if first[k] == removed:
                        first[k] = kept
    largest = 0
    for i in range(robots):
        size = 0
        for j in range(robots):
            size += first[j] == i
        largest = max(largest, size)
    return largest


@inner
def members_of(first: NDArray[np.int64], i: int, members: NDArray[np.int64]) -> int:
    """Write the numbers of a group's robots, lowest ``i``, into ``members``; return how many, 0 if there is none."""
    size = 0
    for j in range(first.size):
        if first[j] == i:
            members[size] = j
            size += 1
    return size


@inner
def copy_robot(source: Model, i: int, target: Model, j: int) -> None:
    """Copy positions, velocities and the solver's start values from robot ``i`` of one model to ``j`` of another."""
    # Numbers of entries per robot.
    positions, speeds = source.qpos.size // source.robots, source.qvel.size // source.robots
    for k in range(positions):
        target.qpos[positions * j + k] = source.qpos[positions * i + k]
    for k in range(speeds):
        target.qvel[speeds * j + k] = source.qvel[speeds * i + k]
        target.warmstart[speeds * j + k] = source.warmstart[speeds * i + k]


@inner
def rests(model: Model, i: int) -> bool:
    """Return whether robot ``i`` is at rest: target speeds 0, velocities below REST.

    It is not with a velocity that is nan, so that it is stepped and MuJoCo warns.
    """
    # Numbers of entries per robot. A robot's first two controls are the target speeds of its motors.
    controls, speeds = model.control.size // model.robots, model.qvel.size // model.robots
    if model.control[controls * i] != 0.0 or model.control[controls * i + 1] != 0.0:
        return False
    fastest = 0.0
    for k in range(speeds * i, speeds * (i + 1)):
        fastest = max(fastest, abs(model.qvel[k])) if not math.isnan(model.qvel[k]) else math.inf
    return fastest < REST


MOTORS: Final = 2
"""Number of a robot's controls that change: left and right motor. The other controls, its magnets, are always on."""


class Wheels(NamedTuple):
    """What kernels need to step robots on wheels, in addition to ``World``."""

    gap_m: float
    """Distance of centres within which two robots may touch in one control period, m."""
    first: NDArray[np.int64]
    """For each robot the lowest number of a robot in its group (``groups.set_groups``), shape (robots,)."""
    members: NDArray[np.int64]
    """Scratch memory for the members of a group, shape (robots,)."""
    all: Model
    """The model of the whole swarm, in which the state of all robots is."""
    groups: tuple[Model, Model, Model]
    """Models of 1, 2 and 3 robots, into which groups are copied for a step."""


@inner
def turn_wheels(wheels: Wheels, swarm: Swarm, setup: Setup) -> None:
    """Set the target speeds of each robot's motors, rad/s, to those that give its commanded speed and turn rate."""
    control = wheels.all.control
    controls = control.size // swarm.size  # per robot
    for i in range(swarm.size):
        row, place = swarm[i], controls * i
        track_m = setup.drive_track_m if row.mode == DRIVE else setup.turn_track_m
        half_difference_m_s = 0.5 * row.rate_rad_s * track_m
        control[place] = (row.speed_m_s - half_difference_m_s) / ROLLING_M
        control[place + 1] = (row.speed_m_s + half_difference_m_s) / ROLLING_M


@inner
def yaw_rad(qpos: NDArray[np.float64], place: int) -> float:
    """Return the heading, rad, of the quaternion (w, x, y, z) in ``qpos`` that begins at index ``place``."""
    w, x, y, z = qpos[place], qpos[place + 1], qpos[place + 2], qpos[place + 3]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@inner
def step_group(world: World, group: Model, swarm: Swarm, members: NDArray[np.int64]) -> None:
    """Step a model through one control period, and add the angles that its gyros read to the robots' ``gyro_deg``."""
    sensors = group.sensors.size // group.robots  # per robot; the third is the gyro's vertical axis
    for _ in range(world.steps):
        world.calls.step(group.model, group.data)
        for k in range(group.robots):
            swarm[members[k]].gyro_deg += math.degrees(group.sensors[sensors * k + 2] * world.step_s)


@inner
def step_apart(world: World, wheels: Wheels, swarm: Swarm, size: int) -> None:
    """Step a group of robots, the first ``size`` of ``wheels.members``, through one control period in its own model."""
    whole, part, members = wheels.all, wheels.groups[size - 1], wheels.members
    controls = whole.control.size // whole.robots
    all_rest = True
    for k in range(size):
        all_rest = all_rest and rests(whole, members[k])
    if all_rest:
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
    """Let MuJoCo move the robots through one control period."""
    turn_wheels(wheels, swarm, setup)
    for i in range(swarm.size):
        swarm[i].gyro_deg = 0.0
    if set_groups(swarm, wheels.gap_m, wheels.first) <= LARGEST:
        for i in range(swarm.size):
            size = members_of(wheels.first, i, wheels.members)  # 0 unless i is the lowest number of its group
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
        # A heading is not wrapped; a quaternion gives it only up to whole turns.
        row.heading_rad += wrapped_rad(yaw_rad(world.qpos, place + 3) - row.heading_rad)
    fit_period(swarm, setup)


@inner
def has_warned_in_groups(world: World, wheels: Wheels) -> bool:
    """Return whether MuJoCo has warned since the run began, in the model of the whole swarm or in one of a group."""
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
    seed: int,
    run: int,
    tick: int,
    until: int,
) -> int:
    """Simulate up to ``until``, full buffers, or a period in which MuJoCo warns; return the tick reached."""
    until = min(until, tick + room(record, swarm.size))
    for now in range(tick, until):
        sense(world, swarm, setup)
        if control(swarm, setup, seed, run, now) > 0:
            # Record samples before the move: a robot that samples may be pushed in this period, and its sample has the
            # pose at the beginning of the period. (In ``fixed_step.step`` robots that sample stay where they are.)
            sample(swarm, setup, speeds, record, seed, run, now)
        warned = False
        if not world.frozen[0]:
            move_wheels(world, wheels, swarm, setup)
            warned = has_warned_in_groups(world, wheels)
        end_period(world, warned, swarm, setup, record, run, now)
        if warned:
            return now + 1
    return max(tick, until)  # nothing has been simulated if ``until`` is not after ``tick``
