"""Who wakes next: a tournament of ticks, one leaf a robot; the root holds the earliest.

``tree`` has 2 P entries for the P leaves (a power of two); entry 1 is the root, the children of entry n
are 2 n and 2 n + 1, robot i's leaf is P + i. Unused leaves hold NEVER.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import inlined, kernel

NEVER: Final = 2**62


def empty_tree(robots: int) -> NDArray[np.int64]:
    """A tournament in which nobody wakes."""
    leaves = 1 << max(robots - 1, 0).bit_length()
    return np.full(2 * leaves, NEVER, dtype=np.int64)


@kernel
def set_wake(tree: NDArray[np.int64], i: int, tick: int) -> None:
    """Robot ``i`` is to wake at ``tick``."""
    node = (tree.size >> 1) + i
    tree[node] = tick
    while node > 1:
        node >>= 1
        earliest = min(tree[2 * node], tree[2 * node + 1])
        if tree[node] == earliest:
            return
        tree[node] = earliest


@inlined
def wake_by(tree: NDArray[np.int64], i: int, tick: int) -> None:
    """Robot ``i`` is to wake at ``tick`` or before."""
    if tick < tree[(tree.size >> 1) + i]:
        set_wake(tree, i, tick)


@inlined
def awake_at(tree: NDArray[np.int64], tick: int, awake: NDArray[np.int64]) -> int:
    """The robots that wake at ``tick``, in index order, into ``awake``; gives how many.

    ``tick`` is the earliest of all, so that subtrees whose root is later hold none of them.
    """
    leaves = tree.size >> 1
    count, node = 0, 1
    while True:
        if tree[node] == tick and node < leaves:
            node *= 2  # down to the left
            continue
        if tree[node] == tick:
            awake[count] = node - leaves
            count += 1
        while node & 1:  # up from right children
            if node == 1:
                return count
            node >>= 1
        if node == 0:
            return count
        node += 1  # over to the right sibling
