"""No feedback, and a walk of its own: after a reading of vibration a robot turns away from where it was, and goes on
for longer the surer it is; it shows how a strategy steers."""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import belief_below, strategy_in, u


class Params:
    leg_s: Annotated[float, Field(gt=0, le=1e4)] = 8.0
    turn_deg: Annotated[float, Field(gt=0, le=180)] = 120.0


class State:
    alpha: int
    beta: int
    own: int
    decision: int


def begin(s, a, d, p, w):
    s.alpha, s.beta, s.decision = w.prior_alpha, w.prior_beta, -1


def on_counts(s, ones, zeros, p, w):
    s.alpha, s.beta = s.alpha + ones, s.beta + zeros


def on_sample(s, a, x, out, d, p, w):
    s.own, s.alpha, s.beta = s.own + 1, s.alpha + x.reading, s.beta + 1 - x.reading
    below = belief_below(s.alpha, s.beta, w)
    if s.decision == -1 and s.alpha + s.beta > w.min_observations and abs(2.0 * below - 1.0) > 0.9:
        s.decision = 0 if below > 0.5 else 1
    out.bit = x.reading
    return True


def decision(s, a, p, w):
    return s.decision


def belief(s, a, p, w):
    return belief_below(s.alpha, s.beta, w)


def steer(s, a, x, d, p, w):
    if x.reading == 0:
        return math.nan, math.nan  # goes on as drawn
    side = 1.0 if u(d, 0) < 0.5 else -1.0
    return side * p.turn_deg, 1000.0 * p.leg_s


avoider = strategy_in(__name__, "avoider", about="no feedback, turning away from vibration")
