"""One control period of planar robots in MuJoCo: sense, control, push, sample.

The robots' program is that of the other engines (``control_step.control``); what it reads are MuJoCo's rays and the
turn of MuJoCo's body, and what it commands are forces.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel
from vibroswarm.motion.control_step import Swarm, account, control, is_blind, load
from vibroswarm.motion.fixed_step import sample
from vibroswarm.motion.physics.arcs import fit_period, note_arcs
from vibroswarm.motion.recorder import Record, room
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import STOP, looks


class Planar(NamedTuple):
    """MuJoCo's model and data as kernels see them."""

    calls: Any
    """``library.Calls``."""
    model: int
    data: int
    """Addresses."""
    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    force: NDArray[np.float64]
    """Views of MuJoCo's memory, (3 robots,): x, y, heading of each."""
    warnings: NDArray[np.int32]
    """How often MuJoCo has warned, by kind."""
    groups: NDArray[np.uint8]
    """Groups of geoms that rays see."""
    point: NDArray[np.float64]
    direction: NDArray[np.float64]
    """Arguments of rays, (3,)."""
    steps: int
    """Steps of MuJoCo in a control period."""
    step_s: float
    mass_kg: float
    spin_kg_m2: float
    push_n: float
    grip_n: float
    twist_n_m: float


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
def ray_m(planar: Planar, swarm: Swarm, setup: Setup, i: int, k: int) -> float:
    """Return the length of robot ``i``'s ray ``k`` by MuJoCo, m; infinite if it hits nothing."""
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
    planar.point[0], planar.point[1] = x_m, y_m
    planar.direction[0] = ahead_x * setup.ray_cos[k] - ahead_y * setup.ray_sin[k]
    planar.direction[1] = ahead_y * setup.ray_cos[k] + ahead_x * setup.ray_sin[k]
    length_m = planar.calls.ray(
        planar.model, planar.data, planar.point.ctypes.data, planar.direction.ctypes.data,
        planar.groups.ctypes.data, 1, i + 1, 0, 0,
    )  # fmt: skip
    return length_m if length_m >= 0.0 else math.inf


@inner
def sense_planar(planar: Planar, swarm: Swarm, setup: Setup) -> None:
    """Read the rays of the robots whose program uses them in this step."""
    placed = False
    for i in range(swarm.size):
        if setup.blind_ms > 0.0 and is_blind(swarm, i):
            swarm[i].nearest_mm = math.inf
        elif looks(load(swarm, i), setup, swarm[i].gyro_deg):
            shortest_m = math.inf
            if sees_something(swarm, setup, i):
                if not placed:
                    planar.calls.kinematics(planar.model, planar.data)
                    placed = True
                for k in range(setup.ray_side_m.size):
                    shortest_m = min(shortest_m, ray_m(planar, swarm, setup, i, k))
            swarm[i].nearest_mm = 1000.0 * shortest_m if shortest_m <= setup.look_m else math.inf


@inner
def within(value: float, limit: float) -> float:
    """Return the value clipped to [-limit, limit]."""
    return min(max(value, -limit), limit)


@inner
def push(planar: Planar, swarm: Swarm) -> None:
    """Set the forces of the next step: those that would give each robot the commanded speeds, within their limits."""
    per_s = 1.0 / planar.step_s
    for i in range(swarm.size):
        row = swarm[i]
        aim = planar.qpos[3 * i + 2] + 0.5 * row.rate_rad_s * planar.step_s
        ahead_x, ahead_y = math.cos(aim), math.sin(aim)
        vx, vy = planar.qvel[3 * i], planar.qvel[3 * i + 1]
        along_m_s, aside_m_s = vx * ahead_x + vy * ahead_y, vy * ahead_x - vx * ahead_y
        most_n = planar.grip_n if row.mode == STOP else planar.push_n
        along_n = within((row.speed_m_s - along_m_s) * planar.mass_kg * per_s, most_n)
        aside_n = within(-aside_m_s * planar.mass_kg * per_s, planar.grip_n)
        planar.force[3 * i] = along_n * ahead_x - aside_n * ahead_y
        planar.force[3 * i + 1] = along_n * ahead_y + aside_n * ahead_x
        faster_rad_s = row.rate_rad_s - planar.qvel[3 * i + 2]
        planar.force[3 * i + 2] = within(faster_rad_s * planar.spin_kg_m2 * per_s, planar.twist_n_m)


@inner
def move_planar(planar: Planar, swarm: Swarm, setup: Setup) -> None:
    """Let MuJoCo move the bodies through one control period; set poses, gyro, and speeds as they were."""
    for _ in range(planar.steps):
        push(planar, swarm)
        planar.calls.step(planar.model, planar.data)
    for i in range(swarm.size):
        row = swarm[i]
        row.from_x_m, row.from_y_m, row.from_heading_rad = row.x_m, row.y_m, row.heading_rad
        row.x_m, row.y_m = planar.qpos[3 * i], planar.qpos[3 * i + 1]
        row.heading_rad = planar.qpos[3 * i + 2]
        row.gyro_deg = math.degrees(row.heading_rad - row.from_heading_rad)
    fit_period(swarm, setup)


@inner
def has_warned(warnings: NDArray[np.int32]) -> bool:
    """Return whether MuJoCo has warned since its data were reset."""
    count = 0
    for kind in range(warnings.size):
        count += warnings[kind]
    return count > 0


@kernel
def planar_steps(
    planar: Planar,
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

    It stops after a period in which MuJoCo warns.
    """
    until = min(until, tick + room(record, swarm.size))
    for now in range(tick, until):
        sense_planar(planar, swarm, setup)
        sampling = control(swarm, setup, seed, run, now)
        move_planar(planar, swarm, setup)
        note_arcs(record, opened, swarm, setup, run, now)
        if sampling > 0:
            sample(swarm, setup, speeds, record, seed, run, now)
        account(swarm)
        if has_warned(planar.warnings):
            return now + 1
    return max(tick, until)
