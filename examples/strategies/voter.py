"""A voter model in phases: read the floor, then tell the opinion for as long as the readings spoke for it, then take
over the opinion of one of the senders that were heard, drawn at random."""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import strategy_in, u


class Params:
    phase_s: Annotated[float, Field(gt=0, le=1e4)] = 60.0


class State:
    opinion: int
    telling: bool
    readings: int
    alike: int  # readings of this phase that are as the opinion says
    senders: int  # heard while telling: bit i is set for robot i
    drawn: int  # the opinion of one of them
    next_s: float


def begin(s, a, d, p, w):
    s.opinion, s.next_s = int(2.0 * u(d, 0)), -p.phase_s * math.log(u(d, 1))


def on_message(s, a, m, sender, t_s, d, p, w):
    if s.telling and s.senders >> sender & 1 == 0:
        s.senders |= 1 << sender
        s.readings += 1  # while telling: how many senders were heard
        s.drawn = m.bit if u(d, 0) * s.readings < 1.0 else s.drawn


def on_sample(s, a, x, out, d, p, w):
    if not s.telling:
        s.readings, s.alike = s.readings + 1, s.alike + (x.reading == s.opinion)
    out.bit = s.opinion
    return s.telling


def on_timer(s, a, t_s, out, d, p, w):
    share = 1.0 if s.telling else max(s.alike / max(s.readings, 1), 0.05)
    s.opinion = s.drawn if s.telling and s.senders > 0 else s.opinion
    s.telling, s.readings, s.alike, s.senders = not s.telling, 0, 0, 0
    s.next_s = t_s - p.phase_s * share * math.log(u(d, 0))
    out.bit = s.opinion
    return s.telling


def decision(s, a, p, w):
    return s.opinion


voter = strategy_in(__name__, "voter", decides="opinion", about="voter model in phases")
