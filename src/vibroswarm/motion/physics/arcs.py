"""Arcs through the poses of bodies that are moved by forces: rows of the tables of segments and moves.

The rows are those of ``motion.recorder`` and ``motion.moves``. A body in contact does not move along an exact arc, so
an arc is fitted to its poses at the two ends of each control period:

| name | unit | equation |
|---|---|---|
| turned | rad | heading at the end - heading at the start |
| turn rate | rad/s | turned / duration |
| speed | m/s | displacement along the direction (heading + turned / 2) / duration / sinc(turned / 2) |
| residual | m | part of the displacement that the arc lacks: across that direction, by sideways slip |

A segment goes on while the end of its arc is within ``KEPT_M`` and ``KEPT_RAD`` of the body's pose. An arc is also
fitted to the two ends of each move so far; another move begins when the residual of that arc exceeds ``SPLIT_M`` or, in
a drive, when the speed of the current period differs from its speed by more than ``SPLIT_M_S``.
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
"""A segment goes on while its arc ends within this distance of the body's position, m."""
KEPT_RAD: Final = 2e-4
"""A segment goes on while its arc ends within this angle of the body's heading, rad."""
SPLIT_M: Final = 2e-4
"""Another move begins if the residual of the arc of the move so far exceeds this length, m."""
SPLIT_M_S: Final = 0.005
"""Another move begins if, in a drive, the present speed differs by more than this from that of the move so far, m/s."""

OPEN_SEGMENT = np.dtype(
    [("tick", np.int64), ("kind", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad", "speed_m_s", "rate_rad_s")]
)
"""A robot's open segment: its first tick, the robot's mode, its pose at that tick (heading not wrapped), the arc."""


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

    If the chord is at most a tenth of the arc's length, as after nearly whole turns or after many turns, the speed is
    set to 0, and the residual includes the chord.
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
    """Set each robot's speed and turn rate to those of an arc through its poses at the two ends of a control period.

    The pose one period ago is in ``from_x_m``, ``from_y_m`` and ``from_heading_rad``.
    """
    for i in range(swarm.size):
        row = swarm[i]
        row.speed_m_s, row.rate_rad_s, _ = arc_between(
            row.from_x_m, row.from_y_m, row.from_heading_rad, row.x_m, row.y_m, row.heading_rad, setup.tick_s
        )


@kernel
def note_arcs(
    record: Record, opened: NDArray[np.void], swarm: Swarm, setup: Setup, run: int, tick: int
) -> None:
    """Record the control period that began at ``tick`` in the buffers of segments and moves, if these are recorded.

    Args:
        opened: each robot's open segment, ``OPEN_SEGMENT``, shape (robots,); updated.
        swarm: the robots at the end of the period, after ``fit_period``.
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
    """Begin a segment of robot ``i`` at ``tick``, unless its open segment goes on.

    That segment goes on if the robot's mode is the same and the segment's arc still leads to the robot's present pose.
    The arguments are those of ``note_arcs``.
    """
    row, segment = swarm[i], opened[i]
    if segment.kind == row.mode:
        elapsed_s = (tick + 1 - segment.tick) * setup.tick_s
        x_m, y_m, heading_rad = arc(
            segment.x_m, segment.y_m, segment.heading_rad, segment.speed_m_s, segment.rate_rad_s, elapsed_s
        )
        if (
            math.hypot(row.x_m - x_m, row.y_m - y_m) <= KEPT_M
            and abs(row.heading_rad - heading_rad) <= KEPT_RAD
        ):
            return
    segment.tick, segment.kind = tick, row.mode
    segment.x_m, segment.y_m, segment.heading_rad = row.from_x_m, row.from_y_m, row.from_heading_rad
    segment.speed_m_s, segment.rate_rad_s = row.speed_m_s, row.rate_rad_s
    written = record.segments[record.filled[1]]
    record.filled[1] += 1
    written.run, written.robot, written.tick, written.kind = run, i, tick, row.mode
    written.x_m, written.y_m, written.heading_rad = segment.x_m, segment.y_m, wrapped_rad(segment.heading_rad)
    written.speed_m_s, written.rate_rad_s = segment.speed_m_s, segment.rate_rad_s


@inner
def note_fitted_move(record: Record, swarm: Swarm, setup: Setup, run: int, tick: int, i: int) -> None:
    """Extend robot ``i``'s current move by the control period that began at ``tick``, or begin another move.

    Another move begins if the robot does something else, or if one arc no longer fits (see the module's text). The
    arguments are those of ``note_arcs``.
    """
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
