"""One run of an engine whose state is rows of numbers: advance it, copy it, steer robots, and record tables.

A robot can be steered after a sample, while it still stands: other robots rely on it only up to the end of its stop,
so steering changes only what it resumes then.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, kernel, zero_rows
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.motion.control_step import NEVER_FAILS, ROBOT, Swarm, begin, load, place_on_lattice, store
from vibroswarm.motion.event.trajectory import ticks_to_sample
from vibroswarm.motion.motion_tables import END_ROW, Failure, Sink, wrapped
from vibroswarm.motion.recorder import clear, drop_ended, empty_record, note_moves
from vibroswarm.motion.robot_params import Setup, give_each, setup_of, speed_quantiles
from vibroswarm.robot.walk import STOP, steered
from vibroswarm.scenario.scenario import Scenario

ROUNDING_TICKS = 1e-6
"""Rounding error allowed for in a number of ticks."""


@kernel
def steer_robot(swarm: Swarm, i: int, turn_deg: float, drive_ms: float) -> bool:
    """Set the next turn and leg of robot ``i`` (``walk.steered``); return False if it has not just sampled."""
    row = swarm[i]
    # At tick 0 ``sampled`` is set, as if after a sample, but no sample has been counted.
    if row.mode != STOP or row.sampled == 0 or row.samples == 0:
        return False
    store(swarm, i, steered(load(swarm, i), turn_deg, drive_ms))
    return True


@inlined
def robot_samples_from(swarm: Swarm, i: int, setup: Setup, latest: int, now: int) -> int:
    """Return a tick before which robot ``i`` surely does not sample; NEVER_FAILS if it has failed."""
    row = swarm[i]
    if row.failed:
        return NEVER_FAILS
    if row.mode == STOP and row.sampled == 0:
        return max(now, latest + ticks_to_sample(setup, row.stopped_ms))
    # At the earliest, the sample timer runs without a pause; it starts from 0 if a sample has just been taken. It takes
    # 1 + int(ticks_left) steps until the timer is above the interval. The step after these finds it so, and the robot
    # stops. It samples at the end of that stop.
    timer_ms = 0 if row.mode == STOP else row.timer_ms
    ticks_left = (setup.sample_interval_ms - timer_ms) / setup.tick_ms - ROUNDING_TICKS
    stops = latest + (2 + int(ticks_left) if ticks_left > 0.0 else 1)
    return max(now, stops) + ticks_to_sample(setup, 0)


@kernel
def no_sample_before(swarm: Swarm, setup: Setup, latest: NDArray[np.int64], now: int) -> int:
    """Return a tick, ``now`` or later, before which surely no robot samples; ``latest`` of each robot as above."""
    earliest = robot_samples_from(swarm, 0, setup, latest[0], now)
    for i in range(1, swarm.size):
        earliest = min(earliest, robot_samples_from(swarm, i, setup, latest[i], now))
    return earliest


class KernelRun(ABC):
    """A run whose state is rows of numbers, those after each control period unless an engine defines another."""

    fields: ClassVar[np.dtype[np.void]] = ROBOT
    """Type of a robot's row, with all the fields that the engine needs."""
    failure: Failure | None = None
    """Why the run failed, if it has."""

    def __init__(self, scenario: Scenario, moves: bool = False) -> None:
        self.tick_ms = scenario.run.control_period_ms
        self.scenario, self.setup = scenario, setup_of(scenario)
        self.speeds = speed_quantiles(scenario.robot)
        self.swarm = zero_rows(scenario.swarm.robots, self.fields)
        self.record = empty_record(self.swarm.size, moves)
        self.prepare()

    def prepare(self) -> None:  # noqa: B027 - most have nothing to make
        """Allocate what the engine needs and what is the same for all runs; called once."""

    def begin(self, seed: int, run: int) -> None:
        """Set this state to time 0 of a run, whatever it was before; buffers are reused."""
        self.seed, self.run, self.tick, self.failure = seed, run, 0, None
        self.swarm.view(np.uint8).fill(0)
        clear(self.record)
        if not begin(self.swarm, self.setup, self.speeds, seed, run):
            place_on_lattice(self.swarm, self.setup, seed, run)
        give_each(self.swarm, self.scenario, self.setup, seed, run)

    def advance(self, until: int, sink: Sink) -> None:
        """Simulate up to the tick ``until``, and pass on new samples, and moves that have ended."""
        while self.tick < until:
            record = self.record
            if self.tick > 0:
                self.tick = self.move_on(until)
            else:  # nothing moves at tick 0: only write the moves that begin there
                if record.moves.size > 0:
                    note_moves(
                        record.moves, record.under_way, record.filled, self.swarm, self.setup, self.run, 0, False
                    )  # fmt: skip
                self.tick = 1
            if record.filled[0] > 0:
                sink.samples(record.samples[: record.filled[0]])
                record.filled[0] = 0
            if 2 * record.filled[1] > record.moves.size:
                sink.moves(record.moves[: record.under_way["place"].min()])
                rest = drop_ended(record.moves, record.under_way, record.filled)
                self.record = record._replace(moves=rest)

    def to_sample(self, until: int, sink: Sink) -> bool:
        """Advance just beyond the next period in which a robot samples, or to ``until``; return whether any sampled."""
        sampled = False

        def take_samples(rows: NDArray[np.void]) -> None:
            nonlocal sampled
            sampled = True
            sink.samples(rows)

        while self.tick < until and not sampled:
            earliest = no_sample_before(self.swarm, self.setup, self.latest_ticks(), self.tick)
            self.advance(min(earliest + 1, until), Sink(take_samples, sink.moves))
        return sampled

    def moves_so_far(self) -> NDArray[np.void]:
        """Return the moves in the buffer (``MOVE_ROW``), sorted by start and robot; those under way end now."""
        rows, place = self.record.moves[: self.record.filled[1]], self.record.under_way["place"]
        if rows.size > 0:
            rows["until"][place] = self.tick
            rows["turned_rad"][place] = self.poses()[:, 2] - rows["heading_rad"][place]
        return rows

    def finish(self, sink: Sink) -> NDArray[np.void]:
        """Pass on all moves that are left, as if they ended now; return the robots' present poses (``END_ROW``)."""
        if self.record.moves.size > 0:
            sink.moves(self.moves_so_far())
        ends, poses = np.empty(self.swarm.size, dtype=END_ROW), self.poses()
        ends["run"], ends["robot"], ends["tick"] = self.run, np.arange(self.swarm.size), self.tick
        ends["x_m"], ends["y_m"], ends["heading_rad"] = poses[:, 0], poses[:, 1], wrapped(poses[:, 2])
        ends["stop_tick"] = self.stop_ticks
        return ends

    @property
    def stop_ticks(self) -> NDArray[np.int64]:
        """Tick since which each robot stands and does not hear, (robots,); -1: it moves, or still hears."""
        return np.where(self.swarm["mode"] == STOP, self.swarm["stop_tick"], -1)

    def steer(self, robot: int, turn_deg: float = math.nan, drive_ms: float = math.nan) -> None:
        """Set the next turn and leg of a robot that has just sampled (``robot.walk.steered``)."""
        robot = whole_number_of(robot, "robot", 0, self.swarm.size - 1)
        if not steer_robot(self.swarm, robot, float(turn_deg), float(drive_ms)):
            raise InputError(
                f"robot {robot} has not just sampled; only then can it be steered", field="robot"
            )

    @abstractmethod
    def move_on(self, until: int) -> int:
        """Simulate up to the tick ``until``, or until the buffers might overflow; return the tick reached."""

    def latest_ticks(self) -> NDArray[np.int64]:
        """Return for each robot the tick after whose step its row holds its state, (robots,)."""
        return np.full(self.swarm.size, self.tick - 1)

    def poses(self) -> NDArray[np.float64]:
        """Return the robots' present poses, (robots, 3): x, y, m, and heading, rad, not wrapped."""
        return np.column_stack([self.swarm[name] for name in ("x_m", "y_m", "heading_rad")])
