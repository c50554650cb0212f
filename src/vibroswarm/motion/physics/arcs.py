"""Arcs through the poses of bodies that forces move: segments and moves, as ``motion.recorder`` and ``motion.moves``
have them.

A body in contact moves along no exact arc. So an arc is fitted to the two ends of each control period:

| name | unit | equation |
|---|---|---|
| turn rate | rad/s | difference of headings / duration |
| speed | m/s | displacement along (heading + half of what was turned) / duration / sinc(half of what was turned) |
| residual | m | displacement across that direction, which no arc has: sideways slip |

A segment goes on while its arc leads to where the body is, up to ``KEPT_M`` and ``KEPT_RAD``. A move is fitted to its
own two ends, and split where that leaves ``SPLIT_M`` or, of a drive, changes the speed by ``SPLIT_M_S``.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel
from vibroswarm.motion.control_step import Swarm
from vibroswarm.motion.geometry import arc, wrapped_rad
from vibroswarm.motion.moves import begin_move
from vibroswarm.motion.recorder import Record
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import AVOID, DRIVE, TURN

KEPT_M: Final = 1e-4
KEPT_RAD: Final = 2e-4
SPLIT_M: Final = 2e-4
SPLIT_M_S: Final = 0.005

OPEN_SEGMENT = np.dtype(
    [("tick", np.int64), ("kind", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad", "speed_m_s", "rate_rad_s")]
)
"""A robot's segment under way: since when, what it does, its first pose (heading not wrapped), its arc."""


@inner
def arc_between(
    x_m: float,
    y_m: float,
    heading_rad: float,
    to_x_m: float,
    to_y_m: float,
    to_heading_rad: float,
    dt_s: float,
) -> tuple[float, float, float]:
    """Return speed (m/s), turn rate (rad/s) and residual (m) of the arc from one pose towards another, ``dt_s`` later.

    After nearly whole turns the chord says nothing about the speed: this is then 0, and all of the chord is residual.
    """
    turned = to_heading_rad - heading_rad
    half = 0.5 * turned
    sinc = math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0
    along_x, along_y = math.cos(heading_rad + half), math.sin(heading_rad + half)
    dx, dy = to_x_m - x_m, to_y_m - y_m
    chord = dx * along_x + dy * along_y
    # Over whole turns the chord is 0 at any speed.
    speed_m_s = chord / sinc / dt_s if abs(sinc) > 0.1 else 0.0
    lost_m = chord - speed_m_s * sinc * dt_s
    return speed_m_s, turned / dt_s, math.hypot(dy * along_x - dx * along_y, lost_m)


@inner
def fit_period(swarm: Swarm, setup: Setup) -> None:
    """Set each robot's speed and turn rate to those of the arc from its pose one period ago (``from_``) to its pose."""
    for i in range(swarm.size):
        row = swarm[i]
        row.speed_m_s, row.rate_rad_s, _ = arc_between(
            row.from_x_m, row.from_y_m, row.from_heading_rad, row.x_m, row.y_m, row.heading_rad, setup.tick_s
        )


@kernel
def note_arcs(
    record: Record, opened: NDArray[np.void], swarm: Swarm, setup: Setup, run: int, tick: int
) -> None:
    """Record the period from ``tick`` to the next in the tables of segments and moves, if requested.

    Args:
        opened: ``OPEN_SEGMENT``, (robots,), updated. swarm: after ``fit_period``.
    """
    if record.segments.size > 0:
        for i in range(swarm.size):
            note_segment(record, opened, swarm, setup, run, tick, i)
    if record.moves.size > 0:
        for i in range(swarm.size):
            note_fitted_move(record, swarm, setup, run, tick, i)


@inner
def note_segment(
    record: Record, opened: NDArray[np.void], swarm: Swarm, setup: Setup, run: int, tick: int, i: int
) -> None:
    """Begin a segment of robot ``i`` at ``tick``, unless the arc of its open segment still leads to its pose."""
    row, now = swarm[i], opened[i]
    if now.kind == row.mode:
        elapsed_s = (tick + 1 - now.tick) * setup.tick_s
        x_m, y_m, heading_rad = arc(
            now.x_m, now.y_m, now.heading_rad, now.speed_m_s, now.rate_rad_s, elapsed_s
        )
        if (
            math.hypot(row.x_m - x_m, row.y_m - y_m) <= KEPT_M
            and abs(row.heading_rad - heading_rad) <= KEPT_RAD
        ):
            return
    now.tick, now.kind = tick, row.mode
    now.x_m, now.y_m, now.heading_rad = row.from_x_m, row.from_y_m, row.from_heading_rad
    now.speed_m_s, now.rate_rad_s = row.speed_m_s, row.rate_rad_s
    written = record.segments[record.filled[1]]
    record.filled[1] += 1
    written.run, written.robot, written.tick, written.kind = run, i, tick, row.mode
    written.x_m, written.y_m, written.heading_rad = now.x_m, now.y_m, wrapped_rad(now.heading_rad)
    written.speed_m_s, written.rate_rad_s = now.speed_m_s, now.rate_rad_s


@inner
def note_fitted_move(record: Record, swarm: Swarm, setup: Setup, run: int, tick: int, i: int) -> None:
    """Continue robot ``i``'s move through the period from ``tick`` on; begin another if it does something new, or if
    one arc no longer fits."""
    row, under_way = swarm[i], record.under_way
    doing = 8 * (row.legs + row.avoidances) + 2 * row.mode
    continues = doing == under_way[i].doing
    if continues:
        move = record.moves[under_way[i].place]
        elapsed_s = (tick + 1 - move.tick) * setup.tick_s
        speed_m_s, rate_rad_s, residual_m = arc_between(
            move.x_m, move.y_m, move.heading_rad, row.x_m, row.y_m, row.heading_rad, elapsed_s
        )
        changed = row.mode == DRIVE and abs(row.speed_m_s - speed_m_s) > SPLIT_M_S
        continues = residual_m <= SPLIT_M and not changed
    if not continues:
        begin_move(
            record.moves, under_way, record.filled, swarm, i, setup, run, tick,
            row.from_x_m, row.from_y_m, row.from_heading_rad,
        )  # fmt: skip
        under_way[i].doing, under_way[i].avoidances = doing, row.avoidances
        move = record.moves[under_way[i].place]
        speed_m_s, rate_rad_s = row.speed_m_s, row.rate_rad_s
    move.speed_m_s, move.rate_rad_s = speed_m_s, rate_rad_s
    # Of a turn, rows hold the radius in place of the speed (``MOVE_ROW``).
    if row.mode == TURN or row.mode == AVOID:
        move.speed_m_s = speed_m_s / rate_rad_s if rate_rad_s != 0.0 else 0.0
