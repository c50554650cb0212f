"""``mujoco-planar``: robots that are discs with two slide joints and a hinge, moved by forces within limits in MuJoCo.

Between contacts they move as the robots of the event engine and the fixed-step engine do. In addition, robots have mass
and finite forces, push each other, and slide along each other and along walls.

| name | unit | value | |
|---|---|---|---|
| mass | kg | 0.04 | of a robot of 25 x 33 x 35 mm with a battery; assumed |
| push | N | 0.24 | largest force of the driving wheels; assumed: beyond it they slip |
| grip | N | 0.36 | largest force with which wheels resist sideways motion, and motion when braked; assumed |
| twist | N m | push x turn track / 2 | largest torque of the wheels |

Bodies are spheres whose centres are in one plane: their contacts are those of discs, and MuJoCo computes them in closed
form. Contacts have no friction. They act from a distance of ``MARGIN_M`` on, so that a robot at full speed is stopped
before it overlaps another one much.

In a control period, robots sense, control, sample and push. Their program is that of the other engines
(``control_step.control``). It reads MuJoCo's rays and the angle that MuJoCo's body has turned; the speeds that it
commands become forces. Positions, velocities and forces in MuJoCo's arrays have three entries per robot: x, y, heading.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel
from vibroswarm.motion.control_step import Swarm, control
from vibroswarm.motion.fixed_step import sample
from vibroswarm.motion.physics.arcs import fit_period
from vibroswarm.motion.physics.arena_xml import BODIES, target_xml, walls_xml
from vibroswarm.motion.physics.mujoco_run import MujocoRun
from vibroswarm.motion.physics.sensing import World, end_period, has_warned, sense
from vibroswarm.motion.recorder import Record, room
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import STOP
from vibroswarm.scenario.scenario import Scenario

STEP_MS: Final = 10.0
"""Longest duration of a step of MuJoCo, ms."""
MASS_KG: Final = 0.04
"""Mass of a robot."""
PUSH_N: Final = 0.24
"""Largest force of the driving wheels."""
GRIP_N: Final = 0.36
"""Largest force with which wheels resist sideways motion, and motion when braked."""
MARGIN_M: Final = 0.0004
"""Distance between two bodies at which their contact begins to act."""


def planar_xml(scenario: Scenario, step_s: float) -> str:
    """Return MuJoCo's model of a scenario as a text in MJCF.

    MuJoCo's automatic reset after an error is disabled: runs handle MuJoCo's warnings themselves.

    Args:
        step_s: duration of a step of MuJoCo, s; the time constant of contacts is two steps.
    """
    radius_m = scenario.robot.body_radius_m
    spin = 0.5 * MASS_KG * radius_m**2  # moment of inertia of a disc
    # Joints in the order in which ``move_planar`` reads positions: x, y, heading. In the text below, ``memory`` is what
    # MuJoCo may use for contacts, which grows with the swarm; ``solref`` holds the time constant of contacts and their
    # damping ratio; ``solimp`` holds their impedance, which rises from 0.95 to 0.99 within a depth of 0.5 mm.
    body = f"""<body>
      <inertial pos="0 0 0" mass="{MASS_KG}" diaginertia="{spin!r} {spin!r} {spin!r}"/>
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>
      <geom type="sphere" size="{radius_m!r}" group="{BODIES}"/>{target_xml(scenario)}
    </body>"""
    return f"""<mujoco model="planar robots">
  <compiler autolimits="true"/>
  <option timestep="{step_s!r}" gravity="0 0 0" integrator="Euler" cone="elliptic">
    <flag autoreset="disable"/>
  </option>
  <size memory="{max(1, scenario.swarm.robots // 8)}M"/>
  <default><geom condim="1" margin="{MARGIN_M!r}" solref="{2.0 * step_s!r} 1" solimp="0.95 0.99 0.0005"/></default>
  <worldbody>{walls_xml(scenario)}{body * scenario.swarm.robots}</worldbody>
</mujoco>"""


class Planar(NamedTuple):
    """Those values of the module's table that depend on the scenario's robots."""

    spin_kg_m2: float
    """Moment of inertia about the vertical axis."""
    twist_n_m: float
    """Largest torque of the wheels."""


@inner
def within(value: float, limit: float) -> float:
    """Return the value clipped to [-limit, limit]."""
    return min(max(value, -limit), limit)


@inner
def push(world: World, body: Planar, swarm: Swarm) -> None:
    """Set the forces for MuJoCo's next step, within their limits.

    Without limits, they would give each robot its commanded speed and turn rate by the end of the step, and stop its
    sideways motion.
    """
    per_s = 1.0 / world.step_s
    for i in range(swarm.size):
        row = swarm[i]
        aim = world.qpos[3 * i + 2] + 0.5 * row.rate_rad_s * world.step_s  # heading in the middle of the step
        ahead_x, ahead_y = math.cos(aim), math.sin(aim)
        vx, vy = world.qvel[3 * i], world.qvel[3 * i + 1]
        along_m_s, aside_m_s = vx * ahead_x + vy * ahead_y, vy * ahead_x - vx * ahead_y
        most_n = GRIP_N if row.mode == STOP else PUSH_N  # wheels of a standing robot brake
        along_n = within((row.speed_m_s - along_m_s) * MASS_KG * per_s, most_n)
        aside_n = within(-aside_m_s * MASS_KG * per_s, GRIP_N)
        world.force[3 * i] = along_n * ahead_x - aside_n * ahead_y
        world.force[3 * i + 1] = along_n * ahead_y + aside_n * ahead_x
        faster_rad_s = row.rate_rad_s - world.qvel[3 * i + 2]
        world.force[3 * i + 2] = within(faster_rad_s * body.spin_kg_m2 * per_s, body.twist_n_m)


@inner
def move_planar(world: World, body: Planar, swarm: Swarm, setup: Setup) -> None:
    """Let MuJoCo move the robots through one control period.

    Then set their poses, their gyro readings, and the speeds and turn rates that they actually had.
    """
    for _ in range(world.steps):
        push(world, body, swarm)
        world.calls.step(world.model, world.data)
    for i in range(swarm.size):
        row = swarm[i]
        row.from_x_m, row.from_y_m, row.from_heading_rad = row.x_m, row.y_m, row.heading_rad
        row.x_m, row.y_m = world.qpos[3 * i], world.qpos[3 * i + 1]
        row.heading_rad = world.qpos[3 * i + 2]
        row.gyro_deg = math.degrees(row.heading_rad - row.from_heading_rad)
    fit_period(swarm, setup)


@kernel
def planar_steps(
    world: World,
    body: Planar,
    swarm: Swarm,
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    opened: NDArray[np.void],
    seed: int,
    run: int,
    tick: int,
    until: int,
) -> int:
    """Simulate from ``tick`` up to ``until``, or until the buffers of ``record`` might overflow.

    Also stops after a period in which MuJoCo warns: from the beginning of that period on, the robots stand.

    Args:
        speeds: ``robot_params.speed_quantiles``. opened: each robot's open segment (``arcs.OPEN_SEGMENT``), updated.
    Returns: the tick reached.
    """
    until = min(until, tick + room(record, swarm.size))
    for now in range(tick, until):
        sense(world, swarm, setup)
        if control(swarm, setup, seed, run, now) > 0:
            # Record samples before the move: a robot that samples may be pushed in this period, and its sample has the
            # pose at the beginning of the period. (In ``fixed_step.step`` robots that sample stay where they are.)
            sample(swarm, setup, speeds, record, seed, run, now)
        warned = False
        if not world.frozen[0]:
            move_planar(world, body, swarm, setup)
            warned = has_warned(world.warnings)
        end_period(world, warned, swarm, setup, record, opened, run, now)
        if warned:
            return now + 1
    return max(tick, until)  # nothing has been simulated if ``until`` is not after ``tick``


class PlanarRun(MujocoRun):
    """A run of planar robots in MuJoCo (``MotionState``)."""

    step_ms = STEP_MS
    bodies = 1

    def prepare(self) -> None:
        """Compile the model, allocate MuJoCo's data, and set the limits of the forces."""
        super().prepare()
        robot = self.scenario.robot
        self.body = Planar(
            spin_kg_m2=0.5 * MASS_KG * robot.body_radius_m**2,
            # Half of the force at each of two wheels, at half of the track from the robot's centre.
            twist_n_m=0.5 * PUSH_N * robot.turn_track_m,
        )

    def xml(self) -> str:
        """Return MuJoCo's model of the scenario as a text in MJCF."""
        return planar_xml(self.scenario, self.step_s)

    def place(self) -> None:
        """Set MuJoCo's state, which has just been reset, to the robots' poses; all velocities are 0."""
        for k, name in enumerate(("x_m", "y_m", "heading_rad")):
            self.data.qpos[k::3] = self.swarm[name]

    def step_to(self, until: int) -> int:
        """Simulate from ``self.tick`` to the tick ``until``; stop earlier if buffers might overflow or MuJoCo warns.

        Return the tick reached. ``self.tick`` stays as it is: ``go_on_to`` sets it.
        """
        return planar_steps(
            self.world, self.body, self.swarm, self.setup, self.speeds, self.record, self.opened,
            self.seed, self.run, self.tick, until,
        )  # fmt: skip
