"""Does more than a given share of the tiles vibrate?

| name | symbol | unit | equation |
|---|---|---|---|
| fill ratio | f | - | Eq. 3, of the part of the floor that lies in the arena |
| decision boundary | 0.5 in the paper | - | the answer is 1 above it, 0 below |
"""

from __future__ import annotations

from typing import Any, Final

from vibroswarm.floors.floor import Floor
from vibroswarm.tasks.base import Asked, Task, register

ON_THE_BOUNDARY: Final = 1e-12
"""Fill ratios nearer than this to the boundary count as equal to it."""

ANSWERS: Final = ("less than {boundary} vibrates", "more than {boundary} vibrates")
"""What the decisions 0 and 1 mean."""


def truth(floor: Floor, asked: Asked, p: Any) -> int | None:
    """Return 1 if the fill ratio in the arena lies above the decision boundary, 0 if below, None if on it."""
    if abs(asked.fill_ratio - asked.decision_boundary) < ON_THE_BOUNDARY:
        return None
    return int(asked.fill_ratio > asked.decision_boundary)


fill_ratio = register(
    Task(
        name="fill_ratio",
        truth=truth,
        about="do more than a share of the tiles vibrate?",
        answers=ANSWERS,
    )
)
