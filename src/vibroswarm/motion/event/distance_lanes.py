"""Approximate positions of a small swarm, in columns: distances to all robots are computed several at a time.

``Places`` is one row of columns with LANES numbers each, one a robot: ``mid``, ``chord``, ``tick``,
``position_error_m``, ``self_event_tick`` and ``plan_end_tick`` as in ``PLANNER``, and ``minded_m``, how near another
robot may come before it matters, m. A lane without a robot stands infinitely far away.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined
from vibroswarm.motion.event.trajectory import Planner
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
    """How near another may come to a robot before either minds, m: in sight of one that drives, else near touching."""
    return float(max(setup.zone_m, setup.sight_m) if row.mode == DRIVE else setup.zone_m)


@inlined
def measure_all(
    places: Places, apart: NDArray[np.float64], robots: int, i: int, x_m: float, y_m: float, tick: int
) -> tuple[float, float]:
    """Write the squared distances from robot ``i``, at (x, y), to all others into its row of ``apart`` from 1 on.

    Returns the least, m^2, and the largest error of a distance, m. From then on others find robot ``i`` at (x, y).
    """
    places.mid_x_m[i], places.position_error_m[i] = math.inf, 0.0  # it does not find itself
    mine = apart[i]
    for k in range(np.uint64((robots + 3) & ~3)):
        passed = tick - places.tick[k]
        dx = places.mid_x_m[k] + passed * places.chord_x_m[k] - x_m
        dy = places.mid_y_m[k] + passed * places.chord_y_m[k] - y_m
        mine[k + np.uint64(1)] = dx * dx + dy * dy
    nearest2, error = math.inf, 0.0
    for k in range(robots):
        nearest2 = min(nearest2, mine[k + 1])
        error = max(error, places.position_error_m[k])
    places.mid_x_m[i], places.mid_y_m[i], places.tick[i] = x_m, y_m, tick
    return nearest2, error


@inlined
def measure_meetings(
    places: Places, apart: NDArray[np.float64], robots: int, i: int, row: Planner, setup: Setup, tick: int
) -> None:
    """By how much robot ``i``, awake at ``tick``, and each other stay further apart than matters, by their chords.

    Written as squares, m^2, into its row of ``apart`` from 1 on. Above 0, the two do not matter to each other for as
    long as both plans last.
    """
    mine = apart[i]
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
        one = max(min(last, b_own), min(b_last, own)) - both
        nearest2 = min(nearest2, nearest_on_way2(x, y, on_x, on_y, one))
        far = max(minded, places.minded_m[k]) + error + places.position_error_m[k]
        mine[k + np.uint64(1)] = nearest2 - far * far
    mine[i + 1] = math.inf


@inlined
def nearest_on_way2(x: float, y: float, dx: float, dy: float, span: float) -> float:
    """Least squared distance from the origin of a point at (x, y) that moves by (dx, dy) a tick, for so many ticks."""
    ticks = min(max(-(x * dx + y * dy) / (dx * dx + dy * dy + AT_REST_M2), 0.0), span)
    x, y = x + ticks * dx, y + ticks * dy
    squared: float = x * x + y * y
    return squared
