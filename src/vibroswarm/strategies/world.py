"""What a strategy's functions are given: the world as a robot knows it, a reading, and chance.

Names are those of the scenario's fields; see ``base`` for who is given what.
"""

from __future__ import annotations

from typing import NamedTuple

from vibroswarm.compiled import inlined
from vibroswarm.draws import uniform
from vibroswarm.strategies.belief_table import Beliefs, belief_of


class World(NamedTuple):
    """What robot ``robot`` knows of its task; lengths in m, times in s."""

    robot: int
    """Its own number, from 0."""
    robots: int
    t_end_s: float
    tick_s: float
    tick_ms: int
    width_m: float
    height_m: float
    rows: int
    """Of the grid of tiles."""
    columns: int
    tile_width_m: float
    tile_height_m: float
    left_m: float
    bottom_m: float
    decision_boundary: float
    """The question: does more than this share of the tiles vibrate?"""
    boundary: float
    """The share of ones to hold readings against (``decision.boundary_of``)."""
    credible_threshold: float
    min_observations: int
    gate: int
    """What is counted against ``min_observations``: ``GATE_TOTAL``, ``GATE_RECEIVED``, ``GATE_OWN``."""
    gate_counts_current: bool
    revise: bool
    prior_alpha: int
    prior_beta: int
    false_positive: float
    """Share of samples at still places that robots expect to read 1; of readings taken at their word: 0."""
    false_negative: float
    hold_s: float
    """For how long opinions have to agree."""
    beliefs: Beliefs


class Reading(NamedTuple):
    """An own sample."""

    reading: int
    """0 or 1."""
    t_s: float
    number: int
    """Of the robot's samples, from 0."""
    x_m: float
    """Where the robot believes that it is. Without a stage of localisation that is where it is."""
    y_m: float
    heading_rad: float
    spread_m: float
    """Standard deviation of the place, m."""


class Draws(NamedTuple):
    """The address of the numbers of one call; see ``u``."""

    seed: int
    run: int
    robot: int
    purpose: int
    address: int
    peer: int
    shift: int
    first: float
    """The number 0 where it is known already, else below 0."""


@inlined
def u(d: Draws, k: int) -> float:
    """The k-th uniform number of this call, inside (0, 1); k from 0 to 65,535."""
    if k == 0 and d.first > 0.0:
        return d.first
    return uniform(d.seed, d.run, d.robot, d.purpose, d.address, d.peer + (k << d.shift))


@inlined
def belief_below(alpha: int, beta: int, w: World) -> float:
    """P(share of ones < ``w.boundary``) for a share that is Beta(alpha, beta); whole alpha, beta >= 1."""
    return belief_of(w.beliefs, alpha, beta)
