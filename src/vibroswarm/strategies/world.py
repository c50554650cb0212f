"""Arguments of a strategy's hooks: the world as a robot knows it, a reading, random numbers, and beliefs.

Names are those of the scenario's fields; see ``base`` for the hooks.

A belief is P(share of ones < boundary) by a Beta(alpha, beta) posterior. Beliefs are cached in a table that all runs
and threads share. A belief depends only on alpha, beta and the boundary, so it does not matter which thread computes it
first, or whether two threads write the same number at once. Columns are counts n = alpha + beta, rows are distances
alpha - boundary n. A robot's n grows by one at a time while the distance hardly changes, so entries read one after the
other are close in memory. Farther than sqrt(``SURE`` n) from the boundary the belief is 0 or 1, so rows reach only
about as far as that for the largest n. Beyond ``MAX_COUNTS`` counts beliefs are computed each time.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, unsigned
from vibroswarm.core.rng import uniform
from vibroswarm.robot.belief import SURE
from vibroswarm.robot.belief import belief_below as posterior_below

NO_RATES: Final = np.empty(0)
"""Rates of robots that are not told them."""


class World(NamedTuple):
    """What robot ``robot`` knows about its task; lengths in m, times in s."""

    robot: int
    """Its own number, from 0."""
    robots: int
    """Number of robots."""
    kinds: int
    """Number of kinds of tile."""
    t_end_s: float
    """End of the run."""
    tick_s: float
    """Length of a tick (control period)."""
    tick_ms: int
    """Length of a tick, ms."""
    width_m: float
    """Size of the arena in x."""
    height_m: float
    """Size of the arena in y."""
    rows: int
    """Rows of the grid of tiles."""
    columns: int
    """Columns of the grid of tiles."""
    tile_width_m: float
    """Size of a tile in x."""
    tile_height_m: float
    """Size of a tile in y."""
    left_m: float
    """x of the left end of the grid."""
    bottom_m: float
    """y of the lower end of the grid."""
    decision_boundary: float
    """The question: does more than this share of the tiles vibrate?"""
    boundary: float
    """Share of ones that readings are tested against (``decision.boundary_of``)."""
    credible_threshold: float
    """p_c: a robot decides if its belief, or 1 minus its belief, is above this."""
    min_observations: int
    """O_c: a robot decides only with more counted observations than this."""
    gate: int
    """Which observations count towards ``min_observations``: ``GATE_TOTAL``, ``GATE_RECEIVED``, ``GATE_OWN``."""
    gate_counts_current: bool
    """Whether the own reading just taken counts towards ``min_observations``."""
    revise: bool
    """Whether a robot may change its decision."""
    prior_alpha: int
    """Ones of the prior."""
    prior_beta: int
    """Zeros of the prior."""
    false_positive: float
    """Share of samples on still tiles expected to read 1; 0 if readings are taken at face value, unless the
    strategy ``knows_error_rates``."""
    false_negative: float
    """Share of samples on vibrating tiles expected to read 0; 0 in the same cases as ``false_positive``."""
    hold_s: float
    """How long the opinions of all robots have to agree before the swarm has decided."""
    beliefs: Beliefs
    """Table of the values of ``belief_below`` that have been computed so far."""
    rates: NDArray[np.float64] = NO_RATES
    """Probability of each class of readings on each kind of tile, kind by kind, (kinds * classes,); empty unless the
    strategy ``knows_error_rates``."""


class Reading(NamedTuple):
    """An own sample."""

    reading: int
    """0 or 1; more, if the sensor tells more than two classes."""
    t_s: float
    """Time of the sample."""
    number: int
    """Index among the robot's samples, from 0."""
    x_m: float
    """x of where the robot believes it is (``localisation``); true if ``localisation.method`` is "true"."""
    y_m: float
    """y of where the robot believes it is."""
    heading_rad: float
    """Heading that the robot believes it has, anticlockwise from x."""
    spread_m: float
    """Standard deviation of the position, m: the root of the mean of the variances in x and y."""
    lagged_number: int
    """Index of the lagged sample: the one taken ``localisation.lag`` samples ago, whose place is known better by now.
    -1: there is none yet. If robots know their true positions, this sample itself is the lagged one."""
    lagged_x_m: float
    """x of where the robot now believes that the lagged sample was taken."""
    lagged_y_m: float
    """y of where the robot now believes that the lagged sample was taken."""
    lagged_spread_x_m: float
    """Standard deviation of ``lagged_x_m``, m."""
    lagged_spread_y_m: float
    """Standard deviation of ``lagged_y_m``, m."""
    log_ratio: float = math.nan
    """ln of the density of what was measured on vibrating over that on still tiles, or the log ratio of the bit if a
    fault changed it; nan unless the parameter ``energies`` is True."""
    value: float = math.nan
    """What the sample measured, the first of several numbers, whatever a fault made of the reading; nan unless the
    parameter ``energies`` is True."""


class Draws(NamedTuple):
    """Address of the random numbers of one call; see ``u`` and ``core.rng.uniform``."""

    seed: int
    """Seed of the simulation."""
    run: int
    """Number of the run."""
    robot: int
    """Number of the robot."""
    purpose: int
    """What the numbers are used for: a value of ``core.rng.Purpose``."""
    address: int
    """Index of the event, such as the sample or the message."""
    peer: int
    """Number of the other robot, if there is one."""
    shift: int
    """Bits by which k is shifted, so that ``peer`` and k fit into one word of the address."""
    first: float
    """The number for k = 0 if it is known already, else negative."""


@inlined
def u(d: Draws, k: int) -> float:
    """Return the k-th uniform number of this call, in (0, 1); k from 0 to 65,535.

    The number is a function of ``d`` and k: the same address always gives the same number.
    """
    if k == 0 and d.first > 0.0:  # the number is known already
        return d.first
    return uniform(d.seed, d.run, d.robot, d.purpose, d.address, d.peer + (k << d.shift))


@inlined
def belief_below(alpha: int, beta: int, w: World) -> float:
    """Return P(share of ones < ``w.boundary``) for a Beta(alpha, beta) share; integers alpha, beta >= 1."""
    return belief_of(w.beliefs, alpha, beta)


MIN_COUNTS: Final = 1024
"""Least number of columns of a table; a table of this size has 2 MB."""
MAX_COUNTS: Final = 8192
"""Greatest number of columns of a table; a table of this size has 55 MB, but only entries that are used take memory."""
ASIDE: Final = 24
"""Extra columns: without them the rows, a power of 2 apart, would compete for the same lines of the cache."""


class Beliefs(NamedTuple):
    """``values``: (distances, counts), 0 where not yet computed."""

    values: NDArray[np.float64]
    boundary: float


def beliefs(boundary: float, counts: int) -> Beliefs:
    """Return the table up to ``counts``, at most ``MAX_COUNTS``; sizes are powers of 2, to share cached ones."""
    return _beliefs(boundary, min(max(1 << counts.bit_length(), MIN_COUNTS), MAX_COUNTS))


@lru_cache(maxsize=8)
def _beliefs(boundary: float, room: int) -> Beliefs:
    """Return an empty table of ``room`` counts, shared by all calls with the same arguments."""
    # 2 more: distances are rounded to whole numbers, and the columns of ``ASIDE`` serve slightly higher counts.
    furthest = math.ceil(math.sqrt(SURE * room)) + 2
    return Beliefs(np.zeros((2 * furthest + 1, room + ASIDE)), boundary)


@inlined
def belief_of(beliefs: Beliefs, alpha: int, beta: int) -> float:
    """Return P(share of ones < boundary) for a Beta share, from the table; an entry of 0 is computed and stored."""
    values, boundary = beliefs
    counts = alpha + beta
    # place: the row of the table; the middle row is that of distance 0 from the boundary.
    place = alpha - int(boundary * counts) + values.shape[0] // 2
    if counts >= values.shape[1] or place < 0 or place >= values.shape[0]:
        return posterior_below(alpha, beta, boundary)
    # Compiled code checks signed indices for negative ones; unsigned indices save this time.
    row, column = unsigned(place), unsigned(counts)
    known: float = values[row, column]
    if known == 0.0:
        known = posterior_below(alpha, beta, boundary)
        values[row, column] = known
    return known
