"""Robots' moves: a drive, turn, avoidance, stop or blocked stretch, as one row each.

All engines write a row when a move begins, and complete it when the move ends. A robot's current move is called under
way. Segments (``recorder``) hold each tick of a turn; moves hold a turn as one row, which costs much less.

| name | unit | equation |
|---|---|---|
| turned_rad | rad | heading at the end of the move - heading at its start, whole turns included |
| turn rate of a turn | rad/s | turned_rad / duration: the mean turn rate, as the controller changes it at each tick |
| speed of a turn | m/s | m_d turn_track / 2 times the turn rate: the robot's centre moves on a circle of that radius |

m_d is the robot's misalignment (``robot_params``).

Three arrays are passed from function to function and changed in place: ``moves``, a buffer of ``MOVE_ROW``;
``under_way``, rows of ``UNDER_WAY``, shape (robots,); and ``filled``, shape (3,), the numbers of rows of samples,
segments and moves written so far (``recorder.Record``), of which only the last is used here.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel, zero_rows
from vibroswarm.motion.control_step import Swarm
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import AVOID, STOP, TURN

MOVE_ROW = np.dtype(
    [(name, np.int64) for name in ("tick", "until")]
    + [(name, np.int32) for name in ("run", "robot", "kind")]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad", "speed_m_s", "rate_rad_s")]
    + [(name, np.float64) for name in ("turned_rad", "ray_m")]
)
"""A move from ``tick`` to ``until`` (-1 while it is under way). The heading is not wrapped. For a turning robot,
``speed_m_s`` holds the radius of the circle on which its centre moves, m, until the row becomes part of a table."""

UNDER_WAY = np.dtype([(name, np.int64) for name in ("place", "doing", "avoidances")])
"""A robot's current move. ``place``: its row in the buffer of moves, -1 if the robot has none. ``doing``: a number that
identifies what the robot does (``note_move``). ``avoidances``: the robot's number of avoidances when the move began."""

MOVES_AT_ONCE: Final = 2048
"""Smallest number of rows of a buffer: few enough to stay in the processor's cache."""


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
    """End robot ``i``'s current move and begin another if the robot does something else from ``tick`` on.

    Args:
        moves, under_way, filled: see the module's text; changed.
        swarm: the robots' rows after the step at ``tick``. x_m, y_m, heading_rad: the robot's pose at ``tick``.
    """
    row = swarm[i]
    # One number for the mode (0 to 3), whether the robot is blocked (0 or 1), and the legs and avoidances begun. By the
    # legs and avoidances, a turn differs from another that follows it directly, and an avoidance too. A robot that
    # stands makes no move that could be blocked; its ``blocked`` may be left from before.
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
    """End robot ``i``'s current move, if it has one, and begin a new one; arguments as for ``note_move``.

    The rows in the buffer stay sorted by tick, then robot. The buffer must have room for another row (``Record``).
    """
    row = swarm[i]
    if under_way[i].place >= 0:
        last = moves[under_way[i].place]
        last.until, last.turned_rad = tick, heading_rad - last.heading_rad
    place = filled[2]
    filled[2] += 1
    # At each tick, the event engine processes robots that stop to sample before the others. So rows of this tick may be
    # there already that belong to robots of higher numbers: move each of them up by one place.
    while place > 0 and moves[place - 1].tick == tick and moves[place - 1].robot > i:
        moves[place] = moves[place - 1]
        under_way[moves[place].robot].place = place
        place -= 1
    under_way[i].place = place
    move = moves[place]
    move.run, move.robot, move.tick, move.until, move.kind = run, i, tick, -1, row.mode
    move.x_m, move.y_m, move.heading_rad, move.turned_rad = x_m, y_m, heading_rad, 0.0
    move.speed_m_s, move.rate_rad_s = row.speed_m_s, row.rate_rad_s
    if (row.mode == TURN or row.mode == AVOID) and not row.blocked:
        # Radius of the circle on which the robot's centre moves. ``fill_move_columns`` makes a speed of it: the turn
        # rate, of which the mean is needed, is known only when the turn has ended.
        move.speed_m_s = 0.5 * row.misalignment * setup.turn_track_m
    # Only the first row of an avoidance has a ray. A stop, a change of ``blocked`` or the end of a fitted arc
    # (``physics.arcs``) divides an avoidance into several rows, and leaves the robot's number of avoidances as it is.
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
    """End and begin the moves of all robots that do something else from ``tick`` on (``note_move``).

    Args:
        moves, under_way, filled: see the module's text; changed.
        after_move: whether the robots have already moved to their poses of the next tick. Their poses at ``tick`` are
            then those that ``control_step.contact`` saved in ``from_x_m``, ``from_y_m`` and ``from_heading_rad``.
    """
    for i in range(swarm.size):
        row = swarm[i]
        if after_move:
            x_m, y_m, heading_rad = row.from_x_m, row.from_y_m, row.from_heading_rad
        else:
            x_m, y_m, heading_rad = row.x_m, row.y_m, row.heading_rad
        note_move(moves, under_way, filled, swarm, i, setup, run, tick, x_m, y_m, heading_rad)


def drop_ended(moves: NDArray[np.void], under_way: NDArray[np.void], filled: NDArray[np.int64]) -> None:
    """Remove from a buffer all rows before the oldest move under way; these are moves that have ended.

    A caller that needs these rows reads them before. The arguments are changed in place (see the module's text). Each
    robot must have a move under way.
    """
    first, count = int(under_way["place"].min()), int(filled[2])
    rest = bytes_of(moves[first:count]).copy()  # source and target may overlap
    bytes_of(moves)[: rest.size] = rest
    under_way["place"] -= first
    filled[2] = count - first


def bytes_of(rows: NDArray[np.void]) -> NDArray[np.uint8]:
    """Return a view of rows as bytes, which numpy copies many times faster than rows with fields."""
    return rows.view(np.uint8)


def with_room(moves: NDArray[np.void], filled: int) -> NDArray[np.void]:
    """Return ``moves`` itself if this buffer is at most half full, or else a copy that is twice as large.

    Args:
        filled: number of rows in use.
    """
    if 2 * filled <= moves.size:
        return moves
    larger = zero_rows(2 * moves.size, MOVE_ROW)
    larger[:filled] = moves[:filled]
    return larger


@kernel
def let_end(
    moves: NDArray[np.void], under_way: NDArray[np.void], until: int, headings: NDArray[np.float64]
) -> None:
    """Set the end of all moves under way to tick ``until``, and the angle that each robot has turned so far.

    The moves stay the robots' current moves. Before simulation goes on, call this again with ``until`` -1, which marks
    them as under way again.

    Args:
        headings: the robots' current headings, rad, not wrapped, shape (robots,).
    """
    for i in range(headings.size):
        if under_way[i].place >= 0:
            move = moves[under_way[i].place]
            move.until, move.turned_rad = until, headings[i] - move.heading_rad
