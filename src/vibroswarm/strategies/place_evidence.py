"""Maps of ``places`` with options: one or several for each sender, by likelihoods of any reading, not of a bit alone.

``places`` and ``place_map`` have the symbols; what is added here:

| name | symbol | unit | equation |
|---|---|---|---|
| maps | K | - | ``draws``, at least 1; map k takes every sender's samples to be where draw k of their path is |
| evidence of a reading | l_kjt | - | as in ``places``, with exp(L) and 1 for the probabilities of the reading |
| log ratio | L | - | of the energy, or of the bit by the error rates told |
| vibrating tiles | n | - | mean of n_k, n_k = sum over t of p_kt |
| variance within maps | W | - | mean of sum over t of p_kt (1 - p_kt) |
| variance between maps | B | - | sum of (n_k - n)^2 / (K - 1) |
| score | z | - | (x N - n) / sqrt(v W + (1 + 1 / K) B): Rubin, Multiple Imputation (1987), ch. 3 |

Functions here are compiled with each kernel, never cached alone: their arguments are of types of generated modules.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inlined_uncached
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.place_map import RATE, felt, logistic, score_at
from vibroswarm.strategies.world import Draws, World

RATIO_STEP: Final = 1.0 / 16.0
RATIO_STEPS: Final = 127
"""Log ratios in messages have one byte: steps, and how many of them either way."""


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Begin with empty maps, undecided."""
    s.decision, s.needed = -1, score_at(w.credible_threshold)
    for j in range(w.robots):
        a.weight[j] = 1.0 - p.broken_prior


@inlined_uncached
def ratio_of_bit(bit: int, w: World) -> float:
    """Return the log ratio of a bit, by the error rates told."""
    vibrating, still = 1.0 - w.false_negative, w.false_positive
    if bit == 0:
        vibrating, still = w.false_negative, 1.0 - w.false_positive
    return math.log(max(vibrating, RATE) / max(still, RATE))


@inlined_uncached
def rounded_ratio(log_ratio: float) -> float:
    """Return a log ratio as messages hold it."""
    steps = math.floor(log_ratio / RATIO_STEP + 0.5)
    return RATIO_STEP * min(max(steps, -RATIO_STEPS), RATIO_STEPS)


@inlined_uncached
def odds_in(a: Row, k: int, tile: int, w: World) -> float:
    """Return the log odds of a tile in map ``k``."""
    total, tiles = 0.0, w.rows * w.columns
    for j in range(w.robots):
        total += a.weight[j] * a.odds[(k * w.robots + j) * tiles + tile]
    return total


@inlined_uncached
def add_evidence(
    a: Row, k: int, j: int, log_ratio: float, left: int, right: int, upper: int, lower: int, w: World
) -> float:
    """Add a reading of sender ``j`` to map ``k``; return P(vibration is felt) there by the map without the sender.

    Args:
        left to lower: of the place, as ``place_map.share_place`` returns them; its shares are in ``a``.
    """
    tiles, more = w.rows * w.columns, math.exp(log_ratio) - 1.0
    of_sender = (k * w.robots + j) * tiles
    for r in range(upper, lower + 1):
        for c in range(left, right + 1):
            t = r * w.columns + c
            odds = odds_in(a, k, t, w)
            a.p[t] = logistic(odds)
            a.p_without[t] = logistic(odds - a.weight[j] * a.odds[of_sender + t])
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
            own, vibrating, still = 0.0, 0.0, 0.0
            for r in range(max(2 * row - 1, 2 * upper), min(2 * row + 1, 2 * lower) + 1):
                for c in range(max(2 * column - 1, 2 * left), min(2 * column + 1, 2 * right) + 1):
                    share = a.of_column[c] * a.of_row[r] / a.of_all[0]
                    if share > 0.0:
                        own += share * (1.0 + more * felt(a.p, r, c, -1, w))
                        vibrating += share * (1.0 + more)
                        still += share * (1.0 + more * felt(a.p, r, c, t, w))
            rest = max(expected - own, 0.0)
            a.odds[of_sender + t] += math.log((vibrating + rest) / (still + rest))
    return without


@inlined_uncached
def chance_of_bit(bit: int, vibration: float, w: World) -> float:
    """Return the probability of a bit where vibration is felt with this probability, by the error rates told."""
    one = w.false_positive + (1.0 - w.false_negative - w.false_positive) * vibration
    return one if bit == 1 else 1.0 - one


@inlined_uncached
def score_of_maps(a: Row, maps: int, variance_factor: float, w: World) -> float:
    """Return z."""
    tiles = w.rows * w.columns
    mean, squares, inside = 0.0, 0.0, 0.0
    for k in range(maps):
        vibrating = 0.0
        for t in range(tiles):
            probability = logistic(odds_in(a, k, t, w))
            vibrating += probability
            inside += probability * (1.0 - probability) / maps
        # Welford (1962): mean and sum of squares, updated so that nothing cancels.
        step = (vibrating - mean) / (k + 1)
        squares += (vibrating - mean) * (vibrating - mean - step)
        mean += step
    between = squares / (maps - 1) * (1.0 + 1.0 / maps) if maps > 1 else 0.0
    return (w.decision_boundary * tiles - mean) / math.sqrt(variance_factor * max(inside, 1e-12) + between)


@inlined_uncached
def decide(s: Row, z: float, t_s: float, falls_from: float, w: World) -> None:
    """Decide if the score suffices, as ``places`` does."""
    part, needed = t_s / w.t_end_s, s.needed
    if part > falls_from:
        needed *= max((1.0 - part) / (1.0 - falls_from), 0.0)
    if abs(z) > needed:
        s.decision = 0 if z > 0.0 else 1
