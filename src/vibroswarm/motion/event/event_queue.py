"""The queue of robots that wake: a key for each robot, in blocks of 16 robots.

A key is the tick at which a robot wakes, times 2^16, plus its number: robots that wake at the same tick follow in the
order of their numbers. ``wakes`` has one row per block, (blocks, 17): a lower bound on its robots' keys, then the
keys; NEVER where there is no robot. While the robots of a tick wake, the bound ignores the keys of those that have
woken, until ``set_wake``.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner

NEVER: Final = 2**62
"""A tick, or a key, beyond all others."""
KEY_BITS: Final = 16
"""Number of bits of a key that hold the robot's number; the bits above hold the tick."""
ROBOT_BITS: Final = 2**KEY_BITS - 1
"""Mask of the robot's number in a key; robots are numbered with 16 bits, as in the tables."""
NOBODY: Final[int] = np.int64(-1)  # type: ignore[assignment]
"""A key below all keys of robots. For a Python literal, Numba would compile the called function once more."""


def all_wake(robots: int, tick: int) -> NDArray[np.int64]:
    """Return a new queue (``wakes``) in which each robot wakes at ``tick``."""
    wakes = np.full(((robots + 15) // 16, 17), NEVER, dtype=np.int64)
    for i in range(robots):
        wakes[i >> 4, (i & 15) + 1] = (tick << KEY_BITS) + i  # block i // 16, entry i % 16 + 1
    wakes[:, 0] = wakes[:, 1]  # at the same tick, the first robot of a block has its smallest key
    return wakes


@inlined
def set_wake(wakes: NDArray[np.int64], i: int, tick: int) -> None:
    """Set the tick at which robot ``i`` wakes, and keep the first entry of its block a lower bound."""
    block = wakes[i >> 4]
    key = (tick << KEY_BITS) + i
    block[(i & 15) + 1] = key
    block[0] = min(block[0], key)


@inlined
def wake_by(wakes: NDArray[np.int64], i: int, tick: int) -> None:
    """Make robot ``i`` wake at ``tick``, unless it wakes earlier already."""
    if (tick << KEY_BITS) + i < wakes[i >> 4, (i & 15) + 1]:
        set_wake(wakes, i, tick)


@inner
def next_two_wakes(wakes: NDArray[np.int64], robots: int) -> tuple[int, int]:
    """Return the smallest and the second smallest key, or NEVER; the smallest twice if there is more than one block."""
    if wakes.shape[0] > 1:
        first = next_wake(wakes, robots, NOBODY)
        return first, first
    first, second = NEVER, NEVER
    for m in range(robots):
        key = wakes[0, m + 1]
        second = min(second, max(first, key))
        first = min(first, key)
    return first, second


@inner
def next_wake(wakes: NDArray[np.int64], robots: int, beyond: int) -> int:
    """Return the smallest key above ``beyond``, the key of the last robot that woke; NEVER if there is none."""
    if wakes.shape[0] == 1:
        return least_of(wakes, 0, robots, beyond)
    while True:
        first = 0
        for k in range(1, wakes.shape[0]):
            if wakes[k, 0] < wakes[first, 0]:
                first = k
        bound, i = int(wakes[first, 0]), int(wakes[first, 0]) & ROBOT_BITS
        if bound >= NEVER or (bound > beyond and wakes[i >> 4, (i & 15) + 1] == bound):
            return bound
        wakes[first, 0] = least_of(wakes, first, min(robots - 16 * first, 16), beyond)


@inlined
def least_of(wakes: NDArray[np.int64], block: int, robots: int, beyond: int) -> int:
    """Return the smallest key above ``beyond`` of the first ``robots`` robots of a block, NEVER if there is none."""
    earliest = NEVER
    for m in range(robots):
        key = wakes[block, m + 1]
        if key > beyond:
            earliest = min(earliest, key)
    return int(earliest)
