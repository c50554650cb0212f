"""Who wakes next: a key for each robot, in blocks of 16 with a bound for each block.

A key is the tick at which the robot wakes, times 2^16, plus its number: the least key says when and who at
once, and who wakes at the same tick follows in index order. ``wakes`` has a row a block, shape (blocks, 17): a
key below which there is none in the block, then those of its robots; NEVER where there is none.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner

NEVER: Final = 2**62
KEY_BITS: Final = 16
ROBOT_BITS: Final = 2**KEY_BITS - 1
"""Robots are numbered with 16 bits, as in the tables."""
NOBODY: Final[int] = np.int64(-1)  # type: ignore[assignment]
"""A key below all others; as a number: for a Python literal Numba would compile its callee anew."""


def all_wake(robots: int, tick: int) -> NDArray[np.int64]:
    """Return a queue in which every robot wakes at ``tick``.

    A row holds 16 robots: its earliest key, then the key of each, NEVER where there is no robot.
    """
    wakes = np.full(((robots + 15) // 16, 17), NEVER, dtype=np.int64)
    for i in range(robots):
        wakes[i >> 4, (i & 15) + 1] = (tick << KEY_BITS) + i
    wakes[:, 0] = wakes[:, 1]  # keys rise with the robot: the first of a row is its earliest
    return wakes


@inlined
def set_wake(wakes: NDArray[np.int64], i: int, tick: int) -> None:
    """Set the tick at which robot ``i`` wakes."""
    block = wakes[i >> 4]
    key = (tick << KEY_BITS) + i
    block[(i & 15) + 1] = key
    block[0] = min(block[0], key)


@inlined
def wake_by(wakes: NDArray[np.int64], i: int, tick: int) -> None:
    """Wake robot ``i`` at ``tick`` or earlier."""
    if (tick << KEY_BITS) + i < wakes[i >> 4, (i & 15) + 1]:
        set_wake(wakes, i, tick)


@inner
def next_two_wakes(wakes: NDArray[np.int64], robots: int) -> tuple[int, int]:
    """Return the smallest key and the second smallest, each NEVER if there is none.

    With more than one block, the second would need another search: the smallest is returned twice instead.
    """
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
    """Return the smallest key above ``beyond``, NEVER if there is none.

    ``beyond`` is the key of the last robot that woke: robots that wake at the same tick keep their keys until all of
    them have woken. The first entry of a block is a lower bound on its keys, and may be outdated. It is exact if its
    robot still has this key; otherwise it is recomputed, but only when it is the smallest of all."""
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
    """Return the smallest key above ``beyond`` among the first ``robots`` of a block, NEVER if there is none."""
    earliest = NEVER
    for m in range(robots):
        key = wakes[block, m + 1]
        if key > beyond:
            earliest = min(earliest, key)
    return int(earliest)
