"""Which kind of tile is the most common, without feedback: a robot counts readings of each kind, and sends its own.

| name | symbol | unit | equation |
|---|---|---|---|
| counts | a_j | - | readings of kind j, own and received, prior included: shares ~ Dirichlet(a) |
| belief | P_j | - | P(share j is the largest) (``robot.most_common``); for two kinds p and 1 - p of Eq. 12 |
| decision | d | - | the kind j with P_j > p_c, and -1 while undecided (Eq. 13) |

With two kinds it is ``none``, bit by bit. Readings are taken at face value: a class is counted as the kind of its tile.
A class beyond the last kind is no reading: it is neither counted nor sent.

``s`` is the robot's state, ``a`` its arrays, ``x`` its reading, ``m`` a message heard, ``out`` the message to fill in,
``d`` random numbers, ``p`` the parameters (none), ``w`` what the robot knows.
"""

from __future__ import annotations

import math

from vibroswarm.core.jit import inner
from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import Row, decision, enough
from vibroswarm.strategies.kind_belief import is_most_common, leader
from vibroswarm.strategies.world import Draws, Reading, World, belief_below

__all__ = ["decision", "dirichlet"]


class State:
    """Numbers of own readings and of readings heard, and the decision."""

    own: int
    received: int
    decision: int


class Arrays:
    """The posterior."""

    counts = array("int64", "kinds")


class Message:
    """The kind of tile that was read, or that the robot believes in."""

    kind: int


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Start with the prior, and undecided. Kinds above 1 have the prior of kind 1."""
    for kind in range(w.kinds):
        a.counts[kind] = w.prior_alpha if kind > 0 else w.prior_beta
    s.decision = -1


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Count a reading of another robot like an own one."""
    a.counts[m.kind] += 1
    s.received += 1


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count the reading, decide, and send the reading."""
    observe_and_decide(s, a, x, w)
    out.kind = x.reading
    return x.reading < w.kinds


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return p, the belief that kind 1 is not the most common, for two kinds; nan for more."""
    return belief_below(a.counts[1], a.counts[0], w) if w.kinds == 2 else math.nan


@inner
def observe_and_decide(s: Row, a: Row, x: Reading, w: World) -> None:
    """Add an own reading, if it is one, to the posterior; decide, if undecided and with enough observations."""
    if x.reading < w.kinds:
        a.counts[x.reading] += 1
        s.own += 1
    if s.decision == -1 and enough(s.own, s.received, w):
        kind = leader(a.counts)
        if is_most_common(a.counts, kind, w):
            s.decision = kind


dirichlet = register(
    strategy_in(
        __name__,
        "dirichlet",
        answers_kinds=True,
        shares="counts",
        about="no feedback, several kinds of tile: a robot sends its reading, and decides which kind is most common",
    )
)
