"""MCP, minimalistic collective perception: a robot sends its estimate of the fill ratio, and its confidence in it.

Chin, Khaluf and Pinciroli 2023, IROS, arXiv 2209.12858; formulas as in the authors' public code.

| name | symbol | unit | equation |
|---|---|---|---|
| ones, samples | h, t | - | own readings so far |
| true_positive, true_negative | b, w | - | P(1 on vibrating tiles) = 1 - FN, P(0 on still ones) = 1 - FP |
| estimate | x | - | (h / t + w - 1) / (b + w - 1), clipped to [0, 1] |
| confidence | a | - | Fisher information of x; three cases, see ``local_confidence`` |
| social estimate | X | - | sum(a_j x_j) / sum(a_j), of the latest message of each robot j |
| informed estimate | x' | - | (a x + A X) / (a + A), with A = sum(a_j) |
| belief | p | - | P(f < boundary) = Phi((boundary - x') sqrt(a + A)) (ours) |

- Message: estimate and confidence (4 bytes each) and the sender (1 byte): 9 bytes.
- What a robot knows of its task: its error rates, if ``decision.boundary_of`` is "tiles"; otherwise it takes
  readings at face value.
- Differences from the original: a robot of the original never decides. Here a robot decides once, if p > p_c or
  1 - p > p_c, and if more than O_c observations are counted, where each message counts as one. It sends at each
  reading, to all robots; a robot of the original sends every ten control periods, to its neighbours.
- The information-weighted mean is close to, but not, the estimate from pooled counts: both are equal where all robots
  read the same share of ones; otherwise robots whose share is nearer to 0 or 1 weigh more.
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inlined, inner
from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import Row, decided, decision, enough
from vibroswarm.strategies.world import Draws, Reading, World

PERFECT: Final = 1.0 - 1e-6
"""Largest accuracy: a perfect sensor would make the confidence infinite if all readings are the same."""
LEAST_GAIN: Final = 1e-12
"""Smallest b + w - 1: a scenario's is above 0, but ``PERFECT`` may have made it smaller."""
LEAST_CONFIDENCE: Final = 1e-6
"""Smallest confidence of an own estimate, so that the weights never sum to 0; 0 is for robots not heard yet."""


ESTIMATE: Final = ("estimate", "estimate_spread")
"""What robots report: x', and its standard deviation 1 / sqrt(a + A)."""


class State:
    """Own counts, the informed estimate and its spread, the belief after the last reading, and the decision."""

    ones: int
    samples: int
    received: int
    estimate: float
    estimate_spread: float
    below: float
    decision: int


class Arrays:
    """The latest message of each robot; confidence 0 before the first."""

    estimate = array("float64", "robots")
    confidence = array("float64", "robots")


class Message:
    """Estimate of the fill ratio, and its confidence."""

    estimate: float
    confidence: float


def opposite(m: Row) -> None:
    """Turn the estimate x into 1 - x, for a robot with the fault ``opposite``; its confidence stays the same."""
    m.estimate = 1.0 - m.estimate


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Know nothing, undecided."""
    s.estimate, s.estimate_spread, s.below, s.decision = math.nan, math.nan, 0.5, -1


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Replace the sender's estimate and confidence by those of the message, and count the message."""
    a.estimate[sender], a.confidence[sender] = m.estimate, m.confidence
    s.received += 1


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count the reading, update the belief by own and received estimates, decide, and send the own estimate."""
    s.ones += x.reading
    s.samples += 1
    true_positive, true_negative = min(1.0 - w.false_negative, PERFECT), min(1.0 - w.false_positive, PERFECT)
    out.estimate = local_estimate(s.ones, s.samples, true_positive, true_negative)
    out.confidence = local_confidence(s.ones, s.samples, true_positive, true_negative)
    estimate, confidence = informed(out.estimate, out.confidence, a.estimate, a.confidence)
    decide_by(s, estimate, confidence, w)
    return True


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return p, the belief that f is below the boundary, after the last reading."""
    found: float = s.below
    return found


@inlined
def decide_by(s: Row, estimate: float, confidence: float, w: World) -> None:
    """Set estimate and belief from an informed estimate; decide, if undecided and with enough observations."""
    s.estimate, s.estimate_spread = estimate, 1.0 / math.sqrt(confidence)
    s.below = probability_below(estimate, confidence, w.decision_boundary)
    if s.decision == -1 and enough(s.samples, s.received, w):
        s.decision = decided(s.below, -1, w)


@inner
def raw_estimate(ones: int, samples: int, true_positive: float, true_negative: float) -> float:
    """Return the estimate before clipping: the fill ratio whose expected share of ones is the share read.

    It is outside of [0, 1] if no fill ratio has that share.
    """
    return (ones / samples + true_negative - 1.0) / max(true_positive + true_negative - 1.0, LEAST_GAIN)


@inner
def local_estimate(ones: int, samples: int, true_positive: float, true_negative: float) -> float:
    """Return x, the own estimate of the fill ratio, in [0, 1]."""
    return min(max(raw_estimate(ones, samples, true_positive, true_negative), 0.0), 1.0)


@inner
def local_confidence(ones: int, samples: int, true_positive: float, true_negative: float) -> float:
    """Return the confidence a in x: minus the second derivative of the log-likelihood of the readings at x.

    The three cases are x clipped to 0, x clipped to 1, and x between 0 and 1, where the likelihood has its maximum.
    """
    raw = raw_estimate(ones, samples, true_positive, true_negative)
    slope, zeros = true_positive + true_negative - 1.0, samples - ones
    # Inside P(1) = ones / samples, and neither ones nor zeros is 0: without ones x is 0, without zeros it is 1. Squares
    # are products: powers of Python differ from those of compiled code in last bits.
    if raw <= 0.0:  # x = 0, where P(1) = 1 - w
        p_one = 1.0 - true_negative
        found = slope * slope * (ones / (p_one * p_one) + zeros / (true_negative * true_negative))
    elif raw >= 1.0:  # x = 1, where P(0) = 1 - b
        p_zero = 1.0 - true_positive
        found = slope * slope * (zeros / (p_zero * p_zero) + ones / (true_positive * true_positive))
    else:
        found = slope * slope * float(samples) * samples * samples / (float(ones) * zeros)
    return max(found, LEAST_CONFIDENCE)


@inlined
def informed(estimate: float, confidence: float, estimates: Row, confidences: Row) -> tuple[float, float]:
    """Return the informed estimate x' and its confidence a + A."""
    weighted, total = confidence * estimate, confidence
    for j in range(confidences.size):
        weighted += confidences[j] * estimates[j]
        total += confidences[j]
    return weighted / total, total


@inner
def probability_below(estimate: float, confidence: float, boundary: float) -> float:
    """Return P(f < boundary) for f ~ Normal(estimate, 1 / confidence)."""
    return 0.5 * math.erfc((estimate - boundary) * math.sqrt(0.5 * confidence))


mcp = register(
    strategy_in(
        __name__,
        "mcp",
        decision=decision,
        reports=ESTIMATE,
        bytes_on_air=9,
        about="MCP: a robot sends its estimate of the fill ratio, and its confidence",
    )
)
