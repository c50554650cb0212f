"""``mujoco-planar``: runs of planar robots in MuJoCo."""

from __future__ import annotations

from vibroswarm.motion.physics.mujoco_run import MujocoRun
from vibroswarm.motion.physics.planar_model import GRIP_N, MASS_KG, PUSH_N, STEP_MS, planar_xml
from vibroswarm.motion.physics.planar_step import Planar, planar_steps


class PlanarRun(MujocoRun):
    """A run of planar robots in MuJoCo (``MotionState``)."""

    step_ms = STEP_MS
    bodies = 1

    def prepare(self) -> None:
        """Compile the model."""
        super().prepare()
        robot = self.scenario.robot
        self.body = Planar(
            mass_kg=MASS_KG,
            spin_kg_m2=0.5 * MASS_KG * robot.body_radius_m**2,
            push_n=PUSH_N,
            grip_n=GRIP_N,
            twist_n_m=0.5 * PUSH_N * robot.turn_track_m,
        )

    def xml(self) -> str:
        """Return the model as MJCF."""
        return planar_xml(self.scenario, self.step_s)

    def place(self) -> None:
        """Set MuJoCo's state to the robots' poses, at rest."""
        for k, name in enumerate(("x_m", "y_m", "heading_rad")):
            self.data.qpos[k::3] = self.swarm[name]

    def step_to(self, until: int) -> int:
        """Simulate up to the tick ``until``, while the buffers suffice and MuJoCo does not warn; return the tick."""
        return planar_steps(
            self.world, self.body, self.swarm, self.setup, self.speeds, self.record, self.opened,
            self.seed, self.run, self.tick, until,
        )  # fmt: skip
