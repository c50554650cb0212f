"""Soft feedback, u^s: a robot says a random bit between reading and belief (Algorithm 3).

| name | symbol | unit | equation |
|---|---|---|---|
| weight | delta | - | exp(-eta Gamma) abs(1/2 - p)^kappa, in [0, 0.5^kappa] (Eq. 13) |
| probability | - | - | delta (1 - p) + (1 - delta) O (Eq. 11) |

With delta = 0 it says O, as no feedback does.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.compiled import inner
from vibroswarm.robot.believe import variance

ROUNDING: Final = 1e-12
"""Far above what rounding does to a probability."""


@inner
def weight(alpha: int, beta: int, belief: float, eta: float, kappa: float) -> float:
    """delta (Eq. 13)."""
    delta: float = math.exp(-eta * variance(alpha, beta)) * abs(0.5 - belief) ** kappa
    return delta


@inner
def probability(observation: int, alpha: int, beta: int, belief: float, eta: float, kappa: float) -> float:
    """Probability that the message is 1 (Eq. 11)."""
    delta = weight(alpha, beta, belief, eta, kappa)
    return delta * (1.0 - belief) + (1.0 - delta) * observation


@inner
def message(
    observation: int, alpha: int, beta: int, belief: float, eta: float, kappa: float, u: float
) -> int:
    """m ~ Bernoulli(probability): 1 where the uniform number lies below it."""
    # Most numbers tell without exponential and power: delta is at most |1/2 - p|^2, |1/2 - p| or 1.
    distance = abs(0.5 - belief)
    most = distance * distance if kappa >= 2.0 else (distance if kappa >= 1.0 else 1.0)
    doubt = belief if observation == 1 else 1.0 - belief
    if (1.0 - u if observation == 1 else u) > most * doubt + ROUNDING:
        return observation
    return 1 if u < probability(observation, alpha, beta, belief, eta, kappa) else 0
