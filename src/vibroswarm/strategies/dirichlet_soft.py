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
from vibroswarm.strategies.drawn_kind import drawn_kind
from vibroswarm.strategies.soft import Params, message
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
    """Count the reading, decide, and send a random kind, drawn by the reading and the posterior.

    A robot that has decided may change its decision if ``w.revise``.
    """
    before = s.decision
    if w.revise:
        s.decision = -1
    observe_and_decide(s, a, x, w)
    if s.decision == -1:
        s.decision = before
    if x.reading >= w.kinds:
        return False
    if w.kinds == 2:
        below = belief_below(a.counts[1], a.counts[0], w)
        out.kind = message(x.reading, a.counts[1], a.counts[0], below, p.eta, p.kappa, u(d, 0))
    else:
        out.kind = drawn_kind(x.reading, a.counts, p.eta, p.kappa, u(d, 0), w)
    return True


dirichlet_soft = register(
    strategy_in(
        __name__,
        "dirichlet_soft",
        answers_kinds=True,
        shares="counts",
        revises=True,
        about="soft feedback, several kinds of tile: a robot sends a kind drawn between its reading and its belief",
    )
)
