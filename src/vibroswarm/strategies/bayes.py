"""The common part of none, positive and soft: posterior of the fill ratio, and decision (Algorithm 1 of the paper).

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

GATE_TOTAL, GATE_RECEIVED, GATE_OWN = 0, 1, 2
"""Values of ``World.gate``: which observations count towards O_c: own and received ones, received ones, own ones."""
GATES: Final = ("total", "received", "own")
"""Names of these values in a scenario (``decision.gate``); a value is the index of its name."""


class State:
    """What a robot knows and has decided."""

    alpha: int
    beta: int
    decision: int
    own: int


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Start with the prior, and undecided."""
    s.alpha, s.beta, s.decision = w.prior_alpha, w.prior_beta, -1


def on_counts(s: Row, ones: int, zeros: int, p: Row, w: World) -> None:
    """Add bits from other robots to the posterior, like own readings (Eq. 11)."""
    s.alpha += ones  # Eq. 11
    s.beta += zeros


def decision(s: Row, a: Row, p: Row, w: World) -> int:
    """Return the decision d_f: 0, 1, or -1 while undecided."""
    current: int = s.decision
    return current


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return p, the belief that f is below the boundary, by the posterior (Eq. 12)."""
    return belief_below(s.alpha, s.beta, w)


@inlined
def observe(s: Row, observation: int) -> None:
    """Add an own reading, 0 or 1, to the posterior (Eq. 10), and count it."""
    s.alpha += observation  # Eq. 10
    s.beta += 1 - observation
    s.own += 1


@inlined
def is_enough(s: Row, w: World) -> bool:
    """Return whether ``s``, which includes the current sample, holds more than O_c observations, see ``enough``."""
    return enough(s.own, s.alpha + s.beta - w.prior_alpha - w.prior_beta - s.own, w)


@inlined
def enough(own: int, received: int, w: World) -> bool:
    """Return whether more than O_c of the observations that ``w.gate`` names are counted."""
    counted = own if w.gate_counts_current else own - 1
    if w.gate == GATE_OWN:
        return bool(counted > w.min_observations)
    if w.gate == GATE_RECEIVED:
        return bool(received > w.min_observations)
    return bool(counted + received > w.min_observations)


@inlined
def decided(p_below: float, before: int, w: World) -> int:
    """Return d_f by Eq. 13: 0 or 1 if the belief is strictly above p_c on that side, otherwise ``before``."""
    if p_below > w.credible_threshold:  # Eq. 13
        return 0
    if 1.0 - p_below > w.credible_threshold:
        return 1
    return before


@inlined
def decide_once(s: Row, w: World) -> None:
    """Decide by the posterior, if the robot is undecided and has counted enough observations."""
    if s.decision == -1 and is_enough(s, w):
        s.decision = decided(belief_below(s.alpha, s.beta, w), -1, w)
