"""A motion as replay reads it: who has heard which samples' messages by when, the same under every strategy.

All hear all. A bit sent at tick k is read at the receiver's first walking tick after k, never during its stop; ties
are read in robot order. So a robot whose stop began at tick s (and that last walked at s - 1) has read, when it
samples, what was sent up to tick s - 2. What was sent, and when, are the samples themselves: none of this depends on
what is said.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import allocating_kernel, inner, read_only, signed
from vibroswarm.draws import ALONE, MESSAGE, uniform
from vibroswarm.inference.minds import lost
from vibroswarm.motion.contract import Motion
from vibroswarm.scenario import Scenario

BITS = 64
HEARD_ROWS, LAST_OWN, OTHERS = 0, 1, 2
"""Columns of ``Timeline.heard``."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """Samples (the rows of the motion table, run by run) and what of the run had been heard at each.

    Replay of many strategies over one motion makes it once (``timeline_of``).
    """

    samples: pl.DataFrame
    """run, robot and sample of the rows."""
    ends: pl.DataFrame
    robots: int
    runs: NDArray[np.int64]
    """(runs,)."""
    bounds: NDArray[np.int64]
    """(runs + 1,): the rows of run r are those from ``bounds[r]`` to ``bounds[r + 1]``."""
    time_s: NDArray[np.float64]
    robot: NDArray[np.uint16]
    sample: NDArray[np.uint32]
    """(rows,) each."""
    heard: NDArray[np.int32]
    """(rows, 3): how many rows of the run the robot had come past when it took this sample, which of them was
    its own last one (-1: none; both counted from the run's first row), how many were not its own."""
    heard_at_end: NDArray[np.int32]
    """(runs * robots, 3): the same at the end of the run."""
    _message_numbers: dict[int, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    _not_heard: dict[tuple[int, float], NDArray[np.uint64]] = field(default_factory=dict, repr=False)

    @property
    def longest(self) -> int:
        """Rows of the run that has most."""
        return int(np.diff(self.bounds).max(initial=0))

    def message_numbers(self, seed: int) -> NDArray[np.float64]:
        """The uniform number of each sample's message, (rows,)."""
        if seed not in self._message_numbers:
            self._message_numbers[seed] = message_numbers(
                seed, self.runs, self.bounds, self.robot, self.sample
            )
        return self._message_numbers[seed]

    def not_heard(self, seed: int, loss: float) -> NDArray[np.uint64]:
        """Who does not hear each sample's message, its sender and those who lose it, a bit a robot, (rows,).

        The same under every strategy; of no rows where nothing is lost, or robots are more than the bits of a number.
        """
        if loss <= 0.0 or self.robots > BITS:
            return np.empty(0, dtype=np.uint64)
        if (seed, loss) not in self._not_heard:
            self._not_heard[seed, loss] = not_heard(
                seed, self.runs, self.bounds, self.robot, self.sample, self.robots, loss
            )
        return self._not_heard[seed, loss]


def timeline_of(scenario: Scenario, motion: Motion | Timeline) -> Timeline:
    """The timeline of a motion; one that was made before is given back.

    Raises:
        ValueError: the ends are not one row a run and robot, or there are samples of other robots.
    """
    if isinstance(motion, Timeline):
        return motion
    tick_ms, robots = scenario.run.control_period_ms, scenario.swarm.robots
    samples, ends = motion.samples, motion.ends
    if ends.height % robots:
        raise ValueError(f"{ends.height} ends of runs of {robots} robots")
    highest = int(samples["robot"].to_numpy().max(initial=0))
    if highest >= robots:
        raise ValueError(f"samples of robot {highest} in runs of {robots} robots")
    runs = ends["run"].to_numpy()[::robots]
    bounds = np.append(np.searchsorted(samples["run"].to_numpy(), runs), samples.height)
    names = ("robot", "sample", "time_s", "stop_start_s")
    column = {name: read_only(samples[name].to_numpy()) for name in names}
    heard, at_end = hearing(
        bounds,
        column["robot"],
        column["time_s"],
        column["stop_start_s"],
        heard_at_end(ends, tick_ms),
        tick_ms,
    )
    return Timeline(
        samples=pl.DataFrame([samples[name] for name in ("run", "robot", "sample")]),
        ends=ends,
        robots=robots,
        runs=runs.astype(np.int64),
        bounds=bounds,
        time_s=column["time_s"],
        robot=column["robot"],
        sample=column["sample"],
        heard=heard,
        heard_at_end=at_end,
    )


@inner
def tick_of(time_s: float, tick_ms: int) -> int:
    """The tick nearest to a time."""
    return int(np.rint(time_s * (1000.0 / tick_ms)))


def heard_at_end(ends: pl.DataFrame, tick_ms: int) -> NDArray[np.int64]:
    """What was sent up to this tick has been read when the run ends, shape (robots,).

    A robot that walks last walked at the tick before the end; one that stands, before its stop began.
    """
    stop_start_s, end_s = ends["stop_start_s"].to_numpy(), ends["end_s"].to_numpy()
    standing_since_s = np.where(np.isnan(stop_start_s), end_s, stop_start_s)
    return np.rint(standing_since_s * (1000.0 / tick_ms)).astype(np.int64) - 2


@allocating_kernel
def hearing(
    bounds: NDArray[np.int64],
    robot: NDArray[np.uint16],
    time_s: NDArray[np.float64],
    stop_start_s: NDArray[np.float64],
    until_at_end: NDArray[np.int64],
    tick_ms: int,
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """``Timeline.heard`` and ``heard_at_end``.

    Args:
        robot, time_s, stop_start_s: (rows,) of the motion table. until_at_end: (runs * robots,): what was sent up
            to this tick has been read at the end.
    """
    robots = until_at_end.size // max(bounds.size - 1, 1)
    heard = np.empty((robot.size, 3), dtype=np.int32)
    at_end = np.empty((until_at_end.size, 3), dtype=np.int32)
    tick = np.empty(robot.size, dtype=np.int64)
    previous = np.empty(robot.size, dtype=np.int32)  # the robot's row before, from the run's first
    latest = np.empty(robots, dtype=np.int32)
    own = np.empty(robots, dtype=np.int32)
    for r in range(bounds.size - 1):
        low, high = bounds[r], bounds[r + 1]
        latest[:] = -1
        own[:] = 0
        for k in range(low, high):
            i = signed(robot[k])
            tick[k], previous[k] = tick_of(time_s[k], tick_ms), latest[i]
            until = tick_of(stop_start_s[k], tick_ms) - 2
            write_heard(heard[k], heard, previous, tick, low, k, until, latest[i], own[i])
            latest[i] = k - low
            own[i] += 1
        for i in range(robots):
            e = r * robots + i
            write_heard(at_end[e], heard, previous, tick, low, high, until_at_end[e], latest[i], own[i])
    return heard, at_end


@inner
def write_heard(
    row: NDArray[np.int32],
    heard: NDArray[np.int32],
    previous: NDArray[np.int32],
    tick: NDArray[np.int64],
    low: int,
    k: int,
    until: int,
    last_own: int,
    own: int,
) -> None:
    """What a robot with ``own`` samples, the last in row ``last_own``, has come past before row ``k``."""
    rows = k - low
    while rows > 0 and tick[low + rows - 1] > until:
        rows -= 1
    if last_own >= 0:
        rows = max(rows, heard[low + last_own, HEARD_ROWS])  # what was read stays read
    while last_own >= rows:
        last_own = previous[low + last_own]
        own -= 1
    row[HEARD_ROWS], row[LAST_OWN], row[OTHERS] = rows, last_own, rows - own


@allocating_kernel
def not_heard(
    seed: int,
    runs: NDArray[np.int64],
    bounds: NDArray[np.int64],
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    robots: int,
    loss: float,
) -> NDArray[np.uint64]:
    """``Timeline.not_heard``."""
    out = np.zeros(robot.size, dtype=np.uint64)
    for r in range(runs.size):
        for k in range(bounds[r], bounds[r + 1]):
            sender, index = signed(robot[k]), signed(sample[k])
            for i in range(robots):
                if i == sender or lost(seed, runs[r], i, sender, index, loss):
                    out[k] |= np.uint64(1) << np.uint64(i)
    return out


@allocating_kernel
def message_numbers(
    seed: int,
    runs: NDArray[np.int64],
    bounds: NDArray[np.int64],
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
) -> NDArray[np.float64]:
    """The uniform number of each sample's message, (rows,)."""
    out = np.empty(robot.size, dtype=np.float64)
    for r in range(runs.size):
        for k in range(bounds[r], bounds[r + 1]):
            out[k] = uniform(seed, runs[r], signed(robot[k]), MESSAGE, signed(sample[k]), ALONE)
    return out
