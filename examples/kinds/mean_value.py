"""Robots that estimate the mean value of the floor from what they measure, and how far off they may be.

A sample on a tile of value v measures (1 - v) of a still and v of a vibrating tile, so the mean measured is a straight
line in the mean of v. Neighbouring samples are alike: the spread is that of means over batches of them.
"""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import strategy_in


class Params:
    energies: bool = True  # asks for what is measured
    still: float = 0.862  # mean of what is measured at value 0, and at 1: those of the preset paper
    vibrating: float = 2.538
    batch: Annotated[int, Field(ge=1, le=1000, description="Own samples whose mean a robot sends.")] = 20


class State:
    taken: int  # samples of this batch, and their sum
    batch_sum: float
    batches: int  # own and heard, with their sum and sum of squares
    total: float
    squares: float
    estimate: float
    estimate_spread: float


class Message:
    level: float


def begin(s, a, d, p, w):
    s.estimate = math.nan
    s.estimate_spread = math.nan


def add_batch(s, level):
    s.batches += 1
    s.total += level
    s.squares += level * level
    if s.batches > 3:
        s.estimate = s.total / s.batches
        squares = max(s.squares - s.total * s.estimate, 0.0)  # of distances from the mean
        s.estimate_spread = math.sqrt(squares / (s.batches - 3) / s.batches)  # Student's t


def on_message(s, a, m, sender, t_s, d, p, w):
    add_batch(s, m.level)


def on_sample(s, a, x, out, d, p, w):
    s.taken += 1
    s.batch_sum += x.value
    if s.taken < p.batch:
        return False
    out.level = (s.batch_sum / s.taken - p.still) / (p.vibrating - p.still)
    add_batch(s, out.level)
    s.taken, s.batch_sum = 0, 0.0
    return True


def decision(s, a, p, w):
    return -1


level = strategy_in(
    __name__,
    "level",
    bytes_on_air=4,
    reports=("estimate", "estimate_spread"),
    about="mean of the values measured, with its spread",
)
