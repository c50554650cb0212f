"""Looking ahead on two pieces of plans: when may one robot see the other, or its move end in it (see ``lookahead``)?"""

from __future__ import annotations

import math

from vibroswarm.core.jit import inlined, inner
from vibroswarm.motion.event.event_queue import NEVER
from vibroswarm.motion.event.lookahead import SIDE_TICKS, avoidance_tick, ticks_until_closed
from vibroswarm.motion.event.trajectory import Planner, along_arc, position_in_turn
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE, STOP

CONTACT_M = 1e-9
"""Below this distance from touching, the exact positions decide."""


@inlined
def may_encounter(a: Planner, b: Planner, setup: Setup, tick: int) -> bool:
    """Return whether the chords of two pieces come so close after ``tick``, while both last, that an exact check is
    needed.

    Cheap conservative reject: if False, there is certainly no encounter.
    """
    x = a.mid_x_m + (tick - a.tick) * a.chord_x_m - b.mid_x_m - (tick - b.tick) * b.chord_x_m
    y = a.mid_y_m + (tick - a.tick) * a.chord_y_m - b.mid_y_m - (tick - b.tick) * b.chord_y_m
    bound_m = setup.zone_m
    if a.mode == DRIVE or b.mode == DRIVE:
        bound_m = max(bound_m, setup.sight_m)
    bound_m += a.position_error_m + b.position_error_m
    span = min(a.self_event_tick, b.self_event_tick) - tick
    dx, dy = a.chord_x_m - b.chord_x_m, a.chord_y_m - b.chord_y_m
    if not comes_within(x, y, dx, dy, span, bound_m):
        return False
    end_x, end_y, slack = x + span * dx, y + span * dy, a.position_error_m + b.position_error_m
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
    """Return whether another robot stays beside, behind or ahead of all that a driver's rays and body reach, as it
    drives.

    Relative to the driver, and according to the chords, the other moves on a straight line, so both ends of the line
    decide. The driver's heading differs from its chord by at most half of all it turns.

    Args:
        x, y: position of the other relative to the driver at the beginning, in the world's axes, m.
        end_x, end_y: the same at the end.
        slack: sum of the position errors of the two, m.
    """
    turned = 0.5 * abs(row.rate_rad_s) * (row.self_event_tick - row.tick) * setup.tick_s
    margin = slack + max(setup.sight_m, setup.zone_m) * turned
    # Coordinates along and across the chord are not divided by its length; as that is at most ``max_step_m``,
    # limits multiplied by ``max_step_m`` are safe.
    ahead = (max(setup.fan_ahead_m + row.ray_forward_m, setup.zone_m) + margin) * row.max_step_m
    behind = (min(setup.fan_behind_m + row.ray_forward_m, -setup.zone_m) - margin) * row.max_step_m
    lateral = (max(setup.fan_beside_m, setup.zone_m) + margin) * row.max_step_m
    on, off = x * row.chord_x_m + y * row.chord_y_m, y * row.chord_x_m - x * row.chord_y_m
    end_on = end_x * row.chord_x_m + end_y * row.chord_y_m
    end_off = end_y * row.chord_x_m - end_x * row.chord_y_m
    return bool(
        (min(on, end_on) > ahead)
        | (max(on, end_on) < behind)
        | (min(off, end_off) > lateral)
        | (max(off, end_off) < -lateral)
    )


@inlined
def stops_before(a: Planner, b: Planner) -> bool:
    """Return whether robot ``a`` stops to sample, according to its plan, while robot ``b`` still moves by its own."""
    return bool(
        (a.plan_end_tick > a.self_event_tick) & (a.self_event_tick < b.self_event_tick) & (b.mode != STOP)
    )


@inlined
def comes_within(x: float, y: float, dx: float, dy: float, span: int, far: float) -> bool:
    """Return whether a point that starts at (x, y) and moves by (dx, dy) per tick comes within the distance ``far`` of
    the origin in the next ``span`` ticks."""
    beyond = x * x + y * y - far * far
    closing = -(x * dx + y * dy)
    # On an endless line the smallest squared distance would exceed far^2 by beyond - closing^2 / speed^2.
    if (beyond > 0.0) & ((closing <= 0.0) | (beyond * (dx * dx + dy * dy) > closing * closing)):
        return False
    x, y = x + span * dx, y + span * dy
    return bool((beyond <= 0.0) | (x * dx + y * dy > 0.0) | (x * x + y * y < far * far))


@inner
def encounter_tick(a: Planner, b: Planner, setup: Setup, tick: int, a_first: bool) -> tuple[int, bool, bool]:
    """Find the first tick after ``tick`` at which one of two robots detects the other or is blocked by it.

    Args:
        a_first: whether ``a`` moves before ``b``.

    Returns: the tick, NEVER if nothing happens while both plans last; whether ``a`` is affected; whether ``b`` is.
    """
    if a.mode == STOP and b.mode == STOP:
        return NEVER, False, False
    last = min(a.self_event_tick, b.self_event_tick)
    reach = 2.0 * setup.radius_m + a.max_step_m + b.max_step_m
    if a.mode == DRIVE or b.mode == DRIVE:
        reach = max(reach, setup.sight_m)
    roughly = is_turning(a) or is_turning(b)
    now, a_from, b_from = tick + 1, sees_from(a, setup), sees_from(b, setup)
    while now <= last:
        free = chord_clear_ticks(a, b, reach, now)
        if free >= last - now + 1:
            return NEVER, False, False
        if free < 1.0:
            a_looks, b_looks = now >= a_from, now >= b_from
            a_sight, b_sight, contact = pair_clear_ticks(a, b, setup, now, a_first, roughly, a_looks, b_looks)
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
                return int(now), a.mode != STOP, b.mode != STOP
            # A robot that cannot detect the other until then need not be checked before.
            if a_looks:
                a_from = now + max(1, int(a_sight))
            if b_looks:
                b_from = now + max(1, int(b_sight))
            free = min(min(a_from, b_from) - now, contact)
        now += max(1, int(free))
    return NEVER, False, False


@inlined
def is_turning(row: Planner) -> bool:
    """Return whether a robot turns in place."""
    return bool(row.mode != DRIVE and row.mode != STOP)


@inlined
def sees_from(row: Planner, setup: Setup) -> int:
    """Return the first tick at which a robot may detect another: ``avoidance_tick`` of a driver, else NEVER."""
    return avoidance_tick(row, setup) if row.mode == DRIVE else NEVER


@inlined
def chord_clear_ticks(a: Planner, b: Planner, reach: float, tick: int) -> float:
    """Return a lower bound on the ticks from ``tick`` until the two are within ``reach``, according to their chords: 0
    if they may be now, 1e9 if they never are."""
    x = a.mid_x_m + (tick - a.tick) * a.chord_x_m - b.mid_x_m - (tick - b.tick) * b.chord_x_m
    y = a.mid_y_m + (tick - a.tick) * a.chord_y_m - b.mid_y_m - (tick - b.tick) * b.chord_y_m
    dx, dy = a.chord_x_m - b.chord_x_m, a.chord_y_m - b.chord_y_m
    bound = reach + a.position_error_m + b.position_error_m
    beyond = x * x + y * y - bound * bound
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
def pair_clear_ticks(
    a: Planner,
    b: Planner,
    setup: Setup,
    tick: int,
    a_first: bool,
    roughly: bool,
    a_looks: bool,
    b_looks: bool,
) -> tuple[float, float, float]:
    """Return lower bounds on the ticks before ``a`` detects ``b``, before ``b`` detects ``a``, and before a move of one
    ends in the other.

    The first two are 0 if the one detects the other now; the third is below 1 if a move from ``tick`` may end so.

    Args:
        a_first: whether ``a`` moves before ``b``.
        roughly: whether a turning robot is taken as a point somewhere within ``position_error_m`` of its pivot, which
            is cheaper and mostly precise enough.
        a_looks: whether to compute when ``a`` detects ``b``, for drivers only; else that bound is SIDE_TICKS.
        b_looks: the same for ``b``.
    """
    a_x, a_y, a_sin, a_cos = about(a, setup, tick, roughly)
    b_x, b_y, b_sin, b_cos = about(b, setup, tick, roughly)
    slack = creep = swerve = a_step = b_step = a_bend = b_bend = 0.0
    if a.mode == DRIVE:
        a_step, a_bend = a.speed_m_s * setup.tick_s, a.rate_rad_s * setup.tick_s
        swerve += abs(a_bend) * a.max_step_m
    elif roughly:
        slack += a.position_error_m
    else:
        creep += a.max_step_m
    if b.mode == DRIVE:
        b_step, b_bend = b.speed_m_s * setup.tick_s, b.rate_rad_s * setup.tick_s
        swerve += abs(b_bend) * b.max_step_m
    elif roughly:
        slack += b.position_error_m
    else:
        creep += b.max_step_m
    x, y = b_x - a_x, b_y - a_y
    dx, dy = b_step * b_cos - a_step * a_cos, b_step * b_sin - a_step * a_sin
    apart = math.sqrt(x * x + y * y)
    gap, both = apart - 2.0 * setup.radius_m - slack - CONTACT_M, a.max_step_m + b.max_step_m
    closing = creep - (x * dx + y * dy) / apart
    # When the second moves, the first has already moved: they may be closer by the first's step.
    first_rate = a.max_step_m if a_first else b.max_step_m
    contact = ticks_until_closed(gap - first_rate, closing, swerve)
    if contact < 1.0 and gap > 0.0:
        on_x, on_y, veer = x - a_step * a_cos, y - a_step * a_sin, a.max_step_m * abs(a_bend)
        if not a_first:
            on_x, on_y, veer = x + b_step * b_cos, y + b_step * b_sin, b.max_step_m * abs(b_bend)
        # The step of the first is taken along its heading at ``tick``; a tick later it may differ by ``veer``, and
        # that of a turning robot may have any direction.
        lateral = first_rate if is_turning(a if a_first else b) else veer
        on = math.sqrt(on_x * on_x + on_y * on_y)
        approach = creep + veer - (on_x * dx + on_y * dy) / on
        contact = min(
            ticks_until_closed(gap - apart + on - lateral, approach, swerve),
            ticks_until_closed(gap, closing, swerve),
        )
    a_sight = b_sight = SIDE_TICKS
    reach = apart + SIDE_TICKS * both
    if a_looks:
        spin = abs(a_bend) * (2.0 * both + abs(a_bend) * reach)
        a_sight = ticks_until_seen(
            setup, a.ray_forward_m, a_sin, a_cos, a_bend, x, y, dx, dy, slack, creep, swerve + spin
        )
    if b_looks:
        spin = abs(b_bend) * (2.0 * both + abs(b_bend) * reach)
        b_sight = ticks_until_seen(
            setup, b.ray_forward_m, b_sin, b_cos, b_bend, -x, -y, -dx, -dy, slack, creep, swerve + spin
        )
    return a_sight, b_sight, contact


@inlined
def about(row: Planner, setup: Setup, tick: int, roughly: bool) -> tuple[float, float, float, float]:
    """Return a robot's position at a tick of its plan, m, m, and the sine and cosine of a driver's heading (of others
    always 0 and 1: they use no rays).

    If ``roughly``, the position of a turning robot is its pivot.
    """
    if row.mode == DRIVE:
        x_m, y_m, _, sin_h, cos_h = along_arc(row, (tick - row.tick) * setup.tick_s)
        return x_m, y_m, sin_h, cos_h
    if roughly or row.mode == STOP:
        return row.mid_x_m, row.mid_y_m, 0.0, 1.0
    x_m, y_m = position_in_turn(row, setup, tick)
    return x_m, y_m, 0.0, 1.0


@inner
def ticks_until_seen(
    setup: Setup, forward_m: float, sin_h: float, cos_h: float, bend: float,
    x_m: float, y_m: float, dx: float, dy: float,
    slack: float, creep: float, swerve: float,
) -> float:  # fmt: skip
    """Return a lower bound on the ticks before one of a robot's rays, each ``look`` long, meets the disc of another; 0
    if one does now, at most SIDE_TICKS.

    The distance of a point from a ray is convex: it falls by no more than the point's motion along its gradient.

    Args:
        bend: the robot's turn rate, rad per tick.
        x_m, y_m: position of the other relative to the robot, in the world's axes, m.
        dx, dy: velocity of the other relative to the robot, in the world's axes, m per tick.
        slack: error bound of the position, m.
        creep: how fast that bound may grow, m per tick.
        swerve: bound on the other's acceleration in the frame of the turning robot, m per tick^2.
    """
    ahead, left = x_m * cos_h + y_m * sin_h, y_m * cos_h - x_m * sin_h
    d_ahead = dx * cos_h + dy * sin_h + bend * left
    d_left = dy * cos_h - dx * sin_h - bend * ahead
    ahead -= forward_m
    free = SIDE_TICKS
    for k in range(setup.ray_side_m.size):
        lateral = left - setup.ray_side_m[k]
        along = ahead * setup.ray_cos[k] + lateral * setup.ray_sin[k]
        along = min(max(along, 0.0), setup.look_m)
        off_x, off_y = ahead - along * setup.ray_cos[k], lateral - along * setup.ray_sin[k]
        off = math.sqrt(off_x * off_x + off_y * off_y)
        gap = off - setup.disc_radius_m - slack
        if gap <= 0.0:
            return 0.0
        free = min(free, ticks_until_closed(gap, creep - (off_x * d_ahead + off_y * d_left) / off, swerve))
    return free


@inner
def blocks_at(first: Planner, second: Planner, setup: Setup, tick: int) -> bool:
    """Return whether a move from ``tick`` of one of the two would end in the other, according to their plans.

    ``first`` moves first. Where it ends up is compared with where ``second`` is then, which may block ``first``, and
    with where ``second`` would move to, as ``first`` may block that.
    """
    there_x, there_y, _, _ = about(second, setup, tick, False)
    next_x, next_y, _, _ = about(second, setup, tick + 1, False)
    x, y, _, _ = about(first, setup, tick + 1, False)
    touch2 = 4.0 * setup.radius_m * setup.radius_m
    before = (there_x - x) * (there_x - x) + (there_y - y) * (there_y - y)
    after = (next_x - x) * (next_x - x) + (next_y - y) * (next_y - y)
    return bool(min(before, after) < touch2 + 1e-12)
