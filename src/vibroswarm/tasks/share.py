"""Which share of the tiles vibrates? A number, not a decision: the robots' estimates are scored.

| name | symbol | unit | equation |
|---|---|---|---|
| share | f | - | Eq. 3, of the part of the floor that lies in the arena: tiles of kind 1 |
"""

from __future__ import annotations

from typing import Any

from vibroswarm.floors.floor import Floor
from vibroswarm.tasks.base import Asked, Task, register
from vibroswarm.tasks.fill_ratio import ANSWERS


def truth(floor: Floor, asked: Asked, p: Any) -> float:
    """Return the fill ratio in the arena."""
    return asked.fill_ratio


share = register(
    Task(
        name="share",
        truth=truth,
        about="which share of the tiles vibrates? The robots' estimates are scored",
        answers=ANSWERS,
        estimated="share of tiles that vibrate",
    )
)
