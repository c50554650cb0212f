"""What the engines record: buffers of samples, segments and moves, and their tables.

Kernels fill buffers of plain rows (``Record``), in which times are ticks. ``frame_of``, ``segment_frame`` and
``end_frame`` turn rows into the tables that ``source`` describes. A segment or a move is open, or
under way, until the robot's next one begins.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, zero_rows
from vibroswarm.motion.control_step import Swarm, clear_account
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.moves import MOVE_ROW, MOVES_AT_ONCE, UNDER_WAY
from vibroswarm.motion.source import ENDS, FAILURES, MOTION, MOVES, SEGMENTS, Motion
from vibroswarm.robot.walk import AVOID, KINDS, STOP, TURN

SAMPLE_ROW = np.dtype(
    [("run", np.uint32), ("robot", np.uint16), ("sample", np.uint32)]
    + [("stop_tick", np.int64), ("tick", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad")]
    + [(name, np.int64) for name in ("drive", "turn", "avoid", "stop")]
)  # fmt: skip
"""A sample at ``tick``, the end of the stop that began at ``stop_tick``; ``drive`` to ``stop`` are ticks in each mode
since the robot's previous sample."""
SEGMENT_ROW = np.dtype(
    [("run", np.uint32), ("robot", np.uint16), ("tick", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad", "speed_m_s", "rate_rad_s")]
    + [("kind", np.int64)]
)  # fmt: skip
"""An arc of constant speed and turn rate from ``tick`` to the robot's next row; ``kind`` is the robot's mode."""

END_ROW = np.dtype(
    [("run", np.uint32), ("robot", np.uint16), ("tick", np.int64), ("stop_tick", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad")]
)  # fmt: skip
"""A robot's pose at ``tick``, and the tick from which it stands and hears nothing (-1: it moves or hears)."""

DTYPES: Final[dict[Any, Any]] = {
    pl.UInt16: np.uint16,
    pl.UInt32: np.uint32,
    pl.Float32: np.float32,
    pl.Float64: np.float64,
    MOVES["kind"]: np.uint8,
}
"""NumPy's types of numbers, by those of polars."""


class Failure(NamedTuple):
    """Why a run failed, and at which tick."""

    run: int
    """The run's number."""
    tick: int
    """Tick from which the robots stand."""
    reason: str
    """Why the run failed, in words."""


class Rows(NamedTuple):
    """The rows of a run, or of a piece of it: ``SAMPLE_ROW``, ``SEGMENT_ROW``, ``END_ROW``, ``MOVE_ROW``.

    ``segments`` and ``moves`` are None if they are not recorded, ``failure`` is None if the run has not failed.
    """

    samples: NDArray[np.void]
    """Rows of samples (``SAMPLE_ROW``)."""
    segments: NDArray[np.void] | None
    """Rows of segments (``SEGMENT_ROW``); None if segments are not recorded."""
    ends: NDArray[np.void]
    """One row per robot with its latest pose (``END_ROW``)."""
    moves: NDArray[np.void] | None = None
    """Rows of moves (``MOVE_ROW``); None if moves are not recorded."""
    failure: Failure | None = None
    """Why the run failed; None if it has not."""


class Record(NamedTuple):
    """The buffers of a run. A buffer of size 0 stands for a table that is not recorded.

    Kernels do not check for room when they write a row. Engines stop before a buffer might overflow (``room``,
    ``room_for``).
    """

    samples: NDArray[np.void]
    """Rows of samples (``SAMPLE_ROW``)."""
    segments: NDArray[np.void]
    """Rows of segments (``SEGMENT_ROW``); size 0 if segments are not recorded."""
    moves: NDArray[np.void]
    """Rows of moves (``MOVE_ROW``); size 0 if moves are not recorded."""
    filled: NDArray[np.int64]
    """Number of rows in use in each buffer, shape (3,): samples, segments, moves."""
    latest: NDArray[np.float64]
    """Speed, turn rate and kind of each robot's open segment, shape (robots, 3); kind -1: none yet."""
    under_way: NDArray[np.void]
    """Each robot's move under way: ``UNDER_WAY``, shape (robots,)."""


def empty_record(robots: int, samples: int, segments: int, moves: bool = False) -> Record:
    """Return empty buffers for a swarm.

    Args:
        samples, segments: numbers of rows for which there is to be room; 0 segments: segments are not recorded.
        moves: whether moves are recorded. Their buffer grows when needed.
    """
    # The buffer of moves always holds each robot's move under way. With room for 64 moves per robot, these rows take
    # only a small part of it.
    move_rows = max(MOVES_AT_ONCE, 64 * robots) if moves else 0
    record = Record(
        samples=zero_rows(samples, SAMPLE_ROW),
        segments=zero_rows(segments, SEGMENT_ROW),
        moves=zero_rows(move_rows, MOVE_ROW),
        filled=np.zeros(3, dtype=np.int64),
        latest=np.zeros((robots, 3)),
        under_way=zero_rows(robots, UNDER_WAY),
    )
    clear(record)  # -1, not 0, marks a robot without a segment or a move
    return record


def clear(record: Record) -> None:
    """Empty the buffers, and forget each robot's open segment and its move under way."""
    record.filled[:], record.latest[:] = 0, -1.0
    record.under_way["place"], record.under_way["doing"], record.under_way["avoidances"] = -1, -1, 0


def copy_record(record: Record) -> Record:
    """Return an independent copy of the buffers."""
    # Only the rows in use are copied: the rest, allocated as zeros, takes no memory until it is written.
    buffers = (record.samples, record.segments, record.moves)
    samples, segments, moves = (zero_rows(rows.size, rows.dtype) for rows in buffers)
    for copy, original, count in zip((samples, segments, moves), buffers, record.filled, strict=True):
        copy[:count] = original[:count]
    return Record(
        samples=samples,
        segments=segments,
        moves=moves,
        filled=record.filled.copy(),
        latest=record.latest.copy(),
        under_way=record.under_way.copy(),
    )


@inner
def room(record: Record, robots: int) -> int:
    """Return for how many ticks the buffers surely have room.

    In a tick, each robot writes at most one row of each table that is recorded.
    """
    ticks = (record.samples.size - record.filled[0]) // robots
    if record.segments.size > 0:
        ticks = min(ticks, (record.segments.size - record.filled[1]) // robots)
    if record.moves.size > 0:
        ticks = min(ticks, (record.moves.size - record.filled[2]) // robots)
    return int(ticks)


@inner
def room_for(record: Record, rows: int, moves: int) -> tuple[int, int, int]:
    """Return how many rows of each buffer (samples, segments, moves) may be in use if some rows are to remain free.

    The engine compares ``Record.filled`` with these numbers. The number for a table that is not recorded is 0.

    Args:
        rows: number of rows that must remain free in the buffer of samples, and also in that of segments.
        moves: number of rows that must remain free in the buffer of moves.
    """
    segments = record.segments.size - rows if record.segments.size > 0 else 0
    return record.samples.size - rows, segments, record.moves.size - moves if record.moves.size > 0 else 0


@inner
def write_sample(record: Record, swarm: Swarm, run: int, i: int, tick: int) -> None:
    """Write a row for the sample that robot ``i`` takes at this tick, and set its times in each mode to 0.

    The robot's program has counted the sample already, so the row's number is one less.
    """
    row = record.samples[record.filled[0]]
    record.filled[0] += 1
    row.run, row.robot, row.sample = run, i, swarm[i].samples - 1
    row.stop_tick, row.tick = swarm[i].stop_tick, tick
    row.x_m, row.y_m, row.heading_rad = swarm[i].x_m, swarm[i].y_m, wrapped_rad(swarm[i].heading_rad)
    row.drive, row.turn = swarm[i].drive_ticks, swarm[i].turn_ticks
    row.avoid, row.stop = swarm[i].avoid_ticks, swarm[i].stop_ticks
    clear_account(swarm, i)


@kernel
def write_segments(record: Record, swarm: Swarm, run: int, tick: int, after_move: bool) -> None:
    """Begin a segment at ``tick`` for each robot whose speed, turn rate or kind differs from its open segment.

    Args:
        after_move: whether the robots have already moved to their poses of the next tick; their poses at ``tick`` are
            then in ``from_x_m``, ``from_y_m`` and ``from_heading_rad``.
    """
    for i in range(swarm.size):
        row = swarm[i]
        pose_here, pose_before = (
            (row.x_m, row.y_m, row.heading_rad),
            (row.from_x_m, row.from_y_m, row.from_heading_rad),
        )
        pose = pose_before if after_move else pose_here
        write_segment(record, run, i, tick, pose, row.speed_m_s, row.rate_rad_s, row.mode)


@inner
def write_segment(
    record: Record,
    run: int,
    i: int,
    tick: int,
    pose: tuple[float, float, float],
    speed_m_s: float,
    rate_rad_s: float,
    kind: int,
) -> None:
    """Begin a segment at ``tick`` if robot ``i``'s speed, turn rate or kind differs from its open segment.

    Args:
        pose: the robot's position and heading (m, m, rad) at ``tick``. kind: the robot's mode, DRIVE to STOP.
    """
    latest = record.latest[i]
    if latest[0] == speed_m_s and latest[1] == rate_rad_s and latest[2] == kind:
        return
    latest[0], latest[1], latest[2] = speed_m_s, rate_rad_s, kind
    row = record.segments[record.filled[1]]
    record.filled[1] += 1
    row.run, row.robot, row.tick, row.kind = run, i, tick, kind
    row.x_m, row.y_m, row.heading_rad = pose[0], pose[1], wrapped_rad(pose[2])
    row.speed_m_s, row.rate_rad_s = speed_m_s, rate_rad_s


def seconds(ticks: NDArray[np.int64], tick_ms: int) -> NDArray[np.float64]:
    """Return the times of ticks, s: the float nearest to the exact decimal."""
    return ticks * tick_ms / 1000.0


def joined(pieces: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """Return the rows of one or more pieces, which have the same type, as one new array.

    The rows are copied as bytes: NumPy copies structured rows field by field, which is many times slower.
    """
    if len(pieces) == 1:
        return pieces[0].view(np.uint8).copy().view(pieces[0].dtype)
    return np.concatenate([piece.view(np.uint8) for piece in pieces]).view(pieces[0].dtype)


class Columns(ABC):
    """The columns of a table, filled from rows while the rows are still in the processor's cache.

    Columns of the same type of number are the rows of one array, in the order of ``schema``, so that there are few
    arrays to be enlarged. ``count`` is the number of rows so far.

    Args:
        room: number of rows for which to allocate memory; more is allocated when needed.
    """

    schema: ClassVar[dict[str, Any]]

    def __init__(self, tick_ms: int, room: int) -> None:
        self.tick_ms, self.count = tick_ms, 0
        kinds = [DTYPES[kind] for kind in self.schema.values()]
        # Type of number to array, shape (columns of that type, room).
        self.arrays = {kind: np.empty((kinds.count(kind), room), dtype=kind) for kind in dict.fromkeys(kinds)}

    def take(self, rows: NDArray[np.void]) -> None:
        """Append these rows; moves must have ended."""
        if rows.size == 0:
            return
        if self.count + rows.size > self.arrays[np.float64].shape[1]:  # the same for all arrays
            self.arrays = {kind: grown(array, self.count, rows.size) for kind, array in self.arrays.items()}
        self.fill(rows)
        self.count += rows.size

    @abstractmethod
    def fill(self, rows: NDArray[np.void]) -> None:
        """Write rows into the arrays, from index ``count`` on."""

    def by_name(self) -> dict[str, NDArray[Any]]:
        """Return the columns of all rows, (rows,) each, in the order in which they were taken; they are views."""
        columns = {kind: iter(array) for kind, array in self.arrays.items()}
        # Each column of the table takes the next row of the array of its type.
        return {name: next(columns[DTYPES[kind]])[: self.count] for name, kind in self.schema.items()}

    def frame(self) -> pl.DataFrame:
        """Return all rows as a table, in the order in which they were taken; its columns are views of the arrays."""
        return pl.DataFrame(self.by_name(), schema=self.schema)


class SampleColumns(Columns):
    """The columns of a table of samples, from rows ``SAMPLE_ROW``."""

    schema = MOTION

    def fill(self, rows: NDArray[np.void]) -> None:
        """See ``Columns.fill``."""
        wide, narrow = self.arrays[np.float64], self.arrays[np.float32]  # 8 and 4 bytes a number
        fill_columns(
            rows, self.arrays[np.uint32], self.arrays[np.uint16], wide, narrow, self.count, self.tick_ms
        )


class MoveColumns(Columns):
    """The columns of a table of moves that have all ended, from rows ``MOVE_ROW``."""

    schema = MOVES

    def fill(self, rows: NDArray[np.void]) -> None:
        """See ``Columns.fill``."""
        runs, robots, kinds = (self.arrays[kind][0] for kind in (np.uint32, np.uint16, np.uint8))
        fill_move_columns(rows, runs, robots, kinds, self.arrays[np.float64], self.count, self.tick_ms)

    def frame(self) -> pl.DataFrame:
        """See ``Columns.frame``; kinds become words."""
        columns: dict[str, Any] = self.by_name()
        columns["kind"] = kind_words(columns["kind"])
        columns["ray_m"] = pl.Series(columns["ray_m"], nan_to_null=True)
        return pl.DataFrame(columns, schema=MOVES)


def kind_words(kinds: NDArray[Any]) -> pl.Series:
    """Return kinds of segments or moves, indices into ``KINDS``, as the words of the tables."""
    return pl.Series(KINDS, dtype=MOVES["kind"]).gather(pl.Series(kinds))


def grown(array: NDArray[Any], count: int, more: int) -> NDArray[Any]:
    """Return a longer copy of an array of columns, shape (columns, room).

    The first ``count`` entries of each column are copied. The copy has room for ``more`` further entries, and for at
    least 1.5 times ``count`` in all, so that arrays are seldom copied.
    """
    larger = np.empty((array.shape[0], max(count + more, count + count // 2)), dtype=array.dtype)
    larger[:, :count] = array[:, :count]
    return larger


@kernel
def fill_columns(
    rows: NDArray[np.void],
    numbers: NDArray[np.uint32],
    robots: NDArray[np.uint16],
    wide: NDArray[np.float64],
    narrow: NDArray[np.float32],
    first: int,
    tick_ms: int,
) -> None:
    """Convert rows of samples to columns, which are written from index ``first`` on; ticks become times in s.

    Args:
        rows: ``SAMPLE_ROW``.
        numbers, robots, wide, narrow: one array for the columns of each type of number, in the order of ``MOTION``,
            shape (columns, room). ``numbers`` holds run and sample; ``robots`` the robot; ``wide`` the start of the
            stop, the time and the pose; ``narrow`` the times in each mode.
    """
    for k in range(rows.size):
        row, place = rows[k], first + k
        numbers[0, place], robots[0, place], numbers[1, place] = row.run, row.robot, row.sample
        wide[0, place], wide[1, place] = row.stop_tick * tick_ms / 1000.0, row.tick * tick_ms / 1000.0
        wide[2, place], wide[3, place], wide[4, place] = row.x_m, row.y_m, row.heading_rad
        narrow[0, place], narrow[1, place] = row.drive * tick_ms / 1000.0, row.turn * tick_ms / 1000.0
        narrow[2, place], narrow[3, place] = row.avoid * tick_ms / 1000.0, row.stop * tick_ms / 1000.0


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
    """Convert rows of moves to columns, which are written from index ``first`` on.

    Ticks become times in s. For turns, turn rate and speed become their means over the move.

    Args:
        rows: ``MOVE_ROW``; all moves have ended.
        runs, robots, kinds: columns, shape (room,). numbers: the columns of floats in the order of ``MOVES``,
            shape (8, room).
    """
    for k in range(rows.size):
        row, place = rows[k], first + k
        runs[place], robots[place], kinds[place] = row.run, row.robot, row.kind
        speed_m_s, rate_rad_s = row.speed_m_s, row.rate_rad_s
        if row.kind == TURN or row.kind == AVOID:
            rate_rad_s = row.turned_rad / ((row.until - row.tick) * tick_ms / 1000.0)
            # The row holds the circle's radius instead of the speed, and 0 if the turn is blocked.
            speed_m_s *= rate_rad_s
        numbers[0, place] = row.tick * tick_ms / 1000.0
        numbers[1, place], numbers[2, place] = row.x_m, row.y_m
        numbers[3, place] = wrapped_rad(row.heading_rad)
        numbers[4, place], numbers[5, place] = speed_m_s, rate_rad_s
        numbers[6, place], numbers[7, place] = row.turned_rad, row.ray_m


def frame_of(table: type[Columns], pieces: Sequence[NDArray[np.void]], tick_ms: int) -> pl.DataFrame:
    """Return pieces of rows as one table; they must be in the order of run, time, robot."""
    columns = table(tick_ms, sum(piece.size for piece in pieces))
    for piece in pieces:
        columns.take(piece)
    return columns.frame()


def segment_frame(rows: NDArray[np.void], tick_ms: int) -> pl.DataFrame:
    """Return segment rows as a table; they must be in the order of run, time, robot."""
    # ``copy`` takes each field out of the rows as a contiguous column of its own.
    return pl.DataFrame(
        {
            "run": rows["run"].copy(),
            "robot": rows["robot"].copy(),
            "start_s": seconds(rows["tick"], tick_ms),
            "x_m": rows["x_m"].copy(),
            "y_m": rows["y_m"].copy(),
            "heading_rad": rows["heading_rad"].copy(),
            "speed_m_s": rows["speed_m_s"].copy(),
            "turn_rate_rad_s": rows["rate_rad_s"].copy(),
            "kind": kind_words(rows["kind"].copy()),
        },
        schema=SEGMENTS,
    )


def end_rows(swarm: Swarm, run: int, tick: int) -> NDArray[np.void]:
    """Return rows (``END_ROW``) with the robots' poses at ``tick``, shape (robots,).

    ``stop_tick`` is the tick from which the robot stands and hears no messages. It is -1 if the robot moves, or has
    failed and stands for good but still hears (``control_step.fail`` then sets the robot's own ``stop_tick`` to -1).
    """
    ends = zero_rows(swarm.size, END_ROW)
    ends["run"], ends["robot"], ends["tick"] = run, np.arange(swarm.size), tick
    ends["x_m"], ends["y_m"] = swarm["x_m"], swarm["y_m"]
    ends["heading_rad"] = [wrapped_rad(heading) for heading in swarm["heading_rad"]]
    ends["stop_tick"] = np.where(swarm["mode"] == STOP, swarm["stop_tick"], -1)
    return ends


def end_frame(rows: NDArray[np.void], tick_ms: int) -> pl.DataFrame:
    """Return the table ``ends``: where each robot was when its run (or a piece of the run) ended.

    Args:
        rows: one row (``END_ROW``) per run and robot. Where ``stop_tick`` is -1, because the robot then heard messages,
            ``stop_start_s`` is null.
    """
    is_deaf = rows["stop_tick"] >= 0  # the robot stands and hears nothing
    stop_start_s = np.where(is_deaf, seconds(rows["stop_tick"], tick_ms), np.nan)
    # ``copy`` takes each field out of the rows as a contiguous column of its own.
    return pl.DataFrame(
        {
            "run": rows["run"].copy(),
            "robot": rows["robot"].copy(),
            "end_s": seconds(rows["tick"], tick_ms),
            "x_m": rows["x_m"].copy(),
            "y_m": rows["y_m"].copy(),
            "heading_rad": rows["heading_rad"].copy(),
            "stop_start_s": pl.Series(stop_start_s, nan_to_null=True),
        },
        schema=ENDS,
    )


def tables(pieces: Sequence[Rows], tick_ms: int) -> Motion:
    """Return the rows of one or more runs, or of a piece of a run, as one ``Motion``, in the order of ``pieces``.

    Args:
        pieces: one per run, at least one, in the order of runs.
    """
    samples = frame_of(SampleColumns, [piece.samples for piece in pieces], tick_ms)
    return with_samples(samples, pieces, tick_ms)


def one_run(pieces: Sequence[Rows]) -> Rows:
    """Join consecutive pieces of one run, at least one.

    A move that was under way at the end of a piece is also in the next piece, as it went on: that row is taken.
    """
    segments = [piece.segments for piece in pieces if piece.segments is not None]
    moves = [piece.moves for piece in pieces if piece.moves is not None]
    return pieces[-1]._replace(
        samples=joined([piece.samples for piece in pieces]),
        segments=joined(segments) if segments else None,
        moves=_latest_moves(joined(moves)) if moves else None,
    )


def _latest_moves(moves: NDArray[np.void]) -> NDArray[np.void]:
    """Return rows of moves sorted by start and robot; of rows with the same start and robot, the last one."""
    order = np.lexsort((moves["robot"], moves["tick"]))  # stable: a later row stays behind an earlier one
    moves = moves[order]
    goes_on = (moves["tick"][1:] == moves["tick"][:-1]) & (moves["robot"][1:] == moves["robot"][:-1])
    return moves[np.append(~goes_on, True)]


def with_samples(samples: pl.DataFrame, pieces: Sequence[Rows], tick_ms: int) -> Motion:
    """Return one ``Motion`` of one or more runs, from their table of samples and their rows of all other tables.

    Args:
        samples: the samples of all runs. The samples in ``pieces`` are not used.
        pieces: the rows of ends, segments, moves and failures; one piece per run, at least one, in the order of runs.
    """
    segments = [piece.segments for piece in pieces if piece.segments is not None]
    moves = [piece.moves for piece in pieces if piece.moves is not None]
    return Motion(
        samples=samples,
        ends=end_frame(joined([piece.ends for piece in pieces]), tick_ms),
        segments=pl.concat([segment_frame(rows, tick_ms) for rows in segments]) if segments else None,
        moves=frame_of(MoveColumns, moves, tick_ms) if moves else None,
        failures=failure_frame([piece.failure for piece in pieces if piece.failure is not None], tick_ms),
    )


def failure_frame(failures: Sequence[Failure], tick_ms: int) -> pl.DataFrame | None:
    """Return failures of runs as a table, or None if no run failed."""
    if not failures:
        return None
    rows = [(failure.run, failure.tick * tick_ms / 1000.0, failure.reason) for failure in failures]
    return pl.DataFrame(rows, schema=FAILURES, orient="row")
