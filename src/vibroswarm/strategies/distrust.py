"""Distrust: no feedback, but bits of senders that are too improbable are left out; no place is needed.

A robot keeps the bits of each sender apart, its own readings among them. Before it decides it compares each source with
all others together: if so few or so many ones are too improbable under the posterior of the others, the source is left
out, the most improbable first, until none is. Ours; it assumes that most sources are right.

| name | symbol | unit | equation |
|---|---|---|---|
| source | k, n | - | ones and bits of one sender, or of the own sensor |
| others | a, b | - | prior plus ones, zeros of all other sources not left out |
| probability | P(K = k) | - | C(n, k) B(a + k, b + n - k) / B(a, b): beta-binomial |
| tail | q | - | min(1, 2 P(K >= k)) for k at or above the mean n a / (a + b), min(1, 2 P(K <= k)) below; exact |
| left out | - | - | the source of the least q, if q < threshold; then all remaining ones are compared anew |
| alpha, beta | - | - | prior plus ones, zeros of the sources not left out |

Bits of one robot are alike because its samples lie side by side, so that sources that are right differ by more than
chance. The threshold is to be far below the usual levels of tests; docs/faults.md says what it costs.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Final

from pydantic import Field

from vibroswarm.core.jit import inlined, inner
from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import belief, decided, decision, enough
from vibroswarm.strategies.world import Draws, Reading, World, belief_below

__all__ = ["belief", "decision", "distrust"]
Row = Any

SMALL: Final = 1e-17
"""Terms below this share of a sum are neglected."""


class Params:
    """When a source is left out."""

    threshold: Annotated[
        float,
        Field(ge=0, le=1, description="A source is left out if its bits are less probable; 0: none is."),
    ] = 1e-6


class State:
    """Posterior of the sources not left out, decision, and number of sources left out."""

    alpha: int
    beta: int
    decision: int
    own: int
    left_out: int


class Arrays:
    """Ones and bits of each robot, the own among them, and whether it is left out."""

    ones = array("int64", "robots")
    bits = array("int64", "robots")
    is_out = array("uint8", "robots")


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Set the prior, undecided."""
    s.alpha, s.beta, s.decision = w.prior_alpha, w.prior_beta, -1


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Count the sender's bit; those of a sender that is left out wait."""
    a.ones[sender] += m.bit
    a.bits[sender] += 1
    if a.is_out[sender] == 0:
        s.alpha += m.bit
        s.beta += 1 - m.bit


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count, leave out, decide, and send the reading."""
    s.own += 1
    a.ones[w.robot] += x.reading
    a.bits[w.robot] += 1
    weigh(s, a.ones, a.bits, a.is_out, p.threshold, w)
    if s.decision == -1:
        own = s.own if a.is_out[w.robot] == 0 else 0
        if enough(own, s.alpha + s.beta - w.prior_alpha - w.prior_beta - own, w):
            s.decision = decided(belief_below(s.alpha, s.beta, w), -1, w)
    out.bit = x.reading
    return True


@inlined
def weigh(s: Row, ones: Row, bits: Row, is_out: Row, threshold: float, w: World) -> None:
    """Leave out the sources that are too improbable, and set the posterior to that of the others."""
    s.alpha, s.beta, s.left_out = w.prior_alpha, w.prior_beta, 0
    for j in range(bits.size):
        is_out[j] = 0
        s.alpha += ones[j]
        s.beta += bits[j] - ones[j]
    while True:
        least, worst = threshold, -1
        for j in range(bits.size):
            if is_out[j] == 0 and bits[j] > 0:
                zeros = bits[j] - ones[j]
                tail = two_sided_tail(ones[j], bits[j], s.alpha - ones[j], s.beta - zeros)
                if tail < least:
                    least, worst = tail, j
        if worst < 0:
            break
        is_out[worst] = 1
        s.left_out += 1
        s.alpha -= ones[worst]
        s.beta -= bits[worst] - ones[worst]


@inner
def two_sided_tail(k: int, n: int, a: int, b: int) -> float:
    """Return q, twice the tail on the side of the mean on which k lies, for n bits and Beta(a, b)."""
    tail = upper_tail(k, n, a, b) if k * (a + b) >= n * a else upper_tail(n - k, n, b, a)
    return min(1.0, 2.0 * tail)


@inner
def upper_tail(k: int, n: int, a: int, b: int) -> float:
    """Return P(K >= k), summed term by term, for k at or above the mean and a, b >= 1."""
    term, total = math.exp(log_probability(k, n, a, b)), 0.0
    while term > SMALL * total:
        total += term
        if k == n:
            break
        term *= (n - k) * (a + k) / ((k + 1.0) * (b + n - k - 1.0))
        k += 1
    return total


@inner
def log_probability(k: int, n: int, a: int, b: int) -> float:
    """Return ln P(K = k)."""
    choose = math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0)
    given = math.lgamma(a + b + 0.0) - math.lgamma(a + 0.0) - math.lgamma(b + 0.0)
    return (
        choose
        + given
        + math.lgamma(a + k + 0.0)
        + math.lgamma(b + n - k + 0.0)
        - math.lgamma(a + b + n + 0.0)
    )


distrust = register(
    strategy_in(
        __name__,
        "distrust",
        bytes_on_air=2,
        about="distrust: a robot sends its reading, and leaves out senders whose bits are too improbable",
    )
)
