"""A network in which a receiver now and then misses nearly everything for a while: Gilbert-Elliott, by receiver.

Each receiver is in a good or a bad state, and loses messages independently with the probability of that state.
States change as a Markov chain in time, so that a burst lasts as long in a large swarm as in a small one.

| name | symbol | unit | equation |
|---|---|---|---|
| bad_share | b | - | share of time in the bad state |
| bad_s | T | s | mean time in the bad state |
| correlation time | tau | s | T (1 - b) |
| state drawn anew after t seconds | - | - | with probability 1 - exp(-t / tau), and then bad with b |
| lost_in_bad, lost_in_good | - | - | probability that a message is lost in that state |

With T = 0 every message finds a state of its own, and losses are independent, with probability
b lost_in_bad + (1 - b) lost_in_good. Gilbert (1960) and Elliott (1963) have the chain step at each bit sent; in the
recordings bursts end by time. The defaults are fitted to the recordings of the study's robots
(``calibrate.message_loss``, docs/networks.md).
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

    bad_share: Annotated[float, Field(ge=0, le=1, description="Share of time in the bad state.")] = 0.0129
    bad_s: Annotated[
        float, Field(ge=0, le=1e9, description="Mean time in the bad state, s; 0: losses are independent.")
    ] = 10.3
    lost_in_bad: Annotated[
        float, Field(ge=0, le=1, description="Probability that a message is lost in the bad state.")
    ] = 1.0
    lost_in_good: Annotated[float, Field(ge=0, le=1, description="The same in the good state.")] = 0.0095


class Arrays:
    """The state of each receiver."""

    is_bad = array("uint8", "robots")
    next_tick = array("int64", "robots")
    """One tick after the message to which the state belongs; 0: none yet."""


def send(
    n: Any, a: Any, sender: int, tick: int, number: int, bytes_on_air: int, x_m: Any, y_m: Any,
    arrival_tick: Any, d: Draws, p: Any, w: World,
) -> None:  # fmt: skip
    """Advance the state of each receiver to this message; those that do not lose it can read it at the next tick."""
    tau_s = p.bad_s * (1.0 - p.bad_share)
    for j in range(arrival_tick.size):
        since_s = (tick + 1 - a.next_tick[j]) * w.tick_s
        anew = a.next_tick[j] == 0 or tau_s <= 0.0 or u(d, 3 * j) < -math.expm1(-since_s / tau_s)
        if anew:
            a.is_bad[j] = u(d, 3 * j + 1) < p.bad_share
        a.next_tick[j] = tick + 1
        share = p.lost_in_bad if a.is_bad[j] else p.lost_in_good
        if u(d, 3 * j + 2) >= share:
            arrival_tick[j] = tick + 1


bursts = register(
    Network(name="bursts", params=Params, arrays=Arrays, send=send, about="receivers miss messages in bursts")
)
