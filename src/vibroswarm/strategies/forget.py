"""Forget: no feedback; counts of ones and zeros are forgotten exponentially, for floors that change.

| name | symbol | unit | equation |
|---|---|---|---|
| memory | m | bits | a bit heard or read m bits ago counts as exp(-1) bits; 0: nothing is forgotten |
| ones, zeros | k_1, k_0 | - | at an own sample, with n bits since the own sample before: k exp(-n / m) + those n bits |
| alpha, beta | - | - | prior plus k_1, and plus k_0, rounded to whole numbers |
| decision | d_f | - | as without feedback; it may change if ``decision.revise`` is set |

Counts never exceed about m, so an answer is revised after some m bits. With a memory of 0 it is ``none``, bit by bit.
All bits since a robot's last own sample count alike, so that their order does not matter.

- Message: the reading, as ``none``.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.base import register, strategy_in
from vibroswarm.strategies.bayes import Row, belief, decided, decision, enough
from vibroswarm.strategies.world import Draws, Reading, World, belief_below


class Params:
    """How long bits count."""

    memory: Annotated[
        float,
        Field(ge=0, le=1e9, description="Bits, own and received, after which a bit counts 1/e; 0: for ever."),
    ] = 400.0


class State:
    """Counts that are forgotten, bits since the last own sample, their posterior, and the decision."""

    ones: float
    zeros: float
    new_ones: int
    new_zeros: int
    alpha: int
    beta: int
    own: int
    received: int
    decision: int


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Start with the prior, and undecided."""
    s.alpha, s.beta, s.decision = w.prior_alpha, w.prior_beta, -1


def on_counts(s: Row, ones: int, zeros: int, p: Row, w: World) -> None:
    """Count bits from other robots."""
    add(s, ones, zeros)
    s.received += ones + zeros


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count the reading, forget, decide, and send the reading."""
    add(s, x.reading, 1 - x.reading)
    s.own += 1
    kept = math.exp(-(s.new_ones + s.new_zeros) / p.memory) if p.memory > 0.0 else 1.0
    s.ones, s.zeros = s.ones * kept + s.new_ones, s.zeros * kept + s.new_zeros
    s.new_ones, s.new_zeros = 0, 0
    s.alpha = w.prior_alpha + int(s.ones + 0.5)
    s.beta = w.prior_beta + int(s.zeros + 0.5)
    if (s.decision == -1 or w.revise) and enough(s.own, s.received, w):
        s.decision = decided(belief_below(s.alpha, s.beta, w), s.decision, w)
    out.bit = x.reading
    return True


@inlined
def add(s: Row, ones: int, zeros: int) -> None:
    """Add bits to those since the last own sample, and to the posterior."""
    s.new_ones += ones
    s.new_zeros += zeros
    s.alpha += ones
    s.beta += zeros


forget = register(
    strategy_in(
        __name__,
        "forget",
        belief=belief,
        decision=decision,
        revises=True,
        about="forget: no feedback, and old bits count less and less",
    )
)
