"""The robot of the paper in MuJoCo: a chassis on four magnetic wheels, two of them driven, with gyro and accelerometer.

| name | unit | value | |
|---|---|---|---|
| chassis, wheel | kg | 0.032, 0.002 | a robot of 25 x 33 x 35 mm with a battery; assumed |
| wheel base, track | m | BASE_M, TRACK_M | between the points where wheels touch; assumed |
| friction | - | DRIVEN, PASSIVE | on the floor; driven assumed, passive fitted: 0.10 +- 0.05 (robots-and-mujoco.md) |
| adhesion | N | 0.3 | of each magnetic wheel; assumed |
| rotor | kg m^2 | 3e-5 | inertia of a motor behind its gears; assumed: it starts and stops within two periods |

One front and one rear wheel, on opposite sides, are driven, as in the robot of the paper; the others roll freely. The
magnets are MuJoCo's adhesion actuators. Wheels are ellipsoids, so that each touches the floor in one point. The chassis
is a box that touches walls and other chassis with friction. The wheels lie within its outline, so that they touch
nothing but the floor. The size is the paper's, whatever ``robot.body_radius_m`` is.

MuJoCo tests only the pairs of geoms that may touch. Contact between wheels and floor is softer than between bodies: so
robots come to rest, and the solver needs one iteration for a robot that drives straight, not several.

A motor is a velocity servo. It has the inertia of its gears, without which explicit steps of such a stiff servo would
be unstable. Each distance sensor is a cone of CONE_RAYS rays with an opening of CONE_DEG, that of the paper's robots.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroswarm.scenario.scenario import Scenario

BODIES, WALLS, TARGETS = 0, 1, 2
"""Groups of MuJoCo's geoms (shapes). Rays see only walls and targets; a target is the disc that rays see of a robot."""
TARGET_HALF_HEIGHT_M: Final = 0.02
"""Half of the height of the discs that rays see."""


def walls_xml(scenario: Scenario) -> str:
    """Return the geoms of the four walls: planes that face inwards, named wall0 to wall3."""
    arena = scenario.arena
    # In ``size`` below, the two zeros make a plane infinite; 1 is the spacing of its grid in pictures.
    walls = (  # a point of each wall, and its normal, which points into the arena
        ("0 0 0", "1 0 0"),
        (f"{arena.width_m!r} 0 0", "-1 0 0"),
        ("0 0 0", "0 1 0"),
        (f"0 {arena.height_m!r} 0", "0 -1 0"),
    )
    return "".join(
        f'<geom name="wall{k}" type="plane" size="0 0 1" pos="{place}" zaxis="{inwards}" group="{WALLS}"/>'
        for k, (place, inwards) in enumerate(walls)
    )


def target_xml(scenario: Scenario) -> str:
    """Return the geom that rays see of a robot, a disc without mass that touches nothing; empty if its radius is 0."""
    disc_m = scenario.rays.disc_radius_m
    if disc_m <= 0.0:
        return ""
    size = f"{disc_m!r} {TARGET_HALF_HEIGHT_M!r}"
    return f'<geom type="cylinder" size="{size}" group="{TARGETS}" contype="0" conaffinity="0" mass="0"/>'


STEP_MS: Final = 5.0
"""Longest duration of a step of MuJoCo, ms."""
WHEEL_M: Final = 0.006
"""Radius of a wheel."""
ROLLING_M: Final = 0.00586
"""Effective radius of a rolling wheel, as the magnets press it a little into the soft floor. Fitted to the speed."""
HALF_WHEEL_M: Final = 0.002
"""Half of the width of a wheel."""
LENGTH_M, WIDTH_M, HEIGHT_M = 0.033, 0.025, 0.035
"""Size of the robot, with its wheels; the paper does not say which is which (docs/robots-and-mujoco.md)."""
CLEARANCE_M: Final = 0.002
"""Height of the chassis above the floor."""
CORNER_M: Final = math.hypot(LENGTH_M / 2, WIDTH_M / 2)
"""Distance of a robot's corners from its middle."""
BASE_M: Final = LENGTH_M - 2 * WHEEL_M
"""Distance from front to rear between the points in which wheels touch the floor."""
TRACK_M: Final = WIDTH_M - 2 * HALF_WHEEL_M
"""Distance from left to right between the points in which wheels touch the floor."""
DRIVEN: Final = 0.8
"""Coefficient of friction on the floor, of driven wheels."""
PASSIVE: Final = 0.1
"""Coefficient of friction on the floor, of wheels that roll freely."""
SIDES: Final = 0.3
"""Coefficient of friction of chassis on walls and on each other; assumed."""
IMPRATIO: Final = 1.0
"""MuJoCo's ratio of the impedance of friction to that of normal forces."""
ADHESION_N: Final = 0.3
"""Force with which the magnet of a wheel pulls the wheel to the floor."""
ROTOR_KG_M2: Final = 3e-5
"""Inertia of a motor behind its gears."""
SERVO_N_M_S: Final = 3e-3
"""Torque of a motor per difference (1 rad/s) between its target speed and its speed."""
TORQUE_N_M: Final = 0.01
"""Largest torque of a motor."""
MARGIN_M: Final = 0.0004
"""Distance between two bodies at which their contact begins to act."""
FLOOR_STEPS: Final = 4.0
"""Time constant of contacts with the floor, in steps. Wheels would never come to rest on a floor as stiff as walls."""
BODY_STEPS: Final = 2.0
"""Time constant of contacts between bodies, in steps."""
SENSOR_HEIGHT_M: Final = 0.012
"""Height of the sensors above the floor."""
TOLERANCE: Final = 1e-4
"""Tolerance of the solver (Newton's method). After 30 s, positions differ by 4 micrometres from those with 1e-12; with
1e-3 they differ by 1.7 mm."""
SUNK_M: Final = 0.00026
"""Depth to which wheels sink into the floor at rest, m."""
CONE_DEG: Final = 27.0
CONE_RAYS: Final = 5
"""Opening of the cone of a distance sensor, and the number of rays in it."""
CONE_RAD: Final = tuple(math.radians(a) for a in np.linspace(-CONE_DEG / 2, CONE_DEG / 2, CONE_RAYS).tolist())
"""Directions of the rays of a distance sensor, relative to its axis."""

WHEELS: Final = (("front_left", 1, 1, True), ("rear_right", -1, -1, True), ("front_right", 1, -1, False),
                 ("rear_left", -1, 1, False))  # fmt: skip
"""Each wheel's name, signs of its x and y in the robot's frame, and whether it is driven. The left driven wheel is
first, then the right one: the order of a robot's motors."""


def wheels_xml(scenario: Scenario, step_s: float, group: int | None = None) -> str:
    """Return MuJoCo's model, in MJCF, of a scenario or of a ``group`` of robots, without what it does not need."""
    robots = scenario.swarm.robots if group is None else group
    accelerometer = '<accelerometer site="imu{0}"/>' if group is None else ""
    # "Islands" make MuJoCo solve the contacts of bodies that do not touch each other separately.
    islands = "disable" if robots == 1 else "enable"
    # Each robot's controls: two motors, then four magnets. Its sensors begin with the gyro. In the text below,
    # ``memory`` is what MuJoCo may use for contacts, in MiB; it grows with the number of robots. ``contype`` and
    # ``conaffinity`` of 0 mean that geoms touch only in the pairs of ``_contacts``. ``solimp`` is the impedance of
    # contacts, which rises from 0.95 to 0.99 within a depth of 0.5 mm.
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
    <default class="wheel"><geom type="ellipsoid" size="{WHEEL_M} {HALF_WHEEL_M} {WHEEL_M}" mass="0.002"/></default>
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
    """Return MJCF of the pairs of geoms that may touch: wheels and floor, chassis and walls, two chassis."""
    # condim 3: contacts with friction, whose first two coefficients are those of sliding. solref: time constant of a
    # contact, s, and its damping ratio.
    floor = f'condim="3" solref="{FLOOR_STEPS * step_s!r} 1"'
    sides = f'friction="{SIDES} {SIDES} 0 0 0"'
    others = f'condim="3" {sides} margin="{MARGIN_M}" solref="{BODY_STEPS * step_s!r} 1"'
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
    """Return the four walls and the chassis of lower numbers, so that each pair of chassis is listed once."""
    return [f"wall{k}" for k in range(4)] + [f"chassis{j}" for j in range(i)]


def _robot(scenario: Scenario, i: int) -> str:
    """Return MJCF of robot ``i``: chassis, target of other robots' rays, inertial sensors and wheels."""
    wheels = "".join(
        f"""<body pos="{x * BASE_M / 2} {y * TRACK_M / 2} {WHEEL_M}" name="{name}{i}">
          <joint name="{name}{i}" type="hinge" axis="0 1 0" armature="{ROTOR_KG_M2 if driven else 1e-7}"/>
          <geom name="{name}{i}" class="wheel" group="{BODIES}"/></body>"""
        for name, x, y, driven in WHEELS
    )
    # The origin of a robot's frame is on the floor below its centre; the centre of mass of the chassis is 10 mm higher.
    # The moments of inertia are those of a box. The armature, the inertia of a motor behind its
    # gears, is almost 0 for wheels that roll freely. MuJoCo wants half of the sizes.
    squares = np.array([LENGTH_M, WIDTH_M, HEIGHT_M]) ** 2
    spins = " ".join(map(str, (0.032 / 12 * (squares.sum() - squares)).tolist()))
    half_m = (HEIGHT_M - CLEARANCE_M) / 2
    return f"""<body><freejoint/>
      <inertial pos="0 0 0.01" mass="0.032" diaginertia="{spins}"/>
      <site name="imu{i}" pos="0 0 {SENSOR_HEIGHT_M}"/>
      <geom name="chassis{i}" type="box" size="{LENGTH_M / 2} {WIDTH_M / 2} {half_m}"
        pos="0 0 {CLEARANCE_M + half_m}" group="{BODIES}"/>
      {target_xml(scenario)}{wheels}
    </body>"""
