"""A colour sensor with four kinds of tile, a question about red tiles, and a strategy that answers it."""

import numpy as np

from vibroswarm.sensors import SensorModel
from vibroswarm.strategies import Strategy
from vibroswarm.tasks import Task

RATES = np.array(
    [[0.85, 0.05, 0.05, 0.05], [0.05, 0.85, 0.05, 0.05], [0.10, 0.05, 0.80, 0.05], [0.05, 0.05, 0.10, 0.80]]
)
RED = 2


def four(p):
    return 4


def measure(kind, u, p):
    return np.searchsorted(np.cumsum(RATES[kind])[:-1], u).astype(float)


def reading(value, p):
    return value.astype(int)


def likelihood(kind, value, p):
    return RATES[kind][value.astype(int)]


colour = SensorModel(
    name="colour", kinds=four, readings=four, measure=measure, reading=reading, likelihood=likelihood
)


def truth(floor, asked, p):
    return int(floor.share_within(RED, asked.width_m, asked.height_m) > 0.1)


red = Task(name="red", truth=truth, answers=("at most 10 % is red", "more than 10 % is red"))


class State:
    red: int
    heard: int
    decision: int


class Message:
    kind: int


def begin(s, a, d, p, w):
    s.decision = -1


def on_message(s, a, m, sender, t_s, d, p, w):
    s.red += m.kind == RED
    s.heard += 1


def on_sample(s, a, x, out, d, p, w):
    s.red += x.reading == RED
    s.heard += 1
    if s.heard > 300 and s.decision == -1:
        s.decision = int(s.red > 0.13 * s.heard)  # 10 % red reads as 12.5 %
    out.kind = x.reading
    return True


def decision(s, a, p, w):
    return s.decision


counts = Strategy(
    name="counts",
    state=State,
    message=Message,
    begin=begin,
    on_message=on_message,
    on_sample=on_sample,
    decision=decision,
    many_readings=True,
)
