"""Neighbours: for each robot those that it might meet soon, and approximate distances to them.

In a small swarm the list is all others, always. In a large one lists are updated every LIST_TICKS from a grid of
cells: a robot further away than ``radius`` can be neither seen nor touched before that, whatever both do.

``near`` has one row per robot: the number of neighbours, then their indices in order. The numbers are unsigned, so that
compiled code need not check whether an index counts from the end.

``Places`` is one row of columns with LANES numbers each, one a robot, so that distances from one robot of a small swarm
to all others are computed several at a time: ``mid``, ``chord``, ``tick``, ``position_error_m``, ``self_event_tick``
and ``plan_end_tick`` as in ``PLANNER``, and ``minded_m``, how near another robot may come before it matters, m. A lane
without a robot stands infinitely far away.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel
from vibroswarm.motion.event.trajectory import Planner, Planners, pose_at
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import DRIVE

LANES: Final = 16
PLACES = np.dtype(
    [
        (name, np.float64, (LANES,))
        for name in ("mid_x_m", "mid_y_m", "chord_x_m", "chord_y_m", "tick", "position_error_m",
                     "self_event_tick", "plan_end_tick", "minded_m")
    ]
)  # fmt: skip
Places = Any
"""A row of them."""

ROUNDING_M: Final = 1e-9
AT_REST_M2: Final = 1e-300
"""Added to the squared step of a robot, so that one that stands causes no division by 0."""


@inlined
def store_plan(places: Places, i: int, row: Planner, setup: Setup) -> None:
    """Copy robot ``i``'s plan from its row."""
    places.mid_x_m[i], places.mid_y_m[i] = row.mid_x_m, row.mid_y_m
    places.chord_x_m[i], places.chord_y_m[i] = row.chord_x_m, row.chord_y_m
    places.tick[i], places.position_error_m[i] = row.tick, row.position_error_m
    places.self_event_tick[i], places.plan_end_tick[i] = row.self_event_tick, row.plan_end_tick
    places.minded_m[i] = minded_m(row, setup)


@inlined
def minded_m(row: Planner, setup: Setup) -> float:
    """Return the distance within which another robot may affect this one, m: the contact zone, and for a driver at
    least its sight."""
    return float(max(setup.zone_m, setup.sight_m) if row.mode == DRIVE else setup.zone_m)


@inlined
def measure_all(
    places: Places, apart: NDArray[np.float64], robots: int, i: int, x_m: float, y_m: float, tick: int
) -> tuple[float, float]:
    """Write the squared distances from robot ``i``, at (x, y), to all others into ``apart[i, 1:]``, m^2.

    Also moves robot ``i`` to (x, y) in ``places``, so that later calls for other robots measure to there.

    Returns: the smallest squared distance, m^2 (infinite if there is no other robot), and the largest position error
        of the others, m.
    """
    places.mid_x_m[i], places.position_error_m[i] = math.inf, 0.0  # infinitely far from itself
    own_row = apart[i]
    for k in range(np.uint64((robots + 3) & ~3)):
        passed = tick - places.tick[k]
        dx = places.mid_x_m[k] + passed * places.chord_x_m[k] - x_m
        dy = places.mid_y_m[k] + passed * places.chord_y_m[k] - y_m
        own_row[k + np.uint64(1)] = dx * dx + dy * dy
    nearest2, error = math.inf, 0.0
    for k in range(robots):
        nearest2 = min(nearest2, own_row[k + 1])
        error = max(error, places.position_error_m[k])
    places.mid_x_m[i], places.mid_y_m[i], places.tick[i] = x_m, y_m, tick
    return nearest2, error


@inlined
def measure_meetings(
    places: Places, apart: NDArray[np.float64], robots: int, i: int, row: Planner, setup: Setup, tick: int
) -> None:
    """Write for each other robot how close robot ``i`` comes to it from ``tick`` on, into ``apart[i, 1:]``.

    An entry is the smallest squared distance between their chords while both plans last, minus the square of the
    distance at which they may affect each other, position errors included, m^2. If it is above 0, they do not affect
    each other in that time. The entry for robot ``i`` itself is infinite."""
    own_row = apart[i]
    x_m, y_m, chord_x_m, chord_y_m = row.mid_x_m, row.mid_y_m, row.chord_x_m, row.chord_y_m
    own, last = float(row.self_event_tick - tick), float(row.plan_end_tick - tick)
    error, minded = row.position_error_m + ROUNDING_M, minded_m(row, setup)
    for k in range(np.uint64((robots + 7) & ~7)):
        passed = tick - places.tick[k]
        b_x, b_y = places.chord_x_m[k], places.chord_y_m[k]
        b_own, b_last = places.self_event_tick[k] - tick, places.plan_end_tick[k] - tick
        # Both move until one of them stops; then that one stands, and the other moves on.
        x = places.mid_x_m[k] + passed * b_x - x_m
        y = places.mid_y_m[k] + passed * b_y - y_m
        both = min(own, b_own)
        nearest2 = nearest_on_way2(x, y, b_x - chord_x_m, b_y - chord_y_m, both)
        x, y = x + both * (b_x - chord_x_m), y + both * (b_y - chord_y_m)
        on_x, on_y = (b_x, b_y) if own < b_own else (-chord_x_m, -chord_y_m)
        overlap_ticks = max(min(last, b_own), min(b_last, own)) - both
        nearest2 = min(nearest2, nearest_on_way2(x, y, on_x, on_y, overlap_ticks))
        bound_m = max(minded, places.minded_m[k]) + error + places.position_error_m[k]
        own_row[k + np.uint64(1)] = nearest2 - bound_m * bound_m
    own_row[i + 1] = math.inf


@inlined
def nearest_on_way2(x: float, y: float, dx: float, dy: float, span: float) -> float:
    """Return the smallest squared distance from the origin within ``span`` ticks, of a point that starts at (x, y)
    and moves by (dx, dy) per tick."""
    ticks = min(max(-(x * dx + y * dy) / (dx * dx + dy * dy + AT_REST_M2), 0.0), span)
    x, y = x + ticks * dx, y + ticks * dy
    squared: float = x * x + y * y
    return squared


LIST_TICKS: Final = 128
SMALL_SWARM: Final = 16
"""Up to this many robots, all are on all lists."""
MOST_CELLS: Final = 256
"""A side of the grid has at most this many cells."""


def list_radius_m(setup: Setup) -> float:
    """Return the distance beyond which robots cannot affect each other for LIST_TICKS, m."""
    return float(max(setup["zone_m"], setup["sight_m"]) + 2.0 * setup["longest_step_m"] * (LIST_TICKS + 1))


def most_listed(robots: int, setup: Setup) -> int:
    """Return the largest possible length of a neighbour list: all others in a small swarm, else what fits within the
    radius.

    Bodies of radius r do not overlap. Those with centres within a distance R lie in a circle of radius R + r and
    cover less than pi / sqrt(12) of it, so there are fewer than 0.91 (R / r + 1)^2 of them; 1.2 leaves a margin."""
    if robots <= SMALL_SWARM:
        return robots - 1
    discs = 1.2 * (list_radius_m(setup) / float(setup["radius_m"]) + 1.0) ** 2
    return min(robots - 1, math.ceil(discs))


def empty_lists(robots: int, setup: Setup) -> NDArray[np.uint32]:
    """Return one list per robot, (robots, 1 + ``most_listed``): in a small swarm all others, for good; in a large one
    none until ``update_lists``."""
    room = most_listed(robots, setup)
    lists = np.zeros((robots, room + 1), dtype=np.uint32)
    if robots <= SMALL_SWARM:
        for i in range(robots):
            lists[i, 0] = robots - 1
            lists[i, 1:] = [j for j in range(robots) if j != i]
    return lists


@inlined
def neighbour_count(near: NDArray[np.uint32], i: int) -> int:
    """Return the number of robots on robot ``i``'s list."""
    return np.int64(near[i, 0])  # type: ignore[return-value]


@inlined
def neighbour(near: NDArray[np.uint32], i: int, m: int) -> int:
    """Return the ``m``-th robot on robot ``i``'s list."""
    return np.int64(near[i, m + 1])  # type: ignore[return-value]


def empty_grid(robots: int, setup: Setup) -> NDArray[np.int64]:
    """Return scratch memory for ``update_lists``: the first robot of each cell, then the next robot in the same
    cell."""
    across, up = grid_size(setup["width_m"], setup["height_m"], list_radius_m(setup))
    return np.zeros(across * up + robots, dtype=np.int64)


@kernel
def grid_size(width_m: float, height_m: float, radius_m: float) -> tuple[int, int]:
    """Return the numbers of columns and rows of a grid with cells no smaller than the radius."""
    across = min(max(int(width_m / radius_m), 1), MOST_CELLS)
    up = min(max(int(height_m / radius_m), 1), MOST_CELLS)
    return across, up


@inner
def update_lists(
    planners: Planners,
    near: NDArray[np.uint32],
    grid: NDArray[np.int64],
    setup: Setup,
    radius_m: float,
    tick: int,
) -> None:
    """Update all lists from the positions at ``tick``, which are stored in ``from_x_m`` and ``from_y_m``."""
    across, up = grid_size(setup.width_m, setup.height_m, radius_m)
    cells = across * up
    grid[:cells] = -1
    for i in range(planners.size - 1, -1, -1):
        planners[i].from_x_m, planners[i].from_y_m, _ = pose_at(planners[i], setup, tick)
        cell = cell_of(planners, i, setup, across, up)
        grid[cells + i] = grid[cell]
        grid[cell] = i
    for i in range(planners.size):
        update_list(planners, near, grid, setup, radius_m, across, up, i)


@inner
def cell_of(planners: Planners, i: int, setup: Setup, across: int, up: int) -> int:
    """Return the cell in which robot ``i`` lies."""
    column = min(max(int(planners[i].from_x_m / setup.width_m * across), 0), across - 1)
    row = min(max(int(planners[i].from_y_m / setup.height_m * up), 0), up - 1)
    return row * across + column


@inner
def update_list(
    planners: Planners, near: NDArray[np.uint32], grid: NDArray[np.int64], setup: Setup,
    radius_m: float, across: int, up: int, i: int,
) -> None:  # fmt: skip
    """Update robot ``i``'s list: the robots within the radius, from its own and the eight adjacent cells."""
    cell = cell_of(planners, i, setup, across, up)
    row, column = cell // across, cell % across
    count = 0
    for y in range(max(row - 1, 0), min(row + 2, up)):
        for x in range(max(column - 1, 0), min(column + 2, across)):
            j = grid[y * across + x]
            while j >= 0:
                dx = planners[j].from_x_m - planners[i].from_x_m
                dy = planners[j].from_y_m - planners[i].from_y_m
                if j != i and dx * dx + dy * dy < radius_m * radius_m:
                    count += insert(near[i, 1:], count, j)
                j = grid[across * up + j]
    near[i, 0] = count


@inner
def insert(numbers: NDArray[np.integer[Any]], count: int, j: int) -> int:
    """Insert ``j`` among the first ``count`` numbers, which are sorted; return 1, or 0 if it is already among them."""
    place = count
    while place > 0 and numbers[place - 1] >= j:
        place -= 1
    if place < count and numbers[place] == j:
        return 0
    for k in range(count, place, -1):
        numbers[k] = numbers[k - 1]
    numbers[place] = j
    return 1
