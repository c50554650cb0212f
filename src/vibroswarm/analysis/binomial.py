"""Tails of the binomial law, without ``scipy.stats``, whose import takes longer than many a run.

| symbol | name | what it is |
|---|---|---|
| K | - | number of ones among n independent samples, each 1 with probability q |
| n | ``samples`` | at least 1 |
| q | ``share`` | |
| k | ``count`` | whole number; may be below 0 or above n |

P(K > k) = I_q(k + 1, n - k) for 0 <= k < n, with the regularised incomplete beta function I.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betainc, betaincc

Values = NDArray[np.float64]


def probability_at_most(count: ArrayLike, samples: ArrayLike, share: float) -> Values:
    """Compute P(K <= k) for each count k and number of samples n; the arguments are broadcast."""
    k, n = np.asarray(count, dtype=float), np.asarray(samples, dtype=float)
    inside = np.clip(k, 0.0, n - 1.0)  # where the formula holds
    tail = betaincc(inside + 1.0, n - inside, share)
    return np.where(k < 0.0, 0.0, np.where(k >= n, 1.0, tail))


def probability_above(count: ArrayLike, samples: ArrayLike, share: float) -> Values:
    """Compute P(K > k) for each count k and number of samples n; the arguments are broadcast."""
    k, n = np.asarray(count, dtype=float), np.asarray(samples, dtype=float)
    inside = np.clip(k, 0.0, n - 1.0)  # where the formula holds
    tail = betainc(inside + 1.0, n - inside, share)
    return np.where(k < 0.0, 1.0, np.where(k >= n, 0.0, tail))
