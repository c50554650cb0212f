"""Questions for a number, not a decision; the robots' estimates are scored.

| task | name | symbol | unit | equation |
|---|---|---|---|---|
| ``mean`` | mean | - | - | of the values v of the tiled area in the arena; of kinds 0 and 1 it is the fill ratio |
| ``share`` | share | f | - | Eq. 3, of the part of the floor that lies in the arena: tiles of the kind asked for, 1 |

Robots that count readings estimate the share of ones, which is not the mean value where the sensor errs.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import KIND_LIMIT, Floor
from vibroswarm.tasks.base import Asked, Task, register
from vibroswarm.tasks.fill_ratio import ANSWERS
from vibroswarm.tasks.majority import sides


def mean_value(floor: Floor, asked: Asked, p: Any) -> float:
    """Return the mean value in the arena."""
    return asked.fill_ratio


def check_mean(floor: Floor, asked: Asked, p: Any) -> None:
    """Refuse floors of more than two kinds of tile, which have no values."""
    if asked.kinds > 2:
        raise InputError(
            f"'mean' needs tiles with values, and not of {asked.kinds} kinds; choose majority",
            field="task.name",
        )


class Params:
    """Which share is asked for."""

    kind: Annotated[int, Field(ge=0, lt=KIND_LIMIT)] = 1
    """Kind of tile; 1 is vibrating."""


def share_of_kind(floor: Floor, asked: Asked, p: Any) -> float:
    """Return the share of the kind in the arena; that of kind 1 is the fill ratio."""
    return asked.fill_ratio if p.kind == 1 else floor.share_within(p.kind, asked.width_m, asked.height_m)


def estimated(p: Any) -> str:
    """Return what is estimated, in words."""
    return "share of tiles that vibrate" if p.kind == 1 else f"share of tiles of kind {p.kind}"


def check_share(floor: Floor, asked: Asked, p: Any) -> None:
    """Refuse floors whose tiles have values, of which none or all vibrate."""
    if floor.has_contrasts:
        raise InputError(
            "'share' needs tiles that vibrate or not, and these have values; choose mean", field="task.name"
        )


mean = register(
    Task(
        name="mean",
        truth=mean_value,
        check=check_mean,
        about="what is the mean value of the tiles? The robots' estimates are scored",
        answers=ANSWERS,
        estimated="mean value of the tiles",
    )
)
share = register(
    Task(
        name="share",
        params=Params,
        truth=share_of_kind,
        check=check_share,
        about="which share of the tiles vibrates, or is of another kind? The robots' estimates are scored",
        answers=sides,
        estimated=estimated,
    )
)
