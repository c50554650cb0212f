"""Can the swarm agree where no answer is better? On which side, how soon, and for how long?

The floor is symmetric: its kinds of tile are equally common, or as equally as its number of tiles allows.

| name | symbol | unit | equation |
|---|---|---|---|
| tiles of a kind | n_k | - | max n_k - min n_k is at most 1 |
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibroswarm.core.numbers import count, listed
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.tasks import majority
from vibroswarm.tasks.base import Asked, Task, register
from vibroswarm.tasks.fill_ratio import ANSWERS as FILL_RATIO


def truth(floor: Floor, asked: Asked, p: Any) -> None:
    """Return None: no answer is right."""


def check(floor: Floor, asked: Asked, p: Any) -> None:
    """Refuse floors on which one kind of tile is more common than another."""
    majority.check_kinds(floor, "'agree' asks for a side between kinds of tile")
    tiles = np.bincount(floor.tiles.ravel(), minlength=asked.kinds)
    if tiles.max() - tiles.min() > 1:
        counts = listed(
            f"{count(number, 'tile')} of kind {kind}" for kind, number in enumerate(tiles.tolist())
        )
        raise InputError(
            f"'agree' asks on which side a swarm ends where no side is right, and this floor has {counts}; "
            "give as many of each, as random:0.5 does, or choose majority",
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
