"""About where each robot of a small swarm is, in columns: the distances to all are taken several at a time.

A column has LANES numbers, one a robot, and stands at a fixed place of one array, so that the compiler sees that
what is read is not what is written: mid_x, mid_y (m), chord_x, chord_y (m a tick), tick, slack (m), as in the rows
of ``plans``. Where there is no robot, one stands infinitely far away.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import inlined
from vibroswarm.motion.plans import Planner

LANES: Final = 16
MID_X: Final = 0
MID_Y: Final = LANES
CHORD_X: Final = 2 * LANES
CHORD_Y: Final = 3 * LANES
SINCE: Final = 4 * LANES
SLACK: Final = 5 * LANES


def no_places() -> NDArray[np.float64]:
    """Columns of no robots."""
    places = np.zeros(6 * LANES)
    places[MID_X : MID_X + LANES] = math.inf
    return places


def stand_at(places: NDArray[np.float64], x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> None:
    """Robots stand there at tick 0."""
    places[MID_Y:] = 0.0
    places[MID_X : MID_X + x_m.size] = x_m
    places[MID_Y : MID_Y + y_m.size] = y_m


@inlined
def put_down(places: NDArray[np.float64], i: int, row: Planner) -> None:
    """Robot ``i`` has the plan of its row."""
    places[MID_X + i], places[MID_Y + i] = row.mid_x_m, row.mid_y_m
    places[CHORD_X + i], places[CHORD_Y + i] = row.chord_x_m, row.chord_y_m
    places[SINCE + i], places[SLACK + i] = row.tick, row.slack_m


@inlined
def hide(places: NDArray[np.float64], i: int) -> None:
    """Robot ``i`` is about to look around, and not to see itself."""
    if i < LANES:
        places[MID_X + i], places[SLACK + i] = math.inf, 0.0


@inlined
def measure_all(
    places: NDArray[np.float64],
    apart: NDArray[np.float64],
    robots: int,
    i: int,
    x_m: float,
    y_m: float,
    tick: int,
) -> tuple[float, float]:
    """Squared distances of the hidden robot ``i`` at (x, y) to all others, into its row of ``apart`` from 1 on.

    Gives the least, and the most that they may be off, m. Then all see robot ``i`` there.
    """
    mine = apart[i]
    for k in range(np.uint64((robots + 3) & ~3)):
        mine[k + np.uint64(1)] = apart2(places, k, x_m, y_m, tick)
    nearest2, slack = math.inf, 0.0
    for k in range(robots):
        nearest2 = min(nearest2, mine[k + 1])
        slack = max(slack, places[SLACK + k])
    places[MID_X + i], places[MID_Y + i], places[SINCE + i] = x_m, y_m, tick
    return nearest2, slack


@inlined
def apart2(places: NDArray[np.float64], k: int, x_m: float, y_m: float, tick: int) -> float:
    """Squared distance of a point from where about robot ``k`` is at ``tick``, m^2."""
    passed = tick - places[np.uint64(SINCE) + k]
    dx = places[np.uint64(MID_X) + k] + passed * places[np.uint64(CHORD_X) + k] - x_m
    dy = places[np.uint64(MID_Y) + k] + passed * places[np.uint64(CHORD_Y) + k] - y_m
    squared: float = dx * dx + dy * dy
    return squared
