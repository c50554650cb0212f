"""An estimator by averaging over neighbours. With each reading a robot's estimate becomes a mean of the share of ones
that it has read itself and of the estimates that it has heard since; so all come near the mean of all, as far as
messages reach (opinions with stubborn agents, Friedkin and Johnsen 1990)."""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import strategy_in


class Params:
    weight: Annotated[float, Field(ge=0, lt=1)] = 0.8  # of the estimates heard, in the mean
    least: Annotated[int, Field(ge=1)] = 20  # own readings before a decision


class State:
    ones: int
    readings: int
    heard: int  # estimates since the last own reading, and their sum
    total: float
    estimate: float
    estimate_spread: float  # as of independent readings, all robots heard
    decision: int


class Message:
    estimate: float


def begin(s, a, d, p, w):
    s.estimate, s.estimate_spread, s.decision = 0.5, 0.5, -1


def on_message(s, a, m, sender, t_s, d, p, w):
    s.heard += 1
    s.total += m.estimate


def on_sample(s, a, x, out, d, p, w):
    s.ones, s.readings = s.ones + x.reading, s.readings + 1
    own = s.ones / s.readings
    s.estimate = own
    if s.heard > 0:
        s.estimate = (1.0 - p.weight) * own + p.weight * s.total / s.heard
    s.heard, s.total = 0, 0.0
    share = (s.ones + 1.0) / (s.readings + 2.0)  # never 0 or 1, so that the spread is not 0
    alone = (1.0 - p.weight) ** 2
    s.estimate_spread = math.sqrt(share * (1.0 - share) / s.readings * (alone + (1.0 - alone) / w.robots))
    is_sure = abs(s.estimate - w.boundary) > 1.6449 * s.estimate_spread
    if s.decision == -1 and s.readings >= p.least and is_sure:
        s.decision = int(s.estimate > w.boundary)
    out.estimate = s.estimate
    return True


def decision(s, a, p, w):
    return s.decision


averaging = strategy_in(
    __name__,
    "averaging",
    bytes_on_air=4,
    reports=("estimate", "estimate_spread"),
    about="averaging over neighbours: mean of the own share of ones and of the estimates heard",
)
