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

from vibroswarm.compiled import kernel, zero_rows
from vibroswarm.motion.ahead import (
    blocked_ticks,
    may_meet,
    maybe_within,
    meeting_tick,
    prepare_to_look,
    wall_tick,
)
from vibroswarm.motion.body import Setup
from vibroswarm.motion.contract import Source, register
from vibroswarm.motion.geometry import arc, wrapped_rad
from vibroswarm.motion.kernel_run import KernelRun, batch_of
from vibroswarm.motion.neighbours import (
    LIST_TICKS,
    SMALL_SWARM,
    empty_grid,
    empty_lists,
    insert,
    list_radius_m,
    make_lists,
)
from vibroswarm.motion.phases import control_one, load, rays_to_disc, rays_to_walls, refresh
from vibroswarm.motion.plans import (
    PLANNER,
    Planners,
    begin_plan,
    block,
    catch_up,
    own_ticks,
    pose_at,
    take_sample,
    turn_command,
)
from vibroswarm.motion.record import END_ROW, Record, has_room, write_sample, write_segment
from vibroswarm.motion.wakes import NEVER, awake_at, empty_tree, set_wake, wake_by
from vibroswarm.robot.walk import DRIVE, STOP, looks

HORIZON_TICKS = 250
"""No plan reaches further: a longer one would be hard to look ahead on."""

ROOM_TICKS = 2 * (HORIZON_TICKS + 2)
"""Rows a robot may write between two looks at the buffers: two turns, tick by tick."""


@kernel
def events(
    planners: Planners,
    tree: NDArray[np.int64],
    near: NDArray[np.int64],
    awake: NDArray[np.int64],
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    seed: int,
    run: int,
    until: int,
) -> int:
    """From event to event up to the tick ``until``, or while the buffers suffice; gives the tick reached."""
    rows = ROOM_TICKS * planners.size
    while tree[1] < until:
        tick = tree[1]
        if not has_room(record, rows):
            return int(tick)
        count = awake_at(tree, tick, awake)
        count = sample(planners, tree, awake, count, setup, speeds, record, seed, run, tick)
        if count > 0:
            wake(planners, tree, near, awake, count, setup, record, seed, run, tick)
    if record.segments.size > 0:
        for i in range(planners.size):
            write_turn(record, planners, i, setup, run, until)
    return until


@kernel
def sample(
    planners: Planners,
    tree: NDArray[np.int64],
    awake: NDArray[np.int64],
    count: int,
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    seed: int,
    run: int,
    tick: int,
) -> int:
    """Of those awake, those whose stop is over sample, and stand until the next tick; gives how many others."""
    others = 0
    for k in range(count):
        i = awake[k]
        if planners[i].mode == STOP and planners[i].sample_tick == tick:
            take_sample(planners, i, tick)
            write_sample(record, planners, run, i, tick)
            refresh(planners, setup, speeds, seed, run, i, tick)
            set_wake(tree, i, planners[i].own_tick)
        else:
            awake[others] = i
            others += 1
    return others


@kernel
def wake(
    planners: Planners,
    tree: NDArray[np.int64],
    near: NDArray[np.int64],
    awake: NDArray[np.int64],
    count: int,
    setup: Setup,
    record: Record,
    seed: int,
    run: int,
    tick: int,
) -> None:
    """What the robots that wake at ``tick`` do there, phase by phase, in index order."""
    count = rouse(planners, near, awake, count, setup, record, run, tick)
    for k in range(count):
        i = awake[k]
        row = planners[i]
        if row.mode == DRIVE and row.alert_tick > tick:
            row.nearest_mm = math.inf
        elif looks(load(planners, i), setup, row.gyro_deg):
            row.nearest_mm = 1000.0 * nearest_now_m(planners, near, i, setup, tick)
    for k in range(count):
        control_one(planners, setup, seed, run, tick, awake[k])
        begin_plan(planners, awake[k], setup, tick)
    for k in range(count):
        contact_now(planners, near, awake[k], setup, tick)
    if record.segments.size > 0:
        for k in range(count):
            row = planners[awake[k]]
            pose = (row.x_m, row.y_m, row.heading_rad)
            write_segment(record, run, awake[k], tick, pose, row.speed_m_s, row.rate_rad_s, row.mode)
    for k in range(count):
        plan(planners, tree, near, awake[k], setup, tick)
    for k in range(count):
        meet(planners, tree, near, awake[k], setup, tick)


@kernel
def rouse(
    planners: Planners,
    near: NDArray[np.int64],
    awake: NDArray[np.int64],
    count: int,
    setup: Setup,
    record: Record,
    run: int,
    tick: int,
) -> int:
    """Bring those awake to ``tick``, and with them all that move so near that a new plan might block them.

    Gives how many are awake now; ``awake`` stays in index order.
    """
    zone = 2.0 * (setup.radius_m + setup.longest_step_m)
    k = 0
    while k < count:
        i = awake[k]
        k += 1
        if planners[i].tick == tick:
            continue
        if record.segments.size > 0:
            write_turn(record, planners, i, setup, run, tick)
        catch_up(planners, i, setup, tick)
        row = planners[i]
        row.crowded = 0
        for m in range(near[i, 0]):
            j = near[i, m + 1]
            if maybe_within(planners, j, row.x_m, row.y_m, zone, tick):
                row.crowded = 1
                if planners[j].tick != tick and planners[j].mode != STOP:
                    count += insert(awake, count, j)
                    k = 0
    return count


@kernel
def nearest_now_m(planners: Planners, near: NDArray[np.int64], i: int, setup: Setup, tick: int) -> float:
    """The shortest of robot ``i``'s rays at ``tick``, m; infinite when none sees a thing that would matter."""
    x, y, reach = planners[i].x_m, planners[i].y_m, setup.ray_reach_m
    nearest = math.inf
    ahead_x, ahead_y = planners[i].cos_h, planners[i].sin_h
    if x < reach or y < reach or setup.width_m - x < reach or setup.height_m - y < reach:
        nearest = rays_to_walls(setup, x, y, ahead_x, ahead_y)
    reach += setup.disc_radius_m
    for m in range(near[i, 0]):
        j = near[i, m + 1]
        if maybe_within(planners, j, x, y, reach, tick):
            other_x, other_y, _ = pose_at(planners, j, setup, tick)
            nearest = min(nearest, rays_to_disc(setup, x, y, ahead_x, ahead_y, other_x, other_y))
    return nearest if nearest <= setup.look_m else math.inf


@kernel
def contact_now(planners: Planners, near: NDArray[np.int64], i: int, setup: Setup, tick: int) -> None:
    """Block robot ``i``'s move from ``tick`` if it would end in a wall or a body.

    Robots before ``i`` have moved already (those that could be touched are awake), those after it have not.
    """
    row = planners[i]
    row.from_x_m, row.from_y_m = row.x_m, row.y_m  # where it will be at the next tick, if nobody is near
    if row.speed_m_s == 0.0:
        return
    zone = 2.0 * (setup.radius_m + setup.longest_step_m)
    inset = setup.radius_m + setup.longest_step_m
    x, y = row.x_m, row.y_m
    at_wall = x < inset or y < inset or setup.width_m - x < inset or setup.height_m - y < inset
    if not (row.crowded or at_wall):
        return
    x, y, _ = arc(row.x_m, row.y_m, row.heading_rad, row.speed_m_s, row.rate_rad_s, setup.tick_s)
    r = setup.radius_m
    hit = x < r or y < r or x > setup.width_m - r or y > setup.height_m - r
    for m in range(near[i, 0]):
        j = near[i, m + 1]
        if not hit and maybe_within(planners, j, x, y, zone, tick):
            hit = touches_now(planners, i, j, setup, tick, x, y)
    if hit:
        block(planners, i)
    else:
        row.from_x_m, row.from_y_m = x, y


@kernel
def touches_now(planners: Planners, i: int, j: int, setup: Setup, tick: int, x_m: float, y_m: float) -> bool:
    """Whether a body at (x, y) would overlap robot ``j``, where it stands when robot ``i`` moves from ``tick``."""
    if j < i and planners[j].tick == tick and planners[j].mode != STOP:
        other_x, other_y = planners[j].from_x_m, planners[j].from_y_m
    else:
        other_x, other_y, _ = pose_at(planners, j, setup, tick)
    dx, dy = other_x - x_m, other_y - y_m
    return bool(dx * dx + dy * dy < 4.0 * setup.radius_m * setup.radius_m)


@kernel
def write_turn(record: Record, planners: Planners, i: int, setup: Setup, run: int, until: int) -> None:
    """Write down a turn's further segments, one for each tick before ``until`` at which its command changes."""
    row = planners[i]
    if row.mode == STOP or row.mode == DRIVE or row.blocked:
        return
    error_deg, integral_deg_s = row.error_deg, row.integral_deg_s
    before = turn_command(setup, error_deg, integral_deg_s)
    for tick in range(row.tick + 1, until):
        error_deg -= row.turn_gain * before
        integral_deg_s += error_deg * setup.tick_ms / 1000.0
        command = turn_command(setup, error_deg, integral_deg_s)
        if command != before and tick > row.written_tick:
            heading = row.heading_rad + math.radians(row.error_deg - error_deg)
            x_m = row.x_m + row.radius_m * (math.sin(heading) - row.sin_h)
            y_m = row.y_m - row.radius_m * (math.cos(heading) - row.cos_h)
            rate = math.radians(row.turn_gain * command) / setup.tick_s
            write_segment(record, run, i, tick, (x_m, y_m, heading), row.radius_m * rate, rate, row.mode)
        before = command
    row.written_tick = until - 1


@kernel
def plan(
    planners: Planners, tree: NDArray[np.int64], near: NDArray[np.int64], i: int, setup: Setup, tick: int
) -> None:
    """Until when robot ``i`` knows of nothing by itself: its own next event, or a wall."""
    row = planners[i]
    ahead = own_ticks(planners, i, setup, HORIZON_TICKS)
    if row.blocked:
        ahead = blocked_ticks(planners, near, i, setup, ahead) if row.mode == DRIVE else 1
    row.own_tick = tick + ahead
    prepare_to_look(planners, i, setup)
    row.alert_tick = wall_tick(planners, i, setup)
    set_wake(tree, i, min(row.alert_tick, row.sample_tick if row.mode == STOP else row.own_tick))


@kernel
def meet(
    planners: Planners, tree: NDArray[np.int64], near: NDArray[np.int64], i: int, setup: Setup, tick: int
) -> None:
    """Wake robot ``i``, and those that it meets, by the tick at which they may matter to each other."""
    for m in range(near[i, 0]):
        j = near[i, m + 1]
        if not may_meet(planners, i, j, setup, tick):
            continue
        look_out(planners, tree, i, j, setup, tick)


@kernel
def look_out(planners: Planners, tree: NDArray[np.int64], i: int, j: int, setup: Setup, tick: int) -> None:
    """Wake both by the first tick after ``tick`` at which they may matter to each other."""
    meeting = meeting_tick(planners, i, j, setup, tick)
    if meeting < NEVER:
        alert(planners, tree, i, meeting)
        alert(planners, tree, j, meeting)


@kernel
def new_lists(
    planners: Planners,
    tree: NDArray[np.int64],
    near: NDArray[np.int64],
    grid: NDArray[np.int64],
    setup: Setup,
    radius_m: float,
    tick: int,
) -> None:
    """Make the lists anew, and let those that are on them now look ahead on each other."""
    make_lists(planners, near, grid, setup, radius_m, tick)
    for i in range(planners.size):
        for m in range(near[i, 0]):
            j = near[i, m + 1]
            if j > i:
                look_out(planners, tree, i, j, setup, tick - 1)


@kernel
def alert(planners: Planners, tree: NDArray[np.int64], i: int, tick: int) -> None:
    """Another robot may matter to robot ``i`` at ``tick``; to one that stands, nobody does."""
    if planners[i].mode != STOP:
        planners[i].alert_tick = min(planners[i].alert_tick, tick)
        wake_by(tree, i, tick)


@kernel
def lay_down(planners: Planners, setup: Setup, tick: int, ends: NDArray[np.void]) -> None:
    """Where the robots are at ``tick``, into rows of ``END_ROW``."""
    for i in range(planners.size):
        ends[i].x_m, ends[i].y_m, heading = pose_at(planners, i, setup, tick)
        ends[i].heading_rad = wrapped_rad(heading)
        ends[i].stop_tick = planners[i].stop_tick if planners[i].mode == STOP else -1


class EventRun(KernelRun):
    """One run under the event-driven engine: state in, state out (``MotionState``)."""

    fields = PLANNER

    def start(self, seed: int, run: int) -> None:
        """Go to time 0 of a run: all stand; their own next event is the step at tick 1."""
        super().start(seed, run)
        self.tree = empty_tree(self.swarm.size)
        self.awake = np.zeros(self.swarm.size, dtype=np.int64)
        self.near = empty_lists(self.swarm.size, self.setup)
        self.grid, self.list_radius_m = empty_grid(self.swarm.size, self.setup), list_radius_m(self.setup)
        self.swarm["own_tick"], self.swarm["alert_tick"], self.swarm["stop_ticks"] = 1, NEVER, 0
        self.swarm["sin_h"], self.swarm["cos_h"] = (
            np.sin(self.swarm["heading_rad"]),
            np.cos(self.swarm["heading_rad"]),
        )
        for i in range(self.swarm.size):
            set_wake(self.tree, i, 1)

    def copy(self) -> EventRun:
        """A branch that does not change with this state."""
        other = super().copy()
        other.tree, other.near = self.tree.copy(), self.near.copy()
        return other

    def move_on(self, until: int) -> int:
        """From event to event up to the tick ``until``, or for as long as the buffers suffice."""
        if self.swarm.size <= SMALL_SWARM:
            return self.events_until(until)
        if self.tick == 1 or self.tick % LIST_TICKS == 0:
            new_lists(self.swarm, self.tree, self.near, self.grid, self.setup, self.list_radius_m, self.tick)
        return self.events_until(min(until, self.tick - self.tick % LIST_TICKS + LIST_TICKS))

    def events_until(self, until: int) -> int:
        """From event to event up to the tick ``until``, or for as long as the buffers suffice."""
        return events(
            self.swarm, self.tree, self.near, self.awake, self.setup, self.speeds, self.record,
            self.seed, self.run, until,
        )  # fmt: skip

    def ends(self) -> NDArray[np.void]:
        """Where the robots are now: ``END_ROW``."""
        ends = zero_rows(self.swarm.size, END_ROW)
        ends["run"], ends["robot"], ends["tick"] = self.run, np.arange(self.swarm.size), self.tick
        lay_down(self.swarm, self.setup, self.tick, ends)
        return ends


EVENT = Source("event", EventRun, partial(batch_of, EventRun), "from event to event")
register(EVENT)
