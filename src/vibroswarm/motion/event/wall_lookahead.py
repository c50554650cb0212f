"""Looking ahead on walls: when a ray may see one, or the body come to one (see ``lookahead``)."""

from __future__ import annotations

from vibroswarm.core.jit import inlined, inner
from vibroswarm.motion.event.event_queue import NEVER
from vibroswarm.motion.event.lookahead import (
    ROUNDING_M,
    SIDE_TICKS,
    avoidance_tick,
    ticks_until_closed,
    wall_clearance_m,
)
from vibroswarm.motion.event.trajectory import Planner, along_arc, position_in_turn
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE, STOP

SAG_ROUNDING_M = 1e-9


@inlined
def wall_tick(row: Planner, setup: Setup) -> int:
    """First tick of the plan, after its own, at which a ray may see a wall or the body come to one, or NEVER."""
    if row.mode == STOP:
        return NEVER
    inset = setup.radius_m + setup.longest_step_m
    if row.mode != DRIVE:
        if row.blocked:  # and stays so
            return NEVER
        near = wall_clearance_m(setup, row.mid_x_m, row.mid_y_m)
        return NEVER if near - row.position_error_m >= inset else turn_at_walls(row, setup)
    far = max(setup.ray_reach_m, inset) + row.position_error_m
    left, right = min(row.x_m, row.end_x_m), max(row.x_m, row.end_x_m)
    low, high = min(row.y_m, row.end_y_m), max(row.y_m, row.end_y_m)
    if left >= far and low >= far and right <= setup.width_m - far and high <= setup.height_m - far:
        return NEVER
    return tick_at_walls(row, setup, inset)


@inner
def turn_at_walls(row: Planner, setup: Setup) -> int:
    """``wall_tick`` for a robot that turns near walls: the tick at which its pivot would swing its body into one."""
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
    """``wall_tick`` for a driver that comes near walls."""
    left, right, low, high = reach_box(row, setup, inset, row.x_m, row.y_m, row.sin_h, row.cos_h)
    own_left, own_right, own_low, own_high = reach_box(
        row, setup, inset, row.end_x_m, row.end_y_m, row.end_sin_h, row.end_cos_h
    )
    # Between both ends a distance is above the straight line by no more than an eighth of how it bends.
    ticks, bend = row.self_event_tick - row.tick, abs(row.rate_rad_s) * setup.tick_s
    sag = 0.125 * ticks * ticks * bend * (row.max_step_m + bend * setup.ray_reach_m) + SAG_ROUNDING_M
    near_left, near_right = min(left, own_left) < sag, max(right, own_right) > setup.width_m - sag
    near_low, near_high = min(low, own_low) < sag, max(high, own_high) > setup.height_m - sag
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
    """The box round a robot's body with its inset, and its rays: left, right, low, high, m."""
    left, right, low, high = x_m - inset, x_m + inset, y_m - inset, y_m + inset
    for k in range(setup.ray_side_m.size):
        along = row.ray_forward_m + setup.look_m * setup.ray_cos[k]
        beside = setup.ray_side_m[k] + setup.look_m * setup.ray_sin[k]
        end_x, end_y = x_m + along * cos_h - beside * sin_h, y_m + along * sin_h + beside * cos_h
        left, right = min(left, end_x), max(right, end_x)
        low, high = min(low, end_y), max(high, end_y)
        if setup.outside_m > 0.0:  # rays that may start beyond a wall
            along, beside = row.ray_forward_m, setup.ray_side_m[k]
            end_x, end_y = x_m + along * cos_h - beside * sin_h, y_m + along * sin_h + beside * cos_h
            left, right = min(left, end_x), max(right, end_x)
            low, high = min(low, end_y), max(high, end_y)
    return left, right, low, high


@inner
def free_ticks_to_wall(
    row: Planner, setup: Setup, inset: float, distance_m: float, toward: float, aside: float, looks: bool
) -> float:
    """Ticks that surely pass before a ray's end is beyond a wall or the body nearer than its inset; 0 if one is.

    A ray is shorter than ``look`` just when its end, so far out, lies beyond a wall, or its start does.

    Args:
        distance_m: from the centre to the wall. toward, aside: cosine and sine of the heading, seen from the
            wall's normal (1, 0: straight at it); a point (a, b) of the robot's frame is a toward - b aside nearer.
        looks: whether rays matter.
    """
    step = row.speed_m_s * setup.tick_s
    bend = row.rate_rad_s * setup.tick_s
    most = row.max_step_m + abs(bend) * setup.ray_reach_m
    free = ticks_until_closed(distance_m - inset, step * toward, abs(bend) * row.max_step_m)
    if not looks:
        return free
    for k in range(setup.ray_side_m.size):
        along = row.ray_forward_m + setup.look_m * setup.ray_cos[k]
        beside = setup.ray_side_m[k] + setup.look_m * setup.ray_sin[k]
        nearer = along * toward - beside * aside
        closing = step * toward - bend * (along * aside + beside * toward)
        free = min(free, ticks_until_closed(distance_m - nearer, closing, abs(bend) * most))
        if setup.outside_m > 0.0:
            along, beside = row.ray_forward_m, setup.ray_side_m[k]
            nearer = along * toward - beside * aside
            closing = step * toward - bend * (along * aside + beside * toward)
            free = min(free, ticks_until_closed(distance_m - nearer - ROUNDING_M, closing, abs(bend) * most))
    return free
