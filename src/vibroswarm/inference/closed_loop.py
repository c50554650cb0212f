"""The closed loop: runs whose samples are observed and replayed while the robots move.

It uses the functions that process whole tables, and gives the same numbers; a test compares them. It knows at any time
which robots have decided, and where a strategy wants to steer them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, NamedTuple, TypeGuard

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import address_of, entry_for, kernel, read_only, signed, zero_rows
from vibroswarm.core.kernel_call import call
from vibroswarm.inference.agents import estimate_of, posterior_of, strategy_used
from vibroswarm.inference.code_errors import translate_errors
from vibroswarm.inference.deliveries import write_heard
from vibroswarm.inference.replay_arrays import DONE, Readings, Rows, Stops
from vibroswarm.inference.replayer import NO_VALUES, CountsReplayer, replayer_of
from vibroswarm.inference.sender_positions import NO_TRACKS, move_rows, tracks_of_rows
from vibroswarm.localisation.locate import is_estimated
from vibroswarm.localisation.online import OnlineLocalisation
from vibroswarm.motion.event.engine import events
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.event.neighbours import SMALL_SWARM
from vibroswarm.motion.event.world import World
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.recorder import SAMPLE_ROW
from vibroswarm.motion.source import Motion, MotionState
from vibroswarm.observation.energy_model import is_sensed, readings_of, weighed
from vibroswarm.observation.observe import (
    Ground,
    SensedFloor,
    energies_at,
    read,
    reads_energies,
    values_at,
)
from vibroswarm.robot.pose_mixture import ESTIMATE
from vibroswarm.scenario.fault_draws import apply_faults
from vibroswarm.scenario.scenario import Scenario


class SampleBuffer(NamedTuple):
    """The samples of a run so far, in order of time: what the replay reads, and what only their recording needs."""

    rows: Rows
    stops: Stops
    readings: Readings
    previous: NDArray[np.int32]
    """(capacity,): previous row of the same robot; -1: none."""
    latest: NDArray[np.int32]
    """(robots,): last row of each robot; -1: none."""
    own: NDArray[np.int32]
    """(robots,): number of samples of each robot."""


def _columns(buffer: SampleBuffer) -> list[NDArray[Any]]:
    """Return the arrays of a buffer that are written."""
    rows, stops, readings, *rest = buffer
    return [*rows, *stops, *readings._replace(uniforms=np.empty(0)), *rest]


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
        rows: the new samples (``motion.recorder.SAMPLE_ROW``), in order of time. ground: floor and sensors of the run.
        buffer: changed; it must have room for all ``rows``, which is not checked. filled: number of samples in the
            buffer so far. seed, run: address of the sensors' noise.
        tick_ms: control period.
    """
    into, stops, readings = buffer.rows, buffer.stops, buffer.readings
    for n in range(rows.size):
        row, k = rows[n], filled
        i, number = signed(row.robot), signed(row.sample)
        into.robot[k], into.sample[k] = row.robot, row.sample
        stops.tick[k], into.time_s[k] = row.tick, row.tick * tick_ms / 1000.0
        _, reading, _, _ = read(ground, row.x_m, row.y_m, into.time_s[k], seed, run, i, number)
        readings.x_m[k], readings.y_m[k], readings.heading_rad[k] = row.x_m, row.y_m, row.heading_rad
        readings.observation[k], buffer.previous[k] = reading, buffer.latest[i]
        stops.stop_tick[k], stops.following[k] = row.stop_tick, -1
        if buffer.latest[i] >= 0:
            stops.following[buffer.latest[i]] = k
        else:
            stops.first[i] = k
        # A robot reads messages while it walks, not while it stands: last at stop_tick - 1. A message is read one tick
        # after it was sent, at the earliest, so the robot has read those sent up to stop_tick - 2.
        until, last_own, own = row.stop_tick - 2, buffer.latest[i], buffer.own[i]
        # 0: first row of the run, as the buffer holds a single run
        write_heard(into.heard[k], into.heard, buffer.previous, stops.tick, 0, k, until, last_own, own)
        buffer.latest[i] = k
        buffer.own[i] += 1
        filled += 1
    return filled


class Calls(NamedTuple):
    """Addresses of the kernels that ``follow`` calls."""

    events: int
    record_samples: int
    replay: int


@kernel
def follow(
    calls: Calls, world: World, ground: SensedFloor, buffer: SampleBuffer, bounds: NDArray[np.int64],
    decision: NDArray[np.int64], replay: Any, from_start: bool, to_end: bool, limit_s: float, tick: int, until: int,
    check_ticks: int, tick_ms: int,
) -> int:  # fmt: skip
    """Simulate, observe and replay a run until all robots have decided, which is checked every ``check_ticks``.

    Args:
        bounds: its last entry is the number of samples in the buffer, changed. decision: (robots,): of the replay.
        replay: arguments of the replay, except its last three, ``from_start``, ``to_end`` and ``limit_s``.
        tick: where the run is, at least 1. until: latest end.
    Returns: the tick reached; the negative error code of the replay if it failed.
    """
    record = world.record
    while tick < until:
        tick = call(calls.events, (world, min(tick + check_ticks, until)))
        rows = record.samples[: record.filled[0]]
        bounds[1] = call(
            calls.record_samples, (rows, ground, buffer, bounds[1], world.seed, world.run, tick_ms)
        )
        record.filled[0] = 0
        status: int = call(calls.replay, (*replay, from_start, to_end, limit_s))
        if status != DONE:
            return -status
        from_start = False
        undecided = 0
        for i in range(decision.size):
            undecided += decision[i] < 0
        if undecided == 0:
            break
    return tick


_calls: dict[Any, Calls] = {}
"""What a compiled ``follow`` calls, by it and by the module of the replay."""
NO_STOP_TICKS: Final = np.empty(0, dtype=np.int64)
"""Given to ``ClosedLoop.catch_up`` if no replayer needs stops."""


def max_samples(scenario: Scenario) -> int:
    """Return an upper bound on the number of samples of a run, from the fewest ticks between two samples of a robot.

    The bound holds for motion that keeps to ``sample_interval_ms`` and ``stop_ms`` of the scenario, as that of our
    engines does: the sample timer must exceed the interval, so it takes at least one tick more. Two samples more per
    robot are allowed for those at the beginning and at the end of the run.
    """
    tick_ms, sample = scenario.run.control_period_ms, scenario.sample
    between = 1 + int(sample.sample_interval_ms // tick_ms) + int(sample.stop_ms // tick_ms)
    return scenario.swarm.robots * (scenario.ticks // between + 2)


class ClosedLoop:
    """Observes and replays runs of a scenario, one after the other, while they move.

    Call ``begin`` for each run. Then, again and again, add new moves and samples and call ``catch_up``.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        """Allocate all memory for a run; ``begin`` sets its contents.

        ``readings``, ``rows`` and ``stops``, the inputs of the replay, are read-only views of memory that is filled as
        the run advances.

        Args:
            seed: seed of the runs.
        """
        robots = scenario.swarm.robots
        self.scenario, self.seed, self.tick_ms = scenario, seed, scenario.run.control_period_ms
        self.strategy = strategy_used(scenario)
        self.localisation = OnlineLocalisation(scenario, seed) if is_estimated(scenario) else None
        self.is_sensed = is_sensed(scenario.sensor)
        self.ends_s: list[float] = []
        """Ends of the runs, s; callers append to this list, it is not used here."""
        self.entry: Callable[..., int] | None = None  # compiled ``record_samples``; see ``add_samples``
        # compiled ``follow``, whose first argument is ``calls``
        self.following: Callable[..., int] | None = None
        # bounds: 0 and the number of samples in the buffer, so that all its samples are those of one run (``Rows``).
        # runs: the number of the run. walked_tick, known_tick: as in ``Stops``; see ``catch_up``.
        self.bounds, self.runs = np.zeros(2, dtype=np.int64), np.zeros(1, dtype=np.int64)
        self.walked_tick, self.known_tick = np.zeros(robots, dtype=np.int64), np.zeros(1, dtype=np.int64)
        self._allocate(max_samples(scenario))

    def _allocate(self, capacity: int) -> None:
        """Allocate what depends on the number of samples of a run: buffer, inputs of the replay, replayer.

        Args:
            capacity: number of samples that there is room for.
        """
        scenario, robots = self.scenario, self.walked_tick.size
        self.estimates = np.zeros((capacity if self.localisation else 0, len(ESTIMATE)))
        self.weighed = np.zeros((capacity if reads_energies(scenario) else 0, 2))
        self.replayer = replayer_of(scenario, self.seed, runs=1, longest=capacity, rows=capacity)
        # needs_moves: whether network or localisation read the moves, so that ``add_moves`` must be called before
        # ``catch_up``. decision, decision_time_s: see their use in ``all_decided_s``; -1 and nan while undecided.
        self.needs_moves = self.replayer.reads_positions or self.localisation is not None
        agents = self.replayer.swarm.agents
        self.decision: NDArray[np.int64] = agents["decision"]
        self.decision_time_s: NDArray[np.float64] = agents["decided_s"]
        rows = Rows(
            bounds=self.bounds,
            runs=self.runs,
            robot=np.empty(capacity, dtype=np.uint16),
            sample=np.empty(capacity, dtype=np.uint32),
            time_s=np.empty(capacity),
            heard=np.empty((capacity, 3), dtype=np.int32),
            # not used: ``to_end`` is never requested here
            heard_at_end=np.zeros((robots, 3), dtype=np.int32),
        )
        stops = Stops(
            tick=np.empty(capacity, dtype=np.int64),
            stop_tick=np.empty(capacity, dtype=np.int64),
            following=np.empty(capacity, dtype=np.int32),
            first=np.empty(robots, dtype=np.int32),
            walked_tick=self.walked_tick,
            known_tick=self.known_tick,
        )
        readings = Readings(
            observation=np.empty(capacity, dtype=np.uint8),
            x_m=np.empty(capacity),
            y_m=np.empty(capacity),
            heading_rad=np.empty(capacity),
            uniforms=NO_VALUES,  # the kernel computes the numbers when it needs them
            estimates=self.estimates,
            weighed=self.weighed,
        )
        # ``begin`` sets the arrays with an entry per robot, and ``record_samples`` the rows of the others.
        self.buffer = SampleBuffer(
            rows,
            stops,
            readings,
            previous=np.empty(capacity, dtype=np.int32),
            latest=np.empty(robots, dtype=np.int32),
            own=np.empty(robots, dtype=np.int32),
        )
        self.rows = Rows(*(read_only(column) for column in rows))
        self.stops = Stops(*(read_only(column) for column in stops))
        self.readings = Readings(*(read_only(column) for column in readings))

    def _enlarge(self, needed: int) -> None:
        """Make room for ``needed`` samples and as many again.

        The next ``catch_up`` replays the run from its start, as the new replayer has replayed nothing yet.
        """
        filled = int(self.bounds[1])
        old = self.buffer
        self._allocate(2 * needed)
        for before, now in zip(_columns(old), _columns(self.buffer), strict=True):
            # Columns with one entry per robot do not grow, and are copied whole. Columns that are not needed have no
            # entries. Of all others the rows of the samples so far are copied.
            size = before.shape[0] if before.shape == now.shape else filled
            now[:size] = before[:size]
        self.is_new = True

    def begin(self, run: int, ground: Ground) -> None:
        """Set the state to the start of a run.

        Args:
            run: number of the run. ground: its floor and sensors.
        """
        self.ground, self.run, self.runs[0], self.bounds[1] = ground, run, run, 0
        self.buffer.latest[:], self.buffer.own[:], self.buffer.stops.first[:] = -1, 0, -1
        self.walked_tick[:], self.known_tick[0] = 0, 0
        self.moves: list[NDArray[np.void]] = []
        self.tracks = NO_TRACKS
        # is_new: whether the next ``catch_up`` replays the run from its start: in a new run, or after ``_enlarge``.
        # Until then decisions and states are those of the run before.
        # located: number of samples that ``catch_up`` has handled.
        self.is_new, self.located = True, 0
        if self.localisation is not None:
            self.localisation.begin(run)

    def add_moves(self, rows: NDArray[np.void]) -> None:
        """Append moves (``motion.moves.MOVE_ROW``), which are copied.

        A move that is still under way may be added, and is added again when it has ended. Of two rows of
        one move, the one that was added last counts.
        """
        if self.replayer.reads_positions:
            self.moves.append(rows.copy())
        if self.localisation is not None:
            self.localisation.add_moves(rows)

    def add_samples(self, rows: NDArray[np.void]) -> None:
        """Append new samples (``motion.recorder.SAMPLE_ROW``) with their readings to the buffer."""
        needed = int(self.bounds[1]) + rows.size
        if needed > self.stops.tick.size:  # a user's source may sample more often than the scenario says
            self._enlarge(needed)
        if len(self.ground.stages) == 1:  # the floor does not change
            self._record(self.ground.stages[0], rows)
        else:
            for ground, part in self.ground.parts(rows["tick"] * self.tick_ms / 1000.0):
                self._record(ground, rows[part])
        if self.is_sensed:
            self._sense(slice(needed - rows.size, needed))

    def _record(self, ground: SensedFloor, rows: NDArray[np.void]) -> None:
        arguments = (rows, ground, self.buffer, int(self.bounds[1]), self.seed, self.run, self.tick_ms)
        if self.entry is None:  # the compiled function for these types, which is faster to call
            self.entry = entry_for(record_samples, *arguments)
        self.bounds[1] = self.entry(*arguments)

    def catch_up(self, known_tick: int, stop_tick: NDArray[np.int64]) -> None:
        """Replay the samples that were added since the last call, after computing what their readings need.

        Args:
            known_tick: motion is known up to this tick, exclusive.
            stop_tick: (robots,): tick since which each robot stands; -1: it walks. Used only if the replayer needs
                stops.
        """
        if self.replayer.needs_stops:
            self.known_tick[0] = known_tick
            # Last tick at which each robot walked: before its stop or, if it does not stand, the last known tick.
            self.walked_tick[:] = np.where(stop_tick >= 0, stop_tick, known_tick) - 1
        new = slice(self.located, int(self.bounds[1]))  # rows of the new samples
        if self.weighed.size > 0:
            self._weigh_energies(new)
        if self.localisation is not None:
            self.localisation.locate(
                self.rows.robot[new],
                self.stops.stop_tick[new],
                self.rows.time_s[new],
                self.estimates[new],
            )
        self.located = new.stop
        if self.replayer.reads_positions:
            robots = self.walked_tick.size
            self.tracks = tracks_of_rows(np.concatenate(self.moves), robots)
        self.replayer.advance(
            self.rows, self.readings, self.stops, from_start=self.is_new, tracks=self.tracks
        )
        self.is_new = False

    def follow(self, state: EventRun, check_s: float) -> None:
        """Simulate a run that ``can_follow`` from its start until all robots have decided, by one kernel.

        Args:
            state: the run's motion at time 0, changed. check_s: time between checks whether all robots have decided.
        """
        until, check = state.until_tick(self.scenario.run.t_end_s), state.until_tick(check_s)
        world, (ground,), buffer = state.world(), self.ground.stages, self.buffer
        replay = self.replayer.arguments(self.rows, self.readings, self.stops, NO_TRACKS)
        flags = (True, False, math.inf)  # from the start, not to the end, without a limit
        arguments = (
            world, ground, buffer, self.bounds, self.decision, replay, *flags, 1, until, check, self.tick_ms
        )  # fmt: skip
        if self.following is None:
            self.following = entry_for(follow, Calls(0, 0, 0), *arguments)
            key = self.following, self.replayer.module  # which determine the types of all arguments
            if key not in _calls:
                _calls[key] = Calls(
                    address_of(events, world, until),
                    address_of(
                        record_samples, state.record.samples, ground, buffer, 0, self.seed, self.run, check
                    ),
                    address_of(self.replayer.module.replay, *replay, *flags),
                )
            self.calls = _calls[key]
        self.replayer.restart(self.rows)
        with translate_errors(self.replayer.strategy, self.replayer.network):
            tick = self.following(self.calls, *arguments)
        self.replayer.refuse(max(-tick, DONE))
        state.tick = tick
        self.located, self.is_new = int(self.bounds[1]), tick <= 1  # a run of a single tick is not replayed

    def can_follow(self, state: MotionState) -> TypeGuard[EventRun]:
        """Return whether ``follow`` can simulate this run, which must not record segments or moves.

        Samples of a small swarm need no more than ``record_samples`` and ``replay`` if they are counted, without a
        user's code, on a floor that does not change. Decisions must be final.
        """
        replayer = self.replayer
        return (
            isinstance(state, EventRun)
            and state.swarm.size <= SMALL_SWARM
            and isinstance(replayer, CountsReplayer)
            and len(self.ground.stages) == 1
            and not (
                self.needs_moves or self.is_sensed or self.weighed.size or self.steers or self.may_change
            )
            and not (replayer.strategy.code or replayer.network.code)
        )

    def _parts(self, new: slice) -> Iterator[tuple[SensedFloor, slice, list[NDArray[Any]]]]:
        """Yield each stage of the floor in the rows ``new``: its part of them, and robot, sample, x, y, time there."""
        rows, readings = self.rows, self.readings
        columns: tuple[NDArray[Any], ...] = (
            rows.robot, rows.sample, readings.x_m, readings.y_m, rows.time_s
        )  # fmt: skip
        for ground, part in self.ground.parts(rows.time_s[new]):
            yield ground, part, [column[new][part] for column in columns]

    def _weigh_energies(self, new: slice) -> None:
        """Write values and log likelihood ratios of the samples in the rows ``new``."""
        for ground, part, own in self._parts(new):
            energy = energies_at(self.scenario, ground, self.seed, self.run, *own)
            self.weighed[new][part] = weighed(
                self.scenario.sensor, self.readings.observation[new][part], energy, ground.place
            )

    def _sense(self, new: slice) -> None:
        """Replace the readings in the rows ``new`` by those of a sensor that depends on the place."""
        sensor = self.scenario.sensor
        for ground, part, own in self._parts(new):
            values = values_at(sensor, ground.tiles, ground.place, self.seed, self.run, *own)
            read = readings_of(sensor, values)
            robot, sample, _, _, time_s = own
            first = np.zeros(len(read), dtype=np.int64)  # ``ground`` holds a single run
            apply_faults(
                ground.faults, first, robot, sample, time_s, sensor.readings, self.seed, self.runs, read
            )
            self.buffer.readings.observation[new][part] = read

    def rewind_to(self, time_s: float) -> None:
        """Set the swarm to its state at the earlier time ``time_s``, by replaying the run from its start.

        Samples taken exactly at ``time_s`` are included.
        """
        last = int(self.bounds[1]) - 1
        if not self.replayer.needs_stops and (last < 0 or self.rows.time_s[last] <= time_s):
            return  # No sample was taken later; and a replayer without stops has no timers, so nothing else happens.
        self.replayer.advance(
            self.rows, self.readings, self.stops, from_start=True, limit_s=time_s, tracks=self.tracks
        )

    @property
    def all_decided_s(self) -> float | None:
        """Time of the latest current decision, s; None while any robot is undecided."""
        if -1 in self.decision.tolist():  # for a few robots faster than NumPy
            return None
        return float(max(self.decision_time_s.tolist()))

    @property
    def first_all_decided_s(self) -> float | None:
        """First time at which all robots had decided, s; None while any robot is undecided.

        ``all_decided_s`` is later if a robot has changed its decision since. It is earlier by ``decision.hold_s`` if
        robots decide by opinions, as such decisions count from the time since which the opinions agree.
        """
        if self.all_decided_s is None:
            return None
        return float(self.replayer.swarm.agents["first_decided_s"].max())

    @property
    def estimate(self) -> NDArray[np.float64]:
        """Each robot's estimate, as in tables (``final_columns``), (robots,); nan if the strategy has none."""
        swarm = self.replayer.swarm
        if self.strategy.has_own_estimate:
            return np.array(swarm.states["estimate"])
        return estimate_of(*posterior_of(self.scenario, swarm, self.strategy))

    @property
    def steers(self) -> bool:
        """Whether the strategy steers the robots."""
        return self.strategy.steer is not None

    @property
    def may_change(self) -> bool:
        """Whether robots may change their decisions."""
        return self.strategy.revises and self.scenario.decision.revise


def sample_rows(samples: pl.DataFrame, tick_ms: int) -> NDArray[np.void]:
    """Convert a table of samples to rows (``motion.recorder.SAMPLE_ROW``) in the same order.

    The closed loop does not read the times spent driving, turning, avoiding and standing, so these fields are 0.
    """
    rows = zero_rows(samples.height, SAMPLE_ROW)
    for name in ("run", "robot", "sample", "x_m", "y_m", "heading_rad"):
        rows[name] = samples[name].to_numpy()
    for name, column in (("stop_tick", "stop_start_s"), ("tick", "time_s")):
        rows[name] = np.rint(samples[column].to_numpy() * (1000.0 / tick_ms))
    return rows


def advance_loops(state: MotionState, loops: Sequence[ClosedLoop], until_s: float) -> Motion | None:
    """Advance a run to ``until_s``, and replay the new samples in the closed loops of several scenarios.

    Args:
        state: the run's motion, changed.
        loops: one closed loop for each scenario, changed. All scenarios have this motion.
    Returns: the new motion as tables; None if ``state`` is a ``KernelRun``, whose rows are passed on without making
        tables.
    """
    tick_ms = loops[0].tick_ms
    if isinstance(state, KernelRun):

        def take(rows: NDArray[np.void]) -> None:
            """Add new samples to each closed loop."""
            for loop in loops:
                loop.add_samples(rows)

        # Both ``hand_over`` and ``go_on`` simulate up to ``until_s`` and pass new samples to ``take``. Only
        # ``hand_over`` also returns the new moves.
        if any(loop.needs_moves for loop in loops):
            rest = state.hand_over(until_s, take)
            for loop in loops:
                if loop.needs_moves and rest.moves is not None:
                    loop.add_moves(rest.moves)
        else:
            state.go_on(until_s, take)
        # known_tick: all samples before this tick are known. stop_tick, (robots,): tick since which each robot stands;
        # -1: it walks. If no replayer needs stops, ``catch_up`` does not read ``stop_tick``.
        needs_stops = any(loop.replayer.needs_stops for loop in loops)
        piece, known_tick = None, state.tick
        stop_tick = state.stop_ticks if needs_stops else NO_STOP_TICKS
    else:
        piece = state.advance(until_s)
        known_tick, stop_tick = add_piece(piece, loops, tick_ms)
    # The samples have only been added so far: now replay them.
    for loop in loops:
        loop.catch_up(known_tick, stop_tick)
    return piece


def add_piece(piece: Motion, loops: Sequence[ClosedLoop], tick_ms: int) -> tuple[int, NDArray[np.int64]]:
    """Append the samples and, if needed, the moves of a piece of motion to each closed loop.

    Args:
        piece: motion of one run; its table of ends has one row per robot, in the order of robots, and all
            ends are at the same time. loops: changed. tick_ms: control period.
    Returns: the arguments of ``ClosedLoop.catch_up``: the tick up to which motion is known, exclusive; the tick since
        which each robot stands, (robots,), -1: it walks.
    """
    rows = sample_rows(piece.samples, tick_ms)
    for loop in loops:
        loop.add_samples(rows)
        if loop.needs_moves:
            loop.add_moves(move_rows(piece.moves, tick_ms))
    standing = piece.ends["stop_start_s"].fill_null(-1.0).to_numpy()  # null: the robot walks at the end
    stop_tick = np.where(standing < 0, -1, np.rint(standing * (1000.0 / tick_ms))).astype(np.int64)
    return int(np.rint(piece.ends["end_s"].to_numpy().max() * (1000.0 / tick_ms))), stop_tick
