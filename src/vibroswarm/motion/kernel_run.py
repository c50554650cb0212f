"""One run of an engine whose state is rows of numbers: advance it, copy it, steer robots, and record tables.

``KernelRun`` implements ``source.MotionState`` and ``SteeredState`` for all our engines. ``tick`` is the next control
period to simulate: everything before it is done.

A robot can be steered after a sample, while it still stands. In the event engine, other robots then rely on it only up
to the end of its stop, and its own next plan is made when the stop is over. So steering changes only what the robot
resumes after the stop; no other state depends on that yet.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, kernel, zero_rows
from vibroswarm.core.ticks import tick_at
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.motion.control_step import NEVER_FAILS, ROBOT, Swarm, begin, load, place_on_lattice, store
from vibroswarm.motion.event.trajectory import Planners, ticks_to_sample
from vibroswarm.motion.moves import drop_ended, let_end, note_moves, with_room
from vibroswarm.motion.recorder import (
    Failure,
    MoveColumns,
    Rows,
    SampleColumns,
    clear,
    copy_record,
    empty_record,
    end_rows,
    joined,
    segment_frame,
    tables,
    with_samples,
    write_segments,
)
from vibroswarm.motion.robot_params import Setup, give_each, setup_of, speed_quantiles
from vibroswarm.motion.source import Motion
from vibroswarm.robot.walk import STOP, steered
from vibroswarm.scenario.scenario import Scenario

MAX_TURN_DEG = 3600.0
"""Largest angle that a strategy may ask for when it steers, to either side."""
MAX_DRIVE_MS = 1e9
"""Longest leg that a strategy may ask for when it steers."""
ROUNDING_TICKS = 1e-6
"""Rounding error allowed for in a number of ticks."""


@kernel
def steer_robot(swarm: Swarm, i: int, turn_deg: float, drive_ms: float) -> bool:
    """Set the next turn and leg of robot ``i``, which has just sampled; return False, changing nothing, if it has not.

    Args:
        turn_deg, drive_ms: as in ``robot.walk.steered``; NaN leaves the turn or the duration as it would be.
    """
    row = swarm[i]
    # At tick 0 ``sampled`` is set, as if after a sample, but no sample has been counted.
    if row.mode != STOP or row.sampled == 0 or row.samples == 0:
        return False
    store(swarm, i, steered(load(swarm, i), turn_deg, drive_ms))
    return True


def check_steering(robots: int, robot: int, turn_deg: float, drive_ms: float) -> int:
    """Check the arguments of ``KernelRun.steer``; return the robot's number as a Python integer.

    Args:
        robots: number of robots of the swarm.
    Raises:
        InputError: ``robot`` is not a whole number from 0 to ``robots`` - 1, or the angle or the duration is out of
            range.
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
    """Return a tick before which robot ``i`` surely does not sample; NEVER_FAILS if it has failed.

    This is a lower bound, ``now`` or later: the robot may sample later, as turns and avoidances may stop its timer.

    Args:
        latest: the robot's row holds its state after the step of this tick. now: the next tick to simulate.
    """
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
def no_sample_before_steps(swarm: Swarm, setup: Setup, now: int) -> int:
    """Return a tick, ``now`` or later, before which surely no robot samples, for engines that simulate every tick.

    Each robot's row must hold its state after the step of tick ``now`` - 1.
    """
    earliest = no_sample_before(swarm, 0, setup, now - 1, now)
    for i in range(1, swarm.size):
        earliest = min(earliest, no_sample_before(swarm, i, setup, now - 1, now))
    return earliest


@kernel
def no_sample_before_plans(planners: Planners, setup: Setup, now: int) -> int:
    """Return a tick, ``now`` or later, before which surely no robot samples, for the event engine.

    The event engine plans each robot's motion ahead: a robot's row holds its state after the step of ``row.tick``, at
    which its plan began.
    """
    earliest = no_sample_before(planners, 0, setup, planners[0].tick, now)
    for i in range(1, planners.size):
        earliest = min(earliest, no_sample_before(planners, i, setup, planners[i].tick, now))
    return earliest


Take = Callable[[NDArray[np.void]], None]
"""A function that receives new rows. They are overwritten later, so it must copy what it wants to keep."""

BUFFER_TICKS = 2048
"""Number of ticks for which buffers suffice even if every robot writes a row at each tick."""


class KernelRun(ABC):
    """A run whose state is rows of numbers, those after each control period unless an engine defines another.

    Args:
        scenario, seed, run: the run that begins at time 0.
        segments, moves: whether these tables are recorded.
    """

    fields: ClassVar[np.dtype[np.void]] = ROBOT
    """Type of a robot's row, with all the fields that the engine needs."""
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
        """Allocate what the engine needs and what is the same for all runs; called once, before ``start``."""

    def start(self, seed: int, run: int) -> None:
        """Reset this state to time 0 of a run, whatever it was before; buffers are reused."""
        self.seed, self.run, self.tick, self.failure = seed, run, 0, None
        self.swarm.view(np.uint8).fill(0)
        clear(self.record)
        if not begin(self.swarm, self.setup, self.speeds, seed, run):
            place_on_lattice(self.swarm, self.setup, seed, run)
        give_each(self.swarm, self.scenario, self.setup, seed, run)

    @property
    def stop_ticks(self) -> NDArray[np.int64]:
        """Tick since which each robot stands and does not hear, (robots,); -1: it moves, or has failed but still hears.

        For a failed robot that hears, ``control_step.fail`` sets -1 in its row.
        """
        return np.where(self.swarm["mode"] == STOP, self.swarm["stop_tick"], -1)

    @property
    def time_s(self) -> float:
        """Time up to which motion has been simulated, s."""
        return self.tick * self.tick_ms / 1000.0

    def copy(self) -> Self:
        """Return an independent copy of this state."""
        branch = object.__new__(type(self))  # without __init__, which would start a run
        branch.__dict__.update(self.__dict__)  # the parameters never change, so they are shared
        branch.swarm = self.swarm.copy()
        branch.record = copy_record(self.record)
        return branch

    def advance(self, until_s: float) -> Motion:
        """Simulate to the first tick at or after ``until_s``; return the new motion as tables (``MotionState``)."""
        return tables([self.rows(until_s)], self.tick_ms)

    def rows(self, until_s: float) -> Rows:
        """Simulate as ``advance`` does; return the new motion as rows, not yet as tables."""
        samples: list[NDArray[np.void]] = []
        # ``joined`` copies the rows: the buffer that they lie in is used again.
        rest = self.hand_over(until_s, lambda rows: samples.append(joined([rows])))
        return rest._replace(samples=joined(samples or [rest.samples]))  # ``rest.samples`` is empty

    def hand_over(self, until_s: float, take: Take, take_moves: Take | None = None) -> Rows:
        """Simulate as ``advance`` does, and pass samples on in pieces while they are in the processor's cache.

        Args:
            take: called with each piece of new samples, in order (``SAMPLE_ROW``).
            take_moves: called with each piece of moves, in order (``MOVE_ROW``); only for a call that simulates a whole
                run, as moves of earlier calls may still be in the buffer. Without it, new moves are returned.
        Returns:
            The new segments, the ends and the failure; no samples; moves only without ``take_moves``. The robots' moves
            under way are returned as if they ended now. The next call returns them again, with their later end.
        """
        since = self.tick
        moves: list[NDArray[np.void]] = []

        def keep_moves(rows: NDArray[np.void]) -> None:
            # The buffer may also hold moves that ended, and were returned, before this call: leave them out.
            moves.append(rows[rows["until"] >= since])

        take_moves = take_moves or keep_moves
        pieces = self.go_on(until_s, take, take_moves)
        segments = joined(pieces or [self.record.segments[:0]])
        pieces.clear()  # sorting takes the memory of the rows once more
        record = self.record
        if record.moves.size > 0:
            headings = self.headings()
            let_end(record.moves, record.under_way, self.tick, headings)
            # ``filled`` holds the numbers of rows of samples, segments and moves.
            take_moves(record.moves[: record.filled[2]])
            let_end(record.moves, record.under_way, -1, headings)  # they are under way again
        return Rows(
            samples=record.samples[:0],
            segments=in_order(segments) if record.segments.size else None,
            ends=self.ends(),
            moves=joined(moves) if moves else None,
            failure=self.failure,
        )

    def go_on(self, until_s: float, take: Take, take_moves: Take | None = None) -> list[NDArray[np.void]]:
        """Simulate to the first tick at or after ``until_s``; return the new segments, as a list of pieces.

        The list is empty if segments are not recorded.

        Args:
            take: called with each piece of new samples.
            take_moves: called, whenever the buffer of moves is more than half full, with the moves that are then
                removed from it: all those before the oldest one under way. The other moves stay in the buffer. If None,
                the removed moves are dropped.
        """
        return self.go_on_to(self.until_tick(until_s), take, take_moves)

    def until_tick(self, until_s: float) -> int:
        """Return the first tick at or after ``until_s``.

        Raises:
            InputError: ``until_s`` is NaN or infinite.
        """
        if not math.isfinite(until_s):
            raise InputError(f"{until_s!r} is not a time", field="until_s")
        return tick_at(until_s, self.tick_ms)

    def go_on_to(self, until: int, take: Take, take_moves: Take | None) -> list[NDArray[np.void]]:
        """Simulate up to the tick ``until`` in pieces that fit into the buffers; return the new segments, in pieces.

        ``take`` and ``take_moves`` are those of ``go_on``.
        """
        record, segments = self.record, []
        while self.tick < until:
            if self.tick == 0:  # nothing moves at tick 0: only write the segments and moves that begin there
                # 0 is the tick; False: the robots have not moved, so rows start from their present poses.
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
            if record.segments.size > 0:  # ``joined`` copies the rows, since the buffer is used again
                segments.append(joined([record.segments[: record.filled[1]]]))
            record.filled[:2] = 0  # the buffers of samples and segments are empty again
            # Moves stay in their buffer until it is more than half full. Then pass on and remove those before the
            # oldest move under way; if that does not make enough room, the buffer is enlarged.
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
        """Simulate until just after the next control period in which a robot samples, or to ``until_s`` if none does.

        Args:
            until_s: as in ``advance``.
            take: called with the samples of that period (``SAMPLE_ROW``), one row for each robot that samples, in the
                order of robots; the rows are overwritten later.
            take_moves: called once with the moves that ended in this call (``MOVE_ROW``), sorted by start and robot;
                not called if moves are not recorded.
            take_segments: called once with the segments that began in this call (``SEGMENT_ROW``), sorted by time and
                robot; not called if segments are not recorded or nothing was simulated. There may be no rows.
        Returns: whether any robot sampled. If so, it sampled in the last control period before the new ``time_s``.
        """
        until, since, sampled = self.until_tick(until_s), self.tick, False
        ended: list[NDArray[np.void]] = []
        segments: list[NDArray[np.void]] = []

        def note_samples(rows: NDArray[np.void]) -> None:
            nonlocal sampled
            sampled = True
            take(rows)

        def keep_moves(rows: NDArray[np.void]) -> None:
            # Leave out moves that ended before this call, and moves under way, whose ``until`` is -1.
            ended.append(rows[rows["until"] >= since])

        # Simulate up to the end of the first control period in which a robot may sample; repeat if none has sampled.
        while self.tick < until and not sampled:
            segments += self.go_on_to(min(self.no_sample_before() + 1, until), note_samples, keep_moves)
        if take_moves is not None and self.record.moves.size > 0:
            # Some moves that ended are still in the buffer.
            keep_moves(self.record.moves[: self.record.filled[2]])
            take_moves(joined(ended))
        if take_segments is not None and segments:
            take_segments(in_order(joined(segments)))
        return sampled

    def moves_under_way(self) -> NDArray[np.void]:
        """Return a copy of the robots' current moves as if they ended now (``MOVE_ROW``), in the order of robots.

        Shape (robots,); empty if moves are not recorded or none has begun.
        """
        place = self.record.under_way["place"]
        rows = self.record.moves[place[place >= 0]]  # indexing by an array copies the rows
        rows["turned_rad"] = self.headings()[rows["robot"]] - rows["heading_rad"]
        rows["until"] = self.tick
        return rows

    def steer(self, robot: int, turn_deg: float = math.nan, drive_ms: float = math.nan) -> None:
        """Set the next turn and leg of a robot that has just sampled (``robot.walk.steered``).

        Args:
            robot: a robot that sampled in the last control period before ``time_s``.
            turn_deg: angle to turn first, anticlockwise positive; nan: go on with what the stop interrupted.
            drive_ms: duration of the leg after that; nan: the duration drawn at random.
        Raises:
            InputError: the robot does not stand after a sample, or an angle or a duration is out of range.
        """
        robot = check_steering(self.swarm.size, robot, turn_deg, drive_ms)
        if not steer_robot(self.swarm, robot, float(turn_deg), float(drive_ms)):
            raise InputError(
                f"robot {robot} has not just sampled; only then can it be steered", field="robot"
            )

    @abstractmethod
    def move_on(self, until: int) -> int:
        """Simulate up to the tick ``until``, or until the buffers might overflow; return the tick reached."""

    def no_sample_before(self) -> int:
        """Return a tick, ``tick`` or later, before which surely no robot samples."""
        return no_sample_before_steps(self.swarm, self.setup, self.tick)

    def ends(self) -> NDArray[np.void]:
        """Return the robots' current poses: ``END_ROW``."""
        return end_rows(self.swarm, self.run, self.tick)

    def headings(self) -> NDArray[np.float64]:
        """Return the robots' current headings, rad, not wrapped, (robots,)."""
        return self.swarm["heading_rad"].copy()


def in_order(rows: NDArray[np.void]) -> NDArray[np.void]:
    """Return rows of segments or moves sorted by time, then robot.

    The event engine writes the segments of a turn after their ticks.
    """
    return rows[np.lexsort((rows["robot"], rows["tick"]))]


def batch_of(
    engine: type[KernelRun],
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    segments: bool = False,
    moves: bool = False,
) -> Motion:
    """Simulate whole runs of an engine one after the other; return them as one ``Motion``, in the order of ``runs``.

    All runs use the same state and buffers (``start`` resets them), and rows are converted to columns while they are in
    the processor's cache.

    Args:
        runs: run numbers, at least one. segments, moves: whether these tables are recorded.
    """
    end_s = scenario.run.t_end_s
    state = engine(scenario, seed, runs[0], segments, moves)
    samples = likely_samples(scenario) * len(runs)
    columns = SampleColumns(state.tick_ms, samples)
    # Robots make some three moves per sample; more memory is allocated when needed.
    move_columns = MoveColumns(state.tick_ms, 3 * samples if moves else 0)
    pieces, arcs = [], []
    for run in runs:
        state.start(seed, run)
        piece = state.hand_over(end_s, columns.take, move_columns.take if moves else None)
        if piece.segments is not None:  # the largest table: rows of all runs would double its memory
            arcs.append(segment_frame(piece.segments, state.tick_ms))
        pieces.append(piece._replace(segments=None))
    motion = with_samples(columns.frame(), pieces, state.tick_ms)
    if arcs:
        motion = replace(motion, segments=pl.concat(arcs))
    return replace(motion, moves=move_columns.frame()) if moves else motion


def likely_samples(scenario: Scenario) -> int:
    """Estimate the number of samples of a run, from above, as if turns and avoidances never delayed a sample."""
    each_ms = scenario.sample.sample_interval_ms + scenario.sample.stop_ms
    return int(scenario.swarm.robots * scenario.run.t_end_s * 1000.0 / max(each_ms, 1.0)) + 1
