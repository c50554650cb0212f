"""Looking ahead on robots whose move is blocked: for how long it stays so (see ``lookahead``)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner
from vibroswarm.motion.event.lookahead import (
    ROUNDING_M,
    SIDE_TICKS,
    distance2_m2,
    maybe_within,
    wall_clearance_m,
)
from vibroswarm.motion.event.neighbours import neighbour, neighbour_count
from vibroswarm.motion.event.trajectory import (
    Planner,
    Planners,
    blocked_drive_end,
    blocked_turn_end,
    position_at,
    turn_command,
)
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE, STOP


@inner
def blocked_ticks(planners: Planners, near: NDArray[np.uint32], i: int, setup: Setup, most: int) -> int:
    """Ticks for which a robot whose move has just been blocked stays blocked, at most ``most``.

    It stands and turns on, while the others follow their plans. When one nearby changes its plan, this robot is woken
    anyway. So only robots that stand, or that stay near from now on, count as blocking it.
    """
    row = planners[i]
    error_deg, integral_deg_s = row.error_deg, row.integral_deg_s
    gyro_deg = row.turn_gain * turn_command(setup, error_deg, integral_deg_s)
    # How far the end of a driver's move shifts in a tick, at most.
    a_tick = abs(row.intended_speed_m_s * row.rate_rad_s) * setup.tick_s * setup.tick_s
    n = 1
    while n < most:
        if row.mode == DRIVE:
            x, y = blocked_drive_end(row, setup, n)
        else:
            error_deg -= gyro_deg
            integral_deg_s += error_deg * setup.tick_s
            gyro_deg = row.turn_gain * turn_command(setup, error_deg, integral_deg_s)
            x, y = blocked_turn_end(row, setup, row.error_deg - error_deg, gyro_deg)
        held = overlap_ticks(setup.radius_m - wall_clearance_m(setup, x, y), a_tick)
        for m in range(neighbour_count(near, i)):
            j = neighbour(near, i, m)
            other = planners[j]
            if held > 0 or not maybe_within(other, row.x_m, row.y_m, setup.zone_m, row.tick + n):
                continue
            if other.mode != STOP and other.self_event_tick <= row.tick + n:
                return n
            other_x, other_y = position_at(other, setup, row.tick + n + 1 if j < i else row.tick + n)
            apart = math.sqrt((other_x - x) * (other_x - x) + (other_y - y) * (other_y - y))
            held = overlap_ticks(2.0 * setup.radius_m - apart, a_tick + other.max_step_m)
            if held > 0 and other.mode != STOP:
                if not other.blocked and not stays_near(other, row, setup):
                    return n
                held = min(held, other.self_event_tick - row.tick - n)
        if held == 0:
            return n
        n += held if row.mode == DRIVE else 1
    return most


@inlined
def stays_near(other: Planner, row: Planner, setup: Setup) -> bool:
    """Whether a robot whose plan brings it to touch another is within the zone until then."""
    far = setup.zone_m - 2.0 * other.position_error_m
    return bool(far > 2.0 * setup.radius_m and distance2_m2(other, row.x_m, row.y_m, row.tick) < far * far)


@inlined
def overlap_ticks(depth: float, shift: float) -> int:
    """Ticks for which an overlap surely lasts that shrinks by at most ``shift`` a tick; 0: no overlap."""
    if depth <= 0.0:
        return 0
    return max(1, int(min(depth / (shift + ROUNDING_M), SIDE_TICKS)))
