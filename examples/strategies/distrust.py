"""Distrust: no feedback; a robot leaves out senders whose bits are too improbable. It needs no places of samples.

A robot counts the bits of each source separately; a source is a sender, or the robot's own sensor. At each own reading
it compares each source with all others together. If the source's number of ones is too improbable under the posterior
of the others, the source is left out. This is repeated, with the most improbable source first, until no source is too
improbable. The strategy is our own; it assumes that most sources are right.

| name | symbol | unit | equation |
|---|---|---|---|
| source | k, n | - | ones and bits of one sender, or of the own sensor |
| others | a, b | - | prior plus ones, and plus zeros, of all other sources that are not left out |
| probability | P(K = k) | - | C(n, k) B(a + k, b + n - k) / B(a, b): beta-binomial, given the others |
| tail | q | - | min(1, 2 P(K >= k)) for k at or above the mean n a / (a + b), min(1, 2 P(K <= k)) below; exact |
| left out | - | - | the source of the least q, if q < threshold; then all remaining sources are compared again |
| alpha, beta | - | - | prior plus ones, and plus zeros, of the sources not left out |

Samples of one robot lie side by side, so its bits are correlated, and sources that are right differ by more than
chance. The threshold must therefore be far below the usual levels of significance.

- It removes stuck sensors, up to two of five. Against a bias of ten points, or opposite bits near a fill ratio of 1/2,
  it does nothing. With one of five stuck at 1, at 0.48, 6 % are wrong and 51 % undecided; with ``none`` all are wrong.
- With the default threshold wait for 200 observations or more (``decision.min_observations``); a rule that decides
  after fewer needs a higher threshold.
- It costs 0 to 0.5 points of errors where nobody is faulty, most on floors with large clusters, and two to three times
  the CPU; in large swarms more.

vibroswarm run --strategy examples/strategies/distrust.py:distrust --set faults.stuck_at_1=0.2
"""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import array, belief_below, strategy_in
from vibroswarm.strategies.bayes import belief, decided, decision, enough

__all__ = ["belief", "decision", "distrust"]

SMALL = 1e-17
"""A sum stops at the first term below this share of it: smaller terms do not change a double."""


class Params:
    """When a source is left out."""

    threshold: Annotated[
        float,
        Field(
            ge=0, le=1, description="A sender is ignored if its bits are less probable than this; 0: none is."
        ),
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


def begin(s, a, d, p, w):
    """Start with the prior, and undecided."""
    s.alpha, s.beta, s.decision = w.prior_alpha, w.prior_beta, -1


def on_message(s, a, m, sender, t_s, d, p, w):
    """Count the sender's bit; add it to the posterior too, unless the sender is left out at present.

    Counts of a sender left out are kept, because the next ``weigh`` compares all sources again.
    """
    a.ones[sender] += m.bit
    a.bits[sender] += 1
    if a.is_out[sender] == 0:
        s.alpha += m.bit
        s.beta += 1 - m.bit


def on_sample(s, a, x, out, d, p, w):
    """Count the reading, leave out improbable sources, decide, and send the reading."""
    s.own += 1
    a.ones[w.robot] += x.reading
    a.bits[w.robot] += 1
    weigh(s, a.ones, a.bits, a.is_out, p.threshold, w)
    if s.decision == -1:
        # Only observations of sources that are not left out count. The own sensor is one of the sources. The posterior
        # without its prior is the number of these observations; without the own readings, it is the number of bits
        # received.
        own = s.own if a.is_out[w.robot] == 0 else 0
        received = s.alpha + s.beta - w.prior_alpha - w.prior_beta - own
        # ``enough`` leaves out the current reading, which is not counted if the own sensor is left out.
        if enough(max(own, 1 - w.gate_counts_current), received, w):
            s.decision = decided(belief_below(s.alpha, s.beta, w), -1, w)
    out.bit = x.reading
    return True


def weigh(s, ones, bits, is_out, threshold, w):
    """Decide anew which sources are left out, and set the posterior to the prior plus the bits of all other sources.

    Args:
        s: its ``alpha``, ``beta`` and ``left_out``, the number of sources left out, are set. ones, bits: (robots,),
            numbers of ones and of bits of each source. is_out: (robots,), set to 1 for the sources left out and to 0
            for the others. threshold: a source is left out if its tail q is below this.
    """
    s.alpha, s.beta, s.left_out = w.prior_alpha, w.prior_beta, 0
    for j in range(bits.size):
        is_out[j] = 0
        s.alpha += ones[j]
        s.beta += bits[j] - ones[j]
    while True:
        # Find the source ``worst`` with the least tail, if that is below the threshold. Source j is compared with the
        # posterior of all other sources that are not left out: s.alpha and s.beta without the bits of j. If no other is
        # left, that is the prior. Sources without bits are skipped: their tail is 1.
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


def two_sided_tail(k, n, a, b):
    """Return q, twice the probability of k or a value farther from the mean on the same side, at most 1.

    Args:
        k, n: ones and bits of the source. a, b: prior plus ones, and plus zeros, of the other sources.
    """
    # Below the mean, P(ones <= k) is P(zeros >= n - k), so zeros and ones are exchanged.
    tail = upper_tail(k, n, a, b) if k * (a + b) >= n * a else upper_tail(n - k, n, b, a)
    return min(1.0, 2.0 * tail)


def upper_tail(k, n, a, b):
    """Return P(K >= k) for k at or above the mean, where terms fall from k on, so that the sum may stop early.

    ``k``, ``n``, ``a`` and ``b`` are those of the table; a, b >= 1. The result is 0 if P(K = k) is too small for a
    double.
    """
    term, total = math.exp(log_probability(k, n, a, b)), 0.0
    while term > SMALL * total:
        total += term
        if k == n:
            break
        # P(K = k + 1) / P(K = k)
        term *= (n - k) * (a + k) / ((k + 1.0) * (b + n - k - 1.0))
        k += 1
    return total


def log_probability(k, n, a, b):
    """Return ln P(K = k) of the beta-binomial law, with k, n, a and b as in the table."""
    choose = math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0)
    # "+ 0.0" turns the integers into floating-point numbers, which lgamma() takes.
    given = math.lgamma(a + b + 0.0) - math.lgamma(a + 0.0) - math.lgamma(b + 0.0)
    return (
        choose
        + given
        + math.lgamma(a + k + 0.0)
        + math.lgamma(b + n - k + 0.0)
        - math.lgamma(a + b + n + 0.0)
    )


distrust = strategy_in(
    __name__,
    "distrust",
    bytes_on_air=2,
    reports=("left_out", "is_out"),
    about="distrust: a robot sends its reading, and leaves out senders whose bits are too improbable",
)
