"""What the event-driven engine works on (``World``), and the distances from a robot to the others.

The approximate distances from robot ``i`` to others stand in its row of ``World.apart``: to all robots of a small swarm
(at most SMALL_SWARM robots), else to its neighbours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner
from vibroswarm.motion.event.lookahead import distance2_m2, maybe_within
from vibroswarm.motion.event.neighbours import SMALL_SWARM, Places, measure_all, neighbour, neighbour_count
from vibroswarm.motion.event.trajectory import Planner, Planners, position_at
from vibroswarm.motion.recorder import Record
from vibroswarm.motion.robot_params import Setup


class World(NamedTuple):
    """All that the engine works on; compiled functions take it as one argument."""

    planners: Planners
    """The robots, each with the present piece of its plan, shape (robots,)."""
    stops: Planners
    """The stop that is the second piece of a robot's plan, if the robot drives and then samples; shape (robots,)."""
    wakes: NDArray[np.int64]
    """The queue of ticks at which robots wake next (``event_queue``)."""
    near: NDArray[np.uint32]
    """Each robot's list of neighbours (``neighbours``)."""
    places: Places
    """Copies of the plans of a small swarm, in columns (``neighbours.Places``); not used for a large swarm."""
    apart: NDArray[np.float64]
    """One row per robot, scratch memory: the largest error of the approximate distances to other robots, m; then the
    squares of these distances, m^2 (``look_around``), to all robots of a small swarm, else to its neighbours. When
    encounters are scheduled in a small swarm, margins replace the squares (``neighbours.measure_meetings``)."""
    awake: NDArray[np.uint32]
    """The robots awake at this tick, in the order of their numbers; the rest of the array is not used."""
    setup: Setup
    """The scenario's parameters (``robot_params.Setup``)."""
    speeds: NDArray[np.float64]
    """``robot_params.speed_quantiles``."""
    record: Record
    """The buffers of samples and moves."""
    seed: int
    """The run's seed, which addresses its random numbers."""
    run: int
    """The run's number, which addresses its random numbers."""


@inlined
def is_within(row: Planner, x_m: float, y_m: float, distance_m: float, setup: Setup, tick: int) -> bool:
    """Return whether a robot is within ``distance_m`` of (x_m, y_m) at ``tick``; its approximate position comes
    first."""
    if not maybe_within(row, x_m, y_m, distance_m, tick):
        return False
    there_x, there_y = position_at(row, setup, tick)
    dx, dy = there_x - x_m, there_y - y_m
    return bool(dx * dx + dy * dy < distance_m * distance_m)


@inlined
def look_around(world: World, i: int, tick: int) -> bool:
    """Write robot ``i``'s row of ``World.apart`` and its ``clearance_m``; return whether one may be in its contact
    zone."""
    row = world.planners[i]
    # Robot i's plan has ended at ``tick``, and its next plan is made later. Until then its approximate position, which
    # other robots read at this tick, is the exact one: ``row.tick`` is ``tick``, so the old plan's chord adds nothing.
    # ``position_error_m`` of the old plan stays in the row: for an exact position, any bound on the error is valid.
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
    """Return the number of distances in robot ``i``'s row of ``apart``; a small swarm's include the robot itself."""
    return planners.size if planners.size <= SMALL_SWARM else neighbour_count(near, i)


@inlined
def candidate(planners: Planners, near: NDArray[np.uint32], i: int, m: int) -> int:
    """Return the robot to which distance ``m`` in robot ``i``'s row of ``apart`` belongs."""
    return m if planners.size <= SMALL_SWARM else neighbour(near, i, m)


@inlined
def within2(apart: NDArray[np.float64], i: int, distance_m: float) -> float:
    """Return (``distance_m`` + e)^2, m^2, e the largest error in row ``i``: only robots below it may be within."""
    bound_m = distance_m + apart[i, 0]
    return float(bound_m * bound_m)


@inner
def measure_listed(
    planners: Planners, near: NDArray[np.uint32], apart: NDArray[np.float64], i: int, tick: int
) -> tuple[float, float]:
    """Write squared distances to neighbours, m^2, into ``apart[i, 1:]``; return the smallest, and the largest error."""
    row = planners[i]
    nearest2, error = math.inf, 0.0
    for m in range(neighbour_count(near, i)):
        other = planners[neighbour(near, i, m)]
        apart[i, m + 1] = distance2_m2(other, row.x_m, row.y_m, tick)
        nearest2 = min(nearest2, apart[i, m + 1])
        error = max(error, other.position_error_m)
    return nearest2, error
