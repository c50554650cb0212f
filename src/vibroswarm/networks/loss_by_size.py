"""A network that loses messages independently, with the share that the study's radio lost at this swarm size.

| name | symbol | unit | equation |
|---|---|---|---|
| robots | n | - | 5 to 10, as in the experiments |
| share lost | l | - | L (1 - exp(-(n - n_0) / m)) |
| share lost by large swarms | L | - | 0.0921 |
| size without loss | n_0 | robots | 4.81 |
| scale | m | robots | 1.75 |

The study plots the share of packets lost at six sizes (``experiments.packet_loss_percent`` in
``paper/published.json``); of the messages addressed to a robot it is n / (n - 1) times that: 0.9 to 9.0 %. Of seven
forms, fitted by least squares and compared by leaving out one size at a time, this one was chosen (root mean square
error of the size left out 0.5 points; a straight line 1.7). Its residuals are up to 0.4 points. A test repeats the
fit. Outside of 5 to 10 robots nothing was measured, and other sizes are refused.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vibroswarm.errors import InputError
from vibroswarm.networks.base import Network, register
from vibroswarm.strategies.world import Draws, World, u

LARGE: Final = 0.0921
NO_LOSS: Final = 4.81
SCALE: Final = 1.75
FEWEST: Final = 5
MOST: Final = 10


def share_lost(robots: int) -> float:
    """Return the share of messages addressed to a robot that are lost in a swarm of 5 to 10 robots."""
    return LARGE * (1.0 - math.exp(-(robots - NO_LOSS) / SCALE))


def lost(sender: int, receiver: int, d: Draws, p: Any, w: World) -> bool:
    """Return whether this message is lost on its way to this receiver."""
    return u(d, 0) < share_lost(w.robots)


def check(params: Any, robots: int) -> None:
    """Refuse swarms of a size at which no loss was measured.

    Raises:
        InputError: fewer than 5 or more than 10 robots.
    """
    if not FEWEST <= robots <= MOST:
        raise InputError(
            f"{robots} robots: network 'loss_by_size' is fitted to swarms of {FEWEST} to {MOST}; choose such a size, "
            "or network 'loss' with a share of your own",
            field="swarm.robots",
        )


loss_by_size = register(
    Network(
        name="loss_by_size", lost=lost, check=check, about="lost independently, as in the study's experiments"
    )
)
