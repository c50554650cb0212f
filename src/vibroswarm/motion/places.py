"""About where each robot of a small swarm is, in columns: the distances to all are taken several at a time.

A column has LANES numbers, one a robot, and stands at a fixed place of one array, so that the compiler sees that
what is read is not what is written: mid_x, mid_y (m), chord_x, chord_y (m a tick), tick, slack (m), own_tick,
last_tick, as in the rows of ``plans``, and how near another may come before it matters (m). Where there is no
robot, one stands infinitely far away.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import inlined
from vibroswarm.motion.body import Setup
from vibroswarm.motion.plans import Planner
from vibroswarm.robot.walk import DRIVE

LANES: Final = 16
MID_X: Final = 0
MID_Y: Final = LANES
CHORD_X: Final = 2 * LANES
CHORD_Y: Final = 3 * LANES
SINCE: Final = 4 * LANES
SLACK: Final = 5 * LANES
OWN: Final = 6 * LANES
LAST: Final = 7 * LANES
MINDED: Final = 8 * LANES
COLUMNS: Final = 9

ROUNDING_M: Final = 1e-9
AT_REST_M2: Final = 1e-300
"""Added to the square of what a robot moves in a tick, so that one that stands is not divided by 0."""


def no_places() -> NDArray[np.float64]:
    """Columns of no robots."""
    places = np.zeros(COLUMNS * LANES)
    places[MID_X : MID_X + LANES] = math.inf
    return places


def stand_at(places: NDArray[np.float64], x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> None:
    """Robots stand there at tick 0."""
    places[MID_Y:] = 0.0
    places[MID_X : MID_X + x_m.size] = x_m
    places[MID_Y : MID_Y + y_m.size] = y_m


@inlined
def put_down(places: NDArray[np.float64], i: int, row: Planner, setup: Setup) -> None:
    """Robot ``i`` has the plan of its row."""
    places[MID_X + i], places[MID_Y + i] = row.mid_x_m, row.mid_y_m
    places[CHORD_X + i], places[CHORD_Y + i] = row.chord_x_m, row.chord_y_m
    places[SINCE + i], places[SLACK + i] = row.tick, row.slack_m
    places[OWN + i], places[LAST + i] = row.own_tick, row.last_tick
    places[MINDED + i] = minded_m(row, setup)


@inlined
def minded_m(row: Planner, setup: Setup) -> float:
    """How near another may come to a robot before either minds, m: in sight of one that drives, else near touching."""
    return float(max(setup.zone_m, setup.sight_m) if row.mode == DRIVE else setup.zone_m)


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


@inlined
def measure_meetings(
    places: NDArray[np.float64],
    apart: NDArray[np.float64],
    robots: int,
    i: int,
    row: Planner,
    setup: Setup,
    tick: int,
) -> None:
    """By how much robot ``i``, awake at ``tick``, and each other stay further apart than matters, by their chords.

    As squares, m^2, into its row of ``apart`` from 1 on: above 0, they are of no matter to each other for as long
    as both plans last.
    """
    mine = apart[i]
    x_m, y_m, chord_x_m, chord_y_m = row.mid_x_m, row.mid_y_m, row.chord_x_m, row.chord_y_m
    own, last = float(row.own_tick - tick), float(row.last_tick - tick)
    slack, minded = row.slack_m + ROUNDING_M, minded_m(row, setup)
    for k in range(np.uint64((robots + 7) & ~7)):
        passed = tick - places[np.uint64(SINCE) + k]
        b_x, b_y = places[np.uint64(CHORD_X) + k], places[np.uint64(CHORD_Y) + k]
        b_own, b_last = places[np.uint64(OWN) + k] - tick, places[np.uint64(LAST) + k] - tick
        # Both move, until one of them stops; that one stands, and the other moves on.
        x = places[np.uint64(MID_X) + k] + passed * b_x - x_m
        y = places[np.uint64(MID_Y) + k] + passed * b_y - y_m
        both = min(own, b_own)
        nearest2 = nearest_on_way2(x, y, b_x - chord_x_m, b_y - chord_y_m, both)
        x, y = x + both * (b_x - chord_x_m), y + both * (b_y - chord_y_m)
        on_x, on_y = (b_x, b_y) if own < b_own else (-chord_x_m, -chord_y_m)
        one = max(min(last, b_own), min(b_last, own)) - both
        nearest2 = min(nearest2, nearest_on_way2(x, y, on_x, on_y, one))
        far = max(minded, places[np.uint64(MINDED) + k]) + slack + places[np.uint64(SLACK) + k]
        mine[k + np.uint64(1)] = nearest2 - far * far
    mine[i + 1] = math.inf


@inlined
def nearest_on_way2(x: float, y: float, dx: float, dy: float, span: float) -> float:
    """Least squared distance from the origin of a point at (x, y) that moves by (dx, dy) a tick, for so many ticks."""
    ticks = min(max(-(x * dx + y * dy) / (dx * dx + dy * dy + AT_REST_M2), 0.0), span)
    x, y = x + ticks * dx, y + ticks * dy
    squared: float = x * x + y * y
    return squared
