"""The belief P_j that kind j of tile is the most common, from counts of readings, and its bounds.

The counts a_j, prior included, stand for shares ~ Dirichlet(a). For two kinds P_1 and P_0 are p and 1 - p of Eq. 12.
For more, P_j is an integral (``robot.most_common``), which is computed only where its bounds do not tell.
"""

from __future__ import annotations

import math

from vibroswarm.core.jit import inner
from vibroswarm.robot.most_common import most_common_belief
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.world import World, belief_below


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

    Args:
        n: sum of the counts.
    """
    first = leader(counts)
    for kind in range(counts.size):
        apart, both = (counts[first] - counts[kind]) / n, (counts[first] + counts[kind]) / n
        if kind != first and apart <= 1.6449 * math.sqrt((both - apart * apart) / (n + 1.0)):
            return -1
    return first


@inner
def is_most_common(counts: Row, kind: int, w: World) -> bool:
    """Return whether P_j > p_c for j = ``kind``, a kind with the largest count.

    The integral is computed only if p_c is between bounds of P_j.
    """
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
    """Return a lower bound of P_j for j = ``kind``: the product of the probabilities of a larger share than each other.

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
