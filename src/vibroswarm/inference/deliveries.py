"""A motion as replay reads it: which samples' messages each robot has heard by when, the same under every
strategy.

Without losses every robot hears every message. A bit sent at tick k is read at the receiver's first walking tick
after k, never during its stop; ties are read in robot order. So a robot whose stop began at tick s, and that last
walked at s - 1, has read all messages sent up to tick s - 2 when it samples. Messages are sent at samples, so
none of this depends on their content.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, inner, read_only, signed, unsigned
from vibroswarm.core.rng import ALONE, MESSAGE, uniform
from vibroswarm.inference.agents import loss_uniform
from vibroswarm.inference.replay_arrays import NO_ESTIMATES, Deliveries, Rows, Stops
from vibroswarm.inference.sender_positions import Tracks, tracks_of
from vibroswarm.localisation.locate import estimate, estimates_key, is_estimated
from vibroswarm.motion.source import Motion
from vibroswarm.networks import network
from vibroswarm.scenario.scenario import Scenario

LANES, LANE_BITS = 4, 16
"""Counts of several robots packed into a 64-bit word: lanes per word, bits per lane."""
MAX_ROBOTS = 64
"""Above this, the receivers of a message are not cached."""
HEARD_ROWS, LAST_OWN, OTHERS = 0, 1, 2
"""Columns of ``Timeline.heard``."""


class Reach(NamedTuple):
    """Receivers of each message if some are lost."""

    words: NDArray[np.uint64]
    """(rows, words): a 1 in the lane of each robot that hears the message of this row, so that the counts of all
    robots are added up at once."""
    others: NDArray[np.int32]
    """(rows,): number of messages the robot had heard when it took this sample."""
    others_at_end: NDArray[np.int32]
    """(runs * robots,): the same at the end of the run."""


NO_REACH = Reach(np.empty((0, 0), np.uint64), np.empty(0, np.int32), np.empty(0, np.int32))

NO_STOPS: Final = Stops(
    *(
        read_only(np.empty(0, dtype=kind))
        for kind in (np.int64, np.int64, np.int32, np.int32, np.int64, np.int64)
    )
)


@dataclass(frozen=True, eq=False)
class Timeline:
    """The samples of a motion, run by run, and the messages of the run that had been heard at each.

    ``timeline_of`` builds it once for the replay of many strategies over one motion.
    """

    samples: pl.DataFrame
    """run, robot and sample of the rows."""
    ends: pl.DataFrame
    robots: int
    runs: NDArray[np.int64]
    """(runs,)."""
    bounds: NDArray[np.int64]
    """(runs + 1,): run r has the rows from ``bounds[r]`` to ``bounds[r + 1]``."""
    tick_ms: int
    time_s: NDArray[np.float64]
    stop_start_s: NDArray[np.float64]
    robot: NDArray[np.uint16]
    sample: NDArray[np.uint32]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    """(rows,) each."""
    heard: NDArray[np.int32]
    """(rows, 3), at the time of this sample: how many of the run's messages lie behind the robot, the row of its
    own last one (-1: none; both counted from the run's first row), and how many were not its own."""
    heard_at_end: NDArray[np.int32]
    """(runs * robots, 3): the same at the end of the run."""
    moves: pl.DataFrame | None = None
    _message_uniforms: dict[int, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    _reach: dict[tuple[int, float], Reach] = field(default_factory=dict, repr=False)

    _estimates: dict[Any, NDArray[np.float64]] = field(default_factory=dict, repr=False)

    deliveries: dict[Any, Deliveries] = field(default_factory=dict, repr=False)
    """Cache, keyed by everything that they depend on; see ``deliveries_of``."""

    def stops_if(self, needed: bool) -> Stops:
        """Return ``stops`` if needed, else empty ones."""
        return self.stops if needed else NO_STOPS

    @cached_property
    def stops(self) -> Stops:
        """When robots stand."""
        per_s = 1000.0 / self.tick_ms
        tick, stop_tick = (
            np.rint(column * per_s).astype(np.int64) for column in (self.time_s, self.stop_start_s)
        )
        run = np.repeat(np.arange(self.runs.size), np.diff(self.bounds))
        whose = run * self.robots + self.robot
        order = np.argsort(whose, kind="stable")
        following = np.full(tick.size, -1, dtype=np.int32)
        first = np.full(self.runs.size * self.robots, -1, dtype=np.int32)
        begins = np.flatnonzero(np.append(True, np.diff(whose[order]) != 0)[: order.size])
        goes_on = np.setdiff1d(np.arange(order.size), begins)
        following[order[goes_on - 1]] = order[goes_on] - self.bounds[run[order[goes_on]]]
        first[whose[order[begins]]] = order[begins] - self.bounds[run[order[begins]]]
        end_tick = np.rint(self.ends["end_s"].to_numpy() * per_s).astype(np.int64)
        known = end_tick.reshape(-1, self.robots).max(axis=1) if end_tick.size else end_tick
        walked = last_read_ticks(self.ends, self.tick_ms) + 1
        return Stops(*(read_only(column) for column in (tick, stop_tick, following, first, walked, known)))

    @cached_property
    def tracks(self) -> Tracks:
        """Robot positions at any tick.

        Raises:
            InputError: the motion has no moves.
        """
        return tracks_of(self.moves, self.runs, self.robots, self.tick_ms)

    @property
    def longest(self) -> int:
        """Number of rows of the longest run."""
        return int(np.diff(self.bounds).max(initial=0))

    def message_uniforms(self, seed: int) -> NDArray[np.float64]:
        """Return the uniform number of each sample's message, (rows,)."""
        if seed not in self._message_uniforms:
            self._message_uniforms[seed] = message_uniforms(
                seed, self.runs, self.bounds, self.robot, self.sample
            )
        return self._message_uniforms[seed]

    def estimates(self, scenario: Scenario, seed: int) -> NDArray[np.float64]:
        """Return where robots believe they are at each sample, (rows, 9 and more) as ``Readings.estimates``; of no rows
        if they know where they are. It is the same for all strategies.

        Raises:
            InputError: the robots estimate their positions, and the motion has no moves.
        """
        if not is_estimated(scenario):
            return NO_ESTIMATES
        key = estimates_key(scenario, seed)
        if key not in self._estimates:
            self._estimates[key] = read_only(
                estimate(scenario, seed, self.samples, self.stop_start_s, self.time_s, self.moves, self.ends)
            )
        return self._estimates[key]

    def reach(self, seed: int, loss: float) -> Reach:
        """Return who receives the message of each sample where a share ``loss`` is lost.

        It is the same under every strategy, so it is computed once for each seed and loss. The result is the empty
        ``NO_REACH`` if nothing is lost, or if there are too many robots or messages for the packed counts.
        """
        if loss <= 0.0 or self.robots > MAX_ROBOTS or self.longest >= 1 << LANE_BITS:
            return NO_REACH
        if (seed, loss) not in self._reach:
            self._reach[seed, loss] = Reach(*compute_reach(
                seed, self.runs, self.bounds, self.robot, self.sample, self.heard, self.heard_at_end, loss
            ))  # fmt: skip
        return self._reach[seed, loss]


def needs_moves(scenario: Scenario) -> bool:
    """Return whether a scenario's network or localisation reads the table of moves."""
    return network(scenario.network.name).reads_positions or is_estimated(scenario)


def timeline_of(scenario: Scenario, motion: Motion | Timeline) -> Timeline:
    """Return the timeline of a motion; a timeline is returned as it is.

    Raises:
        ValueError: the ends are not one row per run and robot, or there are samples of other robots.
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
    names = ("robot", "sample", "time_s", "stop_start_s", "x_m", "y_m", "heading_rad")
    column = {name: read_only(samples[name].to_numpy()) for name in names}
    heard, at_end = compute_heard(
        bounds,
        column["robot"],
        column["time_s"],
        column["stop_start_s"],
        last_read_ticks(ends, tick_ms),
        tick_ms,
    )
    return Timeline(
        samples=pl.DataFrame([samples[name] for name in ("run", "robot", "sample")]),
        ends=ends,
        robots=robots,
        runs=runs.astype(np.int64),
        bounds=bounds,
        tick_ms=tick_ms,
        time_s=column["time_s"],
        stop_start_s=column["stop_start_s"],
        robot=column["robot"],
        sample=column["sample"],
        x_m=column["x_m"],
        y_m=column["y_m"],
        heading_rad=column["heading_rad"],
        heard=heard,
        heard_at_end=at_end,
        moves=motion.moves,
    )


def rows_of(timeline: Timeline) -> Rows:
    """Return a timeline as kernels read it."""
    columns = (timeline.bounds, timeline.runs, timeline.robot, timeline.sample, timeline.time_s)
    return Rows(*(read_only(column) for column in (*columns, timeline.heard, timeline.heard_at_end)))


@inner
def tick_of(time_s: float, tick_ms: int) -> int:
    """Return the tick nearest to a time."""
    return int(np.rint(time_s * (1000.0 / tick_ms)))


def last_read_ticks(ends: pl.DataFrame, tick_ms: int) -> NDArray[np.int64]:
    """Return the tick up to which each robot has read all messages when the run ends, (runs * robots,).

    A robot reads until the tick at which it last walked: one before the end, or one before its stop began if it
    stands at the end. By then it has read what was sent before that tick.
    """
    stop_start_s, end_s = ends["stop_start_s"].to_numpy(), ends["end_s"].to_numpy()
    standing_since_s = np.where(np.isnan(stop_start_s), end_s, stop_start_s)
    return np.rint(standing_since_s * (1000.0 / tick_ms)).astype(np.int64) - 2


@allocating_kernel
def compute_heard(
    bounds: NDArray[np.int64],
    robot: NDArray[np.uint16],
    time_s: NDArray[np.float64],
    stop_start_s: NDArray[np.float64],
    until_at_end: NDArray[np.int64],
    tick_ms: int,
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return ``Timeline.heard`` and ``heard_at_end``.

    Args:
        robot, time_s, stop_start_s: (rows,), columns of the motion table.
        until_at_end: (runs * robots,), the tick up to which each robot has read all messages at the end of the run.
    """
    robots = until_at_end.size // max(bounds.size - 1, 1)
    heard = np.empty((robot.size, 3), dtype=np.int32)
    at_end = np.empty((until_at_end.size, 3), dtype=np.int32)
    tick = np.empty(robot.size, dtype=np.int64)
    previous = np.empty(robot.size, dtype=np.int32)  # the robot's previous row, from the run's first
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
    """Fill in ``row``, a row of ``Timeline.heard``: what a robot has read of the messages of rows ``low`` to ``k``.

    Args:
        until: tick up to which the robot has read all messages.
        last_own: row of the robot's last sample before row ``k``, from the run's first; -1: none.
        own: number of its samples before row ``k``.
    """
    rows = k - low
    while rows > 0 and tick[low + rows - 1] > until:
        rows -= 1
    if last_own >= 0:
        rows = max(rows, heard[low + last_own, HEARD_ROWS])  # what is read stays read
    while last_own >= rows:
        last_own = previous[low + last_own]
        own -= 1
    row[HEARD_ROWS], row[LAST_OWN], row[OTHERS] = rows, last_own, rows - own


@allocating_kernel
def compute_reach(
    seed: int,
    runs: NDArray[np.int64],
    bounds: NDArray[np.int64],
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    heard: NDArray[np.int32],
    heard_at_end: NDArray[np.int32],
    loss: float,
) -> tuple[NDArray[np.uint64], NDArray[np.int32], NDArray[np.int32]]:
    """Return the arrays of ``Reach``.

    Args:
        runs to heard_at_end: of the ``Timeline``.
    """
    robots = heard_at_end.shape[0] // max(runs.size, 1)
    words = np.zeros((robot.size, (robots + LANES - 1) // LANES), dtype=np.uint64)
    reached_lanes = np.empty(robot.size, dtype=np.int32)
    at_end = np.empty(heard_at_end.shape[0], dtype=np.int32)
    numbers = np.empty(robot.size, dtype=np.float64)
    # Receivers of the messages before each row of a run, summed.
    reached = np.zeros((robot.size + 1, words.shape[1]), dtype=np.uint64)
    for r in range(runs.size):
        low, high = bounds[r], bounds[r + 1]
        for i in range(robots):
            mark_receivers(
                words[low:high], numbers, i, seed, runs[r], robot[low:high], sample[low:high], loss
            )
        for k in range(unsigned(low), unsigned(high)):
            reached_lanes[k] = in_lane(reached[unsigned(heard[k, HEARD_ROWS])], signed(robot[k]))
            place = k - unsigned(low)
            for w in range(unsigned(words.shape[1])):
                reached[place + unsigned(1), w] = reached[place, w] + words[k, w]
        for i in range(robots):
            e = r * robots + i
            at_end[e] = in_lane(reached[unsigned(heard_at_end[e, HEARD_ROWS])], i)
    return words, reached_lanes, at_end


@inner
def mark_receivers(
    words: NDArray[np.uint64],
    numbers: NDArray[np.float64],
    i: int,
    seed: int,
    run: int,
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    loss: float,
) -> None:
    """Mark robot ``i`` in the words of the messages that reach it.

    Args:
        words: (rows, words), rows of the run; written.
        robot, sample: (rows,), columns of the run.
        numbers: scratch for at least as many rows.
    """
    for k in range(unsigned(robot.size)):  # a separate loop, which compilers vectorise
        numbers[k] = loss_uniform(seed, run, i, signed(robot[k]), signed(sample[k]))
    word, bit = np.uint64(i // LANES), np.uint64(1) << np.uint64(i % LANES * LANE_BITS)
    for k in range(unsigned(robot.size)):
        reached = (robot[k] != i) & (numbers[k] >= loss)
        words[k, word] |= bit if reached else np.uint64(0)


@inner
def in_lane(words: NDArray[np.uint64], i: int) -> int:
    """Return robot ``i``'s count from a row of packed counts (``LANES``)."""
    shifted = words[i // LANES] >> np.uint64(i % LANES * LANE_BITS)
    return signed(shifted & np.uint64((1 << LANE_BITS) - 1))


@allocating_kernel
def message_uniforms(
    seed: int,
    runs: NDArray[np.int64],
    bounds: NDArray[np.int64],
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
) -> NDArray[np.float64]:
    """Return the uniform number of each sample's message, (rows,)."""
    out = np.empty(robot.size, dtype=np.float64)
    for r in range(runs.size):
        for k in range(bounds[r], bounds[r + 1]):
            out[k] = uniform(seed, runs[r], signed(robot[k]), MESSAGE, signed(sample[k]), ALONE)
    return out
