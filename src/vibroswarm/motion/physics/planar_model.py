"""The planar robot in MuJoCo: a disc on two slides and a hinge, pushed by forces within limits.

Between contacts it moves as the kinematic engines' robots do; what it adds are mass, finite forces, and bodies that
push and slide along each other and along walls.

| name | unit | value | |
|---|---|---|---|
| mass | kg | 0.04 | of a robot of 25 x 33 x 35 mm with a battery; assumed |
| push | N | 0.24 | the most that driving wheels push; assumed: they slip beyond |
| grip | N | 0.36 | the most that wheels resist sideways, or braked; assumed |
| twist | N m | push x turn track / 2 | the most that wheels turn |

Contacts of spheres in one plane are those of discs, in closed form. They have no friction. They begin ``MARGIN_M``
before bodies touch, so that a robot at full speed is stopped before it is deep in another.
"""

from __future__ import annotations

from typing import Final

from vibroswarm.motion.physics.arena_xml import BODIES, target_xml, walls_xml
from vibroswarm.scenario.scenario import Scenario

STEP_MS: Final = 10.0
MASS_KG: Final = 0.04
PUSH_N: Final = 0.24
GRIP_N: Final = 0.36
MARGIN_M: Final = 0.0004


def planar_xml(scenario: Scenario, step_s: float) -> str:
    """Return the model of a scenario as MJCF.

    Args:
        step_s: duration of a step of MuJoCo.
    """
    radius_m = scenario.robot.body_radius_m
    spin = 0.5 * MASS_KG * radius_m**2
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
