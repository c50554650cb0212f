"""Motion that depends on decisions: strategies that steer, and runs that end when all robots have decided.

For a strategy that steers, the engine returns after each control period in which a robot samples. The closed loop then
observes and replays these samples by the functions of whole tables, with the same numbers, and passes the turn and the
leg that the strategy chooses to the engine. With ``run.stop = "all_decided"`` a run ends one tick after the last
robot has decided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel, read_only, signed
from vibroswarm.core.ticks import tick_at
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.deliveries import NO_TRACKS, needs_moves, timeline_of, tracks_of_rows
from vibroswarm.inference.replay import advance, classes_and_values, replayer_of
from vibroswarm.inference.replay_arrays import Readings, Rows, Stops
from vibroswarm.inference.replayer import NO_VALUES, Replayer
from vibroswarm.localisation.locate import PlaceFilters, is_estimated
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.motion_tables import Collected, Motion, Sink
from vibroswarm.motion.source import MotionState, moved, started
from vibroswarm.observation.energy_model import is_sensed, weighed
from vibroswarm.observation.observe import (
    Ground,
    SensedFloor,
    energies_read,
    observe,
    read,
    readings_at,
    reads_energies,
    sensed_floors,
)
from vibroswarm.robot.pose_mixture import ESTIMATE
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario


class SampleBuffer(NamedTuple):
    """The samples of a run so far, in order of time: what the replay reads, and what only their recording needs."""

    rows: Rows
    stops: Stops
    readings: Readings
    latest: NDArray[np.int32]
    """(robots,): last row of each robot; -1: none."""


@kernel
def record_samples(
    rows: NDArray[np.void],
    ground: SensedFloor,
    buffer: SampleBuffer,
    filled: int,
    seed: int,
    run: int,
    tick_ms: int,
) -> int:
    """Append new samples and their readings to the buffer; return the new number of samples."""
    into, stops, readings = buffer.rows, buffer.stops, buffer.readings
    for n in range(rows.size):
        row, k = rows[n], filled
        i, number = signed(row.robot), signed(row.sample)
        into.robot[k], into.sample[k] = row.robot, row.sample
        stops.tick[k], into.time_s[k] = row.tick, row.tick * tick_ms / 1000.0
        _, reading, _, _ = read(ground, row.x_m, row.y_m, into.time_s[k], seed, run, i, number)
        readings.x_m[k], readings.y_m[k], readings.heading_rad[k] = row.x_m, row.y_m, row.heading_rad
        readings.observation[k] = reading
        stops.stop_tick[k], stops.following[k] = row.stop_tick, -1
        if buffer.latest[i] >= 0:
            stops.following[buffer.latest[i]] = k
        else:
            stops.first[i] = k
        buffer.latest[i] = k
        filled += 1
    return filled


class ClosedLoop:
    """Observes and replays runs of a scenario, one after the other, while they move."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        """Allocate all memory for a run; ``begin`` sets its contents."""
        # An upper bound of a run's samples: the sample timer must exceed the interval, so it takes a tick more; two
        # more per robot are for those at the beginning and at the end of the run.
        robots, sample, tick_ms = scenario.swarm.robots, scenario.sample, scenario.run.control_period_ms
        between = 1 + int(sample.sample_interval_ms // tick_ms) + int(sample.stop_ms // tick_ms)
        capacity = robots * (scenario.ticks // between + 2)
        self.scenario, self.seed, self.tick_ms = scenario, seed, tick_ms
        self.localisation = PlaceFilters(scenario, seed) if is_estimated(scenario) else None
        self.is_sensed, self.is_weighed = is_sensed(scenario.sensor), reads_energies(scenario)
        self.replayer = Replayer(scenario, self.seed, runs=1, longest=capacity, rows=capacity)
        # needs_moves: whether network or localisation read the moves, so that ``add_moves`` must be called before
        # ``catch_up``.
        self.needs_moves = self.replayer.network.reads_positions or self.localisation is not None
        # ``begin`` sets the arrays with an entry per robot, and ``record_samples`` the rows of the others.
        self.buffer = SampleBuffer(
            rows=Rows(
                bounds=np.zeros(2, dtype=np.int64),  # 0 and the number of samples in the buffer
                runs=np.zeros(1, dtype=np.int64),  # the number of the run
                robot=np.empty(capacity, dtype=np.uint16),
                sample=np.empty(capacity, dtype=np.uint32),
                time_s=np.empty(capacity),
            ),
            stops=Stops(
                tick=np.empty(capacity, dtype=np.int64),
                stop_tick=np.empty(capacity, dtype=np.int64),
                following=np.empty(capacity, dtype=np.int32),
                first=np.empty(robots, dtype=np.int32),
                walked_tick=np.zeros(robots, dtype=np.int64),
                known_tick=np.zeros(1, dtype=np.int64),
            ),
            readings=Readings(
                observation=np.empty(capacity, dtype=np.uint8),
                x_m=np.empty(capacity),
                y_m=np.empty(capacity),
                heading_rad=np.empty(capacity),
                uniforms=NO_VALUES,  # the kernel computes the numbers when it needs them
                estimates=np.zeros((capacity if self.localisation else 0, len(ESTIMATE))),
                weighed=np.zeros((capacity if self.is_weighed else 0, 2)),
            ),
            latest=np.empty(robots, dtype=np.int32),
        )
        self.rows = Rows(*(read_only(column) for column in self.buffer.rows))
        self.stops = Stops(*(read_only(column) for column in self.buffer.stops))
        self.readings = Readings(*(read_only(column) for column in self.buffer.readings))

    @property
    def samples(self) -> int:
        """Number of samples so far."""
        return int(self.rows.bounds[1])

    def begin(self, run: int, ground: Ground) -> None:
        """Set the state to the start of a run."""
        rows, stops = self.buffer.rows, self.buffer.stops
        self.ground, self.run, rows.runs[0], rows.bounds[1] = ground, run, run, 0
        self.buffer.latest[:], stops.first[:], stops.walked_tick[:], stops.known_tick[0] = -1, -1, 0, 0
        self.moves: list[NDArray[np.void]] = []
        # caught_up: number of samples that ``catch_up`` has handled; -1: none, and the run begins.
        self.tracks, self.caught_up = NO_TRACKS, -1
        if self.localisation is not None:
            self.localisation.begin(run)

    def add_moves(self, rows: NDArray[np.void]) -> None:
        """Append copies of moves (``MOVE_ROW``); of two rows of one move the later counts, so it may be under way."""
        if self.replayer.network.reads_positions:
            self.moves.append(rows.copy())
        if self.localisation is not None:
            self.localisation.add_moves(rows)

    def add_samples(self, rows: NDArray[np.void]) -> None:
        """Append new samples (``motion.motion_tables.SAMPLE_ROW``) with their readings to the buffer."""
        for ground, part in self.ground.parts(rows["tick"] * self.tick_ms / 1000.0) if rows.size else ():
            before = self.samples
            self.buffer.rows.bounds[1] = record_samples(
                rows[part], ground, self.buffer, before, self.seed, self.run, self.tick_ms
            )
            if self.is_sensed or self.is_weighed:
                self._measure(ground, slice(before, self.samples))

    def _measure(self, ground: SensedFloor, new: slice) -> None:
        """Write the readings of a sensor that depends on the place, and values with their log likelihood ratios."""
        sensor, observation = self.scenario.sensor, self.buffer.readings.observation[new]
        robot, sample, time_s = self.rows.robot[new], self.rows.sample[new], self.rows.time_s[new]
        address = (self.seed, self.run, robot, sample, self.readings.x_m[new], self.readings.y_m[new], time_s)
        readings = readings_at(self.scenario, ground, *address)
        if self.is_sensed:
            observation[:] = readings.observation
        if self.is_weighed:
            energy = energies_read(self.scenario, readings)
            self.buffer.readings.weighed[new] = weighed(sensor, observation, energy, ground.place)

    def catch_up(self, known_tick: int, stop_tick: NDArray[np.int64]) -> None:
        """Replay the samples that were added since the last call, after computing where robots believe they are."""
        self.buffer.stops.known_tick[0] = known_tick
        # Last tick at which each robot walked: before its stop or, if it does not stand, the last known tick.
        self.buffer.stops.walked_tick[:] = np.where(stop_tick >= 0, stop_tick, known_tick) - 1
        if self.localisation is not None:
            new = slice(max(self.caught_up, 0), self.samples)
            self.localisation.locate(
                self.rows.robot[new],
                self.stops.stop_tick[new],
                self.rows.time_s[new],
                self.buffer.readings.estimates[new],
            )
        if self.replayer.network.reads_positions:
            self.tracks = tracks_of_rows(np.concatenate(self.moves), stop_tick.size)
        self.replayer.advance(
            self.rows, self.readings, self.stops, from_start=self.caught_up < 0, tracks=self.tracks
        )
        self.caught_up = self.samples


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
        moves = state.moves_so_far()
        loop.add_moves(moves[moves["until"] >= since])
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
    seen = observe(scenario, seed, whole.samples, floors, energies=reads_energies(scenario))
    timeline = timeline_of(scenario, whole)
    replayer = replayer_of(scenario, seed, timeline)
    advance(replayer, scenario, seed, timeline, *classes_and_values(seen))
    ends_s = np.minimum(replayer.decided_s + scenario.tick_s, scenario.run.t_end_s)
    until = [tick_at(end_s, scenario.run.control_period_ms) for end_s in ends_s.tolist()]
    return moved(motion, scenario, seed, runs, moves, progress, until)
