"""One run of an engine whose state is rows of numbers: advance, copy, write down (``MotionState``)."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import zero_rows
from vibroswarm.errors import InputError
from vibroswarm.motion.body import give_each, setup_of, speed_quantiles
from vibroswarm.motion.contract import Motion
from vibroswarm.motion.phases import begin
from vibroswarm.motion.record import (
    Rows,
    SampleColumns,
    copy_record,
    empty_record,
    joined,
    tables,
    with_samples,
    write_segments,
)
from vibroswarm.robot.walk import STOP
from vibroswarm.scenario import Scenario

BUFFER_TICKS = 2048
"""Buffers hold this many ticks, were every robot to write a row at each."""


class KernelRun(ABC):
    """State in, state out. A kind of engine gives its rows' fields and the two methods at the end."""

    fields: ClassVar[np.dtype[np.void]]

    def __init__(self, scenario: Scenario, seed: int, run: int, segments: bool = False) -> None:
        self.tick_ms = scenario.run.control_period_ms
        self.scenario, self.setup = scenario, setup_of(scenario)
        self.speeds = speed_quantiles(scenario.robot)
        robots = scenario.swarm.robots
        self.swarm = zero_rows(robots, self.fields)
        self.record = empty_record(robots, BUFFER_TICKS * robots, BUFFER_TICKS * robots if segments else 0)
        self.prepare()
        self.start(seed, run)

    def prepare(self) -> None:  # noqa: B027 - most have nothing to make
        """Make what is the same for all runs, once."""

    def start(self, seed: int, run: int) -> None:
        """Go to time 0 of a run, whatever this state was before."""
        self.seed, self.run, self.tick = seed, run, 0
        self.swarm.view(np.uint8).fill(0)
        self.record.latest[:], self.record.filled[:] = -1.0, 0
        begin(self.swarm, self.setup, self.speeds, seed, run)
        give_each(self.swarm, self.scenario)

    @property
    def stop_ticks(self) -> NDArray[np.int64]:
        """Since which tick each robot stands, (robots,); -1: it walks."""
        return np.where(self.swarm["mode"] == STOP, self.swarm["stop_tick"], -1)

    @property
    def time_s(self) -> float:
        """Until when motion is known."""
        return self.tick * self.tick_ms / 1000.0

    def copy(self) -> Self:
        """A branch that does not change with this state."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other.swarm = self.swarm.copy()
        other.record = copy_record(self.record)
        return other

    def advance(self, until_s: float) -> Motion:
        """What is new up to the first tick at or after ``until_s``."""
        return tables([self.rows(until_s)], self.tick_ms)

    def rows(self, until_s: float) -> Rows:
        """``advance``, as plain rows."""
        samples: list[NDArray[np.void]] = []
        rest = self.hand_over(until_s, lambda rows: samples.append(joined([rows])))
        return rest._replace(samples=joined(samples or [rest.samples]))

    def hand_over(self, until_s: float, take: Callable[[NDArray[np.void]], None]) -> Rows:
        """``rows`` without samples: those are handed over as they come, in a buffer that is used again."""
        segments, record = self.go_on(until_s, take), self.record
        return Rows(
            record.samples[:0],
            in_order(joined(segments or [record.segments[:0]])) if record.segments.size else None,
            self.ends(),
        )

    def go_on(self, until_s: float, take: Callable[[NDArray[np.void]], None]) -> list[NDArray[np.void]]:
        """Move on to the first tick at or after ``until_s``; gives the segments, and samples as ``hand_over`` does."""
        if not math.isfinite(until_s):
            raise InputError(f"{until_s!r} is not a time", field="until_s")
        until = math.ceil(until_s * 1000.0 / self.tick_ms - 1e-9)
        record, segments = self.record, []
        while self.tick < until:
            if self.tick == 0:
                if record.segments.size > 0:
                    write_segments(record, self.swarm, self.run, 0, False)
                self.tick = 1
            else:
                self.tick = self.move_on(until)
            if record.filled[0] > 0:
                take(record.samples[: record.filled[0]])
            if record.segments.size > 0:
                segments.append(joined([record.segments[: record.filled[1]]]))
            record.filled[:] = 0
        return segments

    @abstractmethod
    def move_on(self, until: int) -> int:
        """Move to the tick ``until``, or for as long as the buffers suffice; gives the tick reached."""

    @abstractmethod
    def ends(self) -> NDArray[np.void]:
        """Where the robots are now: ``END_ROW``."""


def in_order(segments: NDArray[np.void]) -> NDArray[np.void]:
    """Segment rows by time, then robot: an engine may write a turn down when it is over."""
    return segments[np.lexsort((segments["robot"], segments["tick"]))]


def batch_of(
    engine: type[KernelRun], scenario: Scenario, seed: int, runs: Sequence[int], segments: bool
) -> Motion:
    """Whole runs, one after the other, as one Motion."""
    end_s = scenario.run.t_end_s
    state = engine(scenario, seed, runs[0], segments)
    columns = SampleColumns(state.tick_ms, likely_samples(scenario) * len(runs))
    pieces = []
    for run in runs:
        state.start(seed, run)
        pieces.append(state.hand_over(end_s, columns.take))
    return with_samples(columns.frame(), pieces, state.tick_ms)


def likely_samples(scenario: Scenario) -> int:
    """As many samples as a run takes if nobody is ever kept from it: about as many as there will be."""
    each_ms = scenario.sample.sample_interval_ms + scenario.sample.stop_ms
    return int(scenario.swarm.robots * scenario.run.t_end_s * 1000.0 / max(each_ms, 1.0)) + 1
