"""One run of robots in MuJoCo: model, data, state in and state out; what its kinds of robot share."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import zero_rows
from vibroswarm.errors import warn_once
from vibroswarm.motion.control_step import ROBOT
from vibroswarm.motion.kernel_run import KernelRun, no_sample_before_steps
from vibroswarm.motion.physics.arcs import OPEN_SEGMENT
from vibroswarm.motion.physics.arena_xml import TARGETS, WALLS
from vibroswarm.motion.physics.library import calls, mujoco
from vibroswarm.motion.physics.sensing import World
from vibroswarm.motion.recorder import Failure, end_rows

WARNINGS: Final = {
    0: "a singular inertia",
    1: "too many contacts",
    2: "too many constraints",
    3: "positions that are not finite",
    4: "velocities that are not finite",
    5: "accelerations that are not finite",
    6: "controls that are not finite",
}
"""Kinds of MuJoCo's warnings (``mjtWarning``)."""


class MujocoRun(KernelRun):
    """A run of robots in MuJoCo (``MotionState``). A kind of robot gives the model and how it is stepped."""

    fields = ROBOT
    step_ms: ClassVar[float]
    """Longest step of MuJoCo; that of a run divides the control period."""
    bodies: ClassVar[int]
    """Bodies of a robot."""
    cone_rad: ClassVar[tuple[float, ...]] = (0.0,)
    """Directions of the rays of a distance sensor about its axis, rad."""

    def prepare(self) -> None:
        """Compile the model, and make MuJoCo's data."""
        self.steps = math.ceil(self.tick_ms / self.step_ms)
        self.step_s = self.scenario.tick_s / self.steps
        self.compile()
        self.opened = zero_rows(self.scenario.swarm.robots, OPEN_SEGMENT)
        self.connect()

    def compile(self) -> None:
        """Compile the model."""
        self.model: Any = mujoco().MjModel.from_xml_string(self.xml())

    def connect(self) -> None:
        """Make MuJoCo's data, and views of it for kernels."""
        data = self.data = mujoco().MjData(self.model)
        groups = np.zeros(6, dtype=np.uint8)
        groups[[WALLS, TARGETS]] = 1
        self.world = World(
            calls=calls(), model=self.model._address, data=data._address, qpos=data.qpos, qvel=data.qvel,
            force=data.qfrc_applied, warnings=data.warning.number, frozen=np.zeros(1, dtype=np.int64),
            groups=groups, point=np.array([0.0, 0.0, self.ray_height_m()]), direction=np.zeros(3),
            cone_rad=np.array(self.cone_rad), bodies=self.bodies, steps=self.steps, step_s=self.step_s,
        )  # fmt: skip

    def start(self, seed: int, run: int) -> None:
        """Set time 0 of a run, whatever the state was before."""
        super().start(seed, run)
        mujoco().mj_resetData(self.model, self.data)
        self.world.frozen[0] = 0
        self.place()
        for name in ("x_m", "y_m", "heading_rad"):
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
        branch.world.frozen[:] = self.world.frozen
        module.mj_setState(self.model, branch.data, state, every)
        return branch

    def move_on(self, until: int) -> int:
        """Simulate up to the tick ``until``, or for as long as the buffers suffice; return the tick reached."""
        reached = self.step_to(until)
        if self.world.frozen[0] and self.failure is None:
            self.failure = Failure(self.run, reached - 1, self._reason())
            at_s = self.failure.tick * self.scenario.tick_s
            warn_once(f"run {self.run} of seed {self.seed} failed at {at_s:g} s: {self.failure.reason}")
        return reached

    def warned(self) -> NDArray[np.int32]:
        """Return how often MuJoCo has warned, by kind."""
        return self.data.warning.number

    def _reason(self) -> str:
        """Return what MuJoCo has warned of, in words."""
        kinds = np.flatnonzero(self.warned())
        return "MuJoCo warned of " + " and ".join(WARNINGS.get(int(kind), f"kind {kind}") for kind in kinds)

    def no_sample_before(self) -> int:
        """Return a tick, ``tick`` or later, before which no robot samples."""
        return no_sample_before_steps(self.swarm, self.setup, self.tick)

    def ends(self) -> NDArray[np.void]:
        """Return the robots' current poses: ``END_ROW``."""
        return end_rows(self.swarm, self.run, self.tick)

    def headings(self) -> NDArray[np.float64]:
        """Return the robots' current headings, rad, not wrapped."""
        return self.swarm["heading_rad"].copy()

    def ray_height_m(self) -> float:
        """Return the height of the distance sensors, m."""
        return 0.0

    @abstractmethod
    def xml(self) -> str:
        """Return the model as MJCF."""

    @abstractmethod
    def place(self) -> None:
        """Set MuJoCo's state to the robots' poses, at rest."""

    @abstractmethod
    def step_to(self, until: int) -> int:
        """Simulate up to the tick ``until``, while the buffers suffice and MuJoCo does not warn; return the tick."""
