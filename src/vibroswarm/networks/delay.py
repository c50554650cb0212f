"""A network that delays messages by a fixed time plus a random time drawn for each message and receiver.

| name | symbol | unit | equation |
|---|---|---|---|
| fixed_s | D | s | fixed part |
| random_s | R | s | mean of the exponential part |
| delay of a message to a receiver | - | s | D - R ln u |

Messages may overtake each other. A message is read at the first control period after its delay, and never in the period
in which it was sent.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Field

from vibroswarm.networks.base import Network, register
from vibroswarm.strategies.world import Draws, World, u

MOST_TICKS = 1e15
"""Limit on the delay, in ticks, so that it fits into an integer; no run is that long."""


class Params:
    """How late messages are."""

    fixed_s: Annotated[
        float,
        Field(ge=0, le=1e9, description="Part of the delay that all messages have, s: the radio's own."),
    ] = 1.0
    random_s: Annotated[
        float,
        Field(
            ge=0,
            le=1e9,
            description="Mean of the exponential part, drawn for each message and receiver, s: messages overtake each "
            "other.",
        ),
    ] = 0.0


def send(
    n: Any, a: Any, sender: int, tick: int, number: int, bytes_on_air: int, x_m: Any, y_m: Any,
    arrival_tick: Any, d: Draws, p: Any, w: World,
) -> None:  # fmt: skip
    """Write, for each robot, the first tick at which the message's delay is over."""
    for j in range(arrival_tick.size):
        delay_s = p.fixed_s
        if p.random_s > 0.0:
            delay_s -= p.random_s * math.log(u(d, j))
        # Without the 1e-9, rounding could make n + 1 ticks of a delay of n whole ticks.
        ticks = math.ceil(min(delay_s / w.tick_s, MOST_TICKS) - 1e-9)
        arrival_tick[j] = tick + max(1, ticks)


delay = register(
    Network(
        name="delay", params=Params, send=send, positions=False, about="messages are late, also by chance"
    )
)
