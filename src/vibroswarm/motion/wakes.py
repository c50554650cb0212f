"""Who wakes next: the robots' ticks in blocks of 16, with a bound for each block.

``wakes`` has a row a block, shape (blocks, 17): a tick before which nobody in the block wakes, then the ticks of
its robots; NEVER where there is none.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import inlined, inner

NEVER: Final = 2**62


def nobody_wakes(robots: int) -> NDArray[np.int64]:
    """Robots of whom nobody wakes."""
    return np.full(((robots + 15) // 16, 17), NEVER, dtype=np.int64)


@inlined
def set_wake(wakes: NDArray[np.int64], i: int, tick: int) -> None:
    """Robot ``i`` is to wake at ``tick``."""
    block = wakes[i >> 4]
    block[(i & 15) + 1] = tick
    block[0] = min(block[0], tick)


@inlined
def wake_by(wakes: NDArray[np.int64], i: int, tick: int) -> None:
    """Robot ``i`` is to wake at ``tick`` or before."""
    if tick < wakes[i >> 4, (i & 15) + 1]:
        set_wake(wakes, i, tick)


@inner
def next_wake(wakes: NDArray[np.int64], robots: int) -> int:
    """The tick at which somebody wakes next; the bounds of the blocks are made exact as far as need be."""
    while True:
        first = 0
        for k in range(1, wakes.shape[0]):
            if wakes[k, 0] < wakes[first, 0]:
                first = k
        earliest = NEVER
        for m in range(min(robots - 16 * first, 16)):
            earliest = min(earliest, wakes[first, m + 1])
        if earliest == wakes[first, 0]:
            return int(earliest)
        wakes[first, 0] = earliest
        if wakes.shape[0] == 1:
            return int(earliest)


@inlined
def awake_at(wakes: NDArray[np.int64], tick: int, awake: NDArray[np.int64], robots: int) -> int:
    """The robots that wake at ``tick``, the earliest of all, in index order into ``awake``; gives how many."""
    count = 0
    for k in range(wakes.shape[0]):
        if wakes[k, 0] == tick:
            for i in range(16 * k, min(robots, 16 * k + 16)):
                awake[count] = i
                count += wakes[k, (i & 15) + 1] == tick
    return count
