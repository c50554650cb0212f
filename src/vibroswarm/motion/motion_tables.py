"""Tables of motion, their columns, and checks of tables from sources that are not ours; ``source`` describes them."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.fork_guard import check_threads
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import CodeError, InputError, RunError
from vibroswarm.scenario.fault_fields import MOTION_FAULTS
from vibroswarm.scenario.scenario import Scenario

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
}
SEGMENTS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "start_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "speed_m_s": pl.Float64,
    "turn_rate_rad_s": pl.Float64,
    "kind": pl.Enum(["drive", "turn", "avoid", "stop"]),
}
MOVES: Final[dict[str, Any]] = {**SEGMENTS, "turned_rad": pl.Float64, "ray_m": pl.Float64}
ENDS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "end_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "stop_start_s": pl.Float64,
}
FAILURES: Final[dict[str, Any]] = {"run": pl.UInt32, "time_s": pl.Float64, "reason": pl.String}
"""Runs that failed: since when their robots stand, and why."""


@dataclass(frozen=True)
class Motion(NotebookView):
    """The tables of a source, see ``source``."""

    samples: pl.DataFrame
    ends: pl.DataFrame
    segments: pl.DataFrame | None = None
    moves: pl.DataFrame | None = None
    failures: pl.DataFrame | None = None
    """``FAILURES``; None if no run failed."""

    def __repr__(self) -> str:
        more = [name for name in ("segments", "moves") if getattr(self, name) is not None]
        runs, robots = self.ends["run"].n_unique(), self.ends["robot"].n_unique()
        parts = [
            f"{runs} run{'s' * (runs != 1)}",
            f"{robots} robot{'s' * (robots != 1)}",
            f"{self.samples.height:,} samples",
            *([f"with {' and '.join(more)}"] if more else []),
            *([f"{self.failures.height} failed"] if self.failures is not None else []),
        ]
        return f"Motion({', '.join(parts)})"


def join(pieces: Sequence[Motion]) -> Motion:
    """Join pieces of motion, in the order of runs and of time within a run.

    The ends of a run, and the data of a move that several pieces contain, are those of the last piece.
    """
    check_threads()
    ends = pl.concat([piece.ends for piece in pieces])
    ends = ends.group_by("run", "robot", maintain_order=True).last()
    segments = [piece.segments for piece in pieces if piece.segments is not None]
    failures = [piece.failures for piece in pieces if piece.failures is not None]
    return Motion(
        pl.concat([piece.samples for piece in pieces]),
        ends.select(list(ENDS)),
        pl.concat(segments) if segments else None,
        _join_moves([piece.moves for piece in pieces if piece.moves is not None]),
        pl.concat(failures).unique("run", keep="first", maintain_order=True) if failures else None,
    )


def _join_moves(pieces: Sequence[pl.DataFrame]) -> pl.DataFrame | None:
    if len(pieces) < 2:
        return pieces[0] if pieces else None
    latest = pl.concat(pieces).unique(["run", "robot", "start_s"], keep="last")
    return latest.sort("run", "start_s", "robot")


def checked(
    init: Callable[..., Any],
    scenario: Scenario,
    seed: int,
    run: int,
    segments: bool = False,
    moves: bool = False,
) -> CheckedState:
    """Return a run at time 0, see ``source.Init``, that checks its output.

    Raises:
        CodeError: ``init`` raised.
        InputError: robots stop for good, which only our engines simulate.
    """
    _refuse_faults(scenario)
    state = _called(init, init, scenario, seed, run, segments=segments, moves=moves)
    return CheckedState(state, init, scenario, run)


def checked_batch(
    batch: Callable[..., Any],
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    segments: bool = False,
    moves: bool = False,
) -> Motion:
    """Return whole runs, see ``source.Batch``, checked.

    Raises:
        CodeError: ``batch`` raised, or its result is not a valid ``Motion``.
        InputError: robots stop for good, which only our engines simulate.
    """
    _refuse_faults(scenario)
    motion_parts: Any = _called(batch, batch, scenario, seed, runs, segments=segments, moves=moves)
    for run in runs:
        part = motion_parts
        if isinstance(motion_parts, Motion) and all(
            "run" in one.columns for one in (motion_parts.samples, motion_parts.ends)
        ):
            of_run = pl.col("run") == run
            part = Motion(
                motion_parts.samples.filter(of_run),
                motion_parts.ends.filter(of_run),
                motion_parts.segments,
                motion_parts.moves,
            )
        end_s = scenario.ticks * scenario.tick_s
        for problem in _wrong(part, scenario, run, 0.0, end_s, end_s):
            raise CodeError(f"{_file_of(batch)}: {problem}")
    motion: Motion = motion_parts
    return motion


def _refuse_faults(scenario: Scenario) -> None:
    """Raise an ``InputError`` if robots of a scenario stop for good."""
    for kind in MOTION_FAULTS:
        if getattr(scenario.faults, kind):
            raise InputError(
                "this source of motion does not simulate robots that stop for good; 'event' and 'fixed-step' do",
                field=f"faults.{kind}",
            )


class CheckedState:
    """A ``MotionState`` that wraps and checks another.

    Raises (through ``advance`` and ``copy``):
        CodeError: the other raised, or its result is not a valid ``Motion``; the message names table and column.
    """

    def __init__(self, state: Any, init: Callable[..., Any], scenario: Scenario, run: int) -> None:
        self.state, self.init, self.scenario, self.run = state, init, scenario, run

    @property
    def time_s(self) -> float:
        """Time up to which motion is known, s."""
        return float(_called(self.init, lambda: self.state.time_s))

    def advance(self, until_s: float) -> Motion:
        """See ``MotionState.advance``."""
        before_s = self.time_s
        piece = _called(self.init, self.state.advance, until_s)
        for problem in _wrong(piece, self.scenario, self.run, before_s, until_s, self.time_s):
            raise CodeError(f"{_file_of(self.init)}: {problem}")
        motion: Motion = piece
        return motion

    def copy(self) -> CheckedState:
        """See ``MotionState.copy``."""
        return CheckedState(_called(self.init, self.state.copy), self.init, self.scenario, self.run)


def _called(init: Callable[..., Any], function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """Call a user's function, and report its errors with file and line.

    Raises:
        CodeError: it raised; the file and the line are named.
    """
    try:
        return function(*arguments, **named)
    except (InputError, RunError):
        raise
    except Exception as error:
        file = _file_of(init)
        lines = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
        place = f"{file}, line {lines[-1].lineno}, in {lines[-1].name}" if lines else file
        raise CodeError(f"{place}: {type(error).__name__}: {error}") from None


def _file_of(init: Callable[..., Any]) -> str:
    code = getattr(init, "__code__", None) or getattr(getattr(init, "__init__", None), "__code__", None)
    return str(getattr(code, "co_filename", "a source of motion"))


def _wrong(
    piece: Any, scenario: Scenario, run: int, before_s: float, until_s: float, after_s: float
) -> Iterator[str]:
    """Yield the errors in a piece of motion, in words; nothing if it is valid.

    Args:
        before_s, after_s: the state's ``time_s`` before and after ``advance(until_s)``.
    """
    if not isinstance(piece, Motion):
        yield f"gives {type(piece).__name__}, not Motion"
        return
    tick_s, end_s = scenario.tick_s, scenario.run.t_end_s
    if not math.isfinite(after_s) or after_s < min(until_s, end_s) - tick_s / 4:
        yield f"after advance({until_s:g}) its time_s is {after_s:g}"
    tables = (
        ("samples", MOTION, True),
        ("ends", ENDS, True),
        ("segments", SEGMENTS, False),
        ("moves", MOVES, False),
    )
    for name, schema, needed in tables:
        frame = getattr(piece, name)
        if frame is None and not needed:
            continue
        if not isinstance(frame, pl.DataFrame):
            yield f"the table {name} is {type(frame).__name__}, not a polars DataFrame"
            return
        columns: dict[str, Any] = dict(frame.schema)
        for column, kind in schema.items():
            if columns.get(column) != kind:
                yield f"the table {name}: column '{column}' is {columns.get(column, 'missing')}, expected {kind}"
        if list(columns) != list(schema):
            yield f"the table {name} has the columns {', '.join(columns)}, where {', '.join(schema)} are right"
            return
    yield from _wrong_rows(piece, scenario, run, before_s, after_s)


def _wrong_rows(
    piece: Motion, scenario: Scenario, run: int, before_s: float, after_s: float
) -> Iterator[str]:
    """Yield the errors in the rows of a piece of motion whose columns are right; arguments as for ``_wrong``."""
    robots, quarter_s = scenario.swarm.robots, scenario.tick_s / 4
    if piece.ends["robot"].to_list() != list(range(robots)) or (piece.ends["run"] != run).any():
        yield f"the table ends has not one row for each of {robots} robots of run {run}, in their order"
    samples = piece.samples
    if samples.is_empty():
        return
    if (samples["run"] != run).any() or int(samples["robot"].max()) >= robots:  # type: ignore[arg-type]
        yield f"the table samples has rows of other runs than {run}, or of robots beyond {robots - 1}"
    if samples.drop("stop_start_s").null_count().sum_horizontal().item():
        yield "the table samples has values that are missing"
        return
    for column in ("time_s", "x_m", "y_m", "heading_rad"):
        if not samples[column].is_finite().all():
            yield f"the table samples: column '{column}' is not finite"
            return
    time_s = samples["time_s"].to_numpy()
    if time_s.min() < before_s - quarter_s or time_s.max() > after_s - quarter_s:
        yield (
            f"the table samples has times of {time_s.min():g} to {time_s.max():g} s, where those from {before_s:g} s "
            f"to before {after_s:g} s are right"
        )
    order = np.lexsort((samples["robot"].to_numpy(), time_s))
    if (np.diff(order) != 1).any():
        yield "the table samples is not sorted by time and robot"
    for column, most in (("x_m", scenario.arena.width_m), ("y_m", scenario.arena.height_m)):
        places = samples[column].to_numpy()
        if places.min() < 0.0 or places.max() > most:
            yield f"the table samples: column '{column}' leaves the arena, 0 to {most:g} m"
