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
    energy: NDArray[np.float32]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    numbers: NDArray[np.float64]
    """The uniform number 0 of each sample."""


class Log(NamedTuple):
    """What robots believed and had decided after each row, (rows,) each; of no rows where nobody asks."""

    states: NDArray[np.void]
    received: NDArray[np.uint32]
    belief: NDArray[np.float64]
    decision: NDArray[np.int8]


def empty_log(rows: int, state_type: np.dtype[np.void]) -> Log:
    """Room for so many rows."""
    return Log(
        zero_rows(rows, state_type),
        np.empty(rows, dtype=np.uint32),
        np.empty(rows),
        np.empty(rows, dtype=np.int8),
    )


class Counts(NamedTuple):
    """What has been sent so far in a run, kept from call to call."""

    ones_sent: NDArray[np.int32]
    """(rows of the longest run + 1,): ones among the run's messages before each row."""
    own_ones: NDArray[np.int32]
    """(rows of the longest run,): ones among the sender's messages up to each row."""
    ones_reached: NDArray[np.uint64]
    """(rows of the longest run + 1, words): the same as ``ones_sent`` for each robot that messages reach, in lanes."""


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
