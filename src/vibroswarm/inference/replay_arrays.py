"""Arrays that the replay kernels read and write: samples, stops, logs, and messages under way to each robot.

Messages under way are in doubly linked lists, one per robot, which share the arrays of an ``Inbox``. Each entry is one
message to one receiver. A robot's entries are sorted by arrival tick and, for equal arrival ticks, in the order of
sending, so that they are in the order in which they will be read. Only messages that arrive take memory, so that large
swarms in which each robot hears only a few others need little of it.

"Rows" are rows of a motion table, that is, samples. A number of a row "from the run's first" counts from 0 in each run.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, read_only, signed, zero_rows
from vibroswarm.strategies.world import Reading

DONE: Final = 0
"""Status code: all is replayed."""
BUFFER_FULL: Final = 2
"""Status code: a buffer of messages is full; the call must be repeated with a larger one."""
INVALID_DECISION: Final = 3
"""Error code: a decision is not -1, 0 or 1."""
INVALID_MESSAGE: Final = 4
"""Error code: the ``bit`` of a message is not 0 or 1."""
AGREED_SINCE: Final = 0
"""Index in ``MessageBuffer.agreement`` of the tick since which all opinions agree; -1: they do not."""
SETTLED: Final = 1
"""Index in ``MessageBuffer.agreement`` of whether the opinions became decisions (1) or not (0)."""
ERROR_TEXT: Final = {
    INVALID_DECISION: "a decision is none of -1 (undecided), 0, 1 (or a further kind of tile)",
    INVALID_MESSAGE: "the bit of a message is neither 0 nor 1",
}
"""Messages of the error codes."""


@inlined
def is_decision(new: float, kinds: int) -> bool:
    """Return whether what a strategy's ``decision`` returned is -1 (undecided) or a kind of tile."""
    return -1 <= new < kinds and new % 1 == 0


class Rows(NamedTuple):
    """Rows of a motion table, run by run, in order of time; see ``deliveries.Timeline``."""

    bounds: NDArray[np.int64]
    """(runs + 1,): run r has the rows from ``bounds[r]`` to ``bounds[r + 1]``."""
    runs: NDArray[np.int64]
    """(runs,): run numbers."""
    robot: NDArray[np.uint16]
    """(rows,): robot of the sample."""
    sample: NDArray[np.uint32]
    """(rows,): index of the sample among the robot's samples."""
    time_s: NDArray[np.float64]
    """(rows,): time of the sample."""


class Readings(NamedTuple):
    """Input of a strategy at each row, (rows,) each; a field is empty if it is not available or not needed."""

    observation: NDArray[np.uint8]
    """Class that the robot read."""
    x_m: NDArray[np.float64]
    """True place, x."""
    y_m: NDArray[np.float64]
    """True place, y."""
    heading_rad: NDArray[np.float64]
    """True heading."""
    uniforms: NDArray[np.float64]
    """First uniform number of each call of ``on_sample``."""
    estimates: NDArray[np.float64]
    """(rows, 9): places as robots estimate them (``robot.pose_mixture.ESTIMATE``); no rows if robots know their true
    places."""
    weighed: NDArray[np.float64]
    """(rows, 2): value of each sample, and its log likelihood ratio (``observation.energy_model``); no rows if the
    strategy reads none."""


NO_ESTIMATES: Final = read_only(np.empty((0, 9)))
"""``Readings.estimates`` of robots that know their true places."""


@inlined
def own_reading(readings: Readings, k: int, time_s: float, number: int) -> Reading:
    """Return the reading of the sample in row ``k`` as a strategy gets it."""
    # A ``Reading`` has, after class, time and number: place, heading and spread now; then number, place and spreads of
    # the lagged sample. The columns of the estimates are in this order.
    reading, estimates, weighed = signed(readings.observation[k]), readings.estimates, readings.weighed
    value = weighed[k, 0] if weighed.shape[0] > 0 else np.nan
    log_ratio = weighed[k, 1] if weighed.shape[0] > 0 else np.nan
    if estimates.shape[0] > 0:
        return Reading(
            reading, time_s, number, estimates[k, 0], estimates[k, 1], estimates[k, 2], estimates[k, 3],
            int(estimates[k, 4]), estimates[k, 5], estimates[k, 6], estimates[k, 7], estimates[k, 8], log_ratio, value,
        )  # fmt: skip
    x_m = readings.x_m[k] if readings.x_m.size > 0 else np.nan
    y_m = readings.y_m[k] if readings.y_m.size > 0 else np.nan
    heading_rad = readings.heading_rad[k] if readings.heading_rad.size > 0 else np.nan
    # A robot that knows its place knows it without error, so the "lagged" sample is this one, with spreads 0.
    return Reading(
        reading, time_s, number, x_m, y_m, heading_rad, 0.0, number, x_m, y_m, 0.0, 0.0, log_ratio, value
    )


class Stops(NamedTuple):
    """When robots stand, and so neither hear nor send, in ticks."""

    tick: NDArray[np.int64]
    """(rows,): tick of the sample, at the end of its stop."""
    stop_tick: NDArray[np.int64]
    """(rows,): first tick of the stop."""
    following: NDArray[np.int32]
    """(rows,): next row of the same robot, from the run's first; -1: none, or not known yet."""
    first: NDArray[np.int32]
    """(runs * robots,): first row of each robot, from the run's first; -1: none, or not known yet."""
    walked_tick: NDArray[np.int64]
    """(runs * robots,): last tick at which the robot is known to walk."""
    known_tick: NDArray[np.int64]
    """(runs,): motion is known up to this tick, exclusive."""


class MessageBuffer(NamedTuple):
    """Messages sent in the current run, in the order of tick and sender; (capacity,) each unless stated."""

    messages: NDArray[np.void]
    """Rows of the strategy's ``Message``."""
    sender: NDArray[np.int64]
    """Robot that sent the message."""
    tick: NDArray[np.int64]
    """Tick at which it was sent."""
    number: NDArray[np.int64]
    """Index of the message among its sender's messages."""
    arrival: Any
    """(robots,): tick from which each robot can read the message that was sent last; -1: never. 0 for networks
    without ``send``, whose messages arrive at the next tick or not at all."""
    inbox: Any
    """``Inbox`` of the messages under way; 0 for networks without ``send``."""
    filled: NDArray[np.int64]
    """(1,): number of messages."""
    ones: NDArray[np.int64]
    """(capacity + 1,): number of ones among the messages before each; filled only if bits are counted."""
    arrivals: NDArray[np.int64]
    """(capacity, robots): tick from which each robot can read each message, -1: never; (0, 0) if not requested."""
    agreement: NDArray[np.int64]
    """(2,): tick since which all opinions agree (-1: they do not); 1 if they have agreed for long enough, else 0."""
    zero_message: NDArray[np.void]
    """(1,): a zeroed message."""
    zero_state: NDArray[np.void]
    """(1,): a zeroed robot state."""
    zero_network_state: NDArray[np.void]
    """(1,): a zeroed network state."""
    x_m: Any
    """(robots,): x of each robot when a message is sent; empty if ``send`` does not read positions; 0 without it."""
    y_m: Any
    """(robots,): y of each robot, as ``x_m``."""


class Log(NamedTuple):
    """State of the robot after each of its samples, (rows,) each; empty if not requested."""

    states: NDArray[np.void]
    """Rows of the strategy's ``State``."""
    received: NDArray[np.uint32]
    """Number of messages that the robot has received."""
    belief: NDArray[np.float64]
    """Belief that the share of ones is below the boundary; nan if the strategy has none."""
    decision: NDArray[np.int8]
    """-1: undecided. If the strategy decides by opinions, this is the robot's opinion, also before it is a decision."""
    sends: NDArray[np.uint8]
    """1 if the robot sends a message at this sample, else 0."""


def empty_log(rows: int, state_type: np.dtype[np.void]) -> Log:
    """Allocate a log for ``rows`` samples."""
    return Log(
        states=zero_rows(rows, state_type),
        received=np.empty(rows, dtype=np.uint32),
        belief=np.empty(rows),
        decision=np.empty(rows, dtype=np.int8),
        sends=np.ones(rows, dtype=np.uint8),
    )


class Inbox(NamedTuple):
    """Lists of all robots, doubly linked; -1 ends a list."""

    first: NDArray[np.int64]
    """(robots,): first entry of each robot's list; -1: the list is empty."""
    last: NDArray[np.int64]
    """(robots,): last entry of each robot's list; -1: the list is empty."""
    before: NDArray[np.int64]
    """(capacity,): the entry before this one; -1: none."""
    after: NDArray[np.int64]
    """(capacity,): the entry after this one; -1: none. It also links the entries that are free again."""
    message: NDArray[np.int64]
    """(capacity,): index of the message."""
    arrival_tick: NDArray[np.int64]
    """(capacity,): tick from which it can be read."""
    free: NDArray[np.int64]
    """(2,): first entry in the list of entries that are free again (-1: none), and number of entries used so far;
    entries from that number on have never been used."""


def empty_inbox(robots: int, capacity: int) -> Inbox:
    """Return an empty inbox for ``robots`` robots, with room for ``capacity`` entries, each a message to one robot."""
    before, after, message, arrival_tick = (np.empty(capacity, dtype=np.int64) for _ in range(4))
    first, last = (np.full(robots, -1, dtype=np.int64) for _ in range(2))
    free = np.array([-1, 0])  # no entry is free again, and none has been used
    return Inbox(first, last, before, after, message, arrival_tick, free)


@inlined
def clear_inbox(inbox: Inbox) -> None:
    """Remove all messages of all robots."""
    inbox.first[:], inbox.last[:] = -1, -1
    inbox.free[0], inbox.free[1] = -1, 0  # no entry is free again, and none has been used


@inlined
def put_message(inbox: Inbox, robot: int, message: int, arrival_tick: int) -> bool:
    """Insert a message into a robot's list, which is sorted by arrival tick; return whether there was room for it."""
    # Take an entry that is free again or, if there is none, one that was never used.
    entry = inbox.free[0]
    if entry >= 0:
        inbox.free[0] = inbox.after[entry]
    else:
        entry = inbox.free[1]
        if entry >= inbox.message.size:
            return False
        inbox.free[1] = entry + 1
    inbox.message[entry], inbox.arrival_tick[entry] = message, arrival_tick
    # Find the entries before and after it. The search begins at the end of the list, as most messages arrive last.
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
    """Remove the first message from a robot's list, which must not be empty, and free its entry."""
    entry = inbox.first[robot]
    after = inbox.after[entry]
    inbox.first[robot] = after
    if after >= 0:
        inbox.before[after] = -1
    else:
        inbox.last[robot] = -1
    inbox.after[entry] = inbox.free[0]
    inbox.free[0] = entry
