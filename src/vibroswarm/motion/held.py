"""Looking ahead on robots whose move is blocked: for how long they stay so (see ``ahead``)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import inlined, inner
from vibroswarm.motion.ahead import ROUNDING_M, SIDE_TICKS, apart2, maybe_within, to_wall_m
from vibroswarm.motion.body import Setup
from vibroswarm.motion.neighbours import how_many, listed
from vibroswarm.motion.plans import Planner, Planners, place_at, pushed_to, swung_to, turn_command
from vibroswarm.robot.walk import DRIVE, STOP


@inner
def blocked_ticks(planners: Planners, near: NDArray[np.uint32], i: int, setup: Setup, most: int) -> int:
    """Ticks for which a robot whose move has just been blocked stays blocked, at most ``most``.

    It stands and turns on, by the others' plans. When one of those near changes its plan, it is woken anyway; so it
    is held only by those that stand, or that stay near from now on.
    """
    row = planners[i]
    error_deg, integral_deg_s = row.error_deg, row.integral_deg_s
    gyro_deg = row.turn_gain * turn_command(setup, error_deg, integral_deg_s)
    # So far the place where a driver's move would end shifts in a tick.
    a_tick = abs(row.wish_m_s * row.rate_rad_s) * setup.tick_s * setup.tick_s
    n = 1
    while n < most:
        if row.mode == DRIVE:
            x, y = pushed_to(row, setup, n)
        else:
            error_deg -= gyro_deg
            integral_deg_s += error_deg * setup.tick_s
            gyro_deg = row.turn_gain * turn_command(setup, error_deg, integral_deg_s)
            x, y = swung_to(row, setup, row.error_deg - error_deg, gyro_deg)
        held = held_ticks(setup.radius_m - to_wall_m(setup, x, y), a_tick)
        for m in range(how_many(near, i)):
            j = listed(near, i, m)
            other = planners[j]
            if held > 0 or not maybe_within(other, row.x_m, row.y_m, setup.zone_m, row.tick + n):
                continue
            if other.mode != STOP and other.own_tick <= row.tick + n:
                return n
            other_x, other_y = place_at(other, setup, row.tick + n + 1 if j < i else row.tick + n)
            apart = math.sqrt((other_x - x) * (other_x - x) + (other_y - y) * (other_y - y))
            held = held_ticks(2.0 * setup.radius_m - apart, a_tick + other.rate_m)
            if held > 0 and other.mode != STOP:
                if not other.blocked and not stays_near(other, row, setup):
                    return n
                held = min(held, other.own_tick - row.tick - n)
        if held == 0:
            return n
        n += held if row.mode == DRIVE else 1
    return most


@inlined
def stays_near(other: Planner, row: Planner, setup: Setup) -> bool:
    """Whether a robot whose plan brings it to touch another is within the zone all the way to there."""
    far = setup.zone_m - 2.0 * other.slack_m
    return bool(far > 2.0 * setup.radius_m and apart2(other, row.x_m, row.y_m, row.tick) < far * far)


@inlined
def held_ticks(depth: float, shift: float) -> int:
    """Ticks for which an overlap so deep surely lasts, if it shrinks by no more than ``shift`` a tick; 0: none."""
    if depth <= 0.0:
        return 0
    return max(1, int(min(depth / (shift + ROUNDING_M), SIDE_TICKS)))
