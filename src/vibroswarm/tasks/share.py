"""Which share of the tiles is of a kind, such as vibrating? A number: the robots' estimates are scored.

| name | symbol | unit | equation |
|---|---|---|---|
| share | f | - | Eq. 3, of the part of the floor that lies in the arena: tiles of the kind that is asked for, 1 |
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import KIND_LIMIT, Floor
from vibroswarm.tasks import agree
from vibroswarm.tasks.base import Asked, Task, register


class Params:
    """Which share is asked for."""

    kind: Annotated[int, Field(ge=0, lt=KIND_LIMIT)] = 1
    """Kind of tile; 1 is vibrating."""


def truth(floor: Floor, asked: Asked, p: Any) -> float:
    """Return the share of the kind in the arena; that of kind 1 is the fill ratio."""
    return asked.fill_ratio if p.kind == 1 else floor.share_within(p.kind, asked.width_m, asked.height_m)


def estimated(p: Any) -> str:
    """Return what is estimated, in words."""
    return "share of tiles that vibrate" if p.kind == 1 else f"share of tiles of kind {p.kind}"


def check(floor: Floor, asked: Asked, p: Any) -> None:
    """Refuse floors whose tiles have values, of which none or all vibrate."""
    if floor.has_contrasts:
        raise InputError(
            "'share' needs tiles that vibrate or not, and these have values; choose mean", field="task.name"
        )


share = register(
    Task(
        name="share",
        params=Params,
        truth=truth,
        check=check,
        about="which share of the tiles vibrates, or is of another kind? The robots' estimates are scored",
        answers=agree.answers,
        estimated=estimated,
    )
)
