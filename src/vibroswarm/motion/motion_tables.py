"""Tables of motion (``source`` describes them), in s; the rows that sources give, in ticks; how rows become tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel
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


Take = Callable[[Rows], None]
"""A function that receives new rows. They are overwritten later, so it must copy what it wants to keep."""


class Sink(NamedTuple):
    """What takes the rows of a run that is simulated."""

    samples: Take
    """Called with samples, ``SAMPLE_ROW``, in order of time and robot."""
    moves: Take = lambda rows: None
    """Called with moves that have ended, ``MOVE_ROW``, in order of start and robot."""


class Columns:
    """Columns of rows, an array for each type of number; rows are converted while they are in the processor's cache."""

    def __init__(self, fill: Callable[..., None], tick_ms: int, *arrays: NDArray[Any]) -> None:
        self.fill, self.tick_ms, self.arrays, self.count = fill, tick_ms, list(arrays), 0

    def take(self, rows: Rows) -> None:
        """Append rows; the arrays grow twofold."""
        end = self.count + rows.size
        for k, array in enumerate(self.arrays if end > self.arrays[0].shape[1] else ()):
            self.arrays[k] = np.empty((len(array), 2 * end), dtype=array.dtype)
            self.arrays[k][:, : self.count] = array[:, : self.count]
        self.fill(rows, *self.arrays, self.count, self.tick_ms)
        self.count = end

    def all(self) -> list[NDArray[Any]]:
        """Return the columns, views of the arrays."""
        return [column[: self.count] for array in self.arrays for column in array]


class Collected:
    """The rows of runs, one run after the other, until they become tables."""

    def __init__(self, tick_ms: int) -> None:
        self.tick_ms = tick_ms
        self.samples = Columns(
            fill_samples,
            tick_ms,
            np.empty((3, 0), np.uint32),
            np.empty((5, 0)),
            np.empty((5, 0), np.float32),
        )
        self.moves = Columns(fill_moves, tick_ms, np.empty((3, 0), np.uint32), np.empty((8, 0)))
        self.sink = Sink(self.samples.take, self.moves.take)
        self.ends, self.failures = list[Rows](), list[Failure]()

    def end(self, state: Any) -> None:
        """Take what is left of the present run of a ``source.MotionState``."""
        self.ends.append(state.finish(self.sink))
        if state.failure is not None:
            self.failures.append(state.failure)

    def samples_frame(self) -> pl.DataFrame:
        """Return the table of samples."""
        run, robot, *columns = self.samples.all()
        # polars takes longer to change the type of ``robot``
        return pl.DataFrame(
            dict(zip(MOTION, (run, robot.astype(np.uint16), *columns), strict=True)), schema=MOTION
        )

    def motion(self) -> Motion:
        """Return all rows as tables; there are moves if any were given."""
        return Motion(
            samples=self.samples_frame(),
            ends=end_frame(joined(self.ends), self.tick_ms),
            moves=move_frame(self.moves) if self.moves.count else None,
            failures=pl.DataFrame(self.failures, schema=FAILURES, orient="row") if self.failures else None,
        )


def joined(pieces: Sequence[Rows]) -> Rows:
    """Return the rows of one or more pieces, which have the same type, as one new array.

    They are copied as bytes: NumPy copies structured rows field by field, which is many times slower.
    """
    return np.concatenate([piece.view(np.uint8) for piece in pieces]).view(pieces[0].dtype, type(pieces[0]))


def seconds(ticks: NDArray[np.int64], tick_ms: int) -> NDArray[np.float64]:
    """Return the times of ticks, s: the float nearest to the exact decimal."""
    return ticks * tick_ms / 1000.0


def wrapped(angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the same angles in [-pi, pi), to the last bit as ``geometry.wrapped_rad``."""
    return angles_rad - 2.0 * np.pi * np.floor((angles_rad + np.pi) / (2.0 * np.pi))


@kernel
def fill_samples(
    rows: Rows,
    numbers: NDArray[np.uint32],
    wide: NDArray[np.float64],
    narrow: NDArray[np.float32],
    first: int,
    tick_ms: int,
) -> None:
    """Write the columns of samples from ``first`` on: run, robot, sample; times, pose; times in each mode, blocked."""
    for n in range(rows.size):
        row, k = rows[n], first + n
        numbers[0, k], numbers[1, k], numbers[2, k] = row.run, row.robot, row.sample
        wide[0, k], wide[1, k] = row.stop_tick * tick_ms / 1000.0, row.tick * tick_ms / 1000.0
        wide[2, k], wide[3, k], wide[4, k] = row.x_m, row.y_m, row.heading_rad
        narrow[0, k], narrow[1, k] = row.drive * tick_ms / 1000.0, row.turn * tick_ms / 1000.0
        narrow[2, k], narrow[3, k] = row.avoid * tick_ms / 1000.0, row.stop * tick_ms / 1000.0
        narrow[4, k] = row.blocked * tick_ms / 1000.0


def end_frame(rows: Rows, tick_ms: int) -> pl.DataFrame:
    """Return the table ``ends``; robots that hear messages (``stop_tick`` -1) have no ``stop_start_s``."""
    stop_s = np.where(rows["stop_tick"] >= 0, seconds(rows["stop_tick"], tick_ms), np.nan)
    run, robot, *pose = (rows[name].copy() for name in ("run", "robot", "x_m", "y_m", "heading_rad"))
    columns = [run, robot, seconds(rows["tick"], tick_ms), *pose, pl.Series(stop_s, nan_to_null=True)]
    return pl.DataFrame(dict(zip(ENDS, columns, strict=True)), schema=ENDS)


@kernel
def fill_moves(
    rows: Rows, kinds: NDArray[np.uint32], columns: NDArray[np.float64], first: int, tick_ms: int
) -> None:
    """Write the columns of moves from ``first`` on: run, robot, kind; start, pose, rates, angle turned, ray."""
    for n in range(rows.size):
        row, k = rows[n], first + n
        speed_m_s, rate_rad_s = row.speed_m_s, row.rate_rad_s
        if row.kind == TURN or row.kind == AVOID:
            # The row of a turn holds the circle's radius instead of the speed, and 0 if the turn is blocked.
            rate_rad_s = row.turned_rad / ((row.until - row.tick) * tick_ms / 1000.0)
            speed_m_s *= rate_rad_s
        columns[0, k], columns[1, k], columns[2, k] = row.tick * tick_ms / 1000.0, row.x_m, row.y_m
        columns[3, k], columns[4, k], columns[5, k] = wrapped_rad(row.heading_rad), speed_m_s, rate_rad_s
        columns[6, k], columns[7, k] = row.turned_rad, row.ray_m
        kinds[0, k], kinds[1, k], kinds[2, k] = row.run, row.robot, row.kind


def move_frame(moves: Columns) -> pl.DataFrame:
    """Return moves as a table; they must be in the order of run, start, robot."""
    run, robot, kind, *columns, turned_rad, ray_m = moves.all()
    kinds = pl.Series(KINDS, dtype=KIND).gather(kind)
    frame = [run, robot.astype(np.uint16), *columns, kinds, turned_rad, pl.Series(ray_m, nan_to_null=True)]
    return pl.DataFrame(dict(zip(MOVES, frame, strict=True)), schema=MOVES)
