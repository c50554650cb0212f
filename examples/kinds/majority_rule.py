"""A majority rule with as many options as there are kinds of tile. A robot has an opinion and tells it after each
reading; at the end of a phase it takes over what most of its readings and of the opinions heard in the phase are."""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import array, strategy_in, u


class Params:
    phase_s: Annotated[float, Field(gt=0, le=1e4)] = 60.0
    weight: Annotated[int, Field(ge=1, le=1000)] = 3  # of an own reading, in opinions heard


class State:
    opinion: int
    next_s: float


class Arrays:
    votes = array("int32", "kinds")


class Message:
    kind: int


def begin(s, a, d, p, w):
    s.opinion = min(int(w.kinds * u(d, 0)), w.kinds - 1)
    s.next_s = -p.phase_s * math.log(u(d, 1))


def on_message(s, a, m, sender, t_s, d, p, w):
    a.votes[m.kind] += 1


def on_sample(s, a, x, out, d, p, w):
    if x.reading < w.kinds:  # a class beyond the kinds is no reading
        a.votes[x.reading] += p.weight
    out.kind = s.opinion
    return True


def on_timer(s, a, t_s, out, d, p, w):
    for kind in range(w.kinds):
        if a.votes[kind] > a.votes[s.opinion]:
            s.opinion = kind
    for kind in range(w.kinds):
        a.votes[kind] = 0
    s.next_s = t_s - p.phase_s * math.log(u(d, 0))
    out.kind = s.opinion
    return False


def decision(s, a, p, w):
    return s.opinion


rule = strategy_in(
    __name__,
    "rule",
    decides="opinion",
    answers_kinds=True,
    reports=("opinion",),
    about="majority rule in phases, as many options as kinds of tile",
)
