"""Direct switching and cross-inhibition: robots that take over opinions, from others and from the floor itself.

A robot explores first, and takes its reading as first opinion. At each update it takes up one opinion: with probability
``asocial`` its latest reading, else one that it has heard since its last update, drawn at random. With direct switching
it takes over what it takes up. With cross-inhibition an opinion other than its own makes it uncommitted, and only an
uncommitted robot takes over an opinion. It tells its opinion with a probability that is the opinion's quality: the
share of its readings that were alike.
"""

from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import strategy_in, u


class Params:
    explore_s: Annotated[float, Field(ge=0, le=1e4, description="Time before the first update, s.")] = 60.0
    update_s: Annotated[float, Field(gt=0, le=1e4, description="Time between updates, s.")] = 10.0
    asocial: Annotated[float, Field(ge=0, le=1, description="Share of updates by an own reading.")] = 0.05
    inhibits: Annotated[bool, Field(description="Cross-inhibition; if not, direct switching.")] = True


class State:
    opinion: int  # -1: uncommitted
    reading: int  # -1: none since the last update
    heard: int  # -1: none since the last update
    messages: int
    ones: float  # share of the readings that were 1, forgotten over twenty
    next_s: float


def begin(s, a, d, p, w):
    s.opinion, s.reading, s.heard, s.ones = -1, -1, -1, 0.5
    s.next_s = p.explore_s + p.update_s * u(d, 1)


def on_message(s, a, m, sender, t_s, d, p, w):
    s.messages += 1
    if u(d, 0) * s.messages < 1.0:
        s.heard = m.bit


def on_sample(s, a, x, out, d, p, w):
    s.reading = x.reading
    s.ones += 0.05 * (x.reading - s.ones)
    return False


def on_timer(s, a, t_s, out, d, p, w):
    is_first = t_s < p.explore_s + p.update_s
    taken = s.reading if is_first or u(d, 0) < p.asocial else s.heard
    if taken >= 0 and taken != s.opinion:
        s.opinion = -1 if p.inhibits and s.opinion >= 0 else taken
    s.reading, s.heard, s.messages = -1, -1, 0
    s.next_s = t_s + p.update_s
    out.bit = max(s.opinion, 0)
    quality = s.ones if s.opinion == 1 else 1.0 - s.ones
    return s.opinion >= 0 and u(d, 1) < quality  # the better the opinion, the more often it is told


def decision(s, a, p, w):
    return s.opinion


opinions = strategy_in(
    __name__, "opinions", decides="opinion", about="opinions: direct switching or cross-inhibition"
)
