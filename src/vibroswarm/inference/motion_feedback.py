"""Motion that depends on decisions: strategies that steer, and runs that end when all robots have decided.

The engine knows nothing about strategies. For a strategy that steers, it stops after each control period in which
a robot samples; the closed loop replays these samples and tells the engine the next turn and leg of each robot.

With ``run.stop = "all_decided"`` a run ends one tick after the last robot has decided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.ticks import reached
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.closed_loop import ClosedLoop, add_piece
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.recorder import Rows, SampleColumns, joined, with_samples
from vibroswarm.motion.source import Motion, MotionState, join, source
from vibroswarm.observation.observe import sensed_floors
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario

Take = Callable[[NDArray[np.void]], None]


class Wanted(NamedTuple):
    """Tables requested beside the samples."""

    segments: bool = False
    moves: bool = False


def steered_motion(
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    floors: Mapping[int, Floor],
    motion: str,
    wanted: Wanted,
    progress: Callable[[float], None] | None = None,
) -> Motion:
    """Move runs that a strategy steers, to their end or, if the scenario says so, until all robots have decided.

    Args:
        floors: floor of each run, by run number. motion: name of the motion source.
        wanted: tables requested beside the samples. progress: called after each run with the share of runs done.
    Raises:
        InputError: the source cannot be steered, or a turn or a leg is out of range.
    """
    loop, t_end_s = ClosedLoop(scenario, seed), scenario.run.t_end_s
    first = steerable(source(motion).init(scenario, seed, runs[0], *wanted), motion)
    columns, parts = SampleColumns(first.tick_ms, 0), []
    for done, (run, ground) in enumerate(zip(runs, sensed_floors(scenario, seed, runs, floors), strict=True)):
        until_s = t_end_s
        if scenario.run.stop == "all_decided":
            loop.begin(run, ground)
            first.start(seed, run)
            until_s = _decided_by(first, loop, t_end_s)
        loop.begin(run, ground)
        first.start(seed, run)
        parts.append(_whole_run(first, loop, until_s, columns))
        if progress is not None:
            progress((done + 1) / len(runs))
    return with_samples(columns.frame(), parts, first.tick_ms)


def steerable(state: MotionState, motion: str) -> KernelRun:
    """Return the state if its robots can be steered.

    Raises:
        InputError: it cannot.
    """
    if not isinstance(state, KernelRun):
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
    """Advance to the next sample or to ``until_s``, and let the strategy steer the robots that sampled.

    Args:
        take, take_moves, take_segments: called with new rows of samples, moves and segments, if given.

    Returns whether any robot sampled.
    """
    before = int(loop.bounds[1])

    def both(rows: NDArray[np.void]) -> None:
        loop.add_samples(rows)
        if take is not None:
            take(rows)

    def both_moves(rows: NDArray[np.void]) -> None:
        loop.add_moves(rows)
        if take_moves is not None:
            take_moves(rows)

    asks = loop.needs_moves
    sampled = state.to_sample(until_s, both, both_moves if asks else take_moves, take_segments)
    if asks:
        loop.add_moves(state.moves_under_way())
    loop.catch_up(state.tick, state.stop_ticks)
    for k in range(before, int(loop.bounds[1])):
        turn_deg, drive_ms = loop.replayer.steering[k].tolist()
        if not (math.isnan(turn_deg) and math.isnan(drive_ms)):
            state.steer(int(loop.buffer.robot[k]), turn_deg, drive_ms)
    return sampled


def _decided_by(state: KernelRun, loop: ClosedLoop, t_end_s: float) -> float:
    """Run until all robots have decided; return the time one tick after that, s, or the end of the run if they never
    have."""
    while not reached(state.time_s, t_end_s, loop.tick_ms):
        steer_on(state, loop, t_end_s)
        decided_s = loop.first_all_decided_s
        if decided_s is not None:
            return min(decided_s + loop.scenario.tick_s, t_end_s)
    return t_end_s


def _whole_run(state: KernelRun, loop: ClosedLoop, until_s: float, columns: SampleColumns) -> Rows:
    """Run from start to ``until_s``; append the samples to ``columns``, and return all other rows."""
    moves, segments = list[NDArray[np.void]](), list[NDArray[np.void]]()

    def keep(rows: NDArray[np.void], kept: list[NDArray[np.void]]) -> None:
        kept.append(joined([rows]))

    has_moves = state.record.moves.size > 0
    while not reached(state.time_s, until_s, loop.tick_ms):
        steer_on(
            state,
            loop,
            until_s,
            columns.take,
            (lambda rows: keep(rows, moves)) if has_moves else None,
            (lambda rows: keep(rows, segments)) if state.record.segments.size > 0 else None,
        )
    if has_moves:
        moves.append(state.moves_under_way())
    return Rows(
        state.record.samples[:0],
        joined(segments) if segments else None,
        state.ends(),
        in_start_order(joined(moves)) if moves else None,
        state.failure,
    )


def in_start_order(moves: NDArray[np.void]) -> NDArray[np.void]:
    """Return moves sorted by start and robot; they were recorded in the order in which they ended."""
    return moves[np.lexsort((moves["robot"], moves["tick"]))]


PIECE_S: Final = 100.0
"""Length of the pieces in which motion advances; the last piece is redone, up to the decision."""
LIKELY: Final = 0.9
"""Length of a run's first piece, as a share of the shortest run so far. No result depends on it."""


def until_all_decided(
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    floors: Mapping[int, Floor],
    motion: str,
    wanted: Wanted,
    progress: Callable[[float], None] | None = None,
) -> Motion:
    """Move runs until one tick after the last robot has decided, or to their end.

    Args:
        floors: floor of each run, by run number. motion: name of the motion source.
        wanted: tables requested beside the samples. progress: called after each run with the share of runs done.
    """
    loop, pieces, first_s = ClosedLoop(scenario, seed), list[Motion](), PIECE_S
    shortest_s = scenario.run.t_end_s
    for done, (run, ground) in enumerate(zip(runs, sensed_floors(scenario, seed, runs, floors), strict=True)):
        loop.begin(run, ground)
        moved = _run(source(motion).init(scenario, seed, run, *wanted), loop, first_s)
        pieces.append(moved)
        shortest_s = min(shortest_s, float(moved.ends["end_s"].to_numpy().max()))
        first_s = max(LIKELY * shortest_s, scenario.tick_s)
        if progress is not None:
            progress((done + 1) / len(runs))
    return join(pieces)


def _run(state: MotionState, loop: ClosedLoop, first_s: float) -> Motion:
    """Move one run until one tick after the last robot has decided, or to its end.

    Motion advances in pieces; the piece in which the last decision falls is repeated up to it, from a copy of the
    state.
    """
    t_end_s, pieces, length_s = loop.scenario.run.t_end_s, list[Motion](), first_s
    while not reached(state.time_s, t_end_s, loop.tick_ms):
        before = state.copy()
        piece = state.advance(min(state.time_s + length_s, t_end_s))
        loop.catch_up(*add_piece(piece, [loop], loop.tick_ms))
        decided_s = loop.first_all_decided_s
        if decided_s is not None:
            return join([*pieces, before.advance(decided_s + loop.scenario.tick_s)])
        pieces.append(piece)
        length_s = PIECE_S
    return join(pieces)
