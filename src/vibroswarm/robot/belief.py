"""The belief that the fill ratio lies below the boundary, given the counts.

| name | symbol | unit | equation |
|---|---|---|---|
| alpha, beta | alpha, beta | - | counts of ones and zeros, own and received, prior included (Eq. 10, 11) |
| boundary | x | - | 0.5 in the paper |
| belief | p | - | P(f < x) = I_x(alpha, beta) (Eq. 12) |
| variance | Gamma | - | alpha beta / ((alpha+beta)^2 (alpha+beta+1)) (Eq. 17) |

For whole alpha and beta, with n = alpha + beta, the belief is the upper tail of a binomial distribution:

    I_x(a, b) = P(K >= a),  K ~ Binomial(n - 1, x),    P(K = a) = x^a (1-x)^(b-1) / (a B(a, b))

It is summed from its largest term on, on the side where that is a small tail: all terms are positive, so that
no digit is lost, and nothing is carried from one sample to the next, so that nothing drifts. The first term comes
from its logarithm, in Stirling's form, in which no two large numbers are subtracted.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import kernel

SURE: Final = 21.0
"""Counts further than sqrt(SURE n) from the boundary leave a doubt below exp(-2 SURE) = 6e-19 (Hoeffding)."""
SMALL: Final = 1e-17
"""Terms below this share of the sum are neglected."""
HALF_LOG_TAU: Final = 0.5 * math.log(2.0 * math.pi)


@kernel
def belief_below(alpha: int, beta: int, boundary: float) -> float:
    """Return p = P(f < boundary) for f ~ Beta(alpha, beta), integers alpha, beta >= 1, 0 < boundary < 1 (Eq. 12).

    Takes some sqrt(alpha + beta) steps; accurate to 1e-12 or better.
    """
    if alpha == beta and boundary == 0.5:
        return 0.5  # exactly, so that it never decides, whatever p_c
    gap = alpha - boundary * (alpha + beta)
    if gap * gap > SURE * (alpha + beta):
        return 0.0 if gap > 0.0 else 1.0
    if gap > 0.0:
        return upper_tail(alpha, beta, boundary)
    return 1.0 - upper_tail(beta, alpha, 1.0 - boundary)


@kernel
def upper_tail(a: int, b: int, x: float) -> float:
    """Return I_x(a, b) for a / (a + b) of about x or more: the terms of the binomial distribution from a on."""
    odds = x / (1.0 - x)
    term = math.exp(log_term(a, b, x)) / (a * (1.0 - x))
    total, left, right = 0.0, b - 1, a + 1
    while term > SMALL * total:
        total += term
        term *= odds * left / right
        left -= 1
        right += 1
    return min(total, 1.0)


@kernel
def log_term(a: int, b: int, x: float) -> float:
    """Return ln [x^a (1-x)^b / B(a, b)]."""
    n = float(a + b)
    gap = a - x * n
    shape = a * math.log1p(gap / (x * n)) + b * math.log1p(-gap / ((1.0 - x) * n))
    height = 0.5 * math.log(a * (b / n)) - HALF_LOG_TAU
    return height - shape + stirling_rest(n) - stirling_rest(float(a)) - stirling_rest(float(b))


@kernel
def stirling_rest(z: float) -> float:
    """Return ln Gamma(z) - [(z - 1/2) ln z - z + ln(2 pi) / 2], to 1e-13."""
    if z < 16.0:
        return math.lgamma(z) - ((z - 0.5) * math.log(z) - z + HALF_LOG_TAU)
    square = z * z
    return (1 / 12 - (1 / 360 - (1 / 1260 - 1 / (1680 * square)) / square) / square) / z


@kernel
def variance(alpha: int, beta: int) -> float:
    """Return Gamma, the variance of Beta(alpha, beta) (Eq. 17)."""
    total = float(alpha + beta)
    return alpha * beta / (total * total * (total + 1.0))  # Eq. 17
