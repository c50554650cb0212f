"""Which share of the tiles vibrates? A number, not a decision: the robots' estimates are scored.

| name | symbol | unit | equation |
|---|---|---|---|
| share | f | - | Eq. 3, of the part of the floor that lies in the arena: tiles of kind 1 |
"""

from __future__ import annotations

from typing import Any

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.tasks.base import Asked, Task, register
from vibroswarm.tasks.fill_ratio import ANSWERS


def truth(floor: Floor, asked: Asked, p: Any) -> float:
    """Return the fill ratio in the arena."""
    return asked.fill_ratio


def check(floor: Floor, asked: Asked, p: Any) -> None:
    """Refuse floors whose tiles have values, of which none or all vibrate."""
    if floor.surface.values is not None:
        raise InputError(
            "'share' asks for the share of tiles that vibrate, and these have values; choose mean",
            field="task.name",
        )


share = register(
    Task(
        name="share",
        truth=truth,
        check=check,
        about="which share of the tiles vibrates? The robots' estimates are scored",
        answers=ANSWERS,
        estimated="share of tiles that vibrate",
    )
)
