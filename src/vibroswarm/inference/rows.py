"""The samples of some runs as the kernels of replay read them, and what they write."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import zero_rows

DONE: Final = 0
DOES_NOT_SEND: Final = 1
"""A strategy that counts (``on_counts``) did not send at a sample."""
NO_ROOM: Final = 2
"""More messages were sent than there is room for."""
NO_KIND: Final = 3
"""A decision is none of -1, 0, 1."""
AGREED_SINCE: Final = 0
SETTLED: Final = 1
"""Places in ``Mail.agreement``."""
WHY: Final = {
    DOES_NOT_SEND: "on_sample did not send; a strategy that counts messages (on_counts) sends at every sample: "
    "give it on_message in place of on_counts",
    NO_KIND: "a decision is none of -1 (undecided), 0 and 1",
}


class Rows(NamedTuple):
    """The rows of a motion table, run by run, in the order of time; see ``Timeline``."""

    bounds: NDArray[np.int64]
    """(runs + 1,): the rows of run r are those from ``bounds[r]`` to ``bounds[r + 1]``."""
    runs: NDArray[np.int64]
    robot: NDArray[np.uint16]
    sample: NDArray[np.uint32]
    time_s: NDArray[np.float64]
    heard: NDArray[np.int32]
    """(rows, 3)."""
    heard_at_end: NDArray[np.int32]
    """(runs * robots, 3)."""


class Readings(NamedTuple):
    """What a strategy is told of each row, (rows,) each; of no rows where it is not told."""

    observation: NDArray[np.uint8]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    numbers: NDArray[np.float64]
    """The uniform number 0 of each sample."""


class Stops(NamedTuple):
    """When robots stand, and so neither hear nor send, in ticks."""

    tick: NDArray[np.int64]
    """(rows,): of the sample, at the end of its stop."""
    stop_tick: NDArray[np.int64]
    """(rows,): the first at which it stands."""
    following: NDArray[np.int32]
    """(rows,): the robot's next row, from the run's first; -1: none, or not known yet."""
    first: NDArray[np.int32]
    """(runs * robots,): the robot's first row, likewise."""
    walked_tick: NDArray[np.int64]
    """(runs * robots,): the last at which it walks, as far as motion is known."""
    known_tick: NDArray[np.int64]
    """(runs,): up to here, this one not included, motion is known."""


class Mail(NamedTuple):
    """What has been sent in the run under way, in the order of tick and sender; (room,) each but where it is said."""

    messages: NDArray[np.void]
    sender: NDArray[np.int64]
    tick: NDArray[np.int64]
    number: NDArray[np.int64]
    """Of the sender's messages, from 0."""
    arrival: NDArray[np.int64]
    """(room, robots): the tick from which on it can be read; -1: never, or it was read. Of no rows where all are there
    at the next tick, or never."""
    filled: NDArray[np.int64]
    """(1,): how many there are."""
    agreement: NDArray[np.int64]
    """(2,): since which tick all opinions agree (-1: they do not), and whether for long enough."""
    empty: NDArray[np.void]
    """(1,): a message of zeros."""
    blank: NDArray[np.void]
    """(1,): a robot's state of zeros."""
    silent: NDArray[np.void]
    """(1,): a network's state of zeros."""
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    """(robots,): where robots are as one sends; of no rows where the network does not ask."""


class Log(NamedTuple):
    """What robots believed and had decided after each row, (rows,) each; of no rows where nobody asks."""

    states: NDArray[np.void]
    received: NDArray[np.uint32]
    belief: NDArray[np.float64]
    decision: NDArray[np.int8]
    sends: NDArray[np.uint8]


def empty_log(rows: int, state_type: np.dtype[np.void]) -> Log:
    """Room for so many rows."""
    return Log(
        zero_rows(rows, state_type),
        np.empty(rows, dtype=np.uint32),
        np.empty(rows),
        np.empty(rows, dtype=np.int8),
        np.ones(rows, dtype=np.uint8),
    )


class Counts(NamedTuple):
    """What has been sent so far in a run, kept from call to call."""

    ones_sent: NDArray[np.int32]
    """(rows of the longest run + 1,): ones among the run's messages before each row."""
    own_ones: NDArray[np.int32]
    """(rows of the longest run,): ones among the sender's messages up to each row."""
    ones_reached: NDArray[np.uint64]
    """(rows of the longest run + 1, words): the same as ``ones_sent`` for each robot that messages reach, in lanes."""


class Marks(NamedTuple):
    """What has been heard of a recorded run; all zeros before it begins."""

    heard: NDArray[np.uint8]
    """(robots, rows): 1 where a robot has heard the message of that row."""
    before: NDArray[np.int64]
    """(robots,): from this row on messages may be left over."""
    since: NDArray[np.int64]
    """(robots,): from this row on they are new."""


class Session(NamedTuple):
    """One run's samples in the order of time, (rows,) each."""

    robot: NDArray[np.int64]
    sample: NDArray[np.int64]
    time_s: NDArray[np.float64]
    hears_until_s: NDArray[np.float64]
    """What was sent before this has arrived when the sample is taken."""
    received: NDArray[np.int64]
    """Messages received since the robot's row before."""
    observation: NDArray[np.uint8]
