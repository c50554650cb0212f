"""Has the floor changed since the start, or since the robot's last answer that it has?

| name | symbol | unit | equation |
|---|---|---|---|
| changed share | - | - | tiles of another kind than then, by area inside the arena, as a share of all |
| answer | - | 1: changed | 1 if that share is above ``more_than``, else 0 |
| then | - | s | 0, or with ``since = "answer"`` the time at which the robot's answer last became 1 |

The truth is a function of time (``statistics.over_time``): the delay of the answer says how long after the
change it was noticed, and false changes how often it was without one. When it changed is what strategies report as
``changed_s``. With ``since = "answer"`` the truth is each robot's own, and a run has none.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import Field

from vibroswarm.floors.floor import Floor
from vibroswarm.tasks.base import Asked, Task, register
from vibroswarm.tasks.fill_ratio import ON_THE_BOUNDARY


class Params:
    """What counts as a change."""

    more_than: Annotated[
        float,
        Field(
            ge=0, lt=1, description="The floor has changed if more than this share of it is of another kind."
        ),
    ] = 0.0
    since: Annotated[
        Literal["start", "answer"],
        Field(description="Since when: the start, or the robot's last answer that it has changed."),
    ] = "start"


def truth(floor: Floor, asked: Asked, p: Any) -> int:
    """Return 1 if more than ``p.more_than`` of the floor is of another kind than at ``asked.start``, else 0."""
    start = floor if asked.start is None else asked.start
    # 1 where the floor differs, whatever contrasts or patches it has
    differs = replace(floor, levels=floor.tiles != start.tiles, patches=())
    return int(differs.share_within(1, asked.width_m, asked.height_m) - p.more_than > ON_THE_BOUNDARY)


changed = register(
    Task(
        name="changed",
        truth=truth,
        params=Params,
        about="has the floor changed since the start, or since a robot last said so?",
        answers=("the floor is as it was", "the floor has changed"),
        asked_anew=lambda p: bool(p.since == "answer"),
        presumed=0,
    )
)
