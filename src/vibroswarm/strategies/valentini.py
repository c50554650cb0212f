"""DC, DMVD and DMMD: robots explore, then disseminate their opinion, then adopt an opinion of those they heard.

DC is direct comparison, DMVD direct modulation of voter-based decisions, DMMD direct modulation of majority-based
decisions: Valentini, Brambilla, Hamann and Dorigo 2016, ANTS; rules as in the public controller by Brambilla.

| name | symbol | unit | equation |
|---|---|---|---|
| explore_s | sigma | s | mean of an exploration, exponential; 10 s in the original |
| quality | q | - | share of the readings of an exploration that equal the own opinion |
| disseminate_s | g | s | the exponential part of a dissemination has mean g q, in DC g; g is 10 s in the original |
| listen_s | - | s | 3: last part of each dissemination, added to the exponential part; a robot listens only then |
| max_opinions | - | - | 2: number of last opinions heard that are used |

At the end of a dissemination a robot uses the last ``max_opinions`` opinions heard; each sender counts once:

| strategy | rule |
|---|---|
| ``dc`` | draw one sender: adopt its opinion if its quality is greater than the own quality |
| ``dmvd`` | draw one sender: adopt its opinion |
| ``dmmd`` | adopt the majority of the opinions heard and the own one; a tie keeps the own one |

If nobody was heard, the opinion stays. At time 0 it is drawn with probability 1/2 each.

- Message, every ``interval_s`` while disseminating: sender and opinion, 2 bytes; DC adds the quality, 4 bytes.
- What a robot knows of its task: nothing. It asks which reading is more frequent, so it works for a boundary of
  1/2 only.
- Differences from the original: each robot hears all others. A reading comes every few seconds instead of at every
  control period, so phases are longer: 60 s. If an exploration brought no reading, the quality stays as before (1/2 at
  first). In DC the mean is g; in the controller it is g times the share of the more frequent colour, which no robot
  knows. A tie (one robot heard, of the other opinion) goes to one fixed colour in the controller.
- The stopping rule is ours; the original stops when an observer sees all robots agree. Here a robot decides once its
  opinion has stayed the same in ``patience`` consecutive disseminations, and then goes on as before. Disseminations in
  which it heard nobody do not count. With ``patience = 0`` the decision is the present opinion, which may change to the
  end: the consensus time is then that of an observer who watches to the end (``run.stop = "t_end"``).
"""

from __future__ import annotations

import math
from typing import Annotated, Final

from pydantic import Field

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.base import Strategy, array, register
from vibroswarm.strategies.bayes import Row
from vibroswarm.strategies.world import Draws, Reading, World, u

ROUNDING_S: Final = 1e-6
"""A timer this much before the end of a phase counts as the end: times are rounded."""


class Params:
    """Durations of the phases, and the stopping rule."""

    explore_s: Annotated[float, Field(gt=0, le=1e5, description="Mean time of an exploration, s.")] = 60.0
    disseminate_s: Annotated[
        float, Field(gt=0, le=1e5, description="Mean time of a dissemination at quality 1, s.")
    ] = 60.0
    listen_s: Annotated[
        float,
        Field(
            gt=0,
            le=1e5,
            description="Last part of a dissemination, in which a robot listens, s.",
        ),
    ] = 3.0
    interval_s: Annotated[
        float,
        Field(
            ge=0.02,
            le=1e5,
            description="Time between messages while disseminating, s: what the radio can carry.",
        ),
    ] = 1.0
    max_opinions: Annotated[
        int,
        Field(
            ge=1,
            le=100_000,
            description="Most opinions that count, the last ones heard.",
        ),
    ] = 2
    patience: Annotated[
        int,
        Field(
            ge=0,
            le=100_000,
            description="Disseminations without change after which a robot decides; 0: its decision is its opinion.",
        ),
    ] = 3


class State:
    """Opinion, phase, and what the phase has brought so far."""

    opinion: int
    quality: float
    is_disseminating: bool
    phase_end_s: float
    next_s: float
    readings: int
    alike: int
    heard: int
    unchanged: int
    decision: int


class Arrays:
    """Senders heard in this dissemination: in which order, from 1 (0: not heard); their opinions and qualities."""

    order = array("int32", "robots")
    opinion = array("int32", "robots")
    quality = array("float64", "robots")


class OpinionWithQuality:
    """A message of DC."""

    bit: int
    quality: float


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Draw an opinion and the duration of the first exploration; the timer is due at its end."""
    s.opinion, s.quality, s.decision = 1 if u(d, 0) < 0.5 else 0, 0.5, -1
    s.phase_end_s = -p.explore_s * math.log(u(d, 1))  # exponential, by inversion
    s.next_s = s.phase_end_s


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Store the sender's opinion, if the robot listens and has not heard this sender in this dissemination."""
    if listens(s, t_s, p) and a.order[sender] == 0:
        s.heard += 1
        a.order[sender], a.opinion[sender] = s.heard, m.bit


def on_message_dc(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Store the sender's opinion and quality, if the robot listens and this sender is new in this dissemination."""
    if listens(s, t_s, p) and a.order[sender] == 0:
        s.heard += 1
        a.order[sender], a.opinion[sender], a.quality[sender] = s.heard, m.bit, m.quality


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count a reading while exploring; nothing is sent, because the function called at the timer sends."""
    if not s.is_disseminating:
        s.readings += 1
        s.alike += 1 if x.reading == s.opinion else 0  # readings that equal the own opinion
    return False


def on_timer_dc(s: Row, a: Row, t_s: float, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Apply the rule of DC (comparison) at the end of a dissemination, change phases, send while disseminating."""
    if s.is_disseminating and is_over(s, t_s):
        j = heard_one(a.order, s.heard, p.max_opinions, u(d, 1))
        settle(s, a.order, a.opinion[j] if j >= 0 and a.quality[j] > s.quality else s.opinion, p)
    sends = go_on(s, t_s, u(d, 0), 1.0, p)  # in DC the mean is g whatever the quality
    out.bit, out.quality = s.opinion, quality(s)
    return sends


def on_timer_dmvd(s: Row, a: Row, t_s: float, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Apply the rule of DMVD (voter model) at the end of a dissemination, change phases, send while disseminating."""
    if s.is_disseminating and is_over(s, t_s):
        j = heard_one(a.order, s.heard, p.max_opinions, u(d, 1))
        settle(s, a.order, a.opinion[j] if j >= 0 else s.opinion, p)
    out.bit = s.opinion
    return go_on(s, t_s, u(d, 0), quality(s), p)


def on_timer_dmmd(s: Row, a: Row, t_s: float, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Apply the rule of DMMD (majority) at the end of a dissemination, change phases, send while disseminating."""
    if s.is_disseminating and is_over(s, t_s):
        settle(s, a.order, majority(a.order, a.opinion, s.heard - p.max_opinions, s.opinion), p)
    out.bit = s.opinion
    return go_on(s, t_s, u(d, 0), quality(s), p)


def decision(s: Row, a: Row, p: Row, w: World) -> int:
    """Return the decision (0, 1, or -1 while undecided), or the present opinion if ``patience`` is 0."""
    found: int = s.opinion if p.patience == 0 else s.decision
    return found


@inlined
def is_over(s: Row, t_s: float) -> bool:
    """Return whether the phase is over."""
    return bool(t_s >= s.phase_end_s - ROUNDING_S)


@inlined
def listens(s: Row, t_s: float, p: Row) -> bool:
    """Return whether the robot is in the last part of a dissemination."""
    return bool(s.is_disseminating and t_s >= s.phase_end_s - p.listen_s)


@inlined
def quality(s: Row) -> float:
    """Return q of the latest exploration or, if that has no reading so far, of the exploration before it."""
    found: float = s.alike / s.readings if s.readings > 0 else s.quality
    return found


@inlined
def heard_one(order: Row, heard: int, most: int, number: float) -> int:
    """Draw one of the last ``most`` robots heard; return its number, or -1 if nobody was heard."""
    count = min(heard, most)
    # Position of the robot to return; the robot heard last has position ``heard``. The inner min() is there because
    # number * count may be rounded up to ``count``. If nobody was heard, ``wanted`` is 1, a position that no robot has.
    # ``wanted > 0`` is a safeguard: position 0 marks robots not heard, and must not match.
    wanted = heard - min(int(number * count), count - 1)
    for j in range(order.size):
        if order[j] == wanted and wanted > 0:
            return j
    return -1


@inlined
def majority(order: Row, opinions: Row, before: int, own: int) -> int:
    """Return the majority of the opinions heard last and of the own opinion; the own opinion if there is a tie."""
    lead = 2 * own - 1  # opinions for 1 minus opinions for 0
    for j in range(order.size):
        if order[j] > max(before, 0):
            lead += 2 * opinions[j] - 1
    return 1 if lead > 0 else (0 if lead < 0 else own)


@inlined
def settle(s: Row, order: Row, opinion: int, p: Row) -> None:
    """End a dissemination: set the opinion, forget who was heard, and decide by the stopping rule."""
    if s.heard > 0:
        s.unchanged = s.unchanged + 1 if opinion == s.opinion else 0
    s.opinion = opinion
    if s.decision == -1 and s.heard > 0 and s.unchanged >= p.patience:
        s.decision = opinion
    forget(order)
    s.heard = 0


@inlined
def forget(order: Row) -> None:
    """Forget who was heard: set all positions to 0."""
    for j in range(order.size):
        order[j] = 0


@inlined
def go_on(s: Row, t_s: float, number: float, share: float, p: Row) -> bool:
    """Change to the next phase if the present one is over, and set the next timer."""
    # While exploring, the phase is over whenever this is called: the timer is due only at its end.
    if is_over(s, t_s):
        if s.is_disseminating:
            s.is_disseminating, s.readings, s.alike = False, 0, 0
            s.phase_end_s = t_s - p.explore_s * math.log(number)  # exponential, by inversion
            s.next_s = s.phase_end_s
            return False
        s.is_disseminating, s.quality = True, quality(s)
        # An exponential time, by inversion, and then the time in which the robot listens.
        s.phase_end_s = t_s - p.disseminate_s * share * math.log(number) + p.listen_s
    s.next_s = min(t_s + p.interval_s, s.phase_end_s)
    return True


dc = register(
    Strategy(
        name="dc",
        params=Params,
        state=State,
        arrays=Arrays,
        message=OpinionWithQuality,
        begin=begin,
        on_message=on_message_dc,
        on_sample=on_sample,
        on_timer=on_timer_dc,
        decision=decision,
        bytes_on_air=4,
        boundary_half=True,
        reports=("opinion", "quality"),
        about="direct comparison: robots explore, disseminate an opinion, and adopt a better one",
    )
)
dmvd = register(
    Strategy(
        name="dmvd",
        params=Params,
        state=State,
        arrays=Arrays,
        begin=begin,
        on_message=on_message,
        on_sample=on_sample,
        on_timer=on_timer_dmvd,
        decision=decision,
        bytes_on_air=2,
        boundary_half=True,
        reports=("opinion", "quality"),
        about="direct modulation, voter: robots explore, disseminate an opinion, and adopt one that they heard",
    )
)
dmmd = register(
    Strategy(
        name="dmmd",
        params=Params,
        state=State,
        arrays=Arrays,
        begin=begin,
        on_message=on_message,
        on_sample=on_sample,
        on_timer=on_timer_dmmd,
        decision=decision,
        bytes_on_air=2,
        boundary_half=True,
        reports=("opinion", "quality"),
        about="direct modulation, majority: robots explore, disseminate an opinion, and adopt the most frequent one",
    )
)
