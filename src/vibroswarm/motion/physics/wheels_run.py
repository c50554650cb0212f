"""``mujoco``: runs of robots on magnetic wheels in MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.motion.footprint import with_room
from vibroswarm.motion.physics.groups import LARGEST, Model
from vibroswarm.motion.physics.library import mujoco
from vibroswarm.motion.physics.mujoco_run import MujocoRun
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


class WheelsRun(MujocoRun):
    """A run of robots on wheels in MuJoCo (``MotionState``)."""

    step_ms = STEP_MS
    bodies = 1 + len(WHEELS)
    cone_rad = CONE_RAD

    def compile(self) -> None:
        """Compile the models of the whole swarm and of groups of 1, 2, ..., LARGEST robots (``groups``)."""
        super().compile()
        # A swarm of fewer than LARGEST robots has no larger groups. Models for larger groups are never used then, and
        # get as many robots as the swarm has.
        robots = self.scenario.swarm.robots
        self.group_models: list[Any] = [
            mujoco().MjModel.from_xml_string(wheels_xml(self.scenario, self.step_s, min(size, robots)))
            for size in range(1, LARGEST + 1)
        ]

    def connect(self) -> None:
        """Allocate MuJoCo's data of all models, and make views of their memory for kernels."""
        super().connect()
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

    def xml(self) -> str:
        """Return MuJoCo's model of the whole swarm as a text in MJCF."""
        return wheels_xml(self.scenario, self.step_s)

    def ray_height_m(self) -> float:
        """Return the height of the distance sensors, m."""
        return SENSOR_HEIGHT_M

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

    def warned(self) -> NDArray[np.int32]:
        """Return the number of MuJoCo's warnings of each kind since the run began, in all models."""
        return sum((data.warning.number for data in self.group_data), start=super().warned())

    def step_to(self, until: int) -> int:
        """Simulate from ``self.tick`` to the tick ``until``; stop earlier if buffers might overflow or MuJoCo warns.

        Return the tick reached. ``self.tick`` stays as it is: ``go_on_to`` sets it.
        """
        return wheels_steps(
            self.world, self.wheels, self.swarm, self.setup, self.speeds, self.record, self.opened,
            self.seed, self.run, self.tick, until,
        )  # fmt: skip


def _views(model: Any, data: Any, robots: int) -> Model:
    return Model(
        model=model._address, data=data._address, qpos=data.qpos, qvel=data.qvel, warmstart=data.qacc_warmstart,
        control=data.ctrl, sensors=data.sensordata, warnings=data.warning.number, robots=robots,
    )  # fmt: skip
