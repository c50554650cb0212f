"""Looking ahead: until when a robot can meet no wall, or its blocked move stays blocked.

Each function here and in ``pair_lookahead`` returns a tick that is never too late:
before it no ray is shorter than theta_c and no move is blocked. Distances shrink at bounded rates, so one look says for
how many ticks no other is needed (conservative advancement). What then happens at a tick is decided by the same
functions as in the fixed-step engine. ``tests/exact/test_lookahead_bounds.py`` compares each bound with stepping.

| name | unit | meaning |
|---|---|---|
| look | m | rays matter up to the shorter of range and theta_c |
| zone | m | below this distance (two radii and two longest steps) a move may bring two robots into contact |
| sight | m | rays see no robot beyond this distance, centre to centre |
| mid, chord | m, m per tick | approximate position: mid + chord n after n ticks; in a turn, mid is its pivot |
| position error | m | bound on the distance from there |
| gap | m | a distance that must not be used up |
| approach | m per tick | how fast a gap shrinks now |
| swerve | m per tick^2 | how much faster it may shrink with each tick |
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner
from vibroswarm.motion.event.event_queue import NEVER
from vibroswarm.motion.event.neighbours import neighbour, neighbour_count
from vibroswarm.motion.event.trajectory import (
    Planner,
    Planners,
    along_arc,
    blocked_drive_end,
    blocked_turn_end,
    position_at,
    position_in_turn,
    turn_command,
)
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE, STOP

SIDE_TICKS = 128.0
"""A wall or a robot nearby is looked at again after at most this many ticks."""

ROUNDING_M = 1e-12


@inlined
def set_chord(row: Planner, setup: Setup) -> None:
    """Set a plan's chord and position error, and a driver's pose at its ``self_event_tick``."""
    set_standing(row)
    if row.mode == STOP:
        return
    if row.mode == DRIVE:
        ticks = row.self_event_tick - row.tick
        x_m, y_m, heading_rad, sin_h, cos_h = along_arc(row, ticks * setup.tick_s)
        row.end_x_m, row.end_y_m, row.end_heading_rad = x_m, y_m, heading_rad
        row.end_sin_h, row.end_cos_h = sin_h, cos_h
        if not row.blocked:
            row.chord_x_m, row.chord_y_m = (x_m - row.x_m) / ticks, (y_m - row.y_m) / ticks
            # An arc leaves its chord by about an eighth of its length times the angle it turns, if that is small; a
            # seventh is safe.
            bend = abs(row.rate_rad_s) * ticks * setup.tick_s
            row.position_error_m = row.max_step_m * ticks * (bend / 7.0 if bend < 1.0 else 1.0)
    elif not row.blocked:
        row.mid_x_m -= row.radius_m * row.sin_h
        row.mid_y_m += row.radius_m * row.cos_h
        row.position_error_m = abs(row.radius_m) + ROUNDING_M


@inlined
def set_standing(row: Planner) -> None:
    """Set the chord of a standing robot."""
    row.mid_x_m, row.mid_y_m = row.x_m, row.y_m
    row.chord_x_m = row.chord_y_m = row.position_error_m = 0.0


@inlined
def maybe_within(row: Planner, x_m: float, y_m: float, distance_m: float, tick: int) -> bool:
    """Return whether a robot may be within ``distance_m`` of a point at ``tick``, according to its chord; if False, it
    is certainly not."""
    bound_m = distance_m + row.position_error_m
    return bool(distance2_m2(row, x_m, y_m, tick) < bound_m * bound_m)


@inlined
def distance2_m2(row: Planner, x_m: float, y_m: float, tick: int) -> float:
    """Return the squared distance from a point to a robot's approximate position at ``tick``, m^2."""
    dx = row.mid_x_m + (tick - row.tick) * row.chord_x_m - x_m
    dy = row.mid_y_m + (tick - row.tick) * row.chord_y_m - y_m
    squared: float = dx * dx + dy * dy
    return squared


@inlined
def encounter_reach_m(row: Planner, setup: Setup, tick: int) -> float:
    """Return the distance at ``tick`` beyond which no other robot can affect this one before its plan ends, m."""
    reach_m: float = max(setup.zone_m, setup.sight_m)
    own_m = (row.self_event_tick - tick) * row.max_step_m
    return reach_m + (own_m + (row.plan_end_tick - tick) * setup.longest_step_m)


@inlined
def wall_clearance_m(setup: Setup, x_m: float, y_m: float) -> float:
    """Return the distance from a point to the nearest wall, m."""
    return min(min(x_m, setup.width_m - x_m), min(y_m, setup.height_m - y_m))


@inlined
def avoidance_tick(row: Planner, setup: Setup) -> int:
    """Return the first tick of a driver's plan at which it uses its rays; it may ignore them for a while after a
    turn."""
    if setup.blind_ms <= 0.0:
        return int(row.tick + 1)
    return int(row.tick + 1 + max(0, math.ceil((row.sees_from_ms - row.driven_ms) / setup.tick_ms)))


@inlined
def ticks_until_closed(gap: float, approach: float, swerve: float) -> float:
    """Return a lower bound on the ticks until a gap closes that shrinks by ``approach`` per tick, and by ``swerve``
    more with each tick; 0 if it is closed already, at most SIDE_TICKS."""
    if gap <= 0.0:
        return 0.0
    below = approach + math.sqrt(approach * approach + 2.0 * swerve * gap)
    return min(2.0 * gap / below, SIDE_TICKS)  # a gap that never closes gives infinity, which this bounds too


@inner
def blocked_ticks(planners: Planners, near: NDArray[np.uint32], i: int, setup: Setup, most: int) -> int:
    """Return the number of ticks, at most ``most``, for which a robot whose move has just been blocked stays blocked.

    It stands and continues to turn, while the others follow their plans. If a neighbour changes its plan, this robot
    is woken anyway. So only robots that stand, or that stay close from now on, count as blocking it."""
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
        blocked = overlap_ticks(setup.radius_m - wall_clearance_m(setup, x, y), a_tick)
        for m in range(neighbour_count(near, i)):
            j = neighbour(near, i, m)
            other = planners[j]
            if blocked > 0 or not maybe_within(other, row.x_m, row.y_m, setup.zone_m, row.tick + n):
                continue
            if other.mode != STOP and other.self_event_tick <= row.tick + n:
                return n
            other_x, other_y = position_at(other, setup, row.tick + n + 1 if j < i else row.tick + n)
            apart = math.sqrt((other_x - x) * (other_x - x) + (other_y - y) * (other_y - y))
            blocked = overlap_ticks(2.0 * setup.radius_m - apart, a_tick + other.max_step_m)
            if blocked > 0 and other.mode != STOP:
                if not other.blocked and not stays_near(other, row, setup):
                    return n
                blocked = min(blocked, other.self_event_tick - row.tick - n)
        if blocked == 0:
            return n
        n += blocked if row.mode == DRIVE else 1
    return most


@inlined
def stays_near(other: Planner, row: Planner, setup: Setup) -> bool:
    """Return whether ``other``, whose plan leads to contact with the standing robot ``row``, is in its zone until then.

    A chord with both ends in a circle lies within it, so the distance at ``row``'s tick decides.
    """
    bound_m = setup.zone_m - 2.0 * other.position_error_m
    return bool(
        bound_m > 2.0 * setup.radius_m and distance2_m2(other, row.x_m, row.y_m, row.tick) < bound_m * bound_m
    )


@inlined
def overlap_ticks(depth: float, shift: float) -> int:
    """Return a lower bound on the ticks for which an overlap of ``depth`` lasts that shrinks by at most ``shift`` per
    tick; 0 if there is none."""
    if depth <= 0.0:
        return 0
    return max(1, int(min(depth / (shift + ROUNDING_M), SIDE_TICKS)))


SAG_ROUNDING_M = 1e-9


@inlined
def wall_tick(row: Planner, setup: Setup) -> int:
    """Return the next tick of the plan at which a wall may matter: a ray may detect it, or the body reach it.

    NEVER if there is none.
    """
    if row.mode == STOP:
        return NEVER
    inset = setup.radius_m + setup.longest_step_m
    if row.mode != DRIVE:  # it turns on the spot
        if row.blocked:  # for as long as its plan lasts: it does not move
            return NEVER
        clearance_m = wall_clearance_m(setup, row.mid_x_m, row.mid_y_m)
        return NEVER if clearance_m - row.position_error_m >= inset else turn_at_walls(row, setup)
    # It drives: no wall matters if the box around its path is far from all of them.
    reach_m = max(setup.ray_reach_m, inset) + row.position_error_m
    left, right = min(row.x_m, row.end_x_m), max(row.x_m, row.end_x_m)
    low, high = min(row.y_m, row.end_y_m), max(row.y_m, row.end_y_m)
    if (
        left >= reach_m
        and low >= reach_m
        and right <= setup.width_m - reach_m
        and high <= setup.height_m - reach_m
    ):
        return NEVER
    return tick_at_walls(row, setup, inset)


@inner
def turn_at_walls(row: Planner, setup: Setup) -> int:
    """Compute ``wall_tick`` for a robot that turns close to walls: the first tick at which its move would end in one,
    NEVER if there is none."""
    tick = row.tick + 1
    while tick < row.self_event_tick and row.max_step_m > 0.0:
        x, y = position_in_turn(row, setup, tick)
        gap = wall_clearance_m(setup, x, y) - setup.radius_m - ROUNDING_M
        if gap < row.max_step_m:
            x, y = position_in_turn(row, setup, tick + 1)
            if wall_clearance_m(setup, x, y) - setup.radius_m < ROUNDING_M:
                return int(tick)
        tick += max(1, int(gap / row.max_step_m))
    return NEVER


@inner
def tick_at_walls(row: Planner, setup: Setup, inset: float) -> int:
    """Compute ``wall_tick`` for a driver close to walls."""
    left, right, low, high = reach_box(row, setup, inset, row.x_m, row.y_m, row.sin_h, row.cos_h)
    end_left, end_right, end_low, end_high = reach_box(
        row, setup, inset, row.end_x_m, row.end_y_m, row.end_sin_h, row.end_cos_h
    )
    # Between the ends of the plan, a distance to a wall deviates from linear interpolation by at most an eighth of
    # ticks^2 times its largest second difference.
    ticks, bend = row.self_event_tick - row.tick, abs(row.rate_rad_s) * setup.tick_s
    sag = 0.125 * ticks * ticks * bend * (row.max_step_m + bend * setup.ray_reach_m) + SAG_ROUNDING_M
    near_left, near_right = min(left, end_left) < sag, max(right, end_right) > setup.width_m - sag
    near_low, near_high = min(low, end_low) < sag, max(high, end_high) > setup.height_m - sag
    if not (near_left or near_right or near_low or near_high):
        return NEVER
    tick, heeds = row.tick + 1, avoidance_tick(row, setup)
    while tick <= row.self_event_tick:
        x, y, _, sin_h, cos_h = along_arc(row, (tick - row.tick) * setup.tick_s)
        free, looks = SIDE_TICKS, tick >= heeds
        # A wall is looked at along its normal: the distance to it, and the heading turned into its frame.
        if near_left:
            free = min(free, free_ticks_to_wall(row, setup, inset, x, -cos_h, -sin_h, looks))
        if near_right:
            free = min(free, free_ticks_to_wall(row, setup, inset, setup.width_m - x, cos_h, sin_h, looks))
        if near_low:
            free = min(free, free_ticks_to_wall(row, setup, inset, y, -sin_h, cos_h, looks))
        if near_high:
            free = min(free, free_ticks_to_wall(row, setup, inset, setup.height_m - y, sin_h, -cos_h, looks))
        if free <= 0.0:
            return int(tick)
        later = tick + max(1, int(free))
        tick = later if looks else min(later, heeds)
    return NEVER


@inlined
def reach_box(
    row: Planner, setup: Setup, inset: float, x_m: float, y_m: float, sin_h: float, cos_h: float
) -> tuple[float, float, float, float]:
    """Return the bounding box of a robot's body (with its inset) and its rays: left, right, low, high, m."""
    left, right, low, high = x_m - inset, x_m + inset, y_m - inset, y_m + inset
    for k in range(setup.ray_side_m.size):
        along = row.ray_forward_m + setup.look_m * setup.ray_cos[k]
        lateral = setup.ray_side_m[k] + setup.look_m * setup.ray_sin[k]
        end_x, end_y = x_m + along * cos_h - lateral * sin_h, y_m + along * sin_h + lateral * cos_h
        left, right = min(left, end_x), max(right, end_x)
        low, high = min(low, end_y), max(high, end_y)
        if setup.outside_m > 0.0:  # rays that may start beyond a wall
            along, lateral = row.ray_forward_m, setup.ray_side_m[k]
            end_x, end_y = x_m + along * cos_h - lateral * sin_h, y_m + along * sin_h + lateral * cos_h
            left, right = min(left, end_x), max(right, end_x)
            low, high = min(low, end_y), max(high, end_y)
    return left, right, low, high


@inner
def free_ticks_to_wall(
    row: Planner, setup: Setup, inset: float, distance_m: float, toward: float, aside: float, looks: bool
) -> float:
    """Return a lower bound on the ticks before a ray's end passes a wall or the body is closer to it than ``inset``.

    It is 0 if that is so now. A ray is shorter than ``look`` exactly if its end at that length, or its start, is
    beyond a wall.

    Args:
        distance_m: from the robot's centre to the wall.
        toward: cosine of the angle between heading and the wall's normal; 1 if the robot faces the wall.
        aside: sine of that angle. A point (a, b) of the robot's frame is a toward - b aside nearer to the wall than
            its centre.
        looks: whether rays matter; if not, only the body is checked.
    """
    step = row.speed_m_s * setup.tick_s
    bend = row.rate_rad_s * setup.tick_s
    most = row.max_step_m + abs(bend) * setup.ray_reach_m
    free = ticks_until_closed(distance_m - inset, step * toward, abs(bend) * row.max_step_m)
    if not looks:
        return free
    for k in range(setup.ray_side_m.size):
        along = row.ray_forward_m + setup.look_m * setup.ray_cos[k]
        lateral = setup.ray_side_m[k] + setup.look_m * setup.ray_sin[k]
        approach = along * toward - lateral * aside
        closing = step * toward - bend * (along * aside + lateral * toward)
        free = min(free, ticks_until_closed(distance_m - approach, closing, abs(bend) * most))
        if setup.outside_m > 0.0:
            along, lateral = row.ray_forward_m, setup.ray_side_m[k]
            approach = along * toward - lateral * aside
            closing = step * toward - bend * (along * aside + lateral * toward)
            free = min(
                free, ticks_until_closed(distance_m - approach - ROUNDING_M, closing, abs(bend) * most)
            )
    return free
