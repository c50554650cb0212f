"""Shares of kinds of tile, estimated by averaging over neighbours (Friedkin and Johnsen 1990).

| name | symbol | equation |
|---|---|---|
| own share | o_j | (own readings of kind j + 1) / (own readings + k), at face value |
| heard share | h_j | mean of the shares of kind j that came between two own readings, the latest there were |
| share | m_j | (1 - a) o_j + a h_j (o_j before any is heard) for j > 0, and the rest for j = 0 |
| counts | c_j | m_j n; n = own readings / ((1 - a)^2 + (1 - (1 - a)^2) / robots): as if all read independently |
| decision | d | j if the next kind is i and m_j - m_i > 1.645 sqrt((m_j + m_i - (m_j - m_i)^2) / (n + 1)) |

A message has the share of one kind, from 1 on in turn.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.core.jit import inner
from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.dirichlet import leader
from vibroswarm.strategies.world import Draws, Reading, World

__all__ = ["averaging", "decision"]


class Params:
    """How much is heard, and when a robot decides."""

    weight: Annotated[float, Field(ge=0, lt=1, description="Weight a of the shares heard.")] = 0.8
    least: Annotated[int, Field(ge=1, le=10**6, description="Own readings before it decides.")] = 20


class State:
    """Own readings, and the decision."""

    own: int
    decision: int


class Arrays:
    """By kind: own readings; number, sum and latest mean of the shares heard; counts."""

    read = array("int32", "kinds")
    heard = array("int32", "kinds")
    total = array("float64", "kinds")
    mean = array("float64", "kinds")
    counts = array("float64", "kinds")


class Message:
    """The share of a kind."""

    kind: int
    share: float


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Start undecided, with nothing heard."""
    s.decision = -1
    for kind in range(w.kinds):
        a.mean[kind] = math.nan


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Add up the share."""
    a.heard[m.kind] += 1
    a.total[m.kind] += m.share


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Average, decide, and send the share of a kind."""
    if x.reading < w.kinds:
        a.read[x.reading] += 1
        s.own += 1
    rest, alone = 1.0, (1.0 - p.weight) ** 2
    n = max(s.own, 1) / (alone + (1.0 - alone) / w.robots)
    for kind in range(1, w.kinds):
        share = averaged(a, kind, (a.read[kind] + 1.0) / (s.own + w.kinds), p.weight)
        rest = max(rest - share, 0.0)
        a.counts[kind] = share * n
    a.counts[0] = rest * n
    if s.decision == -1 and s.own >= p.least:
        s.decision = clear_leader(a.counts, n)
    out.kind = 1 + x.number % (w.kinds - 1)
    out.share = a.counts[out.kind] / n
    return True


@inner
def averaged(a: Row, kind: int, own: float, weight: float) -> float:
    """Return m_j, and begin a new mean of what is heard."""
    if a.heard[kind] > 0:
        a.mean[kind] = a.total[kind] / a.heard[kind]
        a.heard[kind], a.total[kind] = 0, 0.0
    return own if math.isnan(a.mean[kind]) else (1.0 - weight) * own + weight * a.mean[kind]


@inner
def clear_leader(counts: Row, n: float) -> int:
    """Return the decision: the kind with the largest share, -1 if the next one is too near."""
    first = leader(counts)
    second = 1 if first == 0 else 0
    for kind in range(counts.size):
        if kind != first and counts[kind] > counts[second]:
            second = kind
    apart, both = (counts[first] - counts[second]) / n, (counts[first] + counts[second]) / n
    return first if apart > 1.6449 * math.sqrt((both - apart * apart) / (n + 1.0)) else -1


averaging = register(
    strategy_in(
        __name__,
        "averaging",
        bytes_on_air=5,
        many_readings=True,
        answers_kinds=True,
        boundary_half=True,
        reports=("counts",),
        shares="counts",
        about="averaging over neighbours: mean of the own shares of kinds and of those heard",
    )
)
