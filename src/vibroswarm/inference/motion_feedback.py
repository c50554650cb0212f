"""Motion that depends on decisions: strategies that steer, and runs that end when all robots have decided.

The engine of motion knows nothing about strategies. For a strategy that steers, the engine returns after each control
period in which a robot samples. The closed loop then replays these samples, and passes the turn and the leg that the
strategy chooses for each of these robots to the engine.

With ``run.stop = "all_decided"`` a run ends one tick after the last robot has decided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.ticks import reached
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.closed_loop import ClosedLoop
from vibroswarm.inference.deliveries import needs_moves, timeline_of
from vibroswarm.inference.replay import advance, classes_and_values, replayer_of
from vibroswarm.motion.kernel_run import KernelRun, in_order
from vibroswarm.motion.recorder import Rows, SampleColumns, joined, one_run, tables, with_samples
from vibroswarm.motion.source import Motion, MotionState, join, source
from vibroswarm.observation.observe import Ground, observe, reads_energies, sensed_floors
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario

Take = Callable[[NDArray[np.void]], None]
"""Function that is called with new rows, which may be overwritten after the call."""


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
    last_s: Callable[[float], float] | None = None,
) -> Motion:
    """Simulate the motion of runs that a strategy steers.

    A run ends at ``run.t_end_s`` or, if ``run.stop`` is "all_decided", one tick after all robots have decided.

    Args:
        runs: run numbers, at least one. floors: floor of each run, by run number. motion: name of the motion source.
        wanted: tables requested beside the samples. progress: called after each run with the share of runs done.
        last_s: in place of ``run.stop``: returns up to when a run must be known, from when all robots had decided.
    Raises:
        InputError: the motion source cannot be steered, or the strategy chooses a turn or a leg that is out of range.
    """
    loop, grounds = ClosedLoop(scenario, seed), sensed_floors(scenario, seed, runs, floors)
    # One state serves all runs: ``start`` sets it to the start of each.
    state, t_end_s = (
        steerable(source(motion).init(scenario, seed, runs[0], *wanted), motion),
        scenario.run.t_end_s,
    )
    columns, parts = SampleColumns(state.tick_ms, room=0), []

    def moved(
        run: int, ground: Ground, until_s: float, into: SampleColumns, last_s: Callable[[float], float]
    ) -> Rows:
        loop.begin(run, ground)
        state.start(seed, run)
        return _whole_run(state, loop, until_s, into, last_s)

    for done, (run, ground) in enumerate(zip(runs, grounds, strict=True)):
        until_s = t_end_s
        if scenario.run.stop == "all_decided" and last_s is None:  # a timer may decide between two samples
            moved(run, ground, t_end_s, SampleColumns(state.tick_ms, room=0), lambda decided_s: decided_s)
            until_s = min(float(loop.replayer.decided_s[0]) + scenario.tick_s, t_end_s)
        parts.append(moved(run, ground, until_s, columns, last_s or (lambda _: t_end_s)))
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
    before = loop.samples

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
    for k in range(before, loop.samples):  # rows of the new samples
        turn_deg, drive_ms = loop.replayer.steering[k].tolist()  # both nan: the strategy leaves all as drawn
        if not (math.isnan(turn_deg) and math.isnan(drive_ms)):
            state.steer(int(loop.rows.robot[k]), turn_deg, drive_ms)
    return sampled


def _whole_run(
    state: KernelRun,
    loop: ClosedLoop,
    until_s: float,
    columns: SampleColumns,
    last_s: Callable[[float], float],
) -> Rows:
    """Advance a run from its start to ``until_s``; append its samples to ``columns``, and return its other rows.

    Args:
        last_s: returns an earlier end, from when all robots had decided; the run ends with the next samples after it.
    Returns: ends, failure, and segments and moves if they were requested; the field of samples is empty.
    """
    moves, segments = list[NDArray[np.void]](), list[NDArray[np.void]]()

    def keep(rows: NDArray[np.void], kept: list[NDArray[np.void]]) -> None:
        """Append a copy of ``rows`` to ``kept``, as the engine overwrites its rows."""
        kept.append(joined([rows]))

    has_moves = state.record.moves.size > 0  # a buffer without room: the table was not requested
    while not reached(state.time_s, min(until_s, last_s(float(loop.replayer.decided_s[0]))), loop.tick_ms):
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

    Whole runs are replayed to find that tick; then each is simulated once more, up to it.

    Args:
        runs: run numbers, at least one. floors: floor of each run, by run number. motion: name of the motion source.
        wanted: tables requested beside the samples. progress: called after each run with the share of runs done.
    """
    whole = source(motion).batch(scenario, seed, runs, False, needs_moves(scenario))
    ends_s = np.minimum(all_decided_s(scenario, seed, whole, floors) + scenario.tick_s, scenario.run.t_end_s)
    return motion_until(scenario, seed, runs, motion, wanted, ends_s, progress)


def motion_until(
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    motion: str,
    wanted: Wanted,
    ends_s: NDArray[np.float64],
    progress: Callable[[float], None] | None = None,
) -> Motion:
    """Simulate the motion of runs, each up to an end of its own.

    Args:
        ends_s: (runs,). Others: as of ``until_all_decided``.
    """
    found, state, rows, pieces = source(motion), None, list[Rows](), list[Motion]()
    for done, (run, end_s) in enumerate(zip(runs, ends_s.tolist(), strict=True)):
        if isinstance(state, KernelRun):
            state.start(seed, run)
        else:
            state = found.init(scenario, seed, run, *wanted)
        if isinstance(state, KernelRun):  # rows, of which tables are made once
            rows.append(one_run([state.rows(end_s)]))
        else:
            pieces.append(state.advance(end_s))
        if progress is not None:
            progress((done + 1) / len(runs))
    return tables(rows, scenario.run.control_period_ms) if rows else join(pieces)


def all_decided_s(
    scenario: Scenario, seed: int, motion: Motion, floors: Mapping[int, Floor]
) -> NDArray[np.float64]:
    """Return when all robots of each run had decided for the first time, (runs,); inf where some never did."""
    seen, timeline = (
        observe(scenario, seed, motion.samples, floors, energies=reads_energies(scenario)),
        timeline_of(scenario, motion),
    )
    replayer = replayer_of(scenario, seed, timeline)
    advance(replayer, scenario, seed, timeline, *classes_and_values(seen))
    return replayer.decided_s
