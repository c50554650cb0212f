"""Bayes Bots: a robot counts its readings and those of others, and decides once its belief is past p_c or 1 - p_c.

Ebert, Gauci, Mallmann-Trenn and Nagpal 2020, ICRA; rules as in the authors' public controller for Kilobots.

| name | symbol | unit | equation |
|---|---|---|---|
| prior | a_0 | - | alpha = beta = a_0 at time 0; 1 in the controller, 10 in the comparison by Chin et al. |
| alpha, beta | alpha, beta | - | prior, ones and zeros, own and received |
| belief | p | - | P(Beta(alpha, beta) < boundary); the boundary is 1/2 in the original |
| decision | - | - | 0 if p > p_c, 1 if p < 1 - p_c, and then final; tested after each own and each received value |

- Message: sender, value, and the sender's number of readings so far: 2 + 1 + 2 = 5 bytes. The value is the latest
  reading or, with positive feedback, the decision once there is one. A value counts only if its number differs from
  that of the sender's last counted value.
- What a robot knows of its task: the error rates, if ``decision.boundary_of`` is "tiles". The boundary of p is
  then the share of ones expected at the task's boundary; the original assumes perfect sensors. ``min_observations`` has
  no effect: the prior delays decisions.
- Differences from the original: each robot hears all others, and reads every few seconds. The controller counts a
  sender once, and again only 900 s later (``sender_timeout_s = 900``); here every new value counts by default. The
  controller repeats its value all the time; here a value is sent once, or every ``repeat_s``.
- Without feedback, with ``test_received = false`` and prior a_0, a robot decides as ``none`` does with
  ``decision.prior_alpha = decision.prior_beta = a_0`` and ``decision.min_observations = 0``, for every p_c that a
  single reading cannot pass.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import Row, belief, decided, decision
from vibroswarm.strategies.world import Draws, Reading, World, belief_below


class Params:
    """Feedback, prior, and what counts."""

    positive_feedback: Annotated[bool, Field(description="Send the decision once there is one.")] = True
    prior: Annotated[
        int, Field(ge=1, le=100_000, description="Ones, and zeros, counted before the first reading.")
    ] = 10
    test_received: Annotated[
        bool,
        Field(description="Test the belief after each received value too."),
    ] = True
    sender_timeout_s: Annotated[
        float,
        Field(
            ge=0,
            le=1e7,
            description="Ignore a sender for this long after one of its values counted, s: for radios that repeat.",
        ),
    ] = 0.0
    repeat_s: Annotated[
        float,
        Field(
            ge=0,
            le=1e7,
            description="Time between repeated messages, s; 0: a value is sent once. For radios that lose messages.",
        ),
    ] = 0.0


class State:
    """Posterior, decision, number of own readings, the latest reading, and when to repeat the message."""

    alpha: int
    beta: int
    decision: int
    number: int
    bit: int
    next_s: float


class Arrays:
    """Of each sender: number of its last value that counted, and when that came."""

    number = array("int64", "robots")
    counted_s = array("float64", "robots")


class Message:
    """A reading or decision, and its number."""

    bit: int
    number: int


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Start with the prior, undecided, and without a timer until the first reading."""
    s.alpha, s.beta, s.decision, s.next_s = p.prior, p.prior, -1, math.inf


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Count the sender's value unless its number is that of the last counted one (0: none), or it comes too soon."""
    before = a.number[sender]
    if m.number == before or (before > 0 and t_s < a.counted_s[sender] + p.sender_timeout_s):
        return
    a.number[sender], a.counted_s[sender] = m.number, t_s
    count(s, m.bit)
    if p.test_received:
        decide(s, w)


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count the reading, decide if the belief suffices, send a message, and set the timer that repeats it."""
    count(s, x.reading)
    decide(s, w)
    s.number += 1
    s.bit = x.reading
    if p.repeat_s > 0.0:
        s.next_s = x.t_s + p.repeat_s
    fill(s, out, p)
    return True


def on_timer(s: Row, a: Row, t_s: float, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Send the message again under the number of the latest reading, which receivers that have it ignore."""
    s.next_s = t_s + p.repeat_s
    fill(s, out, p)
    return True


@inlined
def count(s: Row, value: int) -> None:
    """Add a value, 0 or 1, to the posterior."""
    s.alpha += value
    s.beta += 1 - value


@inlined
def decide(s: Row, w: World) -> None:
    """Decide by the posterior, if undecided."""
    if s.decision == -1:
        s.decision = decided(belief_below(s.alpha, s.beta, w), -1, w)


@inlined
def fill(s: Row, out: Row, p: Row) -> None:
    """Fill in the message: the decision with positive feedback, otherwise the latest reading, and its number."""
    out.bit = s.decision if p.positive_feedback and s.decision != -1 else s.bit
    out.number = s.number


bayes_bots = register(
    strategy_in(
        __name__,
        "bayes_bots",
        belief=belief,
        decision=decision,
        bytes_on_air=5,
        about="Bayes Bots: a robot sends its reading or, with positive feedback, its decision; the prior is the gate",
    )
)
