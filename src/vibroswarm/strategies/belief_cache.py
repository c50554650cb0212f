"""Cached beliefs: a table of ``belief_below``, shared by all runs and threads.

A belief depends only on the counts and the boundary, so it does not matter who computed it first, nor whether two
threads write the same number at once. Rows are distances of alpha from the boundary, columns are counts n = alpha
+ beta: a robot's counts grow one by one while the distance hardly changes, and so do the table entries that it
reads. Beyond ``SURE`` no table is needed; beyond ``MAX_COUNTS`` beliefs are computed each time.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel, unsigned
from vibroswarm.robot.belief import SURE, belief_below

MIN_COUNTS: Final = 1024
MAX_COUNTS: Final = 8192
"""Columns of a table: 2 to 55 MB if all of it were read; memory is allocated only where it is."""
ASIDE: Final = 24
"""Extra columns, so that neighbouring rows do not compete for the same lines of the processor's cache."""


class Beliefs(NamedTuple):
    """``values``: (distances, counts), 0 where not yet computed."""

    values: NDArray[np.float64]
    boundary: float


def beliefs(boundary: float, counts: int) -> Beliefs:
    """Return the table for posteriors with alpha + beta up to ``counts``, or up to the largest table."""
    room = MIN_COUNTS
    while room <= counts and room < MAX_COUNTS:
        room *= 2
    return _beliefs(boundary, room)


@lru_cache(maxsize=8)
def _beliefs(boundary: float, room: int) -> Beliefs:
    furthest = math.ceil(math.sqrt(SURE * room)) + 2
    return Beliefs(np.zeros((2 * furthest + 1, room + ASIDE)), boundary)


@kernel
def belief_of(beliefs: Beliefs, alpha: int, beta: int) -> float:
    """Return ``belief_below``, computed once for each posterior."""
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
