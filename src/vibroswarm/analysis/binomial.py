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

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betainc, betaincc

Values = NDArray[np.float64]


def probability_at_most(count: ArrayLike, samples: ArrayLike, share: float) -> Values:
    """Compute P(K <= k) for each count k and number of samples n; the arguments are broadcast."""
    return _tail(betaincc, count, samples, share, of_none=0.0)


def probability_above(count: ArrayLike, samples: ArrayLike, share: float) -> Values:
    """Compute P(K > k) for each count k and number of samples n; the arguments are broadcast."""
    return _tail(betainc, count, samples, share, of_none=1.0)


def _tail(
    function: Callable[..., Values], count: ArrayLike, samples: ArrayLike, share: float, of_none: float
) -> Values:
    """Compute a tail by one of the two beta functions; ``of_none``: its value at counts below 0."""
    k, n = np.asarray(count, dtype=float), np.asarray(samples, dtype=float)
    inside = np.clip(k, 0.0, n - 1.0)  # where the formula holds
    tail = function(inside + 1.0, n - inside, share)
    return np.where(k < 0.0, of_none, np.where(k >= n, 1.0 - of_none, tail))
