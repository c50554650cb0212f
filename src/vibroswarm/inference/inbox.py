"""Messages under way to each robot: linked lists in the order in which they will be read.

Only messages that arrive take memory, so that a swarm of a thousand robots of which each hears a few costs no more
than what these hear. Entries of a robot are sorted by arrival tick, and by the order of sending where that is equal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined


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
    """Return a capacity to start with: each robot may have one unread message of each other, up to 16 MiB."""
    return min(robots * robots, 2**19) + 64


@inlined
def clear_inbox(inbox: Inbox) -> None:
    """Drop all messages."""
    inbox.first[:], inbox.last[:] = -1, -1
    inbox.free[0], inbox.free[1] = -1, 0


@inlined
def put_message(inbox: Inbox, robot: int, message: int, arrival_tick: int) -> bool:
    """Add a message, sent after all others; return False if there is no room."""
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
