"""DBBS, distributed Bayesian belief sharing: a robot sends its own and its social belief separately.

Shan and Mostaghim 2021, Swarm Intelligence 15, "Discrete collective estimation in swarm robotics with distributed
Bayesian belief sharing"; rules as in the author's public code.

| name | symbol | unit | equation |
|---|---|---|---|
| hypotheses | f_h | - | (h + 1/2) / H, h = 0 to H - 1; H = 10 in the author's code |
| likelihood | l_h | - | P(1 at f_h) = FP + (1 - FP - FN) f_h; f_h in the original |
| own belief | S_h | - | flat at first; a reading of 1 makes it S_h l_h, a reading of 0 S_h (1 - l_h), normalised |
| social belief | N_h | - | flat at first; beliefs of a robot j make it N_h^lambda S_jh N_jh^mu, normalised |
| decay_own, decay_other | lambda, mu | - | 0.8 and 0.4 in the author's script |
| memory | L | - | readings after which a robot's beliefs may be used again; 10 for 20 robots in the author's script |
| belief | p | - | share of S_h N_h at hypotheses below the boundary, and half of that at it (not in the original) |

At each reading a robot draws one of the robots that it has heard since its last reading. It updates its social belief
by the beliefs of that robot, unless it used that robot within the last L readings.

S and N are products of powers of l_h and 1 - l_h, and so are all their products and powers: S has the exponents
``ones`` and ``zeros``, N has ``social_ones`` and ``social_zeros``. So four exponents replace 2 H numbers, and no number
underflows.

- Message: ones, zeros (2 bytes each), exponents of N (4 bytes each) and the sender (1 byte): 13 bytes. The original
  sends 2 H numbers: 80 bytes at H = 10.
- What a robot knows of its task: its error rates, if ``decision.boundary_of`` is "tiles".
- Differences from the original: each robot hears all others; beliefs are updated at each reading instead of each
  second; L = 2 for five robots. In the original a robot decides for the largest S_h N_h, and an observer checks
  whether a given share of the robots agree. Here a robot decides once, if p > p_c or 1 - p > p_c, and if more than O_c
  observations are counted, where each message counts as one.
- With lambda + mu > 1 the exponents of N grow at every step (at most to 1e12), and early readings weigh most.
"""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import array, strategy_in, u
from vibroswarm.strategies.bayes import decided, decision, enough

__all__ = ["dbbs", "decision"]

LARGEST = 1e12
"""Limit of the sum of both social exponents. At this sum one hypothesis has all of the belief; without a limit the
exponents would overflow."""


class Params:
    """Hypotheses and decays."""

    hypotheses: Annotated[
        int, Field(ge=2, le=1000, description="Number of hypotheses of the fill ratio.")
    ] = 10
    decay_own: Annotated[float, Field(ge=0, le=1, description="Power of the own social belief (lambda).")] = (
        0.8
    )
    decay_other: Annotated[
        float, Field(ge=0, le=1, description="Power of the other robot's social belief (mu).")
    ] = 0.4
    memory: Annotated[
        int,
        Field(
            ge=0,
            le=100_000,
            description="Steps for which a robot is not chosen again (L).",
        ),
    ] = 2


class State:
    """Exponents of both beliefs, the belief after the last reading, and the decision."""

    ones: int
    zeros: int
    social_ones: float
    social_zeros: float
    received: int
    heard: int
    below: float
    decision: int


class Arrays:
    """The latest message of each robot, whether it came since the last reading (1), and the number of the own reading
    at which it was last used (0: never)."""

    is_new = array("uint8", "robots")
    taken = array("int64", "robots")
    ones = array("float64", "robots")
    zeros = array("float64", "robots")
    social_ones = array("float64", "robots")
    social_zeros = array("float64", "robots")


class Message:
    """Exponents of the own and of the social belief."""

    ones: int
    zeros: int
    social_ones: float
    social_zeros: float


def opposite(m):
    """Swap ones and zeros in both beliefs, for a robot with the fault ``opposite``."""
    m.ones, m.zeros = m.zeros, m.ones
    m.social_ones, m.social_zeros = m.social_zeros, m.social_ones


def begin(s, a, d, p, w):
    """Set flat beliefs, undecided."""
    s.below, s.decision = 0.5, -1


def on_message(s, a, m, sender, t_s, d, p, w):
    """Store the beliefs in the message as the latest ones of the sender.

    ``a.is_new`` marks the senders that this robot has heard since its last reading. ``s.heard`` is the number of these
    senders: a sender heard twice is counted once.
    """
    s.received += 1
    s.heard += 1 - a.is_new[sender]
    a.is_new[sender] = 1
    a.ones[sender], a.zeros[sender] = m.ones, m.zeros
    a.social_ones[sender], a.social_zeros[sender] = m.social_ones, m.social_zeros


def on_sample(s, a, x, out, d, p, w):
    """Update both beliefs, decide, and send both beliefs as exponents.

    The own belief is updated by the reading, the social belief by the beliefs of one robot j drawn from those heard
    since the last reading, if j was not used within the last ``memory`` readings.
    """
    s.ones += x.reading
    s.zeros += 1 - x.reading
    # step: number of own readings; j: the robot drawn, -1 if no robot was heard; taken[j]: the step at which robot j
    # was last used, 0 if never.
    step, j = s.ones + s.zeros, drawn_of(a.is_new, s.heard, u(d, 0))
    s.heard = 0
    if j >= 0 and (a.taken[j] == 0 or step - a.taken[j] > p.memory):
        a.taken[j] = step
        s.social_ones = p.decay_own * s.social_ones + a.ones[j] + p.decay_other * a.social_ones[j]
        s.social_zeros = p.decay_own * s.social_zeros + a.zeros[j] + p.decay_other * a.social_zeros[j]
        limit_exponents(s)
    # The product of both beliefs has the sums of their exponents.
    s.below = mass_below(
        s.ones + s.social_ones, s.zeros + s.social_zeros, p.hypotheses, w.decision_boundary, w.false_positive,
        w.false_negative,
    )  # fmt: skip
    if s.decision == -1 and enough(s.ones + s.zeros, s.received, w):
        s.decision = decided(s.below, -1, w)
    out.ones, out.zeros, out.social_ones, out.social_zeros = s.ones, s.zeros, s.social_ones, s.social_zeros
    return True


def belief(s, a, p, w):
    """Return p, the belief that f is below the boundary, after the last reading."""
    found: float = s.below
    return found


def limit_exponents(s):
    """Scale both social exponents down to a sum of ``LARGEST``, if their sum is larger."""
    total = s.social_ones + s.social_zeros
    if total > LARGEST:
        s.social_ones *= LARGEST / total
        s.social_zeros *= LARGEST / total


def drawn_of(is_new, count, number):
    """Draw one of the robots heard since the last reading, and set all of ``is_new`` to 0.

    Args:
        is_new: (robots,), 1 for robots heard since the last reading. count: number of these robots. number: uniform
            number in (0, 1).
    Returns:
        The robot's number; -1 if no robot was heard.
    """
    # wanted: position among the robots heard. min() is there because number * count may be rounded up to ``count``. If
    # no robot was heard, no entry of ``is_new`` is 1, and ``drawn`` stays -1.
    wanted, drawn = min(int(number * count), count - 1), -1
    for j in range(is_new.size):
        if is_new[j] == 1:
            if wanted == 0:
                drawn = j
            wanted -= 1
            is_new[j] = 0
    return drawn


def log_belief(ones, zeros, fill, false_positive, false_negative):
    """Return the logarithm of the belief in a fill ratio in (0, 1), before normalising.

    It is finite, because the error rates of a scenario sum to less than 1, and so the likelihood is in (0, 1) too.
    """
    likelihood = false_positive + (1.0 - false_positive - false_negative) * fill
    return ones * math.log(likelihood) + zeros * math.log1p(-likelihood)


def mass_below(ones, zeros, hypotheses, boundary, false_positive, false_negative):
    """Return p: the share of the belief at hypotheses below the boundary, and half of that at the boundary itself.

    Args:
        ones, zeros: exponents of the belief. hypotheses: H.
    """
    # Beliefs are taken relative to the largest, so that exp() does not underflow for all hypotheses.
    most = -math.inf
    for h in range(hypotheses):
        most = max(most, log_belief(ones, zeros, (h + 0.5) / hypotheses, false_positive, false_negative))
    below, total = 0.0, 0.0
    for h in range(hypotheses):
        fill = (h + 0.5) / hypotheses
        mass = math.exp(log_belief(ones, zeros, fill, false_positive, false_negative) - most)
        total += mass
        if fill < boundary:
            below += mass
        elif fill == boundary:
            below += 0.5 * mass
    return below / total


dbbs = strategy_in(
    __name__,
    "dbbs",
    bytes_on_air=13,
    about="DBBS: a robot sends its own belief and its social belief, apart",
)
