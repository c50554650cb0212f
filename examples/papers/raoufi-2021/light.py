"""A field that rises from 0 to 1 across the arena, a sensor that states its value, and robots that estimate its mean.

Each robot first walks and averages what it reads. From ``explore_s`` on it keeps that mean as its opinion and, at each
sample, takes the mean of its opinion and of those that it has heard since (DeGroot 1974).
"""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from vibroswarm.sensors import SensorModel
from vibroswarm.strategies import strategy_in
from vibroswarm.tasks import Task

STEPS = 16  # the finest that a sensor may hand to a strategy


class Width:
    width_m: Annotated[float, Field(gt=0)] = 1.0  # of the arena, along which the field rises


def sense(samples, p):
    return (samples.x_m / p.width_m).reshape(-1, 1)


def readings(p):
    return STEPS


def reading(value, p):
    return np.minimum(value[:, 0] * STEPS, STEPS - 1).astype(int)


light = SensorModel(name="light", params=Width, readings=readings, sense=sense, reading=reading)


def truth(floor, asked, p):
    return 0.5


intensity = Task(
    name="intensity", truth=truth, estimated="mean intensity", about="what is the mean intensity?"
)


class Params:
    explore_s: Annotated[float, Field(ge=0)] = 60.0


class State:
    read: int
    heard: int  # opinions since the last sample, and their sum
    total: float
    estimate: float
    estimate_spread: float  # of the own mean, were readings independent and uniform


class Message:
    estimate: float


def begin(s, a, d, p, w):
    s.estimate, s.estimate_spread = 0.5, 0.29


def on_message(s, a, m, sender, t_s, d, p, w):
    s.heard += 1
    s.total += m.estimate


def on_sample(s, a, x, out, d, p, w):
    if x.t_s < p.explore_s or s.read == 0:
        s.read += 1
        s.estimate += ((x.reading + 0.5) / STEPS - s.estimate) / s.read
        s.estimate_spread = 0.29 / math.sqrt(s.read)
    else:
        s.estimate = (s.estimate + s.total) / (1 + s.heard)
    s.heard, s.total = 0, 0.0
    out.estimate = s.estimate
    return x.t_s >= p.explore_s


def decision(s, a, p, w):
    return -1


consensus = strategy_in(
    __name__,
    "consensus",
    many_readings=True,
    bytes_on_air=4,
    reports=("estimate", "estimate_spread"),
    about="consensus: explore, then average",
)
