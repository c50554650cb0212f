"""A motion as replay reads it: which messages each robot has heard at each of its samples, the same for all strategies.

Each sample sends one message, so rows of samples are also rows of messages. Without losses every robot hears every
message. A message sent at tick k is read at the receiver's first walking tick after k, never while it stands; messages
sent at the same tick are read in the order of the robots. So a robot whose stop began at tick s last walked at s - 1.
When it samples, it has read all messages sent up to tick s - 2. None of this depends on the content of messages.
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

LANES = 4
"""Number of robots whose counts are packed into one 64-bit word. The part of the word for a robot is its lane."""
LANE_BITS = 16
"""Number of bits of a lane, the part of a 64-bit word that holds the count of one robot."""
MAX_ROBOTS = 64
"""For swarms larger than this, the receivers of messages are not cached."""
HEARD_ROWS = 0
"""Column of ``Rows.heard``: number n of the run's messages that the robot has passed, its own among them."""
LAST_OWN = 1
"""Column of ``Rows.heard``: row of the last of these n messages that is the robot's own; -1: none."""
OTHERS = 2
"""Column of ``Rows.heard``: number of these n messages that are not the robot's own."""


class Reach(NamedTuple):
    """Receivers of each message if some messages are lost."""

    words: NDArray[np.uint64]
    """(rows, robots / LANES rounded up): 1 in the lane of each robot that hears the message of this row, so that one
    addition counts the messages of several robots."""
    others: NDArray[np.int32]
    """(rows,): number of messages that the robot of this row had heard when it took this sample."""
    others_at_end: NDArray[np.int32]
    """(runs * robots,): number of messages that each robot has heard at the end of its run."""


NO_REACH = Reach(np.empty((0, 0), np.uint64), np.empty(0, np.int32), np.empty(0, np.int32))
"""Stands for receivers that are not cached."""

NO_STOPS: Final = Stops(
    *(
        read_only(np.empty(0, dtype=kind))
        for kind in (np.int64, np.int64, np.int32, np.int32, np.int64, np.int64)
    )
)
"""Empty stops, for replays that need none."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """The samples of a motion, run by run, and how many messages of the run the robot had heard at each.

    ``timeline_of`` builds it once for the replay of many strategies over one motion.
    """

    samples: pl.DataFrame
    """run, robot and sample of the rows."""
    ends: pl.DataFrame
    """Table of the ends of the robots' motion."""
    rows: Rows
    """What kernels read of the samples."""
    robots: int
    """Number of robots of a run."""
    tick_ms: int
    """Control period."""
    stop_start_s: NDArray[np.float64]
    """(rows,): when the robot stopped for the sample."""
    x_m: NDArray[np.float64]
    """(rows,): true x at the sample."""
    y_m: NDArray[np.float64]
    """(rows,): true y at the sample."""
    heading_rad: NDArray[np.float64]
    """(rows,): true heading at the sample."""
    moves: pl.DataFrame | None = None
    """Table of moves; None if the motion has none."""
    _message_uniforms: dict[int, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    _reach: dict[tuple[int, float], Reach] = field(default_factory=dict, repr=False)

    _estimates: dict[Any, NDArray[np.float64]] = field(default_factory=dict, repr=False)

    deliveries: dict[Any, Deliveries] = field(default_factory=dict, repr=False)
    """Cache, keyed by everything that they depend on; see ``deliveries_of``."""

    def stops_if(self, needed: bool) -> Stops:
        """Return when robots stand (``stops``) if that is needed, else empty arrays, which cost nothing."""
        return self.stops if needed else NO_STOPS

    @cached_property
    def stops(self) -> Stops:
        """When robots stand (``replay_arrays.Stops``), computed from the times of samples and of ends."""
        per_s, rows = 1000.0 / self.tick_ms, self.rows
        tick, stop_tick = (
            np.rint(column * per_s).astype(np.int64) for column in (rows.time_s, self.stop_start_s)
        )
        run = np.repeat(np.arange(rows.runs.size), np.diff(rows.bounds))  # index of the run of each row
        run_start = rows.bounds[run]  # for each row, the first row of its run
        whose = run * self.robots + rows.robot  # robot of each row, counted over all runs
        order = np.argsort(whose, kind="stable")  # rows by robot and, for each robot, in order of time
        goes_on = np.diff(whose[order]) == 0  # whether the next row in this order is of the same robot
        # ``following`` and ``first`` hold rows that are counted from the first row of their run, which is subtracted.
        following = np.full(tick.size, -1, dtype=np.int32)
        later = order[1:][goes_on]
        following[order[:-1][goes_on]] = later - run_start[later]
        first = np.full(rows.runs.size * self.robots, -1, dtype=np.int32)
        begins = order[np.append(True, ~goes_on)[: order.size]]  # first row of each robot; none without rows
        first[whose[begins]] = begins - run_start[begins]
        # known: tick at which each run ends; empty if there are no runs.
        end_tick = np.rint(self.ends["end_s"].to_numpy() * per_s).astype(np.int64)
        known = end_tick.reshape(-1, self.robots).max(axis=1) if end_tick.size else end_tick
        # A message is read one tick after it was sent, so a robot last walked one tick after the last tick whose
        # messages it has read.
        walked = last_read_ticks(self.ends, self.tick_ms) + 1
        return Stops(
            tick=read_only(tick),
            stop_tick=read_only(stop_tick),
            following=read_only(following),
            first=read_only(first),
            walked_tick=read_only(walked),
            known_tick=read_only(known),
        )

    @cached_property
    def tracks(self) -> Tracks:
        """Moves from which the robots' positions at any tick are computed.

        Raises:
            InputError: the motion has no table of moves.
        """
        return tracks_of(self.moves, self.rows.runs, self.robots, self.tick_ms)

    @property
    def longest(self) -> int:
        """Number of rows of the longest run."""
        return int(np.diff(self.rows.bounds).max(initial=0))

    def message_uniforms(self, seed: int) -> NDArray[np.float64]:
        """Return the first random number of ``on_sample`` at each sample, (rows,); the result is cached by seed."""
        rows = self.rows
        if seed not in self._message_uniforms:
            self._message_uniforms[seed] = message_uniforms(
                seed, rows.runs, rows.bounds, rows.robot, rows.sample
            )
        return self._message_uniforms[seed]

    def estimates(self, scenario: Scenario, seed: int) -> NDArray[np.float64]:
        """Return where robots believe they are at each sample, as in ``replay_arrays.Readings.estimates``.

        The result is cached. Strategies share it if they read the same number of draws. It has no rows if the robots
        know their true places.

        Raises:
            InputError: the robots estimate their positions, and the motion has no table of moves.
        """
        if not is_estimated(scenario):
            return NO_ESTIMATES
        key = estimates_key(scenario, seed)
        if key not in self._estimates:
            self._estimates[key] = read_only(
                estimate(
                    scenario, seed, self.samples, self.stop_start_s, self.rows.time_s, self.moves, self.ends
                )
            )
        return self._estimates[key]

    def reach(self, seed: int, loss: float) -> Reach:
        """Return which robots receive the message of each sample, if a message is lost with probability ``loss``.

        The result is the same for all strategies, so it is cached by seed and loss. It is the empty ``NO_REACH`` if
        nothing is lost, if there are more than MAX_ROBOTS robots, or if a run has so many messages that their number
        does not fit into a lane.
        """
        if loss <= 0.0 or self.robots > MAX_ROBOTS or self.longest >= 1 << LANE_BITS:
            return NO_REACH
        if (seed, loss) not in self._reach:
            bounds, runs, robot, sample, _, heard, at_end = self.rows
            reached = compute_reach(seed, runs, bounds, robot, sample, heard, at_end, loss)
            self._reach[seed, loss] = Reach(*reached)
        return self._reach[seed, loss]


def needs_moves(scenario: Scenario) -> bool:
    """Return whether a scenario's network or localisation reads the table of moves."""
    return network(scenario.network.name).reads_positions or is_estimated(scenario)


def timeline_of(scenario: Scenario, motion: Motion | Timeline) -> Timeline:
    """Return the timeline of a motion.

    Samples must be sorted by run, time and robot, and ends by run and robot; each run of the samples must have ends.
    This is not checked.

    Args:
        motion: the tables of a motion; or its timeline, which is returned unchanged.
    Raises:
        ValueError: the number of rows of the table of ends is not a multiple of the number of robots, or a sample's
            robot does not exist.
    """
    if isinstance(motion, Timeline):
        return motion
    tick_ms, robots = scenario.run.control_period_ms, scenario.swarm.robots
    samples, ends = motion.samples, motion.ends
    if ends.height % robots:
        raise ValueError(f"the table of ends has {ends.height} rows, not {robots} (robots) for each run")
    highest = int(samples["robot"].to_numpy().max(initial=0))
    if highest >= robots:
        raise ValueError(f"samples name robot {highest}; there are {robots} robots, numbered from 0")
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
    of_rows = (
        bounds,
        runs.astype(np.int64),
        column["robot"],
        column["sample"],
        column["time_s"],
        heard,
        at_end,
    )
    return Timeline(
        samples=pl.DataFrame([samples[name] for name in ("run", "robot", "sample")]),
        ends=ends,
        rows=Rows(*(read_only(array) for array in of_rows)),
        robots=robots,
        tick_ms=tick_ms,
        stop_start_s=column["stop_start_s"],
        x_m=column["x_m"],
        y_m=column["y_m"],
        heading_rad=column["heading_rad"],
        moves=motion.moves,
    )


@inner
def tick_of(time_s: float, tick_ms: int) -> int:
    """Return the tick nearest to ``time_s``: tables hold times of ticks, up to rounding."""
    return int(np.rint(time_s * (1000.0 / tick_ms)))


def last_read_ticks(ends: pl.DataFrame, tick_ms: int) -> NDArray[np.int64]:
    """Return, for each robot, the tick up to which it has read all messages when its run ends, (runs * robots,).

    A robot reads until the tick at which it last walked: the tick before the end or, if it stands at the end, the tick
    before its stop began. A message is read one tick after it is sent, at the earliest. So the robot has read all
    messages sent up to 2 ticks before the end or its stop.
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
    """Return the arrays ``Rows.heard`` and ``Rows.heard_at_end``: which messages each robot has heard.

    Messages are heard in the order of their rows, so a robot has always passed the first n messages of its run: it has
    heard those of other robots, and skipped its own. A row of the result has three columns: HEARD_ROWS, the number n;
    LAST_OWN, the row of the last of these n messages that is the robot's own, counted from the run's first row, -1 if
    none is; OTHERS, the number of these n messages that are not its own. ``heard`` has a row for each sample, at the
    time of the sample; ``heard_at_end`` has a row for each robot of each run (index: run * robots + robot), at the end
    of the run.

    Args:
        bounds: (runs + 1,): run r has the rows from ``bounds[r]`` to ``bounds[r + 1]``.
        robot, time_s, stop_start_s: (rows,), columns of the motion table.
        until_at_end: (runs * robots,): tick up to which each robot has read all messages when its run ends.
    """
    robots = until_at_end.size // max(bounds.size - 1, 1)  # max: there may be no runs
    heard = np.empty((robot.size, 3), dtype=np.int32)
    at_end = np.empty((until_at_end.size, 3), dtype=np.int32)
    tick = np.empty(robot.size, dtype=np.int64)
    # ``write_heard`` needs the next three arrays to find a robot's last own message among those that it has passed, and
    # to count its own messages. Their rows are counted from the run's first row; -1: none.
    previous = np.empty(robot.size, dtype=np.int32)  # for each row, the previous row of the same robot
    latest = np.empty(robots, dtype=np.int32)  # for each robot, its latest row so far
    own = np.empty(robots, dtype=np.int32)  # for each robot, the number of its rows so far
    for r in range(bounds.size - 1):
        low, high = bounds[r], bounds[r + 1]
        latest[:] = -1
        own[:] = 0
        for k in range(low, high):
            i = signed(robot[k])
            tick[k], previous[k] = tick_of(time_s[k], tick_ms), latest[i]
            # The robot last walked one tick before its stop. At that tick it read what was sent up to a tick earlier.
            until = tick_of(stop_start_s[k], tick_ms) - 2
            write_heard(heard[k], heard, previous, tick, low, k, until, latest[i], own[i])
            latest[i] = k - low
            own[i] += 1
        for i in range(robots):
            e = r * robots + i  # row of robot i at the end of run r
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
    """Write a row of ``Rows.heard``: which of the run's messages before row ``k`` a robot has passed.

    A robot has passed all messages sent up to the tick ``until``: it has heard those of other robots, and skipped its
    own. They are the first n messages of the run, because rows are in the order of time. The row that is written has
    three columns: HEARD_ROWS, the number n; LAST_OWN, the row of the robot's last own message among these n, counted
    from the run's first row, -1 if there is none; OTHERS, the number of these n messages that are not its own.

    Args:
        row: (3,), written.
        heard: rows of ``Rows.heard``; those of the run before row ``k`` are already written.
        previous: for each row, the previous row of the same robot, counted from the run's first row; -1: none.
        tick: for each row, the tick of the sample, at which its message is sent.
        low: first row of the run.
        k: row of the sample; at the end of a run, the row after the run's last one.
        until: tick up to which the robot has read all messages.
        last_own: row of the robot's last sample before row ``k``, counted from the run's first row; -1: none.
        own: number of the robot's samples before row ``k``.
    """
    # The number n: begin with all messages before row k, and leave out those sent after ``until``.
    rows = k - low
    while rows > 0 and tick[low + rows - 1] > until:
        rows -= 1
    if last_own >= 0:
        # Messages that the robot had passed at its last sample stay passed. ``until`` is earlier than at that sample
        # only if this stop begins before the stop of that sample, as a user's motion source may give it.
        rows = max(rows, heard[low + last_own, HEARD_ROWS])
    # The robot's latest own messages may have been sent after ``until``: go back to the last one among the first n.
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
    """Return the three arrays of ``Reach``: which robots receive each message, and how many each robot has received.

    Args:
        runs, bounds, robot, sample, heard, heard_at_end: the fields of ``Timeline``. loss: probability that a message
            is lost.
    """
    robots = heard_at_end.shape[0] // max(runs.size, 1)  # max: there may be no runs
    words = np.zeros((robot.size, (robots + LANES - 1) // LANES), dtype=np.uint64)
    others = np.empty(robot.size, dtype=np.int32)
    at_end = np.empty(heard_at_end.shape[0], dtype=np.int32)
    numbers = np.empty(robot.size, dtype=np.float64)
    # For each row of a run, from its first: the number of earlier messages that reach each robot, in lanes.
    reached = np.zeros((robot.size + 1, words.shape[1]), dtype=np.uint64)
    for r in range(runs.size):
        low, high = bounds[r], bounds[r + 1]
        for i in range(robots):
            mark_receivers(
                words[low:high], numbers, i, seed, runs[r], robot[low:high], sample[low:high], loss
            )
        for k in range(unsigned(low), unsigned(high)):  # unsigned indices are faster
            # What reached the robot among the messages that it has passed; these are before row k, so counted already.
            others[k] = in_lane(reached[unsigned(heard[k, HEARD_ROWS])], signed(robot[k]))
            place = k - unsigned(low)
            for w in range(unsigned(words.shape[1])):
                reached[place + unsigned(1), w] = reached[place, w] + words[k, w]
        for i in range(robots):
            e = r * robots + i
            at_end[e] = in_lane(reached[unsigned(heard_at_end[e, HEARD_ROWS])], i)
    return words, others, at_end


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
    """Set the lane of robot ``i`` to 1 in the words of all messages that reach it; its own messages do not reach it.

    Args:
        words: (rows, words): ``Reach.words`` of one run, changed. robot, sample: (rows,): sender and index of each
            message of the run. numbers: scratch, at least (rows,). loss: probability that a message is lost.
    """
    for k in range(unsigned(robot.size)):  # a separate loop, which compilers vectorise
        numbers[k] = loss_uniform(seed, run, i, signed(robot[k]), signed(sample[k]))
    word, bit = np.uint64(i // LANES), np.uint64(1) << np.uint64(i % LANES * LANE_BITS)
    for k in range(unsigned(robot.size)):
        reached = (robot[k] != i) & (numbers[k] >= loss)
        words[k, word] |= bit if reached else np.uint64(0)


@inner
def in_lane(words: NDArray[np.uint64], i: int) -> int:
    """Return the count of robot ``i`` from its lane of the packed counts ``words``, (words,)."""
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
    """Return the first random number of ``on_sample`` (``u(d, 0)``) at each sample, (rows,).

    The numbers are computed in advance, once for all strategies that are replayed. Their addresses are those of
    ``agents.sample_draws`` with k = 0.

    Args:
        runs, bounds, robot, sample: as in ``Timeline``.
    """
    out = np.empty(robot.size, dtype=np.float64)
    for r in range(runs.size):
        for k in range(bounds[r], bounds[r + 1]):
            out[k] = uniform(seed, runs[r], signed(robot[k]), MESSAGE, signed(sample[k]), ALONE)
    return out
