"""Networks in which every robot hears every other: without loss, or with messages lost independently.

| network | name | symbol | unit | equation |
|---|---|---|---|---|
| ``loss`` | share | - | - | probability that a message does not reach a receiver |
| ``loss_by_size`` | robots | n | - | 5 to 10, as in the experiments |
| ``loss_by_size`` | share lost | l | - | L (1 - exp(-(n - n_0) / m)) |

L = 0.0921 is the share lost by large swarms, n_0 = 4.81 robots the size without loss, m = 1.75 robots the scale. The
study plots the share of packets lost at six swarm sizes (``experiments.packet_loss_percent`` in
``paper/published.json``). It is a share of the messages of all n robots. Those of the receiver itself are never lost,
so l, the share of the messages that the n - 1 others send it, is n / (n - 1) times as large: 0.9 to 9.0 %. Seven
formulas were fitted by least squares and compared by leaving out one size at a time. This one was chosen: the root mean
square error at the size left out is 0.5 percentage points (a straight line: 1.7), and its residuals are at most 0.4
points. A test repeats the fit. Nothing was measured outside of 5 to 10 robots, so other sizes are refused.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Final

from pydantic import Field

from vibroswarm.errors import InputError
from vibroswarm.networks.base import Network, register
from vibroswarm.strategies.world import Draws, World, u

LARGE: Final = 0.0921
"""L: share lost by large swarms."""
NO_LOSS: Final = 4.81
"""n_0: number of robots at which nothing is lost."""
SCALE: Final = 1.75
"""m: scale of the growth of losses with the number of robots."""
FEWEST: Final = 5
"""Smallest swarm of the experiments."""
MOST: Final = 10
"""Largest swarm of the experiments."""


class Params:
    """How many messages are lost."""

    share: Annotated[
        float, Field(ge=0, le=1, description="Probability that a message does not reach a receiver.")
    ] = 0.0


def lost(sender: int, receiver: int, d: Draws, p: Any, w: World) -> bool:
    """Return whether a message is lost on its way to one receiver."""
    # The first test saves drawing a number if nothing can be lost.
    return bool(p.share > 0.0 and u(d, 0) < p.share)


def share_lost(robots: int) -> float:
    """Return l: the share of the messages of other robots that a receiver loses, in a swarm of 5 to 10 robots."""
    return LARGE * (1.0 - math.exp(-(robots - NO_LOSS) / SCALE))


def lost_by_size(sender: int, receiver: int, d: Draws, p: Any, w: World) -> bool:
    """Return whether a message is lost on its way to one receiver."""
    return u(d, 0) < share_lost(w.robots)


def check(params: Any, robots: int) -> None:
    """Refuse swarms of a size at which no loss was measured; the network has no parameters to check."""
    if not FEWEST <= robots <= MOST:
        raise InputError(
            f"network 'loss_by_size' is fitted to swarms of {FEWEST} to {MOST}, not of {robots}; choose such a size, "
            "or network 'loss' with a share of your own",
            field="swarm.robots",
        )


ideal = register(Network(name="ideal", about="every robot hears every other"))
loss = register(
    Network(name="loss", params=Params, lost=lost, about="messages are lost independently at each receiver")
)
loss_by_size = register(
    Network(
        name="loss_by_size",
        lost=lost_by_size,
        check=check,
        about="lost independently, as in the study's experiments",
    )
)
