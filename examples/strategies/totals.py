"""Totals: a robot sends its counts so far, and decides by a threshold that falls to 0 at the end of the run.

Estimation from counts with known error rates is that of minimalistic collective perception (Chin, Khaluf and
Pinciroli 2023, arXiv 2209.12858; ``mcp``); the test and its falling threshold are ours.

| name | symbol | unit | equation |
|---|---|---|---|
| ones, samples | h, n | - | numbers of ones and of readings: own ones plus the latest totals of each sender |
| boundary | q_0 | - | share of ones expected at the boundary: FP + (1 - FP - FN) / 2 for a boundary of 1/2 |
| score | z | - | (h - q_0 n) / sqrt((n + 3) / 4) |
| threshold | c | - | a robot decides if abs(z) > c (1 - t / T_end); typically 3 |

The 3 in the score keeps a robot from deciding on its first readings: at c = 3 and a boundary of 1/2, fewer than 12
readings never suffice at time 0.

- Message: own ones and readings (2 bytes each) and the sender (1 byte): 5 bytes. Totals include all earlier readings,
  so the next message makes up for a lost one.
- What a robot knows of its task: T_end; its error rates, if ``decision.boundary_of`` is "tiles". It needs no
  places, and does not use ``min_observations``.
- Nearly every robot decides by T_end. At its last reading the threshold is still a little above 0, so a robot whose
  score is nearer to 0 stays undecided: 0 of 1000 robots in 1200 s, 6 in 200 s, 91 in 60 s (preset ``paper``, f = 0.48).

vibroswarm run --strategy examples/strategies/totals.py:totals
"""

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import array, strategy_in
from vibroswarm.strategies.bayes import belief, decision

__all__ = ["belief", "decision", "totals"]


class Params:
    """The threshold."""

    threshold: Annotated[
        float,
        Field(ge=0, le=1e3, description="Score at which a robot decides at time 0; it falls to 0 at T_end."),
    ] = 3.0


class State:
    """Own totals, and all counts with the prior."""

    ones: int
    samples: int
    alpha: int
    beta: int
    decision: int


class Arrays:
    """The latest totals of each sender."""

    ones = array("int32", "robots")
    samples = array("int32", "robots")


class Message:
    """The sender's own totals."""

    ones: int
    samples: int


def opposite(m):
    """Turn ones into zeros."""
    m.ones = m.samples - m.ones


def begin(s, a, d, p, w):
    """Start with the prior, and undecided."""
    s.alpha, s.beta, s.decision = w.prior_alpha, w.prior_beta, -1


def on_message(s, a, m, sender, t_s, d, p, w):
    """Store the totals of the message as the sender's latest ones, unless a later message of the sender came before.

    A message with more readings is later. Only the difference from the sender's last totals is added to the counts.
    """
    samples = m.samples - a.samples[sender]
    if samples <= 0:
        return
    ones = m.ones - a.ones[sender]
    s.alpha += ones
    s.beta += samples - ones
    a.ones[sender], a.samples[sender] = m.ones, m.samples


def on_sample(s, a, x, out, d, p, w):
    """Count the reading, decide by the threshold, and send the own totals."""
    s.ones += x.reading
    s.samples += 1
    s.alpha += x.reading
    s.beta += 1 - x.reading
    if s.decision == -1:
        # Own and received readings, without the prior.
        ones, zeros = s.alpha - w.prior_alpha, s.beta - w.prior_beta
        limit = max(p.threshold * (1.0 - x.t_s / w.t_end_s), 0.0)
        z = score(ones, ones + zeros, w.boundary)
        if z > limit:
            s.decision = 1
        elif z < -limit:
            s.decision = 0
    out.ones, out.samples = s.ones, s.samples
    return True


def score(ones, samples, boundary):
    """Return the score z: how far the share of ones lies above the boundary, in about standard deviations."""
    return (ones - boundary * samples) / math.sqrt((samples + 3) / 4.0)


totals = strategy_in(
    __name__,
    "totals",
    belief=belief,
    decision=decision,
    bytes_on_air=5,
    about="totals: a robot sends its counts; the threshold of its decision falls to 0 at the end",
)
