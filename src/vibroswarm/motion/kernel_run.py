"""One run of an engine whose state is rows of numbers: advance, copy, steer, write down (``MotionState``).

Other robots look ahead on a standing robot only to the end of its stop; its next plan is made when the stop is over. So
steering may change what it resumes while it stands, and nothing else needs to know.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, kernel, zero_rows
from vibroswarm.core.ticks import tick_at
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.motion.control_step import NEVER_FAILS, Swarm, begin, load, store
from vibroswarm.motion.event.trajectory import Planners, ticks_to_sample
from vibroswarm.motion.moves import MoveColumns, drop_ended, let_end, note_moves, with_room
from vibroswarm.motion.recorder import (
    Failure,
    Rows,
    SampleColumns,
    clear,
    copy_record,
    empty_record,
    joined,
    tables,
    with_samples,
    write_segments,
)
from vibroswarm.motion.robot_params import Setup, give_each, setup_of, speed_quantiles
from vibroswarm.motion.source import Motion
from vibroswarm.robot.walk import STOP, steered
from vibroswarm.scenario.scenario import Scenario

MAX_TURN_DEG = 3600.0
MAX_DRIVE_MS = 1e9
ROUNDING_TICKS = 1e-6


@kernel
def steer_robot(swarm: Swarm, i: int, turn_deg: float, drive_ms: float) -> bool:
    """Apply ``robot.walk.steered`` to robot ``i``; return False if it has not just sampled."""
    row = swarm[i]
    if row.mode != STOP or row.sampled == 0 or row.samples == 0:
        return False
    store(swarm, i, steered(load(swarm, i), turn_deg, drive_ms))
    return True


def check_steering(robots: int, robot: int, turn_deg: float, drive_ms: float) -> int:
    """Return the robot's number, if the arguments are valid.

    Raises:
        InputError: no such robot, or an angle or a duration that no robot can turn or drive.
    """
    robot = whole_number_of(robot, "robot", 0, robots - 1)
    if not (math.isnan(turn_deg) or abs(turn_deg) <= MAX_TURN_DEG):
        raise InputError(
            f"{turn_deg!r} is not an angle from -{MAX_TURN_DEG:g} to {MAX_TURN_DEG:g} deg, or nan",
            field="turn_deg",
        )
    if not (math.isnan(drive_ms) or 0.0 <= drive_ms <= MAX_DRIVE_MS):
        raise InputError(
            f"{drive_ms!r} is not a duration from 0 to {MAX_DRIVE_MS:g} ms, or nan", field="drive_ms"
        )
    return robot


@inlined
def no_sample_before(swarm: Swarm, i: int, setup: Setup, latest: int, now: int) -> int:
    """Return a tick, ``now`` or later, before which robot ``i`` does not sample; NEVER_FAILS if it has failed.

    Args:
        latest: tick of the robot's row. now: tick up to which motion is known.
    """
    row = swarm[i]
    if row.failed:
        return NEVER_FAILS
    if row.mode == STOP and row.sampled == 0:
        return max(now, latest + ticks_to_sample(setup, row.stopped_ms))
    # At the earliest, the sample timer runs without a pause, and from 0 if a sample has just been taken.
    timer_ms = 0 if row.mode == STOP else row.timer_ms
    left = (setup.sample_interval_ms - timer_ms) / setup.tick_ms - ROUNDING_TICKS
    stops = latest + (2 + int(left) if left > 0.0 else 1)
    return max(now, stops) + ticks_to_sample(setup, 0)


@kernel
def no_sample_before_steps(swarm: Swarm, setup: Setup, now: int) -> int:
    """Return a tick before which no robot samples, for robots stepped up to tick ``now``."""
    earliest = no_sample_before(swarm, 0, setup, now - 1, now)
    for i in range(1, swarm.size):
        earliest = min(earliest, no_sample_before(swarm, i, setup, now - 1, now))
    return earliest


@kernel
def no_sample_before_plans(planners: Planners, setup: Setup, now: int) -> int:
    """Return the same as ``no_sample_before_steps``, for robots that have plans."""
    earliest = no_sample_before(planners, 0, setup, planners[0].tick, now)
    for i in range(1, planners.size):
        earliest = min(earliest, no_sample_before(planners, i, setup, planners[i].tick, now))
    return earliest


Take = Callable[[NDArray[np.void]], None]

BUFFER_TICKS = 2048
"""Buffers hold this many ticks, were every robot to write a row at each."""


class KernelRun(ABC):
    """A run whose state is rows of numbers. Each engine defines ``fields`` and the abstract methods at the end."""

    fields: ClassVar[np.dtype[np.void]]
    failure: Failure | None = None
    """Why the run failed, if it has."""

    def __init__(
        self, scenario: Scenario, seed: int, run: int, segments: bool = False, moves: bool = False
    ) -> None:
        self.tick_ms = scenario.run.control_period_ms
        self.scenario, self.setup = scenario, setup_of(scenario)
        self.speeds = speed_quantiles(scenario.robot)
        robots = scenario.swarm.robots
        self.swarm = zero_rows(robots, self.fields)
        room = BUFFER_TICKS * robots
        self.record = empty_record(robots, room, room if segments else 0, moves)
        self.prepare()
        self.start(seed, run)

    def prepare(self) -> None:  # noqa: B027 - most have nothing to make
        """Allocate everything that is the same for all runs."""

    def start(self, seed: int, run: int) -> None:
        """Set time 0 of a run, whatever the state was before."""
        self.seed, self.run, self.tick, self.failure = seed, run, 0, None
        self.swarm.view(np.uint8).fill(0)
        clear(self.record)
        begin(self.swarm, self.setup, self.speeds, seed, run)
        give_each(self.swarm, self.scenario, self.setup, seed, run)

    @property
    def stop_ticks(self) -> NDArray[np.int64]:
        """Tick since which each robot stands and does not hear, (robots,); -1: it moves, or stands but hears."""
        return np.where(self.swarm["mode"] == STOP, self.swarm["stop_tick"], -1)

    @property
    def time_s(self) -> float:
        """Time up to which motion is known, s."""
        return self.tick * self.tick_ms / 1000.0

    def copy(self) -> Self:
        """Return an independent copy of this state."""
        branch = object.__new__(type(self))
        branch.__dict__.update(self.__dict__)
        branch.swarm = self.swarm.copy()
        branch.record = copy_record(self.record)
        return branch

    def advance(self, until_s: float) -> Motion:
        """Return the new motion up to the first tick at or after ``until_s``."""
        return tables([self.rows(until_s)], self.tick_ms)

    def rows(self, until_s: float) -> Rows:
        """Return the result of ``advance`` as rows."""
        samples: list[NDArray[np.void]] = []
        rest = self.hand_over(until_s, lambda rows: samples.append(joined([rows])))
        return rest._replace(samples=joined(samples or [rest.samples]))

    def hand_over(self, until_s: float, take: Take, take_moves: Take | None = None) -> Rows:
        """Return ``rows`` without samples, which are passed to ``take`` in a reused buffer.

        Args:
            until_s: as in ``advance``.
            take: called with the new samples.
            take_moves: called with the new moves, in order; these are then not in the rows that are returned.
        """
        since = self.tick
        moves: list[NDArray[np.void]] = []

        def keep_moves(rows: NDArray[np.void]) -> None:
            moves.append(rows[rows["until"] >= since])

        take_moves = take_moves or keep_moves
        segments = self.go_on(until_s, take, take_moves)
        record = self.record
        if record.moves.size > 0:
            headings = self.headings()
            let_end(record.moves, record.under_way, self.tick, headings)
            take_moves(record.moves[: record.filled[2]])
            let_end(record.moves, record.under_way, -1, headings)
        return Rows(
            record.samples[:0],
            in_order(joined(segments or [record.segments[:0]])) if record.segments.size else None,
            self.ends(),
            joined(moves) if moves else None,
            self.failure,
        )

    def go_on(self, until_s: float, take: Take, take_moves: Take | None = None) -> list[NDArray[np.void]]:
        """Advance to the first tick at or after ``until_s``; return the segments, and pass samples on as ``hand_over``
        does.

        Args:
            take_moves: called with the moves that leave the buffer because it is full: all before the oldest that is
                under way.
        """
        return self.go_on_to(self.until_tick(until_s), take, take_moves)

    def until_tick(self, until_s: float) -> int:
        """Return the first tick at or after ``until_s``.

        Raises:
            InputError: it is not a time.
        """
        if not math.isfinite(until_s):
            raise InputError(f"{until_s!r} is not a time", field="until_s")
        return tick_at(until_s, self.tick_ms)

    def go_on_to(self, until: int, take: Take, take_moves: Take | None) -> list[NDArray[np.void]]:
        """Advance to a tick as ``go_on`` does, and empty the buffers whenever they are full."""
        record, segments = self.record, []
        while self.tick < until:
            if self.tick == 0:
                if record.segments.size > 0:
                    write_segments(record, self.swarm, self.run, 0, False)
                if record.moves.size > 0:
                    note_moves(
                        record.moves, record.under_way, record.filled, self.swarm, self.setup, self.run, 0, False
                    )  # fmt: skip
                self.tick = 1
            else:
                self.tick = self.move_on(until)
            if record.filled[0] > 0:
                take(record.samples[: record.filled[0]])
            if record.segments.size > 0:
                segments.append(joined([record.segments[: record.filled[1]]]))
            record.filled[:2] = 0
            if 2 * record.filled[2] > record.moves.size:
                if take_moves is not None:
                    take_moves(record.moves[: record.under_way["place"].min()])
                drop_ended(record.moves, record.under_way, record.filled)
                record = self.record = record._replace(moves=with_room(record.moves, int(record.filled[2])))
        return segments

    def to_sample(
        self,
        until_s: float,
        take: Take,
        take_moves: Take | None = None,
        take_segments: Take | None = None,
    ) -> bool:
        """Advance until just after the next control period in which a robot samples, or to ``until_s`` if none does.

        Args:
            until_s: as in ``advance``.
            take: called with the samples of that period (``SAMPLE_ROW``), one for each robot that samples, by robot;
                the rows are reused later.
            take_moves: called with the moves that have ended since (``MOVE_ROW``), by start and robot.
            take_segments: called with the segments that have begun since.
        Returns: whether any robot samples in the last control period before ``time_s``.
        """
        until, since, sampled = self.until_tick(until_s), self.tick, False
        ended: list[NDArray[np.void]] = []
        segments: list[NDArray[np.void]] = []

        def taken(rows: NDArray[np.void]) -> None:
            nonlocal sampled
            sampled = True
            take(rows)

        def keep_moves(rows: NDArray[np.void]) -> None:
            ended.append(rows[rows["until"] >= since])

        while self.tick < until and not sampled:
            segments += self.go_on_to(min(self.no_sample_before() + 1, until), taken, keep_moves)
        if take_moves is not None and self.record.moves.size > 0:
            keep_moves(self.record.moves[: self.record.filled[2]])
            take_moves(joined(ended))
        if take_segments is not None and segments:
            take_segments(in_order(joined(segments)))
        return sampled

    def moves_under_way(self) -> NDArray[np.void]:
        """Return the robots' current moves (``MOVE_ROW``, (robots,)) up to now, by robot."""
        place = self.record.under_way["place"]
        rows = self.record.moves[place[place >= 0]]
        rows["turned_rad"] = self.headings()[rows["robot"]] - rows["heading_rad"]
        rows["until"] = self.tick
        return rows

    def steer(self, robot: int, turn_deg: float = math.nan, drive_ms: float = math.nan) -> None:
        """Set the next turn and leg of a robot that has just sampled, see ``robot.walk.steered``.

        Args:
            robot: one of those that sampled in the last control period before ``time_s``.
            turn_deg: angle to turn first, anticlockwise positive; nan: go on with what the stop interrupted.
            drive_ms: duration of the leg after that; nan: as drawn.
        Raises:
            InputError: the robot does not stand after a sample, or an angle or a duration is out of range.
        """
        robot = check_steering(self.swarm.size, robot, turn_deg, drive_ms)
        if not steer_robot(self.swarm, robot, float(turn_deg), float(drive_ms)):
            raise InputError(
                f"robot {robot} has not just sampled; only then can it be steered", field="robot"
            )

    @abstractmethod
    def no_sample_before(self) -> int:
        """Return a tick, ``tick`` or later, before which no robot samples."""

    @abstractmethod
    def move_on(self, until: int) -> int:
        """Advance to the tick ``until``, or while the buffers suffice; return the tick reached."""

    @abstractmethod
    def ends(self) -> NDArray[np.void]:
        """Return the robots' current poses: ``END_ROW``."""

    @abstractmethod
    def headings(self) -> NDArray[np.float64]:
        """Return the robots' current headings, rad, not wrapped, (robots,)."""


def in_order(segments: NDArray[np.void]) -> NDArray[np.void]:
    """Sort segment rows by time, then robot: an engine may write a turn only after it has ended."""
    return segments[np.lexsort((segments["robot"], segments["tick"]))]


def batch_of(
    engine: type[KernelRun],
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    segments: bool = False,
    moves: bool = False,
) -> Motion:
    """Simulate whole runs one after the other and return them as one ``Motion``."""
    end_s = scenario.run.t_end_s
    state = engine(scenario, seed, runs[0], segments, moves)
    samples = likely_samples(scenario) * len(runs)
    columns = SampleColumns(state.tick_ms, samples)
    move_columns = MoveColumns(state.tick_ms, 3 * samples if moves else 0)
    pieces = []
    for run in runs:
        state.start(seed, run)
        pieces.append(state.hand_over(end_s, columns.take, move_columns.take if moves else None))
    motion = with_samples(columns.frame(), pieces, state.tick_ms)
    return replace(motion, moves=move_columns.frame()) if moves else motion


def likely_samples(scenario: Scenario) -> int:
    """Return the number of samples of a run if no robot is ever delayed, which is close to the actual number."""
    each_ms = scenario.sample.sample_interval_ms + scenario.sample.stop_ms
    return int(scenario.swarm.robots * scenario.run.t_end_s * 1000.0 / max(each_ms, 1.0)) + 1
