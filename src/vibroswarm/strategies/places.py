"""Places: a robot sends where it sampled, and keeps a map of the floor; it presumes that the grid of tiles is known.

With ``rate_pairs`` it weighs nine pairs of error rates by evidence, with a map for each: ``place_map``.

The estimated places are those of ``localisation``: a sample is sent ``localisation.lag`` samples late, smoothed. With
``localisation.method`` at "true" robots know their places, and the sample is sent at once.

| name | symbol | unit | equation |
|---|---|---|---|
| share of a place on tile t | q_t | - | normal in x and y about the mean, cut off at 4 standard deviations, sum 1 |
| map | p_t | - | 1 / (1 + exp(-sum over senders j of w_j l_jt)) |
| expected on tile t | m_t | - | p_t P(r on a vibrating tile) + (1 - p_t) P(r on a still tile) |
| evidence of reading r | l_jt | - | += ln((q_t P(r, vibrating) + R_t) / (q_t P(r, still) + R_t)) |
| other tiles | R_t | - | sum over u other than t of q_u m_u |
| surprise of sender j | s_j | - | (log probability of its readings under the map without them - expected) / std. dev. |
| suspicion | b_j | - | log probability of j's readings if they show its own share of ones anywhere, less as above |
| weight of sender j | w_j | - | 1 / (1 + prior odds of being broken * exp(b_j)); 0 while s_j < -``trust_limit`` |
| score | z | - | (x N - sum p_t) / sqrt(v sum p_t (1 - p_t)), x the boundary, N the number of tiles |
| belief | - | - | normal distribution function of z: that less than x of the tiles vibrate |
| decision | - | - | once the belief is past p_c on either side, with ``min_samples`` readings heard and own |

Of surprise and suspicion 1 / ``trust_memory`` is forgotten at each reading. From the share ``falls_from`` of the run
on, the score needed falls to 0 at its end, so that nobody stays undecided.

- Message: sender and reading (1 byte), number (1), place to 1 mm (2 each), standard deviations to 1 mm (1 each): 8
  bytes, sent once the place is known. With options: ``place_samples``, ``place_summaries``.
- Told to a robot: the grid of tiles, its error rates, the end of the run if ``falls_from`` is below 1, and how far
  beyond edges vibration is felt if ``edge_reach_m`` is above 0.
- The prior is that each tile vibrates or not as a coin falls. Floors near the boundary are harder than that: errors
  there are more frequent than 1 - p_c. ``variance_factor`` above 1 is caution against them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Final

from pydantic import Field

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.base import Strategy, array, register, strategy_in
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.place_map import (
    RATE,
    add_reading,
    pairs_of,
    score,
    score_at,
    share_place,
    weigh_pairs,
)
from vibroswarm.strategies.world import Draws, Reading, World

__all__ = ["Message", "decision", "places"]

STEP_M: Final = 0.001
"""Resolution of places in messages."""


class Message:
    """A sample: its reading, and its place with standard deviations, m."""

    bit: int
    number: int
    at_x_m: float
    at_y_m: float
    spread_x_m: float
    spread_y_m: float


@inlined
def fill_message(s: Row, x: Reading, out: Row) -> bool:
    """Fill in the message of the sample whose place is known by now; return False if there is none yet.

    Args:
        s: its ``bits`` are the own readings not sent yet, the latest is the lowest; ``x`` is added.
    """
    s.bits = ((s.bits << 1) | x.reading) & 0xFFFFFFF
    if x.lagged_number < 0:
        return False
    out.bit = (s.bits >> (x.number - x.lagged_number)) & 1
    out.number = x.lagged_number
    out.at_x_m, out.at_y_m = rounded(x.lagged_x_m), rounded(x.lagged_y_m)
    out.spread_x_m, out.spread_y_m = rounded(x.lagged_spread_x_m), rounded(x.lagged_spread_y_m)
    return True


@inlined
def rounded(length_m: float) -> float:
    """Return a length as messages hold it."""
    return STEP_M * math.floor(length_m / STEP_M + 0.5)


class MapParams:
    """Caution, patience and trust."""

    variance_factor: Annotated[
        float, Field(ge=0.01, le=100, description="Factor v of the variance of the score: caution.")
    ] = 1.0
    min_samples: Annotated[
        int, Field(ge=0, le=10**9, description="Least number of readings, own and heard, to decide.")
    ] = 25
    falls_from: Annotated[
        float,
        Field(ge=0, le=1, description="Share of the run after which the score needed falls to 0; 1: never."),
    ] = 1.0
    spread_factor: Annotated[
        float, Field(ge=0, le=100, description="Factor of the standard deviations of places.")
    ] = 1.0
    trust_limit: Annotated[
        float,
        Field(ge=0, le=1000, description="Surprise at which a sender is no longer trusted; 1000: never."),
    ] = 5.0
    broken_prior: Annotated[
        float, Field(ge=0, lt=1, description="Share of robots presumed to read alike everywhere; 0: none.")
    ] = 0.1
    trust_memory: Annotated[
        int, Field(ge=1, le=10**6, description="Readings over which a sender's surprise is averaged.")
    ] = 60
    rate_pairs: Annotated[
        bool,
        Field(description="Whether nine pairs of error rates, around those told, are weighed by evidence."),
    ] = False
    rate_step: Annotated[
        float, Field(ge=0, le=10, description="Step between these pairs, in the log odds of each rate.")
    ] = 0.7
    edge_reach_m: Annotated[
        float,
        Field(
            ge=0,
            le=1,
            description="How far beyond the edges of a tile its vibration is felt, as robots are told.",
        ),
    ] = 0.0


class Options:
    """What else messages may hold."""

    energies: Annotated[
        bool,
        Field(
            description="Whether messages hold the log likelihood ratio of a reading's energy, whose laws on both "
            "kinds of tile robots know, in place of a bit."
        ),
    ] = False
    draws: Annotated[
        int,
        Field(
            ge=0,
            le=4,
            description="Draws of the place in each message, each along one path, and as many maps: 2 to 4; 0: mean "
            "and spread.",
        ),
    ] = 0
    share_map: Annotated[
        bool,
        Field(
            description="Whether robots send their own map, a byte a tile, in place of samples: at most 139 tiles."
        ),
    ] = False
    map_every: Annotated[
        int,
        Field(ge=1, le=10**6, description="With share_map, a map is sent after each so many own samples."),
    ] = 1


class Params(MapParams, Options):
    """Caution, patience and trust, and what else messages may hold."""


class State:
    """Own readings not sent yet (the latest is the lowest bit), readings in the map, and the decision."""

    bits: int
    heard: int
    needed: float
    decision: int


class Arrays:
    """Log odds of each tile by pair of rates and sender, evidence and probability of each pair, how surprising each
    sender is, and scratch: a place's share of each column and row and of the edges between them, and p of the tiles."""

    odds = array("float64", "9*robots*tiles")
    evidence = array("float64", "9")
    credence = array("float64", "9")
    surprise = array("float64", "robots")
    variance = array("float64", "robots")
    suspicion = array("float64", "robots")
    ones = array("float64", "robots")
    readings = array("float64", "robots")
    weight = array("float64", "robots")
    of_column = array("float64", "2*columns")
    of_row = array("float64", "2*rows")
    of_all = array("float64", "1")
    p = array("float64", "tiles")
    p_without = array("float64", "tiles")


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Begin with an empty map, undecided."""
    s.decision, s.needed = -1, score_at(w.credible_threshold)
    for j in range(w.robots):
        a.weight[j] = 1.0 - p.broken_prior
    weigh_pairs(a, pairs_of(p))


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Add another robot's sample to the map."""
    add_sample(s, a, sender, m.bit, m.at_x_m, m.at_y_m, m.spread_x_m, m.spread_y_m, p, w)


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Add and send the sample whose place is known by now, and decide."""
    sends = fill_message(s, x, out)
    if sends:
        add_sample(s, a, w.robot, out.bit, out.at_x_m, out.at_y_m, out.spread_x_m, out.spread_y_m, p, w)
    if s.decision == -1 and s.heard >= p.min_samples:
        z, part = score(a, p, w), x.t_s / w.t_end_s
        needed = s.needed
        if part > p.falls_from:
            needed *= max((1.0 - part) / (1.0 - p.falls_from), 0.0)
        if abs(z) > needed:
            s.decision = 0 if z > 0.0 else 1
    return sends


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return the belief that less than the boundary's share of the tiles vibrates."""
    return 0.5 * math.erfc(-score(a, p, w) * math.sqrt(0.5))


def add_sample(
    s: Row,
    a: Row,
    j: int,
    bit: int,
    x_m: float,
    y_m: float,
    spread_x_m: float,
    spread_y_m: float,
    p: Row,
    w: World,
) -> None:
    """Add a sample of sender ``j`` to the map."""
    s.heard += 1
    left, right, upper, lower = share_place(a, x_m, y_m, spread_x_m, spread_y_m, p, w)
    if right < left:
        return  # beyond the floor
    judge(a, j, bit, add_reading(a, j, bit, left, right, upper, lower, p, w), p)


def judge(a: Row, j: int, bit: int, probability: float, p: Row) -> None:
    """Weigh sender ``j`` anew after a reading of this probability under the map without it."""
    kept = 1.0 - 1.0 / p.trust_memory
    chance = min(max(probability, RATE), 1.0 - RATE)
    by_chance = chance * math.log(chance) + (1.0 - chance) * math.log(1.0 - chance)
    ratio = math.log(chance / (1.0 - chance))
    a.surprise[j] = kept * a.surprise[j] + math.log(chance) - by_chance
    a.variance[j] = kept * kept * a.variance[j] + chance * (1.0 - chance) * ratio * ratio
    if_broken = (a.ones[j] + 0.5) / (a.readings[j] + 1.0)
    if bit == 0:
        if_broken = 1.0 - if_broken
    a.suspicion[j] = kept * a.suspicion[j] + math.log(if_broken / chance)
    a.ones[j], a.readings[j] = kept * a.ones[j] + bit, kept * a.readings[j] + 1.0
    broken = p.broken_prior / (1.0 - p.broken_prior) * math.exp(min(a.suspicion[j], 500.0))
    a.weight[j] = 1.0 / (1.0 + broken)
    if a.surprise[j] < -p.trust_limit * math.sqrt(a.variance[j]):
        a.weight[j] = 0.0


def variant(p: Any, sizes: Mapping[str, int]) -> Strategy:
    """Return the strategy that runs with these parameters: ``places``, or the one that has their functions.

    Args:
        p: of ``Params``. sizes: tiles of the grid, and the arena's longer side, ``longest_mm``.
    Raises:
        InputError: options that do not go together, or do not fit into a message.
    """
    if not (p.energies or p.draws or p.share_map):
        return places
    from vibroswarm.strategies.place_options import with_options

    return with_options(places, p, sizes)


places = register(
    strategy_in(
        __name__,
        "places",
        bytes_on_air=8,
        knows_error_rates=True,
        variant=variant,
        about="places: robots send where they sampled, and map a floor whose grid of tiles is known",
    )
)
