"""The event-driven engine: jumps from event to event, and does at each what the fixed-step engine does there.

An event is a tick at which something may change: a sample falls due, a leg, a turn or a stop is over, a ray
may be shorter than theta_c, bodies may touch. Robots sleep until their next one; those that wake at a tick
catch up to it and go through the same phases by the same functions: sense, control, contact, sample. Then
they plan: until when will nothing change? A robot that wakes for nothing only plans again.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import branching_kernel, inlined, inner, kernel, zero_rows
from vibroswarm.motion.ahead import apart2, maybe_within, prepare_to_look, stand_still
from vibroswarm.motion.body import Setup
from vibroswarm.motion.contract import Source, register
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.held import blocked_ticks
from vibroswarm.motion.kernel_run import KernelRun, batch_of
from vibroswarm.motion.meetings import may_meet, may_pass, meeting_tick, passing_tick, stops_before
from vibroswarm.motion.moves import note_move
from vibroswarm.motion.neighbours import (
    LIST_TICKS,
    SMALL_SWARM,
    empty_grid,
    empty_lists,
    how_many,
    insert,
    list_radius_m,
    listed,
    make_lists,
)
from vibroswarm.motion.phases import control_one, is_blind, load, rays_to_disc, rays_to_walls, refresh
from vibroswarm.motion.places import hide, measure_all, measure_meetings, no_places, put_down, stand_at
from vibroswarm.motion.plans import (
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
    own_ticks,
    place_at,
    pose_at,
    stand_on,
    stops_at,
    ticks_to_sample,
    turn_command,
    turned_by,
)
from vibroswarm.motion.record import END_ROW, Record, room_for, write_sample, write_segment
from vibroswarm.motion.steering import no_sample_before_plans
from vibroswarm.motion.wakes import (
    KEY_BITS,
    NEVER,
    ROBOT_BITS,
    all_wake,
    next_wake,
    next_wakes,
    set_wake,
    wake_by,
)
from vibroswarm.motion.walls import wall_tick
from vibroswarm.robot.walk import DRIVE, STOP, looks

HORIZON_TICKS = 250
"""No plan reaches further: a longer one would be hard to look ahead on."""

ROOM_TICKS = 2 * (HORIZON_TICKS + 2)
"""Rows a robot may write between two looks at the buffers: two turns, tick by tick."""


@branching_kernel
def events(
    planners: Planners,
    wakes: NDArray[np.int64],
    near: NDArray[np.uint32],
    places: NDArray[np.float64],
    apart: NDArray[np.float64],
    awake: NDArray[np.uint32],
    standing: Planners,
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    seed: int,
    run: int,
    until: int,
) -> int:
    """From event to event up to the tick ``until``, or while the buffers suffice; gives the tick reached."""
    last_sample, last_segment, last_move = room_for(record, ROOM_TICKS * planners.size, planners.size)
    while True:
        key, after = next_wakes(wakes, planners.size)
        tick = key >> KEY_BITS
        if tick >= until:
            break
        if record.filled[0] > last_sample or record.filled[1] > last_segment or record.filled[2] > last_move:
            return tick
        if after == key:
            after = next_wake(wakes, planners.size, key)
        count = 0
        while True:
            awake[count] = key & ROBOT_BITS
            if stops_at(planners[one_of(awake, count)], setup, tick):
                stop(planners, wakes, places, one_of(awake, count), setup, record, run, tick)
            else:
                count += 1
            if after >> KEY_BITS > tick:
                break
            key, after = after, next_wake(wakes, planners.size, after)
        if count == 0:
            continue
        count = rouse(planners, near, places, apart, awake, count, setup, speeds, record, seed, run, tick)
        step(planners, near, apart, awake, count, setup, record, seed, run, tick)
        blocked = 0
        for k in range(count):
            blocked += plan(planners, places, one_of(awake, k), setup, tick)
        if blocked > 0:
            hold(planners, near, places, awake, count, setup, tick)
        for k in range(count):
            meet(planners, wakes, near, places, apart, standing, one_of(awake, k), setup, tick)
        for k in range(count):
            i = one_of(awake, k)
            row = planners[i]
            set_wake(wakes, i, min(row.alert_tick, row.own_tick))
    for i in range(planners.size):
        row = planners[i]
        if row.mode == STOP and row.sampled == 0 and row.sample_tick < until:
            sample(planners, i, setup, speeds, record, seed, run)
        if record.segments.size > 0:
            write_turn(record, row, i, setup, run, until)
    return until


@inlined
def one_of(awake: NDArray[np.uint32], k: int) -> int:
    """The robot at place ``k`` of those awake; kept without a sign, so that no index may count from the end."""
    return np.int64(awake[k])  # type: ignore[return-value]


@inlined
def stop(
    planners: Planners,
    wakes: NDArray[np.int64],
    places: NDArray[np.float64],
    i: int,
    setup: Setup,
    record: Record,
    run: int,
    tick: int,
) -> None:
    """Robot ``i`` stops to sample, which was in its plan: all others have looked ahead on it."""
    row = planners[i]
    begin_stop(row, setup, tick)
    if record.segments.size > 0:
        write_segment(record, run, i, tick, (row.x_m, row.y_m, row.heading_rad), 0.0, 0.0, STOP)
    if record.moves.size > 0:
        note(record, planners, i, setup, run, tick)
    if planners.size <= SMALL_SWARM:
        put_down(places, i, row, setup)
    set_wake(wakes, i, row.own_tick)


@inlined
def rouse(
    planners: Planners,
    near: NDArray[np.uint32],
    places: NDArray[np.float64],
    apart: NDArray[np.float64],
    awake: NDArray[np.uint32],
    count: int,
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    seed: int,
    run: int,
    tick: int,
) -> int:
    """Bring those awake to ``tick``, and with them all that move so near that a new plan might block them.

    Those that stand have sampled at the tick before. Gives how many are awake now; ``awake`` stays in index order.
    """
    k = 0
    while k < count:
        i = one_of(awake, k)
        k += 1
        row = planners[i]
        if row.tick == tick:
            continue
        hide(places, i)
        if row.mode == STOP:
            if row.sampled == 0:
                sample(planners, i, setup, speeds, record, seed, run)
            stand_on(row, tick)
        else:
            if record.segments.size > 0:
                write_turn(record, row, i, setup, run, tick)
            catch_up(row, setup, tick)
        if look_around(planners, near, places, apart, i, setup, tick):
            near2 = within2(apart, i, setup.zone_m)
            for m in range(noted(planners, near, i)):
                if apart[i, m + 1] >= near2:
                    continue
                j = robot_noted(planners, near, i, m)
                other = planners[j]
                moving = other.tick != tick and other.mode != STOP
                if moving and is_within(other, row.x_m, row.y_m, setup.zone_m, setup, tick):
                    count += insert(awake, count, j)
                    k = 0
    return count


@inlined
def is_within(row: Planner, x_m: float, y_m: float, distance_m: float, setup: Setup, tick: int) -> bool:
    """Whether a robot is within a distance of a point at ``tick``: by its plan, if it may be by its chord."""
    if not maybe_within(row, x_m, y_m, distance_m, tick):
        return False
    there_x, there_y = place_at(row, setup, tick)
    dx, dy = there_x - x_m, there_y - y_m
    return bool(dx * dx + dy * dy < distance_m * distance_m)


@inlined
def look_around(
    planners: Planners,
    near: NDArray[np.uint32],
    places: NDArray[np.float64],
    apart: NDArray[np.float64],
    i: int,
    setup: Setup,
    tick: int,
) -> bool:
    """Whether another body may be so near robot ``i`` that they might touch.

    Notes how far the others are: ``apart`` has a row a robot, the most that these distances may be wrong, m, and
    then their squares, of all robots or of those on its list.
    """
    row = planners[i]
    row.mid_x_m, row.mid_y_m = row.x_m, row.y_m
    if planners.size <= SMALL_SWARM:
        nearest2, slack = measure_all(places, apart, planners.size, i, row.x_m, row.y_m, tick)
    else:
        nearest2, slack = measure_listed(planners, near, apart, i, tick)
    apart[i, 0] = slack
    row.alone_m = math.sqrt(nearest2) - slack
    return bool(row.alone_m < setup.zone_m)


@inlined
def noted(planners: Planners, near: NDArray[np.uint32], i: int) -> int:
    """How many distances robot ``i``'s row of ``apart`` holds."""
    return planners.size if planners.size <= SMALL_SWARM else how_many(near, i)


@inlined
def robot_noted(planners: Planners, near: NDArray[np.uint32], i: int, m: int) -> int:
    """The robot that distance ``m`` of robot ``i``'s row of ``apart`` is to."""
    return m if planners.size <= SMALL_SWARM else listed(near, i, m)


@inlined
def within2(apart: NDArray[np.float64], i: int, distance_m: float) -> float:
    """What a squared distance in robot ``i``'s row of ``apart`` is below if the other may be within that, m^2."""
    far = distance_m + apart[i, 0]
    return float(far * far)


@inner
def measure_listed(
    planners: Planners, near: NDArray[np.uint32], apart: NDArray[np.float64], i: int, tick: int
) -> tuple[float, float]:
    """Squared distances to those on the list of robot ``i``; gives the least, and the most they may be off."""
    row = planners[i]
    nearest2, slack = math.inf, 0.0
    for m in range(how_many(near, i)):
        other = planners[listed(near, i, m)]
        apart[i, m + 1] = apart2(other, row.x_m, row.y_m, tick)
        nearest2 = min(nearest2, apart[i, m + 1])
        slack = max(slack, other.slack_m)
    return nearest2, slack


@inlined
def sample(
    planners: Planners,
    i: int,
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    seed: int,
    run: int,
) -> None:
    """Robot ``i``'s stop is over: it samples. It is woken at the tick after, which is soon enough to write it down."""
    end_stop(planners[i])
    tick = planners[i].sample_tick
    write_sample(record, planners, run, i, tick)
    refresh(planners, setup, speeds, seed, run, i, tick)


@inlined
def step(
    planners: Planners,
    near: NDArray[np.uint32],
    apart: NDArray[np.float64],
    awake: NDArray[np.uint32],
    count: int,
    setup: Setup,
    record: Record,
    seed: int,
    run: int,
    tick: int,
) -> None:
    """What the robots that are awake do at ``tick``, phase by phase, in index order."""
    for k in range(count):
        row = planners[one_of(awake, k)]
        unseen = row.mode == DRIVE and row.alert_tick > tick
        if unseen or (setup.blind_ms > 0.0 and is_blind(planners, one_of(awake, k))):
            row.nearest_mm = math.inf
        elif looks(load(planners, one_of(awake, k)), setup, row.gyro_deg):
            row.nearest_mm = 1000.0 * nearest_now_m(planners, near, apart, one_of(awake, k), setup, tick)
    for k in range(count):
        control_one(planners, setup, seed, run, tick, one_of(awake, k))
        begin_plan(planners[one_of(awake, k)], setup, tick)
    for k in range(count):
        contact_now(planners, near, apart, one_of(awake, k), setup, tick)
    if record.segments.size > 0:
        for k in range(count):
            row = planners[one_of(awake, k)]
            pose = (row.x_m, row.y_m, row.heading_rad)
            write_segment(record, run, one_of(awake, k), tick, pose, row.speed_m_s, row.rate_rad_s, row.mode)
    if record.moves.size > 0:
        for k in range(count):
            note(record, planners, one_of(awake, k), setup, run, tick)


@inlined
def note(record: Record, planners: Planners, i: int, setup: Setup, run: int, tick: int) -> None:
    """``note_move`` of a robot at its plan's tick."""
    x_m, y_m, heading_rad = planners[i].x_m, planners[i].y_m, planners[i].heading_rad
    note_move(
        record.moves, record.under_way, record.filled, planners, i, setup, run, tick, x_m, y_m, heading_rad
    )  # fmt: skip


@inlined
def nearest_now_m(
    planners: Planners, near: NDArray[np.uint32], apart: NDArray[np.float64], i: int, setup: Setup, tick: int
) -> float:
    """The shortest of robot ``i``'s rays at ``tick``, m; infinite when none sees a thing that would matter."""
    row = planners[i]
    x, y, reach = row.x_m, row.y_m, setup.ray_reach_m
    nearest = math.inf
    if x < reach or y < reach or setup.width_m - x < reach or setup.height_m - y < reach:
        nearest = rays_to_walls(setup, row.ray_forward_m, x, y, row.cos_h, row.sin_h)
    if row.alone_m < setup.sight_m:
        near2 = within2(apart, i, setup.sight_m)
        for m in range(noted(planners, near, i)):
            if apart[i, m + 1] >= near2:
                continue
            other = planners[robot_noted(planners, near, i, m)]
            if maybe_within(other, x, y, setup.sight_m, tick):
                other_x, other_y = place_at(other, setup, tick)
                disc = rays_to_disc(setup, row.ray_forward_m, x, y, row.cos_h, row.sin_h, other_x, other_y)
                nearest = min(nearest, disc)
    return nearest if nearest <= setup.look_m else math.inf


@inlined
def contact_now(
    planners: Planners, near: NDArray[np.uint32], apart: NDArray[np.float64], i: int, setup: Setup, tick: int
) -> None:
    """Block robot ``i``'s move from ``tick`` if it would end in a wall or a body.

    Robots before ``i`` have moved already (those that could be touched are awake), those after it have not.
    """
    row = planners[i]
    row.from_x_m, row.from_y_m = row.x_m, row.y_m  # where it will be at the next tick, if nobody is near
    if row.speed_m_s == 0.0:
        return
    inset = setup.radius_m + setup.longest_step_m
    x, y = row.x_m, row.y_m
    at_wall = x < inset or y < inset or setup.width_m - x < inset or setup.height_m - y < inset
    if row.alone_m < setup.zone_m or at_wall:
        move_or_block(planners, near, apart, i, setup, tick)


@inner
def move_or_block(
    planners: Planners, near: NDArray[np.uint32], apart: NDArray[np.float64], i: int, setup: Setup, tick: int
) -> None:
    """``contact_now`` for a robot that has a wall or a body near."""
    row = planners[i]
    x, y, _, _, _ = along_arc(row, setup.tick_s)
    r = setup.radius_m
    hit = x < r or y < r or x > setup.width_m - r or y > setup.height_m - r
    near2 = within2(apart, i, setup.zone_m)
    for m in range(noted(planners, near, i)):
        if not hit and apart[i, m + 1] < near2:
            hit = touches_now(planners, i, robot_noted(planners, near, i, m), setup, tick, x, y)
    if hit:
        block(row)
    else:
        row.from_x_m, row.from_y_m = x, y


@inlined
def touches_now(planners: Planners, i: int, j: int, setup: Setup, tick: int, x_m: float, y_m: float) -> bool:
    """Whether a body at (x, y) would overlap robot ``j``, where it stands when robot ``i`` moves from ``tick``."""
    other = planners[j]
    if j < i and other.tick == tick and other.mode != STOP:
        other_x, other_y = other.from_x_m, other.from_y_m
    else:
        other_x, other_y = place_at(other, setup, tick)
    dx, dy = other_x - x_m, other_y - y_m
    return bool(dx * dx + dy * dy < 4.0 * setup.radius_m * setup.radius_m)


@inner
def write_turn(record: Record, row: Planner, i: int, setup: Setup, run: int, until: int) -> None:
    """Write down a turn's further segments, one for each tick before ``until`` at which its command changes."""
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
def plan(planners: Planners, places: NDArray[np.float64], i: int, setup: Setup, tick: int) -> int:
    """Until when robot ``i`` knows of nothing by itself: its own next event, or a wall.

    Gives 1 if its move is blocked, which ``hold`` then sees to, else 0.
    """
    row = planners[i]
    ahead = own_ticks(row, setup, HORIZON_TICKS)
    if row.blocked:
        row.own_tick = tick + ahead
        stand_still(row)
        return 1
    plan_until(planners, places, i, setup, tick, ahead)
    return 0


@inlined
def plan_until(
    planners: Planners, places: NDArray[np.float64], i: int, setup: Setup, tick: int, ahead: int
) -> None:
    """Robot ``i``'s plan reaches so many ticks ahead, and to the end of the stop if one is due then."""
    row = planners[i]
    row.own_tick = row.last_tick = tick + ahead
    if row.mode == DRIVE and ahead == due_ticks(DRIVE, row.timer_ms, setup):
        row.last_tick += ticks_to_sample(setup, 0) + 1
    prepare_to_look(row, setup)
    if planners.size <= SMALL_SWARM:
        put_down(places, i, row, setup)
    row.alert_tick = wall_tick(row, setup)


@inner
def hold(
    planners: Planners,
    near: NDArray[np.uint32],
    places: NDArray[np.float64],
    awake: NDArray[np.uint32],
    count: int,
    setup: Setup,
    tick: int,
) -> None:
    """Plan those awake whose moves are blocked, when the others have plans and stand where they are.

    Two that block each other stay as long as both are blocked: the first to go on wakes the other.
    """
    for k in range(count):
        i = one_of(awake, k)
        if planners[i].blocked:
            ahead = blocked_ticks(planners, near, i, setup, planners[i].own_tick - tick)
            plan_until(planners, places, i, setup, tick, ahead)


@inlined
def meet(
    planners: Planners,
    wakes: NDArray[np.int64],
    near: NDArray[np.uint32],
    places: NDArray[np.float64],
    apart: NDArray[np.float64],
    standing: Planners,
    i: int,
    setup: Setup,
    tick: int,
) -> None:
    """Wake robot ``i``, and those that it meets, by the tick at which one may matter to the other."""
    row = planners[i]
    # Who is further away than this cannot come near before it looks around again.
    far = max(setup.zone_m, setup.sight_m)
    far += (row.own_tick - tick) * row.rate_m + (row.last_tick - tick) * setup.longest_step_m
    if far < row.alone_m:
        return
    far2 = within2(apart, i, far)
    if planners.size <= SMALL_SWARM:
        far2 = 0.0
        measure_meetings(places, apart, planners.size, i, row, setup, tick)
    for m in range(noted(planners, near, i)):
        if apart[i, m + 1] > far2:
            continue
        j = robot_noted(planners, near, i, m)
        other = planners[j]
        if other.tick == tick and other.mode != STOP and j < i:
            continue  # it is awake too, and has looked already
        if may_meet(row, other, setup, tick):
            look_out(planners, wakes, i, j, setup, tick)
        if stops_before(row, other) and may_pass(row, other, setup):
            look_out_for(planners, wakes, standing, i, j, setup)
        if stops_before(other, row) and may_pass(other, row, setup):
            look_out_for(planners, wakes, standing, j, i, setup)


@inner
def look_out(planners: Planners, wakes: NDArray[np.int64], i: int, j: int, setup: Setup, tick: int) -> None:
    """Wake whom the other matters to by the first tick after ``tick`` at which it may: both look again from there."""
    meeting, to_i, to_j = meeting_tick(planners[i], planners[j], setup, tick, i < j)
    if to_i:
        alert(planners, wakes, i, meeting)
    if to_j:
        alert(planners, wakes, j, meeting)


@inner
def look_out_for(
    planners: Planners, wakes: NDArray[np.int64], standing: Planners, i: int, j: int, setup: Setup
) -> None:
    """Wake robot ``j`` by the first tick at which robot ``i``, which has then stopped to sample, may matter to it."""
    meeting = passing_tick(planners[i], planners[j], standing[0], setup)
    if meeting < NEVER:
        alert(planners, wakes, j, meeting)


@inlined
def alert(planners: Planners, wakes: NDArray[np.int64], i: int, tick: int) -> None:
    """Another robot may matter to robot ``i`` at ``tick``; to one that stands, nobody does."""
    row = planners[i]
    if row.mode != STOP and tick < row.alert_tick:
        row.alert_tick = tick
        wake_by(wakes, i, tick)


@kernel
def new_lists(
    planners: Planners,
    wakes: NDArray[np.int64],
    near: NDArray[np.uint32],
    grid: NDArray[np.int64],
    standing: Planners,
    setup: Setup,
    radius_m: float,
    tick: int,
) -> None:
    """Make the lists anew, and let those that are on them now look ahead on each other."""
    make_lists(planners, near, grid, setup, radius_m, tick)
    for i in range(planners.size):
        for m in range(how_many(near, i)):
            j = listed(near, i, m)
            if j > i and may_meet(planners[i], planners[j], setup, tick - 1):
                look_out(planners, wakes, i, j, setup, tick - 1)
            if stops_before(planners[i], planners[j]) and may_pass(planners[i], planners[j], setup):
                look_out_for(planners, wakes, standing, i, j, setup)


@kernel
def lay_down(planners: Planners, setup: Setup, tick: int, ends: NDArray[np.void]) -> None:
    """Where the robots are at ``tick``, into rows of ``END_ROW``."""
    for i in range(planners.size):
        ends[i].x_m, ends[i].y_m, heading = pose_at(planners[i], setup, tick)
        ends[i].heading_rad = wrapped_rad(heading)
        ends[i].stop_tick = planners[i].stop_tick if planners[i].mode == STOP else -1


@kernel
def headings_at(planners: Planners, setup: Setup, tick: int, headings: NDArray[np.float64]) -> None:
    """The headings at ``tick``, rad, whole turns included, into (robots,)."""
    for i in range(planners.size):
        _, _, headings[i] = pose_at(planners[i], setup, tick)


class EventRun(KernelRun):
    """One run under the event-driven engine: state in, state out (``MotionState``)."""

    fields = PLANNER

    def prepare(self) -> None:
        """Make the lists of neighbours and what else is the same for all runs."""
        robots = self.swarm.size
        self.all_wake = all_wake(robots, 1)
        self.wakes, self.awake = self.all_wake.copy(), np.zeros(robots, dtype=np.uint32)
        self.near, self.grid = empty_lists(robots, self.setup), empty_grid(robots, self.setup)
        self.places = no_places()
        self.apart = np.zeros((robots, 1 + max(SMALL_SWARM, self.near.shape[1])))
        self.standing = zero_rows(1, PLANNER)
        self.standing["mode"] = STOP
        self.list_radius_m = list_radius_m(self.setup)

    def start(self, seed: int, run: int) -> None:
        """Go to time 0 of a run: all stand; their own next event is the step at tick 1."""
        super().start(seed, run)
        swarm = self.swarm
        swarm["own_tick"], swarm["alert_tick"] = 1, NEVER
        swarm["sin_h"], swarm["cos_h"] = np.sin(swarm["heading_rad"]), np.cos(swarm["heading_rad"])
        swarm["mid_x_m"], swarm["mid_y_m"], swarm["stop_ticks"] = swarm["x_m"], swarm["y_m"], 0
        self.wakes[:] = self.all_wake
        if swarm.size <= SMALL_SWARM:
            stand_at(self.places, swarm["x_m"], swarm["y_m"])

    def copy(self) -> EventRun:
        """A branch that does not change with this state."""
        other = super().copy()
        other.wakes, other.near, other.places = self.wakes.copy(), self.near.copy(), self.places.copy()
        other.awake, other.apart, other.standing = self.awake.copy(), self.apart.copy(), self.standing.copy()
        return other

    def move_on(self, until: int) -> int:
        """From event to event up to the tick ``until``, or for as long as the buffers suffice."""
        if self.swarm.size <= SMALL_SWARM:
            return self.events_until(until)
        if self.tick == 1 or self.tick % LIST_TICKS == 0:
            new_lists(
                self.swarm, self.wakes, self.near, self.grid, self.standing, self.setup, self.list_radius_m, self.tick
            )  # fmt: skip
        return self.events_until(min(until, self.tick - self.tick % LIST_TICKS + LIST_TICKS))

    def events_until(self, until: int) -> int:
        """From event to event up to the tick ``until``, or for as long as the buffers suffice."""
        return events(
            self.swarm, self.wakes, self.near, self.places, self.apart, self.awake, self.standing, self.setup,
            self.speeds, self.record, self.seed, self.run, until,
        )  # fmt: skip

    def no_sample_before(self) -> int:
        """A tick, ``tick`` or later, before which nobody samples."""
        return no_sample_before_plans(self.swarm, self.setup, self.tick)

    def ends(self) -> NDArray[np.void]:
        """Where the robots are now: ``END_ROW``."""
        ends = zero_rows(self.swarm.size, END_ROW)
        ends["run"], ends["robot"], ends["tick"] = self.run, np.arange(self.swarm.size), self.tick
        lay_down(self.swarm, self.setup, self.tick, ends)
        return ends

    def headings(self) -> NDArray[np.float64]:
        """The robots' headings now, rad, whole turns included."""
        headings = np.empty(self.swarm.size)
        headings_at(self.swarm, self.setup, self.tick, headings)
        return headings


EVENT = Source("event", EventRun, partial(batch_of, EventRun), "from event to event", is_ours=True)
register(EVENT)
