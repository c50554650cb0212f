"""Shares of kinds of tile, estimated by averaging over neighbours (Friedkin and Johnsen 1990).

| name | symbol | equation |
|---|---|---|
| own share | o_j | (own readings of kind j + 1) / (own readings + k), at face value |
| heard share | h_j | mean of the shares of kind j that came between two own readings, the latest there were |
| share | m_j | (1 - a) o_j + a h_j (o_j before any is heard) for j > 0, and the rest for j = 0 |
| counts | c_j | m_j n; n = own readings / ((1 - a)^2 + (1 - (1 - a)^2) / robots): as if all read independently |
| decision | d | the kind whose share is clearly the largest (``kinds.clear_leader``) |
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.kinds import clear_leader
from vibroswarm.strategies.world import Draws, Reading, World


class Params:
    """How much is heard, and when a robot decides."""

    weight: Annotated[float, Field(ge=0, lt=1, description="Weight a of the shares heard.")] = 0.8
    least: Annotated[int, Field(ge=1, le=10**6, description="Own readings before it decides.")] = 20


class State:
    """Own readings, and the decision."""

    own: int
    decision: int


class Arrays:
    """By kind: own readings; number and sum of the shares heard, and whether before the last own sample; counts."""

    read = array("int32", "kinds")
    heard = array("int32", "kinds")
    total = array("float64", "kinds")
    before = array("uint8", "kinds")
    counts = array("float64", "kinds")


class Message:
    """The share of a kind, from kind 1 on in turn."""

    kind: int
    share: float


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Start undecided."""
    s.decision = -1


def opposite(m: Row) -> None:
    """Turn the share of the kind into that of all others, for a robot with the fault ``opposite``."""
    m.share = 1.0 - m.share


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Add the share to those heard since the last own sample."""
    if a.before[m.kind] == 1:
        a.before[m.kind], a.heard[m.kind], a.total[m.kind] = 0, 0, 0.0
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
        share = (a.read[kind] + 1.0) / (s.own + w.kinds)
        if a.heard[kind] > 0:
            share = (1.0 - p.weight) * share + p.weight * (a.total[kind] / a.heard[kind])
        rest = max(rest - share, 0.0)
        a.before[kind], a.counts[kind] = 1, share * n
    a.counts[0] = rest * n
    if s.decision == -1 and s.own >= p.least:
        s.decision = clear_leader(a.counts, n)
    out.kind = 1 + x.number % (w.kinds - 1)
    out.share = a.counts[out.kind] / n
    return True


averaging = register(
    strategy_in(
        __name__,
        "averaging",
        decision=decision,
        bytes_on_air=5,
        answers_kinds=True,
        shares="counts",
        about="averaging over neighbours: mean of the own shares of kinds and of those heard",
    )
)
