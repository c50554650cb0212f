"""Soft feedback for several kinds of tile: a robot sends a random kind, drawn between its reading and its belief.

| name | symbol | unit | equation |
|---|---|---|---|
| belief | P_j | - | P(kind j is the most common) |
| weight | delta | - | exp(-eta Gamma) (max P - 1/k)^kappa; for two kinds Eq. 18 |
| probability of sending j | - | - | delta P_j + (1 - delta) [j = O]; for two kinds Eq. 16 |

Gamma is the variance of the posterior of the largest share. This generalisation of the paper's rule to k kinds is ours;
with two kinds it is ``soft``, bit by bit.
"""

from __future__ import annotations

import math

from vibroswarm.core.jit import inner
from vibroswarm.robot.belief import variance
from vibroswarm.strategies.base import register, strategy_in
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.dirichlet import (
    Arrays,
    Message,
    State,
    begin,
    belief,
    observe_and_decide,
    on_message,
)
from vibroswarm.strategies.kind_belief import (
    UNSURE,
    belief_in,
    kind_within_bounds,
    leader,
    least_belief,
    most_belief,
)
from vibroswarm.strategies.soft import ROUNDING, Params, message
from vibroswarm.strategies.world import Draws, Reading, World, belief_below, u

__all__ = [
    "Arrays",
    "Message",
    "Params",
    "State",
    "begin",
    "belief",
    "decision",
    "dirichlet_soft",
    "on_message",
]


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count the reading, decide, and send a random kind, drawn by the reading and the posterior."""
    observe_and_decide(s, a, x, w)
    if x.reading >= w.kinds:
        return False
    if w.kinds == 2:
        below = belief_below(a.counts[1], a.counts[0], w)
        out.kind = message(x.reading, a.counts[1], a.counts[0], below, p.eta, p.kappa, u(d, 0))
    else:
        out.kind = drawn_kind(x.reading, a.counts, p.eta, p.kappa, u(d, 0), w)
    return True


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


dirichlet_soft = register(
    strategy_in(
        __name__,
        "dirichlet_soft",
        answers_kinds=True,
        shares="counts",
        about="soft feedback, several kinds of tile: a robot sends a kind drawn between its reading and its belief",
    )
)
