"""Steering: advancing from sample to sample, and changing what a robot does after its own sample.

Other robots look ahead on a standing robot only to the end of its stop; its next plan is made when the stop is
over. So what it resumes may be changed while it stands, and nothing else needs to know.
"""

from __future__ import annotations

import math

from vibroswarm.core.jit import inlined, kernel
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.motion.control_step import Swarm, load, store
from vibroswarm.motion.event.trajectory import Planners, ticks_to_sample
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import STOP, steered

MAX_TURN_DEG = 3600.0
MAX_DRIVE_MS = 1e9
ROUNDING_TICKS = 1e-6


@kernel
def steer_robot(swarm: Swarm, i: int, turn_deg: float, drive_ms: float) -> bool:
    """Apply ``robot.walk.steered`` to robot ``i``; return False if it has not just sampled."""
    row = swarm[i]
    if row.mode != STOP or row.sampled == 0 or row.samples == 0:
        return False
    store(swarm, i, steered(load(swarm, i), turn_deg, drive_ms))
    return True


def check_steering(robots: int, robot: int, turn_deg: float, drive_ms: float) -> int:
    """Return the robot's number, if the arguments are valid.

    Raises:
        InputError: no such robot, or an angle or a duration that no robot can turn or drive.
    """
    robot = whole_number_of(robot, "robot", 0, robots - 1)
    if not (math.isnan(turn_deg) or abs(turn_deg) <= MAX_TURN_DEG):
        raise InputError(
            f"{turn_deg!r} is not an angle from -{MAX_TURN_DEG:g} to {MAX_TURN_DEG:g} deg, or nan",
            field="turn_deg",
        )
    if not (math.isnan(drive_ms) or 0.0 <= drive_ms <= MAX_DRIVE_MS):
        raise InputError(
            f"{drive_ms!r} is not a duration from 0 to {MAX_DRIVE_MS:g} ms, or nan", field="drive_ms"
        )
    return robot


@inlined
def no_sample_before(swarm: Swarm, i: int, setup: Setup, latest: int, now: int) -> int:
    """Return a tick, ``now`` or later, before which robot ``i``, whose row is of tick ``latest``, does not sample."""
    row = swarm[i]
    if row.mode == STOP and row.sampled == 0:
        return max(now, latest + ticks_to_sample(setup, row.stopped_ms))
    # The timer runs at most all the time, from 0 after a sample.
    timer_ms = 0 if row.mode == STOP else row.timer_ms
    left = (setup.sample_interval_ms - timer_ms) / setup.tick_ms - ROUNDING_TICKS
    stops = latest + (2 + int(left) if left > 0.0 else 1)
    return max(now, stops) + ticks_to_sample(setup, 0)


@kernel
def no_sample_before_steps(swarm: Swarm, setup: Setup, now: int) -> int:
    """Return a tick before which nobody samples, for robots stepped up to tick ``now``."""
    earliest = no_sample_before(swarm, 0, setup, now - 1, now)
    for i in range(1, swarm.size):
        earliest = min(earliest, no_sample_before(swarm, i, setup, now - 1, now))
    return earliest


@kernel
def no_sample_before_plans(planners: Planners, setup: Setup, now: int) -> int:
    """Return the same as ``no_sample_before_steps``, for robots that have plans."""
    earliest = no_sample_before(planners, 0, setup, planners[0].tick, now)
    for i in range(1, planners.size):
        earliest = min(earliest, no_sample_before(planners, i, setup, planners[i].tick, now))
    return earliest
