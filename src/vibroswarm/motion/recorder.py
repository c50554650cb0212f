"""What the engines record: buffers of samples and moves, which kernels fill with plain rows.

All engines write a row when a move begins, and complete it when the move ends. A robot's current move is called under
way.

| name | unit | equation |
|---|---|---|
| turned_rad | rad | heading at the end of the move - heading at its start, whole turns included |
| turn rate of a turn | rad/s | turned_rad / duration: the mean turn rate, as the controller changes it at each tick |
| speed of a turn | m/s | m_d turn_track / 2 times the turn rate: the robot's centre moves on a circle of that radius |

m_d is the robot's misalignment (``robot_params``).

Three arrays are passed from function to function and changed in place: ``moves``, a buffer of ``MOVE_ROW``;
``under_way``, rows of ``UNDER_WAY``, shape (robots,); and ``filled``, shape (2,), the numbers of rows of samples and of
moves written so far (``recorder.Record``), of which only the last is used here.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel, zero_rows
from vibroswarm.motion.control_step import Swarm, clear_account
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.motion_tables import MOVE_ROW, SAMPLE_ROW
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import AVOID, STOP, TURN

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
    """End robot ``i``'s current move and begin another if the robot does something else from ``tick`` on."""
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
    """End robot ``i``'s current move, if it has one, and begin a new one; arguments as for ``note_move``."""
    row = swarm[i]
    if under_way[i].place >= 0:
        last = moves[under_way[i].place]
        last.until, last.turned_rad = tick, heading_rad - last.heading_rad
    place = filled[1]
    filled[1] += 1
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
        # Radius of the circle on which the robot's centre moves. ``move_frame`` makes a speed of it: the turn rate, of
        # which the mean is needed, is known only when the turn has ended.
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

    If they have moved already (``after_move``), their poses at ``tick`` are in ``from_x_m``, ``from_y_m`` and
    ``from_heading_rad``.
    """
    for i in range(swarm.size):
        row = swarm[i]
        if after_move:
            x_m, y_m, heading_rad = row.from_x_m, row.from_y_m, row.from_heading_rad
        else:
            x_m, y_m, heading_rad = row.x_m, row.y_m, row.heading_rad
        note_move(moves, under_way, filled, swarm, i, setup, run, tick, x_m, y_m, heading_rad)


def drop_ended(
    moves: NDArray[np.void], under_way: NDArray[np.void], filled: NDArray[np.int64]
) -> NDArray[np.void]:
    """Remove all rows before the oldest move under way; return the buffer, enlarged if it stays half full."""
    first, count = int(under_way["place"].min()), int(filled[1])
    rest = moves[first:count]
    room = moves if 2 * rest.size <= moves.size else zero_rows(2 * moves.size, MOVE_ROW)
    room.view(np.uint8)[: rest.nbytes] = rest.view(np.uint8)  # many times faster than rows with fields
    under_way["place"] -= first
    filled[1] = count - first
    return room


SAMPLE_TICKS = 2048
"""Number of ticks for which the buffer of samples suffices even if every robot samples at each tick."""


class Record(NamedTuple):
    """The buffers of a run. The buffer of moves has size 0 if moves are not recorded.

    Kernels do not check for room when they write a row. Engines stop before a buffer might overflow (``room``).
    """

    samples: NDArray[np.void]
    """Rows of samples (``SAMPLE_ROW``)."""
    moves: NDArray[np.void]
    """Rows of moves (``MOVE_ROW``)."""
    filled: NDArray[np.int64]
    """Number of rows in use in each buffer, shape (2,): samples, moves."""
    under_way: NDArray[np.void]
    """Each robot's move under way: ``UNDER_WAY``, shape (robots,)."""


def empty_record(robots: int, moves: bool) -> Record:
    """Return buffers for a swarm, to be emptied by ``clear``."""
    # The buffer of moves always holds each robot's move under way. With room for 64 moves per robot, these rows take
    # only a small part of it.
    return Record(
        samples=zero_rows(SAMPLE_TICKS * robots, SAMPLE_ROW),
        moves=zero_rows(max(MOVES_AT_ONCE, 64 * robots) if moves else 0, MOVE_ROW),
        filled=np.zeros(2, dtype=np.int64),
        under_way=zero_rows(robots, UNDER_WAY),
    )


def clear(record: Record) -> None:
    """Empty the buffers, and forget each robot's move under way."""
    record.filled[:] = 0
    record.under_way["place"], record.under_way["doing"], record.under_way["avoidances"] = -1, -1, 0


@inner
def room(record: Record, robots: int) -> int:
    """Return for how many ticks the buffers surely have room: at most a row of each table per robot and tick."""
    ticks = (record.samples.size - record.filled[0]) // robots
    if record.moves.size > 0:
        ticks = min(ticks, (record.moves.size - record.filled[1]) // robots)
    return int(ticks)


@inner
def write_sample(record: Record, swarm: Swarm, run: int, i: int, tick: int) -> None:
    """Write a row for the sample that robot ``i`` takes at this tick, and set its times in each mode to 0."""
    row = record.samples[record.filled[0]]
    record.filled[0] += 1
    row.run, row.robot, row.sample = run, i, swarm[i].samples - 1
    row.stop_tick, row.tick = swarm[i].stop_tick, tick
    row.x_m, row.y_m, row.heading_rad = swarm[i].x_m, swarm[i].y_m, wrapped_rad(swarm[i].heading_rad)
    row.drive, row.turn = swarm[i].drive_ticks, swarm[i].turn_ticks
    row.avoid, row.stop, row.blocked = swarm[i].avoid_ticks, swarm[i].stop_ticks, swarm[i].blocked_ticks
    clear_account(swarm, i)
