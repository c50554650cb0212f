"""Robots that cannot touch are stepped apart, each in a model of its own; those that may touch, together.

| name | unit | meaning |
|---|---|---|
| gap | m | distance of centres within which two robots may touch in one control period |
| group | - | robots joined by distances below the gap, directly or through others |
| rest | m/s, rad/s | a group whose motors are off and whose velocities are all below REST stands: it is not stepped |

Robots that do not touch have no equation in common, so a step of each alone is the step of all; it costs less, as
nothing is looked for between them. The state of all robots lies in the model of all, which rays are cast in; groups
are copied into models of 1, 2 or 3 robots and back. If one is larger, all robots are stepped together in that period.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner
from vibroswarm.motion.control_step import Swarm

LARGEST: Final = 3
"""Robots of the largest group that has a model of its own."""
REST: Final = 1e-4
"""Velocities of a robot at rest, m/s and rad/s. It would roll on by 2 micrometres."""


class Model(NamedTuple):
    """MuJoCo's model and data of some robots, as kernels see them."""

    model: int
    data: int
    """Addresses."""
    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    warmstart: NDArray[np.float64]
    control: NDArray[np.float64]
    sensors: NDArray[np.float64]
    """Views of MuJoCo's memory: positions, velocities, what its solver begins with, controls, sensors."""
    warnings: NDArray[np.int32]
    """How often MuJoCo has warned, by kind."""
    robots: int


@inner
def set_groups(swarm: Swarm, gap_m: float, first: NDArray[np.int64]) -> int:
    """Group the robots by distance; return the size of the largest group.

    Args:
        gap_m: robots nearer than this, centre to centre, are in one group.
        first: (robots,), written: lowest index in each robot's group.
    """
    robots = swarm.size
    for i in range(robots):
        first[i] = i
    for i in range(robots):
        for j in range(i):
            dx, dy = swarm[i].x_m - swarm[j].x_m, swarm[i].y_m - swarm[j].y_m
            if first[i] != first[j] and dx * dx + dy * dy < gap_m * gap_m:
                joined, gone = min(first[i], first[j]), max(first[i], first[j])
                for k in range(i + 1):
                    if first[k] == gone:
                        first[k] = joined
    largest = 0
    for i in range(robots):
        size = 0
        for j in range(robots):
            size += first[j] == i
        largest = max(largest, size)
    return largest


@inner
def members_of(first: NDArray[np.int64], i: int, members: NDArray[np.int64]) -> int:
    """Write the robots of the group whose lowest index is ``i`` into ``members``; return their number, 0 if there is no
    such group."""
    size = 0
    for j in range(first.size):
        if first[j] == i:
            members[size] = j
            size += 1
    return size


@inner
def copy_robot(source: Model, i: int, target: Model, j: int) -> None:
    """Copy positions, velocities and what the solver begins with from robot ``i`` of one model to ``j`` of another."""
    positions, speeds = source.qpos.size // source.robots, source.qvel.size // source.robots
    for k in range(positions):
        target.qpos[positions * j + k] = source.qpos[positions * i + k]
    for k in range(speeds):
        target.qvel[speeds * j + k] = source.qvel[speeds * i + k]
        target.warmstart[speeds * j + k] = source.warmstart[speeds * i + k]


@inner
def rests(model: Model, i: int) -> bool:
    """Return whether robot ``i`` stands, with its motors off; False if a velocity is nan."""
    controls, speeds = model.control.size // model.robots, model.qvel.size // model.robots
    if model.control[controls * i] != 0.0 or model.control[controls * i + 1] != 0.0:
        return False
    fastest = 0.0
    for k in range(speeds * i, speeds * (i + 1)):
        fastest = max(fastest, abs(model.qvel[k])) if not math.isnan(model.qvel[k]) else math.inf
    return fastest < REST
