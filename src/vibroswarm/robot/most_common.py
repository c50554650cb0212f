"""The belief that one kind of tile is the most common, given the counts of readings of each kind.

| name | symbol | unit | equation |
|---|---|---|---|
| counts | a_j | - | readings of kind j, own and received, prior included: shares ~ Dirichlet(a_0, ..., a_(k-1)) |
| belief | P_j | - | P(share j is the largest) = integral of g(x; a_j) prod_(i != j) G(x; a_i) dx |

g and G are density and distribution function of a Gamma law of scale 1: shares are Gamma variables over their sum. The
integral over t = ln x is a sum over equal steps h. Its terms are analytic, and fall off on both sides at least as an
exponential function, so that the error falls off exponentially as h gets smaller.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vibroswarm.core.jit import kernel
from vibroswarm.robot.belief import HALF_LOG_TAU, SMALL, stirling_rest

STEP: Final = 0.35
"""Longest step of the sum, in standard deviations of ln x."""
WIDEST: Final = 0.15
"""Longest step of the sum, for small counts."""


@kernel
def most_common_belief(counts: Any, kind: int) -> float:
    """Return P_j for j = ``kind``; the error is at most 1e-12."""
    own = counts[kind]
    step, middle = min(STEP / math.sqrt(own), WIDEST), math.log(own)
    total = density_and_largest(counts, kind, middle)
    for direction in range(-1, 2, 2):
        # From the middle to both sides the terms fall, or first grow and then fall.
        at, term = middle, total
        while term > SMALL * total:
            at += direction * step
            term = density_and_largest(counts, kind, at)
            total += term
    found: float = min(step * total, 1.0)
    return found


@kernel
def density_and_largest(counts: Any, kind: int, log_x: float) -> float:
    """Return the density of ln x for the variable of ``kind``, times the probability that all others are below x."""
    x = math.exp(log_x)
    product = math.exp(log_density(counts[kind], x)) * x
    for other in range(counts.size):
        if other != kind:
            product *= gamma_below(counts[other], x)
    return product


@kernel
def log_density(a: int, x: float) -> float:
    """Return ln of the density of a Gamma law of shape ``a`` and scale 1 at x > 0, without loss for large ``a``."""
    z = float(a)
    # (a - 1) ln x - x - ln Gamma(a), with Stirling's formula for the last term.
    return (
        z * math.log1p((x - z) / z)
        - (x - z)
        - math.log(x)
        + 0.5 * math.log(z)
        - HALF_LOG_TAU
        - stirling_rest(z)
    )


@kernel
def gamma_below(a: int, x: float) -> float:
    """Return the probability that a Gamma variable of shape ``a`` and scale 1 is below x, for whole a >= 1.

    It is P(N >= a) for N ~ Poisson(x). Of its two tails the smaller is summed, from its largest term on.
    """
    if x <= 0.0:
        return 0.0
    term = math.exp(log_density(a, x)) * x / a  # P(N = a)
    total = 0.0
    if x < a:  # P(N >= a)
        above = a
        while term > SMALL * total:
            total += term
            above += 1
            term *= x / above
        return total
    below = a  # P(N < a), from P(N = a - 1) down
    term *= below / x
    while term > SMALL * total:
        total += term
        below -= 1
        term *= below / x  # 0 below N = 0, where the sum ends at the latest
    return 1.0 - total
