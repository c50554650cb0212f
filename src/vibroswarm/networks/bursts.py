"""A network in which each receiver sometimes misses nearly all messages for a while: a Gilbert-Elliott model.

Each receiver is in a good or a bad state, and loses messages independently with the probability of that state. States
change as a Markov chain in time, not per message, so that a burst lasts as long in a large swarm as in a small one.

| name | symbol | unit | equation |
|---|---|---|---|
| bad_share | b | - | share of time in the bad state |
| bad_s | T | s | mean time in the bad state |
| correlation time | tau | s | T (1 - b) |
| state redrawn after t seconds | - | - | with probability 1 - exp(-t / tau); it is then bad with probability b |
| lost_in_bad, lost_in_good | - | - | probability that a message is lost in that state |

With T = 0 the state is redrawn for each message, so losses are independent, with probability
b lost_in_bad + (1 - b) lost_in_good. In the models of Gilbert (1960) and Elliott (1963) the chain steps at each bit
that is sent; in the recordings the length of bursts is a matter of time. The defaults are fitted to the recordings of
the study's robots (docs/networks-and-faults.md).
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Field

from vibroswarm.networks.base import Network, register
from vibroswarm.strategies.base import array
from vibroswarm.strategies.world import Draws, World, u


class Params:
    """How receivers fail."""

    bad_share: Annotated[
        float,
        Field(
            ge=0,
            le=1,
            description="Share of time in the bad state.",
        ),
    ] = 0.0129
    bad_s: Annotated[
        float, Field(ge=0, le=1e9, description="Mean time in the bad state, s; 0: losses are independent.")
    ] = 10.3
    lost_in_bad: Annotated[
        float,
        Field(
            ge=0,
            le=1,
            description="Probability that a message is lost in the bad state.",
        ),
    ] = 1.0
    lost_in_good: Annotated[float, Field(ge=0, le=1, description="The same in the good state.")] = 0.0095


class Arrays:
    """The state of each receiver."""

    is_bad = array("uint8", "robots")
    """1 if the receiver is in the bad state, else 0."""
    next_tick = array("int64", "robots")
    """Tick of the last message + 1; 0: no message yet (all arrays begin at 0)."""


def send(
    n: Any, a: Any, sender: int, tick: int, number: int, bytes_on_air: int, x_m: Any, y_m: Any,
    arrival_tick: Any, d: Draws, p: Any, w: World,
) -> None:  # fmt: skip
    """Advance each receiver's state to ``tick``; a message that is not lost can be read at the next tick."""
    tau_s = p.bad_s * (1.0 - p.bad_share)
    for j in range(arrival_tick.size):
        # The receiver's state is redrawn at its first message, and later with a probability that grows with the time
        # since the last message (``next_tick`` is that message's tick + 1).
        since_s = (tick + 1 - a.next_tick[j]) * w.tick_s
        anew = a.next_tick[j] == 0 or tau_s <= 0.0 or u(d, 3 * j) < -math.expm1(-since_s / tau_s)
        if anew:
            a.is_bad[j] = u(d, 3 * j + 1) < p.bad_share
        a.next_tick[j] = tick + 1
        share = p.lost_in_bad if a.is_bad[j] else p.lost_in_good
        if u(d, 3 * j + 2) >= share:
            arrival_tick[j] = tick + 1


bursts = register(
    Network(
        name="bursts",
        params=Params,
        arrays=Arrays,
        send=send,
        positions=False,
        about="receivers miss messages in bursts",
    )
)
