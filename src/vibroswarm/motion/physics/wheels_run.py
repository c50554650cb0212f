"""``mujoco``: runs of robots on magnetic wheels in MuJoCo."""

from __future__ import annotations

import numpy as np

from vibroswarm.motion.physics.mujoco_run import MujocoRun
from vibroswarm.motion.physics.wheels_model import (
    CONE_RAD,
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

    def prepare(self) -> None:
        """Compile the model."""
        super().prepare()
        model, robots = self.model, self.scenario.swarm.robots
        self.wheels = Wheels(ROLLING_M, model.nq // robots, model.nu // robots, model.nsensordata // robots)

    def xml(self) -> str:
        """Return the model as MJCF."""
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

    def step_to(self, until: int) -> int:
        """Simulate up to the tick ``until``, while the buffers suffice and MuJoCo does not warn; return the tick."""
        return wheels_steps(
            self.world, self.wheels, self.swarm, self.setup, self.speeds, self.record, self.opened,
            self.seed, self.run, self.tick, until,
        )  # fmt: skip
