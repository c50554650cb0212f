"""Has the floor changed since the start?

| name | symbol | unit | equation |
|---|---|---|---|
| changed share | - | - | tiles of another kind than at time 0, by area inside the arena, as a share of all |
| answer | - | 1: changed | 1 if that share is above ``more_than``, else 0 |

The truth is a function of time (``analysis.answers_over_time``): the delay of the answer says how long after the change
the swarm noticed it, and false changes how often it did without one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from vibroswarm.floors.floor import Floor
from vibroswarm.tasks.base import Asked, Task, register


class Params:
    """What counts as a change."""

    more_than: Annotated[
        float,
        Field(
            ge=0, lt=1, description="The floor has changed if more than this share of it is of another kind."
        ),
    ] = 0.0


def truth(floor: Floor, asked: Asked, p: Any) -> int:
    """Return 1 if more than ``p.more_than`` of the floor is of another kind than at time 0, else 0."""
    start = floor if asked.start is None else asked.start
    differs = replace(floor, tiles=(floor.tiles != start.tiles).astype(np.uint8))
    return int(differs.share_within(1, asked.width_m, asked.height_m) > p.more_than)


changed = register(
    Task(
        name="changed",
        truth=truth,
        params=Params,
        about="has the floor changed since the start?",
        answers=("the floor is as it was", "the floor has changed"),
    )
)
