"""Schedule encounters: each robot wakes, at the latest, at the first tick at which another one may affect it.

The module ``engine`` explains plans, their pieces, and how robots wake. All functions change the arrays in ``world`` in
place. ``i`` and ``j`` are numbers of robots.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel
from vibroswarm.motion.event.event_queue import wake_by
from vibroswarm.motion.event.lookahead import encounter_reach_m
from vibroswarm.motion.event.neighbours import (
    SMALL_SWARM,
    measure_meetings,
    neighbour,
    neighbour_count,
    update_lists,
)
from vibroswarm.motion.event.pair_lookahead import encounter_tick, may_encounter, stops_before
from vibroswarm.motion.event.trajectory import Planner, Planners
from vibroswarm.motion.event.world import World, candidate, candidate_count, within2
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import STOP

STANDS_FIRST: Final[bool] = np.bool_(True)  # type: ignore[assignment]
"""The argument ``a_first`` for a robot that stands: it counts as moving first, as the bound on contact allows for the
step of the first robot (``pair_lookahead.pair_clear_ticks``), which is then 0. It is not a Python literal, for which
Numba would compile the called function once more."""


@inlined
def schedule_encounters(world: World, i: int, tick: int) -> None:
    """Schedule the first tick after ``tick`` at which robot ``i`` and another robot could sense or touch each other.

    This is done for each other robot that may come near before robot ``i``'s plan ends.
    """
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
    """Schedule the first encounter of robots ``i`` and ``j`` after ``tick`` in each pair of pieces of their plans.

    The pairs are: the two present pieces; and, if one robot stops to sample while the other still moves, that stop and
    the present piece of the other.
    """
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
    """Schedule the first tick after ``tick`` at which two robots may affect each other.

    A robot that may be affected wakes at that tick at the latest.

    Args:
        a: the piece of robot ``i``'s plan that is considered. b: the piece of robot ``j``'s plan.
        a_first: whether robot ``i`` moves before robot ``j``.
    """
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
    """Update the neighbour lists of a large swarm at ``tick``, and schedule the encounters of all neighbours.

    Args:
        grid: scratch memory (``neighbours.empty_grid``). radius_m: distance up to which robots are neighbours.
    """
    update_lists(world.planners, world.near, grid, world.setup, radius_m, tick)
    for i in range(world.planners.size):
        for m in range(neighbour_count(world.near, i)):
            j = neighbour(world.near, i, m)
            if j > i:
                schedule_pair(world, i, j, tick - 1)  # encounters from ``tick`` on
