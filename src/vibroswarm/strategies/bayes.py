"""The common part of none, positive and soft: posterior of the fill ratio, and decision (Algorithm 1).

| name | symbol | unit | equation |
|---|---|---|---|
| alpha, beta | alpha, beta | - | counts of ones and zeros, own and received, prior included (Eq. 10, 11) |
| decision | d_f | - | 0 if p > p_c, 1 if 1 - p > p_c, and -1 while undecided (Eq. 13) |
| min_observations | O_c | - | a robot may decide only with strictly more than O_c counted observations |
"""

from __future__ import annotations

from typing import Any, Final

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.world import Draws, World, belief_below

Row = Any
"""A row of a structured array: its fields are attributes, changed in place."""

GATE_TOTAL: Final = 0
GATE_RECEIVED: Final = 1
GATE_OWN: Final = 2
GATES: Final = ("total", "received", "own")


class State:
    """What a robot knows and has decided."""

    alpha: int
    beta: int
    decision: int
    own: int


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Set the prior, undecided."""
    s.alpha, s.beta, s.decision = w.prior_alpha, w.prior_beta, -1


def on_counts(s: Row, ones: int, zeros: int, p: Row, w: World) -> None:
    """Add bits from other robots to the posterior, like own readings (Eq. 11)."""
    s.alpha += ones  # Eq. 11
    s.beta += zeros


def decision(s: Row, a: Row, p: Row, w: World) -> int:
    """Return d_f."""
    current: int = s.decision
    return current


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return P(f < boundary) of the posterior (Eq. 12)."""
    return belief_below(s.alpha, s.beta, w)


@inlined
def observe(s: Row, observation: int) -> None:
    """Add an own reading to the posterior (Eq. 10)."""
    s.alpha += observation  # Eq. 10
    s.beta += 1 - observation
    s.own += 1


@inlined
def is_enough(s: Row, w: World) -> bool:
    """Return whether more than O_c observations are counted; ``s`` already includes the current sample."""
    return enough(s.own, s.alpha + s.beta - w.prior_alpha - w.prior_beta - s.own, w)


@inlined
def enough(own: int, received: int, w: World) -> bool:
    """Return whether more than O_c observations are counted.

    Args:
        own: readings, the current one included. received: observations of other robots.
    """
    counted = own if w.gate_counts_current else own - 1
    if w.gate == GATE_OWN:
        return bool(counted > w.min_observations)
    if w.gate == GATE_RECEIVED:
        return bool(received > w.min_observations)
    return bool(counted + received > w.min_observations)


@inlined
def decided(p_below: float, before: int, w: World) -> int:
    """Return d_f by Eq. 13, with strict inequalities; ``before`` if the belief decides nothing."""
    if p_below > w.credible_threshold:  # Eq. 13
        return 0
    if 1.0 - p_below > w.credible_threshold:
        return 1
    return before


@inlined
def decide_once(s: Row, w: World) -> None:
    """Decide, if undecided and if there are enough observations."""
    if s.decision == -1 and is_enough(s, w):
        s.decision = decided(belief_below(s.alpha, s.beta, w), -1, w)
