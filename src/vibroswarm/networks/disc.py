"""A network with a range: robots hear a message if they are near enough to its sender when it is sent.

| name | symbol | unit | equation |
|---|---|---|---|
| range_m | r | m | heard if (x - x_s)^2 + (y - y_s)^2 <= r^2 |

A disc is the usual model in swarm studies, for example of Ebert et al. (2020) for Kilobots. It ignores that real radios
reach further in some directions than in others, and that signals fade.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from vibroswarm.networks.base import Network, register
from vibroswarm.strategies.world import Draws, World


class Params:
    """How far a message reaches."""

    range_m: Annotated[
        float,
        Field(
            gt=0,
            allow_inf_nan=True,
            description="Largest distance that a message crosses, m; or inf.",
        ),
    ] = 0.5


def send(
    n: Any, a: Any, sender: int, tick: int, number: int, bytes_on_air: int, x_m: Any, y_m: Any,
    arrival_tick: Any, d: Draws, p: Any, w: World,
) -> None:  # fmt: skip
    """Let the robots within range read the message at the next tick."""
    x_s, y_s, r2 = x_m[sender], y_m[sender], p.range_m * p.range_m
    for j in range(arrival_tick.size):
        if (x_m[j] - x_s) ** 2 + (y_m[j] - y_s) ** 2 <= r2:
            arrival_tick[j] = tick + 1


disc = register(
    Network(name="range", params=Params, send=send, about="robots within a distance of the sender hear it")
)
