"""The belief that the fill ratio lies below the boundary, given the counts.

| name | symbol | unit | equation |
|---|---|---|---|
| alpha, beta | alpha, beta | - | counts of ones and zeros, own and received, prior included (Eq. 10, 11) |
| boundary | x | - | 0.5 in the paper |
| belief | p | - | P(f < x) = I_x(alpha, beta) (Eq. 12) |
| variance | Gamma | - | alpha beta / ((alpha+beta)^2 (alpha+beta+1)) (Eq. 17) |

For whole alpha and beta, with n = alpha + beta, the belief is the upper tail of a binomial distribution:

    I_x(a, b) = P(K >= a),  K ~ Binomial(n - 1, x),    P(K = a) = x^a (1-x)^(b-1) / (a B(a, b))

Of the two tails of the distribution, the smaller one is summed, from its largest term on. All terms are positive, so no
digits are lost by subtraction. The belief is computed afresh from the counts at each sample, so errors do not
accumulate. The first term is computed from its logarithm, in Stirling's form, in which no two large numbers are
subtracted.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import kernel

SURE: Final = 21.0
"""If alpha differs from boundary * n, n = alpha + beta, by more than sqrt(SURE n), the smaller tail of the distribution
is below exp(-2 SURE) = 6e-19 by Hoeffding's inequality."""
SMALL: Final = 1e-17
"""Terms below this share of the sum are neglected."""
HALF_LOG_TAU: Final = 0.5 * math.log(2.0 * math.pi)
"""The constant ln(2 pi) / 2 of Stirling's formula."""


@kernel
def belief_below(alpha: int, beta: int, boundary: float) -> float:
    """Return p = P(f < boundary) for f ~ Beta(alpha, beta), integers alpha, beta >= 1, 0 < boundary < 1 (Eq. 12)."""
    if alpha == beta and boundary == 0.5:
        return 0.5  # exactly, so that a robot never decides on equal counts, however low its credible threshold is
    gap = alpha - boundary * (alpha + beta)
    # Here the smaller tail is below 6e-19 (see SURE), so that p is 0 or 1 in double precision.
    if gap * gap > SURE * (alpha + beta):
        return 0.0 if gap > 0.0 else 1.0
    if gap > 0.0:
        return upper_tail(alpha, beta, boundary)
    return 1.0 - upper_tail(beta, alpha, 1.0 - boundary)


@kernel
def upper_tail(a: int, b: int, x: float) -> float:
    """Return I_x(a, b) = P(K >= a), K ~ Binomial(a + b - 1, x), for a / (a + b) >= x.

    P(K = k) then falls from k = a on, so the sum from k = a upwards ends at the first negligible term.
    """
    odds = x / (1.0 - x)
    term = math.exp(log_term(a, b, x)) / (a * (1.0 - x))  # P(K = a), as in the module's docstring
    total, left, right = 0.0, b - 1, a + 1
    while term > SMALL * total:
        total += term
        term *= odds * left / right  # from P(K = k) to P(K = k + 1)
        left -= 1  # 0 at the last k, a + b - 1: the next term is 0, so the sum ends there at the latest
        right += 1
    return min(total, 1.0)  # rounding must not give a probability above 1


@kernel
def log_term(a: int, b: int, x: float) -> float:
    """Return ln [x^a (1-x)^b / B(a, b)], with B by Stirling's formula and the formula's errors added."""
    n = float(a + b)
    gap = a - x * n
    # By Stirling's formula the logarithm has its maximum ``height`` at x = a / n, and is lower by ``shape`` at another
    # x. ``stirling_rest`` is the formula's error for n, a and b; with these three added the result is exact.
    shape = a * math.log1p(gap / (x * n)) + b * math.log1p(-gap / ((1.0 - x) * n))
    height = 0.5 * math.log(a * (b / n)) - HALF_LOG_TAU
    return height - shape + stirling_rest(n) - stirling_rest(float(a)) - stirling_rest(float(b))


@kernel
def stirling_rest(z: float) -> float:
    """Return the error of Stirling's formula, ln Gamma(z) - [(z - 1/2) ln z - z + ln(2 pi) / 2], to 1e-13."""
    if z < 16.0:
        return math.lgamma(z) - ((z - 0.5) * math.log(z) - z + HALF_LOG_TAU)
    square = z * z  # from z = 16 on, four terms of Stirling's series in 1 / z are as exact, and cheaper
    return (1 / 12 - (1 / 360 - (1 / 1260 - 1 / (1680 * square)) / square) / square) / z


@kernel
def variance(alpha: int, beta: int) -> float:
    """Return Gamma, the variance of Beta(alpha, beta) (Eq. 17)."""
    total = float(alpha + beta)
    return alpha * beta / (total * total * (total + 1.0))  # Eq. 17
