"""Neighbours: the robots that each robot might meet soon, and approximate distances to them.

In a small swarm (at most SMALL_SWARM robots) all others are neighbours. In a large one, lists are updated every
LIST_TICKS ticks, by a grid of cells: until then, two robots further apart than ``list_radius_m`` can neither see nor
touch each other. ``near`` has one row per robot: the number of its neighbours, then their numbers, ascending.

``Places`` holds copies of the plans of a small swarm as columns of LANES numbers, so that the processor computes
several distances at a time. A lane without a robot has the position infinity.
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
"""Number of robots for which ``PLACES`` has room: those of the largest small swarm."""
PLACES = np.dtype(
    [
        (name, np.float64, (LANES,))
        for name in ("mid_x_m", "mid_y_m", "chord_x_m", "chord_y_m", "tick", "position_error_m",
                     "self_event_tick", "plan_end_tick", "minded_m")
    ]
)  # fmt: skip
"""Copies of the plans of a small swarm: one field for each quantity, with one entry (lane) per robot."""
Places = Any
"""One row of ``PLACES``."""

ROUNDING_M: Final = 1e-9
"""Added to position errors, so that rounding cannot exclude an encounter."""
AT_REST_M2: Final = 1e-300
"""Added to the squared step of a robot, so that one that stands causes no division by 0."""


@inlined
def store_plan(places: Places, i: int, row: Planner, setup: Setup) -> None:
    """Copy robot ``i``'s plan from its row into its lane of ``places``."""
    places.mid_x_m[i], places.mid_y_m[i] = row.mid_x_m, row.mid_y_m
    places.chord_x_m[i], places.chord_y_m[i] = row.chord_x_m, row.chord_y_m
    places.tick[i], places.position_error_m[i] = row.tick, row.position_error_m
    places.self_event_tick[i], places.plan_end_tick[i] = row.self_event_tick, row.plan_end_tick
    places.minded_m[i] = minded_m(row, setup)


@inlined
def minded_m(row: Planner, setup: Setup) -> float:
    """Return the distance within which another robot may affect this one, m: contact zone or a driver's sight."""
    return float(max(setup.zone_m, setup.sight_m) if row.mode == DRIVE else setup.zone_m)


@inlined
def measure_all(
    places: Places, apart: NDArray[np.float64], robots: int, i: int, x_m: float, y_m: float, tick: int
) -> tuple[float, float]:
    """Write squared distances to all robots, m^2, into ``apart[i, 1:]``; return the smallest and the largest error.

    The distance to itself is infinite. Its place is set to (x_m, y_m), error 0, for later calls at the tick.
    """
    places.mid_x_m[i], places.position_error_m[i] = math.inf, 0.0  # infinitely far from itself
    own_row = apart[i]
    # The number of robots is rounded up to a multiple of 4, as a processor computes several lanes at once. Lanes
    # without a robot do no harm: they are infinitely far away. ``k`` is unsigned, so that compiled code need not check
    # for negative indices.
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
    """Write margins into ``apart[i, 1:]``, m^2: a robot whose margin is above 0 has no encounter with robot ``i``.

    The margin is the smallest squared distance between the two chords while both plans last, minus the square of the
    distance within which they may affect each other (position errors included).
    """
    own_row = apart[i]
    x_m, y_m, chord_x_m, chord_y_m = row.mid_x_m, row.mid_y_m, row.chord_x_m, row.chord_y_m
    # Ticks until robot i stops moving, and until its plan, with the stop, ends. b_moves and b_last are those of the
    # other robot.
    moves, last = float(row.self_event_tick - tick), float(row.plan_end_tick - tick)
    error, minded = row.position_error_m + ROUNDING_M, minded_m(row, setup)
    # The number of robots is rounded up, here to a multiple of 8, for the same reason as in ``measure_all``. The
    # results of lanes without a robot may be nan; they are not read.
    for k in range(np.uint64((robots + 7) & ~7)):
        passed = tick - places.tick[k]  # ticks since the other robot's plan began
        b_x, b_y = places.chord_x_m[k], places.chord_y_m[k]
        b_moves, b_last = places.self_event_tick[k] - tick, places.plan_end_tick[k] - tick
        # First both move, for ``both`` ticks. Then one robot stands and the other moves on, for ``one`` ticks: until it
        # stops too, or the plan of the standing one ends. (x, y): position of the other robot relative to robot i.
        x = places.mid_x_m[k] + passed * b_x - x_m
        y = places.mid_y_m[k] + passed * b_y - y_m
        both = min(moves, b_moves)
        nearest2 = nearest_on_way2(x, y, b_x - chord_x_m, b_y - chord_y_m, both)
        x, y = x + both * (b_x - chord_x_m), y + both * (b_y - chord_y_m)
        on_x, on_y = (b_x, b_y) if moves < b_moves else (-chord_x_m, -chord_y_m)
        # ``both + one`` is the first ``min`` if robot i stops first, the second ``min`` if the other robot does. The
        # ``min`` that does not apply is at most ``both``.
        one = max(min(last, b_moves), min(b_last, moves)) - both
        nearest2 = min(nearest2, nearest_on_way2(x, y, on_x, on_y, one))
        bound_m = max(minded, places.minded_m[k]) + error + places.position_error_m[k]
        own_row[k + np.uint64(1)] = nearest2 - bound_m * bound_m
    own_row[i + 1] = math.inf


@inlined
def nearest_on_way2(x: float, y: float, dx: float, dy: float, span: float) -> float:
    """Return the smallest squared distance of a moving point from the origin within ``span`` ticks."""
    # The time at which the point would be nearest if it always moved on this line, clipped to [0, span].
    ticks = min(max(-(x * dx + y * dy) / (dx * dx + dy * dy + AT_REST_M2), 0.0), span)
    x, y = x + ticks * dx, y + ticks * dy
    squared: float = x * x + y * y
    return squared


LIST_TICKS: Final = 128
"""Number of ticks between two updates of the neighbour lists of a large swarm."""
SMALL_SWARM: Final = 16
"""Largest swarm in which all robots are neighbours of each other."""
MOST_CELLS: Final = 256
"""Largest number of cells along a side of the grid."""


def list_radius_m(setup: Setup) -> float:
    """Return a distance, m: robots that are further apart cannot affect each other in the next LIST_TICKS ticks."""
    # Both robots may move towards each other in every tick; the tick in addition (+ 1) is a margin.
    return float(max(setup["zone_m"], setup["sight_m"]) + 2.0 * setup["longest_step_m"] * (LIST_TICKS + 1))


def most_listed(robots: int, setup: Setup) -> int:
    """Return the largest possible length of a neighbour list.

    In a small swarm, that is the number of all others; in a large one, the number of bodies that fit within
    ``list_radius_m``. Bodies of radius r do not overlap. Those with centres within a distance R of a point lie in a
    circle of radius R + r and cover less than pi / sqrt(12) of it, so that there are fewer than 0.91 (R / r + 1)^2 of
    them; the factor 1.2 leaves a margin.
    """
    if robots <= SMALL_SWARM:
        return robots - 1
    discs = 1.2 * (list_radius_m(setup) / float(setup["radius_m"]) + 1.0) ** 2
    return min(robots - 1, math.ceil(discs))


def empty_lists(robots: int, setup: Setup) -> NDArray[np.uint32]:
    """Return lists of neighbours, (robots, 1 + most_listed): of all others in a small swarm, else empty."""
    room = most_listed(robots, setup)
    lists = np.zeros((robots, room + 1), dtype=np.uint32)
    if robots <= SMALL_SWARM:
        for i in range(robots):
            lists[i, 0] = robots - 1
            lists[i, 1:] = [j for j in range(robots) if j != i]
    return lists


@inlined
def neighbour_count(near: NDArray[np.uint32], i: int) -> int:
    """Return the number of robot ``i``'s neighbours."""
    return np.int64(near[i, 0])  # type: ignore[return-value]


@inlined
def neighbour(near: NDArray[np.uint32], i: int, m: int) -> int:
    """Return the number of robot ``i``'s ``m``-th neighbour, from 0."""
    return np.int64(near[i, m + 1])  # type: ignore[return-value]


def empty_grid(robots: int, setup: Setup) -> NDArray[np.int64]:
    """Return scratch memory, (cells + robots,): the first robot of each cell, then each robot's next; -1: none."""
    across, up = grid_size(setup["width_m"], setup["height_m"], list_radius_m(setup))
    cells = across * up
    return np.zeros(cells + robots, dtype=np.int64)


@kernel
def grid_size(width_m: float, height_m: float, radius_m: float) -> tuple[int, int]:
    """Return the numbers of columns and rows of cells, of sides of at least ``radius_m``, that cover the arena."""
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
    """Write the lists of all robots' neighbours into ``near``, and positions at ``tick`` into ``from_...``."""
    across, up = grid_size(setup.width_m, setup.height_m, radius_m)
    cells = across * up
    grid[:cells] = -1
    # Put each robot in front of its cell's list; in descending order, so that the lists are in ascending order.
    for i in range(planners.size - 1, -1, -1):
        planners[i].from_x_m, planners[i].from_y_m, _ = pose_at(planners[i], setup, tick)
        cell = cell_of(planners, i, setup, across, up)
        grid[cells + i] = grid[cell]
        grid[cell] = i
    for i in range(planners.size):
        update_list(planners, near, grid, setup, radius_m, across, up, i)


@inner
def cell_of(planners: Planners, i: int, setup: Setup, across: int, up: int) -> int:
    """Return the number of the cell in which robot ``i`` is, counted row by row; ``across`` columns, ``up`` rows."""
    # Clipped, so that no rounding error of a position leads out of the grid.
    column = min(max(int(planners[i].from_x_m / setup.width_m * across), 0), across - 1)
    row = min(max(int(planners[i].from_y_m / setup.height_m * up), 0), up - 1)
    return row * across + column


@inner
def update_list(
    planners: Planners, near: NDArray[np.uint32], grid: NDArray[np.int64], setup: Setup,
    radius_m: float, across: int, up: int, i: int,
) -> None:  # fmt: skip
    """Write the list of robot ``i``'s neighbours: the robots within the radius, from its own and the adjacent cells."""
    cell = cell_of(planners, i, setup, across, up)
    row, column = cell // across, cell % across
    count = 0
    for y in range(max(row - 1, 0), min(row + 2, up)):
        for x in range(max(column - 1, 0), min(column + 2, across)):
            j = grid[y * across + x]
            while j >= 0:  # -1 ends the cell's list
                dx = planners[j].from_x_m - planners[i].from_x_m
                dy = planners[j].from_y_m - planners[i].from_y_m
                if j != i and dx * dx + dy * dy < radius_m * radius_m:
                    count += insert(near[i, 1:], count, j)
                j = grid[across * up + j]  # the next robot in the same cell
    near[i, 0] = count


@inner
def insert(numbers: NDArray[np.integer[Any]], count: int, j: int) -> int:
    """Insert ``j`` into the first ``count`` numbers; return 1, or 0 if it is already among them."""
    place = count
    while place > 0 and numbers[place - 1] >= j:
        place -= 1
    if place < count and numbers[place] == j:
        return 0
    for k in range(count, place, -1):
        numbers[k] = numbers[k - 1]
    numbers[place] = j
    return 1
