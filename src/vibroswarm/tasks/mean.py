"""What is the mean value of the tiles? A number, not a decision: the robots' estimates are scored.

| name | symbol | unit | equation |
|---|---|---|---|
| mean | - | - | of the values v of the tiled area in the arena; of kinds 0 and 1 it is the fill ratio |

Robots that count readings estimate the share of ones, which is not the mean value where the sensor errs.
"""

from __future__ import annotations

from typing import Any

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.tasks.base import Asked, Task, register
from vibroswarm.tasks.fill_ratio import ANSWERS


def truth(floor: Floor, asked: Asked, p: Any) -> float:
    """Return the mean value in the arena."""
    return asked.fill_ratio


def check(floor: Floor, asked: Asked, p: Any) -> None:
    """Refuse floors of more than two kinds of tile, which have no values."""
    if asked.kinds > 2:
        raise InputError(
            f"'mean' needs tiles with values, and not of {asked.kinds} kinds; choose majority",
            field="task.name",
        )


mean = register(
    Task(
        name="mean",
        truth=truth,
        check=check,
        about="what is the mean value of the tiles? The robots' estimates are scored",
        answers=ANSWERS,
        estimated="mean value of the tiles",
    )
)
