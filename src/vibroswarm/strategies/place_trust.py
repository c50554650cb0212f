"""What a robot remembers of the samples that it adds to its map, and how it judges their senders.

Symbols and equations are those of the table in ``places``.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.base import array
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.place_map import RATE

STEP_M: Final = 0.001
"""Resolution of places in messages."""
TRUST_MEMORY: Final = 60
"""Readings over which a sender's surprise is averaged."""


class State:
    """The last own readings (the latest is the lowest bit), number of samples added, own and heard (those off the
    floor too), score needed, and decision."""

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


@inlined
def rounded(length_m: float) -> float:
    """Return a length rounded to ``STEP_M``, as messages hold it."""
    return STEP_M * math.floor(length_m / STEP_M + 0.5)


def judge(a: Row, j: int, bit: int, probability: float, p: Row) -> None:
    """Update surprise, suspicion and weight of sender ``j`` by one of its readings.

    Args:
        bit: the reading. probability: that of this reading, by the map without the evidence of ``j``.
    """
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
