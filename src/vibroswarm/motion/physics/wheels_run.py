"""``mujoco``: runs of robots on magnetic wheels in MuJoCo.

MuJoCo's model is what never changes in a run; its data are the state. A run in which MuJoCo warns has failed: from then
on its robots stand (``sensing.freeze``).

| name | unit | meaning |
|---|---|---|
| pose | m, rad | x, y and heading of a rectangle's middle, (3,) |
| size | m | its length, along the heading, and its width |
| depth | m | how far one of two must move until they are apart; below 0: they are apart |

Two rectangles are apart if, along a side of one of them, their shadows do not overlap (separating axis theorem). So the
depth is the least overlap of their shadows along the four directions of their sides.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.numbers import stated
from vibroswarm.errors import InputError, warn_once
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.motion_tables import Failure
from vibroswarm.motion.physics.library import calls, mujoco
from vibroswarm.motion.physics.sensing import World
from vibroswarm.motion.physics.wheels_model import (
    CONE_RAD,
    CORNER_M,
    LENGTH_M,
    MARGIN_M,
    SENSOR_HEIGHT_M,
    STEP_MS,
    SUNK_M,
    TARGETS,
    WALLS,
    WHEELS,
    WIDTH_M,
    wheels_xml,
)
from vibroswarm.motion.physics.wheels_step import LARGEST, Model, Wheels, wheels_steps
from vibroswarm.motion.source import Source, register

Floats = NDArray[np.float64]

SPARE_M: Final = 1e-5
"""Distance that is left between two robots that were moved apart, if there is room."""
ROUNDS: Final = 2000
"""Most rounds in which robots that start too near are moved apart."""


def half_shadow(turned_rad: Floats, size_m: tuple[float, float]) -> Floats:
    """Return half of the length of a rectangle's shadow along a direction at an angle to its heading, m."""
    shadow: Floats = (np.abs(np.cos(turned_rad)) * size_m[0] + np.abs(np.sin(turned_rad)) * size_m[1]) / 2
    return shadow


def half_extents(heading_rad: Floats, size_m: tuple[float, float]) -> Floats:
    """Return how far rectangles reach from their middles along x and y, (..., 2), m."""
    return np.stack([half_shadow(heading_rad - turn, size_m) for turn in (0.0, math.pi / 2)], axis=-1)


def overlap(one: Floats, other: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return how deep pairs of rectangles overlap, (pairs,), and unit vectors from ``other`` to ``one``, (pairs, 2)."""
    depth, direction = np.full(len(one), np.inf), np.zeros((len(one), 2))
    for side_rad in (one[:, 2], one[:, 2] + math.pi / 2, other[:, 2], other[:, 2] + math.pi / 2):
        axis = np.stack([np.cos(side_rad), np.sin(side_rad)], axis=-1)
        apart = ((one - other)[:, :2] * axis).sum(axis=-1)
        shadows = half_shadow(one[:, 2] - side_rad, size_m) + half_shadow(other[:, 2] - side_rad, size_m)
        least = shadows - np.abs(apart) < depth
        depth = np.where(least, shadows - np.abs(apart), depth)
        direction = np.where(least[:, None], np.where(apart < 0, -1.0, 1.0)[:, None] * axis, direction)
    return depth, direction


def with_room(poses: Floats, size_m: tuple[float, float], arena_m: tuple[float, float]) -> Floats:
    """Move rectangles that overlap each other or a wall apart, and return their poses; others stay bit by bit."""
    poses = poses.copy()
    first, second = np.triu_indices(len(poses), k=1)
    reach = half_extents(poses[:, 2], size_m)
    for _ in range(ROUNDS):
        poses[:, :2] = np.clip(poses[:, :2], reach, np.array(arena_m) - reach)
        depth, direction = overlap(poses[first], poses[second], size_m)
        close = depth > 0.0
        if not close.any():
            return poses
        shift = 0.5 * (depth[close, None] + SPARE_M) * direction[close]  # each by half
        np.add.at(poses[:, :2], first[close], shift)
        np.add.at(poses[:, :2], second[close], -shift)
    raise InputError(
        f"{len(poses)} robots of {1000 * size_m[0]:g} x {1000 * size_m[1]:g} mm do not fit into an arena of "
        f"{arena_m[0]:g} x {arena_m[1]:g} m",
        field="swarm.robots",
    )


WARNINGS: Final = {
    0: "a singular inertia",
    1: "too many contacts",
    2: "too many constraints",
    3: "positions that are not finite",
    4: "velocities that are not finite",
    5: "accelerations that are not finite",
    6: "controls that are not finite",
}
"""MuJoCo's kinds of warnings (``mjtWarning``) in words."""


class WheelsRun(KernelRun):
    """A run of robots on wheels in MuJoCo (``MotionState``)."""

    cone_rad: ClassVar[tuple[float, ...]] = CONE_RAD
    """Directions of the rays of a distance sensor, relative to its axis, rad."""

    def prepare(self) -> None:
        """Compile the models, and allocate MuJoCo's data, with views of their memory for kernels."""
        self.steps = math.ceil(self.tick_ms / STEP_MS)  # MuJoCo's steps per control period
        self.step_s = self.scenario.tick_s / self.steps
        self.model: Any = mujoco().MjModel.from_xml_string(wheels_xml(self.scenario, self.step_s))
        # A swarm of fewer than LARGEST robots has no larger groups. Models for larger groups are never used then, and
        # get as many robots as the swarm has.
        robots = self.scenario.swarm.robots
        self.group_models: list[Any] = [
            mujoco().MjModel.from_xml_string(wheels_xml(self.scenario, self.step_s, min(size, robots)))
            for size in range(1, LARGEST + 1)
        ]
        data = self.data = mujoco().MjData(self.model)
        groups = np.zeros(6, dtype=np.uint8)  # for each of MuJoCo's six groups of geoms, whether rays see it
        groups[[WALLS, TARGETS]] = 1
        self.world = World(
            calls=calls(), model=self.model._address, data=data._address, qpos=data.qpos,
            warnings=data.warning.number, frozen=np.zeros(1, dtype=np.int64),
            groups=groups, point=np.array([0.0, 0.0, SENSOR_HEIGHT_M]), direction=np.zeros(3),
            cone_rad=np.array(self.cone_rad), bodies=1 + len(WHEELS), steps=self.steps, step_s=self.step_s,
        )  # fmt: skip
        robot = self.scenario.robot
        self.group_data: list[Any] = [mujoco().MjData(model) for model in self.group_models]
        one, two, three = (
            _views(model, data, min(size, robots))
            for size, (model, data) in enumerate(zip(self.group_models, self.group_data, strict=True), 1)
        )
        # No speed factor is larger: drawn ones are clipped to ``speed_factor_max``, larger ones in a list are refused.
        factor = max(float(self.speeds.max()), robot.speed_factor_max)
        # The longest way that a robot drives in a control period. Two robots approach each other by at most twice this
        # length; the gap includes four times this length, to be safe.
        step_m = factor * robot.full_speed_m_s * self.scenario.tick_s
        self.wheels = Wheels(
            gap_m=2.0 * CORNER_M + MARGIN_M + 4.0 * step_m,
            first=np.zeros(robots, dtype=np.int64), members=np.zeros(robots, dtype=np.int64),
            all=_views(self.model, self.data, robots), groups=(one, two, three),
        )  # fmt: skip

    def begin(self, seed: int, run: int) -> None:
        """Set this state to time 0 of a run, whatever it was before."""
        super().begin(seed, run)
        mujoco().mj_resetData(self.model, self.data)
        self.world.frozen[0] = 0
        self.place()

    def move_on(self, until: int) -> int:
        """Simulate up to ``until``, full buffers, or a period in which MuJoCo warns; return the tick reached."""
        reached = wheels_steps(
            self.world, self.wheels, self.swarm, self.setup, self.speeds, self.record,
            self.seed, self.run, self.tick, until,
        )  # fmt: skip
        if self.world.frozen[0] and self.failure is None:
            # The latest period, which began at ``reached`` - 1, was undone.
            kinds = np.flatnonzero(self.warned())
            reason = "MuJoCo warned of " + " and ".join(WARNINGS[kind] for kind in kinds.tolist())
            at_s = (reached - 1) * self.tick_ms / 1000.0
            self.failure = Failure(self.run, at_s, reason)
            warn_once(f"run {self.run} of seed {self.seed} failed at {stated(at_s)} s: {reason}")
        return reached

    def warned(self) -> NDArray[np.int32]:
        """Return the number of MuJoCo's warnings of each kind since the run began, in all models."""
        return sum((data.warning.number for data in self.group_data), start=self.data.warning.number)

    def place(self) -> None:
        """Set MuJoCo's state, which has just been reset, to the robots' poses, with magnets on and all velocities 0."""
        robots, arena = self.scenario.swarm.robots, self.scenario.arena
        poses = np.column_stack([self.swarm[name] for name in ("x_m", "y_m", "heading_rad")])
        apart = with_room(poses, (LENGTH_M, WIDTH_M), (arena.width_m, arena.height_m))
        self.swarm["x_m"], self.swarm["y_m"] = apart[:, 0], apart[:, 1]
        # Views with one row per robot. A row of poses: x, y, z, heading as a quaternion (w, x, y, z), angles of wheels.
        # A row of controls: two motors, four magnets.
        poses, controls = (values.reshape(robots, -1) for values in (self.data.qpos, self.data.ctrl))
        poses[:] = 0.0
        poses[:, 0], poses[:, 1], poses[:, 2] = self.swarm["x_m"], self.swarm["y_m"], -SUNK_M
        half_rad = 0.5 * self.swarm["heading_rad"]
        poses[:, 3], poses[:, 6] = np.cos(half_rad), np.sin(half_rad)
        controls[:, 2:] = 1.0
        # Models of groups get poses, velocities and motor commands whenever a group is stepped: set their magnets only.
        # The reset also sets the numbers of MuJoCo's warnings to 0.
        for model, data in zip(self.group_models, self.group_data, strict=True):
            mujoco().mj_resetData(model, data)
            data.ctrl[:] = 1.0


def _views(model: Any, data: Any, robots: int) -> Model:
    return Model(
        model=model._address, data=data._address, qpos=data.qpos, qvel=data.qvel, warmstart=data.qacc_warmstart,
        control=data.ctrl, sensors=data.sensordata, warnings=data.warning.number, robots=robots,
    )  # fmt: skip


MUJOCO: Final = register(
    Source("mujoco", WheelsRun, "robots on magnetic wheels in MuJoCo, with cones of rays", is_ours=True)
)
