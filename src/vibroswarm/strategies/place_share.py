"""The map of ``places`` where the question is not "more than half?": tiles inform each other through their share.

How many tiles vibrate is not known beforehand, and a floor of which little vibrates is as likely as one of which much
does: a tile is no coin. ``places`` and ``place_map`` define the other symbols.

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

With m = x = 1/2 robots take tiles as independent coins instead, as ``place_map.score`` does.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inlined_uncached
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.place_map import score, total_odds
from vibroswarm.strategies.world import World

SMALL: Final = 2.0**-40
"""When all E_K are below this, all are divided by it: only ratios matter, and a float of 4 bytes ends at 1e-38."""
MOST_ODDS: Final = 500.0
"""Log odds of a tile are limited to this size."""


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
    """Return what a robot believes of the number K of vibrating tiles, by its map.

    ``a.p`` is used as scratch: entry K - 1 holds E_K.

    Returns:
        Probability that K is at most the boundary's share of tiles, probability that it is more, and mean of K.
    """
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
    """Return the score z from the probabilities of "not more" and "more", whose sum is 1; z > 0 if the first is larger.

    The quantile is computed by bisection from the smaller probability, so that it is exact where the other rounds to 1.
    """
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
    """Return the log odds that a tile vibrates of which nothing is known, from the mean of K by the others.

    The share theta has the posterior Beta(K + 1, N - K + b) given K if m <= 1/2, and Beta(K + b, N - K + 1) if m > 1/2.
    """
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
