"""Motion that depends on decisions: strategies that steer, and runs that end when all robots have decided.

The engine of motion knows nothing about strategies. For a strategy that steers, the engine returns after each control
period in which a robot samples. The closed loop then replays these samples, and passes the turn and the leg that the
strategy chooses for each of these robots to the engine.

With ``run.stop = "all_decided"`` a run ends one tick after the last robot has decided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.ticks import tick_at
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.closed_loop import ClosedLoop
from vibroswarm.inference.deliveries import needs_moves, timeline_of
from vibroswarm.inference.replay import advance, classes_and_values, replayer_of
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.motion_tables import Collected, Motion, Sink
from vibroswarm.motion.source import MotionState, moved, started
from vibroswarm.observation.observe import Ground, observe, reads_energies, sensed_floors
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario


def steered_motion(
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    floors: Mapping[int, Floor],
    motion: str,
    moves: bool,
    progress: Callable[[float], None] | None = None,
    last_s: Callable[[float], float] | None = None,
) -> Motion:
    """Simulate the motion of runs that a strategy steers."""
    loop, grounds = ClosedLoop(scenario, seed), sensed_floors(scenario, seed, runs, floors)
    state = steerable(started(motion, scenario, moves or loop.needs_moves), motion)
    t_end_s, rows = scenario.run.t_end_s, Collected(loop.tick_ms)

    def steer_to(
        run: int, ground: Ground, until_s: float, sink: Sink, last_s: Callable[[float], float]
    ) -> None:
        """Steer a run from its start to ``until_s``, or to the next samples after ``last_s``."""
        loop.begin(run, ground)
        state.begin(seed, run)
        until = tick_at(until_s, loop.tick_ms)
        while state.tick < tick_at(min(until_s, last_s(float(loop.replayer.decided_s[0]))), loop.tick_ms):
            steer_on(state, loop, until, sink)

    for done, (run, ground) in enumerate(zip(runs, grounds, strict=True)):
        until_s = t_end_s
        if scenario.run.stop == "all_decided" and last_s is None:  # a timer may decide between two samples
            steer_to(run, ground, t_end_s, Collected(loop.tick_ms).sink, lambda decided_s: decided_s)
            until_s = min(float(loop.replayer.decided_s[0]) + scenario.tick_s, t_end_s)
        steer_to(run, ground, until_s, rows.sink, last_s or (lambda _: t_end_s))
        rows.end(state)
        if progress is not None:
            progress((done + 1) / len(runs))
    return rows.motion()


def steerable(state: MotionState, motion: str) -> KernelRun:
    """Return ``state``, the state of a run, if its robots can be steered."""
    if not isinstance(state, KernelRun):
        # A source from a user's file is named with the hash of that file, which the message leaves out.
        raise InputError(
            f"'{motion.partition(plugins.HASH)[0]}' cannot be steered, and the strategy steers; take 'event' or "
            "'fixed-step'",
            field="motion",
        )
    return state


def steer_on(state: KernelRun, loop: ClosedLoop, until: int, sink: Sink) -> bool:
    """Advance a run to the next tick at which robots sample, or to ``until``; let the strategy steer these robots."""
    before, since = loop.samples, state.tick

    def take_samples(rows: NDArray[np.void]) -> None:
        """Pass new samples to the closed loop, and to the caller."""
        loop.add_samples(rows)
        sink.samples(rows)

    def take_moves(rows: NDArray[np.void]) -> None:
        """Pass moves to the closed loop, unless they ended before, and to the caller."""
        loop.add_moves(rows[rows["until"] >= since])
        sink.moves(rows)

    sampled = state.to_sample(until, Sink(take_samples, take_moves))
    if loop.needs_moves:
        # The loop also needs moves that are not passed on yet, and those under way: localisation reads the stops at
        # which robots have just sampled, and networks the positions of all robots.
        loop.add_moves(state.moves_since(since))
    loop.catch_up(state.tick, state.stop_ticks)
    for k in range(before, loop.samples):  # rows of the new samples
        turn_deg, drive_ms = loop.replayer.steering[k].tolist()  # both nan: the strategy leaves all as drawn
        if not (math.isnan(turn_deg) and math.isnan(drive_ms)):
            state.steer(int(loop.rows.robot[k]), turn_deg, drive_ms)
    return sampled


def until_all_decided(
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    floors: Mapping[int, Floor],
    motion: str,
    moves: bool,
    progress: Callable[[float], None] | None = None,
) -> Motion:
    """Simulate runs until one tick after all robots decided: replay whole runs, then simulate up to that tick."""
    whole = moved(motion, scenario, seed, runs, needs_moves(scenario))
    ends_s = np.minimum(all_decided_s(scenario, seed, whole, floors) + scenario.tick_s, scenario.run.t_end_s)
    until = [tick_at(end_s, scenario.run.control_period_ms) for end_s in ends_s.tolist()]
    return moved(motion, scenario, seed, runs, moves, progress, until)


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
