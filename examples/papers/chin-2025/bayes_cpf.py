"""BayesCPF, Bayes collective perception filter: MCP by robots that track the drifting accuracy of their sensors.

Chin and Pinciroli 2025, arXiv 2504.04774; rules as in the authors' public code (filter "Delta", binomial variant).

| name | symbol | unit | equation |
|---|---|---|---|
| accuracy | b | - | probability of a right reading, the same on vibrating and still tiles; kept in (1/2, 1) |
| window | t, h | - | number of the last readings used, and of ones among them; they give x and x' as in ``mcp`` |
| reference | f | - | weighted mean of the last t informed estimates, the oldest with weight t, the latest with 1 |
| mean, variance | m, P | - | of b; at each reading: m - drift, P + drift_variance |
| expected | - | - | t (f (2 m - 1) - m + 1) ones in the window |
| slope, noise | C, Q | - | t (2 f - 1); t ((2 m - 1)^2 (f - f^2 - 1/4) + 1/4) |
| gain | K | - | P C / (C^2 P + Q); Kalman update: m becomes m + K (h - expected), P becomes (1 - K C) P |
| constrained | - | - | b = m inside of (1/2, 1), else the mean of Normal(m, P) truncated to it; m stays as it is |

The Kalman update is left out while t m or t (1 - m) is below 5, because the number of right readings is then far from
normally distributed.

**Blind at a fill ratio of 1/2**: the slope is 0 there, so the accuracy only drifts. Use this strategy far from 1/2.

- Message: as ``mcp``, 9 bytes.
- What a robot knows of its task: accuracy and variance at time 0, and how fast they change. A robot is not told
  its error rates.
- The authors use an accuracy of 0.99 and a variance of 0.001 at time 0, changes per reading of -2.5e-4 and 5e-4, and
  windows of up to 1000 readings.
- Differences from the original: each robot hears all others, and decides as in ``mcp``. The window has a fixed length;
  the original shortens it while the estimated accuracy changes fast. Sensors here drift
  only as a fault (``faults.false_positive_drift_per_h``, ``faults.false_negative_drift_per_h``).
"""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import array, mcp, strategy_in
from vibroswarm.strategies.bayes import decision
from vibroswarm.strategies.mcp import (
    ESTIMATE,
    PERFECT,
    Message,
    belief,
    decide_by,
    informed,
    local_confidence,
    local_estimate,
    on_message,
    opposite,
)

__all__ = ["Message", "bayes_cpf", "belief", "decision", "on_message", "opposite"]

LOWEST = 0.5 + 1e-6
"""Smallest accuracy, just above 1/2: at 1/2 a reading carries no information."""
LARGEST_WINDOW = 1000
LEAST_COUNT = 5.0
"""Least expected number of right, and of wrong, readings for a Kalman update: fewer are far from normal."""


class Params:
    """Assumed accuracy and its drift."""

    accuracy: Annotated[float, Field(gt=0.5, lt=1, description="Mean of the accuracy at time 0.")] = 0.99
    variance: Annotated[float, Field(gt=0, le=1, description="Variance of the accuracy at time 0.")] = 0.001
    drift: Annotated[
        float,
        Field(
            ge=0,
            le=0.5,
            description="Accuracy that is lost from reading to reading (-B).",
        ),
    ] = 2.5e-4
    drift_variance: Annotated[
        float,
        Field(
            ge=0,
            le=1,
            description="Variance that is added from reading to reading (R).",
        ),
    ] = 5e-4
    window: Annotated[
        int, Field(ge=1, le=LARGEST_WINDOW, description="Number of last readings that count (t).")
    ] = 200


class State:
    """Own readings, the accuracy and its variance, the belief after the last reading, and the decision."""

    samples: int
    ones: int
    received: int
    expected_accuracy: float
    variance: float
    accuracy: float
    estimate: float
    estimate_spread: float
    below: float
    decision: int


class Arrays(mcp.Arrays):
    """The latest message of each robot; confidence 0 before the first. The last readings and informed estimates."""

    reading = array("int32", str(LARGEST_WINDOW))
    informed = array("float64", str(LARGEST_WINDOW))


def begin(s, a, d, p, w):
    """Assume an accuracy, undecided."""
    s.expected_accuracy, s.variance, s.accuracy = p.accuracy, p.variance, p.accuracy
    s.estimate, s.estimate_spread, s.below, s.decision = math.nan, math.nan, 0.5, -1


def on_sample(s, a, x, out, d, p, w):
    """Put the reading into the window, update the belief, decide, send the own estimate, and filter the accuracy.

    ``a.reading`` and ``a.informed`` are rings of ``window`` entries. The latest is written to entry ``here``, which is
    unused until the window is full, and from then on holds the oldest. ``s.ones`` is h, ``s.expected_accuracy`` and
    ``s.variance`` are m and P, ``s.accuracy`` is b.
    """
    here = s.samples % p.window
    # Once the window is full, the oldest reading leaves it.
    s.ones += x.reading - (a.reading[here] if s.samples >= p.window else 0)
    a.reading[here] = x.reading
    s.samples += 1
    count = min(s.samples, p.window)
    # The accuracy takes the place of both rates of right readings, on vibrating and on still tiles.
    out.estimate = local_estimate(s.ones, count, s.accuracy, s.accuracy)
    out.confidence = local_confidence(s.ones, count, s.accuracy, s.accuracy)
    estimate, confidence = informed(out.estimate, out.confidence, a.estimate, a.confidence)
    decide_by(s, estimate, confidence, w)
    a.informed[here] = estimate
    # Kalman filter of the accuracy: prediction, then update if there are enough readings.
    s.expected_accuracy -= p.drift
    s.variance += p.drift_variance
    if count * s.expected_accuracy >= LEAST_COUNT and count * (1.0 - s.expected_accuracy) >= LEAST_COUNT:
        correct(s, count, reference(a.informed, here, count))
    s.accuracy = constrained(s.expected_accuracy, s.variance)
    return True


def reference(estimates, here, count):
    """Return f, the weighted mean of the last informed estimates; as in the authors' code, older ones weigh more.

    Args:
        estimates: ring of informed estimates. here: index of the latest estimate. count: number of estimates in the
            ring.
    """
    total = 0.0
    # The latest estimate has age 0 and weight 1. The estimate of an age stands at index here - age. If that is
    # negative, the ring is full, so ``count`` is its length, and the estimate stands that far from the end of the ring.
    for age in range(count):
        total += (age + 1) * estimates[here - age if age <= here else here - age + count]
    return total / (0.5 * count * (count + 1))


def correct(s, count, fill):
    """Update mean m and variance P of the accuracy by the number of ones in the window (Kalman update).

    Args:
        count: t, number of readings in the window. fill: f.
    """
    # A reading is 1 with probability o = f (2 m - 1) - m + 1. The number of ones has the mean t o, whose derivative by
    # m is ``slope`` (C), and the binomial variance t o (1 - o), which is ``noise`` (Q).
    mean, variance = s.expected_accuracy, s.variance
    slope = count * (2.0 * fill - 1.0)
    noise = count * ((2.0 * mean - 1.0) ** 2 * (fill - fill * fill - 0.25) + 0.25)
    gain = variance * slope / (slope * slope * variance + noise)
    s.expected_accuracy = mean + gain * (s.ones - count * (fill * (2.0 * mean - 1.0) - mean + 1.0))
    s.variance = (1.0 - gain * slope) * variance


def constrained(mean, variance):
    """Return b: ``mean`` if it lies in [LOWEST, PERFECT], else the mean of Normal(mean, variance) truncated to it."""
    if LOWEST <= mean <= PERFECT:
        return mean
    spread = math.sqrt(variance)
    low, high = (LOWEST - mean) / spread, (PERFECT - mean) / spread
    mass = 0.5 * (math.erf(high / math.sqrt(2.0)) - math.erf(low / math.sqrt(2.0)))
    # Far outside of the bounds the quotient below would be inaccurate, and the nearest bound is close enough.
    if mass < 1e-12:
        return LOWEST if mean < LOWEST else PERFECT
    density = (math.exp(-0.5 * low * low) - math.exp(-0.5 * high * high)) / math.sqrt(2.0 * math.pi)
    return min(max(mean + spread * density / mass, LOWEST), PERFECT)


bayes_cpf = strategy_in(
    __name__,
    "bayes_cpf",
    bytes_on_air=9,
    reports=ESTIMATE,
    about="BayesCPF: MCP, and a robot tracks the accuracy of its sensor",
)
