"""Runs that are observed and replayed while they move, by the same functions as whole tables.

The closed loop knows when all robots have decided and where a strategy wants to steer. It gives the same tables
as motion, observation and replay one after the other; a test holds it to that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import entry_for, kernel, read_only, signed, zero_rows
from vibroswarm.inference.agents import strategy_used
from vibroswarm.inference.deliveries import write_heard
from vibroswarm.inference.replay_arrays import Readings, Rows, Stops
from vibroswarm.inference.replayer import NO_VALUES, replayer_of
from vibroswarm.inference.sender_positions import NO_TRACKS, move_rows, tracks_of_rows
from vibroswarm.localisation.locate import draws_read, is_estimated
from vibroswarm.localisation.online import OnlineLocalisation
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.recorder import SAMPLE_ROW
from vibroswarm.motion.source import Motion, MotionState
from vibroswarm.observation.energy_model import log_ratios
from vibroswarm.observation.observe import SensedFloor, energies_at, read, reads_energies
from vibroswarm.robot.place_draws import width_of
from vibroswarm.robot.pose_mixture import ESTIMATE
from vibroswarm.scenario.scenario import Scenario


class SampleBuffer(NamedTuple):
    """The samples of a run so far, in order of time; (capacity,) each unless stated."""

    robot: NDArray[np.uint16]
    sample: NDArray[np.uint32]
    time_s: NDArray[np.float64]
    tick: NDArray[np.int64]
    previous: NDArray[np.int32]
    """Previous row of the same robot; -1: none."""
    stop_tick: NDArray[np.int64]
    following: NDArray[np.int32]
    """Next row of the same robot; -1: none yet."""
    heard: NDArray[np.int32]
    """(capacity, 3): as ``Timeline.heard``."""
    observation: NDArray[np.uint8]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    latest: NDArray[np.int32]
    """(robots,): last row of each robot; -1: none."""
    own: NDArray[np.int32]
    """(robots,): number of samples of each robot."""
    first: NDArray[np.int32]
    """(robots,): first row of each robot; -1: none yet."""


def empty_sample_buffer(robots: int, capacity: int) -> SampleBuffer:
    """Return a buffer for ``capacity`` samples."""
    return SampleBuffer(
        robot=np.empty(capacity, dtype=np.uint16),
        sample=np.empty(capacity, dtype=np.uint32),
        time_s=np.empty(capacity),
        tick=np.empty(capacity, dtype=np.int64),
        previous=np.empty(capacity, dtype=np.int32),
        stop_tick=np.empty(capacity, dtype=np.int64),
        following=np.empty(capacity, dtype=np.int32),
        heard=np.empty((capacity, 3), dtype=np.int32),
        observation=np.empty(capacity, dtype=np.uint8),
        x_m=np.empty(capacity),
        y_m=np.empty(capacity),
        heading_rad=np.empty(capacity),
        latest=np.empty(robots, dtype=np.int32),
        own=np.empty(robots, dtype=np.int32),
        first=np.empty(robots, dtype=np.int32),
    )


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
    """Append new samples and their readings to the buffer; return the new number of samples.

    Args:
        rows: the new samples, ``motion.recorder.SAMPLE_ROW``.
        filled: number of samples in the buffer so far.
    """
    for n in range(rows.size):
        row, k = rows[n], filled
        i, number = signed(row.robot), signed(row.sample)
        buffer.robot[k], buffer.sample[k] = row.robot, row.sample
        buffer.tick[k], buffer.time_s[k] = row.tick, row.tick * tick_ms / 1000.0
        _, bit, _, _ = read(ground, row.x_m, row.y_m, buffer.time_s[k], seed, run, i, number)
        buffer.x_m[k], buffer.y_m[k], buffer.heading_rad[k] = row.x_m, row.y_m, row.heading_rad
        buffer.observation[k], buffer.previous[k] = bit, buffer.latest[i]
        buffer.stop_tick[k], buffer.following[k] = row.stop_tick, -1
        if buffer.latest[i] >= 0:
            buffer.following[buffer.latest[i]] = k
        else:
            buffer.first[i] = k
        until, last_own, own = row.stop_tick - 2, buffer.latest[i], buffer.own[i]
        write_heard(buffer.heard[k], buffer.heard, buffer.previous, buffer.tick, 0, k, until, last_own, own)
        buffer.latest[i] = k
        buffer.own[i] += 1
        filled += 1
    return filled


NO_STOP_TICKS: Final = np.empty(0, dtype=np.int64)


def max_samples(scenario: Scenario) -> int:
    """Return an upper bound on the number of samples of a run."""
    tick_ms, sample = scenario.run.control_period_ms, scenario.sample
    between = 1 + int(sample.sample_interval_ms // tick_ms) + int(sample.stop_ms // tick_ms)
    return scenario.swarm.robots * (scenario.ticks // between + 2)


class ClosedLoop:
    """Follows runs of a scenario, one after the other."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        robots, capacity = scenario.swarm.robots, max_samples(scenario)
        self.scenario, self.seed, self.tick_ms = scenario, seed, scenario.run.control_period_ms
        self.strategy = strategy_used(scenario)
        self.buffer = empty_sample_buffer(robots, capacity)
        self.localisation = OnlineLocalisation(scenario, seed) if is_estimated(scenario) else None
        width = len(ESTIMATE) + width_of(draws_read(scenario))
        self.estimates = np.zeros((capacity if self.localisation else 0, width))
        self.log_ratios = np.zeros(capacity if reads_energies(scenario) else 0)
        self.ends_s: list[float] = []
        """Ends of its runs, for callers."""
        self.entry: Callable[..., int] | None = None
        self.replayer = replayer_of(scenario, seed, runs=1, longest=capacity, rows=capacity)
        buffer = SampleBuffer(*(read_only(column) for column in self.buffer))
        self.readings = Readings(
            buffer.observation,
            buffer.x_m,
            buffer.y_m,
            buffer.heading_rad,
            NO_VALUES,
            read_only(self.estimates),
            read_only(self.log_ratios),
        )
        self.bounds, self.runs = np.zeros(2, dtype=np.int64), np.zeros(1, dtype=np.int64)
        self.rows = Rows(
            read_only(self.bounds),
            read_only(self.runs),
            buffer.robot,
            buffer.sample,
            buffer.time_s,
            buffer.heard,
            read_only(np.zeros((robots, 3), dtype=np.int32)),
        )
        self.walked_tick, self.known_tick = np.zeros(robots, dtype=np.int64), np.zeros(1, dtype=np.int64)
        self.stops = Stops(
            buffer.tick,
            buffer.stop_tick,
            buffer.following,
            buffer.first,
            read_only(self.walked_tick),
            read_only(self.known_tick),
        )

    def begin(self, run: int, ground: SensedFloor) -> None:
        """Reset to the start of a run."""
        self.ground, self.runs[0], self.bounds[1] = ground, run, 0
        self.buffer.latest[:], self.buffer.own[:], self.buffer.first[:] = -1, 0, -1
        self.walked_tick[:], self.known_tick[0] = 0, 0
        self.moves, self.tracks = list[NDArray[np.void]](), NO_TRACKS
        self.is_new, self.located = True, 0
        if self.localisation is not None:
            self.localisation.begin(run)

    @property
    def needs_moves(self) -> bool:
        """Whether the network or the localisation reads the moves; ``add_moves`` must then be called before
        ``catch_up``."""
        return self.replayer.reads_positions or self.localisation is not None

    def add_moves(self, rows: NDArray[np.void]) -> None:
        """Append moves (``motion.moves.MOVE_ROW``) that have ended or are under way; the latter are given again
        later."""
        if self.replayer.reads_positions:
            self.moves.append(rows.copy())
        if self.localisation is not None:
            self.localisation.add_moves(rows)

    def add_samples(self, rows: NDArray[np.void]) -> None:
        """Append new samples (``motion.recorder.SAMPLE_ROW``)."""
        arguments = (
            rows,
            self.ground,
            self.buffer,
            int(self.bounds[1]),
            self.seed,
            int(self.runs[0]),
            self.tick_ms,
        )
        if self.entry is None:
            self.entry = entry_for(record_samples, *arguments)
        self.bounds[1] = self.entry(*arguments)

    def catch_up(self, known_tick: int, stop_tick: NDArray[np.int64]) -> None:
        """Replay everything appended since the last call.

        Args:
            known_tick: motion is known up to this tick, exclusive.
            stop_tick: (robots,): tick since which each robot stands; -1: it walks. Read only if the replayer needs
                stops.
        """
        if self.replayer.needs_stops:
            self.known_tick[0] = known_tick
            self.walked_tick[:] = np.where(stop_tick >= 0, stop_tick, known_tick) - 1
        new = slice(self.located, int(self.bounds[1]))
        if self.log_ratios.size > 0:
            self._weigh_energies(new)
        if self.localisation is not None:
            self.localisation.locate(
                self.buffer.robot[new],
                self.buffer.stop_tick[new],
                self.buffer.time_s[new],
                self.estimates[new],
            )
        self.located = new.stop
        if self.replayer.reads_positions:
            self.tracks = tracks_of_rows(np.concatenate(self.moves), self.walked_tick.size)
        self.replayer.advance(
            self.rows, self.readings, self.stops, from_start=self.is_new, tracks=self.tracks
        )
        self.is_new = False

    def _weigh_energies(self, new: slice) -> None:
        """Write the log likelihood ratios of new samples' energies."""
        buffer = self.buffer
        columns = (buffer.robot[new], buffer.sample[new], buffer.x_m[new], buffer.y_m[new])
        energy = energies_at(self.scenario, self.ground, self.seed, int(self.runs[0]), *columns)
        self.log_ratios[new] = log_ratios(self.scenario.sensor, buffer.observation[new], energy)

    def rewind_to(self, time_s: float) -> None:
        """Return the swarm to its state at ``time_s``, including the samples taken at that time."""
        last = int(self.bounds[1]) - 1
        if not self.replayer.needs_stops and (last < 0 or self.buffer.time_s[last] <= time_s):
            return  # nothing has happened since
        self.replayer.advance(
            self.rows, self.readings, self.stops, from_start=True, limit_s=time_s, tracks=self.tracks
        )

    @property
    def decision(self) -> NDArray[np.int64]:
        """Current decision of each robot, (robots,); -1: undecided."""
        return self.replayer.swarm.agents["decision"]

    @property
    def decision_time_s(self) -> NDArray[np.float64]:
        """Time of each robot's current decision, (robots,); nan: undecided."""
        return self.replayer.swarm.agents["decided_s"]

    @property
    def all_decided_s(self) -> float | None:
        """Time of the latest current decision, s; None while any robot is undecided."""
        agents = self.replayer.swarm.agents
        if (agents["decision"] == -1).any():
            return None
        return float(agents["decided_s"].max())

    @property
    def first_all_decided_s(self) -> float | None:
        """First time at which no robot was undecided, s; None while any robot is undecided."""
        if self.all_decided_s is None:
            return None
        return float(self.replayer.swarm.agents["first_decided_s"].max())

    @property
    def estimate(self) -> NDArray[np.float64]:
        """Posterior mean of the fill ratio by each robot, (robots,); nan if the strategy keeps no posterior."""
        states = self.replayer.swarm.states
        if not {"alpha", "beta"} <= set(states.dtype.names or ()):
            return np.full(states.size, np.nan)
        return np.asarray(states["alpha"] / (states["alpha"] + states["beta"]))

    @property
    def steers(self) -> bool:
        """Whether the strategy steers the robots."""
        return self.strategy.steer is not None

    @property
    def may_change(self) -> bool:
        """Whether robots may change their decisions."""
        return self.strategy.revises and self.scenario.decision.revise


def sample_rows(samples: pl.DataFrame, tick_ms: int) -> NDArray[np.void]:
    """Convert a motion table to rows (``motion.recorder.SAMPLE_ROW``); the times spent in each mode are left at 0."""
    rows = zero_rows(samples.height, SAMPLE_ROW)
    for name in ("run", "robot", "sample", "x_m", "y_m", "heading_rad"):
        rows[name] = samples[name].to_numpy()
    for name, column in (("stop_tick", "stop_start_s"), ("tick", "time_s")):
        rows[name] = np.rint(samples[column].to_numpy() * (1000.0 / tick_ms))
    return rows


def advance_loops(state: MotionState, loop: Sequence[ClosedLoop], until_s: float) -> Motion | None:
    """Advance a run to ``until_s``, and replay it in the loops of several scenarios with the same motion.

    Returns the new motion as tables, or None if the state is a ``KernelRun``, which passes its rows on directly.
    """
    tick_ms = loop[0].tick_ms
    if isinstance(state, KernelRun):

        def take(rows: NDArray[np.void]) -> None:
            for member in loop:
                member.add_samples(rows)

        if any(member.needs_moves for member in loop):
            rest = state.hand_over(until_s, take)
            for member in loop:
                if member.needs_moves and rest.moves is not None:
                    member.add_moves(rest.moves)
        else:
            state.go_on(until_s, take)
        needed = any(member.replayer.needs_stops for member in loop)
        piece, known_tick, stop_tick = None, state.tick, state.stop_ticks if needed else NO_STOP_TICKS
    else:
        piece = state.advance(until_s)
        known_tick, stop_tick = add_piece(piece, loop, tick_ms)
    for member in loop:
        member.catch_up(known_tick, stop_tick)
    return piece


def add_piece(piece: Motion, loop: Sequence[ClosedLoop], tick_ms: int) -> tuple[int, NDArray[np.int64]]:
    """Append a piece of motion to each loop.

    Returns: the tick up to which motion is known, exclusive, and the tick since which each robot stands, (robots,),
        -1: it walks.
    """
    rows = sample_rows(piece.samples, tick_ms)
    for member in loop:
        member.add_samples(rows)
        if member.needs_moves:
            member.add_moves(move_rows(piece.moves, tick_ms))
    standing = piece.ends["stop_start_s"].fill_null(-1.0).to_numpy()
    stop_tick = np.where(standing < 0, -1, np.rint(standing * (1000.0 / tick_ms))).astype(np.int64)
    return int(np.rint(piece.ends["end_s"].to_numpy().max() * (1000.0 / tick_ms))), stop_tick
