"""Places: a robot sends where it took each sample, and builds a map of the floor, whose grid of tiles it is told.

Estimated places are those of ``localisation``. A later estimate of a place is better, so a sample is sent
``localisation.lag`` samples after it was taken. With ``localisation.method`` "true" robots know their places, and a
sample is sent at once.

| name | symbol | unit | equation |
|---|---|---|---|
| share of a place on tile t | q_t | - | probability that the sample was taken on t: \
normal in x and y about the mean, 0 on tiles farther than 4 standard deviations, sum 1 |
| map | p_t | - | probability that t vibrates: 1 / (1 + exp(-sum over senders j of w_j l_jt)) |
| probability of reading r on tile t | m_t | - | p_t P(r, vibrating) + (1 - p_t) P(r, still), by the error rates |
| evidence of sender j on tile t | l_jt | - | \
each reading r adds ln((q_t P(r, vibrating) + R_t) / (q_t P(r, still) + R_t)) |
| other tiles | R_t | - | sum over u other than t of q_u m_u |
| surprise of sender j | s_j | - | (L - mean) / standard deviation, L the log probability of j's readings \
under the map without them |
| suspicion of sender j | b_j | - | log probability of j's readings if they are ones in j's own share everywhere \
(half a one and half a zero are added to j's counts), minus L |
| weight of sender j | w_j | - | 1 / (1 + prior odds of being broken * exp(b_j)); 0 while s_j < -``trust_limit`` |
| score | z | - | (boundary N - sum p_t) / sqrt(v sum p_t (1 - p_t)), N the number of tiles, v ``variance_factor`` |
| belief | - | - | that the share of vibrating tiles is below the boundary: normal distribution function of z |
| decision | - | - | once the belief is past p_c on either side, with ``min_samples`` own and heard readings |

A sender whose readings do not depend on the place has a high suspicion. At each reading of a sender, its older
readings lose the fraction 1 / 60 of their weight in surprise, suspicion and counts. After the share
``falls_from`` of the run, the score needed falls linearly to 0 at the end of the run, so that no robot stays undecided.

- Message: sender and reading (1 byte), number (1), x and y to 1 mm (2 each), standard deviations to 1 mm (1 each): 8
  bytes, sent once the place is known. Standard deviations above 255 mm, of robots that have lost their place, are sent
  too, although a byte does not hold them.
- Error rates count as 1e-3 at least, and so do the probabilities by which senders are judged.
- What a robot is told about its task: the grid of tiles, its error rates, the end of the run if ``falls_from`` is below
  1, and how far beyond edges vibration is felt if ``edge_reach_m`` is above 0.
- A priori each tile vibrates with probability 1/2, independently, if the boundary is 1/2. With another boundary, or
  ``prior_median``, tiles share a prior: ``place_map`` has belief and score then, and p_t has the prior odds o.
- ``fading`` is ``places`` for floors that change: at each own sample, s seconds after the one before, l_jt becomes
  l_jt exp(-s / ``memory_s``). The decision may change if ``decision.revise`` is set. A floor that changes contradicts
  all senders at once: set ``trust_limit`` to 1000 and ``broken_prior`` to 0, unless robots may fail.
- Floors whose fill ratio is close to the boundary are harder, and errors there are more frequent than 1 - p_c;
  ``variance_factor`` above 1 makes decisions more cautious.
"""

from __future__ import annotations

import math
from typing import Annotated, Final

from pydantic import Field

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.place_map import (
    RATE,
    TileArrays,
    add_reading,
    learn_share,
    score,
    score_asked,
    score_at,
    share_place,
    tiles_share,
)
from vibroswarm.strategies.world import Draws, Reading, World

STEP_M: Final = 0.001
"""Resolution of places in messages."""
TRUST_MEMORY: Final = 60
"""Readings over which a sender's surprise is averaged."""


class Message:
    """A sample: its reading, and its place with standard deviations, m."""

    bit: int
    number: int
    at_x_m: float
    at_y_m: float
    spread_x_m: float
    spread_y_m: float


@inlined
def rounded(length_m: float) -> float:
    """Return a length rounded to ``STEP_M``, as messages hold it."""
    return STEP_M * math.floor(length_m / STEP_M + 0.5)


@inlined
def fill_message(s: Row, x: Reading, out: Row) -> bool:
    """Store the reading ``x``, and fill in the message of the sample taken ``localisation.lag`` samples ago."""
    s.bits = ((s.bits << 1) | x.reading) & 0xFFFFFFF  # 28 bits are enough: ``localisation.lag`` is at most 24
    if x.lagged_number < 0:
        return False
    # The lagged sample was taken (number - lagged_number) samples ago, so its bit is that far from the lowest bit.
    out.bit = (s.bits >> (x.number - x.lagged_number)) & 1
    out.number = x.lagged_number
    out.at_x_m, out.at_y_m = rounded(x.lagged_x_m), rounded(x.lagged_y_m)
    out.spread_x_m, out.spread_y_m = rounded(x.lagged_spread_x_m), rounded(x.lagged_spread_y_m)
    return True


class Params:
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
    trust_limit: Annotated[
        float,
        Field(
            ge=0,
            le=1000,
            description="Surprise at which a sender is no longer trusted; 1000: never. For lost robots.",
        ),
    ] = 5.0
    broken_prior: Annotated[
        float,
        Field(
            ge=0,
            lt=1,
            description="Share of robots presumed to read alike everywhere; 0: none. For stuck sensors.",
        ),
    ] = 0.1
    prior_median: Annotated[
        float,
        Field(
            ge=0,
            lt=1,
            description="Median of the prior of the share of vibrating tiles; 0: the boundary. Lower where damage is "
            "rare. If it and the boundary are 1/2, tiles are independent.",
        ),
    ] = 0.0
    edge_reach_m: Annotated[
        float,
        Field(
            ge=0,
            le=1,
            description="How far beyond the edges of a tile its vibration is felt, as robots assume.",
        ),
    ] = 0.0


class State:
    """The last own readings (the latest is the lowest bit), number of samples added, own and heard (those off the floor
    too), score needed, and decision.
    """

    bits: int
    heard: int
    needed: float
    decision: int


class TrustArrays:
    """What is known of each sender: its surprise and the variance of it, its suspicion, its readings, its weight."""

    surprise = array("float64", "robots")
    variance = array("float64", "robots")
    suspicion = array("float64", "robots")
    ones = array("float64", "robots")
    readings = array("float64", "robots")
    weight = array("float64", "robots")


class OddsArrays:
    """Log odds of each tile by sender, and prior log odds."""

    odds = array("float64", "robots*tiles")
    prior_odds = array("float64", "1")


class Arrays(TileArrays, TrustArrays, OddsArrays):
    """The map, trust in senders, and the tiles of a sample's place."""


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Begin with an empty map, undecided, with equal weights of senders."""
    # -1: undecided. ``s.needed`` is the absolute score at which the belief in either side reaches the threshold.
    s.decision, s.needed = -1, score_at(w.credible_threshold)
    # Before any reading the weight is the prior probability that a sender is not broken.
    for j in range(w.robots):
        a.weight[j] = 1.0 - p.broken_prior
    if tiles_share(p, w):
        learn_share(a, p, w)


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Add another robot's sample to the map."""
    add_sample(s, a, sender, m.bit, m.at_x_m, m.at_y_m, m.spread_x_m, m.spread_y_m, p, w)


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Store the reading; add the sample of ``localisation.lag`` samples ago to the map and send it; decide."""
    sends = fill_message(s, x, out)
    if sends:
        add_sample(s, a, w.robot, out.bit, out.at_x_m, out.at_y_m, out.spread_x_m, out.spread_y_m, p, w)
    z = learn_share(a, p, w) if tiles_share(p, w) else 0.0  # the prior is learned after the decision too
    if s.decision == -1 and s.heard >= p.min_samples:
        if not tiles_share(p, w):
            z = score(a, p, w)
        part, needed = x.t_s / w.t_end_s, s.needed
        # After the share falls_from of the run the score needed falls linearly, to 0 at the end of the run.
        if part > p.falls_from:
            needed *= max((1.0 - part) / (1.0 - p.falls_from), 0.0)
        if abs(z) > needed:
            s.decision = 0 if z > 0.0 else 1
    return sends


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return the belief that the share of vibrating tiles is below the boundary."""
    return 0.5 * math.erfc(-score_asked(a, p, w) * math.sqrt(0.5))


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
    """Add a sample of sender ``j`` to the map, and update the trust; off the floor it only counts in ``s.heard``."""
    s.heard += 1
    left, right, upper, lower = share_place(a, x_m, y_m, spread_x_m, spread_y_m, p, w)
    if right < left:
        return  # the place is off the floor
    # ``add_reading`` returns the reading's probability by the map without the evidence of j, by which j is judged.
    judge(a, j, bit, add_reading(a, j, bit, left, right, upper, lower, w), p)


def judge(a: Row, j: int, bit: int, probability: float, p: Row) -> None:
    """Update surprise, suspicion and weight of sender ``j`` by one of its readings."""
    kept = 1.0 - 1.0 / TRUST_MEMORY  # weight that older readings keep
    chance = min(max(probability, RATE), 1.0 - RATE)
    # If the map is right, the reading is ``bit`` with probability ``chance``, and its log probability has the mean
    # ``by_chance`` and the variance chance (1 - chance) ratio^2. a.surprise is the weighted sum of log probability -
    # mean over the readings, a.variance the variance of this sum.
    by_chance = chance * math.log(chance) + (1.0 - chance) * math.log(1.0 - chance)
    ratio = math.log(chance / (1.0 - chance))
    a.surprise[j] = kept * a.surprise[j] + math.log(chance) - by_chance
    a.variance[j] = kept * kept * a.variance[j] + chance * (1.0 - chance) * ratio * ratio
    # Probability of the reading if the sender is broken, so that the share of ones in its readings does not depend on
    # the place. Half a one and half a zero are added to the counts, so that the probability is never 0.
    if_broken = (a.ones[j] + 0.5) / (a.readings[j] + 1.0)
    if bit == 0:
        if_broken = 1.0 - if_broken
    a.suspicion[j] = kept * a.suspicion[j] + math.log(if_broken / chance)
    a.ones[j], a.readings[j] = kept * a.ones[j] + bit, kept * a.readings[j] + 1.0
    # Odds that the sender is broken; the limit of 500 keeps exp() from overflowing.
    broken = p.broken_prior / (1.0 - p.broken_prior) * math.exp(min(a.suspicion[j], 500.0))
    a.weight[j] = 1.0 / (1.0 + broken)
    if a.surprise[j] < -p.trust_limit * math.sqrt(a.variance[j]):
        a.weight[j] = 0.0


# Fields of fading come first in its rows: Numba would take a row that begins like one of places for one of places.
class Memory:
    """How long evidence counts."""

    memory_s: Annotated[
        float,
        Field(
            gt=0,
            le=1e9,
            description="Time after which evidence on a tile counts 1/e, s.",
        ),
    ] = 600.0


class FadingParams(Params, Memory):
    """Those of ``places``, and how long evidence counts."""


class Clock:
    """Time of the last own sample, s."""

    sampled_s: float


class FadingState(State, Clock):
    """That of ``places``, and when the map last faded."""


def on_sample_fading(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Let the map fade, add an earlier sample to it and send that, and decide, again if decisions may change."""
    kept = math.exp(-(x.t_s - s.sampled_s) / p.memory_s)
    s.sampled_s = x.t_s
    for k in range(w.robots * w.rows * w.columns):
        a.odds[k] *= kept
    before = s.decision
    if w.revise:
        s.decision = -1  # so that places decides again; without a new decision the old one stays
    sends = on_sample(s, a, x, out, d, p, w)
    if s.decision == -1:
        s.decision = before
    return sends


places = register(
    strategy_in(
        __name__,
        "places",
        decision=decision,
        bytes_on_air=8,
        knows_error_rates=True,
        reports=("p", "weight"),
        about="places: robots send where they sampled, and map a floor whose grid of tiles is known",
    )
)
fading = register(
    strategy_in(
        __name__,
        "fading",
        params=FadingParams,
        state=FadingState,
        on_sample=on_sample_fading,
        decision=decision,
        bytes_on_air=8,
        knows_error_rates=True,
        revises=True,
        reports=("p", "weight"),
        about="fading: places, whose evidence on each tile decays with time",
    )
)
