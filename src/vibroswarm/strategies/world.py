"""Arguments of a strategy's functions: the world as a robot knows it, a reading, random numbers, and beliefs.

Names are those of the scenario's fields; see ``base`` for the functions.

Beliefs are cached in a table that all runs and threads share. A belief depends only on the counts and the boundary, so
it does not matter who computed it first, nor whether two threads write the same number at once. Rows are distances of
alpha from the boundary, columns are counts n = alpha + beta: a robot's counts grow one by one while the distance hardly
changes, and so do the table entries that it reads. Beyond ``SURE`` no table is needed; beyond ``MAX_COUNTS`` beliefs
are computed each time.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, kernel, unsigned
from vibroswarm.core.rng import uniform
from vibroswarm.robot.belief import SURE
from vibroswarm.robot.belief import belief_below as posterior_below


class World(NamedTuple):
    """What robot ``robot`` knows about its task; lengths in m, times in s."""

    robot: int
    """Its own number, from 0."""
    robots: int
    t_end_s: float
    tick_s: float
    tick_ms: int
    width_m: float
    height_m: float
    rows: int
    """Rows of the grid of tiles."""
    columns: int
    tile_width_m: float
    tile_height_m: float
    left_m: float
    bottom_m: float
    decision_boundary: float
    """The question: does more than this share of the tiles vibrate?"""
    boundary: float
    """Share of ones that readings are tested against (``decision.boundary_of``)."""
    credible_threshold: float
    min_observations: int
    gate: int
    """Which observations count towards ``min_observations``: ``GATE_TOTAL``, ``GATE_RECEIVED``, ``GATE_OWN``."""
    gate_counts_current: bool
    revise: bool
    prior_alpha: int
    prior_beta: int
    false_positive: float
    """Share of samples on still tiles expected to read 1; 0 if readings are taken at face value, unless the
    strategy ``knows_error_rates``."""
    false_negative: float
    hold_s: float
    """How long opinions have to agree."""
    beliefs: Beliefs


class Reading(NamedTuple):
    """An own sample."""

    reading: int
    """0 or 1."""
    t_s: float
    number: int
    """Index among the robot's samples, from 0."""
    x_m: float
    """Where the robot believes it is (``localisation``); its true position if ``localisation.method`` is "true"."""
    y_m: float
    heading_rad: float
    spread_m: float
    """Standard deviation of the position, m: the root of the mean of the variances in x and y."""
    lagged_number: int
    """Index of the sample ``localisation.lag`` before, whose place is known better by now; -1: there is none yet. This
    sample itself if robots know their true positions."""
    lagged_x_m: float
    lagged_y_m: float
    """Where the robot now believes that sample was taken."""
    lagged_spread_x_m: float
    lagged_spread_y_m: float
    """Standard deviations of that, m."""


class DetailedReading(NamedTuple):
    """An own sample for a strategy that ``reads_details``: a ``Reading``, its energy and draws of its place."""

    reading: int
    t_s: float
    number: int
    x_m: float
    y_m: float
    heading_rad: float
    spread_m: float
    lagged_number: int
    lagged_x_m: float
    lagged_y_m: float
    lagged_spread_x_m: float
    lagged_spread_y_m: float
    log_ratio: float
    """ln of the density of the sample's energy on vibrating over that on still tiles; nan if it is not computed."""
    draws_m: NDArray[np.float64]
    """(2 draws + 2,): x and y of the lagged sample on each of several paths that the robot may have gone, then the
    spreads in x and y that are left (``robot.place_draws``); empty if robots know their true positions, or if the
    strategy reads none."""


class Draws(NamedTuple):
    """Address of the random numbers of one call; see ``u``."""

    seed: int
    run: int
    robot: int
    purpose: int
    address: int
    peer: int
    shift: int
    first: float
    """Number 0 if already known, else negative."""


@inlined
def u(d: Draws, k: int) -> float:
    """Return the k-th uniform number of this call, inside (0, 1); k from 0 to 65,535."""
    if k == 0 and d.first > 0.0:
        return d.first
    return uniform(d.seed, d.run, d.robot, d.purpose, d.address, d.peer + (k << d.shift))


@inlined
def belief_below(alpha: int, beta: int, w: World) -> float:
    """Return P(share of ones < ``w.boundary``) for a Beta(alpha, beta) share; integers alpha, beta >= 1."""
    return belief_of(w.beliefs, alpha, beta)


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
    """Return ``robot.belief.belief_below``, computed once for each posterior."""
    values, boundary = beliefs
    counts = alpha + beta
    place = alpha - int(boundary * counts) + values.shape[0] // 2
    if counts >= values.shape[1] or place < 0 or place >= values.shape[0]:
        return posterior_below(alpha, beta, boundary)
    row, column = unsigned(place), unsigned(counts)
    known: float = values[row, column]
    if known == 0.0:
        known = posterior_below(alpha, beta, boundary)
        values[row, column] = known
    return known
