"""The map of ``places``: share of a place on each tile, log odds of tiles, and the score.

``places`` defines the symbols; this module adds:

| name | symbol | unit | equation |
|---|---|---|---|
| probability of a reading | P(r) | - | sum over t of q_t m_t |
| near an edge | - | - | within ``edge_reach_m`` of several tiles vibration is felt if any of them vibrates |

A place is a normal distribution in x and y, so it has a share on each column and row. ``of_column[2 c]`` is its share
on column c, ``of_column[2 c + 1]`` its share on the strip around the edge between columns c and c + 1, where vibration
of either is felt. ``of_row`` is the same for rows, from the top. Products of both, divided by ``of_all[0]``, sum to 1.

Where the question is not "more than half?", tiles inform each other through their share. How many tiles vibrate is not
known beforehand, and a floor of which little vibrates is as likely as one of which much does: a tile is no coin.

| name | symbol | unit | equation |
|---|---|---|---|
| boundary | x | - | of the share of vibrating tiles; exactly x is not "more" |
| median of the prior | m | - | ``prior_median``, or x if that is 0 |
| likelihood ratio of tile t | lambda_t | - | exp(sum over senders j of w_j l_jt) |
| number of vibrating tiles | K | - | 0 to N |
| prior of K | pi | - | m <= 1/2: beta-binomial(1, b), b = ln 2 / -ln(1 - m); m > 1/2: that of N - K and 1 - m |
| symmetric polynomial | e_K | - | sum over all sets of K tiles of the product of their lambda_t |
| its mean | E_K | - | e_K / C(N, K): the mean of these products |
| posterior of K | P(K) | - | pi(K) E_K / sum, equation (1) |
| belief | - | - | sum of P(K) over K <= x N |
| score | z | - | standard normal quantile of the belief, divided by sqrt(v) |
| prior odds of a tile | o | - | mean of theta / (1 - mean), theta the share of which the floor is a sample |

(1) is exact: given K, all floors of K vibrating tiles are equally likely a priori. Beta(1, b) has the median m. Adding
tile n with ratio lambda changes E_K to ((n - K) E_K + K lambda E_(K-1)) / n: a sum of positive terms, so that nothing
cancels, whatever the lambdas.

With m = x = 1/2 robots take tiles as independent coins instead, as ``score`` does.

Arguments: ``a`` is the robot's arrays, changed in place, ``p`` the parameters, ``w`` what the robot knows. ``a.odds``
holds the evidence l of ``places``: sender by sender, tiles last. ``a.prior_odds[0]`` holds the log odds of a tile of
which nothing is known: 0, unless tiles share a prior (``tiles_share``).

Functions here are compiled with each kernel and never cached alone, because generated modules define the types of
their arguments.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined_uncached
from vibroswarm.strategies.base import array
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.world import World

WITH_MAP: Final = ("places", "explore", "fading")
"""Strategies whose robots keep such a map."""
FAR: Final = 4.0
"""Standard deviations beyond which tiles have no share of a place."""
LEAST_SPREAD_M: Final = 1e-4
"""Least standard deviation of a place: true places have 0, by which shares cannot be computed."""
RATE: Final = 1e-3
"""Least error rate: with a rate of 0 one reading could outweigh all others."""


SMALL: Final = 2.0**-40
"""When all E_K are below this, all are divided by it: only ratios matter, and a float of 4 bytes ends at 1e-38."""
MOST_ODDS: Final = 500.0
"""Log odds of a tile are limited to this size."""


class TileArrays:
    """Shares of a place in columns, rows and the edges between them, and p of the tiles, with and without a sender."""

    of_column = array("float64", "2*columns")
    of_row = array("float64", "2*rows")
    of_all = array("float64", "1")
    p = array("float64", "tiles")
    p_without = array("float64", "tiles")


@inlined_uncached
def logistic(odds: float) -> float:
    """Return the probability that has these log odds, limited so that exp() does not overflow."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -500.0), 500.0)))


@inlined_uncached
def total_odds(a: Row, tile: int, w: World) -> float:
    """Return the log odds that a tile vibrates: the weighted evidence of all senders."""
    total, tiles = 0.0, w.rows * w.columns
    for j in range(w.robots):
        total += a.weight[j] * a.odds[j * tiles + tile]
    return total


@inlined_uncached
def score(a: Row, p: Row, w: World) -> float:
    """Return the score z; z > 0 if fewer tiles than the boundary's share vibrate."""
    tiles = w.rows * w.columns
    vibrating, variance = 0.0, 0.0
    for t in range(tiles):
        probability = logistic(total_odds(a, t, w))
        vibrating += probability
        variance += probability * (1.0 - probability)
    return (w.decision_boundary * tiles - vibrating) / math.sqrt(p.variance_factor * max(variance, 1e-12))


@inlined_uncached
def score_at(probability: float) -> float:
    """Return the score at which the belief is a given probability, from 1/2 to 1; at most 10."""
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
    """Return the share of a place's distribution below an edge, in x or in y: a normal distribution function."""
    return 0.5 * math.erfc((mean_m - edge_m) / spread_m * math.sqrt(0.5))


@inlined_uncached
def share_place(
    a: Row, x_m: float, y_m: float, spread_x_m: float, spread_y_m: float, p: Row, w: World
) -> tuple[int, int, int, int]:
    """Write the shares of a place on columns, rows and the strips around edges to ``a.of_column`` and ``a.of_row``.

    A strip reaches ``edge_reach_m`` to either side of the edge, but at most half a tile. ``a.of_all[0]`` is set to the
    sum of all products of an entry of ``a.of_column`` and one of ``a.of_row``, by which callers divide. Returns first
    and last column, first and last row that have a share; (0, -1, 0, -1) if the place is off the floor.
    """
    of_x_m = max(spread_x_m, LEAST_SPREAD_M)
    of_y_m = max(spread_y_m, LEAST_SPREAD_M)
    top_m = w.bottom_m + w.rows * w.tile_height_m
    # Tiles farther than this from the mean have no share: vibration of a tile is felt up to edge_reach_m beyond its
    # edges. Columns and rows are kept on the grid; a place off the floor is detected at the end, by its shares.
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
    # Entry 2 c + 1 is the strip between columns c and c + 1. The share of a column ends where a strip begins. The outer
    # sides of ``left`` and ``right`` have no strip: it would be beyond FAR standard deviations, or the grid ends there.
    # Rows are treated in the same way. edge_m is the left edge of the column, and further below the upper edge of the
    # row.
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
    if all_x * all_y < 1e-9:  # practically all of the place is off the floor
        return 0, -1, 0, -1
    a.of_all[0] = all_x * all_y
    return left, right, upper, lower


@inlined_uncached
def add_reading(a: Row, j: int, bit: int, left: int, right: int, upper: int, lower: int, w: World) -> float:
    """Add the evidence of a reading of sender ``j`` to the map, at the place that ``share_place`` wrote.

    Returns the probability of the reading by the map without the evidence of ``j``.
    """
    tiles = w.rows * w.columns
    # Probability of the reading where vibration is felt, and where it is not.
    if_vibrating = max(1.0 - w.false_negative, RATE) if bit == 1 else max(w.false_negative, RATE)
    if_still = max(w.false_positive, RATE) if bit == 1 else max(1.0 - w.false_positive, RATE)
    of_sender = j * tiles
    for r in range(upper, lower + 1):
        for c in range(left, right + 1):
            t = r * w.columns + c
            odds = total_odds(a, t, w) + a.prior_odds[0]
            a.p[t] = logistic(odds)
            a.p_without[t] = logistic(odds - a.weight[j] * a.odds[of_sender + t])
    # P(r), the probability of the reading at this place: ``expected`` by the map, ``before`` by the map without j.
    # Even r and c are rows and columns, odd ones the strips around edges. The -1 of ``felt`` means that no tile is
    # assumed to be still.
    expected, before = 0.0, 0.0
    for r in range(2 * upper, 2 * lower + 1):
        for c in range(2 * left, 2 * right + 1):
            share = a.of_column[c] * a.of_row[r] / a.of_all[0]
            if share > 0.0:
                expected += share * (if_still + (if_vibrating - if_still) * felt(a.p, r, c, -1, w))
                before += share * (if_still + (if_vibrating - if_still) * felt(a.p_without, r, c, -1, w))
    for row in range(upper, lower + 1):
        for column in range(left, right + 1):
            t = row * w.columns + column
            # Part of P(r) from places on tile t or its edges: by the map as it is (own), if t vibrates, and if t is
            # still (``felt`` then takes t as still).
            own, vibrating, still = 0.0, 0.0, 0.0
            # Entries of the tile: its row and column, and the strips on both sides, as far as they have shares.
            for r in range(max(2 * row - 1, 2 * upper), min(2 * row + 1, 2 * lower) + 1):
                for c in range(max(2 * column - 1, 2 * left), min(2 * column + 1, 2 * right) + 1):
                    share = a.of_column[c] * a.of_row[r] / a.of_all[0]
                    if share > 0.0:
                        own += share * (if_still + (if_vibrating - if_still) * felt(a.p, r, c, -1, w))
                        vibrating += share * if_vibrating
                        still += share * (if_still + (if_vibrating - if_still) * felt(a.p, r, c, t, w))
            rest = max(expected - own, 0.0)  # R_t, from all other places; rounding could make it negative
            a.odds[of_sender + t] += math.log((vibrating + rest) / (still + rest))
    return before


@inlined_uncached
def felt(p: NDArray[np.float64], r: int, c: int, still: int, w: World) -> float:
    """Return the probability that any tile that region (r, c) touches vibrates: one, two at an edge, four at a corner.

    ``r``, ``c`` are even for a row or column, odd for the strip around an edge; ``still`` is a tile taken not to
    vibrate, -1: none.
    """
    first = (r // 2) * w.columns + c // 2
    if r % 2 == 0 and c % 2 == 0:
        return 0.0 if first == still else p[first]
    none = 1.0  # becomes the probability that none of the tiles vibrates
    # From r // 2 to (r + 1) // 2: one row if r is even, the rows on both sides of the edge if r is odd. Columns
    # likewise.
    for row in range(r // 2, (r + 1) // 2 + 1):
        for column in range(c // 2, (c + 1) // 2 + 1):
            t = row * w.columns + column
            if t != still:
                none *= 1.0 - p[t]
    return 1.0 - none


@inlined_uncached
def median_of(p: Row, w: World) -> float:
    """Return the median of the prior of the share of vibrating tiles."""
    return p.prior_median if p.prior_median > 0.0 else w.decision_boundary


@inlined_uncached
def tiles_share(p: Row, w: World) -> bool:
    """Return whether tiles inform each other through the share of vibrating ones; if not, they are independent."""
    return w.decision_boundary != 0.5 or median_of(p, w) != 0.5


@inlined_uncached
def prior_shape(median: float) -> float:
    """Return b of the prior Beta(1, b) of the share of the rarer kind of tile, whose median is the smaller share."""
    return math.log(2.0) / -math.log(1.0 - min(median, 1.0 - median))


@inlined_uncached
def count_posterior(a: Row, p: Row, w: World) -> tuple[float, float, float]:
    """Return what a robot believes of the number K of vibrating tiles, by its map."""
    tiles = w.rows * w.columns
    none = 1.0  # E_0
    for t in range(tiles):
        # Both likelihoods of the tile, if it is still and if it vibrates, divided by the larger.
        odds = total_odds(a, t, w)
        still, vibrating = (
            math.exp(-min(max(odds, 0.0), MOST_ODDS)),
            math.exp(max(min(odds, 0.0), -MOST_ODDS)),
        )
        # Equation of the module's docstring for n = t + 1 tiles. The last entry has the factor 0, whatever it held.
        n, before, most = t + 1.0, none, 0.0
        for k in range(t + 1):
            present = a.p[k]
            a.p[k] = ((n - k - 1.0) * still * present + (k + 1.0) * vibrating * before) / n
            before = present
            most = max(most, a.p[k])
        none *= still
        if max(most, none) < SMALL:
            none *= 1.0 / SMALL
            for k in range(t + 1):
                a.p[k] *= 1.0 / SMALL
    # From the likeliest number on, so that the prior only falls: it overflowed on large floors. By j, the number of the
    # rarer kind of tile, which is K for m <= 1/2 and N - K else: pi(j) / pi(j - 1) = (N - j + 1) / (N - j + b).
    median = median_of(p, w)
    b, limit = prior_shape(median), int(w.decision_boundary * tiles + 1e-9)
    prior, below, above, weighted = 1.0, 0.0, 0.0, 0.0
    for j in range(tiles + 1):
        if j > 0:
            prior *= (tiles - j + 1.0) / (tiles - j + b)
        vibrate = j if median <= 0.5 else tiles - j
        part = prior * (a.p[vibrate - 1] if vibrate > 0 else none)
        weighted += vibrate * part
        if vibrate <= limit:
            below += part
        else:
            above += part
    total = below + above
    return below / total, above / total, weighted / total


@inlined_uncached
def score_of_tails(below: float, above: float, p: Row) -> float:
    """Return the score z from the probabilities of "not more" and "more"; z > 0 if the first is larger."""
    tail = min(below, above)
    low, high = 0.0, 40.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if 0.5 * math.erfc(middle * math.sqrt(0.5)) > tail:
            low = middle
        else:
            high = middle
    z = 0.5 * (low + high) / math.sqrt(p.variance_factor)
    return z if below >= above else -z


@inlined_uncached
def prior_odds(mean: float, p: Row, w: World) -> float:
    """Return the log odds that a tile vibrates of which nothing is known, from the mean of K by the others."""
    tiles, b = w.rows * w.columns, prior_shape(median_of(p, w))
    if median_of(p, w) <= 0.5:
        return math.log((mean + 1.0) / (tiles - mean + b))
    return math.log((mean + b) / (tiles - mean + 1.0))


@inlined_uncached
def learn_share(a: Row, p: Row, w: World) -> float:
    """Set ``a.prior_odds``, by which readings at uncertain places are shared out, and return the score z."""
    below, above, mean = count_posterior(a, p, w)
    a.prior_odds[0] = prior_odds(mean, p, w)
    return score_of_tails(below, above, p)


@inlined_uncached
def score_asked(a: Row, p: Row, w: World) -> float:
    """Return the score z for the question asked: from independent tiles, or from tiles that share a prior."""
    if not tiles_share(p, w):
        return score(a, p, w)
    below, above, _ = count_posterior(a, p, w)
    return score_of_tails(below, above, p)
