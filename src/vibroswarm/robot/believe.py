"""The Beta posterior of the fill ratio and the belief that it lies below the boundary.

| name | symbol | unit | equation |
|---|---|---|---|
| alpha, beta | alpha, beta | - | counts of ones and zeros heard, prior included (Eq. 7, 8) |
| boundary | x | - | 0.5 in the paper |
| belief | p | - | P(f < x) = I_x(alpha, beta) (Eq. 9) |
| log_term | L | - | ln [x^alpha (1-x)^beta / B(alpha, beta)] |
| variance | Gamma | - | alpha beta / ((alpha+beta)^2 (alpha+beta+1)) (Eq. 12) |

For whole alpha and beta each update adds or takes one term:

    I_x(a+1, b) = I_x(a, b) - e^L / a,    L(a+1, b) = L + ln x     + ln((a+b)/a)
    I_x(a, b+1) = I_x(a, b) + e^L / b,    L(a, b+1) = L + ln (1-x) + ln((a+b)/b)

The logarithm of the term is carried, not the term: that one underflows on one-sided runs that turn round. Between
two samples, some bits, the term itself is carried on from e^L, which costs no logarithm.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vibroswarm.compiled import kernel

STRETCH: Final = 32
"""Steps for which the term is carried as a product."""


class Posterior(NamedTuple):
    """Beta(alpha, beta), and the belief p = P(f < boundary)."""

    alpha: int
    beta: int
    belief: float
    log_term: float


@kernel
def prior(alpha: int, beta: int, boundary: float) -> Posterior:
    """Beta(alpha, beta) for whole alpha, beta >= 1, reached from Beta(1, 1), at which p = x."""
    first = Posterior(1, 1, boundary, math.log(boundary) + math.log1p(-boundary))
    return observe_all(first, alpha - 1, beta - 1, boundary)


@kernel
def observe(posterior: Posterior, bit: int, boundary: float) -> Posterior:
    """The posterior after one more bit, own or received (Eq. 7, 8)."""
    return observe_all(posterior, bit, 1 - bit, boundary)


@kernel
def observe_all(posterior: Posterior, ones: int, zeros: int, boundary: float) -> Posterior:
    """The posterior after so many more ones and zeros; the same as one by one, but for rounding.

    Within a stretch of steps e^L is carried as a product, and one logarithm takes the stretch into L.
    """
    alpha, beta, belief, log_term = posterior
    term, ratio = math.exp(log_term), 1.0
    for step in range(ones + zeros):
        total = alpha + beta
        if step < ones:
            belief -= term / alpha
            factor = boundary * total / alpha
            alpha += 1
        else:
            belief += term / beta
            factor = (1.0 - boundary) * total / beta
            beta += 1
        term *= factor
        ratio *= factor
        if step % STRETCH == STRETCH - 1:
            log_term += math.log(ratio)
            term, ratio = math.exp(log_term), 1.0
    # Rounding may step over an end by some 1e-16.
    return Posterior(alpha, beta, min(max(belief, 0.0), 1.0), log_term + math.log(ratio))


@kernel
def variance(alpha: int, beta: int) -> float:
    """Gamma, the variance of Beta(alpha, beta) (Eq. 12)."""
    total = float(alpha + beta)
    return alpha * beta / (total * total * (total + 1.0))
