"""Which kind of tile is the most common: a robot counts readings of each kind, under all three feedbacks of the paper.

| name | symbol | unit | equation |
|---|---|---|---|
| counts | a_j | - | readings of kind j, own and received, prior included: shares ~ Dirichlet(a) |
| belief | P_j | - | P(share j is the largest) (``robot.most_common``); for two kinds p and 1 - p of Eq. 12 |
| decision | d | - | the kind j with P_j > p_c, and -1 while undecided (Eq. 13) |
| weight | delta | - | exp(-eta Gamma) (max P - 1/k)^kappa; for two kinds Eq. 18 |
| probability of sending j | - | - | soft: delta P_j + (1 - delta) [j = O]; for two kinds Eq. 16 |

Gamma is the variance of the posterior of the largest share. This generalisation of the paper's soft feedback to k kinds
is ours. With two kinds the strategies are ``none``, ``positive`` and ``soft``, bit by bit. For more, P_j is an
integral, which is computed only where its bounds do not tell. Readings are taken at face value: a class is counted as
the kind of its tile. A class beyond the last kind is no reading: it is neither counted nor sent.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inner
from vibroswarm.robot.belief import variance
from vibroswarm.robot.most_common import most_common_belief
from vibroswarm.strategies import soft
from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import Row, decision, enough
from vibroswarm.strategies.soft import ROUNDING, message
from vibroswarm.strategies.world import Draws, Reading, World, belief_below, u


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


def on_sample_positive(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count the reading, decide, and send the decision, or the reading while undecided."""
    observe_and_decide(s, a, x, w)
    out.kind = s.decision if s.decision != -1 else x.reading
    return s.decision != -1 or x.reading < w.kinds


def on_sample_soft(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count the reading, decide, and send a random kind, drawn by the reading and the posterior."""
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


@inner
def leader(counts: Row) -> int:
    """Return the kind with the largest count, the first of several."""
    first = 0
    for kind in range(1, counts.size):
        if counts[kind] > counts[first]:
            first = kind
    return first


@inner
def clear_leader(counts: Row, n: float) -> int:
    """Return the kind with clearly the largest share m_j = a_j / n, by a normal approximation; -1 if there is none.

    It is j if m_j - m_i > 1.645 sqrt((m_j + m_i - (m_j - m_i)^2) / (n + 1)) for all other kinds i.
    """
    first = leader(counts)
    for kind in range(counts.size):
        apart, both = (counts[first] - counts[kind]) / n, (counts[first] + counts[kind]) / n
        if kind != first and apart <= 1.6449 * math.sqrt((both - apart * apart) / (n + 1.0)):
            return -1
    return first


@inner
def is_most_common(counts: Row, kind: int, w: World) -> bool:
    """Return whether P_j > p_c for j = ``kind``, a kind with the largest count."""
    if counts.size == 2:
        return bool(belief_in(counts, kind, w) > w.credible_threshold)
    if most_belief(counts, kind, w) <= w.credible_threshold:
        return False
    if least_belief(counts, kind, w) > w.credible_threshold:
        return True
    return most_common_belief(counts, kind) > w.credible_threshold


@inner
def most_belief(counts: Row, kind: int, w: World) -> float:
    """Return an upper bound of P_j for j = ``kind``: the least probability of a larger share than another kind's."""
    most = 1.0
    for other in range(counts.size):
        if other != kind:
            most = min(most, pair_belief(counts, kind, other, w))
    return most


@inner
def least_belief(counts: Row, kind: int, w: World) -> float:
    """Return a lower bound of P_j for j = ``kind``: the product of P(larger share) over the others.

    If the kind's Gamma variable is x, the others are below it independently, with probabilities that all rise with x.
    So they are positively correlated (Chebyshev's inequality).
    """
    least = 1.0
    for other in range(counts.size):
        if other != kind:
            least *= pair_belief(counts, kind, other, w)
    return least


@inner
def pair_belief(counts: Row, one: int, other: int, w: World) -> float:
    """Return P(share of kind ``one`` > share of kind ``other``)."""
    return belief_below(counts[other], counts[one], w)


@inner
def belief_in(counts: Row, kind: int, w: World) -> float:
    """Return P_j for j = ``kind``."""
    if counts.size > 2:
        return most_common_belief(counts, kind)
    below = belief_below(counts[1], counts[0], w)
    return below if kind == 0 else 1.0 - below


@inner
def drawn_kind(reading: int, counts: Row, eta: float, kappa: float, number: float, w: World) -> int:
    """Draw the kind to send: the kinds from the highest down share the interval from 0 to 1 by their probabilities."""
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


dirichlet = register(
    strategy_in(
        __name__,
        "dirichlet",
        decision=decision,
        answers_kinds=True,
        shares="counts",
        about="no feedback, several kinds of tile: a robot sends its reading, and decides which kind is most common",
    )
)
dirichlet_positive = register(
    strategy_in(
        __name__,
        "dirichlet_positive",
        on_sample=on_sample_positive,
        decision=decision,
        answers_kinds=True,
        shares="counts",
        about="positive feedback, several kinds of tile: a robot sends its decision once it has one",
    )
)
dirichlet_soft = register(
    strategy_in(
        __name__,
        "dirichlet_soft",
        params=soft.Params,
        on_sample=on_sample_soft,
        decision=decision,
        answers_kinds=True,
        shares="counts",
        revises=True,
        about="soft feedback, several kinds of tile: a robot sends a kind drawn between its reading and its belief",
    )
)
