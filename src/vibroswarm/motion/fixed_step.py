"""The fixed-step engine: every control period of every robot, one after the other. Readable, and the oracle.

A period is sense, control, move, contact, sample (``phases``); a whole run with the messages in the loop
(``whole``) adds communicate. Times are whole ticks; the robot stands at tick 0 and walks from tick 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibroswarm.compiled import kernel, zero_rows
from vibroswarm.errors import InputError
from vibroswarm.motion.body import Body, body_of, walk_program
from vibroswarm.motion.contract import Motion, Source, register
from vibroswarm.motion.phases import ROBOT, Swarm, account, begin, contact, control, move, refresh, sense
from vibroswarm.motion.record import (
    Record,
    Rows,
    copy_record,
    empty_record,
    end_rows,
    room,
    tables,
    write_sample,
    write_segments,
)
from vibroswarm.robot.walk import WalkProgram
from vibroswarm.scenario import Scenario

BUFFER_TICKS = 2048
"""Buffers hold this many ticks, were every robot to write a row at each."""


@kernel
def step(
    swarm: Swarm, body: Body, program: WalkProgram, record: Record, seed: int, run: int, tick: int
) -> None:
    """One control period, from ``tick`` to the next."""
    sense(swarm, body, program)
    sampling = control(swarm, body, program, seed, run, tick)
    move(swarm, body)
    contact(swarm, body)
    if record.segments.size > 0:
        write_segments(record, swarm, run, tick, True)
    if sampling > 0:
        sample(swarm, body, record, seed, run, tick)
    account(swarm)


@kernel
def sample(swarm: Swarm, body: Body, record: Record, seed: int, run: int, tick: int) -> None:
    """Write down the samples taken at this tick."""
    for i in range(swarm.size):
        if swarm[i].sampled:
            write_sample(record, swarm, run, i, tick)
            refresh(swarm, body, seed, run, i, tick)


@kernel
def steps(
    swarm: Swarm, body: Body, program: WalkProgram, record: Record, seed: int, run: int, tick: int, until: int
) -> int:
    """Periods from ``tick`` to ``until``, or while the buffers surely suffice; gives the tick reached."""
    until = min(until, tick + room(record, swarm.size))
    for now in range(tick, until):
        step(swarm, body, program, record, seed, run, now)
    return max(tick, until)


class FixedStepRun:
    """One run under the fixed-step engine: state in, state out (``MotionState``)."""

    def __init__(self, scenario: Scenario, seed: int, run: int, segments: bool = False) -> None:
        self.tick_ms, self.seed, self.run = scenario.run.control_period_ms, seed, run
        self.body, self.program = body_of(scenario), walk_program(scenario)
        robots = scenario.swarm.robots
        self.swarm = zero_rows(robots, ROBOT)
        begin(self.swarm, self.body, self.program, seed, run)
        self.tick = 0
        self.record = empty_record(robots, BUFFER_TICKS * robots, BUFFER_TICKS * robots if segments else 0)

    @property
    def time_s(self) -> float:
        """Until when motion is known."""
        return self.tick * self.tick_ms / 1000.0

    def copy(self) -> FixedStepRun:
        """A branch that does not change with this state."""
        other = object.__new__(FixedStepRun)
        other.__dict__.update(self.__dict__)
        other.swarm = self.swarm.copy()
        other.record = copy_record(self.record)
        return other

    def advance(self, until_s: float) -> Motion:
        """What is new up to the first tick at or after ``until_s``."""
        return tables([self.rows(until_s)], self.tick_ms)

    def rows(self, until_s: float) -> Rows:
        """``advance``, as plain rows."""
        if not math.isfinite(until_s):
            raise InputError(f"{until_s!r} is not a time", field="until_s")
        until = math.ceil(until_s * 1000.0 / self.tick_ms - 1e-9)
        samples, segments = [], []
        while self.tick < until:
            if self.tick == 0:
                if self.record.segments.size > 0:
                    write_segments(self.record, self.swarm, self.run, 0, False)
                self.tick = 1
            else:
                self.tick = steps(
                    self.swarm, self.body, self.program, self.record, self.seed, self.run, self.tick, until
                )
            samples.append(self.record.samples[: self.record.filled[0]].copy())
            segments.append(self.record.segments[: self.record.filled[1]].copy())
            self.record.filled[:] = 0
        return Rows(
            np.concatenate(samples or [self.record.samples[:0]]),
            np.concatenate(segments or [self.record.segments[:0]]) if self.record.segments.size else None,
            end_rows(self.swarm, self.run, self.tick),
        )


def motion_of(scenario: Scenario, seed: int, runs: Sequence[int], segments: bool = False) -> Motion:
    """Whole runs, one after the other, as one Motion."""
    end_s = scenario.run.t_end_s
    rows = [FixedStepRun(scenario, seed, run, segments).rows(end_s) for run in runs]
    return tables(rows, scenario.run.control_period_ms)


FIXED_STEP = Source("fixed-step", FixedStepRun, motion_of, "every control period, one after the other")
register(FIXED_STEP)
