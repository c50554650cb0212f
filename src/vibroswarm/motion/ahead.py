"""Looking ahead: the first tick at which a wall or another robot might matter to a plan.

Each function gives a tick that is never too late: before it no ray is shorter than theta_c and no move is
blocked. Distances shrink at bounded rates, so from one look it is known for how many ticks there is no need
of another (conservative advancement); what then happens at a tick is decided by the same functions as in
the fixed-step engine.

| name | unit | what it is |
|---|---|---|
| look | m | rays matter up to the shorter of range and theta_c |
| zone | m | nearer than this (two radii and two longest steps), a move may bring two robots into contact |
| touch | m | the same, with the steps of the two plans in question |
| reach | m | rays see nothing of a robot further away than this, centre to centre |
| slack | m | how far a robot may be beside its chord |
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import kernel
from vibroswarm.motion.body import Setup
from vibroswarm.motion.geometry import arc
from vibroswarm.motion.plans import Planners, facing_at, pose_at, see_own
from vibroswarm.motion.wakes import NEVER
from vibroswarm.robot.walk import DRIVE, STOP

SIDE_TICKS = 64.0
"""A wall is looked at again after so many ticks at most."""


@kernel
def prepare_to_look(planners: Planners, i: int, setup: Setup) -> None:
    """Chord, slack and rate of a plan that reaches to its ``own_tick``."""
    row = planners[i]
    ticks = row.own_tick - row.tick
    if row.mode == DRIVE:
        see_own(planners, i, setup)
    if row.mode == STOP or row.blocked:
        row.chord_x_m = row.chord_y_m = row.slack_m = row.rate_m = 0.0
    elif row.mode == DRIVE:
        row.chord_x_m, row.chord_y_m = (row.own_x_m - row.x_m) / ticks, (row.own_y_m - row.y_m) / ticks
        row.rate_m = abs(row.speed_m_s) * setup.tick_s
        bend = abs(row.rate_rad_s) * ticks * setup.tick_s
        row.slack_m = row.rate_m * ticks * (bend / 7.0 if bend < 1.0 else 1.0)
    else:
        row.chord_x_m = row.chord_y_m = 0.0
        row.slack_m = 2.0 * abs(row.radius_m)
        row.rate_m = abs(row.radius_m) * math.radians(100.0 * row.turn_gain)


@kernel
def blocked_ticks(planners: Planners, near: NDArray[np.int64], i: int, setup: Setup, most: int) -> int:
    """Ticks for which a robot that drives, and whose move has just been blocked, stays blocked, at most ``most``.

    It stands and turns on, by the others' plans; when one of those near changes its plan, it is woken anyway.
    """
    row = planners[i]
    zone = 2.0 * (setup.radius_m + setup.longest_step_m)
    r = setup.radius_m
    for n in range(1, most):
        heading = row.heading_rad + row.rate_rad_s * (n * setup.tick_s)
        x, y, _ = arc(row.x_m, row.y_m, heading, row.wish_m_s, row.rate_rad_s, setup.tick_s)
        hit = x < r or y < r or x > setup.width_m - r or y > setup.height_m - r
        tick = row.tick + n
        for m in range(near[i, 0]):
            j = near[i, m + 1]
            if hit or not maybe_within(planners, j, row.x_m, row.y_m, zone, tick):
                continue
            if planners[j].mode != STOP and planners[j].own_tick <= tick:
                return n
            other_x, other_y, _ = pose_at(planners, j, setup, tick + 1 if j < i else tick)
            dx, dy = other_x - x, other_y - y
            hit = dx * dx + dy * dy < 4.0 * r * r
        if not hit:
            return n
    return most


@kernel
def maybe_within(planners: Planners, j: int, x_m: float, y_m: float, distance_m: float, tick: int) -> bool:
    """Whether robot ``j`` may be within a distance of a point at ``tick``, by its chord."""
    row = planners[j]
    dx = row.x_m + (tick - row.tick) * row.chord_x_m - x_m
    dy = row.y_m + (tick - row.tick) * row.chord_y_m - y_m
    far = distance_m + row.slack_m
    return bool(dx * dx + dy * dy < far * far)


@kernel
def wall_tick(planners: Planners, i: int, setup: Setup) -> int:
    """First tick of the plan, after its own, at which a ray may see a wall or the body come to one, or NEVER."""
    row = planners[i]
    if row.mode == STOP:
        return NEVER
    inset = setup.radius_m + setup.longest_step_m
    if row.mode != DRIVE:
        near = min(min(row.x_m, setup.width_m - row.x_m), min(row.y_m, setup.height_m - row.y_m))
        return int(row.tick + 1) if near - row.slack_m < inset else NEVER
    far = max(setup.ray_reach_m, inset) + row.slack_m
    near_left = min(row.x_m, row.own_x_m) < far
    near_right = max(row.x_m, row.own_x_m) > setup.width_m - far
    near_low = min(row.y_m, row.own_y_m) < far
    near_high = max(row.y_m, row.own_y_m) > setup.height_m - far
    if not (near_left or near_right or near_low or near_high):
        return NEVER
    tick = row.tick + 1
    while tick <= row.own_tick:
        x, y, _, sin_h, cos_h = facing_at(planners, i, setup, tick)
        free = SIDE_TICKS
        # A wall is looked at along its normal: the distance to it, and the heading turned into its frame.
        if near_left:
            free = min(free, free_ticks_to_wall(row, setup, inset, x, -cos_h, -sin_h))
        if near_right:
            free = min(free, free_ticks_to_wall(row, setup, inset, setup.width_m - x, cos_h, sin_h))
        if near_low:
            free = min(free, free_ticks_to_wall(row, setup, inset, y, -sin_h, cos_h))
        if near_high:
            free = min(free, free_ticks_to_wall(row, setup, inset, setup.height_m - y, sin_h, -cos_h))
        if free <= 0.0:
            return int(tick)
        tick += max(1, int(free))
    return NEVER


@kernel
def free_ticks_to_wall(
    row: Any, setup: Setup, inset: float, distance_m: float, toward: float, aside: float
) -> float:
    """Ticks that surely pass before a ray's end is beyond a wall or the body nearer than its inset; 0 if one is.

    A ray is shorter than ``look`` just when its end, so far out, lies beyond a wall.

    Args:
        distance_m: from the centre to the wall. toward, aside: cosine and sine of the heading, seen from the
            wall's normal (1, 0: straight at it); a point (a, b) of the robot's frame is a toward - b aside nearer.
    """
    step = row.speed_m_s * setup.tick_s
    bend = row.rate_rad_s * setup.tick_s
    most = row.rate_m + abs(bend) * setup.ray_reach_m
    free = side_ticks(distance_m - inset, step * toward, abs(bend) * row.rate_m)
    for k in range(setup.ray_side_m.size):
        along = setup.ray_forward_m + setup.look_m * setup.ray_cos[k]
        beside = setup.ray_side_m[k] + setup.look_m * setup.ray_sin[k]
        nearer = along * toward - beside * aside
        closing = step * toward - bend * (along * aside + beside * toward)
        free = min(free, side_ticks(distance_m - nearer, closing, abs(bend) * most))
    return free


@kernel
def side_ticks(distance: float, approach: float, change: float) -> float:
    """Ticks before a distance that shrinks by ``approach`` a tick, and by ``change`` more each tick, is used up."""
    if distance <= 0.0:
        return 0.0
    below = approach + math.sqrt(approach * approach + 2.0 * change * distance)
    return 2.0 * distance / below if below * SIDE_TICKS > 2.0 * distance else SIDE_TICKS


@kernel
def meeting_tick(planners: Planners, i: int, j: int, setup: Setup, tick: int) -> int:
    """First tick after ``tick`` at which robot ``i`` or ``j`` sees the other or is blocked by it.

    NEVER if it does not come to that as long as both plans last.
    """
    a, b = planners[i], planners[j]
    if a.mode == STOP and b.mode == STOP:
        return NEVER
    last = min(a.own_tick, b.own_tick)
    touch = 2.0 * setup.radius_m + a.rate_m + b.rate_m
    reach = touch
    if a.mode == DRIVE or b.mode == DRIVE:
        reach = max(touch, setup.ray_reach_m + setup.disc_radius_m)
    now = tick + 1
    while now <= last:
        free = apart_ticks(planners, i, j, reach, now)
        if free >= last - now + 1:
            return NEVER
        if free < 1.0:
            free = clear_ticks(planners, i, j, setup, touch, now)
            if free < 0.0 or (free < 1.0 and now < last and blocks_at(planners, i, j, setup, now)):
                return int(now)
        now += max(1, int(free))
    return NEVER


@kernel
def may_meet(planners: Planners, i: int, j: int, setup: Setup, tick: int) -> bool:
    """Whether the chords of two plans come so near, as long as both last, that a closer look is due.

    One test for the many pairs that do not: their least distance is where the derivative of its square is 0.
    """
    a, b = planners[i], planners[j]
    span = min(a.own_tick, b.own_tick) - tick
    x = a.x_m - b.x_m - (tick - b.tick) * b.chord_x_m
    y = a.y_m - b.y_m - (tick - b.tick) * b.chord_y_m
    dx, dy = a.chord_x_m - b.chord_x_m, a.chord_y_m - b.chord_y_m
    nearest = -(x * dx + y * dy) / (dx * dx + dy * dy + 1e-30)
    nearest = min(max(nearest, 0.0), float(span))
    x, y = x + nearest * dx, y + nearest * dy
    far = max(2.0 * (setup.radius_m + setup.longest_step_m), setup.ray_reach_m + setup.disc_radius_m)
    far += a.slack_m + b.slack_m
    return bool(x * x + y * y < far * far)


@kernel
def apart_ticks(planners: Planners, i: int, j: int, reach: float, tick: int) -> float:
    """Ticks that surely pass from ``tick`` before the two are within ``reach``, by their chords."""
    a, b = planners[i], planners[j]
    x = a.x_m + (tick - a.tick) * a.chord_x_m - b.x_m - (tick - b.tick) * b.chord_x_m
    y = a.y_m + (tick - a.tick) * a.chord_y_m - b.y_m - (tick - b.tick) * b.chord_y_m
    dx, dy = a.chord_x_m - b.chord_x_m, a.chord_y_m - b.chord_y_m
    far = reach + a.slack_m + b.slack_m
    beyond = x * x + y * y - far * far
    if beyond <= 0.0:
        return 0.0
    closing = -(x * dx + y * dy)
    if closing <= 0.0:
        return 1e9
    speed2 = dx * dx + dy * dy
    root = closing * closing - speed2 * beyond
    if root < 0.0:
        return 1e9
    return beyond / (closing + math.sqrt(root))


@kernel
def clear_ticks(planners: Planners, i: int, j: int, setup: Setup, touch: float, tick: int) -> float:
    """Ticks that surely pass from ``tick`` before either sees the other or they come nearer than ``touch``.

    0 if they are; -1 if one sees the other. Nearer than ``touch`` a single move may bring them into contact.
    A robot that turns is first taken as standing somewhere within its slack, which is mostly enough.
    """
    a, b = planners[i], planners[j]
    if is_turning(a.mode) or is_turning(b.mode):
        free = clear_from(planners, i, j, setup, touch, a.x_m, a.y_m, b.x_m, b.y_m, tick, True)
        if free >= 1.0:
            return free
    return clear_from(planners, i, j, setup, touch, 0.0, 0.0, 0.0, 0.0, tick, False)


@kernel
def is_turning(mode: int) -> bool:
    """Whether a robot in this mode turns in place."""
    return mode != DRIVE and mode != STOP


@kernel
def clear_from(
    planners: Planners, i: int, j: int, setup: Setup, touch: float,
    a_x: float, a_y: float, b_x: float, b_y: float, tick: int, roughly: bool,
) -> float:  # fmt: skip
    """``clear_ticks``; ``roughly``: robots that turn are about where they began to, as given."""
    a, b = planners[i], planners[j]
    a_sin, a_cos, b_sin, b_cos = 0.0, 1.0, 0.0, 1.0
    slack, rate = 0.0, 1e-12
    if roughly and is_turning(a.mode):
        slack += a.slack_m
    else:
        a_x, a_y, _, a_sin, a_cos = facing_at(planners, i, setup, tick)
        rate += a.rate_m
    if roughly and is_turning(b.mode):
        slack += b.slack_m
    else:
        b_x, b_y, _, b_sin, b_cos = facing_at(planners, j, setup, tick)
        rate += b.rate_m
    free = max(0.0, (math.sqrt((b_x - a_x) * (b_x - a_x) + (b_y - a_y) * (b_y - a_y)) - touch - slack) / rate)
    if a.mode == DRIVE:
        gap = fan_gap_m(setup, a_x, a_y, a_sin, a_cos, b_x, b_y) - slack
        if gap <= 0.0:
            return -1.0
        free = min(free, gap / (rate + abs(a.rate_rad_s) * setup.tick_s * setup.ray_reach_m))
    if b.mode == DRIVE:
        gap = fan_gap_m(setup, b_x, b_y, b_sin, b_cos, a_x, a_y) - slack
        if gap <= 0.0:
            return -1.0
        free = min(free, gap / (rate + abs(b.rate_rad_s) * setup.tick_s * setup.ray_reach_m))
    return free


@kernel
def blocks_at(planners: Planners, i: int, j: int, setup: Setup, tick: int) -> bool:
    """Whether a move from ``tick`` of one of the two would end in the other, by their plans.

    The robot of lower index moves first.
    """
    first, second = min(i, j), max(i, j)
    x, y, _ = pose_at(planners, first, setup, tick + 1)
    there_x, there_y, _ = pose_at(planners, second, setup, tick)
    next_x, next_y, _ = pose_at(planners, second, setup, tick + 1)
    touch2 = 4.0 * setup.radius_m * setup.radius_m
    before = (there_x - x) * (there_x - x) + (there_y - y) * (there_y - y)
    after = (next_x - x) * (next_x - x) + (next_y - y) * (next_y - y)
    return bool(min(before, after) < touch2 + 1e-12)


@kernel
def fan_gap_m(
    setup: Setup, x_m: float, y_m: float, sin_h: float, cos_h: float, disc_x_m: float, disc_y_m: float
) -> float:
    """Distance of a disc from the nearest of a robot's rays, each ``look`` long; 0 or less when one meets it."""
    to_x, to_y = disc_x_m - x_m, disc_y_m - y_m
    ahead = to_x * cos_h + to_y * sin_h - setup.ray_forward_m
    left = to_y * cos_h - to_x * sin_h
    nearest2 = math.inf
    for k in range(setup.ray_side_m.size):
        beside = left - setup.ray_side_m[k]
        along = ahead * setup.ray_cos[k] + beside * setup.ray_sin[k]
        along = min(max(along, 0.0), setup.look_m)
        off_x, off_y = ahead - along * setup.ray_cos[k], beside - along * setup.ray_sin[k]
        nearest2 = min(nearest2, off_x * off_x + off_y * off_y)
    return math.sqrt(nearest2) - setup.disc_radius_m
