"""Can the swarm agree where no answer is better? On which side, how soon, and for how long?

The floor is symmetric: its kinds of tile are equally common, or as equally as its number of tiles allows.

| name | symbol | unit | equation |
|---|---|---|---|
| tiles of a kind | n_k | - | max n_k - min n_k is at most 1 |
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.tasks import majority
from vibroswarm.tasks.base import Asked, Task, register
from vibroswarm.tasks.fill_ratio import ANSWERS as FILL_RATIO


def truth(floor: Floor, asked: Asked, p: Any) -> None:
    """Return None: no answer is right."""


def check(floor: Floor, asked: Asked, p: Any) -> None:
    """Refuse floors on which one kind of tile is more common than another."""
    majority.check(floor, asked, p)
    tiles = np.bincount(floor.tiles.ravel(), minlength=asked.kinds)
    if np.ptp(tiles) > 1:
        raise InputError(
            f"'agree' needs as many tiles of each kind, and not {tiles.tolist()}; choose majority",
            field="task.name",
        )


def answers(kinds: int) -> tuple[str, ...]:
    """Return the sides in words."""
    return FILL_RATIO if kinds == 2 else majority.answers(kinds)


agree = register(
    Task(
        name="agree",
        truth=truth,
        check=check,
        about="on a symmetric floor: on which side does a swarm agree, how soon, and for how long?",
        answers=answers,
    )
)
