"""Arrays that the replay kernels read and write: samples, stops, logs, and messages under way to each robot.

Messages under way are in linked lists, the inboxes, in the order in which they will be read. Only messages that arrive
take memory, so that a swarm of a thousand robots of which each hears a few costs no more than what these hear. Entries
of a robot are sorted by arrival tick, and by the order of sending where that is equal.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, read_only, signed, zero_rows
from vibroswarm.strategies.world import DetailedReading, Reading

DONE: Final = 0
DOES_NOT_SEND: Final = 1
"""A strategy with ``on_counts`` did not send at a sample."""
BUFFER_FULL: Final = 2
"""More messages were sent than the buffer holds."""
INVALID_DECISION: Final = 3
"""A decision is not -1, 0 or 1."""
AGREED_SINCE: Final = 0
SETTLED: Final = 1
"""Indices into ``MessageBuffer.agreement``."""
ERROR_TEXT: Final = {
    DOES_NOT_SEND: "on_sample did not send; a strategy that counts messages (on_counts) sends at every sample: "
    "give it on_message in place of on_counts",
    INVALID_DECISION: "a decision is none of -1 (undecided), 0 and 1",
}


class Rows(NamedTuple):
    """Rows of a motion table, run by run, in order of time; see ``Timeline``."""

    bounds: NDArray[np.int64]
    """(runs + 1,): run r has the rows from ``bounds[r]`` to ``bounds[r + 1]``."""
    runs: NDArray[np.int64]
    robot: NDArray[np.uint16]
    sample: NDArray[np.uint32]
    time_s: NDArray[np.float64]
    heard: NDArray[np.int32]
    """(rows, 3)."""
    heard_at_end: NDArray[np.int32]
    """(runs * robots, 3)."""


class Readings(NamedTuple):
    """Input of a strategy at each row, (rows,) each; empty if not available."""

    observation: NDArray[np.uint8]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    uniforms: NDArray[np.float64]
    """Uniform number 0 of each sample."""
    estimates: NDArray[np.float64]
    """(rows, 9 and more): places as robots estimate them (``robot.pose_mixture.ESTIMATE``), then their draws
    (``robot.place_draws``); of no rows if they know the true ones."""
    log_ratios: NDArray[np.float64]
    """Log likelihood ratio of each sample's energy (``observation.energy_model``)."""


NO_ESTIMATES: Final = read_only(np.empty((0, 9)))


@inlined
def own_reading(readings: Readings, k: int, time_s: float, number: int) -> Reading:
    """Return the reading of row ``k`` as a strategy gets it: with estimated positions if there are estimates, else the
    true ones; nan if there are neither."""
    bit, estimates = signed(readings.observation[k]), readings.estimates
    if estimates.shape[0] > 0:
        return Reading(
            bit, time_s, number, estimates[k, 0], estimates[k, 1], estimates[k, 2], estimates[k, 3],
            int(estimates[k, 4]), estimates[k, 5], estimates[k, 6], estimates[k, 7], estimates[k, 8],
        )  # fmt: skip
    x_m = readings.x_m[k] if readings.x_m.size > 0 else np.nan
    y_m = readings.y_m[k] if readings.y_m.size > 0 else np.nan
    heading_rad = readings.heading_rad[k] if readings.heading_rad.size > 0 else np.nan
    return Reading(bit, time_s, number, x_m, y_m, heading_rad, 0.0, number, x_m, y_m, 0.0, 0.0)


@inlined
def detailed_reading(readings: Readings, k: int, time_s: float, number: int) -> DetailedReading:
    """Return the reading of row ``k`` for a strategy that ``reads_details``: that of ``own_reading``, with the log
    likelihood ratio of its energy (nan if not available) and draws of places (of size 0 if there are none)."""
    x = own_reading(readings, k, time_s, number)
    log_ratio = readings.log_ratios[k] if readings.log_ratios.size > 0 else np.nan
    estimates = readings.estimates
    draws_m = estimates[k][9:] if estimates.shape[0] > 0 else readings.log_ratios[:0]
    return DetailedReading(
        x.reading, time_s, number, x.x_m, x.y_m, x.heading_rad, x.spread_m, x.lagged_number, x.lagged_x_m,
        x.lagged_y_m, x.lagged_spread_x_m, x.lagged_spread_y_m, log_ratio, draws_m,
    )  # fmt: skip


class Stops(NamedTuple):
    """When robots stand, and so neither hear nor send, in ticks."""

    tick: NDArray[np.int64]
    """(rows,): tick of the sample, at the end of its stop."""
    stop_tick: NDArray[np.int64]
    """(rows,): first tick of the stop."""
    following: NDArray[np.int32]
    """(rows,): next row of the same robot, from the run's first; -1: none, or not known yet."""
    first: NDArray[np.int32]
    """(runs * robots,): first row of each robot, likewise."""
    walked_tick: NDArray[np.int64]
    """(runs * robots,): last tick at which the robot is known to walk."""
    known_tick: NDArray[np.int64]
    """(runs,): motion is known up to this tick, exclusive."""


class MessageBuffer(NamedTuple):
    """Messages sent in the current run, in the order of tick and sender; (capacity,) each unless stated."""

    messages: NDArray[np.void]
    sender: NDArray[np.int64]
    tick: NDArray[np.int64]
    number: NDArray[np.int64]
    """Index among the sender's messages."""
    arrival: NDArray[np.int64]
    """(robots,): tick from which each robot can read the last message; -1: never. Empty if messages arrive at the next
    tick or not at all."""
    inbox: Inbox
    """Messages under way; empty if ``arrival`` is."""
    filled: NDArray[np.int64]
    """(1,): number of messages."""
    agreement: NDArray[np.int64]
    """(2,): tick since which all opinions agree (-1: they do not), and whether for long enough."""
    zero_message: NDArray[np.void]
    """(1,): a zeroed message."""
    zero_state: NDArray[np.void]
    """(1,): a zeroed robot state."""
    zero_network_state: NDArray[np.void]
    """(1,): a zeroed network state."""
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    """(robots,): positions when a message is sent; empty if the network does not read them."""


class Log(NamedTuple):
    """Beliefs and decisions after each row, (rows,) each; empty if not requested."""

    states: NDArray[np.void]
    received: NDArray[np.uint32]
    belief: NDArray[np.float64]
    decision: NDArray[np.int8]
    sends: NDArray[np.uint8]


def empty_log(rows: int, state_type: np.dtype[np.void]) -> Log:
    """Return a log for ``rows`` rows; ``sends`` is 1 everywhere, as not all kernels write it."""
    return Log(
        zero_rows(rows, state_type),
        np.empty(rows, dtype=np.uint32),
        np.empty(rows),
        np.empty(rows, dtype=np.int8),
        np.ones(rows, dtype=np.uint8),
    )


class Counts(NamedTuple):
    """Messages sent so far in a run, kept between calls."""

    ones_sent: NDArray[np.int32]
    """(rows of the longest run + 1,): ones among the run's messages before each row."""
    own_ones: NDArray[np.int32]
    """(rows of the longest run,): ones among the sender's messages up to each row."""
    ones_reached: NDArray[np.uint64]
    """(rows of the longest run + 1, words): as ``ones_sent`` for each robot that messages reach, in lanes."""


class Deliveries(NamedTuple):
    """Messages that each robot reads before each of its samples, if all robots send once per sample."""

    which: NDArray[np.int32]
    """Messages, by the row of their sample counted from the run's first."""
    until: NDArray[np.int64]
    """(rows,): end in ``which`` of the messages read before the sample of row k; they begin at the end for row k -
    1."""
    until_at_end: NDArray[np.int64]
    """(runs * robots,): the same for messages read after a robot's last sample; these follow the run's last row."""


NO_DELIVERIES: Final = Deliveries(
    *(read_only(np.empty(0, dtype=kind)) for kind in (np.int32, np.int64, np.int64))
)


class DeliveryScratch(NamedTuple):
    """Scratch memory for computing deliveries."""

    arrival: NDArray[np.int64]
    """(robots,): tick from which each robot can read the last message; -1: never."""
    inbox: Inbox
    """Messages under way."""
    sent: NDArray[np.int64]
    """(robots,): messages sent so far."""
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    """(robots,): positions when a message is sent; empty if the network does not read them."""
    zero_network_state: NDArray[np.void]
    """(1,): a zeroed network state."""
    log: NDArray[np.int64]
    """(rows, robots): written, ``arrival`` of every message; empty if not requested."""


class HeardMessages(NamedTuple):
    """Messages heard so far in a recorded run; all zeros at its start."""

    heard: NDArray[np.uint8]
    """(robots, rows): 1 if the robot has heard the message of that row."""
    leftover_from: NDArray[np.int64]
    """(robots,): first row whose message may be left over."""
    new_from: NDArray[np.int64]
    """(robots,): first row whose message is new."""


class Session(NamedTuple):
    """Samples of one recorded run in order of time, (rows,) each."""

    robot: NDArray[np.int64]
    sample: NDArray[np.int64]
    time_s: NDArray[np.float64]
    hears_until_s: NDArray[np.float64]
    """Messages sent before this have arrived when the sample is taken."""
    received: NDArray[np.int64]
    """Messages received since the robot's previous row."""
    observation: NDArray[np.uint8]


class Inbox(NamedTuple):
    """Lists of all robots, doubly linked; -1 ends a list."""

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    """(robots,): first and last entry of each robot."""
    before: NDArray[np.int64]
    after: NDArray[np.int64]
    """(capacity,): neighbours of an entry; ``after`` also links the entries that are free again."""
    message: NDArray[np.int64]
    """(capacity,): index of the message."""
    arrival_tick: NDArray[np.int64]
    """(capacity,): tick from which it can be read."""
    free: NDArray[np.int64]
    """(2,): first entry that is free again (-1: none), and number of entries ever used."""


def empty_inbox(robots: int, capacity: int) -> Inbox:
    """Return an inbox with room for ``capacity`` messages under way to ``robots`` robots."""
    before, after, message, arrival_tick = (np.empty(capacity, dtype=np.int64) for _ in range(4))
    first, last = (np.full(robots, -1, dtype=np.int64) for _ in range(2))
    return Inbox(first, last, before, after, message, arrival_tick, np.array([-1, 0]))


def start_capacity(robots: int) -> int:
    """Return a capacity to start with: one unread message from each robot to each other, but at most 16 MiB."""
    return min(robots * robots, 2**19) + 64


@inlined
def clear_inbox(inbox: Inbox) -> None:
    """Drop all messages."""
    inbox.first[:], inbox.last[:] = -1, -1
    inbox.free[0], inbox.free[1] = -1, 0


@inlined
def put_message(inbox: Inbox, robot: int, message: int, arrival_tick: int) -> bool:
    """Insert a message into a robot's list by arrival tick; return False if there is no room.

    The message must have been sent after all others, so it goes behind those with the same arrival tick.
    """
    entry = inbox.free[0]
    if entry >= 0:
        inbox.free[0] = inbox.after[entry]
    else:
        entry = inbox.free[1]
        if entry >= inbox.message.size:
            return False
        inbox.free[1] = entry + 1
    inbox.message[entry], inbox.arrival_tick[entry] = message, arrival_tick
    before, after = inbox.last[robot], np.int64(-1)
    while before >= 0 and inbox.arrival_tick[before] > arrival_tick:
        before, after = inbox.before[before], before
    inbox.before[entry], inbox.after[entry] = before, after
    if before >= 0:
        inbox.after[before] = entry
    else:
        inbox.first[robot] = entry
    if after >= 0:
        inbox.before[after] = entry
    else:
        inbox.last[robot] = entry
    return True


@inlined
def take_first(inbox: Inbox, robot: int) -> None:
    """Remove the first message of a robot that has one."""
    entry = inbox.first[robot]
    after = inbox.after[entry]
    inbox.first[robot] = after
    if after >= 0:
        inbox.before[after] = -1
    else:
        inbox.last[robot] = -1
    inbox.after[entry] = inbox.free[0]
    inbox.free[0] = entry
