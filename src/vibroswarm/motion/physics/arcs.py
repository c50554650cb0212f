"""Arcs through the poses of bodies that are moved by forces: rows of the table of moves.

A body in contact does not move along an exact arc, so
an arc is fitted to its poses at the two ends of each control period:

| name | unit | equation |
|---|---|---|
| turned | rad | heading at the end - heading at the start |
| turn rate | rad/s | turned / duration |
| speed | m/s | displacement along the direction (heading + turned / 2) / duration / sinc(turned / 2) |
| residual | m | part of the displacement that the arc lacks: across that direction, by sideways slip |

An arc is also fitted to the two ends of each move so far; another move begins when the residual of that arc exceeds
``SPLIT_M`` or, in a drive, when the speed of the current period differs from its speed by more than ``SPLIT_M_S``.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inner
from vibroswarm.motion.control_step import Swarm
from vibroswarm.motion.recorder import Record, begin_move
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import AVOID, DRIVE, TURN

STUCK: Final = 0.1
"""Share of its commanded way that a driver goes at least, else it is blocked."""
SPLIT_M: Final = 2e-4
"""Another move begins if the residual of the arc of the move so far exceeds this length, m."""
SPLIT_M_S: Final = 0.005
"""Another move begins if, in a drive, the present speed differs by more than this from that of the move so far, m/s."""


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
    """Return speed (m/s), turn rate (rad/s) and residual (m) of the arc from one pose to another, ``dt_s`` later.

    If the chord is at most a tenth of the arc's length, the speed is 0, and the residual includes the chord.
    """
    turned = to_heading_rad - heading_rad
    half = 0.5 * turned
    # For tiny angles, the first two terms of the power series: sin(half) / half would be 0 / 0 at 0.
    sinc = math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0
    along_x, along_y = math.cos(heading_rad + half), math.sin(heading_rad + half)
    dx, dy = to_x_m - x_m, to_y_m - y_m
    chord = dx * along_x + dy * along_y
    # ``sinc`` is chord / length of the arc. Dividing by 0.1 or less would enlarge errors of the chord at least tenfold.
    speed_m_s = chord / sinc / dt_s if abs(sinc) > 0.1 else 0.0
    lost_m = chord - speed_m_s * sinc * dt_s  # 0 unless the speed was set to 0
    return speed_m_s, turned / dt_s, math.hypot(dy * along_x - dx * along_y, lost_m)


@inner
def fit_period(swarm: Swarm, setup: Setup) -> None:
    """Set speed and turn rate to the arc of a period; a driver that went less than ``STUCK`` of its way is blocked."""
    for i in range(swarm.size):
        row = swarm[i]
        least_m_s = STUCK * row.speed_m_s
        row.speed_m_s, row.rate_rad_s, _ = arc_between(
            row.from_x_m, row.from_y_m, row.from_heading_rad, row.x_m, row.y_m, row.heading_rad, setup.tick_s
        )
        row.blocked = row.mode == DRIVE and row.speed_m_s < least_m_s


@inner
def note_fitted_move(record: Record, swarm: Swarm, setup: Setup, run: int, tick: int, i: int) -> None:
    """Extend robot ``i``'s current move by the control period that began at ``tick``, or begin another move."""
    row, under_way = swarm[i], record.under_way
    # As in ``moves.note_move``: the same number as long as the robot does the same thing. ``blocked`` is left out:
    # it is always 0 in MuJoCo's runs.
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
    # For a turning robot, rows hold the radius of its circle in place of the speed (``moves.MOVE_ROW``). At a turn rate
    # of 0 there is no circle.
    if row.mode == TURN or row.mode == AVOID:
        move.speed_m_s = speed_m_s / rate_rad_s if rate_rad_s != 0.0 else 0.0
