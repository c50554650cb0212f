"""The closed loop: runs whose samples are observed and replayed while the robots move.

It uses the functions that process whole tables, and gives the same numbers; a test compares them. It knows at any time
which robots have decided, and where a strategy wants to steer them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import entry_for, kernel, read_only, signed
from vibroswarm.inference.replay_arrays import Readings, Rows, Stops
from vibroswarm.inference.replayer import NO_VALUES, Replayer
from vibroswarm.inference.sender_positions import NO_TRACKS, tracks_of_rows
from vibroswarm.localisation.locate import is_estimated
from vibroswarm.localisation.online import OnlineLocalisation
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
        readings.observation[k] = reading
        stops.stop_tick[k], stops.following[k] = row.stop_tick, -1
        if buffer.latest[i] >= 0:
            stops.following[buffer.latest[i]] = k
        else:
            stops.first[i] = k
        buffer.latest[i] = k
        filled += 1
    return filled


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
        self.localisation = OnlineLocalisation(scenario, seed) if is_estimated(scenario) else None
        self.is_sensed = is_sensed(scenario.sensor)
        self.entry: Callable[..., int] | None = None  # compiled ``record_samples``; see ``add_samples``
        # bounds: 0 and the number of samples in the buffer, so that all its samples are those of one run (``Rows``).
        # runs: the number of the run. walked_tick, known_tick: as in ``Stops``; see ``catch_up``.
        self.bounds, self.runs = np.zeros(2, dtype=np.int64), np.zeros(1, dtype=np.int64)
        self.walked_tick, self.known_tick = np.zeros(robots, dtype=np.int64), np.zeros(1, dtype=np.int64)
        capacity = max_samples(scenario)
        self.estimates = np.zeros((capacity if self.localisation else 0, len(ESTIMATE)))
        self.weighed = np.zeros((capacity if reads_energies(scenario) else 0, 2))
        self.replayer = Replayer(scenario, self.seed, runs=1, longest=capacity, rows=capacity)
        # needs_moves: whether network or localisation read the moves, so that ``add_moves`` must be called before
        # ``catch_up``.
        self.needs_moves = self.replayer.reads_positions or self.localisation is not None
        rows = Rows(
            bounds=self.bounds,
            runs=self.runs,
            robot=np.empty(capacity, dtype=np.uint16),
            sample=np.empty(capacity, dtype=np.uint32),
            time_s=np.empty(capacity),
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
            latest=np.empty(robots, dtype=np.int32),
        )
        self.rows = Rows(*(read_only(column) for column in rows))
        self.stops = Stops(*(read_only(column) for column in stops))
        self.readings = Readings(*(read_only(column) for column in readings))

    def begin(self, run: int, ground: Ground) -> None:
        """Set the state to the start of a run.

        Args:
            run: number of the run. ground: its floor and sensors.
        """
        self.ground, self.run, self.runs[0], self.bounds[1] = ground, run, run, 0
        self.buffer.latest[:], self.buffer.stops.first[:] = -1, -1
        self.walked_tick[:], self.known_tick[0] = 0, 0
        self.moves: list[NDArray[np.void]] = []
        self.tracks = NO_TRACKS
        # is_new: whether the next ``catch_up`` replays the run from its start: in a new run.
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
            stop_tick: (robots,): tick since which each robot stands; -1: it walks.
        """
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
