"""A network that loses each message to each receiver independently, with one probability.

| name | symbol | unit | equation |
|---|---|---|---|
| share | - | - | probability that a message does not reach a receiver |
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from vibroswarm.networks.base import Network, register
from vibroswarm.strategies.world import Draws, World, u


class Params:
    """How many messages are lost."""

    share: Annotated[
        float, Field(ge=0, le=1, description="Probability that a message does not reach a receiver.")
    ] = 0.0


def lost(sender: int, receiver: int, d: Draws, p: Any, w: World) -> bool:
    """Return whether a message is lost on its way to one receiver."""
    # The first test saves drawing a number if nothing can be lost.
    return bool(p.share > 0.0 and u(d, 0) < p.share)


loss = register(
    Network(name="loss", params=Params, lost=lost, about="messages are lost independently at each receiver")
)
