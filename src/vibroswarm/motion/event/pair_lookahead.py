"""Looking ahead on two pieces of plans: the first tick at which one robot may detect the other, or be blocked by it.

Such a tick is called an encounter. ``lookahead`` explains the method and the terms. ``a`` and ``b`` are rows of two
robots, each with one piece of its plan. A robot detects another if one of its rays, ``look_m`` long, meets the
other's disc; only drivers use their rays.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel
from vibroswarm.motion.event.event_queue import NEVER, wake_by
from vibroswarm.motion.event.lookahead import (
    SIDE_TICKS,
    avoidance_tick,
    encounter_reach_m,
    ticks_until_closed,
)
from vibroswarm.motion.event.neighbours import (
    SMALL_SWARM,
    measure_meetings,
    neighbour,
    neighbour_count,
    update_lists,
)
from vibroswarm.motion.event.trajectory import Planner, Planners, along_arc, position_in_turn
from vibroswarm.motion.event.world import World, candidate, candidate_count, within2
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE, STOP

CONTACT_M = 1e-9
"""Bodies nearer to contact than this are compared by their exact positions, m."""


@inlined
def may_encounter(a: Planner, b: Planner, setup: Setup, tick: int) -> bool:
    """Return False if two pieces certainly have no encounter from ``tick`` on, judging by their chords."""
    # (x, y): position of a relative to b at ``tick``; (dx, dy): its change per tick.
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
    return not (a_drives or b_drives)  # if neither drives, they have come within the contact zone


@inlined
def passes_by(
    row: Planner, setup: Setup, x: float, y: float, end_x: float, end_y: float, slack: float
) -> bool:
    """Return whether another robot surely stays out of reach of a driver's rays and body.

    By the chords it moves on a straight line relative to the driver, so both ends on one side of the reach suffice.
    """
    half_turn = 0.5 * abs(row.rate_rad_s) * (row.self_event_tick - row.tick) * setup.tick_s
    # No point of the reach is further from the driver's centre than the ``max`` below, so a deviation of the heading by
    # ``half_turn`` shifts it by at most the product.
    margin = slack + max(setup.sight_m, setup.zone_m) * half_turn
    # on, off: the other robot's coordinates along and across the chord, times the chord's length (a division is saved).
    # That length is at most ``max_step_m``, so the limits are multiplied by ``max_step_m`` to be safe. For a blocked
    # driver, both are 0: no comparison below is true, and so the result is False.
    ahead = (max(setup.fan_ahead_m + row.ray_forward_m, setup.zone_m) + margin) * row.max_step_m
    behind = (min(setup.fan_behind_m + row.ray_forward_m, -setup.zone_m) - margin) * row.max_step_m
    lateral = (max(setup.fan_beside_m, setup.zone_m) + margin) * row.max_step_m
    on, off = x * row.chord_x_m + y * row.chord_y_m, y * row.chord_x_m - x * row.chord_y_m
    end_on = end_x * row.chord_x_m + end_y * row.chord_y_m
    end_off = end_y * row.chord_x_m - end_x * row.chord_y_m
    # ``|`` instead of ``or``, here and below: evaluating all comparisons is faster than branching after each.
    return bool(
        (min(on, end_on) > ahead)
        | (max(on, end_on) < behind)
        | (min(off, end_off) > lateral)
        | (max(off, end_off) < -lateral)
    )


@inlined
def stops_before(a: Planner, b: Planner) -> bool:
    """Return whether, by their plans, robot ``a`` stops to sample while robot ``b`` still moves."""
    return bool(
        (a.plan_end_tick > a.self_event_tick) & (a.self_event_tick < b.self_event_tick) & (b.mode != STOP)
    )


@inlined
def comes_within(x: float, y: float, dx: float, dy: float, span: int, far: float) -> bool:
    """Return whether a point comes within the distance ``far`` of the origin in the next ``span`` ticks."""
    beyond = x * x + y * y - far * far
    closing = -(x * dx + y * dy)
    # If the point moved on for ever, its smallest squared distance would exceed far^2 by beyond - closing^2 / speed^2.
    if (beyond > 0.0) & ((closing <= 0.0) | (beyond * (dx * dx + dy * dy) > closing * closing)):
        return False
    x, y = x + span * dx, y + span * dy
    # The line passes within ``far``. The point does so in time if it starts there, if it moves away from the origin at
    # the end (it has passed the nearest point of the line), or if it ends there.
    return bool((beyond <= 0.0) | (x * dx + y * dy > 0.0) | (x * x + y * y < far * far))


@inner
def encounter_tick(a: Planner, b: Planner, setup: Setup, tick: int, a_first: bool) -> tuple[int, bool, bool]:
    """Return the first tick after ``tick`` at which one of two robots may affect the other, or NEVER; which is
    affected."""
    if a.mode == STOP and b.mode == STOP:
        return NEVER, False, False
    last = min(a.self_event_tick, b.self_event_tick)
    # Robots that are further apart than ``reach`` neither touch at the end of their next moves nor detect each other.
    reach = 2.0 * setup.radius_m + a.max_step_m + b.max_step_m
    if a.mode == DRIVE or b.mode == DRIVE:
        reach = max(reach, setup.sight_m)
    # First a turning robot is taken as its pivot; its exact position is used once that is not enough.
    roughly = is_turning(a) or is_turning(b)
    # a_from, b_from: the first tick at which the robot may detect the other one, as far as is known.
    now, a_from, b_from = tick + 1, sees_from(a, setup), sees_from(b, setup)
    # Check the tick ``now``, then go on to the next tick at which there may be an encounter. Rays are checked at the
    # tick ``last`` too, as the search on the next plan begins a tick later.
    while now <= last:
        free = chord_clear_ticks(a, b, reach, now)  # number of ticks in which there is no encounter
        if free >= last - now + 1:
            return NEVER, False, False
        if free < 1.0:
            a_looks, b_looks = now >= a_from, now >= b_from
            a_sight, b_sight, contact = pair_clear_ticks(a, b, setup, now, a_first, roughly, a_looks, b_looks)
            free = min(min(a_sight, b_sight), contact)
            if roughly and free < 1.0:
                roughly = not roughly  # False: check ``now`` again, and later ticks, with exact positions
                continue
            if a_sight <= 0.0 or b_sight <= 0.0:
                return int(now), a_sight <= 0.0, b_sight <= 0.0
            # A move that begins at ``last`` belongs to the next plan.
            if (
                contact < 1.0
                and now < last
                and blocks_at(a if a_first else b, b if a_first else a, setup, now)
            ):
                # A standing robot makes no move that could be blocked, so it is not affected.
                return int(now), a.mode != STOP, b.mode != STOP
            # The bounds also show until which tick the rays of each robot need not be checked again.
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
    """Return the first tick at which a robot may detect another: ``avoidance_tick`` of a driver, NEVER of others."""
    return avoidance_tick(row, setup) if row.mode == DRIVE else NEVER


@inlined
def chord_clear_ticks(a: Planner, b: Planner, reach: float, tick: int) -> float:
    """Return a lower bound on the ticks from ``tick`` until two robots are within the distance ``reach``, m."""
    # (x, y): position of a relative to b at ``tick``; (dx, dy): its change per tick.
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
    # The smaller root t of beyond - 2 closing t + speed^2 t^2 = 0, in the form without cancellation.
    speed2 = dx * dx + dy * dy
    discriminant = closing * closing - speed2 * beyond
    if discriminant < 0.0:
        return 1e9
    return beyond / (closing + math.sqrt(discriminant))


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
    """Return lower bounds on the ticks until ``a`` detects ``b``, until ``b`` detects ``a``, and until they touch.

    The third is below 1 if a move that begins at ``tick`` may end in the other robot. ``roughly``: a turning robot is
    taken as a point within ``position_error_m`` of its pivot, which is cheaper.
    """
    # step, bend: a driver's way (m) and angle (rad) in a tick. slack: bound on the error of the positions, m. creep:
    # bound on how fast turning robots, whose directions are not computed, come nearer, m per tick.
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
    # Position and velocity (per tick) of b relative to a.
    x, y = b_x - a_x, b_y - a_y
    dx, dy = b_step * b_cos - a_step * a_cos, b_step * b_sin - a_step * a_sin
    apart = math.sqrt(x * x + y * y)
    gap = apart - 2.0 * setup.radius_m - slack - CONTACT_M
    fastest = a.max_step_m + b.max_step_m  # bound on the relative speed, m per tick
    closing = creep - (x * dx + y * dy) / apart
    # When the second robot moves, the first one has moved already: they may be closer by the first one's step.
    first_step = a.max_step_m if a_first else b.max_step_m
    contact = ticks_until_closed(gap - first_step, closing, swerve)
    if contact < 1.0 and gap > 0.0:
        # This bound is coarse: take the direction of the first one's step into account. (on_x, on_y): position of b
        # relative to a after that step.
        on_x, on_y, veer = x - a_step * a_cos, y - a_step * a_sin, a.max_step_m * abs(a_bend)
        if not a_first:
            on_x, on_y, veer = x + b_step * b_cos, y + b_step * b_sin, b.max_step_m * abs(b_bend)
        # The step of the first robot is taken along its heading at ``tick``. A tick later a driver's step may differ by
        # ``veer``; the step of a turning robot, left out of (on_x, on_y), may have any direction. ``lateral``: bound on
        # the error of (on_x, on_y) that this causes.
        lateral = first_step if is_turning(a if a_first else b) else veer
        on = math.sqrt(on_x * on_x + on_y * on_y)
        approach = creep + veer - (on_x * dx + on_y * dy) / on
        # Either the first one's step ends in the second one, which has not moved yet (at the distance ``on`` instead of
        # ``apart``); or the second one's step ends in the first one, when both have moved.
        contact = min(
            ticks_until_closed(gap - apart + on - lateral, approach, swerve),
            ticks_until_closed(gap, closing, swerve),
        )
    a_sight = b_sight = SIDE_TICKS
    reach = apart + SIDE_TICKS * fastest  # largest distance between the two within SIDE_TICKS
    # spin: bound on the other robot's acceleration in the frame of the robot that looks, as that frame turns: twice the
    # turn rate times the relative speed (Coriolis), and the turn rate squared times the distance (centrifugal).
    if a_looks:
        spin = abs(a_bend) * (2.0 * fastest + abs(a_bend) * reach)
        a_sight = ticks_until_seen(
            setup, a.ray_forward_m, a_sin, a_cos, a_bend, x, y, dx, dy, slack, creep, swerve + spin
        )
    if b_looks:
        spin = abs(b_bend) * (2.0 * fastest + abs(b_bend) * reach)
        b_sight = ticks_until_seen(
            setup, b.ray_forward_m, b_sin, b_cos, b_bend, -x, -y, -dx, -dy, slack, creep, swerve + spin
        )
    return a_sight, b_sight, contact


@inlined
def about(row: Planner, setup: Setup, tick: int, roughly: bool) -> tuple[float, float, float, float]:
    """Return a robot's position at a tick, m, m, and sine and cosine of its heading; 0 and 1 if it does not drive."""
    if row.mode == DRIVE:
        x_m, y_m, _, sin_h, cos_h = along_arc(row, (tick - row.tick) * setup.tick_s)
        return x_m, y_m, sin_h, cos_h
    if roughly or row.mode == STOP:  # the stop that ends a plan has its position in mid only (``plan_stop``)
        return row.mid_x_m, row.mid_y_m, 0.0, 1.0
    x_m, y_m = position_in_turn(row, setup, tick)
    return x_m, y_m, 0.0, 1.0


@inner
def ticks_until_seen(
    setup: Setup, forward_m: float, sin_h: float, cos_h: float, bend: float,
    x_m: float, y_m: float, dx: float, dy: float,
    slack: float, creep: float, swerve: float,
) -> float:  # fmt: skip
    """Return a lower bound on the ticks until one of a robot's rays meets another robot's disc, at most SIDE_TICKS.

    The distance of a point from a ray is convex, so while the point moves it falls by no more than its gradient says.
    ``bend`` is in rad per tick; ``dx``, ``dy`` and ``creep`` in m per tick; ``swerve`` in m per tick^2.
    """
    # The other robot's position and velocity in the frame of this one.
    ahead, left = x_m * cos_h + y_m * sin_h, y_m * cos_h - x_m * sin_h
    d_ahead = dx * cos_h + dy * sin_h + bend * left
    d_left = dy * cos_h - dx * sin_h - bend * ahead
    ahead -= forward_m
    free = SIDE_TICKS
    for k in range(setup.ray_side_m.size):
        # (off_x, off_y): from the nearest point of the ray to the other robot.
        lateral = left - setup.ray_side_m[k]
        along = ahead * setup.ray_cos[k] + lateral * setup.ray_sin[k]
        along = min(max(along, 0.0), setup.look_m)
        off_x, off_y = ahead - along * setup.ray_cos[k], lateral - along * setup.ray_sin[k]
        off = math.sqrt(off_x * off_x + off_y * off_y)
        gap = off - setup.disc_radius_m - slack
        if gap <= 0.0:
            return 0.0
        # ``off`` is above 0 here, since ``gap`` is.
        free = min(free, ticks_until_closed(gap, creep - (off_x * d_ahead + off_y * d_left) / off, swerve))
    return free


@inner
def blocks_at(first: Planner, second: Planner, setup: Setup, tick: int) -> bool:
    """Return whether the move of one of two robots at ``tick`` ends in the other; ``first`` moves before ``second``."""
    # False: at exact positions, also of turning robots. Sine and cosine are not needed.
    there_x, there_y, _, _ = about(second, setup, tick, False)
    next_x, next_y, _, _ = about(second, setup, tick + 1, False)
    x, y, _, _ = about(first, setup, tick + 1, False)
    touch2_m2 = 4.0 * setup.radius_m * setup.radius_m  # squared distance of centres at contact
    before = (there_x - x) * (there_x - x) + (there_y - y) * (there_y - y)
    after = (next_x - x) * (next_x - x) + (next_y - y) * (next_y - y)
    # The 1e-12 m^2 allow for rounding: waking the robots needlessly is harmless, missing a contact is not.
    return bool(min(before, after) < touch2_m2 + 1e-12)


STANDS_FIRST: Final[bool] = np.bool_(True)  # type: ignore[assignment]
"""The argument ``a_first`` for a robot that stands: it counts as moving first, as the bound on contact allows for the
step of the first robot (``pair_lookahead.pair_clear_ticks``), which is then 0. It is not a Python literal, for which
Numba would compile the called function once more."""


@inlined
def schedule_encounters(world: World, i: int, tick: int) -> None:
    """Schedule the first tick after ``tick`` at which robot ``i`` and another robot could sense or touch each other."""
    planners, setup = world.planners, world.setup
    row = planners[i]
    reach_m = encounter_reach_m(row, setup, tick)
    if reach_m < row.clearance_m:  # all other robots are too far away
        return
    # Robots whose entry in ``apart`` is above ``limit`` are excluded.
    limit = within2(world.apart, i, reach_m)
    if planners.size <= SMALL_SWARM:
        # Replace the squared distances in ``apart`` by margins; a margin above 0 excludes an encounter.
        limit = 0.0
        measure_meetings(world.places, world.apart, planners.size, i, row, setup, tick)
    for m in range(candidate_count(planners, world.near, i)):
        if world.apart[i, m + 1] > limit:  # entry 0 of the row is the error of the distances
            continue
        j = candidate(planners, world.near, i, m)
        other = planners[j]
        if other.tick == tick and other.mode != STOP and j < i:
            # Robot j is awake too, and has scheduled its encounters with robot i already. (Not so a robot in mode STOP
            # that has just begun its planned stop: ``engine.stop`` schedules nothing.)
            continue
        schedule_pair(world, i, j, tick)


@inlined
def schedule_pair(world: World, i: int, j: int, tick: int) -> None:
    """Schedule the first encounter of robots ``i`` and ``j`` after ``tick`` in each pair of pieces of their plans."""
    a, b = world.planners[i], world.planners[j]
    if may_encounter(a, b, world.setup, tick):
        # Robots move in the order of their numbers: robot i is first if i < j.
        schedule(world.planners, world.wakes, a, b, i, j, world.setup, tick, i < j)
    if stops_before(a, b):
        schedule_stop(world, i, j)
    if stops_before(b, a):
        schedule_stop(world, j, i)


@inlined
def schedule_stop(world: World, i: int, j: int) -> None:
    """Schedule the first encounter of robot ``j``, while it moves, with robot ``i`` in the stop that ends its plan."""
    a, b = world.stops[i], world.planners[j]
    if may_encounter(a, b, world.setup, a.tick):
        schedule(world.planners, world.wakes, a, b, i, j, world.setup, a.tick, STANDS_FIRST)


@inner
def schedule(
    planners: Planners, wakes: NDArray[np.int64], a: Planner, b: Planner, i: int, j: int, setup: Setup, tick: int,
    a_first: bool,
) -> None:  # fmt: skip
    """Schedule the first tick after ``tick`` at which two robots may affect each other."""
    encounter, affects_i, affects_j = encounter_tick(a, b, setup, tick, a_first)
    if affects_i:
        wake_no_later_than(planners, wakes, i, encounter)
    if affects_j:
        wake_no_later_than(planners, wakes, j, encounter)


@inlined
def wake_no_later_than(planners: Planners, wakes: NDArray[np.int64], i: int, tick: int) -> None:
    """Make robot ``i`` wake at ``tick`` at the latest, since another robot may affect it then."""
    row = planners[i]
    if tick < row.lookahead_tick:
        row.lookahead_tick = tick
        wake_by(wakes, i, tick)


@kernel
def new_lists(world: World, grid: NDArray[np.int64], radius_m: float, tick: int) -> None:
    """Update the neighbour lists of a large swarm at ``tick``, and schedule the encounters of all neighbours."""
    update_lists(world.planners, world.near, grid, world.setup, radius_m, tick)
    for i in range(world.planners.size):
        for m in range(neighbour_count(world.near, i)):
            j = neighbour(world.near, i, m)
            if j > i:
                schedule_pair(world, i, j, tick - 1)  # encounters from ``tick`` on
