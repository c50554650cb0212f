"""The study's robot in MuJoCo: a chassis on four magnetic wheels, two of them driven, with gyro and accelerometer.

| name | unit | value | |
|---|---|---|---|
| chassis, wheel | kg | 0.032, 0.002 | a robot of 25 x 33 x 35 mm with a battery; assumed |
| wheel base, track | m | BASE_M, TRACK_M | between the points where wheels touch; assumed |
| friction | - | DRIVEN, PASSIVE | on the floor; driven assumed, passive fitted: 0.59 +- 0.19 (docs/mujoco.md) |
| adhesion | N | 0.3 | of each magnetic wheel; assumed |
| rotor | kg m^2 | 3e-5 | inertia of a motor behind its gears; assumed: it starts and stops within two periods |

One front and one rear wheel are driven, on opposite sides, as in the study's robot; the others roll freely. Magnets are
adhesion actuators. Wheels are balls to the floor, which touch it in one point. Chassis and walls touch at the height
of the axles, without friction.

Only the pairs that may touch are tested. Contact of wheels and floor is softer than that of bodies: robots come to rest
on it, and the solver needs one iteration for a robot that drives straight, not several.

A motor is a servo of velocity. It has the inertia of its gears, as explicit steps of a stiff servo are stable only so.
Each distance sensor is a cone of CONE_DEG (the study's robots: 27 degrees) of CONE_RAYS rays.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroswarm.motion.physics.arena_xml import BODIES, target_xml, walls_xml
from vibroswarm.scenario.scenario import Scenario

STEP_MS: Final = 5.0
WHEEL_M: Final = 0.006
ROLLING_M: Final = 0.00586
"""Radius on which wheels roll: the magnets press them a little into the soft floor. Fitted to the speed."""
BASE_M: Final = 0.018
TRACK_M: Final = 0.036
DRIVEN: Final = 0.8
PASSIVE: Final = 0.6
IMPRATIO: Final = 1.0
ADHESION_N: Final = 0.3
ROTOR_KG_M2: Final = 3e-5
SERVO_N_M_S: Final = 3e-3
TORQUE_N_M: Final = 0.01
MARGIN_M: Final = 0.0004
FLOOR_STEPS: Final = 4.0
BODY_STEPS: Final = 2.0
"""Time constants of contacts, in steps. Wheels on a floor as stiff as walls would never come to rest."""
SENSOR_HEIGHT_M: Final = 0.012
TOLERANCE: Final = 1e-4
"""Of the solver (Newton's method). After 30 s a robot is 4 micrometres from where 1e-12 leads, and 1.7 mm with 1e-3."""
SUNK_M: Final = 0.00026
"""How deep wheels stand in the floor at rest."""
CONE_DEG: Final = 27.0
CONE_RAYS: Final = 5
CONE_RAD: Final = tuple(math.radians(a) for a in np.linspace(-CONE_DEG / 2, CONE_DEG / 2, CONE_RAYS).tolist())

WHEELS: Final = (("front_left", 1, 1, True), ("rear_right", -1, -1, True), ("front_right", 1, -1, False),
                 ("rear_left", -1, 1, False))  # fmt: skip
"""Name, signs of x and y, whether driven; the left of the driven ones first."""


def wheels_xml(scenario: Scenario, step_s: float, group: int | None = None) -> str:
    """Return the model of a scenario as MJCF.

    Args:
        step_s: duration of a step of MuJoCo.
        group: robots, if not all of the swarm; without accelerometers, which the robots' program does not read.
    """
    robots = scenario.swarm.robots if group is None else group
    accelerometer = '<accelerometer site="imu{0}"/>' if group is None else ""
    islands = "disable" if robots == 1 else "enable"
    actuators, sensors = [], []
    for i in range(robots):
        actuators += [
            f'<velocity joint="{name}{i}" kv="{SERVO_N_M_S}" forcerange="-{TORQUE_N_M} {TORQUE_N_M}"/>'
            for name, _, _, driven in WHEELS
            if driven
        ]
        actuators += [
            f'<adhesion body="{name}{i}" ctrlrange="0 1" gain="{ADHESION_N}"/>' for name, *_ in WHEELS
        ]
        sensors += [f'<gyro site="imu{i}"/>{accelerometer.format(i)}']
    return f"""<mujoco model="robots on magnetic wheels">
  <compiler autolimits="true"/>
  <option timestep="{step_s!r}" integrator="Euler" cone="elliptic" impratio="{IMPRATIO}" tolerance="{TOLERANCE}">
    <flag autoreset="disable" eulerdamp="disable" midphase="disable" spring="disable" damper="disable"
      island="{islands}"/>
  </option>
  <size memory="{max(2, robots)}M"/>
  <default>
    <geom contype="0" conaffinity="0"/>
    <pair solimp="0.95 0.99 0.0005"/>
    <default class="wheel"><geom type="sphere" size="{WHEEL_M}" mass="0.002"/></default>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" group="{BODIES}"/>
    {walls_xml(scenario)}{"".join(_robot(scenario, i) for i in range(robots))}
  </worldbody>
  <contact>{_contacts(robots, step_s)}</contact>
  <actuator>{"".join(actuators)}</actuator>
  <sensor>{"".join(sensors)}</sensor>
</mujoco>"""


def _contacts(robots: int, step_s: float) -> str:
    """Return the pairs of geoms that may touch: wheels and floor, chassis and walls, chassis and chassis."""
    floor = f'condim="3" solref="{FLOOR_STEPS * step_s!r} 1"'
    others = f'condim="1" margin="{MARGIN_M}" solref="{BODY_STEPS * step_s!r} 1"'
    pairs = []
    for i in range(robots):
        for name, _, _, driven in WHEELS:
            friction = DRIVEN if driven else PASSIVE
            pairs.append(
                f'<pair geom1="floor" geom2="{name}{i}" friction="{friction} {friction} 0 0 0" {floor}/>'
            )
        pairs += [f'<pair geom1="{other}" geom2="chassis{i}" {others}/>' for other in _others(i)]
    return "".join(pairs)


def _others(i: int) -> list[str]:
    """Return what the chassis of robot ``i`` may touch, other than those of robots after it."""
    return [f"wall{k}" for k in range(4)] + [f"chassis{j}" for j in range(i)]


def _robot(scenario: Scenario, i: int) -> str:
    """Return one robot."""
    radius_m = scenario.robot.body_radius_m
    wheels = "".join(
        f"""<body pos="{x * BASE_M / 2} {y * TRACK_M / 2} {WHEEL_M}" name="{name}{i}">
          <joint name="{name}{i}" type="hinge" axis="0 1 0" armature="{ROTOR_KG_M2 if driven else 1e-7}"/>
          <geom name="{name}{i}" class="wheel" group="{BODIES}"/></body>"""
        for name, x, y, driven in WHEELS
    )
    spin = 0.5 * 0.032 * 0.015**2
    return f"""<body><freejoint/>
      <inertial pos="0 0 0.01" mass="0.032" diaginertia="{spin!r} {spin!r} {spin!r}"/>
      <site name="imu{i}" pos="0 0 {SENSOR_HEIGHT_M}"/>
      <geom name="chassis{i}" type="sphere" size="{radius_m!r}" pos="0 0 {WHEEL_M}" group="{BODIES}"/>
      {target_xml(scenario)}{wheels}
    </body>"""
