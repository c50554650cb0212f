"""Motion that a strategy steers: from sample to sample, each robot's next turn and leg as its strategy says.

The engine knows nothing of strategies: it stops after each control period in which a robot samples; the closed loop
lets the swarm live through that, and tells the engine where to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm import code_files
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.closed_loop import ClosedLoop
from vibroswarm.motion.contract import Motion, MotionState, source
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.record import Rows, SampleColumns, joined, with_samples
from vibroswarm.observation.ground import grounds_of
from vibroswarm.scenario import Scenario

Take = Callable[[NDArray[np.void]], None]


class Wanted(NamedTuple):
    """Which tables are asked for beside the samples."""

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
    """Runs to their end, or to the tick after that at which all have decided, if the scenario says so.

    Args:
        floors: of each run. motion: the source, by name. progress: told the share that is done.
    Raises:
        InputError: a source that cannot be steered, a turn or a leg out of range.
    """
    loop, t_end_s = ClosedLoop(scenario, seed), scenario.run.t_end_s
    first = steerable(source(motion).init(scenario, seed, runs[0], *wanted), motion)
    columns, parts = SampleColumns(first.tick_ms, 0), []
    for done, (run, ground) in enumerate(zip(runs, grounds_of(scenario, seed, runs, floors), strict=True)):
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
    """A state that can be steered.

    Raises:
        InputError: it cannot.
    """
    if not isinstance(state, KernelRun):
        raise InputError(
            f"'{motion.partition(code_files.HASH)[0]}' cannot be steered, and the strategy steers; take 'event' or "
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
    """Move on to the next sample, or to ``until_s``, and let the strategy say how it goes on from there.

    Gives whether anyone sampled.
    """
    before = int(loop.bounds[1])

    def both(rows: NDArray[np.void]) -> None:
        loop.take(rows)
        if take is not None:
            take(rows)

    def both_moves(rows: NDArray[np.void]) -> None:
        loop.take_moves(rows)
        if take_moves is not None:
            take_moves(rows)

    asks = loop.asks_places
    sampled = state.to_sample(until_s, both, both_moves if asks else take_moves, take_segments)
    if asks:
        loop.take_moves(state.moves_under_way())
    loop.catch_up(state.tick, state.stop_ticks)
    for k in range(before, int(loop.bounds[1])):
        turn_deg, drive_ms = loop.replayer.course[k].tolist()
        if not (math.isnan(turn_deg) and math.isnan(drive_ms)):
            state.steer(int(loop.notes.robot[k]), turn_deg, drive_ms)
    return sampled


def _decided_by(state: KernelRun, loop: ClosedLoop, t_end_s: float) -> float:
    """The time of the tick after that at which all have decided for the first time, or the end."""
    while state.time_s < t_end_s:
        steer_on(state, loop, t_end_s)
        decided_s = loop.first_all_decided_s
        if decided_s is not None:
            return min(decided_s + loop.scenario.tick_s, t_end_s)
    return t_end_s


def _whole_run(state: KernelRun, loop: ClosedLoop, until_s: float, columns: SampleColumns) -> Rows:
    """One run from its start to ``until_s``; its samples go into ``columns``."""
    moves, segments = list[NDArray[np.void]](), list[NDArray[np.void]]()

    def keep(rows: NDArray[np.void], kept: list[NDArray[np.void]]) -> None:
        kept.append(joined([rows]))

    has_moves = state.record.moves.size > 0
    while state.time_s < until_s:
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
    )


def in_start_order(moves: NDArray[np.void]) -> NDArray[np.void]:
    """Moves by start, then robot: they were given as they ended."""
    return moves[np.lexsort((moves["robot"], moves["tick"]))]
