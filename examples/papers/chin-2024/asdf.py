"""ASDF, adaptive sensor degradation filter: MCP by robots that correct a wrongly assumed, constant accuracy.

Chin and Pinciroli 2024, arXiv 2410.21546; rules as in the authors' public code (filter "Bravo").

| name | symbol | unit | equation |
|---|---|---|---|
| accuracy | b = w | - | assumed probability of a right reading, the same on vibrating and still tiles |
| local, social, informed estimate | x, X, x' | - | as in ``mcp``, with the assumed accuracy |
| mean, spread | m, s | - | mean and standard deviation (n - 1) of the local estimates x of the n robots heard |
| limit | - | - | s (t_n / sqrt(n) + 1), with P(abs(T) < t_n) = beta for Student's T of n degrees of freedom |
| calibration | - | - | every ``period`` readings, if abs(m - x) >= limit and n > 1: b = (h / t + X - 1) / (2 X - 1) |

**Blind at a fill ratio of 1/2**: there half of the readings are ones whatever the accuracy is, so the correction is
singular at X = 1/2 and unreliable near it. Use this strategy far from 1/2. It also needs robots whose assumed
accuracies differ: if all robots assume the same wrong accuracy, their estimates agree, and no robot corrects it.

- Message: as ``mcp``, 9 bytes.
- What a robot knows of its task: the accuracy that it assumes at first, which is ``accuracy``, or
  ``flawed_accuracy`` for the first ``flawed_robots`` robots. A robot is not told its error rates.
- The authors use an accuracy of 0.95, or 0.75 for some robots, beta of 0.05 to 0.1, and a correction every 250 to
  1000 readings. A run here has some 200 readings, so the default is every 50.
- Differences from the original: each robot hears all others, and decides as in ``mcp``. b is kept in (1/2, 1). The
  authors' code keeps b in (0, 1) and always sets it to 1 for X < 1/2, because their fill ratios are above 1/2.
"""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import strategy_in
from vibroswarm.strategies.bayes import decision
from vibroswarm.strategies.mcp import (
    ESTIMATE,
    PERFECT,
    Arrays,
    Message,
    belief,
    decide_by,
    informed,
    local_confidence,
    local_estimate,
    on_message,
    opposite,
)

__all__ = ["Arrays", "Message", "asdf", "belief", "decision", "on_message", "opposite"]

LOWEST = 0.5 + 1e-6
"""Smallest accuracy, just above 1/2: at 1/2 a reading carries no information."""


class Params:
    """Assumed accuracies, and when to correct them."""

    accuracy: Annotated[float, Field(gt=0.5, lt=1, description="Accuracy that robots assume at first.")] = (
        0.95
    )
    flawed_robots: Annotated[
        int, Field(ge=0, le=100_000, description="Number of robots, the first ones, that assume another one.")
    ] = 1
    flawed_accuracy: Annotated[
        float, Field(gt=0.5, lt=1, description="Accuracy that those robots assume at first.")
    ] = 0.75
    period: Annotated[
        int, Field(ge=1, le=1_000_000, description="Readings between tests of the accuracy.")
    ] = 50
    type_2_error: Annotated[
        float,
        Field(
            gt=0,
            lt=1,
            description="Width of the test: central probability of Student's T (beta).",
        ),
    ] = 0.1


class State:
    """Own counts, assumed accuracy, the belief after the last reading, and the decision."""

    ones: int
    samples: int
    received: int
    accuracy: float
    estimate: float
    estimate_spread: float
    below: float
    decision: int


def begin(s, a, d, p, w):
    """Assume an accuracy, undecided."""
    s.accuracy = p.flawed_accuracy if w.robot < p.flawed_robots else p.accuracy
    s.estimate, s.estimate_spread, s.below, s.decision = math.nan, math.nan, 0.5, -1


def on_sample(s, a, x, out, d, p, w):
    """Count the reading, update the belief, decide, correct the accuracy if that is due, and send the own estimate.

    Every ``period`` readings the accuracy is corrected, if the own estimate ``differs`` from those of the other robots.
    """
    s.ones += x.reading
    s.samples += 1
    # The accuracy takes the place of both rates of right readings, on vibrating and on still tiles.
    out.estimate = local_estimate(s.ones, s.samples, s.accuracy, s.accuracy)
    out.confidence = local_confidence(s.ones, s.samples, s.accuracy, s.accuracy)
    estimate, confidence = informed(out.estimate, out.confidence, a.estimate, a.confidence)
    decide_by(s, estimate, confidence, w)
    # ``differs`` is False until two robots were heard, so ``social_estimate`` never divides by 0.
    if s.samples % p.period == 0 and differs(out.estimate, a.estimate, a.confidence, p.type_2_error):
        s.accuracy = calibrated(s.ones / s.samples, social_estimate(a.estimate, a.confidence), s.accuracy)
    return True


def social_estimate(estimates, confidences):
    """Return X, the mean of the other robots' latest estimates, weighted by confidence.

    Args:
        estimates, confidences: (robots,); confidence is 0 for the robot itself and for robots not heard yet. At least
            one confidence must be above 0.
    """
    weighted, total = 0.0, 0.0
    for j in range(confidences.size):
        weighted += confidences[j] * estimates[j]
        total += confidences[j]
    return weighted / total


def differs(estimate, estimates, confidences, type_2_error):
    """Return whether the own estimate lies at least ``limit`` (see the table) from the mean of the others' estimates.

    Args:
        estimate: the own estimate. estimates, confidences: (robots,), latest message of each robot. The confidence is 0
            for the robot itself and for robots not heard yet; these are left out. type_2_error: beta of the table, the
            probability between -t_n and t_n; the name is that of the authors' code.
    Returns:
        False if fewer than two robots were heard, because the spread of one estimate is unknown. If all robots heard
        have the same estimate, the limit is 0 up to rounding, so that almost any own estimate differs.
    """
    n, total, squares = 0, 0.0, 0.0
    for j in range(confidences.size):
        if confidences[j] > 0.0:
            n += 1
            total += estimates[j]
    if n < 2:
        return False
    mean = total / n
    for j in range(confidences.size):
        if confidences[j] > 0.0:
            squares += (estimates[j] - mean) * (estimates[j] - mean)
    limit = math.sqrt(squares / (n - 1)) * (student_quantile(type_2_error, n) / math.sqrt(n) + 1.0)
    return abs(mean - estimate) >= limit


def calibrated(share, social, before):
    """Return the accuracy at which the own readings would give the social estimate, limited to [LOWEST, PERFECT].

    Args:
        share: h / t, own share of ones. social: X. before: the present accuracy. It is returned if X = 1/2, where the
            equation has no solution.
    """
    if social == 0.5:
        return before
    return min(max((share + social - 1.0) / (2.0 * social - 1.0), LOWEST), PERFECT)


def student_central(t, n):
    """Return P(abs(T) < t) of Student's T with n degrees of freedom, n a whole number.

    It is the finite sum of Abramowitz and Stegun (1964), 26.7.3 for odd n and 26.7.4 for even n.
    """
    angle = math.atan(t / math.sqrt(n))
    sine, cosine = math.sin(angle), math.cos(angle)
    # k is the power of the cosine in a term: 0, 2, ... up to n - 2 for even n, 1, 3, ... up to n - 2 for odd n.
    first = n % 2
    term, total = 1.0 if first == 0 else cosine, 0.0
    for k in range(first, n - 1, 2):
        total += term
        term *= cosine * cosine * (k + 1) / (k + 2)
    if first == 0:
        return sine * total
    return 2.0 / math.pi * (angle + sine * total)


def student_quantile(central, n):
    """Return t with P(abs(T) < t) = ``central``, for Student's T with n degrees of freedom.

    It is found by bisection; 60 halvings exhaust double precision. A quantile above 1e12 is returned as about 1e12.

    Args:
        central: probability in (0, 1). n: degrees of freedom.
    """
    low, high = 0.0, 1.0
    # Double the upper end until the quantile lies below it.
    while student_central(high, n) < central and high < 1e12:
        high *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if student_central(middle, n) < central:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


asdf = strategy_in(
    __name__,
    "asdf",
    bytes_on_air=9,
    reports=ESTIMATE,
    about="ASDF: MCP, and a robot corrects its assumed accuracy by the estimates of others",
)
