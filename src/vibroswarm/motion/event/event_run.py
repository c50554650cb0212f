"""Runs that the event-driven engine simulates, and the motion source ``event``."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import entry_for, kernel, zero_rows
from vibroswarm.motion.event.encounters import new_lists
from vibroswarm.motion.event.engine import events
from vibroswarm.motion.event.event_queue import NEVER, all_wake
from vibroswarm.motion.event.neighbours import (
    LIST_TICKS,
    PLACES,
    SMALL_SWARM,
    empty_grid,
    empty_lists,
    list_radius_m,
)
from vibroswarm.motion.event.trajectory import PLANNER, Planners, pose_at
from vibroswarm.motion.event.world import World
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.kernel_run import KernelRun, batch_of, no_sample_before_plans
from vibroswarm.motion.recorder import END_ROW
from vibroswarm.motion.robot_params import Setup
from vibroswarm.motion.source import Source, register
from vibroswarm.robot.walk import STOP


@kernel
def write_ends(
    planners: Planners, setup: Setup, tick: int, ends: NDArray[np.void], headings: NDArray[np.float64]
) -> None:
    """Write the robots' poses at ``tick``, and ``stop_tick``, into rows of ``END_ROW``; the caller sets other fields.

    ``headings``, (robots,): written too, rad, not wrapped.

    ``stop_tick`` is the tick from which the robot stands and hears nothing, or -1 if it moves, or has failed but still
    hears (``control_step.fail`` then sets -1 in its row).
    """
    for i in range(planners.size):
        ends[i].x_m, ends[i].y_m, headings[i] = pose_at(planners[i], setup, tick)
        ends[i].heading_rad = wrapped_rad(headings[i])
        ends[i].stop_tick = planners[i].stop_tick if planners[i].mode == STOP else -1


class EventRun(KernelRun):
    """A run simulated by the event-driven engine (``MotionState``)."""

    fields = PLANNER

    def prepare(self) -> None:
        """Allocate the arrays of ``World``, which all runs of this state use one after the other."""
        robots = self.swarm.size
        self.all_wake = all_wake(robots, 1)
        self.wakes, self.awake = self.all_wake.copy(), np.zeros(robots, dtype=np.uint32)
        self.near, self.grid = empty_lists(robots, self.setup), empty_grid(robots, self.setup)
        self.places = zero_rows(1, PLACES)
        # One number for the largest error, then room for the distances to all lanes of ``places`` (SMALL_SWARM of them)
        # or to all listed neighbours (``World.apart``).
        self.apart = np.zeros((robots, 1 + max(SMALL_SWARM, self.near.shape[1])))
        # Rows for the stops that end plans; ``plan_stop`` writes what differs from stop to stop.
        self.stops = zero_rows(robots, PLANNER)
        self.stops["mode"] = STOP
        self.list_radius_m = list_radius_m(self.setup)
        # ``go`` calls ``events``, and ``update`` calls ``new_lists``, without Numba's dispatch by types, which would
        # take as long as a few events at each call. ``move_on`` sets both when it first needs them.
        self.go: Callable[[World, int], int] | None = None
        self.update: Callable[[World, NDArray[np.int64], float, int], None] | None = None

    def start(self, seed: int, run: int) -> None:
        """Reset this state to time 0 of a run: all robots stand, and their first event is the step at tick 1."""
        super().start(seed, run)
        self.made_world: World | None = None
        swarm = self.swarm
        swarm["self_event_tick"], swarm["lookahead_tick"] = 1, NEVER  # only the robot's own event wakes it
        heading_rad = swarm["heading_rad"].tolist()
        swarm["sin_h"], swarm["cos_h"] = list(map(math.sin, heading_rad)), list(map(math.cos, heading_rad))
        # Waking at tick 1 adds the control period of tick 0 to ``stop_ticks`` (``stand_on``).
        swarm["mid_x_m"], swarm["mid_y_m"], swarm["stop_ticks"] = swarm["x_m"], swarm["y_m"], 0
        self.wakes[:] = self.all_wake
        if swarm.size <= SMALL_SWARM:
            self.places.view(np.float64).fill(0.0)
            self.places["mid_x_m"] = math.inf  # places without a robot are infinitely far away
            self.places["mid_x_m"][0, : swarm.size] = swarm["x_m"]
            self.places["mid_y_m"][0, : swarm.size] = swarm["y_m"]

    def copy(self) -> EventRun:
        """Return an independent copy of this state.

        Arrays that never change (``all_wake``) are shared, and so is ``grid``, which holds nothing from one call of
        ``new_lists`` to the next.
        """
        branch = super().copy()
        branch.made_world = None
        branch.wakes, branch.near, branch.places = self.wakes.copy(), self.near.copy(), self.places.copy()
        branch.awake, branch.apart, branch.stops = self.awake.copy(), self.apart.copy(), self.stops.copy()
        return branch

    def world(self) -> World:
        """Return the arrays and parameters of this run as the argument of the kernels; arrays are not copied."""
        if self.made_world is None or self.made_world.record is not self.record:
            self.made_world = World(
                planners=self.swarm, stops=self.stops, wakes=self.wakes, near=self.near, places=self.places[0],
                apart=self.apart, awake=self.awake, setup=self.setup, speeds=self.speeds, record=self.record,
                seed=self.seed, run=self.run,
            )  # fmt: skip
        return self.made_world

    def move_on(self, until: int) -> int:
        """Process all events before the tick ``until``, or until the buffers might overflow; return the tick reached.

        A large swarm stops at the next multiple of LIST_TICKS, where its neighbour lists are updated by the next call.
        """
        world = self.world()
        if self.swarm.size > SMALL_SWARM:
            if self.tick == 1 or self.tick % LIST_TICKS == 0:  # tick 1 is the first, with no lists yet
                if self.update is None:
                    self.update = entry_for(new_lists, world, self.grid, self.list_radius_m, self.tick)
                self.update(world, self.grid, self.list_radius_m, self.tick)
            until = min(until, self.tick - self.tick % LIST_TICKS + LIST_TICKS)
        if self.go is None:
            self.go = entry_for(events, world, until)
        return self.go(world, until)

    def no_sample_before(self) -> int:
        """Return a tick, ``tick`` or later, before which surely no robot samples."""
        return no_sample_before_plans(self.swarm, self.setup, self.tick)

    def ends(self) -> NDArray[np.void]:
        """Return the robots' current poses (``END_ROW``), shape (robots,)."""
        ends = zero_rows(self.swarm.size, END_ROW)
        ends["run"], ends["robot"], ends["tick"] = self.run, np.arange(self.swarm.size), self.tick
        write_ends(self.swarm, self.setup, self.tick, ends, np.empty(self.swarm.size))
        return ends

    def headings(self) -> NDArray[np.float64]:
        """Return the robots' current headings, rad, not wrapped, shape (robots,)."""
        headings = np.empty(self.swarm.size)
        write_ends(self.swarm, self.setup, self.tick, zero_rows(headings.size, END_ROW), headings)
        return headings


EVENT = Source("event", EventRun, partial(batch_of, EventRun), "from event to event", is_ours=True)


register(EVENT)
