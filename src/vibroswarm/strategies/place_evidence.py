"""Maps of ``places`` with options: one or several maps, with evidence from energies as well as from bits.

A bit is a reading of 0 or 1. ``places`` and ``place_map`` define the symbols; this module adds:

| name | symbol | unit | equation |
|---|---|---|---|
| maps | K | - | ``draws``, at least 1; map k places each sender's samples on draw k of the sender's path |
| evidence of a reading | l_kjt | - | as in ``places``, with exp(L) for P(r, vibrating) and 1 for P(r, still) |
| log ratio | L | - | ln(P(r, vibrating) / P(r, still)) of the energy, or of the bit by the error rates told |
| vibrating tiles | n | - | mean of n_k, n_k = sum over t of p_kt |
| variance within maps | W | - | mean of sum over t of p_kt (1 - p_kt) |
| variance between maps | B | - | sum of (n_k - n)^2 / (K - 1) |
| score | z | - | (boundary N - n) / sqrt(v W + (1 + 1 / K) B): Rubin, Multiple Imputation (1987), ch. 3 |

Arguments: ``s`` is the robot's state and ``a`` its arrays, both changed in place, ``d`` random numbers, ``p`` the
parameters, ``w`` what the robot knows. ``a.odds`` holds l_kjt, map by map, in each map sender by sender, tiles last.

Functions here are compiled with each kernel and never cached alone, because generated modules define the types of
their arguments.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inlined_uncached
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.place_map import RATE, felt, logistic, total_odds
from vibroswarm.strategies.world import World

RATIO_STEP: Final = 1.0 / 16.0
"""Step in which messages hold a log ratio."""
RATIO_STEPS: Final = 127
"""Largest number of steps, up or down, of a log ratio in a message: it has one byte."""


@inlined_uncached
def ratio_of_bit(bit: int, w: World) -> float:
    """Return the log ratio L of a bit, by the error rates told to the robot, each at least ``RATE``."""
    vibrating, still = 1.0 - w.false_negative, w.false_positive
    if bit == 0:
        vibrating, still = w.false_negative, 1.0 - w.false_positive
    return math.log(max(vibrating, RATE) / max(still, RATE))


@inlined_uncached
def rounded_ratio(log_ratio: float) -> float:
    """Return a log ratio rounded and limited to what one byte of a message can hold."""
    steps = math.floor(log_ratio / RATIO_STEP + 0.5)
    return RATIO_STEP * min(max(steps, -RATIO_STEPS), RATIO_STEPS)


@inlined_uncached
def add_evidence(
    a: Row, k: int, j: int, log_ratio: float, left: int, right: int, upper: int, lower: int, w: World
) -> float:
    """Add the evidence of a reading of sender ``j`` to map ``k``: to ``a.odds`` of each tile with a share of its place.

    Call ``place_map.share_place`` first: it writes the shares of the sample's place to ``a``.

    Args:
        log_ratio: L of the reading. left, right: first and last column that have a share of the place, as
            ``share_place`` returns them. upper, lower: first and last row.
    Returns:
        Probability that vibration is felt at the place, by map ``k`` without the evidence of sender ``j``: the trust in
        the sender is computed from it (``place_trust.judge``).
    """
    # Likelihoods are divided by that of the reading on a still tile: they are 1 there, and 1 + more on a vibrating
    # tile.
    tiles, more = w.rows * w.columns, math.exp(log_ratio) - 1.0
    of_sender = (k * w.robots + j) * tiles
    for r in range(upper, lower + 1):
        for c in range(left, right + 1):
            t = r * w.columns + c
            odds = total_odds(a, k, t, w)
            a.p[t] = logistic(odds)
            a.p_without[t] = logistic(odds - a.weight[j] * a.odds[of_sender + t])
    # Likelihood of the reading by map k, and probability of feeling vibration by map k without sender j. Both are sums
    # over the entries of of_row and of_column: even r and c are rows and columns, odd ones the strips around the edges
    # between them, where vibration of the tiles on both sides is felt (``place_map``). The -1 of ``felt`` means that no
    # tile is assumed to be still.
    expected, without = 0.0, 0.0
    for r in range(2 * upper, 2 * lower + 1):
        for c in range(2 * left, 2 * right + 1):
            share = a.of_column[c] * a.of_row[r] / a.of_all[0]
            if share > 0.0:
                expected += share * (1.0 + more * felt(a.p, r, c, -1, w))
                without += share * felt(a.p_without, r, c, -1, w)
    for row in range(upper, lower + 1):
        for column in range(left, right + 1):
            t = row * w.columns + column
            # Part of the likelihood from places on tile t or its edges: by the map as it is (own), if t vibrates, and
            # if t is still (``felt`` then takes t as still).
            own, vibrating, still = 0.0, 0.0, 0.0
            # Entries of the tile: its row and column, and the strips on both sides of them, as far as they have shares.
            for r in range(max(2 * row - 1, 2 * upper), min(2 * row + 1, 2 * lower) + 1):
                for c in range(max(2 * column - 1, 2 * left), min(2 * column + 1, 2 * right) + 1):
                    share = a.of_column[c] * a.of_row[r] / a.of_all[0]
                    if share > 0.0:
                        own += share * (1.0 + more * felt(a.p, r, c, -1, w))
                        vibrating += share * (1.0 + more)
                        still += share * (1.0 + more * felt(a.p, r, c, t, w))
            # R_t, the part from all other places; rounding could make it negative.
            rest = max(expected - own, 0.0)
            a.odds[of_sender + t] += math.log((vibrating + rest) / (still + rest))
    return without


@inlined_uncached
def chance_of_bit(bit: int, vibration: float, w: World) -> float:
    """Return the probability of a bit, by the error rates told to the robot.

    Args:
        vibration: probability that vibration is felt where the sample was taken.
    """
    one = w.false_positive + (1.0 - w.false_negative - w.false_positive) * vibration
    return one if bit == 1 else 1.0 - one


@inlined_uncached
def score_of_maps(a: Row, maps: int, variance_factor: float, w: World) -> float:
    """Return the score z of ``maps`` maps; it is positive if fewer tiles than the boundary's share vibrate.

    ``mean`` is n, ``inside`` is W, ``between`` is (1 + 1 / K) B of the table, and K is ``maps``; B is 0 for one map. W
    is kept above 0, because the score is divided by the root of v W + (1 + 1 / K) B.
    """
    tiles = w.rows * w.columns
    mean, squares, inside = 0.0, 0.0, 0.0
    for k in range(maps):
        vibrating = 0.0
        for t in range(tiles):
            probability = logistic(total_odds(a, k, t, w))
            vibrating += probability
            inside += probability * (1.0 - probability) / maps
        # Welford (1962): updates of mean and sum of squares that lose no precision by cancellation.
        step = (vibrating - mean) / (k + 1)
        squares += (vibrating - mean) * (vibrating - mean - step)
        mean += step
    between = squares / (maps - 1) * (1.0 + 1.0 / maps) if maps > 1 else 0.0
    return (w.decision_boundary * tiles - mean) / math.sqrt(variance_factor * max(inside, 1e-12) + between)


@inlined_uncached
def decide(s: Row, z: float, t_s: float, falls_from: float, w: World) -> None:
    """Set the decision to 0 or 1 if the score z is past the score needed on either side.

    After the share ``falls_from`` of the run the score needed falls linearly, to 0 at the end of the run, so that no
    robot stays undecided.

    Args:
        s: undecided; ``needed`` is the score needed before it falls. z: score, positive if the share of vibrating tiles
            is below the boundary (decision 0). t_s: the time. falls_from: share of the run, 0 to 1; 1: never falls.
    """
    part, needed = t_s / w.t_end_s, s.needed
    if part > falls_from:
        needed *= max((1.0 - part) / (1.0 - falls_from), 0.0)
    if abs(z) > needed:
        s.decision = 0 if z > 0.0 else 1
