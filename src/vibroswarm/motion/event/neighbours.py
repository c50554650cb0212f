"""Lists of neighbours: for each robot those that it might meet before the lists are updated.

In a small swarm these are all others, always. In a large one the lists are updated every LIST_TICKS from a grid of
cells: a robot further away than ``radius`` can be neither seen nor touched before that, whatever both do.

``near`` has a row a robot: how many, then which, in index order. The numbers are unsigned, so that compiled code need
not check whether an index counts from the end.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel
from vibroswarm.motion.event.trajectory import Planners, pose_at
from vibroswarm.motion.robot_params import Setup

LIST_TICKS: Final = 128
SMALL_SWARM: Final = 16
"""Up to this many robots, all are on all lists."""
MOST_CELLS: Final = 256
"""A side of the grid has at most this many cells."""


def list_radius_m(setup: Setup) -> float:
    """Robots further apart than this do not matter to each other for LIST_TICKS, m."""
    return float(max(setup["zone_m"], setup["sight_m"]) + 2.0 * setup["longest_step_m"] * (LIST_TICKS + 1))


def most_listed(robots: int, setup: Setup) -> int:
    """No list needs room for more than so many: of all others in a small swarm, else of what fits within the radius.

    Bodies do not overlap: those whose centres lie within a circle of radius R, all within one of R + r, cover less
    than pi / sqrt(12) of it, so that there are fewer than 0.91 (R / r + 1)^2.
    """
    if robots <= SMALL_SWARM:
        return robots - 1
    discs = 1.2 * (list_radius_m(setup) / float(setup["radius_m"]) + 1.0) ** 2
    return min(robots - 1, math.ceil(discs))


def empty_lists(robots: int, setup: Setup) -> NDArray[np.uint32]:
    """Lists with room for ``most_listed``; those of a small swarm name everybody else, for ever."""
    room = most_listed(robots, setup)
    near = np.zeros((robots, room + 1), dtype=np.uint32)
    if robots <= SMALL_SWARM:
        for i in range(robots):
            near[i, 0] = robots - 1
            near[i, 1:] = [j for j in range(robots) if j != i]
    return near


@inlined
def neighbour_count(near: NDArray[np.uint32], i: int) -> int:
    """The number of robots on the list of robot ``i``."""
    return np.int64(near[i, 0])  # type: ignore[return-value]


@inlined
def neighbour(near: NDArray[np.uint32], i: int, m: int) -> int:
    """The robot at place ``m`` of the list of robot ``i``."""
    return np.int64(near[i, m + 1])  # type: ignore[return-value]


def empty_grid(robots: int, setup: Setup) -> NDArray[np.int64]:
    """Scratch for ``update_lists``: the first robot of each cell, then the next in the cell of each robot."""
    across, up = grid_size(setup["width_m"], setup["height_m"], list_radius_m(setup))
    return np.zeros(across * up + robots, dtype=np.int64)


@kernel
def grid_size(width_m: float, height_m: float, radius_m: float) -> tuple[int, int]:
    """Columns and rows of cells no smaller than the radius."""
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
    """Update all lists from the positions at ``tick``; ``from_x_m``, ``from_y_m`` are overwritten."""
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
    """The cell in which robot ``i`` lies."""
    column = min(max(int(planners[i].from_x_m / setup.width_m * across), 0), across - 1)
    row = min(max(int(planners[i].from_y_m / setup.height_m * up), 0), up - 1)
    return row * across + column


@inner
def update_list(
    planners: Planners, near: NDArray[np.uint32], grid: NDArray[np.int64], setup: Setup,
    radius_m: float, across: int, up: int, i: int,
) -> None:  # fmt: skip
    """Robot ``i``'s list: those within the radius, from its own and the eight cells around."""
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
    """Put ``j`` among the first ``count`` numbers, which are in order; gives 1, or 0 if it is there."""
    place = count
    while place > 0 and numbers[place - 1] >= j:
        place -= 1
    if place < count and numbers[place] == j:
        return 0
    for k in range(count, place, -1):
        numbers[k] = numbers[k - 1]
    numbers[place] = j
    return 1
