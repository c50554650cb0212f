"""Direct switching and cross-inhibition: robots that take over opinions, from others and from the floor itself.

At each update a robot takes up one opinion: with probability ``asocial`` its latest reading, else one that it has heard
since its last update, drawn at random. With direct switching it takes over what it takes up. With cross-inhibition an
opinion other than its own makes it uncommitted, and only an uncommitted robot takes over an opinion.
"""

from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import strategy_in, u


class Params:
    update_s: Annotated[float, Field(gt=0, le=1e4, description="Time between updates, s.")] = 10.0
    asocial: Annotated[float, Field(ge=0, le=1, description="Share of updates by an own reading.")] = 0.05
    inhibits: Annotated[bool, Field(description="Cross-inhibition; if not, direct switching.")] = True


class State:
    opinion: int  # -1: uncommitted
    reading: int  # -1: none since the last update
    heard: int  # -1: none since the last update
    messages: int
    alike: float  # how often readings were as the opinion says, forgotten over ten
    next_s: float


def begin(s, a, d, p, w):
    s.opinion, s.reading, s.heard, s.alike = int(2.0 * u(d, 0)), -1, -1, 0.5
    s.next_s = p.update_s * u(d, 1)


def on_message(s, a, m, sender, t_s, d, p, w):
    s.messages += 1
    if u(d, 0) * s.messages < 1.0:
        s.heard = m.bit


def on_sample(s, a, x, out, d, p, w):
    s.reading = x.reading
    s.alike += 0.1 * ((1.0 if x.reading == s.opinion else 0.0) - s.alike)
    return False


def on_timer(s, a, t_s, out, d, p, w):
    taken = s.reading if u(d, 0) < p.asocial else s.heard
    if taken >= 0 and taken != s.opinion:
        s.opinion = -1 if p.inhibits and s.opinion >= 0 else taken
        s.alike = 0.5
    s.reading, s.heard, s.messages = -1, -1, 0
    s.next_s = t_s + p.update_s
    out.bit = max(s.opinion, 0)
    return s.opinion >= 0 and u(d, 1) < s.alike  # the better the opinion, the more often it is told


def decision(s, a, p, w):
    return s.opinion


opinions = strategy_in(
    __name__, "opinions", decides="opinion", about="opinions: direct switching or cross-inhibition"
)
