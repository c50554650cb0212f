"""One run of robots in MuJoCo: the base class of the runs of both kinds of robot (planar, and on wheels).

MuJoCo's model is what never changes in a run; its data are the state. A run in which MuJoCo warns has failed: from then
on its robots stand (``sensing.freeze``).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import zero_rows
from vibroswarm.core.numbers import stated
from vibroswarm.errors import warn_once
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.physics.arcs import OPEN_SEGMENT
from vibroswarm.motion.physics.arena_xml import TARGETS, WALLS
from vibroswarm.motion.physics.library import calls, mujoco
from vibroswarm.motion.physics.sensing import World
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


class MujocoRun(KernelRun):
    """A run of robots in MuJoCo (``MotionState``). Each kind of robot has a subclass that defines model and steps.

    ``model`` and ``data`` are MuJoCo's; ``world`` holds views of their memory for kernels. ``opened`` holds the open
    segment of each robot (``arcs.OPEN_SEGMENT``): the latest one, which goes on as long as its arc fits.
    """

    step_ms: ClassVar[float]
    """Longest duration of a step of MuJoCo, ms. In a run the step is shortened to divide the control period evenly."""
    bodies: ClassVar[int]
    """Number of MuJoCo's bodies in a robot."""
    cone_rad: ClassVar[tuple[float, ...]] = (0.0,)
    """Directions of the rays of a distance sensor, relative to its axis, rad."""

    def prepare(self) -> None:
        """Compile the model, and allocate MuJoCo's data and the open segments; called once, before ``start``."""
        self.steps = math.ceil(self.tick_ms / self.step_ms)  # MuJoCo's steps per control period
        self.step_s = self.scenario.tick_s / self.steps
        self.compile()
        self.opened = zero_rows(self.scenario.swarm.robots, OPEN_SEGMENT)
        self.connect()

    def compile(self) -> None:
        """Compile the MJCF text of ``xml`` to MuJoCo's model."""
        self.model: Any = mujoco().MjModel.from_xml_string(self.xml())

    def connect(self) -> None:
        """Allocate MuJoCo's data, and make views of its memory for kernels (``sensing.World``)."""
        data = self.data = mujoco().MjData(self.model)
        groups = np.zeros(6, dtype=np.uint8)  # for each of MuJoCo's six groups of geoms, whether rays see it
        groups[[WALLS, TARGETS]] = 1
        self.world = World(
            calls=calls(), model=self.model._address, data=data._address, qpos=data.qpos, qvel=data.qvel,
            force=data.qfrc_applied, warnings=data.warning.number, frozen=np.zeros(1, dtype=np.int64),
            groups=groups, point=np.array([0.0, 0.0, self.ray_height_m()]), direction=np.zeros(3),
            cone_rad=np.array(self.cone_rad), bodies=self.bodies, steps=self.steps, step_s=self.step_s,
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
        reached = self.step_to(until)
        if self.world.frozen[0] and self.failure is None:
            # The latest period, which began at ``reached`` - 1, was undone.
            self.failure = Failure(self.run, reached - 1, self._reason())
            at_s = self.failure.tick * self.scenario.tick_s
            warn_once(f"run {self.run} of seed {self.seed} failed at {stated(at_s)} s: {self.failure.reason}")
        return reached

    def warned(self) -> NDArray[np.int32]:
        """Return the number of MuJoCo's warnings of each kind since the run began."""
        return self.data.warning.number

    def _reason(self) -> str:
        kinds = np.flatnonzero(self.warned())
        return "MuJoCo warned of " + " and ".join(WARNINGS.get(int(kind), f"kind {kind}") for kind in kinds)

    def ray_height_m(self) -> float:
        """Return the height of the distance sensors, m: here that of planar robots; ``WheelsRun`` overrides it."""
        return 0.0

    @abstractmethod
    def xml(self) -> str:
        """Return MuJoCo's model of the scenario as a text in MJCF."""

    @abstractmethod
    def place(self) -> None:
        """Set MuJoCo's state, which has just been reset, to the robots' poses; all velocities are 0."""

    @abstractmethod
    def step_to(self, until: int) -> int:
        """Simulate from ``self.tick`` to the tick ``until``; stop earlier if buffers might overflow or MuJoCo warns.

        Return the tick reached. ``self.tick`` stays as it is: ``go_on_to`` sets it.
        """
