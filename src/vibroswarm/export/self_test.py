"""What a robot must do in its test of itself at the start (``assets/vibroswarm_self_test.c``).

The same short inspection, with invented readings, is done here by the plain program and there by the robot; then both
must have the same counts and belief. It finds compilers, flags and copies of the program that are not what they
seem to be. It stays away from boundaries at which the last bits would decide: float must pass it too.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vibroswarm.export.assembly import RobotParts
from vibroswarm.export.parameters import c_number
from vibroswarm.export.plain_program import plain_program
from vibroswarm.robot.walk import AVOID, STOP, TURN

SAMPLES: Final = 8
"""Number of samples after which the test ends."""
MOST_TICKS: Final = 6000
"""Number of control periods after which it ends without them."""
COUNTS: Final = ("decision", "samples", "sent", "heard", "timers")
"""Members of the robot that must be equal."""


def self_test_macros(parts: RobotParts) -> dict[str, str]:
    """Return what a robot must have at the end of its test, as texts in C by the names of macros.

    Raises:
        InputError: a number is nan where none can be.
    """
    robot = inspected(parts)
    walk = {name: getattr(robot.walk, name) for name in ("mode", "legs", "avoidances")}
    found = {"ticks": robot.tick, **walk, **{name: getattr(robot, name) for name in COUNTS}}
    found["belief"] = "VS_NAN" if math.isnan(robot.belief) else c_number(float(robot.belief), "belief")
    return {f"EXPECTED_{name.upper()}": str(value) for name, value in found.items()}


def inspected(parts: RobotParts) -> Any:
    """Return a robot of the plain program at the end of the test."""
    program, world = plain_program(parts), parts.world
    robot = program.Robot()
    program.start(robot, 1, 0, 0)
    while robot.samples < SAMPLES and robot.tick < MOST_TICKS:
        turns = robot.walk.mode in (TURN, AVOID)
        gyro_deg = max(min(robot.walk.error_deg, 2.0), -2.0) if turns else 0.0
        ray_mm = 20.0 if robot.tick % 128 == 127 else 1000.0
        samples = program.step(robot, gyro_deg, ray_mm)
        if robot.walk.mode == STOP:
            # Every second sample is of an energy of about twice the threshold, the others of 0.
            shakes = robot.tick % 2 * (robot.samples % 2)
            program.accelerate(robot, 0.0, 0.0, parts.rms_threshold * (8.0 + 4.0 * shakes))
        if samples:
            own = robot.samples % parts.scenario.sensor.readings
            program.sample(robot, own if parts.has_own_sensor else program.observed(robot))
        while robot.jobs:
            program.work(robot)
            if robot.sends and world.robots > 1:
                program.receive(robot, 1, robot.sent - 1, robot.out)
    return robot
