"""Tables of motion: their columns, the rows that sources give, and how rows become tables.

Rows hold times in ticks (control periods); tables hold them in s. What tables mean is described in ``source``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel, zero_rows
from vibroswarm.core.tables import Schema
from vibroswarm.motion.geometry import wrapped_rad
from vibroswarm.robot.walk import AVOID, KINDS, TURN

Rows = NDArray[np.void]
"""Rows with the fields of one of the types below."""

KIND: Final = pl.Enum(["drive", "turn", "avoid", "stop"])
"""What a robot does."""
MOTION: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "stop_start_s": pl.Float64,
    "time_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "drive_s": pl.Float32,
    "turn_s": pl.Float32,
    "avoid_s": pl.Float32,
    "stop_s": pl.Float32,
    "blocked_s": pl.Float32,
}
"""Columns of the table ``samples`` and their types."""
MOVES: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "start_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "speed_m_s": pl.Float64,
    "turn_rate_rad_s": pl.Float64,
    "kind": KIND,
    "turned_rad": pl.Float64,
    "ray_m": pl.Float64,
}
"""Columns of the table ``moves`` and their types."""
POSES: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "time_s": pl.Float64,
    "x_m": pl.Float32,
    "y_m": pl.Float32,
    "heading_rad": pl.Float32,
    "kind": KIND,
}
"""Columns of the table ``poses`` and their types (see ``pose``); the largest table, hence 32 bits."""
ENDS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "end_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "stop_start_s": pl.Float64,
}
"""Columns of the table ``ends`` and their types."""
FAILURES: Final[dict[str, Any]] = {"run": pl.UInt32, "time_s": pl.Float64, "reason": pl.String}
"""Runs that failed: since when their robots stand, and why."""
SCHEMAS: Final = {
    "samples": Schema(MOTION),
    "ends": Schema(ENDS, frozenset({"stop_start_s"})),  # a robot that does not stand has none
    "moves": Schema(MOVES, frozenset({"ray_m"})),
    "failures": Schema(FAILURES),
}
"""The tables of a ``Motion``, in its order."""

SAMPLE_ROW = np.dtype(
    [("run", np.uint32), ("robot", np.uint16), ("sample", np.uint32)]
    + [("stop_tick", np.int64), ("tick", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad")]
    + [(name, np.int64) for name in ("drive", "turn", "avoid", "stop", "blocked")]
)  # fmt: skip
"""A sample at ``tick``, the end of the stop that began at ``stop_tick``; ``drive`` to ``stop`` are ticks in each mode
since the robot's previous sample, and ``blocked`` those of ``drive`` in which it was blocked."""
MOVE_ROW = np.dtype(
    [(name, np.int64) for name in ("tick", "until")]
    + [("run", np.uint32), ("robot", np.int32), ("kind", np.int32)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad", "speed_m_s", "rate_rad_s")]
    + [(name, np.float64) for name in ("turned_rad", "ray_m")]
)
"""A move from ``tick`` to ``until`` (-1 while it is under way). The heading is not wrapped. For a turning robot,
``speed_m_s`` holds the radius of the circle on which its centre moves, m, until the row becomes part of a table."""
END_ROW = np.dtype(
    [("run", np.uint32), ("robot", np.uint16), ("tick", np.int64), ("stop_tick", np.int64)]
    + [(name, np.float64) for name in ("x_m", "y_m", "heading_rad")]
)  # fmt: skip
"""A robot's pose at ``tick``, and the tick from which it stands and hears nothing (-1: it moves or hears)."""


class Failure(NamedTuple):
    """Why a run failed, and when."""

    run: int
    """The run's number."""
    time_s: float
    """Time from which the robots stand."""
    reason: str
    """Why the run failed, in words."""


@dataclass(frozen=True)
class Motion:
    """The tables of one or more runs; see ``source``."""

    samples: pl.DataFrame
    """One row per sample (columns ``MOTION``)."""
    ends: pl.DataFrame
    """Each robot's pose at the end of its run (columns ``ENDS``)."""
    moves: pl.DataFrame | None = None
    """One row per drive, turn, avoidance or stop (columns ``MOVES``); None if they were not requested."""
    failures: pl.DataFrame | None = None
    """``FAILURES``; None if no run failed."""


MoveColumns = tuple[NDArray[np.float64], NDArray[np.uint32]]
"""Columns of moves: start to turn rate, angle turned and ray; and run, robot and kind."""
Take = Callable[[Rows], None]
"""A function that receives new rows. They are overwritten later, so it must copy what it wants to keep."""


class Sink(NamedTuple):
    """What takes the rows of a run that is simulated."""

    samples: Take
    """Called with samples, ``SAMPLE_ROW``, in order of time and robot."""
    moves: Take = lambda rows: None
    """Called with moves that have ended, ``MOVE_ROW``, in order of start and robot."""


class Collected:
    """The rows of runs, one run after the other, until they become tables."""

    def __init__(self, tick_ms: int) -> None:
        self.tick_ms = tick_ms
        self.samples, self.moves, self.ends = list[Rows](), list[MoveColumns](), list[Rows]()
        self.failures: list[Failure] = []
        self.sink = Sink(
            lambda rows: self.samples.append(joined([rows])),
            lambda rows: self.moves.append(move_columns(rows, self.tick_ms)),
        )

    def end(self, state: Any) -> None:
        """Take what is left of the present run of a ``source.MotionState``."""
        self.ends.append(state.finish(self.sink))
        if state.failure is not None:
            self.failures.append(state.failure)

    def samples_frame(self) -> pl.DataFrame:
        """Return the table of samples."""
        return sample_frame(joined([zero_rows(0, SAMPLE_ROW), *self.samples]), self.tick_ms)

    def motion(self) -> Motion:
        """Return all rows as tables; there are moves if any were given."""
        return Motion(
            samples=self.samples_frame(),
            ends=end_frame(joined(self.ends), self.tick_ms),
            moves=move_frame(self.moves) if self.moves else None,
            failures=pl.DataFrame(self.failures, schema=FAILURES, orient="row") if self.failures else None,
        )


def joined(pieces: Sequence[Rows]) -> Rows:
    """Return the rows of one or more pieces, which have the same type, as one new array.

    The rows are copied as bytes: NumPy copies structured rows field by field, which is many times slower.
    """
    return np.concatenate([piece.view(np.uint8) for piece in pieces]).view(pieces[0].dtype, type(pieces[0]))


def seconds(ticks: NDArray[np.int64], tick_ms: int) -> NDArray[np.float64]:
    """Return the times of ticks, s: the float nearest to the exact decimal."""
    return ticks * tick_ms / 1000.0


def wrapped(angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the same angles in [-pi, pi), to the last bit as ``geometry.wrapped_rad``."""
    return angles_rad - 2.0 * np.pi * np.floor((angles_rad + np.pi) / (2.0 * np.pi))


@kernel
def fill_samples(rows: Rows, wide: NDArray[np.float64], narrow: NDArray[np.float32], tick_ms: int) -> None:
    """Write the columns of samples: start of the stop, time and pose; and the times in each mode, and blocked."""
    for k in range(rows.size):
        row = rows[k]
        wide[0, k], wide[1, k] = row.stop_tick * tick_ms / 1000.0, row.tick * tick_ms / 1000.0
        wide[2, k], wide[3, k], wide[4, k] = row.x_m, row.y_m, row.heading_rad
        narrow[0, k], narrow[1, k] = row.drive * tick_ms / 1000.0, row.turn * tick_ms / 1000.0
        narrow[2, k], narrow[3, k] = row.avoid * tick_ms / 1000.0, row.stop * tick_ms / 1000.0
        narrow[4, k] = row.blocked * tick_ms / 1000.0


def sample_frame(rows: Rows, tick_ms: int) -> pl.DataFrame:
    """Return samples as a table; they must be in the order of run, time, robot."""
    wide, narrow = np.empty((5, rows.size)), np.empty((5, rows.size), dtype=np.float32)
    fill_samples(rows, wide, narrow, tick_ms)
    return _frame(dict(zip(list(MOTION)[3:], (*wide, *narrow), strict=True)), rows, MOTION)


def end_frame(rows: Rows, tick_ms: int) -> pl.DataFrame:
    """Return the table ``ends``; robots that hear messages (``stop_tick`` -1) have no ``stop_start_s``."""
    stop_s = np.where(rows["stop_tick"] >= 0, seconds(rows["stop_tick"], tick_ms), np.nan)
    columns = {"end_s": seconds(rows["tick"], tick_ms), "stop_start_s": pl.Series(stop_s, nan_to_null=True)}
    return _frame(columns, rows, ENDS)


@kernel
def fill_moves(rows: Rows, columns: NDArray[np.float64], kinds: NDArray[np.uint32], tick_ms: int) -> None:
    """Write the columns of moves: times, poses, rates and distances; and run, robot and kind."""
    for k in range(rows.size):
        row = rows[k]
        speed_m_s, rate_rad_s = row.speed_m_s, row.rate_rad_s
        if row.kind == TURN or row.kind == AVOID:
            # The row of a turn holds the circle's radius instead of the speed, and 0 if the turn is blocked.
            rate_rad_s = row.turned_rad / ((row.until - row.tick) * tick_ms / 1000.0)
            speed_m_s *= rate_rad_s
        columns[0, k], columns[1, k], columns[2, k] = row.tick * tick_ms / 1000.0, row.x_m, row.y_m
        columns[3, k], columns[4, k], columns[5, k] = wrapped_rad(row.heading_rad), speed_m_s, rate_rad_s
        columns[6, k], columns[7, k] = row.turned_rad, row.ray_m
        kinds[0, k], kinds[1, k], kinds[2, k] = row.run, row.robot, row.kind


def move_columns(rows: Rows, tick_ms: int) -> MoveColumns:
    """Return moves that have ended by columns: rows are converted while they are in the processor's cache."""
    columns = np.empty((8, rows.size)), np.empty((3, rows.size), dtype=np.uint32)
    fill_moves(rows, *columns, tick_ms)
    return columns


def move_frame(moves: Sequence[MoveColumns]) -> pl.DataFrame:
    """Return moves as a table; they must be in the order of run, start, robot."""
    numbers, (run, robot, kind) = (np.concatenate(parts, axis=1) for parts in zip(*moves, strict=True))
    kinds = pl.Series(KINDS, dtype=KIND).gather(kind)
    *columns, turned_rad, ray_m = numbers
    frame = [run, robot, *columns, kinds, turned_rad, pl.Series(ray_m, nan_to_null=True)]
    return pl.DataFrame(dict(zip(MOVES, frame, strict=True)), schema=MOVES)


def _frame(columns: Mapping[str, Any], rows: Rows, schema: Mapping[str, Any]) -> pl.DataFrame:
    """Return a table of these columns, and of the fields of rows for those that are not given."""
    # ``copy`` makes a field of the rows a contiguous column.
    return pl.DataFrame(
        {name: columns[name] if name in columns else rows[name].copy() for name in schema},
        schema=dict(schema),
    )
