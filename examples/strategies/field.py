"""Field: a robot estimates the share of the arena that vibrates by samples with places, without a grid of tiles.

Block kriging (Matheron, "Principles of geostatistics", Economic Geology 58, 1963), updated sample by sample. The arena
is divided into 8 x 8 blocks. Their shares are a Gaussian process of unknown mean, whose correlation falls with
distance.

| name | symbol | unit | equation |
|---|---|---|---|
| share of block b that vibrates | f_b | - | estimated by mean m_b and covariance P_bc |
| at the start | m, P | - | m_b = 1/2; P_bc = 1/12 + mean of exp(-distance / length) / 4 over points of b and c |
| share of a place on block b | q_b | - | probability that the sample was taken on b: place normal in x and y, sum 1 |
| reading as a share | y | - | (reading - a) / (1 - a - b), a and b the rates of false positives and negatives |
| variance of the reading | r | - | h (1 - h) / (1 - a - b)^2, h = a + (1 - a - b) (0.1 + 0.8 q'm), q'm in [0, 1] |
| gain | K, S | - | K = P q, S = q'K + r |
| update | - | - | m += K (y - q'm) / S, P -= K K' / S |
| mean of the arena | n, V | - | estimate and its variance: means of m_b and of P_bc; updated along with m and P |
| score | z | - | (boundary - n) / sqrt(v V), v ``variance_factor`` |
| belief | - | - | that the share of the arena that vibrates is below the boundary: normal distribution function of z |

- Message: as of ``places``, 8 bytes. What a robot knows of its task: the arena, its error rates.
- Memory: 2080 covariances, 64 means and 64 gains of 4 bytes: 8.8 kB. Operations: for each reading 2080 multiplications
  with additions, and 64 more for each block close to its place. An exported robot needs 18 kB of RAM.
- The sign of its score at the end of the run is wrong in 16 %, where counting is wrong in 24 % and ``places`` with the
  right grid in 0.0 %.

vibroswarm run --strategy examples/strategies/field.py:field
"""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm import InputError
from vibroswarm.strategies import array, strategy_in
from vibroswarm.strategies.bayes import decision

__all__ = ["decision", "field"]

SIDE = 8
"""Blocks per side of the arena."""
BLOCKS = SIDE * SIDE
"""Number of blocks."""
POINTS = 3
"""Points per side of a block: the covariance of two blocks is the average over POINTS^2 points in each."""
MEAN_VARIANCE = 1.0 / 12.0
"""Prior variance of the unknown mean: that of a uniform distribution of shares."""
STEP_M = 0.001
"""Resolution of places in messages."""
LEAST_SPREAD_M = 1e-4
"""Least standard deviation of a place: true places have 0, by which shares cannot be computed."""
RATE = 1e-3
"""Least contrast of a sensor."""


class Params:
    """Caution, patience, and how far places are alike."""

    variance_factor: Annotated[
        float, Field(ge=0.01, le=100, description="Factor v of the variance of the score: caution.")
    ] = 1.0
    min_samples: Annotated[
        int, Field(ge=0, le=10**9, description="Least number of readings, own and heard, to decide.")
    ] = 25
    length_m: Annotated[
        float,
        Field(gt=0, le=100, description="Distance at which the correlation of places has fallen to 1/e, m."),
    ] = 0.1


class State:
    """The last own readings (the latest is the lowest bit), number of samples added, own and heard, score needed, the
    estimated share of the arena that vibrates and its variance, and the decision."""

    bits: int
    heard: int
    needed: float
    share: float
    variance: float
    decision: int


class Arrays:
    """Mean of each block, covariances (lower triangle, row by row), and scratch: gains, shares of columns and rows."""

    mean = array("float32", "64")
    covariance = array("float32", "2080")
    gain = array("float32", "64")
    of_column = array("float64", "8")
    of_row = array("float64", "8")


class Message:
    """A sample: its reading, and its place with standard deviations, m."""

    bit: int
    number: int
    at_x_m: float
    at_y_m: float
    spread_x_m: float
    spread_y_m: float


def begin(s, a, d, p, w):
    """Begin undecided, with means of 1/2 and the prior covariances of the table ("at the start").

    ``s.variance`` is V, the mean of all covariances, ``s.share`` is n, and ``s.needed`` is the score needed to decide.
    """
    s.decision, s.needed, s.share = -1, score_at(w.credible_threshold), 0.5
    # a.gain is used as scratch: covariance of two blocks by their distance in blocks, which takes only 64 values.
    for down in range(SIDE):
        for across in range(SIDE):
            a.gain[down * SIDE + across] = block_covariance(across, down, p, w)
    at, total = 0, 0.0  # at: index in a.covariance, which holds the lower triangle row by row
    for b in range(BLOCKS):
        a.mean[b] = 0.5
        for c in range(b + 1):
            blocks_across, blocks_down = abs(b % SIDE - c % SIDE), abs(b // SIDE - c // SIDE)
            a.covariance[at] = a.gain[blocks_down * SIDE + blocks_across]
            total += a.covariance[at] * (1.0 if b == c else 2.0)  # only the lower triangle is stored
            at += 1
    s.variance = total / (BLOCKS * BLOCKS)


def on_message(s, a, m, sender, t_s, d, p, w):
    """Add another robot's sample."""
    add_sample(s, a, m.bit, m.at_x_m, m.at_y_m, m.spread_x_m, m.spread_y_m, w)


def on_sample(s, a, x, out, d, p, w):
    """Update the estimate by an earlier sample, send that sample, and decide.

    That sample was taken ``localisation.lag`` samples ago, because its place is known better by now. Until the robot
    has taken that many samples, nothing is added or sent.
    """
    sends = fill_message(s, x, out)
    if sends:
        add_sample(s, a, out.bit, out.at_x_m, out.at_y_m, out.spread_x_m, out.spread_y_m, w)
    if s.decision == -1 and s.heard >= p.min_samples:
        z = score(s, p, w)
        if abs(z) > s.needed:
            s.decision = 0 if z > 0.0 else 1
    return sends


def belief(s, a, p, w):
    """Return the belief that the share of the arena that vibrates is below the boundary."""
    return 0.5 * math.erfc(-score(s, p, w) * math.sqrt(0.5))


def fill_message(s, x, out):
    """Store the reading ``x``, and fill in the message of the sample taken ``localisation.lag`` samples ago.

    Return whether there is a sample so old; if not, ``out`` is not filled in.
    """
    s.bits = ((s.bits << 1) | x.reading) & 0xFFFFFFF  # 28 bits are enough: ``localisation.lag`` is at most 24
    if x.lagged_number < 0:
        return False
    # The lagged sample was taken (number - lagged_number) samples ago, so its bit is that far from the lowest bit.
    out.bit = (s.bits >> (x.number - x.lagged_number)) & 1
    out.number = x.lagged_number
    out.at_x_m, out.at_y_m = rounded(x.lagged_x_m), rounded(x.lagged_y_m)
    out.spread_x_m, out.spread_y_m = rounded(x.lagged_spread_x_m), rounded(x.lagged_spread_y_m)
    return True


def rounded(length_m):
    """Return a length rounded to ``STEP_M``, as messages hold it."""
    return STEP_M * math.floor(length_m / STEP_M + 0.5)


def score_at(probability):
    """Return the score at which the belief is a given probability, from 1/2 to 1; at most 10.

    It is the standard normal quantile of the probability, computed by bisection.
    """
    low, high = 0.0, 10.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if 0.5 * math.erfc(-middle * math.sqrt(0.5)) < probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def share_below(edge_m, mean_m, spread_m):
    """Return the share of a place's distribution below an edge, in x or in y: a normal distribution function."""
    return 0.5 * math.erfc((mean_m - edge_m) / spread_m * math.sqrt(0.5))


def score(s, p, w):
    """Return the score z, with the variance of the estimate kept above 0."""
    z: float = (w.decision_boundary - s.share) / math.sqrt(p.variance_factor * max(s.variance, 1e-12))
    return z


def block_covariance(across, down, p, w):
    """Return the prior covariance of the shares of two blocks that are ``across`` columns and ``down`` rows apart."""
    total = 0.0
    # Mean of exp(-distance / length) over all pairs of one point in each block. The sum is over differences i and j of
    # the points' positions in their blocks, in units of 1 / POINTS block; ``pairs`` pairs have the same differences.
    for i in range(1 - POINTS, POINTS):
        for j in range(1 - POINTS, POINTS):
            x_m = (across + i / POINTS) * w.width_m / SIDE
            y_m = (down + j / POINTS) * w.height_m / SIDE
            pairs = (POINTS - abs(i)) * (POINTS - abs(j))
            total += pairs * math.exp(-math.sqrt(x_m * x_m + y_m * y_m) / p.length_m)
    # 0.25 is the variance of 0 (still) or 1 (vibrates) at a place that vibrates with probability 1/2.
    return MEAN_VARIANCE + 0.25 * total / POINTS**4


def covariance_at(b, c):
    """Return the index in ``a.covariance`` of the covariance of two blocks."""
    high, low = max(b, c), min(b, c)
    return high * (high + 1) // 2 + low


def add_sample(s, a, bit, x_m, y_m, spread_x_m, spread_y_m, w):
    """Update means, covariances and the estimate of the arena by a reading, 0 or 1, taken at an estimated place.

    Args:
        bit: the reading. x_m, y_m, spread_x_m, spread_y_m: mean and standard deviations of the place.
    """
    s.heard += 1
    # of_x_m, of_y_m: the spread of the place in x, and in y; all_x, all_y: the sums of its shares on columns and on
    # rows.
    of_x_m, of_y_m = max(spread_x_m, LEAST_SPREAD_M), max(spread_y_m, LEAST_SPREAD_M)
    width_m, height_m, all_x, all_y = w.width_m / SIDE, w.height_m / SIDE, 0.0, 0.0
    for k in range(SIDE):
        a.of_column[k] = share_below((k + 1) * width_m, x_m, of_x_m) - share_below(k * width_m, x_m, of_x_m)
        a.of_row[k] = share_below((k + 1) * height_m, y_m, of_y_m) - share_below(k * height_m, y_m, of_y_m)
        all_x += a.of_column[k]
        all_y += a.of_row[k]
    if all_x * all_y < 1e-9:
        return  # practically all of the place is outside of the arena: no block has a share. ``heard`` counts it anyway
    # Compute K = P q in a.gain, and q'm in ``expected``.
    for b in range(BLOCKS):
        a.gain[b] = 0.0
    expected = 0.0
    for r in range(SIDE):
        for c in range(SIDE):
            share = a.of_row[r] * a.of_column[c] / (all_x * all_y)
            if share > 1e-4:  # blocks with less are left out of K and q'm to save time
                # at: index of the block in row r and column c.
                at = r * SIDE + c
                expected += share * a.mean[at]
                for b in range(BLOCKS):
                    a.gain[b] += share * a.covariance[covariance_at(b, at)]
    variance, total = 0.0, 0.0  # ``variance`` becomes S = q'K + r, ``total`` the sum of K
    for b in range(BLOCKS):
        variance += a.of_row[b // SIDE] * a.of_column[b % SIDE] / (all_x * all_y) * a.gain[b]
        total += a.gain[b]
    # r: ``ones`` is h, the probability of reading 1; 0.1 + 0.8 q'm keeps r above 0 if sensors make no errors.
    # ``contrast`` is 1 - a - b, kept above 0 because it is divided by.
    contrast = max(1.0 - w.false_positive - w.false_negative, RATE)
    ones = w.false_positive + contrast * (0.1 + 0.8 * min(max(expected, 0.0), 1.0))
    variance += ones * (1.0 - ones) / (contrast * contrast)
    # Update: m += K change, and likewise n, the mean of m, and V, the mean of P.
    change = ((bit - w.false_positive) / contrast - expected) / variance
    at = 0
    for b in range(BLOCKS):
        a.mean[b] += a.gain[b] * change
        for c in range(b + 1):
            a.covariance[at] -= a.gain[b] * a.gain[c] / variance
            at += 1
    s.share += total / BLOCKS * change
    s.variance -= total * total / (BLOCKS * BLOCKS * variance)


def check(p, boundary):
    """Refuse the question about another share than half.

    A share near 0 or 1 has no normal distribution: at "more than 3 %?" 12 and 30 % of swarms raised false alarms on
    floors of 0 and 2 %.

    Raises:
        InputError: the boundary is not 1/2.
    """
    if boundary != 0.5:
        raise InputError(
            f"field answers 'more than half?' only, and decision.decision_boundary is {boundary:g}; choose places, or "
            "another strategy",
            field="strategy.name",
        )


field = strategy_in(
    __name__,
    "field",
    bytes_on_air=8,
    knows_error_rates=True,
    check=check,
    about="field: robots send where they sampled, and estimate the arena's mean by kriging; no grid is presumed",
)
