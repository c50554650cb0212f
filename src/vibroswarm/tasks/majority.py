"""Which kind of tile is the most common; and on a symmetric floor, on which side a swarm agrees, how soon, how long.

| task | name | symbol | unit | equation |
|---|---|---|---|---|
| ``majority`` | share of a kind | f_k | - | of the part of the floor that lies in the arena |
| ``majority`` | answer | - | kind | the k with the largest f_k; none if two share that place |
| ``agree`` | tiles of a kind | n_k | - | max n_k - min n_k is at most 1; no answer is right |
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.tasks.base import Asked, Task, register
from vibroswarm.tasks.fill_ratio import ANSWERS

TIE: Final = 1e-12
"""Shares that differ by less count as equal."""


def truth(floor: Floor, asked: Asked, p: Any) -> int | None:
    """Return the most common kind of tile in the arena, None if several are equally common."""
    shares = [floor.share_within(kind, asked.width_m, asked.height_m) for kind in range(asked.kinds)]
    *_, second, most = sorted(shares)
    return None if most - second < TIE else shares.index(most)


def check(floor: Floor, asked: Asked, p: Any) -> None:
    """Refuse floors of values and patches, which are contrasts between two kinds."""
    if floor.has_contrasts or floor.patches:
        raise InputError("floors of values or patches have no kinds; choose fill_ratio", field="task.name")


def answers(kinds: int) -> tuple[str, ...]:
    """Return the answers in words."""
    return tuple(f"kind {kind} is most common" for kind in range(kinds))


def no_truth(floor: Floor, asked: Asked, p: Any) -> None:
    """Return None: no answer is right."""


def check_symmetric(floor: Floor, asked: Asked, p: Any) -> None:
    """Refuse floors on which one kind of tile is more common than another."""
    check(floor, asked, p)
    tiles = np.bincount(floor.tiles.ravel(), minlength=asked.kinds)
    if np.ptp(tiles) > 1:
        raise InputError(
            f"'agree' needs as many tiles of each kind, and not {tiles.tolist()}; choose majority",
            field="task.name",
        )


def sides(kinds: int) -> tuple[str, ...]:
    """Return the sides in words."""
    return ANSWERS if kinds == 2 else answers(kinds)


agree = register(
    Task(
        name="agree",
        truth=no_truth,
        check=check_symmetric,
        about="on a symmetric floor: on which side does a swarm agree, how soon, and for how long?",
        answers=sides,
    )
)
majority = register(
    Task(
        name="majority",
        truth=truth,
        check=check,
        about="which kind of tile is most common?",
        answers=answers,
    )
)
