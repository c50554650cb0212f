"""Which kind of tile is the most common?

| name | symbol | unit | equation |
|---|---|---|---|
| share of a kind | f_k | - | of the part of the floor that lies in the arena |
| answer | - | kind | the k with the largest f_k; none if two share that place |
"""

from __future__ import annotations

from typing import Any, Final

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.tasks.base import Asked, Task, register

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


majority = register(
    Task(
        name="majority",
        truth=truth,
        check=check,
        about="which kind of tile is most common?",
        answers=answers,
    )
)
