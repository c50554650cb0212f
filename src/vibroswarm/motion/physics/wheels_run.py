"""``mujoco``: runs of robots on magnetic wheels in MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.motion.physics.groups import LARGEST, Model
from vibroswarm.motion.physics.library import mujoco
from vibroswarm.motion.physics.mujoco_run import MujocoRun
from vibroswarm.motion.physics.wheels_model import (
    CONE_RAD,
    MARGIN_M,
    ROLLING_M,
    SENSOR_HEIGHT_M,
    STEP_MS,
    SUNK_M,
    WHEELS,
    wheels_xml,
)
from vibroswarm.motion.physics.wheels_step import Wheels, wheels_steps


class WheelsRun(MujocoRun):
    """A run of robots on wheels in MuJoCo (``MotionState``)."""

    step_ms = STEP_MS
    bodies = 1 + len(WHEELS)
    cone_rad = CONE_RAD

    def compile(self) -> None:
        """Compile the models: of all robots, and of groups."""
        super().compile()
        robots = self.scenario.swarm.robots
        self.group_models: list[Any] = [
            mujoco().MjModel.from_xml_string(wheels_xml(self.scenario, self.step_s, min(size, robots)))
            for size in range(1, LARGEST + 1)
        ]

    def connect(self) -> None:
        """Make MuJoCo's data, of all robots and of groups, and views of them for kernels."""
        super().connect()
        robots, robot = self.scenario.swarm.robots, self.scenario.robot
        self.group_data: list[Any] = [mujoco().MjData(model) for model in self.group_models]
        one, two, three = (
            _views(model, data, min(size, robots))
            for size, (model, data) in enumerate(zip(self.group_models, self.group_data, strict=True), 1)
        )
        self.reset_groups()
        factor = max(float(self.speeds.max()), robot.speed_factor_max)
        step_m = factor * robot.full_speed_m_s * self.scenario.tick_s
        self.wheels = Wheels(
            rolling_m=ROLLING_M, gap_m=2.0 * robot.body_radius_m + MARGIN_M + 4.0 * step_m,
            first=np.zeros(robots, dtype=np.int64), members=np.zeros(robots, dtype=np.int64),
            all=_views(self.model, self.data, robots), groups=(one, two, three),
        )  # fmt: skip

    def xml(self) -> str:
        """Return the model of all robots as MJCF."""
        return wheels_xml(self.scenario, self.step_s)

    def ray_height_m(self) -> float:
        """Return the height of the distance sensors, m."""
        return SENSOR_HEIGHT_M

    def place(self) -> None:
        """Set MuJoCo's state to the robots' poses, at rest, with their magnets on."""
        robots = self.scenario.swarm.robots
        poses, magnets = (values.reshape(robots, -1) for values in (self.data.qpos, self.data.ctrl))
        poses[:] = 0.0
        poses[:, 0], poses[:, 1], poses[:, 2] = self.swarm["x_m"], self.swarm["y_m"], -SUNK_M
        half_rad = 0.5 * self.swarm["heading_rad"]
        poses[:, 3], poses[:, 6] = np.cos(half_rad), np.sin(half_rad)
        magnets[:, 2:] = 1.0
        self.reset_groups()

    def reset_groups(self) -> None:
        """Switch the magnets of groups on, and forget warnings; poses are copied when they are stepped."""
        for model, data in zip(self.group_models, self.group_data, strict=True):
            mujoco().mj_resetData(model, data)
            data.ctrl[:] = 1.0

    def warned(self) -> NDArray[np.int32]:
        """Return how often MuJoCo has warned, of all robots and of groups, by kind."""
        return sum((data.warning.number for data in self.group_data), start=super().warned())

    def step_to(self, until: int) -> int:
        """Simulate up to the tick ``until``, while the buffers suffice and MuJoCo does not warn; return the tick."""
        return wheels_steps(
            self.world, self.wheels, self.swarm, self.setup, self.speeds, self.record, self.opened,
            self.seed, self.run, self.tick, until,
        )  # fmt: skip


def _views(model: Any, data: Any, robots: int) -> Model:
    """Return MuJoCo's model and data of some robots as kernels see them."""
    return Model(
        model=model._address, data=data._address, qpos=data.qpos, qvel=data.qvel, warmstart=data.qacc_warmstart,
        control=data.ctrl, sensors=data.sensordata, warnings=data.warning.number, robots=robots,
    )  # fmt: skip
