"""Tables of motion, and checks of the tables that motion sources of users return.

The tables and their columns are described in ``source``. Our own engines are checked by tests; a source that a user
wrote is wrapped (``checked``, ``checked_batch``), so that errors in its tables are reported when they occur.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.fork_guard import check_threads
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.numbers import count, stated
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import CodeError, InputError
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
"""Columns of the table ``samples`` and their types (see ``source``)."""
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
"""Columns of the table ``segments`` and their types (see ``source``)."""
MOVES: Final[dict[str, Any]] = {**SEGMENTS, "turned_rad": pl.Float64, "ray_m": pl.Float64}
"""Columns of the table ``moves`` and their types (see ``source``)."""
ENDS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "end_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "stop_start_s": pl.Float64,
}
"""Columns of the table ``ends`` and their types (see ``source``)."""
FAILURES: Final[dict[str, Any]] = {"run": pl.UInt32, "time_s": pl.Float64, "reason": pl.String}
"""Runs that failed: since when their robots stand, and why."""


@dataclass(frozen=True)
class Motion(NotebookView):
    """The tables of one or more runs, or of a piece of a run; see ``source``."""

    samples: pl.DataFrame
    """One row per sample (columns ``MOTION``)."""
    ends: pl.DataFrame
    """Each robot's pose at the end of its run, or of what is known of the run (columns ``ENDS``)."""
    segments: pl.DataFrame | None = None
    """Exact arcs (columns ``SEGMENTS``); None if they were not requested."""
    moves: pl.DataFrame | None = None
    """One row per drive, turn, avoidance or stop (columns ``MOVES``); None if they were not requested."""
    failures: pl.DataFrame | None = None
    """``FAILURES``; None if no run failed."""

    def __repr__(self) -> str:
        """Return the numbers of runs, robots, samples and failed runs, and which optional tables exist, on one line."""
        optional_tables = [name for name in ("segments", "moves") if getattr(self, name) is not None]
        runs, robots = self.ends["run"].n_unique(), self.ends["robot"].n_unique()
        parts = [
            count(runs, "run"),
            count(robots, "robot"),
            count(self.samples.height, "sample"),
            *([f"with {' and '.join(optional_tables)}"] if optional_tables else []),
            *([f"{self.failures.height} failed"] if self.failures is not None else []),
        ]
        return f"Motion({', '.join(parts)})"


def join(pieces: Sequence[Motion]) -> Motion:
    """Join pieces of motion: at least one, given in the order of runs, and of time within a run.

    Samples and segments are in one piece each: a segment is only in the piece in which it begins. Ends and moves under
    way are in every piece, so several pieces may contain the end of the same robot in the same run, or the same move.
    Of these the row of the last piece is taken, as it is the latest. A failed run is reported once, by the row of the
    first piece that contains it.
    """
    check_threads()
    ends = pl.concat([piece.ends for piece in pieces])
    ends = ends.group_by("run", "robot", maintain_order=True).last()
    segments = [piece.segments for piece in pieces if piece.segments is not None]
    failures = [piece.failures for piece in pieces if piece.failures is not None]
    return Motion(
        samples=pl.concat([piece.samples for piece in pieces]),
        ends=ends.select(list(ENDS)),  # columns in the order of ENDS, whichever order group_by gives
        segments=pl.concat(segments) if segments else None,
        moves=_join_moves([piece.moves for piece in pieces if piece.moves is not None]),
        failures=(pl.concat(failures).unique("run", keep="first", maintain_order=True) if failures else None),
    )


def _join_moves(pieces: Sequence[pl.DataFrame]) -> pl.DataFrame | None:
    """Join tables of moves, sorted by run, start and robot; return None if there is no table.

    A move that was under way at the end of a piece is also in the next piece, with the same start and a later end. The
    later row is taken.
    """
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
    """Create a run at time 0 by a user's ``init`` (see ``source.Init``); return a state that checks its tables.

    Raises:
        CodeError: ``init`` raised an error.
        InputError: the scenario has robots that stop for good, which only our engines simulate.
    """
    _refuse_faults(scenario)
    # ``init`` is given twice: as the source whose file is reported, and as the function that is called.
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
    """Simulate whole runs by a user's ``batch`` (see ``source.Batch``), and check the tables of each run.

    Of segments only the columns are checked. Rows of runs that are not in ``runs`` are not checked.

    Raises:
        CodeError: ``batch`` raised an error, or its result is not a valid ``Motion``.
        InputError: the scenario has robots that stop for good, which only our engines simulate.
    """
    _refuse_faults(scenario)
    # ``batch`` is given twice: as the source whose file is reported, and as the function that is called.
    motion_parts: Any = _called(batch, batch, scenario, seed, runs, segments=segments, moves=moves)
    for run in runs:
        part = motion_parts
        # Check the rows of this run. If they cannot be selected, because the result is no ``Motion`` or lacks a column
        # ``run``, pass on the whole result: ``_wrong`` names what is missing.
        if isinstance(motion_parts, Motion) and all(
            isinstance(one, pl.DataFrame) and "run" in one.columns
            for one in (motion_parts.samples, motion_parts.ends)
        ):
            of_run = pl.col("run") == run
            # Segments are not filtered, as their rows are not checked.
            part = Motion(
                samples=motion_parts.samples.filter(of_run),
                ends=motion_parts.ends.filter(of_run),
                segments=motion_parts.segments,
                moves=_rows_where(motion_parts.moves, of_run),
                failures=_rows_where(motion_parts.failures, of_run),
            )
        end_s = scenario.ticks * scenario.tick_s
        # Report the first problem. A batch simulates the whole run: from 0 to ``end_s``.
        for problem in _wrong(part, scenario, run, before_s=0.0, until_s=end_s, after_s=end_s):
            raise CodeError(f"{_file_of(batch)}: {problem}")
    motion: Motion = motion_parts
    return motion


def _rows_where(table: Any, of_run: pl.Expr) -> Any:
    """Return the rows that fulfil a condition; a value that is no table, or has no column ``run``, as it is."""
    return table.filter(of_run) if isinstance(table, pl.DataFrame) and "run" in table.columns else table


def _refuse_faults(scenario: Scenario) -> None:
    """Refuse a scenario in which robots stop for good (``MOTION_FAULTS``).

    Raises:
        InputError: there are such robots.
    """
    for kind in MOTION_FAULTS:
        if getattr(scenario.faults, kind):
            raise InputError(
                "this source of motion does not simulate robots that stop for good; 'event' and 'fixed-step' do",
                field=f"faults.{kind}",
            )


class CheckedState:
    """A ``MotionState`` that wraps the state of a user's source, and checks what it returns.

    Raises (in ``time_s``, ``advance`` and ``copy``):
        CodeError: the wrapped state raised an error, or its result is not a valid ``Motion``; the message names table
            and column.
    """

    def __init__(self, state: Any, init: Callable[..., Any], scenario: Scenario, run: int) -> None:
        self.state, self.init, self.scenario, self.run = state, init, scenario, run

    @property
    def time_s(self) -> float:
        """Time up to which motion has been simulated, s."""
        return float(_called(self.init, lambda: float(self.state.time_s)))

    def advance(self, until_s: float) -> Motion:
        """Advance the wrapped state (``MotionState.advance``), and check the piece of motion that it returns."""
        before_s = self.time_s
        piece = _called(self.init, self.state.advance, until_s)
        # Report the first problem, if there is one.
        for problem in _wrong(piece, self.scenario, self.run, before_s, until_s, self.time_s):
            raise CodeError(f"{_file_of(self.init)}: {problem}")
        motion: Motion = piece
        return motion

    def copy(self) -> CheckedState:
        """See ``MotionState.copy``."""
        return CheckedState(_called(self.init, self.state.copy), self.init, self.scenario, self.run)


def _called(init: Callable[..., Any], function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """Call a user's function and return its result; report its errors with file and line.

    Args:
        init: ``init`` or ``batch`` of the user's source; its file is the one whose lines are reported.
        function, arguments, named: what to call.
    Raises:
        CodeError: the function raised an error; the last line of the user's file that was being run is named.
        InputError, RunError: those that the function raised, unchanged.
    """
    with errors_in(f"{_file_of(init)}:init"):
        return function(*arguments, **named)


def _file_of(init: Callable[..., Any]) -> str:
    """Return the name of the file that defines a function or a class; "a source of motion" if it is unknown."""
    code = getattr(init, "__code__", None) or getattr(getattr(init, "__init__", None), "__code__", None)
    return str(getattr(code, "co_filename", "a source of motion"))


def _wrong(
    piece: Any, scenario: Scenario, run: int, before_s: float, until_s: float, after_s: float
) -> Iterator[str]:
    """Yield each error in a piece of motion, in words; nothing if it is valid.

    Callers stop at the first error. Checks rely on the earlier ones, and may raise an error if one of those reported a
    problem: the rows are checked even if a column has the wrong type.

    Args:
        piece: what ``advance(until_s)`` returned, or the part of a batch that belongs to ``run``.
        before_s, after_s: ``time_s`` of the state before and after ``advance(until_s)``. For a batch ``before_s`` is 0,
            and ``until_s`` and ``after_s`` are the end of the run.
    """
    if not isinstance(piece, Motion):
        yield f"gives {type(piece).__name__}, not Motion"
        return
    tick_s, end_s = scenario.tick_s, scenario.run.t_end_s
    # The state must have reached ``until_s``, or the end of the run if that comes first. A quarter of a tick is allowed
    # for rounding.
    if not math.isfinite(after_s) or after_s < min(until_s, end_s) - tick_s / 4:
        yield f"after advance({stated(until_s)}) its time_s is {stated(after_s)}"
    tables = (
        ("samples", MOTION, True),
        ("ends", ENDS, True),
        ("segments", SEGMENTS, False),
        ("moves", MOVES, False),
        ("failures", FAILURES, False),
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
            yield f"the table {name} has the columns {', '.join(columns)}; expected: {', '.join(schema)}"
            return
    yield from _wrong_rows(piece, scenario, run, before_s, after_s)


def _wrong_rows(
    piece: Motion, scenario: Scenario, run: int, before_s: float, after_s: float
) -> Iterator[str]:
    """Yield each error in the rows of a piece of motion whose columns are right; segments are not checked.

    Arguments and callers are as for ``_wrong``.
    """
    robots, quarter_s = scenario.swarm.robots, scenario.tick_s / 4  # times may be rounded by a quarter tick
    if piece.ends["robot"].to_list() != list(range(robots)) or (piece.ends["run"] != run).any():
        yield f"the table ends must have exactly one row for each of the {robots} robots of run {run}, in their order"
    if (
        piece.failures is not None
        and ((piece.failures["run"] != run) | piece.failures["time_s"].is_null()).any()
    ):
        yield f"the table failures has rows of other runs than {run}, or without a time"
    if piece.moves is not None:
        yield from _wrong_moves(piece.moves, robots, run, before_s, after_s, quarter_s)
    samples = piece.samples
    # In ``ends``, a robot that does not stand has no ``stop_start_s``.
    for name, table, optional in (("ends", piece.ends, ["stop_start_s"]), ("samples", samples, [])):
        required = table.drop(optional)
        if required.null_count().sum_horizontal().item():
            yield f"the table {name} has values that are missing"
            return
        for column in required.select(pl.selectors.float()).columns:
            if not required[column].is_finite().all():
                yield f"the table {name}: column '{column}' is not finite"
                return
    if samples.is_empty():
        return
    if (samples["run"] != run).any() or (samples["robot"] >= robots).any():
        yield f"the table samples has rows of other runs than {run}, or of robots beyond {robots - 1}"
    time_s = samples["time_s"].to_numpy()
    # Samples at ``after_s`` itself belong to the next piece.
    if time_s.min() < before_s - quarter_s or time_s.max() > after_s - quarter_s:
        yield (
            f"the table samples has times of {stated(time_s.min())} to {stated(time_s.max())} s; expected: from "
            f"{stated(before_s)} s to before {stated(after_s)} s"
        )
    order = np.lexsort((samples["robot"].to_numpy(), time_s))
    if (np.diff(order) != 1).any():  # sorting would change the order
        yield "the table samples is not sorted by time and robot"
    for column, size_m in (("x_m", scenario.arena.width_m), ("y_m", scenario.arena.height_m)):
        positions = samples[column].to_numpy()
        if positions.min() < 0.0 or positions.max() > size_m:
            yield f"the table samples: column '{column}' leaves the arena, 0 to {stated(size_m)} m"


def _wrong_moves(
    moves: pl.DataFrame, robots: int, run: int, before_s: float, after_s: float, quarter_s: float
) -> Iterator[str]:
    """Yield each error in the rows of a table of moves, from which networks and localisation compute positions.

    Args:
        robots: number of robots. quarter_s: a quarter of a control period, for rounding; others: see ``_wrong``.
    """
    if moves.drop("ray_m").null_count().sum_horizontal().item():  # only ray_m may be null
        yield "the table moves has values that are missing"
        return
    if (moves["run"] != run).any() or (moves["robot"] >= robots).any():
        yield f"the table moves has rows of other runs than {run}, or of robots beyond {robots - 1}"
        return
    for column in ("start_s", "x_m", "y_m", "heading_rad", "speed_m_s", "turn_rate_rad_s", "turned_rad"):
        if not moves[column].is_finite().all():
            yield f"the table moves: column '{column}' is not finite"
            return
    order = np.lexsort((moves["robot"].to_numpy(), moves["start_s"].to_numpy()))
    if (np.diff(order) != 1).any():  # sorting would change the order
        yield "the table moves is not sorted by time and robot"
        return
    if after_s <= before_s + quarter_s:
        return  # nothing was simulated, so nothing moved
    # Each robot's first move in a piece is the one that was under way at its start, or one that begins there.
    first_s = dict(moves.group_by("robot").agg(pl.col("start_s").min()).iter_rows())
    late = [i for i in range(robots) if first_s.get(i, math.inf) > before_s + quarter_s]
    if late:
        yield f"the table moves has no move of robot {late[0]} that begins at {stated(before_s)} s or is under way then"
