"""The map of ``places``: shares of a place on tiles, log odds of tiles, pairs of error rates, and the score.

``places`` has the table of symbols; what is added here:

| name | symbol | unit | equation |
|---|---|---|---|
| pair of rates | k | - | rates with log odds 0 or +- ``rate_step`` from those told; 0: as told |
| evidence of a pair | e_k | - | sum over readings of w_j ln P(r), P(r) = sum over t of q_t m_t by that pair's map |
| probability of a pair | c_k | - | exp(e_k) / sum |
| vibrating tiles | n | - | sum over k of c_k n_k, n_k = sum p_t |
| its variance | - | - | sum over k of c_k (v sum p_t (1 - p_t) + (n_k - n)^2) |
| near an edge | - | - | within ``edge_reach_m`` of several tiles vibration is felt if any of them vibrates |

With true places and one sender e_k is the exact log probability of all readings: the prior of each tile is a coin's.

Functions here are compiled with each kernel, never cached alone: their arguments are of types of generated modules.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined_uncached
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.world import World

PAIRS: Final = 9
FAR: Final = 4.0
"""Standard deviations at which places are cut off."""
LEAST_SPREAD_M: Final = 1e-4
RATE: Final = 1e-3
"""Error rates are taken to be at least this."""
LEAST_CREDENCE: Final = 1e-6
"""Pairs less probable than this are left out of the score."""


@inlined_uncached
def pairs_of(p: Row) -> int:
    """Return the number of pairs of rates."""
    return PAIRS if p.rate_pairs else 1


@inlined_uncached
def logistic(odds: float) -> float:
    """Return the probability of log odds."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -500.0), 500.0)))


@inlined_uncached
def rate_of(told: float, third: int, p: Row) -> float:
    """Return the rate told (``third`` 0), or the one a step above (1) or below it (2)."""
    if third == 0:
        return told
    rate = min(max(told, RATE), 1.0 - RATE)
    steps = 1.0 if third == 1 else -1.0
    return logistic(math.log(rate / (1.0 - rate)) + p.rate_step * steps)


@inlined_uncached
def weigh_pairs(a: Row, pairs: int) -> None:
    """Weigh the pairs of rates by their evidence."""
    best, total = a.evidence[0], 0.0
    for k in range(1, pairs):
        best = max(best, a.evidence[k])
    for k in range(pairs):
        a.credence[k] = math.exp(max(a.evidence[k] - best, -500.0))
        total += a.credence[k]
    for k in range(pairs):
        a.credence[k] /= total


@inlined_uncached
def total_odds(a: Row, pair: int, tile: int, w: World) -> float:
    """Return the log odds of a tile."""
    total, tiles = 0.0, w.rows * w.columns
    for j in range(w.robots):
        total += a.weight[j] * a.odds[(pair * w.robots + j) * tiles + tile]
    return total


@inlined_uncached
def score(a: Row, p: Row, w: World) -> float:
    """Return z."""
    tiles = w.rows * w.columns
    mean, squares, inside, all_credence = 0.0, 0.0, 0.0, 0.0
    for k in range(pairs_of(p)):
        credence = a.credence[k]
        if credence < LEAST_CREDENCE:
            continue
        vibrating, variance = 0.0, 0.0
        for t in range(tiles):
            probability = logistic(total_odds(a, k, t, w))
            vibrating += probability
            variance += probability * (1.0 - probability)
        # West (1979): mean and sum of squares, updated so that nothing cancels.
        all_credence += credence
        step = (vibrating - mean) * credence / all_credence
        squares += credence * (vibrating - mean) * (vibrating - mean - step)
        mean += step
        inside += credence * variance
    inside = max(inside / all_credence, 1e-12)
    return (w.decision_boundary * tiles - mean) / math.sqrt(
        p.variance_factor * inside + squares / all_credence
    )


@inlined_uncached
def score_at(probability: float) -> float:
    """Return the standard normal quantile of a probability from 1/2 to 1, at most 10, by bisection."""
    low, high = 0.0, 10.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if 0.5 * math.erfc(-middle * math.sqrt(0.5)) < probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inlined_uncached
def share_below(edge_m: float, mean_m: float, spread_m: float) -> float:
    """Return the share of a place's distribution below an edge."""
    return 0.5 * math.erfc((mean_m - edge_m) / spread_m * math.sqrt(0.5))


@inlined_uncached
def share_place(
    a: Row, x_m: float, y_m: float, spread_x_m: float, spread_y_m: float, p: Row, w: World
) -> tuple[int, int, int, int]:
    """Write a place's shares of columns and rows, and of the edges between them; return first and last column and row.

    ``of_column[2 c]`` is the share of column c, ``[2 c + 1]`` of the edge between c and c + 1, up to the reach on
    either side; likewise rows, from the top. Products of both have the sum ``of_all[0]``. The last column is before
    the first if the place is beyond the floor.
    """
    of_x_m = max(spread_x_m * p.spread_factor, LEAST_SPREAD_M)
    of_y_m = max(spread_y_m * p.spread_factor, LEAST_SPREAD_M)
    top_m = w.bottom_m + w.rows * w.tile_height_m
    far_x_m, far_y_m = FAR * of_x_m + p.edge_reach_m, FAR * of_y_m + p.edge_reach_m
    left = min(max(int((x_m - far_x_m - w.left_m) / w.tile_width_m), 0), w.columns - 1)
    right = min(max(int((x_m + far_x_m - w.left_m) / w.tile_width_m), 0), w.columns - 1)
    upper = min(max(int((top_m - y_m - far_y_m) / w.tile_height_m), 0), w.rows - 1)
    lower = min(max(int((top_m - y_m + far_y_m) / w.tile_height_m), 0), w.rows - 1)
    reach_x_m, reach_y_m = (
        min(p.edge_reach_m, 0.5 * w.tile_width_m),
        min(p.edge_reach_m, 0.5 * w.tile_height_m),
    )
    all_x, all_y = 0.0, 0.0
    for c in range(left, right + 1):
        edge_m = w.left_m + c * w.tile_width_m
        low_m = edge_m + (reach_x_m if c > left else 0.0)
        high_m = edge_m + w.tile_width_m
        a.of_column[2 * c + 1] = 0.0
        if c < right and reach_x_m > 0.0:
            a.of_column[2 * c + 1] = share_below(high_m + reach_x_m, x_m, of_x_m) - share_below(
                high_m - reach_x_m, x_m, of_x_m
            )
            high_m -= reach_x_m
        a.of_column[2 * c] = share_below(high_m, x_m, of_x_m) - share_below(low_m, x_m, of_x_m)
        all_x += a.of_column[2 * c] + a.of_column[2 * c + 1]
    for r in range(upper, lower + 1):
        edge_m = top_m - r * w.tile_height_m
        high_m = edge_m - (reach_y_m if r > upper else 0.0)
        low_m = edge_m - w.tile_height_m
        a.of_row[2 * r + 1] = 0.0
        if r < lower and reach_y_m > 0.0:
            a.of_row[2 * r + 1] = share_below(low_m + reach_y_m, y_m, of_y_m) - share_below(
                low_m - reach_y_m, y_m, of_y_m
            )
            low_m += reach_y_m
        a.of_row[2 * r] = share_below(high_m, y_m, of_y_m) - share_below(low_m, y_m, of_y_m)
        all_y += a.of_row[2 * r] + a.of_row[2 * r + 1]
    if all_x * all_y < 1e-9:
        return 0, -1, 0, -1
    a.of_all[0] = all_x * all_y
    return left, right, upper, lower


@inlined_uncached
def add_reading(
    a: Row, j: int, bit: int, left: int, right: int, upper: int, lower: int, p: Row, w: World
) -> float:
    """Add a reading of sender ``j``, whose place has been shared; return its probability under the map without j."""
    total_before, pairs, tiles = 0.0, pairs_of(p), w.rows * w.columns
    for k in range(pairs):
        false_positive, false_negative = (
            rate_of(w.false_positive, k % 3, p),
            rate_of(w.false_negative, k // 3, p),
        )
        if_vibrating = max(1.0 - false_negative, RATE) if bit == 1 else max(false_negative, RATE)
        if_still = max(false_positive, RATE) if bit == 1 else max(1.0 - false_positive, RATE)
        of_sender = (k * w.robots + j) * tiles
        for r in range(upper, lower + 1):
            for c in range(left, right + 1):
                t = r * w.columns + c
                odds = total_odds(a, k, t, w)
                a.p[t] = logistic(odds)
                a.p_without[t] = logistic(odds - a.weight[j] * a.odds[of_sender + t])
        expected, before = 0.0, 0.0
        for r in range(2 * upper, 2 * lower + 1):
            for c in range(2 * left, 2 * right + 1):
                share = a.of_column[c] * a.of_row[r] / a.of_all[0]
                if share > 0.0:
                    expected += share * (if_still + (if_vibrating - if_still) * felt(a.p, r, c, -1, w))
                    before += share * (if_still + (if_vibrating - if_still) * felt(a.p_without, r, c, -1, w))
        total_before += a.credence[k] * before
        a.evidence[k] += a.weight[j] * math.log(expected)
        for row in range(upper, lower + 1):
            for column in range(left, right + 1):
                t = row * w.columns + column
                own, vibrating, still = 0.0, 0.0, 0.0
                for r in range(max(2 * row - 1, 2 * upper), min(2 * row + 1, 2 * lower) + 1):
                    for c in range(max(2 * column - 1, 2 * left), min(2 * column + 1, 2 * right) + 1):
                        share = a.of_column[c] * a.of_row[r] / a.of_all[0]
                        if share > 0.0:
                            own += share * (if_still + (if_vibrating - if_still) * felt(a.p, r, c, -1, w))
                            vibrating += share * if_vibrating
                            still += share * (if_still + (if_vibrating - if_still) * felt(a.p, r, c, t, w))
                rest = max(expected - own, 0.0)
                a.odds[of_sender + t] += math.log((vibrating + rest) / (still + rest))
    weigh_pairs(a, pairs)
    return total_before


@inlined_uncached
def felt(p: NDArray[np.float64], r: int, c: int, still: int, w: World) -> float:
    """Return the probability that vibration is felt at a column or an edge ``c``, a row or an edge ``r``.

    Args:
        p: (tiles,). still: a tile that is presumed not to vibrate; -1: none.
    """
    first = (r // 2) * w.columns + c // 2
    if r % 2 == 0 and c % 2 == 0:
        return 0.0 if first == still else p[first]
    none = 1.0
    for row in range(r // 2, (r + 1) // 2 + 1):
        for column in range(c // 2, (c + 1) // 2 + 1):
            t = row * w.columns + column
            if t != still:
                none *= 1.0 - p[t]
    return 1.0 - none
