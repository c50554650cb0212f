"""The event-driven engine: jumps from event to event, and does at each what the fixed-step engine does there.

An event is a tick at which something may change: a sample falls due; a leg, a turn or a stop ends; a ray may be
shorter than theta_c; or bodies may touch. Robots that wake at a tick (the awake robots) catch up to it, and go
through the same phases as in the fixed-step engine, by the same functions. Then each plans: until which tick will
nothing change? A robot that wakes too early only plans again; none wakes too late. It wakes at
``row.self_event_tick``, its own next event, or at ``row.lookahead_tick``, the first tick at which a wall or another
robot may affect it.

Positions between events are approximated by chords with a bound on the error (``lookahead``); exact positions are
computed only if the chord does not exclude an encounter. A small swarm (at most SMALL_SWARM robots) compares all
pairs; a larger one uses lists of neighbours.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import branching_kernel, inlined, inner
from vibroswarm.motion.control_step import control_one, is_blind, load, rays_to_disc, rays_to_walls, refresh
from vibroswarm.motion.event.event_queue import KEY_BITS, ROBOT_BITS, next_two_wakes, next_wake, set_wake
from vibroswarm.motion.event.lookahead import blocked_ticks, maybe_within, set_chord, set_standing, wall_tick
from vibroswarm.motion.event.neighbours import SMALL_SWARM, insert, store_plan
from vibroswarm.motion.event.pair_lookahead import schedule_encounters
from vibroswarm.motion.event.trajectory import (
    Planners,
    along_arc,
    begin_plan,
    begin_stop,
    block,
    catch_up,
    due_ticks,
    end_stop,
    plan_stop,
    position_at,
    stand_on,
    stops_at,
    ticks_to_sample,
    ticks_to_self_event,
)
from vibroswarm.motion.event.world import World, candidate, candidate_count, is_within, look_around, within2
from vibroswarm.motion.recorder import note_move, write_sample
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE, STOP, looks

HORIZON_TICKS = 250
"""Longest time for which a robot that drives or turns plans ahead: the approximation of longer arcs is poor."""


@branching_kernel
def events(world: World, until: int) -> int:
    """Process all events before the tick ``until``, or until the buffers might overflow; return the tick reached."""
    planners, wakes, record, robots = world.planners, world.wakes, world.record, world.planners.size
    # Numbers of rows in the buffers up to which there is room for the events of one more tick, and for samples at the
    # end.
    last_sample, last_move = record.samples.size - 2 * robots, max(0, record.moves.size - robots)
    while True:
        # The smallest key of the queue and the one after it. A key holds tick and robot in one number.
        key, after = next_two_wakes(wakes, robots)
        tick = key >> KEY_BITS
        if tick >= until:
            break
        if record.filled[0] > last_sample or record.filled[1] > last_move:
            return tick  # the caller empties the buffers and calls again
        if after == key:  # ``next_two_wakes`` has not searched for the second key
            after = next_wake(wakes, robots, key)
        # List the robots that wake at this tick in ``awake``. Those that only begin their planned stop do so at once
        # and are not listed: the next robot overwrites their entry.
        count = 0
        while True:
            world.awake[np.uint64(count)] = key & ROBOT_BITS
            if stops_at(planners[awake_robot(world, count)], world.setup, tick):
                stop(world, awake_robot(world, count), tick)
            else:
                count += 1
            if after >> KEY_BITS > tick:
                break
            key, after = after, next_wake(wakes, robots, after)
        if count == 0:
            continue
        count = wake_neighbours(world, count, tick)
        step(world, count, tick)
        # First, each robot plans as if it were alone. Then blocked robots complete their plans, which depend on the
        # plans of others. At last, encounters are sought, for which all plans are needed.
        blocked = 0
        for k in range(count):
            blocked += plan(world, awake_robot(world, k), tick)
        if blocked > 0:
            plan_blocked(world, count, tick)
        for k in range(count):
            schedule_encounters(world, awake_robot(world, k), tick)
        for k in range(count):
            i = awake_robot(world, k)
            row = planners[i]
            set_wake(wakes, i, min(row.lookahead_tick, row.self_event_tick))
    # No event is left before ``until``. Write the samples before it that are missing (else robots do when they wake).
    for i in range(robots):
        row = planners[i]
        if row.mode == STOP and row.sampled == 0 and row.sample_tick < until:
            sample(world, i)
    return until


@inlined
def awake_robot(world: World, k: int) -> int:
    """Return the number of the ``k``-th awake robot; unsigned indices need no check for negative ones."""
    return np.int64(world.awake[np.uint64(k)])  # type: ignore[return-value]


@inlined
def stop(world: World, i: int, tick: int) -> None:
    """Make robot ``i`` begin the stop that is the second piece of its plan."""
    row, record = world.planners[i], world.record
    begin_stop(row, world.setup, tick)
    if record.moves.size > 0:
        write_move(world, i, tick)
    if world.planners.size <= SMALL_SWARM:
        store_plan(world.places, i, row, world.setup)
    set_wake(world.wakes, i, row.self_event_tick)


@inlined
def wake_neighbours(world: World, count: int, tick: int) -> int:
    """Bring awake robots to ``tick``, wake moving robots that they might now block, and return how many are awake."""
    planners, setup = world.planners, world.setup
    k = 0
    while k < count:
        i = awake_robot(world, k)
        k += 1
        row = planners[i]
        if row.tick == tick:  # this robot has been brought to ``tick`` already
            continue
        if row.mode == STOP:
            if row.sampled == 0 and not row.failed:
                sample(world, i)
            stand_on(row, tick)
        else:
            catch_up(row, setup, tick)
        if look_around(world, i, tick):
            near2 = within2(world.apart, i, setup.zone_m)
            for m in range(candidate_count(planners, world.near, i)):
                if world.apart[i, m + 1] >= near2:
                    continue
                j = candidate(planners, world.near, i, m)
                other = planners[j]
                moving = other.tick != tick and other.mode != STOP
                if moving and is_within(other, row.x_m, row.y_m, setup.zone_m, setup, tick):
                    count += insert(world.awake, count, j)
                    # An inserted robot has shifted the list: begin again, skipping robots that are at ``tick``.
                    k = 0
    return count


@inlined
def sample(world: World, i: int) -> None:
    """Record robot ``i``'s sample at the end of its stop, and draw what changes at a sample (``refresh``)."""
    end_stop(world.planners[i])
    tick = world.planners[i].sample_tick
    write_sample(world.record, world.planners, world.run, i, tick)
    refresh(world.planners, world.setup, world.speeds, world.seed, world.run, i, tick)


@inlined
def step(world: World, count: int, tick: int) -> None:
    """Simulate the awake robots at ``tick``, phase by phase, in the order of their numbers; begin their new plans."""
    planners, setup = world.planners, world.setup
    for k in range(count):
        i = awake_robot(world, k)
        row = planners[i]
        # A driver that wakes before its ``lookahead_tick`` sees nothing: no ray is shorter than theta_c by then.
        unseen = row.mode == DRIVE and row.lookahead_tick > tick
        if unseen or (setup.blind_ms > 0.0 and is_blind(planners, i)):
            row.nearest_mm = math.inf
        elif looks(load(planners, i), setup, row.gyro_deg):
            row.nearest_mm = 1000.0 * nearest_now_m(world, i, tick)
    for k in range(count):
        i = awake_robot(world, k)
        control_one(planners, setup, world.seed, world.run, tick, i)
        begin_plan(planners[i], setup, tick)
    for k in range(count):
        contact_now(world, awake_robot(world, k), tick)
    if world.record.moves.size > 0:
        for k in range(count):
            write_move(world, awake_robot(world, k), tick)


@inlined
def write_move(world: World, i: int, tick: int) -> None:
    """End robot ``i``'s current move and begin another if it does something else from its plan's tick on."""
    record, row = world.record, world.planners[i]
    note_move(
        record.moves, record.under_way, record.filled, world.planners, i, world.setup, world.run, tick,
        row.x_m, row.y_m, row.heading_rad,
    )  # fmt: skip


@inlined
def nearest_now_m(world: World, i: int, tick: int) -> float:
    """Return the shortest of robot ``i``'s rays at ``tick``, m; infinite if nothing is within ``look_m``."""
    planners, setup = world.planners, world.setup
    row = planners[i]
    x, y, reach = row.x_m, row.y_m, setup.ray_reach_m
    shortest_m = math.inf
    if x < reach or y < reach or setup.width_m - x < reach or setup.height_m - y < reach:
        shortest_m = rays_to_walls(setup, row.ray_forward_m, x, y, row.cos_h, row.sin_h)
    if row.clearance_m < setup.sight_m:
        near2 = within2(world.apart, i, setup.sight_m)
        for m in range(candidate_count(planners, world.near, i)):
            if world.apart[i, m + 1] >= near2:
                continue
            other = planners[candidate(planners, world.near, i, m)]
            # A sharper test: with the error of this robot's position, not the largest error in the row of ``apart``.
            if maybe_within(other, x, y, setup.sight_m, tick):
                other_x, other_y = position_at(other, setup, tick)
                disc = rays_to_disc(setup, row.ray_forward_m, x, y, row.cos_h, row.sin_h, other_x, other_y)
                shortest_m = min(shortest_m, disc)
    return shortest_m if shortest_m <= setup.look_m else math.inf


@inlined
def contact_now(world: World, i: int, tick: int) -> None:
    """Block robot ``i``'s move from ``tick`` if the move would end in a wall or in another robot."""
    row, setup = world.planners[i], world.setup
    row.from_x_m, row.from_y_m = row.x_m, row.y_m
    if row.speed_m_s == 0.0:
        return
    # Nearer to a wall than this, the move may end in it.
    inset = setup.radius_m + setup.longest_step_m
    x, y = row.x_m, row.y_m
    at_wall = x < inset or y < inset or setup.width_m - x < inset or setup.height_m - y < inset
    if row.clearance_m < setup.zone_m or at_wall:
        move_or_block(world.planners, world.near, world.apart, i, setup, tick)


@inner
def move_or_block(
    planners: Planners, near: NDArray[np.uint32], apart: NDArray[np.float64], i: int, setup: Setup, tick: int
) -> None:
    """Block robot ``i``'s move from ``tick`` if it would end in a wall or in another robot, else write where it ends.

    This is seldom needed, so it is not inlined, and takes arrays instead of the many of ``World``.
    """
    row = planners[i]
    x, y, _, _, _ = along_arc(row, setup.tick_s)
    r = setup.radius_m
    hit = x < r or y < r or x > setup.width_m - r or y > setup.height_m - r
    near2 = within2(apart, i, setup.zone_m)
    for m in range(candidate_count(planners, near, i)):
        if not hit and apart[i, m + 1] < near2:
            hit = touches_now(planners, i, candidate(planners, near, i, m), setup, tick, x, y)
    if hit:
        block(row)
    else:
        row.from_x_m, row.from_y_m = x, y


@inlined
def touches_now(planners: Planners, i: int, j: int, setup: Setup, tick: int, x_m: float, y_m: float) -> bool:
    """Return whether robot ``i``, after a move from ``tick`` on that ends at (x_m, y_m), would overlap robot ``j``."""
    other = planners[j]
    # Every moving robot close enough to be touched is awake. If it has moved, it is at ``from_x_m``, ``from_y_m``.
    if j < i and other.tick == tick and other.mode != STOP:
        other_x, other_y = other.from_x_m, other.from_y_m
    else:
        other_x, other_y = position_at(other, setup, tick)
    dx, dy = other_x - x_m, other_y - y_m
    return bool(dx * dx + dy * dy < 4.0 * setup.radius_m * setup.radius_m)


@inlined
def plan(world: World, i: int, tick: int) -> int:
    """Plan robot ``i`` to its own next event or one at a wall; return 1 if its move is blocked, else 0."""
    row = world.planners[i]
    # The plan of a moving robot ends at the tick at which it fails, if not before.
    ahead = ticks_to_self_event(row, world.setup, min(HORIZON_TICKS, row.fails_tick - tick))
    if row.blocked:
        # ``plan_blocked`` reads both, also of other blocked robots whose plans are not complete yet.
        row.self_event_tick = tick + ahead
        set_standing(row)
        return 1
    plan_until(world, i, tick, ahead)
    return 0


@inlined
def plan_until(world: World, i: int, tick: int, ahead: int) -> None:
    """Make robot ``i``'s plan last for ``ahead`` ticks; set its chord, and ``lookahead_tick`` by the walls alone."""
    row, setup = world.planners[i], world.setup
    row.self_event_tick = row.plan_end_tick = tick + ahead
    # The stop lasts until the tick after its sample (+ 1), at which the robot wakes. A robot that fails makes no stop.
    is_fit_driver = row.mode == DRIVE and row.self_event_tick < row.fails_tick
    if is_fit_driver and ahead == due_ticks(DRIVE, row.timer_ms, setup):
        row.plan_end_tick += ticks_to_sample(setup, 0) + 1
    set_chord(row, setup)
    if row.plan_end_tick > row.self_event_tick:
        plan_stop(world.stops[i], row)
    if world.planners.size <= SMALL_SWARM:
        store_plan(world.places, i, row, setup)
    row.lookahead_tick = wall_tick(row, setup)


@inner
def plan_blocked(world: World, count: int, tick: int) -> None:
    """Complete the plans of the awake robots whose moves are blocked; all other robots have their plans by now."""
    for k in range(count):
        i = awake_robot(world, k)
        row = world.planners[i]
        if row.blocked:
            most = row.self_event_tick - tick
            plan_until(world, i, tick, blocked_ticks(world.planners, world.near, i, world.setup, most))
