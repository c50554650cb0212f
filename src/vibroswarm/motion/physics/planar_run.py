"""``mujoco-planar``: runs of planar robots in MuJoCo."""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import zero_rows
from vibroswarm.errors import RunError
from vibroswarm.motion.control_step import ROBOT
from vibroswarm.motion.kernel_run import KernelRun, no_sample_before_steps
from vibroswarm.motion.physics.arcs import OPEN_SEGMENT
from vibroswarm.motion.physics.library import calls, mujoco
from vibroswarm.motion.physics.planar_model import (
    GRIP_N,
    MASS_KG,
    PUSH_N,
    STEP_MS,
    TARGETS,
    WALLS,
    planar_xml,
)
from vibroswarm.motion.physics.planar_step import Planar, planar_steps
from vibroswarm.motion.recorder import end_rows


class PlanarRun(KernelRun):
    """A run of planar robots in MuJoCo (``MotionState``)."""

    fields = ROBOT

    def prepare(self) -> None:
        """Compile the model."""
        module, scenario = mujoco(), self.scenario
        self.steps = math.ceil(self.tick_ms / STEP_MS)
        self.step_s = scenario.tick_s / self.steps
        self.model: Any = module.MjModel.from_xml_string(planar_xml(scenario, self.step_s))
        self.opened = zero_rows(scenario.swarm.robots, OPEN_SEGMENT)
        self.connect()

    def connect(self) -> None:
        """Make MuJoCo's data, and views of it for kernels."""
        self.data: Any = mujoco().MjData(self.model)
        groups = np.zeros(6, dtype=np.uint8)
        groups[[WALLS, TARGETS]] = 1
        data, robot = self.data, self.scenario.robot
        self.planar = Planar(
            calls=calls(), model=self.model._address, data=data._address, qpos=data.qpos, qvel=data.qvel,
            force=data.qfrc_applied, warnings=data.warning.number, groups=groups, point=np.zeros(3),
            direction=np.zeros(3), steps=self.steps, step_s=self.step_s, mass_kg=MASS_KG,
            spin_kg_m2=0.5 * MASS_KG * robot.body_radius_m**2, push_n=PUSH_N, grip_n=GRIP_N,
            twist_n_m=0.5 * PUSH_N * robot.turn_track_m,
        )  # fmt: skip

    def start(self, seed: int, run: int) -> None:
        """Set time 0 of a run, whatever the state was before."""
        super().start(seed, run)
        mujoco().mj_resetData(self.model, self.data)
        for k, name in enumerate(("x_m", "y_m", "heading_rad")):
            self.data.qpos[k::3] = self.swarm[name]
            self.opened[name] = self.swarm[name]
        for name in ("tick", "speed_m_s", "rate_rad_s"):
            self.opened[name] = 0
        self.opened["kind"] = self.swarm["mode"]

    def copy(self) -> Self:
        """Return an independent copy of this state."""
        module, branch = mujoco(), super().copy()
        every = module.mjtState.mjSTATE_INTEGRATION
        state = np.empty(module.mj_stateSize(self.model, every))
        module.mj_getState(self.model, self.data, state, every)
        branch.opened = self.opened.copy()
        branch.connect()
        module.mj_setState(self.model, branch.data, state, every)
        return branch

    def move_on(self, until: int) -> int:
        """Simulate up to the tick ``until``, or for as long as the buffers suffice; return the tick reached."""
        reached = planar_steps(
            self.planar, self.swarm, self.setup, self.speeds, self.record, self.opened,
            self.seed, self.run, self.tick, until,
        )  # fmt: skip
        if self.data.warning.number.any():
            raise RunError(f"MuJoCo warned in run {self.run}")
        return reached

    def no_sample_before(self) -> int:
        """Return a tick, ``tick`` or later, before which no robot samples."""
        return no_sample_before_steps(self.swarm, self.setup, self.tick)

    def ends(self) -> NDArray[np.void]:
        """Return the robots' current poses: ``END_ROW``."""
        return end_rows(self.swarm, self.run, self.tick)

    def headings(self) -> NDArray[np.float64]:
        """Return the robots' current headings, rad, not wrapped."""
        return self.swarm["heading_rad"].copy()
