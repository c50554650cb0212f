"""``mujoco``: runs of robots on magnetic wheels in MuJoCo.

MuJoCo's model is what never changes in a run; its data are the state. A run in which MuJoCo warns has failed: from then
on its robots stand (``sensing.freeze``).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import zero_rows
from vibroswarm.core.numbers import stated
from vibroswarm.errors import warn_once
from vibroswarm.motion.footprint import with_room
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.physics.arcs import OPEN_SEGMENT
from vibroswarm.motion.physics.arena_xml import TARGETS, WALLS
from vibroswarm.motion.physics.groups import LARGEST, Model
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
    WHEELS,
    WIDTH_M,
    wheels_xml,
)
from vibroswarm.motion.physics.wheels_step import Wheels, wheels_steps
from vibroswarm.motion.recorder import Failure

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
    """A run of robots on wheels in MuJoCo (``MotionState``).

    ``model`` and ``data`` are MuJoCo's; ``world`` holds views of their memory for kernels. ``opened`` holds the open
    segment of each robot (``arcs.OPEN_SEGMENT``): the latest one, which goes on as long as its arc fits.
    """

    cone_rad: ClassVar[tuple[float, ...]] = CONE_RAD
    """Directions of the rays of a distance sensor, relative to its axis, rad."""

    def prepare(self) -> None:
        """Compile the models, and allocate MuJoCo's data and the open segments; called once, before ``start``.

        There are models of the whole swarm and of groups of 1, 2, ..., LARGEST robots (``groups``).
        """
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
        self.opened = zero_rows(robots, OPEN_SEGMENT)
        self.connect()

    def connect(self) -> None:
        """Allocate MuJoCo's data of all models, and make views of their memory for kernels."""
        data = self.data = mujoco().MjData(self.model)
        groups = np.zeros(6, dtype=np.uint8)  # for each of MuJoCo's six groups of geoms, whether rays see it
        groups[[WALLS, TARGETS]] = 1
        self.world = World(
            calls=calls(), model=self.model._address, data=data._address, qpos=data.qpos,
            warnings=data.warning.number, frozen=np.zeros(1, dtype=np.int64),
            groups=groups, point=np.array([0.0, 0.0, SENSOR_HEIGHT_M]), direction=np.zeros(3),
            cone_rad=np.array(self.cone_rad), bodies=1 + len(WHEELS), steps=self.steps, step_s=self.step_s,
        )  # fmt: skip
        robots, robot = self.scenario.swarm.robots, self.scenario.robot
        self.group_data: list[Any] = [mujoco().MjData(model) for model in self.group_models]
        one, two, three = (
            _views(model, data, min(size, robots))
            for size, (model, data) in enumerate(zip(self.group_models, self.group_data, strict=True), 1)
        )
        self.reset_groups()  # ``start`` does so again, by ``place``; a copy is not started
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

    def start(self, seed: int, run: int) -> None:
        """Reset this state to time 0 of a run, whatever it was before."""
        super().start(seed, run)
        mujoco().mj_resetData(self.model, self.data)
        self.world.frozen[0] = 0
        self.place()
        # Each robot's open segment: the robot stands from tick 0 on. ``go_on_to`` writes the row of this segment.
        for name in ("x_m", "y_m", "heading_rad"):
            self.opened[name] = self.swarm[name]
        for name in ("tick", "speed_m_s", "rate_rad_s"):
            self.opened[name] = 0
        self.opened["kind"] = self.swarm["mode"]

    def copy(self) -> Self:
        """Return an independent copy of this state, with data of its own in MuJoCo; the model is shared."""
        # ``super().copy()`` copies the robots' rows and the buffers; the branch still shares the open segments,
        # MuJoCo's data and ``world`` with this state.
        module, branch = mujoco(), super().copy()
        branch.opened = self.opened.copy()
        # ``connect`` allocates new data, and a new ``world`` with views of them. Then copy into them what the old hold.
        branch.connect()
        branch.world.frozen[:] = self.world.frozen
        parts = module.mjtState.mjSTATE_INTEGRATION  # all parts of the state on which further steps depend
        state = np.empty(module.mj_stateSize(self.model, parts))
        module.mj_getState(self.model, self.data, state, parts)
        module.mj_setState(self.model, branch.data, state, parts)
        return branch

    def move_on(self, until: int) -> int:
        """Simulate up to the tick ``until``, or until the buffers might overflow; return the tick reached.

        Also stops after a period in which MuJoCo warns: the run has then failed, with a warning to the user.
        """
        reached = wheels_steps(
            self.world, self.wheels, self.swarm, self.setup, self.speeds, self.record, self.opened,
            self.seed, self.run, self.tick, until,
        )  # fmt: skip
        if self.world.frozen[0] and self.failure is None:
            # The latest period, which began at ``reached`` - 1, was undone.
            self.failure = Failure(self.run, reached - 1, self._reason())
            at_s = self.failure.tick * self.scenario.tick_s
            warn_once(f"run {self.run} of seed {self.seed} failed at {stated(at_s)} s: {self.failure.reason}")
        return reached

    def warned(self) -> NDArray[np.int32]:
        """Return the number of MuJoCo's warnings of each kind since the run began, in all models."""
        return sum((data.warning.number for data in self.group_data), start=self.data.warning.number)

    def _reason(self) -> str:
        kinds = np.flatnonzero(self.warned())
        return "MuJoCo warned of " + " and ".join(WARNINGS.get(int(kind), f"kind {kind}") for kind in kinds)

    def place(self) -> None:
        """Set MuJoCo's state, which has just been reset, to the robots' poses, with magnets on and all velocities 0.

        Starts are those of all sources of motion, for discs. Robots whose corners would be in a wall or in each other
        are moved apart.
        """
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
        self.reset_groups()

    def reset_groups(self) -> None:
        """Reset the MuJoCo data of the models of 1, 2 and 3 robots, and switch all magnets on.

        Robots that may touch each other form a group, which is stepped in one of these models (``groups``). Poses,
        velocities and motor commands are copied from the model of the whole swarm whenever a group is stepped, so only
        magnets are set here. The reset also sets the numbers of MuJoCo's warnings to 0.
        """
        for model, data in zip(self.group_models, self.group_data, strict=True):
            mujoco().mj_resetData(model, data)
            data.ctrl[:] = 1.0  # magnets on; the motors' entries are overwritten before each step


def _views(model: Any, data: Any, robots: int) -> Model:
    return Model(
        model=model._address, data=data._address, qpos=data.qpos, qvel=data.qvel, warmstart=data.qacc_warmstart,
        control=data.ctrl, sensors=data.sensordata, warnings=data.warning.number, robots=robots,
    )  # fmt: skip
