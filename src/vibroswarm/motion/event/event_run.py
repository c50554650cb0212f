"""Runs that the event-driven engine simulates, and the motion source ``event``."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import entry_for, kernel, zero_rows
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
from vibroswarm.motion.event.pair_lookahead import new_lists
from vibroswarm.motion.event.trajectory import PLANNER, Planners, pose_at
from vibroswarm.motion.event.world import World
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.robot_params import Setup
from vibroswarm.motion.source import Source, register
from vibroswarm.robot.walk import STOP


@kernel
def write_poses(planners: Planners, setup: Setup, tick: int, poses: NDArray[np.float64]) -> None:
    """Write the robots' poses at ``tick`` into ``poses``, (robots, 3); headings are not wrapped."""
    for i in range(planners.size):
        poses[i, 0], poses[i, 1], poses[i, 2] = pose_at(planners[i], setup, tick)


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

    def begin(self, seed: int, run: int) -> None:
        """Set this state to time 0 of a run: all robots stand, and their first event is the step at tick 1."""
        super().begin(seed, run)
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

    def world(self) -> World:
        """Return the arrays and parameters of this run as the argument of the kernels; arrays are not copied."""
        return World(
            planners=self.swarm, stops=self.stops, wakes=self.wakes, near=self.near, places=self.places[0],
            apart=self.apart, awake=self.awake, setup=self.setup, speeds=self.speeds, record=self.record,
            seed=self.seed, run=self.run,
        )  # fmt: skip

    def move_on(self, until: int) -> int:
        """Process the events before the tick ``until``, or while the buffers have room; return the tick reached."""
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

    def latest_ticks(self) -> NDArray[np.int64]:
        """Return the ticks at which the robots' plans began, (robots,)."""
        return self.swarm["tick"].copy()

    def poses(self) -> NDArray[np.float64]:
        """Return the robots' present poses, (robots, 3): x, y, m, and heading, rad, not wrapped."""
        poses = np.empty((self.swarm.size, 3))
        write_poses(self.swarm, self.setup, self.tick, poses)
        return poses


EVENT = register(Source("event", EventRun, "from event to event", is_ours=True))
