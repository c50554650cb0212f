"""Which messages the robots of a recording heard: logs count received messages, but do not say which ones.

A robot's log has the number n of messages that it received between two samples. A replay draws which messages these
are: n of the messages that other robots sent since its previous sample, chosen at random. Times in a log are a little
late, so n may be larger than the number of messages sent in that time. The rest is then drawn from messages that the
robot has not heard: those of the interval before, those sent up to ``slack_s`` later, and at last all older ones.

The network ``RECORDED`` delivers what was drawn. Its ticks are of no clock: the sample in row k is at tick 3 k + 3.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel
from vibroswarm.core.rng import LOSS, uniform
from vibroswarm.networks.base import Network
from vibroswarm.strategies.world import Draws, World


class Session(NamedTuple):
    """Samples of one recorded run, in order of time, (rows,) each."""

    robot: NDArray[np.int64]
    """Robot of the sample."""
    sample: NDArray[np.int64]
    """Index of the sample among the robot's samples."""
    time_s: NDArray[np.float64]
    """Time of the sample."""
    hears_until_s: NDArray[np.float64]
    """Messages sent before this time have arrived when the sample is taken."""
    received: NDArray[np.int64]
    """Number of messages received since the robot's previous row, by its log."""
    observation: NDArray[np.uint8]
    """Class that the robot read."""


class Heard:
    """What was heard."""

    read_at: tuple[int, ...] = ()
    """(rows * robots,): row of the sample before which each robot reads the message of each row; -1: never."""


def send(
    n: Any, a: Any, sender: int, tick: int, number: int, bytes_on_air: int, x_m: Any, y_m: Any, arrival_tick: Any,
    d: Draws, p: Any, w: World,
) -> None:  # fmt: skip
    """Deliver a message to those who heard it, at the last moment before their samples."""
    for j in range(w.robots):
        row = a.read_at[(tick // 3 - 1) * w.robots + j]
        if row >= 0:
            arrival_tick[j] = 3 * row + 1


RECORDED: Final = Network(
    "recorded", params=Heard, send=send, positions=False, about="what was drawn of a recording"
)


@inner
def choose(
    session: Session, read_at: NDArray[np.int64], i: int, k: int, first: int, last: int, wanted: int, seed: int,
    run: int,
) -> int:  # fmt: skip
    """Choose ``wanted`` of the messages in rows [first, last) at random, as heard by robot ``i`` before row ``k``.

    Messages of robot ``i`` itself, and those that it has heard, are not chosen. All subsets of this size are equally
    probable. Returns: number of messages chosen, which is less if fewer remain.
    """
    remaining = 0  # number of messages that may be chosen, from row m on
    for m in range(first, last):
        remaining += session.robot[m] != i and read_at[m, i] < 0
    left = chosen = min(wanted, remaining)
    for m in range(first, last):
        if left == 0:
            break
        if session.robot[m] == i or read_at[m, i] >= 0:
            continue
        # With ``left`` messages still to choose among ``remaining``, each is chosen with probability left / remaining.
        if uniform(seed, run, i, LOSS, session.sample[k], m) * remaining < left:
            read_at[m, i] = k
            left -= 1
        remaining -= 1
    return chosen


@kernel
def draw_heard(
    session: Session,
    read_at: NDArray[np.int64],
    since: NDArray[np.int64],
    slack_s: float,
    seed: int,
    run: int,
) -> int:
    """Draw which messages each robot heard; return the number of received messages that nobody can have sent.

    Args:
        read_at: (rows, robots): -1 everywhere; written. since: (robots, 2): zeros; first row of the messages that were
            new at a robot's previous sample, and of those that are new at its next one.
    """
    unsent = 0
    for k in range(session.robot.size):
        i = session.robot[k]
        leftover, new = since[i, 0], since[i, 1]
        until = new
        while until < k and session.time_s[until] < session.hears_until_s[k]:
            until += 1
        later = until
        while later < k and session.time_s[later] < session.hears_until_s[k] + slack_s:
            later += 1
        left = session.received[k]
        for first, last in ((new, until), (leftover, new), (until, later), (0, leftover)):
            if left > 0:
                left -= choose(session, read_at, i, k, first, last, left, seed, run)
        unsent += left
        since[i, 0], since[i, 1] = new, until
    return unsent
