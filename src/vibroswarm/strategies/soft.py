"""Soft feedback, u^s: a robot sends a random bit, drawn between its reading O and its belief p (Algorithm 3).

| name | symbol | unit | equation |
|---|---|---|---|
| weight | delta | - | exp(-eta Gamma) abs(1/2 - p)^kappa, in [0, 0.5^kappa] (Eq. 18) |
| probability that the message is 1 | - | - | delta (1 - p) + (1 - delta) O (Eq. 16) |

Gamma is the variance of the posterior. With delta = 0 a robot sends O, as without feedback.
"""

from __future__ import annotations

import math
from typing import Annotated, Final

from pydantic import Field

from vibroswarm.core.jit import inner
from vibroswarm.robot.belief import variance
from vibroswarm.strategies.base import Strategy, register
from vibroswarm.strategies.bayes import (
    Row,
    State,
    begin,
    belief,
    decided,
    decision,
    is_enough,
    observe,
    on_counts,
)
from vibroswarm.strategies.world import Draws, Reading, World, belief_below, u

ROUNDING: Final = 1e-12
"""Margin of the shortcut in ``message``, far above the rounding error of a probability."""


class Params:
    """Weights of belief and reading."""

    eta: Annotated[
        float, Field(ge=0, le=1e12, description="How little the belief weighs while the posterior is wide.")
    ] = 1500.0
    kappa: Annotated[
        float, Field(ge=0, le=1e6, description="How little the belief weighs while it is near 1/2.")
    ] = 2.0


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Add the reading to the posterior, decide, and send a random bit, drawn by the reading and the posterior."""
    observe(s, x.reading)
    below = belief_below(s.alpha, s.beta, w)
    if (s.decision == -1 or w.revise) and is_enough(s, w):
        s.decision = decided(below, s.decision, w)
    out.bit = message(x.reading, s.alpha, s.beta, below, p.eta, p.kappa, u(d, 0))
    return True


@inner
def weight(alpha: int, beta: int, belief: float, eta: float, kappa: float) -> float:
    """Return delta (Eq. 18), with ``belief`` for p."""
    delta: float = math.exp(-eta * variance(alpha, beta)) * abs(0.5 - belief) ** kappa  # Eq. 18
    return delta


@inner
def probability(observation: int, alpha: int, beta: int, belief: float, eta: float, kappa: float) -> float:
    """Return the probability that the message is 1 (Eq. 16)."""
    delta = weight(alpha, beta, belief, eta, kappa)
    return delta * (1.0 - belief) + (1.0 - delta) * observation  # Eq. 16


@inner
def message(
    observation: int, alpha: int, beta: int, belief: float, eta: float, kappa: float, u: float
) -> int:
    """Draw the message m, 0 or 1: it is 1 if the uniform number ``u`` lies below ``probability``."""
    # A shortcut: most messages equal O, and are drawn here without an exponential or a power, which take long. The
    # message differs from O with probability delta * doubt (Eq. 16), where ``doubt`` is the belief against O: by the
    # last line, if u < delta * doubt for O = 0, and if 1 - u <= delta * doubt for O = 1. As |1/2 - p| is below 1, delta
    # is at most ``most``: |1/2 - p|^2 for kappa >= 2, |1/2 - p| for kappa >= 1, and 1 for smaller kappa. So beyond most
    # * doubt, with the margin ``ROUNDING``, the last line would return O too.
    distance = abs(0.5 - belief)
    most = distance * distance if kappa >= 2.0 else (distance if kappa >= 1.0 else 1.0)
    doubt = belief if observation == 1 else 1.0 - belief
    if (1.0 - u if observation == 1 else u) > most * doubt + ROUNDING:
        return observation
    return 1 if u < probability(observation, alpha, beta, belief, eta, kappa) else 0


soft = register(
    Strategy(
        name="soft",
        params=Params,
        state=State,
        begin=begin,
        on_counts=on_counts,
        on_sample=on_sample,
        decision=decision,
        belief=belief,
        revises=True,
        boundary_half=True,
        about="soft feedback: a robot sends a bit drawn between its reading and its belief",
    )
)
