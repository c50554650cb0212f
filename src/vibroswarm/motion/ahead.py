"""Looking ahead: the first tick at which a wall or another robot might matter to a plan.

Each function gives a tick that is never too late: before it no ray is shorter than theta_c and no move is
blocked. Distances shrink at bounded rates, so from one look it is known for how many ticks there is no need
of another (conservative advancement); what then happens at a tick is decided by the same functions as in
the fixed-step engine.

| name | unit | what it is |
|---|---|---|
| look | m | rays matter up to the shorter of range and theta_c |
| zone | m | nearer than this (two radii and two longest steps), a move may bring two robots into contact |
| sight | m | rays see nothing of a robot further away than this, centre to centre |
| mid, chord | m, m a tick | about where a robot is: mid + chord n after n ticks of its plan; mid is a turn's pivot |
| slack | m | how far beside that it may be |
| gap | m | a distance that must not be used up |
| approach | m a tick | how fast a gap shrinks now |
| swerve | m a tick^2 | how much faster it may shrink with each tick |
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import inlined, inner
from vibroswarm.motion.body import Setup
from vibroswarm.motion.neighbours import how_many, listed
from vibroswarm.motion.plans import (
    Planner,
    Planners,
    along_arc,
    peek,
    place_at,
    pushed_to,
    swung_to,
    turn_command,
)
from vibroswarm.motion.wakes import NEVER
from vibroswarm.robot.walk import DRIVE, STOP

SIDE_TICKS = 128.0
"""A wall, or another robot that is near, is looked at again after so many ticks at most."""

ROUNDING_M = 1e-12
SAG_ROUNDING_M = 1e-9
CONTACT_M = 1e-9
"""Bodies that come nearer than this to touching are looked at as they are."""


@inlined
def prepare_to_look(row: Planner, setup: Setup) -> None:
    """Where about a plan that reaches to its ``own_tick`` takes the robot; a driver's pose there."""
    stand_still(row)
    if row.mode == STOP:
        return
    if row.mode == DRIVE:
        ticks = row.own_tick - row.tick
        x_m, y_m, heading_rad, sin_h, cos_h = along_arc(row, ticks * setup.tick_s)
        row.own_x_m, row.own_y_m, row.own_heading_rad = x_m, y_m, heading_rad
        row.own_sin_h, row.own_cos_h = sin_h, cos_h
        if not row.blocked:
            row.chord_x_m, row.chord_y_m = (x_m - row.x_m) / ticks, (y_m - row.y_m) / ticks
            bend = abs(row.rate_rad_s) * ticks * setup.tick_s
            row.slack_m = row.rate_m * ticks * (bend / 7.0 if bend < 1.0 else 1.0)
    elif not row.blocked:
        row.mid_x_m -= row.radius_m * row.sin_h
        row.mid_y_m += row.radius_m * row.cos_h
        row.slack_m = abs(row.radius_m) + ROUNDING_M


@inlined
def stand_still(row: Planner) -> None:
    """About where a robot is that stays where it is."""
    row.mid_x_m, row.mid_y_m = row.x_m, row.y_m
    row.chord_x_m = row.chord_y_m = row.slack_m = 0.0


@inner
def blocked_ticks(planners: Planners, near: NDArray[np.uint32], i: int, setup: Setup, most: int) -> int:
    """Ticks for which a robot whose move has just been blocked stays blocked, at most ``most``.

    It stands and turns on, by the others' plans. When one of those near changes its plan, it is woken anyway; so it
    is held only by those that stand, or that stay near from now on.
    """
    row = planners[i]
    error_deg, integral_deg_s = row.error_deg, row.integral_deg_s
    gyro_deg = row.turn_gain * turn_command(setup, error_deg, integral_deg_s)
    a_tick = (
        abs(row.wish_m_s * row.rate_rad_s) * setup.tick_s * setup.tick_s
    )  # so far a driver's place shifts
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


@inlined
def maybe_within(row: Planner, x_m: float, y_m: float, distance_m: float, tick: int) -> bool:
    """Whether a robot may be within a distance of a point at ``tick``, by its chord."""
    far = distance_m + row.slack_m
    return bool(apart2(row, x_m, y_m, tick) < far * far)


@inlined
def apart2(row: Planner, x_m: float, y_m: float, tick: int) -> float:
    """Squared distance of a point from where about a robot is at ``tick``, m^2."""
    dx = row.mid_x_m + (tick - row.tick) * row.chord_x_m - x_m
    dy = row.mid_y_m + (tick - row.tick) * row.chord_y_m - y_m
    squared: float = dx * dx + dy * dy
    return squared


@inlined
def wall_tick(row: Planner, setup: Setup) -> int:
    """First tick of the plan, after its own, at which a ray may see a wall or the body come to one, or NEVER."""
    if row.mode == STOP:
        return NEVER
    inset = setup.radius_m + setup.longest_step_m
    if row.mode != DRIVE:
        if row.blocked:  # and stays so
            return NEVER
        near = to_wall_m(setup, row.mid_x_m, row.mid_y_m)
        return NEVER if near - row.slack_m >= inset else turn_at_walls(row, setup)
    far = max(setup.ray_reach_m, inset) + row.slack_m
    left, right = min(row.x_m, row.own_x_m), max(row.x_m, row.own_x_m)
    low, high = min(row.y_m, row.own_y_m), max(row.y_m, row.own_y_m)
    if left >= far and low >= far and right <= setup.width_m - far and high <= setup.height_m - far:
        return NEVER
    return tick_at_walls(row, setup, inset)


@inlined
def to_wall_m(setup: Setup, x_m: float, y_m: float) -> float:
    """How far a point is from the nearest wall, m."""
    return min(min(x_m, setup.width_m - x_m), min(y_m, setup.height_m - y_m))


@inner
def turn_at_walls(row: Planner, setup: Setup) -> int:
    """``wall_tick`` for a robot that turns near walls: the tick at which its pivot would swing its body into one."""
    tick = row.tick + 1
    while tick < row.own_tick and row.rate_m > 0.0:
        x, y = peek(row, setup, tick)
        gap = to_wall_m(setup, x, y) - setup.radius_m - ROUNDING_M
        if gap < row.rate_m:
            x, y = peek(row, setup, tick + 1)
            if to_wall_m(setup, x, y) - setup.radius_m < ROUNDING_M:
                return int(tick)
        tick += max(1, int(gap / row.rate_m))
    return NEVER


@inner
def tick_at_walls(row: Planner, setup: Setup, inset: float) -> int:
    """``wall_tick`` for a driver that comes near walls."""
    left, right, low, high = outline(row, setup, inset, row.x_m, row.y_m, row.sin_h, row.cos_h)
    own_left, own_right, own_low, own_high = outline(
        row, setup, inset, row.own_x_m, row.own_y_m, row.own_sin_h, row.own_cos_h
    )
    # Between both ends a distance is above the straight line by no more than an eighth of how it bends.
    ticks, bend = row.own_tick - row.tick, abs(row.rate_rad_s) * setup.tick_s
    sag = 0.125 * ticks * ticks * bend * (row.rate_m + bend * setup.ray_reach_m) + SAG_ROUNDING_M
    near_left, near_right = min(left, own_left) < sag, max(right, own_right) > setup.width_m - sag
    near_low, near_high = min(low, own_low) < sag, max(high, own_high) > setup.height_m - sag
    if not (near_left or near_right or near_low or near_high):
        return NEVER
    tick, heeds = row.tick + 1, heeds_tick(row, setup)
    while tick <= row.own_tick:
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
def heeds_tick(row: Planner, setup: Setup) -> int:
    """The first tick after its plan's at which a robot that drives heeds its rays: not at once after a turn."""
    if setup.blind_ms <= 0.0:
        return int(row.tick + 1)
    return int(row.tick + 1 + max(0, math.ceil((row.sees_from_ms - row.driven_ms) / setup.tick_ms)))


@inlined
def outline(
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
    most = row.rate_m + abs(bend) * setup.ray_reach_m
    free = side_ticks(distance_m - inset, step * toward, abs(bend) * row.rate_m)
    if not looks:
        return free
    for k in range(setup.ray_side_m.size):
        along = row.ray_forward_m + setup.look_m * setup.ray_cos[k]
        beside = setup.ray_side_m[k] + setup.look_m * setup.ray_sin[k]
        nearer = along * toward - beside * aside
        closing = step * toward - bend * (along * aside + beside * toward)
        free = min(free, side_ticks(distance_m - nearer, closing, abs(bend) * most))
        if setup.outside_m > 0.0:
            along, beside = row.ray_forward_m, setup.ray_side_m[k]
            nearer = along * toward - beside * aside
            closing = step * toward - bend * (along * aside + beside * toward)
            free = min(free, side_ticks(distance_m - nearer - ROUNDING_M, closing, abs(bend) * most))
    return free


@inlined
def side_ticks(gap: float, approach: float, swerve: float) -> float:
    """Ticks before a gap that shrinks by ``approach`` a tick, and by ``swerve`` more each tick, is used up."""
    if gap <= 0.0:
        return 0.0
    below = approach + math.sqrt(approach * approach + 2.0 * swerve * gap)
    return min(2.0 * gap / below, SIDE_TICKS)  # infinite ones too: no branch that would be hard to predict


@inlined
def may_meet(a: Planner, b: Planner, setup: Setup, tick: int) -> bool:
    """Whether the chords of two plans come so near, as long as both last, that a closer look is due.

    One test for the many pairs that do not.
    """
    x = a.mid_x_m - b.mid_x_m - (tick - b.tick) * b.chord_x_m
    y = a.mid_y_m - b.mid_y_m - (tick - b.tick) * b.chord_y_m
    far = setup.zone_m
    if a.mode == DRIVE or b.mode == DRIVE:
        far = max(far, setup.sight_m)
    far += a.slack_m + b.slack_m
    span = min(a.own_tick, b.own_tick) - tick
    dx, dy = a.chord_x_m - b.chord_x_m, a.chord_y_m - b.chord_y_m
    if not comes_within(x, y, dx, dy, span, far):
        return False
    end_x, end_y, slack = x + span * dx, y + span * dy, a.slack_m + b.slack_m
    a_drives, b_drives = a.mode == DRIVE, b.mode == DRIVE
    if a_drives and not passes_by(a, setup, -x, -y, -end_x, -end_y, slack):
        return True
    if b_drives and not passes_by(b, setup, x, y, end_x, end_y, slack):
        return True
    return not (a_drives or b_drives)


@inlined
def passes_by(
    row: Planner, setup: Setup, x: float, y: float, end_x: float, end_y: float, slack: float
) -> bool:
    """Whether another robot stays beside, behind or ahead of all that a driver's rays and body reach, as it drives.

    Seen along the driver's chord the other goes straight; the heading is off it by half of all it turns at most.

    Args:
        x, y, end_x, end_y: where the other is from the driver, in the world's axes, at first and in the end, m.
        slack: how far both may be beside their chords, m.
    """
    turned = 0.5 * abs(row.rate_rad_s) * (row.own_tick - row.tick) * setup.tick_s
    far = slack + max(setup.sight_m, setup.zone_m) * turned
    # All times the chord's length, which is at most ``rate_m``.
    ahead = (max(setup.fan_ahead_m + row.ray_forward_m, setup.zone_m) + far) * row.rate_m
    behind = (min(setup.fan_behind_m + row.ray_forward_m, -setup.zone_m) - far) * row.rate_m
    beside = (max(setup.fan_beside_m, setup.zone_m) + far) * row.rate_m
    on, off = x * row.chord_x_m + y * row.chord_y_m, y * row.chord_x_m - x * row.chord_y_m
    end_on = end_x * row.chord_x_m + end_y * row.chord_y_m
    end_off = end_y * row.chord_x_m - end_x * row.chord_y_m
    return bool(
        (min(on, end_on) > ahead)
        | (max(on, end_on) < behind)
        | (min(off, end_off) > beside)
        | (max(off, end_off) < -beside)
    )


@inlined
def stops_before(a: Planner, b: Planner) -> bool:
    """Whether robot ``a`` stops to sample, as its plan says, while robot ``b`` still moves by its own."""
    return bool((a.last_tick > a.own_tick) & (a.own_tick < b.own_tick) & (b.mode != STOP))


@inlined
def may_pass(a: Planner, b: Planner, setup: Setup) -> bool:
    """``may_meet`` for the time when robot ``a`` stands, having stopped before ``b``."""
    x = a.own_x_m - b.mid_x_m - (a.own_tick - b.tick) * b.chord_x_m
    y = a.own_y_m - b.mid_y_m - (a.own_tick - b.tick) * b.chord_y_m
    far = b.slack_m + (max(setup.zone_m, setup.sight_m) if b.mode == DRIVE else setup.zone_m)
    span = min(a.last_tick, b.own_tick) - a.own_tick
    if not comes_within(x, y, -b.chord_x_m, -b.chord_y_m, span, far):
        return False
    end_x, end_y = x - span * b.chord_x_m, y - span * b.chord_y_m
    return not (b.mode == DRIVE and passes_by(b, setup, x, y, end_x, end_y, b.slack_m))


@inlined
def comes_within(x: float, y: float, dx: float, dy: float, span: int, far: float) -> bool:
    """Whether a point at (x, y) that moves by (dx, dy) a tick comes so near the origin within so many ticks."""
    beyond = x * x + y * y - far * far
    closing = -(x * dx + y * dy)
    # Their least distance, were the chords endless: beyond - closing^2 / speed^2.
    if (beyond > 0.0) & ((closing <= 0.0) | (beyond * (dx * dx + dy * dy) > closing * closing)):
        return False
    x, y = x + span * dx, y + span * dy
    return bool((beyond <= 0.0) | (x * dx + y * dy > 0.0) | (x * x + y * y < far * far))


@inner
def meeting_tick(a: Planner, b: Planner, setup: Setup, tick: int, a_first: bool) -> tuple[int, bool, bool]:
    """First tick after ``tick`` at which one of two robots sees the other or is blocked by it.

    Gives it, and to whom of the two the other matters then. NEVER if it does not come to that as long as both plans
    last.

    Args:
        a_first: whether ``a`` moves before ``b``.
    """
    if a.mode == STOP and b.mode == STOP:
        return NEVER, False, False
    last = min(a.own_tick, b.own_tick)
    reach = 2.0 * setup.radius_m + a.rate_m + b.rate_m
    if a.mode == DRIVE or b.mode == DRIVE:
        reach = max(reach, setup.sight_m)
    roughly = is_turning(a) or is_turning(b)
    now, a_from, b_from = tick + 1, sees_from(a, setup), sees_from(b, setup)
    while now <= last:
        free = apart_ticks(a, b, reach, now)
        if free >= last - now + 1:
            return NEVER, False, False
        if free < 1.0:
            a_looks, b_looks = now >= a_from, now >= b_from
            a_sight, b_sight, contact = clear_ticks(a, b, setup, now, a_first, roughly, a_looks, b_looks)
            free = min(min(a_sight, b_sight), contact)
            if roughly and free < 1.0:
                roughly = not roughly
                continue
            if a_sight <= 0.0 or b_sight <= 0.0:
                return int(now), a_sight <= 0.0, b_sight <= 0.0
            if (
                contact < 1.0
                and now < last
                and blocks_at(a if a_first else b, b if a_first else a, setup, now)
            ):
                return int(now), True, True
            # Who surely sees nothing for so long need not be asked before.
            if a_looks:
                a_from = now + max(1, int(a_sight))
            if b_looks:
                b_from = now + max(1, int(b_sight))
            free = min(min(a_from, b_from) - now, contact)
        now += max(1, int(free))
    return NEVER, False, False


@inner
def passing_tick(a: Planner, b: Planner, standing: Planner, setup: Setup) -> int:
    """``meeting_tick`` for the time when robot ``a`` stands, having stopped before ``b``.

    Args:
        standing: a row that is none of the robots', in STOP, at rest.
    """
    standing.mid_x_m, standing.mid_y_m, standing.own_tick = a.own_x_m, a.own_y_m, a.last_tick
    # Who is first is of no matter, but for a literal Numba would compile it anew.
    tick, _, _ = meeting_tick(standing, b, setup, a.own_tick - 1, a.own_tick < b.own_tick)
    return tick


@inlined
def is_turning(row: Planner) -> bool:
    """Whether a robot turns in place."""
    return bool(row.mode != DRIVE and row.mode != STOP)


@inlined
def sees_from(row: Planner, setup: Setup) -> int:
    """The first tick at which a robot may see another: ``heeds_tick`` of one that drives, NEVER of others."""
    return heeds_tick(row, setup) if row.mode == DRIVE else NEVER


@inlined
def apart_ticks(a: Planner, b: Planner, reach: float, tick: int) -> float:
    """Ticks that surely pass from ``tick`` before the two are within ``reach``, by their chords."""
    x = a.mid_x_m + (tick - a.tick) * a.chord_x_m - b.mid_x_m - (tick - b.tick) * b.chord_x_m
    y = a.mid_y_m + (tick - a.tick) * a.chord_y_m - b.mid_y_m - (tick - b.tick) * b.chord_y_m
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


@inner
def clear_ticks(
    a: Planner,
    b: Planner,
    setup: Setup,
    tick: int,
    a_first: bool,
    roughly: bool,
    a_looks: bool,
    b_looks: bool,
) -> tuple[float, float, float]:
    """Ticks that surely pass before ``a`` sees ``b``, before ``b`` sees ``a``, and before one's move ends in the other.

    0 if one sees the other; below 1 if a move from ``tick`` may end so.

    Args:
        a_first: whether ``a`` moves before ``b``.
        roughly: robots that turn are taken as standing somewhere within their slack, which is mostly enough.
        a_looks, b_looks: whether it is asked what they see: only of those that drive.
    """
    a_x, a_y, a_sin, a_cos = about(a, setup, tick, roughly)
    b_x, b_y, b_sin, b_cos = about(b, setup, tick, roughly)
    slack = creep = swerve = a_step = b_step = a_bend = b_bend = 0.0
    if a.mode == DRIVE:
        a_step, a_bend = a.speed_m_s * setup.tick_s, a.rate_rad_s * setup.tick_s
        swerve += abs(a_bend) * a.rate_m
    elif roughly:
        slack += a.slack_m
    else:
        creep += a.rate_m
    if b.mode == DRIVE:
        b_step, b_bend = b.speed_m_s * setup.tick_s, b.rate_rad_s * setup.tick_s
        swerve += abs(b_bend) * b.rate_m
    elif roughly:
        slack += b.slack_m
    else:
        creep += b.rate_m
    x, y = b_x - a_x, b_y - a_y
    dx, dy = b_step * b_cos - a_step * a_cos, b_step * b_sin - a_step * a_sin
    apart = math.sqrt(x * x + y * y)
    gap, both = apart - 2.0 * setup.radius_m - slack - CONTACT_M, a.rate_m + b.rate_m
    closing = creep - (x * dx + y * dy) / apart
    # The first has moved when the second has not: apart may then be less by its step, as after so many ticks.
    contact = side_ticks(gap - (a.rate_m if a_first else b.rate_m), closing, swerve)
    if contact < 1.0 and gap > 0.0:
        on_x, on_y, beside = x - a_step * a_cos, y - a_step * a_sin, a.rate_m * abs(a_bend)
        if not a_first:
            on_x, on_y, beside = x + b_step * b_cos, y + b_step * b_sin, b.rate_m * abs(b_bend)
        if is_turning(a if a_first else b):
            beside = a.rate_m if a_first else b.rate_m
        on = math.sqrt(on_x * on_x + on_y * on_y)
        contact = side_ticks(gap - apart + on - beside, creep - (on_x * dx + on_y * dy) / on, swerve)
        contact = min(contact, side_ticks(gap, closing, swerve))
    a_sight = b_sight = SIDE_TICKS
    far = apart + SIDE_TICKS * both
    if a_looks:
        spin = abs(a_bend) * (2.0 * both + abs(a_bend) * far)
        a_sight = fan_ticks(
            setup, a.ray_forward_m, a_sin, a_cos, a_bend, x, y, dx, dy, slack, creep, swerve + spin
        )
    if b_looks:
        spin = abs(b_bend) * (2.0 * both + abs(b_bend) * far)
        b_sight = fan_ticks(
            setup, b.ray_forward_m, b_sin, b_cos, b_bend, -x, -y, -dx, -dy, slack, creep, swerve + spin
        )
    return a_sight, b_sight, contact


@inlined
def about(row: Planner, setup: Setup, tick: int, roughly: bool) -> tuple[float, float, float, float]:
    """Where a robot is at a tick of its plan, and the sine and cosine of its heading.

    ``roughly``: one that turns is somewhere about its pivot.
    """
    if row.mode == DRIVE:
        x_m, y_m, _, sin_h, cos_h = along_arc(row, (tick - row.tick) * setup.tick_s)
        return x_m, y_m, sin_h, cos_h
    if roughly or row.mode == STOP:
        return row.mid_x_m, row.mid_y_m, 0.0, 1.0
    x_m, y_m = peek(row, setup, tick)
    return x_m, y_m, 0.0, 1.0


@inner
def fan_ticks(
    setup: Setup, forward_m: float, sin_h: float, cos_h: float, bend: float,
    x_m: float, y_m: float, dx: float, dy: float,
    slack: float, creep: float, swerve: float,
) -> float:  # fmt: skip
    """Ticks that surely pass before a robot's rays, each ``look`` long, see the disc of another; 0 if one does.

    The distance of a point from a ray is convex: it falls by no more than the point's way along its gradient.

    Args:
        bend: rad a tick. x_m, y_m: of the other, seen from the robot. dx, dy: of its motion, m a tick.
        slack: how far the other may be from there. creep: by how much that may grow, m a tick. swerve: how much
            its motion may change, seen from the robot as it turns, m a tick^2.
    """
    ahead, left = x_m * cos_h + y_m * sin_h, y_m * cos_h - x_m * sin_h
    d_ahead = dx * cos_h + dy * sin_h + bend * left
    d_left = dy * cos_h - dx * sin_h - bend * ahead
    ahead -= forward_m
    free = SIDE_TICKS
    for k in range(setup.ray_side_m.size):
        beside = left - setup.ray_side_m[k]
        along = ahead * setup.ray_cos[k] + beside * setup.ray_sin[k]
        along = min(max(along, 0.0), setup.look_m)
        off_x, off_y = ahead - along * setup.ray_cos[k], beside - along * setup.ray_sin[k]
        off = math.sqrt(off_x * off_x + off_y * off_y)
        gap = off - setup.disc_radius_m - slack
        if gap <= 0.0:
            return 0.0
        free = min(free, side_ticks(gap, creep - (off_x * d_ahead + off_y * d_left) / off, swerve))
    return free


@inner
def blocks_at(first: Planner, second: Planner, setup: Setup, tick: int) -> bool:
    """Whether a move from ``tick`` of one of the two would end in the other, by their plans."""
    there_x, there_y, _, _ = about(second, setup, tick, False)
    next_x, next_y, _, _ = about(second, setup, tick + 1, False)
    x, y, _, _ = about(first, setup, tick + 1, False)
    touch2 = 4.0 * setup.radius_m * setup.radius_m
    before = (there_x - x) * (there_x - x) + (there_y - y) * (there_y - y)
    after = (next_x - x) * (next_x - x) + (next_y - y) * (next_y - y)
    return bool(min(before, after) < touch2 + 1e-12)
