"""Reset: no feedback; a robot tests whether the floor has changed sides, and then counts anew and tells the others.

Page's cumulative sum (Biometrika 41, 1954) of the robot's own posterior predictive against its mirror image beyond the
boundary; that the others are told, and follow, is ours.

| name | symbol | unit | equation |
|---|---|---|---|
| share | f | - | (prior + ones) / (prior + ones + zeros) of the bits before the excursion |
| distance | e | - | max(abs(f - b), least), b the boundary of readings |
| before, after | q_0, q_1 | - | b + e and b - e if f is above b, else b - e and b + e; kept in [0.01, 0.99] |
| sum | S | - | max(0, S + ln(P(bit given q_1) / P(bit given q_0))), at each bit, own or received, once the robot has \
enough bits to decide (O_c) |
| excursion | - | - | the bits since S was last 0 |
| change | - | - | S > threshold: the posterior is the prior plus the excursion, S is 0, and the robot tells it |
| time of the change | - | s | time of the first bit of that excursion; reported as ``changed_s`` |

Counts that have not been contradicted are kept for ever, so that before a change the posterior is that of ``none``, and
after one it holds the bits since the change was likely. The decision may change if ``decision.revise`` is set.

- Message: the reading, and whether the robot has counted anew since its last message: 2 bits, 1 byte. A robot that is
  told also counts anew, from its own excursion, if it ``follows`` and has one.
- With ``tells_change`` the decision is whether the floor has changed (1) or not (0), for the task ``changed``. A
  robot that ``follows`` takes the news as its answer, whether or not it has an excursion of its own; without one, the
  change was when it heard of it. With ``tells_anew`` the decision is 0 again at the next own sample without a change,
  and news that comes within ``SAME`` own samples of a change is of that change.
"""

from __future__ import annotations

import math
from typing import Annotated, Final

from pydantic import Field

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.base import Report, register, strategy_in
from vibroswarm.strategies.bayes import Row, decided, enough
from vibroswarm.strategies.world import Draws, Reading, World, belief_below

RAREST: Final = 0.01
"""Least share of ones, and of zeros, that is presumed: with 0 a single bit could outweigh all others."""

NOTHING: Final = 1e-3
"""A cumulative sum below this is 0: steps up and down by the same amount end there, despite rounding."""

SAME: Final = 4
"""With ``tells_anew``, news is of the change that the robot knows if it comes before this many own samples."""


class Params:
    """When a change is taken for certain, and who follows."""

    threshold: Annotated[
        float,
        Field(
            gt=0,
            le=1000,
            description="Cumulative sum at which the robot starts counting again: higher for fewer false changes, "
            "later for true ones.",
        ),
    ] = 8.0
    least: Annotated[
        float,
        Field(
            gt=0, lt=0.5, description="Least distance of the share from the boundary that the test presumes."
        ),
    ] = 0.05
    follows: Annotated[
        bool,
        Field(
            description="Whether a robot starts to count again when another says that it has. Turn it off where "
            "some say so wrongly."
        ),
    ] = True
    tells_change: Annotated[
        bool,
        Field(description="Whether robots decide if the floor has changed (task changed), not its side."),
    ] = False
    tells_anew: Annotated[
        bool,
        Field(
            description="With tells_change: whether robots that told of a change then tell if there was another "
            "(task.changed.since = answer)."
        ),
    ] = False


class State:
    """Posterior, excursion of the cumulative sum, changes so far, and decision."""

    alpha: int
    beta: int
    own: int
    received: int
    score: float
    ones: int
    zeros: int
    changes: int
    answered: int
    counted: int
    began_s: float
    changed_s: float
    is_told: bool
    decision: int


class Message:
    """A reading, and whether the robot has counted anew."""

    bit: int
    anew: int


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Start with the prior, and undecided."""
    s.alpha, s.beta, s.decision, s.is_told = w.prior_alpha, w.prior_beta, -1, True
    s.changed_s = math.nan


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Count another robot's reading; count anew if it did, and the robot follows."""
    s.received += 1
    take(s, m.bit, t_s, p, w)
    is_known = p.tells_anew and s.changes > 0 and s.own - s.counted < SAME
    if m.anew == 1 and p.follows and not is_known:
        if s.ones + s.zeros > 0:
            count_anew(s, w)
            s.is_told = True  # the others have heard it already
        elif p.tells_anew or (
            p.tells_change and s.changes == 0
        ):  # nothing to count anew: the news is the answer
            s.changes += 1
            s.counted = s.own
            s.changed_s = t_s


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count the reading, decide, and send the reading, with the news of a change."""
    s.own += 1
    take(s, x.reading, x.t_s, p, w)
    if enough(s.own, s.received, w):
        if p.tells_change:
            s.decision = 1 if s.changes > s.answered else 0
            if p.tells_anew:
                s.answered = s.changes
        elif s.decision == -1 or w.revise:
            s.decision = decided(belief_below(s.alpha, s.beta, w), s.decision, w)
    out.bit, out.anew = x.reading, 0 if s.is_told else 1
    s.is_told = True
    return True


def decision(s: Row, a: Row, p: Row, w: World) -> int:
    """Return the decision: 0, 1, or -1 while undecided."""
    current: int = s.decision
    return current


def belief(s: Row, a: Row, p: Row, w: World) -> float:
    """Return P(share of ones < boundary); nan if the robot decides on changes, in which it has no belief."""
    if p.tells_change:
        return math.nan
    return belief_below(s.alpha, s.beta, w)


@inlined
def take(s: Row, bit: int, t_s: float, p: Row, w: World) -> None:
    """Add a bit to the posterior and to the cumulative sum, and count anew if that is past the threshold."""
    # The excursion is left out of the share that it is tested against.
    before = s.alpha - s.ones
    share = before / (before + s.beta - s.zeros)
    s.alpha += bit
    s.beta += 1 - bit
    if not enough(s.own, s.received, w):  # the share is not known well enough to be tested
        return
    apart = max(abs(share - w.boundary), p.least)
    apart = apart if share > w.boundary else -apart
    now = min(max(w.boundary + apart, RAREST), 1.0 - RAREST)
    then = min(max(w.boundary - apart, RAREST), 1.0 - RAREST)
    s.score += math.log(then / now) if bit == 1 else math.log((1.0 - then) / (1.0 - now))
    if s.score < NOTHING:
        s.score, s.ones, s.zeros = 0.0, 0, 0
        return
    if s.ones + s.zeros == 0:
        s.began_s = t_s
    s.ones += bit
    s.zeros += 1 - bit
    if s.score > p.threshold:
        count_anew(s, w)


@inlined
def count_anew(s: Row, w: World) -> None:
    """Make the excursion all that is known, end it, and note that the others are to be told."""
    s.alpha, s.beta = w.prior_alpha + s.ones, w.prior_beta + s.zeros
    s.score, s.ones, s.zeros = 0.0, 0, 0
    s.changes += 1
    s.counted = s.own
    s.changed_s = s.began_s
    s.is_told = False


reset = register(
    strategy_in(
        __name__,
        "reset",
        revises=True,
        reports=("changes", Report("changed_s", "s")),
        about="reset: no feedback; a robot that detects a change starts counting again, and tells the others",
    )
)
