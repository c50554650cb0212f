"""What the engines write down: buffers of samples, segments and moves, and their tables.

Kernels fill arrays of plain rows; ``sample_frame``, ``segment_frame`` and ``end_frame`` turn them into the
tables of the contract.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, zero_rows
from vibroswarm.motion.control_step import Swarm, clear_account
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.motion.moves import MOVE_ROW, MOVES_AT_ONCE, UNDER_WAY, MoveColumns
from vibroswarm.motion.source import ENDS, FAILURES, MOTION, SEGMENTS, Motion
from vibroswarm.robot.walk import KINDS, STOP

SAMPLE_ROW = np.dtype(
    [("run", np.uint32), ("robot", np.uint16), ("sample", np.uint32)]
    + [("stop_tick", np.int64), ("tick", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad")]
    + [(name, np.int64) for name in ("drive", "turn", "avoid", "stop")]
)  # fmt: skip
SEGMENT_ROW = np.dtype(
    [("run", np.uint32), ("robot", np.uint16), ("tick", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad", "speed_m_s", "rate_rad_s")]
    + [("kind", np.int64)]
)  # fmt: skip

END_ROW = np.dtype(
    [("run", np.uint32), ("robot", np.uint16), ("tick", np.int64), ("stop_tick", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad")]
)  # fmt: skip


DTYPES = {pl.UInt16: np.uint16, pl.UInt32: np.uint32, pl.Float32: np.float32, pl.Float64: np.float64}


class Failure(NamedTuple):
    """Why a run failed, and at which tick."""

    run: int
    tick: int
    reason: str


class Rows(NamedTuple):
    """What one run has written: ``SAMPLE_ROW``, ``SEGMENT_ROW`` (or None), ``END_ROW``, ``MOVE_ROW`` (or None)."""

    samples: NDArray[np.void]
    segments: NDArray[np.void] | None
    ends: NDArray[np.void]
    moves: NDArray[np.void] | None = None
    failure: Failure | None = None


class Record(NamedTuple):
    """Rows written so far; ``filled`` holds how many of each."""

    samples: NDArray[np.void]
    segments: NDArray[np.void]
    moves: NDArray[np.void]
    filled: NDArray[np.int64]
    """(3,): samples, segments, moves."""
    latest: NDArray[np.float64]
    """(robots, 3): speed, turn rate and kind of each robot's open segment; kind -1: none yet."""
    under_way: NDArray[np.void]
    """``UNDER_WAY``, (robots,): each robot's move under way."""


def empty_record(robots: int, samples: int, segments: int, moves: bool = False) -> Record:
    """Return buffers for these numbers of samples and segments (0: not recorded), and for moves if ``moves``."""
    record = Record(
        zero_rows(samples, SAMPLE_ROW),
        zero_rows(segments, SEGMENT_ROW),
        zero_rows(max(MOVES_AT_ONCE, 64 * robots) if moves else 0, MOVE_ROW),
        np.zeros(3, dtype=np.int64),
        np.zeros((robots, 3)),
        zero_rows(robots, UNDER_WAY),
    )
    clear(record)
    return record


def clear(record: Record) -> None:
    """Clear the buffers."""
    record.filled[:], record.latest[:] = 0, -1.0
    record.under_way["place"], record.under_way["doing"], record.under_way["avoidances"] = -1, -1, 0


def copy_record(record: Record) -> Record:
    """Return independent copies of the buffers."""
    # Zeroed pages take memory only when they are written.
    buffers = (record.samples, record.segments, record.moves)
    samples, segments, moves = (zero_rows(rows.size, rows.dtype) for rows in buffers)
    for copy, original, count in zip((samples, segments, moves), buffers, record.filled, strict=True):
        copy[:count] = original[:count]
    return Record(
        samples, segments, moves, record.filled.copy(), record.latest.copy(), record.under_way.copy()
    )


@inner
def room(record: Record, robots: int) -> int:
    """Return the number of ticks for which the buffers suffice even if every robot writes one row of each table per
    tick."""
    ticks = (record.samples.size - record.filled[0]) // robots
    if record.segments.size > 0:
        ticks = min(ticks, (record.segments.size - record.filled[1]) // robots)
    if record.moves.size > 0:
        ticks = min(ticks, (record.moves.size - record.filled[2]) // robots)
    return int(ticks)


@inner
def room_for(record: Record, rows: int, moves: int) -> tuple[int, int, int]:
    """Return the largest fill levels of samples, segments and moves at which the wanted rows still fit; 0 for tables
    that are not recorded.

    Args:
        rows: wanted rows of samples, and as many of segments. moves: wanted rows of moves.
    """
    segments = record.segments.size - rows if record.segments.size > 0 else 0
    return record.samples.size - rows, segments, record.moves.size - moves if record.moves.size > 0 else 0


@inner
def write_sample(record: Record, swarm: Swarm, run: int, i: int, tick: int) -> None:
    """Write a row for the sample that robot ``i`` takes at this tick, and reset its times in each mode."""
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
    """Write a segment for each robot whose speed, turn rate or kind differs from its open segment.

    Args:
        after_move: whether the robots have moved already: their poses at this tick are then in ``from_x_m``,
            ``from_y_m`` and ``from_heading_rad``.
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
    """Write a segment if robot ``i``'s speed, turn rate or kind differs from its open segment."""
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
    """Return the rows of several pieces as one copy; copies bytes, since numpy copies field by field."""
    if len(pieces) == 1:
        return pieces[0].view(np.uint8).copy().view(pieces[0].dtype)
    return np.concatenate([piece.view(np.uint8) for piece in pieces]).view(pieces[0].dtype)


class SampleColumns:
    """The columns of a motion table, filled from rows as they come, while those are still in the cache.

    Numbers of a kind are the rows of one array, shape (columns, room): arrays that grow are few.
    """

    def __init__(self, tick_ms: int, room: int) -> None:
        self.tick_ms, self.count = tick_ms, 0
        kinds = [DTYPES[kind] for kind in MOTION.values()]
        self.arrays = {kind: np.empty((kinds.count(kind), room), dtype=kind) for kind in dict.fromkeys(kinds)}

    def take(self, rows: NDArray[np.void]) -> None:
        """Append these rows (``SAMPLE_ROW``)."""
        if rows.size == 0:
            return
        room = self.arrays[np.float64].shape[1]
        if self.count + rows.size > room:
            self.arrays = {kind: grown(array, self.count, rows.size) for kind, array in self.arrays.items()}
        wide, narrow = self.arrays[np.float64], self.arrays[np.float32]
        fill_columns(
            rows, self.arrays[np.uint32], self.arrays[np.uint16], wide, narrow, self.count, self.tick_ms
        )
        self.count += rows.size

    def frame(self) -> pl.DataFrame:
        """Return all rows as a table."""
        columns = {kind: iter(array) for kind, array in self.arrays.items()}
        named = {name: next(columns[DTYPES[kind]])[: self.count] for name, kind in MOTION.items()}
        return pl.DataFrame(named, schema=MOTION)


def grown(array: NDArray[Any], count: int, more: int) -> NDArray[Any]:
    """Return a copy of the first ``count`` columns with room for at least ``more`` further ones, and for half as many
    again as there are."""
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
    """Convert ``SAMPLE_ROW`` to columns in the order of ``MOTION``, one array per kind of number; ticks become s."""
    for k in range(rows.size):
        row, place = rows[k], first + k
        numbers[0, place], robots[0, place], numbers[1, place] = row.run, row.robot, row.sample
        wide[0, place], wide[1, place] = row.stop_tick * tick_ms / 1000.0, row.tick * tick_ms / 1000.0
        wide[2, place], wide[3, place], wide[4, place] = row.x_m, row.y_m, row.heading_rad
        narrow[0, place], narrow[1, place] = row.drive * tick_ms / 1000.0, row.turn * tick_ms / 1000.0
        narrow[2, place], narrow[3, place] = row.avoid * tick_ms / 1000.0, row.stop * tick_ms / 1000.0


def sample_frame(pieces: Sequence[NDArray[np.void]], tick_ms: int) -> pl.DataFrame:
    """Return the motion table of pieces that are in the order of run, time, robot."""
    columns = SampleColumns(tick_ms, sum(piece.size for piece in pieces))
    for piece in pieces:
        columns.take(piece)
    return columns.frame()


def segment_frame(rows: NDArray[np.void], tick_ms: int) -> pl.DataFrame:
    """Return the segment table, in the order of run, time, robot."""
    kinds = np.array(KINDS)
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
            "kind": kinds[rows["kind"]].tolist(),
        },
        schema=SEGMENTS,
    )


def end_rows(swarm: Swarm, run: int, tick: int) -> NDArray[np.void]:
    """Return the robots' poses at ``tick``, and the start of a stop under way (-1: none)."""
    ends = zero_rows(swarm.size, END_ROW)
    ends["run"], ends["robot"], ends["tick"] = run, np.arange(swarm.size), tick
    ends["x_m"], ends["y_m"] = swarm["x_m"], swarm["y_m"]
    ends["heading_rad"] = [wrapped_rad(heading) for heading in swarm["heading_rad"]]
    ends["stop_tick"] = np.where(swarm["mode"] == STOP, swarm["stop_tick"], -1)
    return ends


def end_frame(rows: NDArray[np.void], tick_ms: int) -> pl.DataFrame:
    """Return the table of ends; ``stop_start_s`` is null for robots that walk."""
    stopping = rows["stop_tick"] >= 0
    stop_start_s = np.where(stopping, seconds(rows["stop_tick"], tick_ms), np.nan)
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
    """Return the rows of several runs as one Motion."""
    return with_samples(sample_frame([piece.samples for piece in pieces], tick_ms), pieces, tick_ms)


def with_samples(samples: pl.DataFrame, pieces: Sequence[Rows], tick_ms: int) -> Motion:
    """Return a table of samples, and the ends, segments and moves of the same runs, as one Motion."""
    segments = [piece.segments for piece in pieces if piece.segments is not None]
    moves = [piece.moves for piece in pieces if piece.moves is not None]
    return Motion(
        samples=samples,
        ends=end_frame(joined([piece.ends for piece in pieces]), tick_ms),
        segments=segment_frame(joined(segments), tick_ms) if segments else None,
        moves=move_frame(moves, tick_ms) if moves else None,
        failures=failure_frame([piece.failure for piece in pieces if piece.failure is not None], tick_ms),
    )


def failure_frame(failures: Sequence[Failure], tick_ms: int) -> pl.DataFrame | None:
    """Return the table of failed runs, or None if there is none."""
    if not failures:
        return None
    rows = [(failure.run, failure.tick * tick_ms / 1000.0, failure.reason) for failure in failures]
    return pl.DataFrame(rows, schema=FAILURES, orient="row")


def move_frame(pieces: Sequence[NDArray[np.void]], tick_ms: int) -> pl.DataFrame:
    """Return the table of moves of pieces that are in the order of run, start, robot."""
    columns = MoveColumns(tick_ms, sum(piece.size for piece in pieces))
    for piece in pieces:
        columns.take(piece)
    return columns.frame()
