"""Beliefs that were asked for before: a table of what ``belief_below`` has said, shared by all runs and threads.

A belief depends on nothing but the counts and the boundary, so it does not matter who asked first, nor whether two
threads write the same number at once. Row by row the table holds one distance of alpha from the boundary, column by
column the counts n = alpha + beta: a robot's counts grow one by one while the distance hardly changes, and so do the
places that it reads. Beyond ``SURE`` no table is needed; beyond ``MOST_COUNTS`` the belief is made each time.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import kernel, unsigned
from vibroswarm.robot.believe import SURE, belief_below

LEAST_COUNTS: Final = 1024
MOST_COUNTS: Final = 8192
"""Counts in a table: 2 to 55 MB if all of it were read; memory is taken only where it is."""
ASIDE: Final = 24
"""Columns more, so that neighbouring rows do not compete for the same places of the processor's cache."""


class Beliefs(NamedTuple):
    """``values``: (distances, counts), 0 where nobody has asked yet."""

    values: NDArray[np.float64]
    boundary: float


def beliefs(boundary: float, counts: int) -> Beliefs:
    """The table for posteriors with alpha + beta up to ``counts``, as far as there is one."""
    room = LEAST_COUNTS
    while room <= counts and room < MOST_COUNTS:
        room *= 2
    return _beliefs(boundary, room)


@lru_cache(maxsize=8)
def _beliefs(boundary: float, room: int) -> Beliefs:
    furthest = math.ceil(math.sqrt(SURE * room)) + 2
    return Beliefs(np.zeros((2 * furthest + 1, room + ASIDE)), boundary)


@kernel
def belief_of(beliefs: Beliefs, alpha: int, beta: int) -> float:
    """``belief_below``, asked once for each posterior."""
    values, boundary = beliefs
    counts = alpha + beta
    place = alpha - int(boundary * counts) + values.shape[0] // 2
    if counts >= values.shape[1] or place < 0 or place >= values.shape[0]:
        return belief_below(alpha, beta, boundary)
    row, column = unsigned(place), unsigned(counts)
    known: float = values[row, column]
    if known == 0.0:
        known = belief_below(alpha, beta, boundary)
        values[row, column] = known
    return known
