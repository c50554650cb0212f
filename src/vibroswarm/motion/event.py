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

from vibroswarm.compiled import kernel
from vibroswarm.motion.ahead import meeting_tick, prepare_to_look, wall_tick
from vibroswarm.motion.body import Body
from vibroswarm.motion.contract import Source, register
from vibroswarm.motion.geometry import arc, wrapped_rad
from vibroswarm.motion.kernel_run import KernelRun, batch_of
from vibroswarm.motion.phases import control_one, load, rays_to_disc, rays_to_walls, refresh
from vibroswarm.motion.plans import PLANNER, Planners, begin_plan, block, catch_up, own_ticks, pose_at
from vibroswarm.motion.record import END_ROW, Record, room, write_sample
from vibroswarm.motion.wakes import awake_at, empty_tree, set_wake, wake_by
from vibroswarm.robot.walk import STOP, WalkProgram, looks

HORIZON_TICKS = 250
"""No plan reaches further: a longer one would be hard to look ahead on."""


@kernel
def events(
    planners: Planners,
    tree: NDArray[np.int64],
    awake: NDArray[np.int64],
    body: Body,
    program: WalkProgram,
    record: Record,
    seed: int,
    run: int,
    until: int,
) -> int:
    """From event to event up to the tick ``until``, or while the buffers suffice; gives the tick reached."""
    while tree[1] < until:
        tick = tree[1]
        if room(record, planners.size) < 1:
            return int(tick)
        count = awake_at(tree, tick, awake)
        wake(planners, tree, awake[:count], body, program, record, seed, run, tick)
    return until


@kernel
def wake(
    planners: Planners,
    tree: NDArray[np.int64],
    awake: NDArray[np.int64],
    body: Body,
    program: WalkProgram,
    record: Record,
    seed: int,
    run: int,
    tick: int,
) -> None:
    """What the robots that wake at ``tick`` do there, phase by phase, in index order."""
    for i in awake:
        catch_up(planners, i, body, program, tick)
    for i in awake:
        if looks(load(planners, i), program, planners[i].gyro_deg):
            planners[i].nearest_mm = 1000.0 * nearest_now_m(planners, i, body, program, tick)
    for i in awake:
        control_one(planners, body, program, seed, run, tick, i)
        begin_plan(planners, i, body, program, tick)
    for i in awake:
        contact_now(planners, i, body, program, tick)
    for i in awake:
        if planners[i].sampled:
            write_sample(record, planners, run, i, tick)
            refresh(planners, body, seed, run, i, tick)
    for i in awake:
        plan(planners, tree, i, body, program, tick)
    for i in awake:
        meet(planners, tree, i, body, program, tick)


@kernel
def nearest_now_m(planners: Planners, i: int, body: Body, program: WalkProgram, tick: int) -> float:
    """The shortest of robot ``i``'s rays at ``tick``, m; infinite when none sees a thing that would matter."""
    x, y, reach = planners[i].x_m, planners[i].y_m, body.ray_reach_m
    nearest = math.inf
    ahead_x, ahead_y = math.cos(planners[i].heading_rad), math.sin(planners[i].heading_rad)
    if x < reach or y < reach or body.width_m - x < reach or body.height_m - y < reach:
        nearest = rays_to_walls(body, x, y, ahead_x, ahead_y)
    reach += body.disc_radius_m
    for j in range(planners.size):
        if j != i and maybe_within(planners, j, x, y, reach, tick):
            other_x, other_y, _ = pose_at(planners, j, body, program, tick)
            nearest = min(nearest, rays_to_disc(body, x, y, ahead_x, ahead_y, other_x, other_y))
    return nearest if nearest <= body.look_m else math.inf


@kernel
def maybe_within(planners: Planners, j: int, x_m: float, y_m: float, distance_m: float, tick: int) -> bool:
    """Whether robot ``j`` may be within a distance of a point at ``tick``, by its chord."""
    row = planners[j]
    dx = row.x_m + (tick - row.tick) * row.chord_x_m - x_m
    dy = row.y_m + (tick - row.tick) * row.chord_y_m - y_m
    far = distance_m + row.slack_m
    return bool(dx * dx + dy * dy < far * far)


@kernel
def contact_now(planners: Planners, i: int, body: Body, program: WalkProgram, tick: int) -> None:
    """Block robot ``i``'s move from ``tick`` if it would end in a wall or a body.

    Robots before ``i`` have moved already (those that could be touched are awake), those after it have not.
    """
    row = planners[i]
    row.from_x_m, row.from_y_m = row.x_m, row.y_m  # where it will be at the next tick, if nobody is near
    if row.speed_m_s == 0.0:
        return
    zone = 2.0 * (body.radius_m + body.longest_step_m)
    inset = body.radius_m + body.longest_step_m
    x, y = row.x_m, row.y_m
    near = x < inset or y < inset or body.width_m - x < inset or body.height_m - y < inset
    for j in range(planners.size):
        near = near or (j != i and maybe_within(planners, j, x, y, zone, tick))
    if not near:
        return
    x, y, _ = arc(row.x_m, row.y_m, row.heading_rad, row.speed_m_s, row.rate_rad_s, body.tick_s)
    r = body.radius_m
    hit = x < r or y < r or x > body.width_m - r or y > body.height_m - r
    for j in range(planners.size):
        if j != i and not hit and maybe_within(planners, j, x, y, zone, tick):
            hit = touches_now(planners, i, j, body, program, tick, x, y)
    if hit:
        block(planners, i)
    else:
        row.from_x_m, row.from_y_m = x, y


@kernel
def touches_now(
    planners: Planners, i: int, j: int, body: Body, program: WalkProgram, tick: int, x_m: float, y_m: float
) -> bool:
    """Whether a body at (x, y) would overlap robot ``j``, where it stands when robot ``i`` moves from ``tick``."""
    if j < i and planners[j].tick == tick:
        other_x, other_y = planners[j].from_x_m, planners[j].from_y_m
    else:
        other_x, other_y, _ = pose_at(planners, j, body, program, tick)
    dx, dy = other_x - x_m, other_y - y_m
    return bool(dx * dx + dy * dy < 4.0 * body.radius_m * body.radius_m)


@kernel
def plan(
    planners: Planners, tree: NDArray[np.int64], i: int, body: Body, program: WalkProgram, tick: int
) -> None:
    """Until when robot ``i`` knows of nothing by itself: its own next event, or a wall."""
    row = planners[i]
    row.own_tick = tick + own_ticks(planners, i, program, HORIZON_TICKS)
    if row.blocked:
        row.own_tick = tick + 1
    prepare_to_look(planners, i, body, program)
    set_wake(tree, i, wall_tick(planners, i, body, program))


@kernel
def meet(
    planners: Planners, tree: NDArray[np.int64], i: int, body: Body, program: WalkProgram, tick: int
) -> None:
    """Wake robot ``i``, and those that it meets, by the tick at which they may matter to each other."""
    for j in range(planners.size):
        if j == i or (planners[i].mode == STOP and planners[j].mode == STOP):
            continue
        meeting = meeting_tick(planners, i, j, body, program, tick)
        if planners[i].mode != STOP:
            wake_by(tree, i, meeting)
        if planners[j].mode != STOP:
            wake_by(tree, j, meeting)


@kernel
def lay_down(planners: Planners, body: Body, program: WalkProgram, tick: int, ends: NDArray[np.void]) -> None:
    """Where the robots are at ``tick``, into rows of ``END_ROW``."""
    for i in range(planners.size):
        ends[i].x_m, ends[i].y_m, heading = pose_at(planners, i, body, program, tick)
        ends[i].heading_rad = wrapped_rad(heading)
        ends[i].stop_tick = planners[i].stop_tick if planners[i].mode == STOP else -1


class EventRun(KernelRun):
    """One run under the event-driven engine: state in, state out (``MotionState``)."""

    fields = PLANNER

    def prepare(self) -> None:
        """At tick 0 all stand; their own next event is the step at tick 1."""
        self.tree = empty_tree(self.swarm.size)
        self.awake = np.zeros(self.swarm.size, dtype=np.int64)
        self.swarm["own_tick"] = 1
        for i in range(self.swarm.size):
            self.swarm[i]["stop_ticks"] = 0
            set_wake(self.tree, i, 1)

    def copy(self) -> EventRun:
        """A branch that does not change with this state."""
        other = super().copy()
        other.tree = self.tree.copy()
        return other

    def move_on(self, until: int) -> int:
        """From event to event up to the tick ``until``, or for as long as the buffers suffice."""
        return events(
            self.swarm,
            self.tree,
            self.awake,
            self.body,
            self.program,
            self.record,
            self.seed,
            self.run,
            until,
        )

    def ends(self) -> NDArray[np.void]:
        """Where the robots are now: ``END_ROW``."""
        ends = np.zeros(self.swarm.size, dtype=END_ROW)
        ends["run"], ends["robot"], ends["tick"] = self.run, np.arange(self.swarm.size), self.tick
        lay_down(self.swarm, self.body, self.program, self.tick, ends)
        return ends


EVENT = Source("event", EventRun, partial(batch_of, EventRun), "from event to event")
register(EVENT)
