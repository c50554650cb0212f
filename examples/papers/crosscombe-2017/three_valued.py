"""Three-valued beliefs: a robot believes one option, the other, or neither; it signals, then combines beliefs.

Crosscombe, Lawry, Hauert and Homer 2017, IROS; rules as in the authors' public program for Kilobots, with two
options.

| name | symbol | unit | equation |
|---|---|---|---|
| truth | v | - | twice the truth value of "most vibrate": 0 false, 1 uncertain, 2 true |
| combined | - | - | of the own belief and one heard: v + v_j - 1, clipped to [0, 2] |
| signal time | - | s | ``signal_s`` times the share of own readings that are of the option signalled (ours) |

With two options each belief is (0, 1), (1/2, 1/2) or (1, 0), so one number v describes it. An uncertain robot takes the
belief that it hears; an uncertain belief heard changes nothing; true combined with false gives uncertain. A robot
signals for its option (an uncertain robot draws one), then listens, then combines its belief with that of one robot
drawn from those heard, and signals again. At time 0 the belief is drawn from the three values, and a robot begins with
signalling or with listening, with probability 1/2 each.

- Message, every ``interval_s`` while signalling: sender and belief, 2 bytes. Messages of the original have 4 bytes:
  also the sender's state and option, which no receiver uses.
- What a robot knows of its task: nothing. It works for a boundary of 1/2 only.
- Differences from the original: each robot hears all others. In the original nothing is sensed: robots signal for 7 or
  9 ticks of 0.5 s, constants of the two options, and listen for one tick. Here the signal time is in proportion to the
  share of own readings so far (taken as 1/2 before the first reading).
- The stopping rule is ours, as in ``valentini``: a robot decides once its belief is certain and has stayed the same in
  ``patience`` consecutive updates. Updates in which it heard nobody do not count.
"""

from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import array, strategy_in, u
from vibroswarm.strategies.bayes import decision

__all__ = ["decision", "three_valued"]

ROUNDING_S = 1e-6
"""A timer this much before the end of a phase counts as the end: times are rounded."""


class Params:
    """Durations, and the stopping rule."""

    signal_s: Annotated[float, Field(gt=0, le=1e5, description="Time of signalling at a share of 1, s.")] = (
        60.0
    )
    listen_s: Annotated[
        float, Field(gt=0, le=1e5, description="Time of listening before each update, s.")
    ] = 3.0
    interval_s: Annotated[
        float,
        Field(
            ge=0.02,
            le=1e5,
            description="Time between messages while signalling, s: what the radio can carry.",
        ),
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


def opposite(m):
    """Turn true into false, and false into true."""
    m.truth = 2 - m.truth


def begin(s, a, d, p, w):
    """Draw a belief, and draw whether to begin with signalling or with listening."""
    s.truth, s.decision = int(3.0 * u(d, 0)), -1
    if u(d, 1) < 0.5:  # next_s stays 0: the robot signals at once
        s.is_signalling, s.phase_end_s = True, signal_time(s, u(d, 2), p)
    else:
        s.phase_end_s = p.listen_s
        s.next_s = p.listen_s


def on_message(s, a, m, sender, t_s, d, p, w):
    """Store the sender's belief if the robot is listening and has not heard this sender in this phase."""
    if not s.is_signalling and a.order[sender] == 0:
        s.heard += 1
        a.order[sender], a.truth[sender] = s.heard, m.truth


def on_sample(s, a, x, out, d, p, w):
    """Count a reading; nothing is sent, because ``on_timer`` sends."""
    s.readings += 1
    s.ones += x.reading
    return False


def on_timer(s, a, t_s, out, d, p, w):
    """Send the belief while signalling, and change phase when a phase ends.

    After signalling the robot listens, and sends nothing. After listening it updates its belief and signals again.
    """
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


def signal_time(s, number, p):
    """Return how long to signal, s; at least ``interval_s``, which is enough for one message.

    Args:
        number: uniform number, by which an uncertain robot draws the option that it signals.
    """
    share = s.ones / s.readings if s.readings > 0 else 0.5
    is_one = s.truth == 2 or (s.truth == 1 and number < 0.5)
    return float(max(p.signal_s * (share if is_one else 1.0 - share), p.interval_s))


def update(s, order, truths, number, p):
    """Combine the belief with that of one robot heard, forget who was heard, and decide by the stopping rule.

    If nobody was heard, nothing changes.

    Args:
        order, truths: (robots,), the robot's arrays ``order`` and ``truth``: the position at which each robot was heard
            (0: not heard), and its belief. number: uniform number that selects the robot.
    """
    j = heard_one(order, s.heard, s.heard, number)  # drawn from all robots heard, so ``most`` is their number
    if j < 0:
        return
    truth = combined(s.truth, truths[j])
    s.unchanged = s.unchanged + 1 if truth == s.truth and truth != 1 else 0
    s.truth, s.heard = truth, 0
    forget(order)
    if s.decision == -1 and s.unchanged >= p.patience:
        s.decision = truth // 2  # truth is 0 or 2 here: an uncertain belief sets ``unchanged`` to 0


def heard_one(order, heard, most, number):
    """Draw one of the last ``most`` robots heard; return its number, or -1 if nobody was heard.

    Args:
        order: (robots,), position at which each robot was heard, from 1; 0: not heard. heard: number of robots heard.
            most: number of robots, the last ones heard, of which one is drawn. number: uniform number in (0, 1).
    """
    count = min(heard, most)
    # Position of the robot to return; the robot heard last has position ``heard``. The inner min() is there because
    # number * count may be rounded up to ``count``. If nobody was heard, ``wanted`` is 1, a position that no robot has.
    # ``wanted > 0`` is a safeguard: position 0 marks robots not heard, and must not match.
    wanted = heard - min(int(number * count), count - 1)
    for j in range(order.size):
        if order[j] == wanted and wanted > 0:
            return j
    return -1


def forget(order):
    """Forget who was heard: set all positions to 0."""
    for j in range(order.size):
        order[j] = 0


def combined(own, heard):
    """Return the own belief combined with a belief heard: 0, 1 or 2, see the table."""
    return min(max(own + heard - 1, 0), 2)


three_valued = strategy_in(
    __name__,
    "three_valued",
    bytes_on_air=2,
    boundary_half=True,
    reports=("truth",),
    about="three-valued: robots signal a belief, which may be uncertain, and adopt one that they heard",
)
