"""Motion that depends on decisions: strategies that steer, and runs that end when all robots have decided.

The engine of motion knows nothing about strategies. For a strategy that steers, the engine returns after each control
period in which a robot samples. The closed loop then replays these samples, and passes the turn and the leg that the
strategy chooses for each of these robots to the engine.

With ``run.stop = "all_decided"`` a run ends one tick after the last robot has decided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.ticks import reached
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.closed_loop import ClosedLoop, add_piece
from vibroswarm.motion.kernel_run import KernelRun, in_order
from vibroswarm.motion.recorder import Rows, SampleColumns, joined, one_run, tables, with_samples
from vibroswarm.motion.source import Motion, MotionState, join, source
from vibroswarm.observation.observe import sensed_floors
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario

Take = Callable[[NDArray[np.void]], None]
"""Function that is called with new rows, which may be overwritten after the call."""


State = TypeVar("State", bound=MotionState)
Piece = TypeVar("Piece", Rows, Motion)


class Wanted(NamedTuple):
    """Whether the tables of segments and of moves are requested beside that of samples."""

    segments: bool = False
    """Whether the table of segments is requested."""
    moves: bool = False
    """Whether the table of moves is requested."""


def steered_motion(
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    floors: Mapping[int, Floor],
    motion: str,
    wanted: Wanted,
    progress: Callable[[float], None] | None = None,
) -> Motion:
    """Simulate the motion of runs that a strategy steers.

    A run ends at ``run.t_end_s`` or, if ``run.stop`` is "all_decided", one tick after all robots have decided.

    Args:
        runs: run numbers, at least one. floors: floor of each run, by run number. motion: name of the motion source.
        wanted: tables requested beside the samples. progress: called after each run with the share of runs done.
    Raises:
        InputError: the motion source cannot be steered, or the strategy chooses a turn or a leg that is out of range.
    """
    loop, t_end_s = ClosedLoop(scenario, seed), scenario.run.t_end_s
    # One state serves all runs: ``start`` sets it to the start of each.
    state = steerable(source(motion).init(scenario, seed, runs[0], *wanted), motion)
    columns, parts = SampleColumns(state.tick_ms, room=0), []
    for done, (run, ground) in enumerate(zip(runs, sensed_floors(scenario, seed, runs, floors), strict=True)):
        until_s = t_end_s
        # A run that ends with the last decision is simulated twice: the first time to find its end, the second time to
        # record it up to that end.
        if scenario.run.stop == "all_decided":
            loop.begin(run, ground)
            state.start(seed, run)
            until_s = _decided_by(state, loop, t_end_s)
        loop.begin(run, ground)
        state.start(seed, run)
        parts.append(_whole_run(state, loop, until_s, columns))
        if progress is not None:
            progress((done + 1) / len(runs))
    return with_samples(columns.frame(), parts, state.tick_ms)


def steerable(state: MotionState, motion: str) -> KernelRun:
    """Return ``state``, the state of a run, if its robots can be steered.

    Args:
        motion: name of the motion source, for the message.
    Raises:
        InputError: the motion source does not support steering.
    """
    if not isinstance(state, KernelRun):
        # A source from a user's file is named with the hash of that file, which the message leaves out.
        raise InputError(
            f"'{motion.partition(plugins.HASH)[0]}' cannot be steered, and the strategy steers; take 'event' or "
            "'fixed-step'",
            field="motion",
        )
    return state


def steer_on(
    state: KernelRun,
    loop: ClosedLoop,
    until_s: float,
    take: Take | None = None,
    take_moves: Take | None = None,
    take_segments: Take | None = None,
) -> bool:
    """Advance a run to the next tick at which robots sample, or to ``until_s``; let the strategy steer these robots.

    Args:
        state: the run's motion, changed. loop: the run's closed loop, which replays the samples.
        take, take_moves, take_segments: called with new rows of samples, moves and segments, if given.
    Returns: whether any robot sampled.
    Raises:
        InputError: the strategy chooses a turn or a leg that is out of range.
    """
    before = int(loop.bounds[1])  # number of samples so far

    def take_samples(rows: NDArray[np.void]) -> None:
        """Pass new samples to the closed loop, and to the caller."""
        loop.add_samples(rows)
        if take is not None:
            take(rows)

    def pass_on_moves(rows: NDArray[np.void]) -> None:
        """Pass new moves to the closed loop, and to the caller."""
        loop.add_moves(rows)
        if take_moves is not None:
            take_moves(rows)

    loop_reads_moves = loop.needs_moves
    sampled = state.to_sample(
        until_s, take_samples, pass_on_moves if loop_reads_moves else take_moves, take_segments
    )
    if loop_reads_moves:
        # Engines pass moves on when they have ended. The loop also needs those under way: localisation reads the stops
        # at which robots have just sampled, and networks the positions of all robots.
        loop.add_moves(state.moves_under_way())
    loop.catch_up(state.tick, state.stop_ticks)
    for k in range(before, int(loop.bounds[1])):  # rows of the new samples
        turn_deg, drive_ms = loop.replayer.steering[k].tolist()  # both nan: the strategy leaves all as drawn
        if not (math.isnan(turn_deg) and math.isnan(drive_ms)):
            state.steer(int(loop.rows.robot[k]), turn_deg, drive_ms)
    return sampled


def _decided_by(state: KernelRun, loop: ClosedLoop, t_end_s: float) -> float:
    """Advance a run until all robots have decided, or to ``t_end_s``; return the time at which the run ends, s.

    That is one tick after the last robot has decided, but at most ``t_end_s``.
    """
    while not reached(state.time_s, t_end_s, loop.tick_ms):
        steer_on(state, loop, t_end_s)
        decided_s = loop.first_all_decided_s
        if decided_s is not None:
            return min(decided_s + loop.scenario.tick_s, t_end_s)
    return t_end_s


def _whole_run(state: KernelRun, loop: ClosedLoop, until_s: float, columns: SampleColumns) -> Rows:
    """Advance a run from its start to ``until_s``; append its samples to ``columns``, and return its other rows.

    Returns: ends, failure, and segments and moves if they were requested; the field of samples is empty.
    """
    moves, segments = list[NDArray[np.void]](), list[NDArray[np.void]]()

    def keep(rows: NDArray[np.void], kept: list[NDArray[np.void]]) -> None:
        """Append a copy of ``rows`` to ``kept``, as the engine overwrites its rows."""
        kept.append(joined([rows]))

    has_moves = state.record.moves.size > 0  # a buffer without room: the table was not requested
    while not reached(state.time_s, until_s, loop.tick_ms):
        steer_on(
            state,
            loop,
            until_s,
            take=columns.take,
            take_moves=(lambda rows: keep(rows, moves)) if has_moves else None,
            take_segments=(lambda rows: keep(rows, segments)) if state.record.segments.size > 0 else None,
        )
    if has_moves:
        moves.append(state.moves_under_way())  # those that end with the run
    return Rows(
        samples=state.record.samples[:0],  # none: they are in ``columns``
        segments=joined(segments) if segments else None,
        ends=state.ends(),
        moves=in_order(joined(moves)) if moves else None,
        failure=state.failure,
    )


PIECE_S: Final = 100.0
"""Length of the pieces in which motion advances, s. The piece in which the last robot decides is simulated again, up to
that decision."""
LIKELY: Final = 0.9
"""Length of a run's first piece, as a share of the shortest run so far. It affects speed only, not the result."""


def until_all_decided(
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    floors: Mapping[int, Floor],
    motion: str,
    wanted: Wanted,
    progress: Callable[[float], None] | None = None,
) -> Motion:
    """Simulate the motion of runs until one tick after all robots have decided, or to ``run.t_end_s``.

    Args:
        runs: run numbers, at least one. floors: floor of each run, by run number. motion: name of the motion source.
        wanted: tables requested beside the samples. progress: called after each run with the share of runs done.
    """
    loop, t_end_s = ClosedLoop(scenario, seed), scenario.run.t_end_s
    # Our engines give rows, of which tables are made once, for all runs; other sources give tables.
    state = source(motion).init(scenario, seed, runs[0], *wanted)
    rows, pieces = list[Rows](), list[Motion]()
    # first_s: length of a run's first piece. A run is likely to take at least the share LIKELY of the shortest run so
    # far, so its first piece is that long.
    first_s, shortest_s = PIECE_S, t_end_s
    for done, (run, ground) in enumerate(zip(runs, sensed_floors(scenario, seed, runs, floors), strict=True)):
        loop.begin(run, ground)
        if isinstance(state, KernelRun):
            state.start(seed, run)
            of_run, end_s = _run(state, loop, first_s, KernelRun.rows, _replay_rows)
            rows.append(one_run(of_run))
        else:
            if done > 0:  # a new state for each run: only our engines can begin another run in the same state
                state = source(motion).init(scenario, seed, run, *wanted)
            more, end_s = _run(
                state, loop, first_s, lambda state, until_s: state.advance(until_s), _replay_tables
            )
            pieces += more
        shortest_s = min(shortest_s, end_s)
        first_s = max(LIKELY * shortest_s, scenario.tick_s)  # at least one tick, so that the run advances
        if progress is not None:
            progress((done + 1) / len(runs))
    return tables(rows, loop.tick_ms) if rows else join(pieces)


def _run(
    state: State,
    loop: ClosedLoop,
    first_s: float,
    advance: Callable[[State, float], Piece],
    replay: Callable[[Piece, State, ClosedLoop], None],
) -> tuple[list[Piece], float]:
    """Advance one run until one tick after all robots have decided, or to ``run.t_end_s``.

    Motion advances in pieces. The piece in which the last robot decides is repeated from a copy of the state at its
    beginning, up to one tick after the decision.

    Args:
        state: the run at its start, changed. loop: the run's closed loop, begun. first_s: length of the first piece.
        advance: simulates a state to a time, s, and returns the new motion. replay: replays that motion in the loop.
    Returns: the pieces, and the time at which the run ends, s.
    """
    pieces: list[Piece] = []
    t_end_s, length_s = loop.scenario.run.t_end_s, first_s
    while not reached(state.time_s, t_end_s, loop.tick_ms):
        before = state.copy()
        piece = advance(state, min(state.time_s + length_s, t_end_s))
        replay(piece, state, loop)
        decided_s = loop.first_all_decided_s
        if decided_s is not None:
            end_s = min(decided_s + loop.scenario.tick_s, t_end_s)
            pieces.append(advance(before, end_s))
            return pieces, end_s
        pieces.append(piece)
        length_s = PIECE_S
    return pieces, t_end_s


def _replay_rows(rows: Rows, state: KernelRun, loop: ClosedLoop) -> None:
    """Replay the rows by which one of our engines has advanced ``state``."""
    loop.add_samples(rows.samples)
    if loop.needs_moves and rows.moves is not None:
        loop.add_moves(rows.moves)
    loop.catch_up(state.tick, state.stop_ticks)


def _replay_tables(piece: Motion, _: MotionState, loop: ClosedLoop) -> None:
    """Replay the tables that any other source of motion has returned."""
    loop.catch_up(*add_piece(piece, [loop], loop.tick_ms))
