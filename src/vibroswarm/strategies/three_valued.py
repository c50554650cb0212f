"""Three-valued beliefs: a robot believes one option, the other, or neither; it signals, then takes in a belief.

Crosscombe, Lawry, Hauert and Homer 2017, IROS; rules as in the authors' public program for Kilobots, with two
options.

| name | symbol | unit | equation |
|---|---|---|---|
| truth | v | - | twice the truth value of "most vibrate": 0 false, 1 uncertain, 2 true |
| combined | - | - | own and heard: v + v_j - 1, clipped to [0, 2] |
| signal time | - | s | g times the share of own readings of the option signalled (ours) |

With two options each belief is (0, 1), (1/2, 1/2) or (1, 0): one number. Uncertain takes the other's value, uncertain
heard changes nothing, 0 with 1 gives uncertain. A robot signals for its option (an uncertain one draws it), listens,
takes in the belief of one of the robots it heard, drawn at random, and signals again. At time 0 the belief is one of
the three, and a robot signals with probability 1/2.

- Message, every ``interval_s`` while signalling: sender and belief, 2 bytes (the original: 4, sent by all robots,
  with the state and the option, which no receiver uses).
- Told to a robot: nothing. Boundary 1/2 only.
- Ours: all hear all. In the original nothing is sensed: robots signal for 7 or 9 ticks of 0.5 s, constants of the two
  options, and listen for one tick; here the time is in proportion to the own readings so far (1/2 before the first).
- Ours, the stopping rule, as in ``valentini``: a robot decides once its belief is certain and has stayed the same in
  ``patience`` updates in a row in which it heard others.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from vibroswarm.core.jit import inlined
from vibroswarm.strategies.base import array, register, strategy_in
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.valentini import ROUNDING_S, forget, heard_one
from vibroswarm.strategies.world import Draws, Reading, World, u

__all__ = ["decision", "three_valued"]


class Params:
    """Durations, and the stopping rule."""

    signal_s: Annotated[float, Field(gt=0, le=1e5, description="Time of signalling at a share of 1, s.")] = (
        60.0
    )
    listen_s: Annotated[
        float, Field(gt=0, le=1e5, description="Time of listening before each update, s.")
    ] = 3.0
    interval_s: Annotated[
        float, Field(ge=0.02, le=1e5, description="Time between messages while signalling, s.")
    ] = 1.0
    patience: Annotated[
        int, Field(ge=1, le=100_000, description="Updates without change after which a robot decides.")
    ] = 10


class State:
    """Belief, phase, and what was read and heard."""

    truth: int
    is_signalling: bool
    phase_end_s: float
    next_s: float
    readings: int
    ones: int
    heard: int
    unchanged: int
    decision: int


class Arrays:
    """Senders heard while listening: in which order, from 1 (0: not heard); and their beliefs."""

    order = array("int32", "robots")
    truth = array("int32", "robots")


class Message:
    """A belief."""

    truth: int


def opposite(m: Row) -> None:
    """Turn true into false, and false into true."""
    m.truth = 2 - m.truth


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Draw a belief, and signal or listen."""
    s.truth, s.decision = int(3.0 * u(d, 0)), -1
    if u(d, 1) < 0.5:
        s.is_signalling, s.phase_end_s = True, signal_time(s, u(d, 2), p)
    else:
        s.phase_end_s = p.listen_s
        s.next_s = p.listen_s


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Note the sender's belief, while listening."""
    if not s.is_signalling and a.order[sender] == 0:
        s.heard += 1
        a.order[sender], a.truth[sender] = s.heard, m.truth


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Count a reading."""
    s.readings += 1
    s.ones += x.reading
    return False


def on_timer(s: Row, a: Row, t_s: float, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Signal, listen, or update and signal again."""
    if t_s >= s.phase_end_s - ROUNDING_S:
        if s.is_signalling:
            s.is_signalling = False
            s.phase_end_s = t_s + p.listen_s
            s.next_s = s.phase_end_s
            return False
        update(s, a.order, a.truth, u(d, 0), p)
        s.is_signalling, s.phase_end_s = True, t_s + signal_time(s, u(d, 1), p)
    s.next_s = min(t_s + p.interval_s, s.phase_end_s)
    out.truth = s.truth
    return True


@inlined
def signal_time(s: Row, number: float, p: Row) -> float:
    """Return how long to signal, s; an uncertain robot draws its option by a uniform number."""
    share = s.ones / s.readings if s.readings > 0 else 0.5
    is_one = s.truth == 2 or (s.truth == 1 and number < 0.5)
    return float(max(p.signal_s * (share if is_one else 1.0 - share), p.interval_s))


@inlined
def update(s: Row, order: Row, truths: Row, number: float, p: Row) -> None:
    """Take in the belief of one robot heard, and decide if nothing has changed for long enough."""
    j = heard_one(order, s.heard, s.heard, number)
    if j < 0:
        return
    truth = combined(s.truth, truths[j])
    s.unchanged = s.unchanged + 1 if truth == s.truth and truth != 1 else 0
    s.truth, s.heard = truth, 0
    forget(order)
    if s.decision == -1 and s.unchanged >= p.patience:
        s.decision = truth // 2


@inlined
def combined(own: int, heard: int) -> int:
    """Return the belief that two robots agree on."""
    return min(max(own + heard - 1, 0), 2)


three_valued = register(
    strategy_in(
        __name__,
        "three_valued",
        bytes_on_air=2,
        boundary_half=True,
        about="three-valued: robots signal a belief, which may be uncertain, and take in one that they heard",
    )
)
