"""The event-driven engine: jumps from event to event, and does at each what the fixed-step engine does there.

An event is a tick at which something may change: a sample falls due, a leg, a turn or a stop ends, a ray may be
shorter than theta_c, or bodies may touch. Robots sleep until their next event. Those that wake at a tick catch up to
it and go through the same phases by the same functions as in the fixed-step engine: sense, control, contact, sample.
Then they plan: until when will nothing change? A robot that wakes too early only plans again; none wakes too late.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import branching_kernel, entry_for, inlined, inner, kernel, zero_rows
from vibroswarm.motion.control_step import control_one, is_blind, load, rays_to_disc, rays_to_walls, refresh
from vibroswarm.motion.event.event_queue import (
    KEY_BITS,
    NEVER,
    ROBOT_BITS,
    all_wake,
    next_two_wakes,
    next_wake,
    set_wake,
    wake_by,
)
from vibroswarm.motion.event.lookahead import (
    blocked_ticks,
    distance2_m2,
    encounter_reach_m,
    maybe_within,
    set_chord,
    set_standing,
    wall_tick,
)
from vibroswarm.motion.event.neighbours import (
    LIST_TICKS,
    PLACES,
    SMALL_SWARM,
    Places,
    empty_grid,
    empty_lists,
    insert,
    list_radius_m,
    measure_all,
    measure_meetings,
    neighbour,
    neighbour_count,
    store_plan,
    update_lists,
)
from vibroswarm.motion.event.pair_lookahead import encounter_tick, may_encounter, stops_before
from vibroswarm.motion.event.trajectory import (
    PLANNER,
    Planner,
    Planners,
    along_arc,
    begin_plan,
    begin_stop,
    block,
    catch_up,
    due_ticks,
    end_stop,
    plan_stop,
    pose_at,
    position_at,
    stand_on,
    stops_at,
    ticks_to_sample,
    ticks_to_self_event,
    turn_command,
    turned_by,
)
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.kernel_run import KernelRun, batch_of, no_sample_before_plans
from vibroswarm.motion.moves import note_move
from vibroswarm.motion.recorder import END_ROW, Record, room_for, write_sample, write_segment
from vibroswarm.motion.robot_params import Setup
from vibroswarm.motion.source import Source, register
from vibroswarm.robot.walk import DRIVE, STOP, looks

HORIZON_TICKS = 250
"""No plan is longer: a longer one would be hard to look ahead on."""

STANDS_FIRST: Final[bool] = np.bool_(True)  # type: ignore[assignment]
"""A robot that stands counts as moving first; as a number: Numba would compile a callee anew for a literal."""

ROOM_TICKS = 2 * (HORIZON_TICKS + 2)
"""Rows a robot may write between two checks of the buffers: two turns, tick by tick."""


class World(NamedTuple):
    """All that the engine works on; compiled functions take it as one argument."""

    planners: Planners
    """The robots, each with the piece of its plan that is under way, (robots,)."""
    stops: Planners
    """The stop that ends a robot's plan, if it drives up to a sample: the second piece, (robots,)."""
    wakes: NDArray[np.int64]
    """When each robot wakes next (``event_queue``)."""
    near: NDArray[np.uint32]
    """Lists of neighbours (``neighbours``)."""
    places: Places
    """Approximate positions of a small swarm, in columns (``neighbours.Places``)."""
    apart: NDArray[np.float64]
    """One row per robot: the largest error of its distances, m, then their squares, m^2 (``look_around``)."""
    awake: NDArray[np.uint32]
    """The robots awake at this tick, in index order."""
    setup: Setup
    speeds: NDArray[np.float64]
    record: Record
    seed: int
    run: int


@branching_kernel
def events(world: World, until: int) -> int:
    """Process events up to the tick ``until``, or while the buffers suffice; return the tick reached."""
    planners, wakes, record, robots = world.planners, world.wakes, world.record, world.planners.size
    last_sample, last_segment, last_move = room_for(record, ROOM_TICKS * robots, robots)
    while True:
        key, after = next_two_wakes(wakes, robots)
        tick = key >> KEY_BITS
        if tick >= until:
            break
        if record.filled[0] > last_sample or record.filled[1] > last_segment or record.filled[2] > last_move:
            return tick
        if after == key:
            after = next_wake(wakes, robots, key)
        count = 0
        while True:
            world.awake[count] = key & ROBOT_BITS
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
    for i in range(robots):
        row = planners[i]
        if row.mode == STOP and row.sampled == 0 and row.sample_tick < until:
            sample(world, i)
        if record.segments.size > 0:
            write_turn(record, row, i, world.setup, world.run, until)
    return until


@inlined
def awake_robot(world: World, k: int) -> int:
    """Return the ``k``-th awake robot. The list is unsigned, so that no index can count from the end."""
    return np.int64(world.awake[k])  # type: ignore[return-value]


@inlined
def stop(world: World, i: int, tick: int) -> None:
    """Stop robot ``i`` to sample. The stop was in its plan, so all others have already looked ahead on it."""
    row, record = world.planners[i], world.record
    begin_stop(row, world.setup, tick)
    if record.segments.size > 0:
        write_segment(record, world.run, i, tick, (row.x_m, row.y_m, row.heading_rad), 0.0, 0.0, STOP)
    if record.moves.size > 0:
        write_move(world, i, tick)
    if world.planners.size <= SMALL_SWARM:
        store_plan(world.places, i, row, world.setup)
    set_wake(world.wakes, i, row.self_event_tick)


@inlined
def wake_neighbours(world: World, count: int, tick: int) -> int:
    """Bring the awake robots to ``tick``, and with them all moving robots so close that a new plan might block them.

    Robots that stand have sampled at the tick before. Returns the number of awake robots, which stay in index order."""
    planners, setup = world.planners, world.setup
    k = 0
    while k < count:
        i = awake_robot(world, k)
        k += 1
        row = planners[i]
        if row.tick == tick:
            continue
        if row.mode == STOP:
            if row.sampled == 0 and not row.failed:
                sample(world, i)
            stand_on(row, tick)
        else:
            if world.record.segments.size > 0:
                write_turn(world.record, row, i, setup, world.run, tick)
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
                    k = 0  # the list has shifted; robots already at ``tick`` are skipped
    return count


@inlined
def is_within(row: Planner, x_m: float, y_m: float, distance_m: float, setup: Setup, tick: int) -> bool:
    """Return whether a robot is within ``distance_m`` of a point at ``tick``.

    Its exact position is computed only if the chord does not exclude it.
    """
    if not maybe_within(row, x_m, y_m, distance_m, tick):
        return False
    there_x, there_y = position_at(row, setup, tick)
    dx, dy = there_x - x_m, there_y - y_m
    return bool(dx * dx + dy * dy < distance_m * distance_m)


@inlined
def look_around(world: World, i: int, tick: int) -> bool:
    """Return whether another body may be close enough to touch robot ``i``.

    Fills robot ``i``'s row of ``apart``: the largest error of the distances, m, then their squares, m^2, to all
    robots or to those on its list.
    """
    row = world.planners[i]
    row.mid_x_m, row.mid_y_m = row.x_m, row.y_m
    if world.planners.size <= SMALL_SWARM:
        nearest2, error = measure_all(
            world.places, world.apart, world.planners.size, i, row.x_m, row.y_m, tick
        )
    else:
        nearest2, error = measure_listed(world.planners, world.near, world.apart, i, tick)
    world.apart[i, 0] = error
    row.clearance_m = math.sqrt(nearest2) - error
    return bool(row.clearance_m < world.setup.zone_m)


@inlined
def candidate_count(planners: Planners, near: NDArray[np.uint32], i: int) -> int:
    """Return the number of distances in robot ``i``'s row of ``apart``."""
    return planners.size if planners.size <= SMALL_SWARM else neighbour_count(near, i)


@inlined
def candidate(planners: Planners, near: NDArray[np.uint32], i: int, m: int) -> int:
    """Return the robot to which distance ``m`` in robot ``i``'s row of ``apart`` belongs."""
    return m if planners.size <= SMALL_SWARM else neighbour(near, i, m)


@inlined
def within2(apart: NDArray[np.float64], i: int, distance_m: float) -> float:
    """Return a threshold for robot ``i``'s row of ``apart``, m^2: a robot whose entry is not below it is certainly not
    within ``distance_m``."""
    bound_m = distance_m + apart[i, 0]
    return float(bound_m * bound_m)


@inner
def measure_listed(
    planners: Planners, near: NDArray[np.uint32], apart: NDArray[np.float64], i: int, tick: int
) -> tuple[float, float]:
    """Write the squared distances to robot ``i``'s neighbours into ``apart[i, 1:]``; return the smallest, m^2 (infinite
    without neighbours), and the largest position error, m."""
    row = planners[i]
    nearest2, error = math.inf, 0.0
    for m in range(neighbour_count(near, i)):
        other = planners[neighbour(near, i, m)]
        apart[i, m + 1] = distance2_m2(other, row.x_m, row.y_m, tick)
        nearest2 = min(nearest2, apart[i, m + 1])
        error = max(error, other.position_error_m)
    return nearest2, error


@inlined
def sample(world: World, i: int) -> None:
    """Take robot ``i``'s sample at the end of its stop.

    This runs when the robot wakes a tick later, or when ``events`` ends: nothing needs the sample before.
    """
    end_stop(world.planners[i])
    tick = world.planners[i].sample_tick
    write_sample(world.record, world.planners, world.run, i, tick)
    refresh(world.planners, world.setup, world.speeds, world.seed, world.run, i, tick)


@inlined
def step(world: World, count: int, tick: int) -> None:
    """Simulate the awake robots at ``tick``, phase by phase, in index order."""
    planners, setup, record, run = world.planners, world.setup, world.record, world.run
    for k in range(count):
        i = awake_robot(world, k)
        row = planners[i]
        # Before ``lookahead_tick`` no ray is shorter than theta_c.
        unseen = row.mode == DRIVE and row.lookahead_tick > tick
        if unseen or (setup.blind_ms > 0.0 and is_blind(planners, i)):
            row.nearest_mm = math.inf
        elif looks(load(planners, i), setup, row.gyro_deg):
            row.nearest_mm = 1000.0 * nearest_now_m(world, i, tick)
    for k in range(count):
        i = awake_robot(world, k)
        control_one(planners, setup, world.seed, run, tick, i)
        begin_plan(planners[i], setup, tick)
    for k in range(count):
        contact_now(world, awake_robot(world, k), tick)
    if record.segments.size > 0:
        for k in range(count):
            i = awake_robot(world, k)
            row = planners[i]
            pose = (row.x_m, row.y_m, row.heading_rad)
            write_segment(record, run, i, tick, pose, row.speed_m_s, row.rate_rad_s, row.mode)
    if record.moves.size > 0:
        for k in range(count):
            write_move(world, awake_robot(world, k), tick)


@inlined
def write_move(world: World, i: int, tick: int) -> None:
    """Call ``note_move`` for a robot at its plan's tick."""
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
            if maybe_within(other, x, y, setup.sight_m, tick):
                other_x, other_y = position_at(other, setup, tick)
                disc = rays_to_disc(setup, row.ray_forward_m, x, y, row.cos_h, row.sin_h, other_x, other_y)
                shortest_m = min(shortest_m, disc)
    return shortest_m if shortest_m <= setup.look_m else math.inf


@inlined
def contact_now(world: World, i: int, tick: int) -> None:
    """Block robot ``i``'s move from ``tick`` if it would end in a wall or a body.

    Robots before ``i`` have moved already (those that could be touched are awake), those after it have not.
    """
    row, setup = world.planners[i], world.setup
    row.from_x_m, row.from_y_m = row.x_m, row.y_m  # where it is at the next tick if nobody is near
    if row.speed_m_s == 0.0:
        return
    inset = setup.radius_m + setup.longest_step_m
    x, y = row.x_m, row.y_m
    at_wall = x < inset or y < inset or setup.width_m - x < inset or setup.height_m - y < inset
    if row.clearance_m < setup.zone_m or at_wall:
        move_or_block(world.planners, world.near, world.apart, i, setup, tick)


@inner
def move_or_block(
    planners: Planners, near: NDArray[np.uint32], apart: NDArray[np.float64], i: int, setup: Setup, tick: int
) -> None:
    """Compute ``contact_now`` for a robot close to a wall or a body.

    This is a real call, not inlined; it takes arrays instead of ``World`` to have few arguments."""
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
    """Return whether robot ``i``, moved from ``tick`` to (x, y), would overlap robot ``j``.

    Robots that are awake move in the order of their numbers.
    """
    other = planners[j]
    # An awake robot with a lower index has moved already: ``from_x_m`` and ``from_y_m`` hold where it ends up.
    if j < i and other.tick == tick and other.mode != STOP:
        other_x, other_y = other.from_x_m, other.from_y_m
    else:
        other_x, other_y = position_at(other, setup, tick)
    dx, dy = other_x - x_m, other_y - y_m
    return bool(dx * dx + dy * dy < 4.0 * setup.radius_m * setup.radius_m)


@inner
def write_turn(record: Record, row: Planner, i: int, setup: Setup, run: int, until: int) -> None:
    """Write the further segments of a turn, one for each tick before ``until`` at which its command changes."""
    if row.mode == STOP or row.mode == DRIVE:
        return
    error_deg, integral_deg_s = row.error_deg, row.integral_deg_s
    before = turn_command(setup, error_deg, integral_deg_s)
    for tick in range(row.tick + 1, until):
        error_deg -= row.turn_gain * before
        integral_deg_s += error_deg * setup.tick_ms / 1000.0
        command = turn_command(setup, error_deg, integral_deg_s)
        if command != before and tick > row.written_tick:
            x_m, y_m, heading, _, _ = turned_by(row, row.error_deg - error_deg)
            rate = math.radians(row.turn_gain * command) / setup.tick_s
            speed_m_s = 0.0 if row.blocked else row.radius_m * rate
            write_segment(record, run, i, tick, (x_m, y_m, heading), speed_m_s, rate, row.mode)
        before = command
    row.written_tick = until - 1


@inlined
def plan(world: World, i: int, tick: int) -> int:
    """Plan robot ``i`` up to the next event that it can predict alone: its own next event, or a wall.

    Returns 1 if its move is blocked, which ``plan_blocked`` then deals with, else 0.
    """
    row = world.planners[i]
    ahead = ticks_to_self_event(row, world.setup, min(HORIZON_TICKS, row.fails_tick - tick))
    if row.blocked:
        row.self_event_tick = tick + ahead
        set_standing(row)
        return 1
    plan_until(world, i, tick, ahead)
    return 0


@inlined
def plan_until(world: World, i: int, tick: int, ahead: int) -> None:
    """Make robot ``i``'s plan last for ``ahead`` ticks, plus the stop if it then stops to sample; set its chord and the
    tick at which a wall may matter."""
    row, setup = world.planners[i], world.setup
    row.self_event_tick = row.plan_end_tick = tick + ahead
    is_due = ahead == due_ticks(DRIVE, row.timer_ms, setup)
    if row.mode == DRIVE and is_due and row.self_event_tick < row.fails_tick:
        row.plan_end_tick += ticks_to_sample(setup, 0) + 1
    set_chord(row, setup)
    if row.plan_end_tick > row.self_event_tick:
        plan_stop(world.stops[i], row)
    if world.planners.size <= SMALL_SWARM:
        store_plan(world.places, i, row, setup)
    row.lookahead_tick = wall_tick(row, setup)


@inner
def plan_blocked(world: World, count: int, tick: int) -> None:
    """Plan the awake robots whose moves are blocked, after all others have plans and positions.

    Two robots that block each other stay while both are blocked: the first that moves on wakes the other."""
    for k in range(count):
        i = awake_robot(world, k)
        row = world.planners[i]
        if row.blocked:
            most = row.self_event_tick - tick
            plan_until(world, i, tick, blocked_ticks(world.planners, world.near, i, world.setup, most))


@inlined
def schedule_encounters(world: World, i: int, tick: int) -> None:
    """Schedule the first tick at which robot ``i`` and a neighbour could sense or touch each other."""
    planners, setup = world.planners, world.setup
    row = planners[i]
    reach_m = encounter_reach_m(row, setup, tick)
    if reach_m < row.clearance_m:
        return
    reach2_m2 = within2(world.apart, i, reach_m)
    if planners.size <= SMALL_SWARM:
        reach2_m2 = 0.0  # ``apart`` now holds margins instead of squared distances: above 0, no encounter
        measure_meetings(world.places, world.apart, planners.size, i, row, setup, tick)
    for m in range(candidate_count(planners, world.near, i)):
        if world.apart[i, m + 1] > reach2_m2:
            continue
        j = candidate(planners, world.near, i, m)
        other = planners[j]
        if other.tick == tick and other.mode != STOP and j < i:
            continue  # it is awake too, and has looked already
        schedule_pair(world, i, j, tick)


@inlined
def schedule_pair(world: World, i: int, j: int, tick: int) -> None:
    """Schedule encounters of robots ``i`` and ``j``: between their moving pieces, and between the stop of the one that
    stops first and the other."""
    a, b = world.planners[i], world.planners[j]
    if may_encounter(a, b, world.setup, tick):
        schedule(world.planners, world.wakes, a, b, i, j, world.setup, tick, i < j)
    if stops_before(a, b):
        schedule_stop(world, i, j)
    if stops_before(b, a):
        schedule_stop(world, j, i)


@inlined
def schedule_stop(world: World, i: int, j: int) -> None:
    """Schedule encounters of the stop at the end of robot ``i``'s plan with robot ``j``, which is still moving then."""
    a, b = world.stops[i], world.planners[j]
    if may_encounter(a, b, world.setup, a.tick):
        schedule(world.planners, world.wakes, a, b, i, j, world.setup, a.tick, STANDS_FIRST)


@inner
def schedule(
    planners: Planners, wakes: NDArray[np.int64], a: Planner, b: Planner, i: int, j: int, setup: Setup, tick: int,
    a_first: bool,
) -> None:  # fmt: skip
    """Schedule the first tick after ``tick`` at which piece ``a`` of robot ``i`` and ``b`` of ``j`` may affect each
    other. The affected robot wakes by then and looks ahead again."""
    encounter, to_i, to_j = encounter_tick(a, b, setup, tick, a_first)
    if to_i:
        wake_no_later_than(planners, wakes, i, encounter)
    if to_j:
        wake_no_later_than(planners, wakes, j, encounter)


@inlined
def wake_no_later_than(planners: Planners, wakes: NDArray[np.int64], i: int, tick: int) -> None:
    """Wake robot ``i`` by ``tick``, at which another robot may affect it."""
    row = planners[i]
    if tick < row.lookahead_tick:
        row.lookahead_tick = tick
        wake_by(wakes, i, tick)


@kernel
def new_lists(world: World, grid: NDArray[np.int64], radius_m: float, tick: int) -> None:
    """Update the neighbour lists, and schedule encounters of new neighbours."""
    update_lists(world.planners, world.near, grid, world.setup, radius_m, tick)
    for i in range(world.planners.size):
        for m in range(neighbour_count(world.near, i)):
            j = neighbour(world.near, i, m)
            if j > i:
                schedule_pair(world, i, j, tick - 1)


@kernel
def write_ends(planners: Planners, setup: Setup, tick: int, ends: NDArray[np.void]) -> None:
    """Write the robots' poses at ``tick`` into rows of ``END_ROW``."""
    for i in range(planners.size):
        ends[i].x_m, ends[i].y_m, heading = pose_at(planners[i], setup, tick)
        ends[i].heading_rad = wrapped_rad(heading)
        ends[i].stop_tick = planners[i].stop_tick if planners[i].mode == STOP else -1


@kernel
def headings_at(planners: Planners, setup: Setup, tick: int, headings: NDArray[np.float64]) -> None:
    """Write the headings at ``tick``, rad, not wrapped, into an array (robots,)."""
    for i in range(planners.size):
        _, _, headings[i] = pose_at(planners[i], setup, tick)


class EventRun(KernelRun):
    """One run under the event-driven engine: state in, state out (``MotionState``)."""

    fields = PLANNER

    def prepare(self) -> None:
        """Allocate the neighbour lists and everything else that is the same for all runs."""
        robots = self.swarm.size
        self.all_wake = all_wake(robots, 1)
        self.wakes, self.awake = self.all_wake.copy(), np.zeros(robots, dtype=np.uint32)
        self.near, self.grid = empty_lists(robots, self.setup), empty_grid(robots, self.setup)
        self.places = zero_rows(1, PLACES)
        self.apart = np.zeros((robots, 1 + max(SMALL_SWARM, self.near.shape[1])))
        self.stops = zero_rows(robots, PLANNER)
        self.stops["mode"] = STOP
        self.list_radius_m = list_radius_m(self.setup)
        # Kernels compiled for these arguments; Numba's type dispatch at each call would take as long as a few events.
        self.go: Callable[[World, int], int] | None = None
        self.update: Callable[[World, NDArray[np.int64], float, int], None] | None = None

    def start(self, seed: int, run: int) -> None:
        """Set time 0 of a run: all robots stand, and their first event is the step at tick 1."""
        super().start(seed, run)
        swarm = self.swarm
        swarm["self_event_tick"], swarm["lookahead_tick"] = 1, NEVER
        swarm["sin_h"], swarm["cos_h"] = np.sin(swarm["heading_rad"]), np.cos(swarm["heading_rad"])
        swarm["mid_x_m"], swarm["mid_y_m"], swarm["stop_ticks"] = swarm["x_m"], swarm["y_m"], 0
        self.wakes[:] = self.all_wake
        if swarm.size <= SMALL_SWARM:
            self.places.view(np.float64).fill(0.0)
            self.places["mid_x_m"] = math.inf
            self.places["mid_x_m"][0, : swarm.size] = swarm["x_m"]
            self.places["mid_y_m"][0, : swarm.size] = swarm["y_m"]

    def copy(self) -> EventRun:
        """Return an independent copy of this state."""
        branch = super().copy()
        branch.wakes, branch.near, branch.places = self.wakes.copy(), self.near.copy(), self.places.copy()
        branch.awake, branch.apart, branch.stops = self.awake.copy(), self.apart.copy(), self.stops.copy()
        return branch

    def world(self) -> World:
        """Return the arguments of the kernels."""
        return World(
            self.swarm, self.stops, self.wakes, self.near, self.places[0], self.apart, self.awake, self.setup,
            self.speeds, self.record, self.seed, self.run,
        )  # fmt: skip

    def move_on(self, until: int) -> int:
        """Process events up to the tick ``until``, or while the buffers suffice; return the tick reached.

        A large swarm goes no further than the next update of its neighbour lists.
        """
        world = self.world()
        if self.swarm.size > SMALL_SWARM:
            if self.tick == 1 or self.tick % LIST_TICKS == 0:
                if self.update is None:
                    self.update = entry_for(new_lists, world, self.grid, self.list_radius_m, self.tick)
                self.update(world, self.grid, self.list_radius_m, self.tick)
            until = min(until, self.tick - self.tick % LIST_TICKS + LIST_TICKS)
        if self.go is None:
            self.go = entry_for(events, world, until)
        return self.go(world, until)

    def no_sample_before(self) -> int:
        """Return a tick, ``tick`` or later, before which no robot samples."""
        return no_sample_before_plans(self.swarm, self.setup, self.tick)

    def ends(self) -> NDArray[np.void]:
        """Return the robots' current poses: ``END_ROW``."""
        ends = zero_rows(self.swarm.size, END_ROW)
        ends["run"], ends["robot"], ends["tick"] = self.run, np.arange(self.swarm.size), self.tick
        write_ends(self.swarm, self.setup, self.tick, ends)
        return ends

    def headings(self) -> NDArray[np.float64]:
        """Return the robots' current headings, rad, not wrapped."""
        headings = np.empty(self.swarm.size)
        headings_at(self.swarm, self.setup, self.tick, headings)
        return headings


EVENT = Source("event", EventRun, partial(batch_of, EventRun), "from event to event", is_ours=True)
register(EVENT)
