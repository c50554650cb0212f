"""A robot that decides once readings of one kind lead by ten: a gambler who is ruined or rich."""

from vibroswarm.strategies import strategy_in


class Params:
    pass


class State:
    lead: int


def begin(s, a, d, p, w):
    s.lead = 0


def on_sample(s, a, x, out, d, p, w):
    if abs(s.lead) < 10:
        s.lead += 2 * x.reading - 1
    return False


def decision(s, a, p, w):
    return 1 if s.lead >= 10 else 0 if s.lead <= -10 else -1


ruin = strategy_in(__name__, "ruin", about="decides by a lead of ten readings")
