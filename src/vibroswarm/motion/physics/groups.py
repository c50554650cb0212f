"""Groups of robots: robots that may touch each other are stepped together in MuJoCo, others in separate models.

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

from vibroswarm.core.jit import inner
from vibroswarm.motion.control_step import Swarm

LARGEST: Final = 3
"""Number of robots in the largest group for which there is a model."""
REST: Final = 1e-4
"""Bound on the velocities of a robot at rest, m/s and rad/s. At 1e-4 m/s, a robot moves 2 micrometres in 20 ms."""


class Model(NamedTuple):
    """MuJoCo's model and data of some or all robots, as kernels use them.

    In each array except ``warnings``, all robots have the same number of entries, in the order of robots.
    """

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
    """Group the robots by distance; return the size of the largest group.

    Args:
        gap_m: robots nearer than this, centre to centre, are in one group.
        first: shape (robots,), written: for each robot the lowest number of a robot in its group.
    """
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
    """Write the numbers of the robots in a group into ``members``; return the group's size.

    Args:
        first: as written by ``set_groups``.
        i: lowest number of a robot in the group. If no group has this lowest number, the result is 0.
        members: shape (robots,); entries after the group's are left as they are.
    """
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
    """Return whether robot ``i`` is at rest: the target speeds of its motors are 0, and all its velocities below REST.

    A robot with a velocity that is nan is not at rest, so that it is stepped and MuJoCo warns.
    """
    # Numbers of entries per robot. A robot's first two controls are the target speeds of its motors.
    controls, speeds = model.control.size // model.robots, model.qvel.size // model.robots
    if model.control[controls * i] != 0.0 or model.control[controls * i + 1] != 0.0:
        return False
    fastest = 0.0
    for k in range(speeds * i, speeds * (i + 1)):
        fastest = max(fastest, abs(model.qvel[k])) if not math.isnan(model.qvel[k]) else math.inf
    return fastest < REST
