"""The belief that one kind of tile is the most common, given the counts of readings of each kind.

| name | symbol | unit | equation |
|---|---|---|---|
| counts | a_j | - | readings of kind j, own and received, prior included: shares ~ Dirichlet(a_0, ..., a_(k-1)) |
| belief | P_j | - | P(share j is the largest) = integral of g(x; a_j) prod_(i != j) G(x; a_i) dx |

g and G are density and distribution function of a Gamma law of scale 1: shares are Gamma variables over their sum. The
integral is computed by Gauss-Legendre quadrature over +- ``WIDTH`` standard deviations of g.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.robot.belief import HALF_LOG_TAU, SMALL, stirling_rest

WIDTH: Final = 9.0
"""Half of the range of integration, in standard deviations; what lies beyond is below 1e-15."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(96)


@kernel
def most_common_belief(counts: NDArray[np.int64], kind: int) -> float:
    """Return P_j for j = ``kind``; the error is at most 1e-11.

    Args:
        counts: (kinds,), at least 1 each.
    """
    own = counts[kind]
    width = (
        WIDTH * math.sqrt(own) + 2.0 * WIDTH
    )  # the tail of a Gamma law of small shape is longer than a normal one's
    low, high = max(own - width, 0.0), own + width
    half, total = 0.5 * (high - low), 0.0
    for n in range(_NODES.size):
        x = low + half * (1.0 + _NODES[n])
        product = math.exp(log_density(own, x))
        for other in range(counts.size):
            if other != kind:
                product *= gamma_below(counts[other], x)
        total += _WEIGHTS[n] * product
    found: float = min(half * total, 1.0)
    return found


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
