"""The kind that a robot sends under soft feedback, drawn between its reading O and its belief, for more than two kinds.

Equations and symbols are those of ``dirichlet_soft``. Beliefs P_j are integrals (``kind_belief.belief_in``), but their
bounds tell the kind of nearly every message.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inner
from vibroswarm.robot.belief import variance
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.kind_belief import belief_in, leader, least_belief, most_belief
from vibroswarm.strategies.soft import ROUNDING
from vibroswarm.strategies.world import World


@inner
def drawn_kind(reading: int, counts: Row, eta: float, kappa: float, number: float, w: World) -> int:
    """Draw the kind to send: the kinds from the highest down share the interval from 0 to 1 by their probabilities.

    Args:
        reading: O. number: uniform number in (0, 1).
    """
    total = 0
    for kind in range(counts.size):
        total += counts[kind]
    first = leader(counts)
    narrow = math.exp(-eta * variance(counts[first], total - counts[first]))
    kinds = counts.size
    # Another kind than O is sent with a probability of at most ``most``, at the ends of the interval.
    most = narrow * max(most_belief(counts, first, w) - 1.0 / kinds, 0.0) ** kappa
    if most + ROUNDING < number < 1.0 - most - ROUNDING:
        return reading
    least = narrow * max(least_belief(counts, first, w) - 1.0 / kinds, 0.0) ** kappa
    drawn: int = kind_within_bounds(reading, counts, least, most, number, w)
    if drawn != UNSURE:
        return drawn
    delta = narrow * max(belief_in(counts, first, w) - 1.0 / kinds, 0.0) ** kappa
    upper = 0.0
    for after in range(1, kinds):
        sent: int = kinds - after
        upper += delta * belief_in(counts, sent, w) + (1.0 - delta) * (sent == reading)
        if number < upper:
            return sent
    return 0


UNSURE: Final = -1
"""Bounds of the beliefs do not tell which kind is drawn."""


@inner
def kind_within_bounds(reading: int, counts: Row, least: float, most: float, number: float, w: World) -> int:
    """Draw the kind to send as ``drawn_kind`` does, by bounds of the beliefs; ``UNSURE`` if they do not tell.

    Hardly a message needs more, and the integrals of ``belief_in`` take a hundred times as long.

    Args:
        least, most: bounds of delta.
    """
    all_least = 0.0
    for kind in range(counts.size):
        all_least += least_belief(counts, kind, w)
    above_least, above_most = 0.0, 0.0  # bounds of the belief in any kind from ``sent`` on
    for after in range(1, counts.size):
        sent: int = counts.size - after
        above_least += least_belief(counts, sent, w)
        above_most = min(above_most + most_belief(counts, sent, w), 1.0 - (all_least - above_least))
        low, high = least * above_least, most * above_most
        if reading >= sent:
            low, high = 1.0 - most * (1.0 - above_least), 1.0 - least * (1.0 - above_most)
        if number < low - ROUNDING:
            return sent
        if number < high + ROUNDING:
            return UNSURE
    return 0
