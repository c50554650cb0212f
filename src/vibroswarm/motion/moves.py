"""Robots' moves: a drive, turn, avoidance, stop or blocked stretch, as one row each.

Both engines write a row when a move begins, and complete it when the move ends. Segments (``recorder``) hold each
tick of a turn; moves hold a turn as one row, at a small part of the cost.

| name | unit | equation |
|---|---|---|
| turned_rad | rad | heading at the end of the move less that at its start, whole turns included |
| turn rate of a turn | rad/s | turned_rad / duration: its mean, as the controller's changes at each tick |
| speed of a turn | m/s | m_d turn_track / 2 times the turn rate: the centre goes round a circle of that radius |
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel, zero_rows
from vibroswarm.motion.control_step import Swarm
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.robot_params import Setup
from vibroswarm.motion.source import MOVES
from vibroswarm.robot.walk import AVOID, KINDS, STOP, TURN

MOVE_ROW = np.dtype(
    [(name, np.int64) for name in ("tick", "until")]
    + [(name, np.int32) for name in ("run", "robot", "kind")]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad", "speed_m_s", "rate_rad_s")]
    + [(name, np.float64) for name in ("turned_rad", "ray_m")]
)
"""A move from ``tick`` to ``until``, or -1 while under way. The heading is not wrapped. For a turning robot,
speed_m_s holds the radius of the circle on which its centre moves, m."""

UNDER_WAY = np.dtype([(name, np.int64) for name in ("place", "doing", "avoidances")])
"""A robot's current move: its row in the buffer, or -1; its activity, as one number; its avoidances so far."""

MOVES_AT_ONCE: Final = 2048
"""Minimum rows of a buffer: few enough to stay in the processor's cache."""


@inlined
def note_move(
    moves: NDArray[np.void],
    under_way: NDArray[np.void],
    filled: NDArray[np.int64],
    swarm: Swarm,
    i: int,
    setup: Setup,
    run: int,
    tick: int,
    x_m: float,
    y_m: float,
    heading_rad: float,
) -> None:
    """Begin a row if robot ``i`` does something new from ``tick`` on.

    Args:
        moves: buffer of ``MOVE_ROW``. under_way: ``UNDER_WAY``, (robots,).
        filled: ``Record.filled``, whose last number counts the moves.
        x_m, y_m, heading_rad: pose at ``tick``.
    """
    row = swarm[i]
    # ``legs`` and ``avoidances`` distinguish two turns or avoidances that follow each other directly.
    doing = 8 * (row.legs + row.avoidances) + 2 * row.mode + (row.blocked if row.mode != STOP else 0)
    if doing != under_way[i].doing:
        begin_move(moves, under_way, filled, swarm, i, setup, run, tick, x_m, y_m, heading_rad)
        under_way[i].doing, under_way[i].avoidances = doing, row.avoidances


@inner
def begin_move(
    moves: NDArray[np.void],
    under_way: NDArray[np.void],
    filled: NDArray[np.int64],
    swarm: Swarm,
    i: int,
    setup: Setup,
    run: int,
    tick: int,
    x_m: float,
    y_m: float,
    heading_rad: float,
) -> None:
    """End robot ``i``'s current move, if there is one, and begin another; arguments as for ``note_move``.

    Rows of one tick are kept in the order of robots.
    """
    row = swarm[i]
    if under_way[i].place >= 0:
        last = moves[under_way[i].place]
        last.until, last.turned_rad = tick, heading_rad - last.heading_rad
    place = filled[2]
    filled[2] += 1
    while place > 0 and moves[place - 1].tick == tick and moves[place - 1].robot > i:
        moves[place] = moves[place - 1]  # the event engine processes robots that stop to sample first
        under_way[moves[place].robot].place = place
        place -= 1
    under_way[i].place = place
    move = moves[place]
    move.run, move.robot, move.tick, move.until, move.kind = run, i, tick, -1, row.mode
    move.x_m, move.y_m, move.heading_rad, move.turned_rad = x_m, y_m, heading_rad, 0.0
    move.speed_m_s, move.rate_rad_s = row.speed_m_s, row.rate_rad_s
    if (row.mode == TURN or row.mode == AVOID) and not row.blocked:
        move.speed_m_s = 0.5 * row.misalignment * setup.turn_track_m
    onset = row.mode == AVOID and row.avoidances != under_way[i].avoidances
    move.ray_m = row.nearest_mm / 1000.0 if onset else np.nan


@kernel
def note_moves(
    moves: NDArray[np.void],
    under_way: NDArray[np.void],
    filled: NDArray[np.int64],
    swarm: Swarm,
    setup: Setup,
    run: int,
    tick: int,
    after_move: bool,
) -> None:
    """Call ``note_move`` for all robots.

    Args:
        after_move: read the poses at the start of the tick, as saved by ``contact``.
    """
    for i in range(swarm.size):
        row = swarm[i]
        if after_move:
            x_m, y_m, heading_rad = row.from_x_m, row.from_y_m, row.from_heading_rad
        else:
            x_m, y_m, heading_rad = row.x_m, row.y_m, row.heading_rad
        note_move(moves, under_way, filled, swarm, i, setup, run, tick, x_m, y_m, heading_rad)


def drop_ended(moves: NDArray[np.void], under_way: NDArray[np.void], filled: NDArray[np.int64]) -> None:
    """Remove the rows before the oldest move under way from a buffer. Each robot must have a move under way."""
    first, count = int(under_way["place"].min()), int(filled[2])
    rest = bytes_of(moves[first:count]).copy()
    bytes_of(moves)[: rest.size] = rest
    under_way["place"] -= first
    filled[2] = count - first


def bytes_of(rows: NDArray[np.void]) -> NDArray[np.uint8]:
    """Return a view of the rows as bytes: numpy copies these many times faster than rows with fields."""
    return rows.view(np.uint8)


def with_room(moves: NDArray[np.void], filled: int) -> NDArray[np.void]:
    """Return the same buffer, or one twice as large if it is more than half full."""
    if 2 * filled <= moves.size:
        return moves
    larger = zero_rows(2 * moves.size, MOVE_ROW)
    larger[:filled] = moves[:filled]
    return larger


@kernel
def let_end(
    moves: NDArray[np.void], under_way: NDArray[np.void], until: int, headings: NDArray[np.float64]
) -> None:
    """Set the end of current moves to tick ``until`` (-1: still under way), given the robots' headings (rad)."""
    for i in range(headings.size):
        if under_way[i].place >= 0:
            move = moves[under_way[i].place]
            move.until, move.turned_rad = until, headings[i] - move.heading_rad


class MoveColumns:
    """Columns of a table of moves, filled from rows while those are still in the processor's cache."""

    def __init__(self, tick_ms: int, room: int) -> None:
        self.tick_ms, self.count = tick_ms, 0
        self.runs, self.robots = np.empty((1, room), dtype=np.uint32), np.empty((1, room), dtype=np.uint16)
        self.kinds, self.numbers = np.empty((1, room), dtype=np.uint8), np.empty((8, room))

    def take(self, rows: NDArray[np.void]) -> None:
        """Append these rows (``MOVE_ROW``), all of which have ended."""
        if rows.size == 0:
            return
        if self.count + rows.size > self.kinds.size:
            self.runs, self.robots, self.kinds, self.numbers = (
                self._grown(array, rows.size) for array in (self.runs, self.robots, self.kinds, self.numbers)
            )
        fill_move_columns(
            rows, self.runs[0], self.robots[0], self.kinds[0], self.numbers, self.count, self.tick_ms
        )  # fmt: skip
        self.count += rows.size

    def _grown(self, array: NDArray[Any], more: int) -> NDArray[Any]:
        room = max(self.count + more, self.count + self.count // 2)
        larger = np.empty((array.shape[0], room), dtype=array.dtype)
        larger[:, : self.count] = array[:, : self.count]
        return larger

    def frame(self, in_order: bool = True) -> pl.DataFrame:
        """Return all rows as a table; sorted by run, start and robot if they were not taken ``in_order``."""
        n = self.count
        start, x, y, heading, speed, rate, turned, ray = self.numbers[:, :n]
        frame = pl.DataFrame(
            {
                "run": self.runs[0, :n],
                "robot": self.robots[0, :n],
                "start_s": start,
                "x_m": x,
                "y_m": y,
                "heading_rad": heading,
                "speed_m_s": speed,
                "turn_rate_rad_s": rate,
                "kind": pl.Series(KINDS, dtype=MOVES["kind"]).gather(pl.Series(self.kinds[0, :n])),
                "turned_rad": turned,
                "ray_m": pl.Series(ray, nan_to_null=True),
            },
            schema=MOVES,
        )
        return frame if in_order else frame.sort("run", "start_s", "robot")


@kernel
def fill_move_columns(
    rows: NDArray[np.void],
    runs: NDArray[np.uint32],
    robots: NDArray[np.uint16],
    kinds: NDArray[np.uint8],
    numbers: NDArray[np.float64],
    first: int,
    tick_ms: int,
) -> None:
    """Convert ``MOVE_ROW`` to columns, from index ``first`` on; ``numbers`` holds the floats in the order of ``MOVES``.

    Ticks become s; for turns, rate and speed become their means over the move.
    """
    for k in range(rows.size):
        row, place = rows[k], first + k
        runs[place], robots[place], kinds[place] = row.run, row.robot, row.kind
        speed_m_s, rate_rad_s = row.speed_m_s, row.rate_rad_s
        if row.kind == TURN or row.kind == AVOID:
            rate_rad_s = row.turned_rad / ((row.until - row.tick) * tick_ms / 1000.0)
            speed_m_s *= rate_rad_s
        numbers[0, place] = row.tick * tick_ms / 1000.0
        numbers[1, place], numbers[2, place] = row.x_m, row.y_m
        numbers[3, place] = wrapped_rad(row.heading_rad)
        numbers[4, place], numbers[5, place] = speed_m_s, rate_rad_s
        numbers[6, place], numbers[7, place] = row.turned_rad, row.ray_m
