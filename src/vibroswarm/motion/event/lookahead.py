"""Looking ahead: up to which tick a robot surely meets no wall, or its blocked move surely stays blocked.

The tick found may be too early but is never too late: before it, no ray is shorter than theta_c and no move is
blocked. Distances shrink at bounded rates, so each check shows for how many ticks no further check is needed
(conservative advancement). The move at a tick is blocked if it would end in a wall or in another robot.

| name | unit | meaning |
|---|---|---|
| theta_c | m | a robot avoids what a ray meets at less than this length (``avoidance_threshold_mm``) |
| look | m | rays matter up to this length, the shorter of their range and theta_c |
| zone | m | below this distance (two radii and two longest steps) a move may bring two robots into contact |
| sight | m | rays see no robot beyond this distance, centre to centre |
| inset | m | body radius and longest step: nearer to a wall than this, the next move may be blocked |
| mid, chord | m, m per tick | approximate position n ticks after the plan's tick: mid + n chord |
| pivot | m | centre of the circle on which the centre of a turning robot moves; its mid (chord 0) |
| position error | m | bound on the distance between approximate and exact position |
| gap | m | a distance that must not shrink to 0 |
| approach | m per tick | speed at which a gap shrinks now |
| swerve | m per tick^2 | bound on the increase of that speed per tick |
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
"""A wall or a robot nearby is checked again after at most this many ticks."""

ROUNDING_M = 1e-12
"""Bound on rounding errors of positions, m."""


@inlined
def set_chord(row: Planner, setup: Setup) -> None:
    """Set the approximate position of a plan (mid, chord, position error), for other robots that look ahead on it."""
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
            # An arc of a small angle deviates from its chord by about an eighth of its length (``max_step_m`` times
            # ticks) times the angle (``bend``); a seventh is a safe bound. An arc of more than 1 rad deviates by less
            # than its length.
            bend = abs(row.rate_rad_s) * ticks * setup.tick_s
            row.position_error_m = row.max_step_m * ticks * (bend / 7.0 if bend < 1.0 else 1.0)
    elif not row.blocked:  # it turns in place: its centre moves on a circle about the pivot
        row.mid_x_m -= row.radius_m * row.sin_h
        row.mid_y_m += row.radius_m * row.cos_h
        row.position_error_m = abs(row.radius_m) + ROUNDING_M


@inlined
def set_standing(row: Planner) -> None:
    """Set the approximate position of a robot that stands; it is exact."""
    row.mid_x_m, row.mid_y_m = row.x_m, row.y_m
    row.chord_x_m = row.chord_y_m = row.position_error_m = 0.0


@inlined
def maybe_within(row: Planner, x_m: float, y_m: float, distance_m: float, tick: int) -> bool:
    """Return whether a robot may be within ``distance_m`` of the point (x_m, y_m) at ``tick``."""
    bound_m = distance_m + row.position_error_m
    return bool(distance2_m2(row, x_m, y_m, tick) < bound_m * bound_m)


@inlined
def distance2_m2(row: Planner, x_m: float, y_m: float, tick: int) -> float:
    """Return the squared distance from the point (x_m, y_m) to a robot's approximate position at ``tick``, m^2."""
    dx = row.mid_x_m + (tick - row.tick) * row.chord_x_m - x_m
    dy = row.mid_y_m + (tick - row.tick) * row.chord_y_m - y_m
    squared: float = dx * dx + dy * dy
    return squared


@inlined
def encounter_reach_m(row: Planner, setup: Setup, tick: int) -> float:
    """Return a distance, m: robots further away at ``tick`` have no encounter with this robot before its plan ends."""
    reach_m: float = max(setup.zone_m, setup.sight_m)
    # This robot moves until ``self_event_tick``. The other one may move on during the stop that ends this robot's plan.
    own_m = (row.self_event_tick - tick) * row.max_step_m
    return reach_m + (own_m + (row.plan_end_tick - tick) * setup.longest_step_m)


@inlined
def wall_clearance_m(setup: Setup, x_m: float, y_m: float) -> float:
    """Return the distance from a point to the nearest wall, m; negative if the point is outside the arena."""
    return min(min(x_m, setup.width_m - x_m), min(y_m, setup.height_m - y_m))


@inlined
def avoidance_tick(row: Planner, setup: Setup) -> int:
    """Return the first tick of a driver's plan at which it uses its rays."""
    # A plan is made after the step at ``row.tick``, so the next tick is the first at which rays can matter. The period
    # from ``row.tick`` to that tick is already in ``driven_ms``.
    if setup.blind_ms <= 0.0:
        return int(row.tick + 1)
    return int(row.tick + 1 + max(0, math.ceil((row.sees_from_ms - row.driven_ms) / setup.tick_ms)))


@inlined
def ticks_until_closed(gap: float, approach: float, swerve: float) -> float:
    """Return a lower bound on the ticks until a gap closes; 0 if it is closed already, at most SIDE_TICKS.

    After t ticks the gap is at least ``gap - approach t - swerve t^2 / 2``; the result is the positive root.
    """
    if gap <= 0.0:
        return 0.0
    # The root is written as a quotient that also holds for swerve 0, where the usual formula is 0 / 0.
    denominator = approach + math.sqrt(approach * approach + 2.0 * swerve * gap)
    # If the gap never closes, the denominator may be 0: kernels divide as NumPy does, and the quotient is infinite.
    return min(2.0 * gap / denominator, SIDE_TICKS)


@inner
def blocked_ticks(planners: Planners, near: NDArray[np.uint32], i: int, setup: Setup, most: int) -> int:
    """Return for how many ticks, at most ``most``, robot ``i``, whose move has been blocked, surely stays blocked.

    Only robots that are in its contact zone until they change their plans count as blocking it: they wake it then.
    """
    row = planners[i]
    error_deg, integral_deg_s = row.error_deg, row.integral_deg_s
    gyro_deg = row.turn_gain * turn_command(setup, error_deg, integral_deg_s)
    # In a tick, a driver's heading turns by rate times dt. So the end of its move, whose length is speed times dt,
    # shifts by at most the product of the two.
    shift_m = abs(row.intended_speed_m_s * row.rate_rad_s) * setup.tick_s * setup.tick_s
    n = 1  # number of ticks for which the move is surely blocked so far: at the plan's tick it is
    while n < most:
        if row.mode == DRIVE:
            x, y = blocked_drive_end(row, setup, n)
        else:
            # One step of the turn. Afterwards ``gyro_deg`` is the angle that the robot turns in the tick that follows.
            # Since the plan's tick, the robot has turned by the angle by which its error has fallen.
            error_deg -= gyro_deg
            integral_deg_s += error_deg * setup.tick_s
            gyro_deg = row.turn_gain * turn_command(setup, error_deg, integral_deg_s)
            x, y = blocked_turn_end(row, setup, row.error_deg - error_deg, gyro_deg)
        # (x, y) is where the move n ticks after the plan's tick would end. From then on it is blocked for ``blocked``
        # ticks: by a wall or, if not, by a neighbour. A standing neighbour stays until it wakes robot i; for a moving
        # one, the position is known only until its plan ends.
        blocked = overlap_ticks(setup.radius_m - wall_clearance_m(setup, x, y), shift_m)
        for m in range(neighbour_count(near, i)):
            j = neighbour(near, i, m)
            other = planners[j]
            if blocked > 0 or not maybe_within(other, row.x_m, row.y_m, setup.zone_m, row.tick + n):
                continue
            if other.mode != STOP and other.self_event_tick <= row.tick + n:
                return n  # what the other robot does after its plan is not known
            # A robot of lower number moves first, so it has moved already.
            other_x, other_y = position_at(other, setup, row.tick + n + 1 if j < i else row.tick + n)
            apart = math.sqrt((other_x - x) * (other_x - x) + (other_y - y) * (other_y - y))
            blocked = overlap_ticks(2.0 * setup.radius_m - apart, shift_m + other.max_step_m)
            if blocked > 0 and other.mode != STOP:
                if not other.blocked and not stays_near(other, row, setup):
                    return n  # it might change its plan outside of the zone, without waking robot i
                # What the other robot does after the end of its plan is not known.
                blocked = min(blocked, other.self_event_tick - row.tick - n)
        if blocked == 0:
            return n
        n += blocked if row.mode == DRIVE else 1  # a turn is simulated tick by tick
    return most


@inlined
def stays_near(other: Planner, row: Planner, setup: Setup) -> bool:
    """Return whether the moving robot ``other`` stays in the contact zone of the blocked robot ``row`` until contact.

    A line with both ends in a circle lies within it. The arc may deviate from it by the position error at both ends.
    """
    bound_m = setup.zone_m - 2.0 * other.position_error_m
    # The smaller circle must still be larger than that of contact, whose radius is two body radii.
    return bool(
        bound_m > 2.0 * setup.radius_m and distance2_m2(other, row.x_m, row.y_m, row.tick) < bound_m * bound_m
    )


@inlined
def overlap_ticks(depth: float, shift: float) -> int:
    """Return a lower bound on the number of ticks for which an overlap lasts; 0 if there is no overlap."""
    if depth <= 0.0:
        return 0
    # At least 1: the overlap exists at the present tick.
    return max(1, int(min(depth / (shift + ROUNDING_M), SIDE_TICKS)))


SAG_ROUNDING_M = 1e-9
"""Bound on rounding errors where paths close to walls are interpolated, m."""


@inlined
def wall_tick(row: Planner, setup: Setup) -> int:
    """Return the first tick of a plan at which a wall may affect the robot; NEVER if there is no such tick."""
    if row.mode == STOP:
        return NEVER
    inset = setup.radius_m + setup.longest_step_m
    if row.mode != DRIVE:  # it turns in place
        if row.blocked:  # its plan lasts no longer than it is surely blocked, so it does not move
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
    """Return the first tick at which the move of a robot that turns close to a wall may end in it, else NEVER."""
    tick = row.tick + 1
    # The move that begins at ``self_event_tick`` belongs to the next plan. If ``max_step_m`` is 0, the robot's centre
    # stays, so no move ends in a wall.
    while tick < row.self_event_tick and row.max_step_m > 0.0:
        x, y = position_in_turn(row, setup, tick)
        gap = wall_clearance_m(setup, x, y) - setup.radius_m - ROUNDING_M
        if gap < row.max_step_m:  # this tick's move may end in the wall: compute where it ends
            x, y = position_in_turn(row, setup, tick + 1)
            if wall_clearance_m(setup, x, y) - setup.radius_m < ROUNDING_M:
                return int(tick)
        tick += max(1, int(gap / row.max_step_m))
    return NEVER


@inner
def tick_at_walls(row: Planner, setup: Setup, inset: float) -> int:
    """Return the first tick at which a driver may detect a wall by a ray, or its move may end in one, else NEVER."""
    left, right, low, high = reach_box(row, setup, inset, row.x_m, row.y_m, row.sin_h, row.cos_h)
    end_left, end_right, end_low, end_high = reach_box(
        row, setup, inset, row.end_x_m, row.end_y_m, row.end_sin_h, row.end_cos_h
    )
    # Between start and end of the plan, each distance to a wall deviates from linear interpolation by at most an eighth
    # of ticks^2 times its largest second difference per tick. The second difference of the robot's position is at most
    # ``max_step_m`` times the angle turned in a tick (``bend``); that of a ray's end relative to the robot is at most
    # ``ray_reach_m`` times ``bend`` squared. A wall further away than ``sag`` at both ends is excluded.
    ticks, bend = row.self_event_tick - row.tick, abs(row.rate_rad_s) * setup.tick_s
    sag = 0.125 * ticks * ticks * bend * (row.max_step_m + bend * setup.ray_reach_m) + SAG_ROUNDING_M
    near_left, near_right = min(left, end_left) < sag, max(right, end_right) > setup.width_m - sag
    near_low, near_high = min(low, end_low) < sag, max(high, end_high) > setup.height_m - sag
    if not (near_left or near_right or near_low or near_high):
        return NEVER
    tick, sees_from = row.tick + 1, avoidance_tick(row, setup)
    # Check ``self_event_tick`` too: the robot's step at that tick computes no rays if ``lookahead_tick`` is later.
    while tick <= row.self_event_tick:
        x, y, _, sin_h, cos_h = along_arc(row, (tick - row.tick) * setup.tick_s)
        free, looks = SIDE_TICKS, tick >= sees_from
        # For each wall: the distance to it, and cosine and sine of the heading relative to the wall's normal.
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
        # While the robot ignores its rays, ``free`` does not take them into account: check again when it uses them.
        tick = later if looks else min(later, sees_from)
    return NEVER


@inlined
def reach_box(
    row: Planner, setup: Setup, inset: float, x_m: float, y_m: float, sin_h: float, cos_h: float
) -> tuple[float, float, float, float]:
    """Return the bounding box (left, right, low, high, m) of a driver's rays and body at a pose."""
    left, right, low, high = x_m - inset, x_m + inset, y_m - inset, y_m + inset
    for k in range(setup.ray_side_m.size):
        along = row.ray_forward_m + setup.look_m * setup.ray_cos[k]
        lateral = setup.ray_side_m[k] + setup.look_m * setup.ray_sin[k]
        end_x, end_y = x_m + along * cos_h - lateral * sin_h, y_m + along * sin_h + lateral * cos_h
        left, right = min(left, end_x), max(right, end_x)
        low, high = min(low, end_y), max(high, end_y)
        if setup.outside_m > 0.0:  # rays may start beyond a wall, so their starts are included too
            along, lateral = row.ray_forward_m, setup.ray_side_m[k]
            end_x, end_y = x_m + along * cos_h - lateral * sin_h, y_m + along * sin_h + lateral * cos_h
            left, right = min(left, end_x), max(right, end_x)
            low, high = min(low, end_y), max(high, end_y)
    return left, right, low, high


@inner
def free_ticks_to_wall(
    row: Planner, setup: Setup, inset: float, distance_m: float, toward: float, aside: float, looks: bool
) -> float:
    """Return a lower bound on the ticks until a ray detects a wall, or it is nearer to the robot than ``inset``.

    ``toward`` and ``aside`` are cosine and sine of the angle between heading and the wall's normal.
    """
    step = row.speed_m_s * setup.tick_s
    bend = row.rate_rad_s * setup.tick_s
    # Bound on the speed of any point of a ray, m per tick.
    most = row.max_step_m + abs(bend) * setup.ray_reach_m
    # First the body. Velocities turn with the robot, by ``bend`` per tick: so a speed towards the wall grows by at most
    # ``bend`` times the point's speed per tick.
    free = ticks_until_closed(distance_m - inset, step * toward, abs(bend) * row.max_step_m)
    if not looks:
        return free
    for k in range(setup.ray_side_m.size):
        # The end of ray k, in the robot's frame; by how much it is nearer to the wall; and how fast it comes nearer.
        along = row.ray_forward_m + setup.look_m * setup.ray_cos[k]
        lateral = setup.ray_side_m[k] + setup.look_m * setup.ray_sin[k]
        nearer_m = along * toward - lateral * aside
        closing = step * toward - bend * (along * aside + lateral * toward)
        free = min(free, ticks_until_closed(distance_m - nearer_m, closing, abs(bend) * most))
        if setup.outside_m > 0.0:  # the ray may start beyond the wall: the same for its start
            # ROUNDING_M is subtracted since a ray that starts on the wall detects it too (``wall_distance``).
            along, lateral = row.ray_forward_m, setup.ray_side_m[k]
            nearer_m = along * toward - lateral * aside
            closing = step * toward - bend * (along * aside + lateral * toward)
            free = min(
                free, ticks_until_closed(distance_m - nearer_m - ROUNDING_M, closing, abs(bend) * most)
            )
    return free
