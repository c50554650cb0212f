"""Tables of motion, and checks of the tables that motion sources of users return.

The tables and their columns are described in ``source``. Our own engines are checked by tests; a source that a user
wrote is wrapped (``checked``, ``checked_batch``), so that errors in its tables are reported when they occur.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import stated
from vibroswarm.core.tables import Schema, check_table
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
SCHEMAS: Final = {
    "samples": Schema(MOTION),
    "ends": Schema(ENDS, frozenset({"stop_start_s"})),  # a robot that does not stand has none
    "segments": Schema(SEGMENTS),
    "moves": Schema(MOVES, frozenset({"ray_m"})),
    "failures": Schema(FAILURES),
}
"""The tables of a ``Motion``, in its order."""
NEEDED: Final = ("samples", "ends")
"""Those that every motion has."""


@dataclass(frozen=True)
class Motion:
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


def join(pieces: Sequence[Motion]) -> Motion:
    """Join pieces of motion: at least one, given in the order of runs, and of time within a run.

    Samples and segments are in one piece each: a segment is only in the piece in which it begins. Ends and moves under
    way are in every piece, so several pieces may contain the end of the same robot in the same run, or the same move.
    Of these the row of the last piece is taken, as it is the latest. A failed run is reported once, by the row of the
    first piece that contains it.
    """
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


def part_of(motion: Motion, run: int) -> Motion:
    """Return the rows of one run, of each table that there is."""
    tables = {name: getattr(motion, name) for name in SCHEMAS}
    of_run = pl.col("run") == run
    own: dict[str, Any] = {
        name: table if table is None else table.filter(of_run) for name, table in tables.items()
    }
    return Motion(**own)


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

    Rows of runs that are not in ``runs`` are not checked against the scenario.

    Raises:
        CodeError: ``batch`` raised an error, or its result is not a valid ``Motion``.
        InputError: the scenario has robots that stop for good, which only our engines simulate.
    """
    _refuse_faults(scenario)
    # ``batch`` is given twice: as the source whose file is reported, and as the function that is called.
    motion: Motion = _called(batch, batch, scenario, seed, runs, segments=segments, moves=moves)
    _refuse(batch, wrong_tables(motion))
    end_s = scenario.ticks * scenario.tick_s
    for run in runs:
        _refuse(batch, _wrong_rows(part_of(motion, run), scenario, run, before_s=0.0, after_s=end_s))
    return motion


def _refuse(source: Callable[..., Any], problems: Iterator[str]) -> None:
    """Report the first problem of what a user's ``init`` or ``batch`` returned, if there is one.

    Raises:
        CodeError: there is one.
    """
    for problem in problems:
        raise CodeError(f"{_file_of(source)}: {problem}")


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
        self.numbers: dict[int, int] = {}  # number of each robot's last sample

    @property
    def time_s(self) -> float:
        """Time up to which motion has been simulated, s."""
        return float(_called(self.init, lambda: float(self.state.time_s)))

    def advance(self, until_s: float) -> Motion:
        """Advance the wrapped state (``MotionState.advance``), and check the piece of motion that it returns."""
        before_s = self.time_s
        piece: Motion = _called(self.init, self.state.advance, until_s)
        _refuse(self.init, wrong_tables(piece))
        after_s = self.time_s
        _refuse(self.init, _wrong_time(self.scenario, until_s, after_s))
        wrong = _wrong_rows(piece, self.scenario, self.run, before_s, after_s, self.numbers)
        _refuse(self.init, wrong)
        self.numbers |= dict(piece.samples.group_by("robot").agg(pl.col("sample").max()).iter_rows())
        return piece

    def copy(self) -> CheckedState:
        """See ``MotionState.copy``."""
        copy = CheckedState(_called(self.init, self.state.copy), self.init, self.scenario, self.run)
        copy.numbers = dict(self.numbers)
        return copy


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


def _wrong_time(scenario: Scenario, until_s: float, after_s: float) -> Iterator[str]:
    """Yield what is wrong with the time of a state after ``advance(until_s)``.

    It must have reached ``until_s``, or the end of the run if that comes first. A quarter of a tick is allowed for
    rounding.
    """
    if not math.isfinite(after_s) or after_s < min(until_s, scenario.run.t_end_s) - scenario.tick_s / 4:
        yield f"after advance({stated(until_s)}) its time_s is {stated(after_s)}"


def wrong_tables(motion: Any) -> Iterator[str]:
    """Yield errors in the tables of motion, each by itself: in its columns, or a value that is missing or impossible.

    Only a motion without such errors can be checked further.
    """
    if not isinstance(motion, Motion):
        yield f"gives {type(motion).__name__}, not Motion"
        return
    for name, schema in SCHEMAS.items():
        frame = getattr(motion, name)
        if frame is None and name not in NEEDED:
            continue
        if not isinstance(frame, pl.DataFrame):
            yield f"the table {name} is {type(frame).__name__}, not a polars DataFrame"
            return
        try:
            check_table(frame, schema, name, name)
        except InputError as error:
            yield f"the table {name}: {error.reason}"
        if list(frame.schema.items()) != list(
            schema.columns.items()
        ):  # in this order, an Enum with all its words
            yield f"the table {name} has the columns {_stated(frame.schema)}; expected: {_stated(schema.columns)}"


def _stated(columns: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} ({kind})" for name, kind in columns.items())


def _wrong_rows(
    piece: Motion,
    scenario: Scenario,
    run: int,
    before_s: float,
    after_s: float,
    numbers: Mapping[int, int] = MappingProxyType({}),
) -> Iterator[str]:
    """Yield errors in the rows of a piece of motion that passed ``wrong_tables``; segments are not checked.

    Args:
        piece: what ``advance`` returned, or the part of a batch that belongs to ``run``.
        before_s, after_s: ``time_s`` of the state before and after; for a batch, start and end of the run.
        numbers: of the last sample in earlier pieces, by robot.
    """
    robots, quarter_s = scenario.swarm.robots, scenario.tick_s / 4  # times may be rounded by a quarter tick
    if piece.ends["robot"].to_list() != list(range(robots)) or (piece.ends["run"] != run).any():
        yield f"the table ends must have exactly one row for each of the {robots} robots of run {run}, in their order"
    if piece.failures is not None and (piece.failures["run"] != run).any():
        yield f"the table failures has rows of other runs than {run}"
    samples = piece.samples
    for name, table, time in (("samples", samples, "time_s"), ("moves", piece.moves, "start_s")):
        if table is None:
            continue
        if (table["run"] != run).any() or (table["robot"] >= robots).any():
            yield f"the table {name} has rows of other runs than {run}, or of robots beyond {robots - 1}"
        order = np.lexsort((table["robot"].to_numpy(), table[time].to_numpy()))
        if (np.diff(order) != 1).any():
            yield f"the table {name} is not sorted by time and robot"
    if piece.moves is not None and after_s > before_s + quarter_s:
        first_s = dict(piece.moves.group_by("robot").agg(pl.col("start_s").min()).iter_rows())
        late = [i for i in range(robots) if first_s.get(i, math.inf) > before_s + quarter_s]
        if late:
            yield (
                f"the table moves has no move of robot {late[0]} that begins at {stated(before_s)} s or is under way "
                f"then"
            )
    if samples.is_empty():
        return
    # Numbers are addresses of chance: a repeated one repeats a reading.
    earlier = pl.col("robot").replace_strict(numbers, default=-1, return_dtype=pl.Int64)
    before = pl.col("sample").cast(pl.Int64).shift().over("robot").fill_null(earlier)
    wrong = samples.filter(pl.col("sample") <= before)
    if wrong.height:
        yield f"the table samples: those of robot {wrong['robot'][0]} are not numbered in the order of time, from 0"
    if (samples["stop_start_s"] > samples["time_s"]).any():
        yield "the table samples: a stop_start_s is after its time_s"
    time_s = samples["time_s"].to_numpy()
    # Samples at ``after_s`` itself belong to the next piece.
    if time_s.min() < before_s - quarter_s or time_s.max() > after_s - quarter_s:
        yield (
            f"the table samples has times of {stated(time_s.min())} to {stated(time_s.max())} s; expected: from "
            f"{stated(before_s)} s to before {stated(after_s)} s"
        )
    for column, size_m in (("x_m", scenario.arena.width_m), ("y_m", scenario.arena.height_m)):
        positions = samples[column].to_numpy()
        if positions.min() < 0.0 or positions.max() > size_m:
            yield f"the table samples: column '{column}' leaves the arena, 0 to {stated(size_m)} m"
