"""Fields of ``[change]`` and ``[faults]``: how the floor changes during a run, and which robots fail."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, field_validator, model_validator

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.core.numbers import stated
from vibroswarm.errors import InputError, named
from vibroswarm.floors.changes import Changes, changes_between, grown, markov_changes, permuted
from vibroswarm.floors.floor import DIGITS, Floor, as_tiles
from vibroswarm.floors.source import SUM_TO_1, is_generated, is_random, named_tiles
from vibroswarm.floors.surfaces import is_patches, named_patches

INVERT: Final = "invert"
"""What vibrates becomes still, and what is still vibrates."""
REDRAW: Final = "redraw"
"""The same tiles, at random places."""
GROW: Final = "grow"
"""Still tiles beside others become like them."""

Times = Annotated[
    tuple[Annotated[float, Field(gt=0, le=1e7)], ...], Field(min_length=1, max_length=1000, strict=False)
]
Steps = Annotated[
    tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1, max_length=1000, strict=False)
]
Shares = Annotated[
    tuple[Annotated[float, Field(ge=0, le=1)], ...], Field(min_length=2, max_length=16, strict=False)
]


class Change(FrozenModel):
    """How the floor changes during a run, at given times or at random; it stays as it is by default."""

    at_s: Times | None = None
    """Times at which it changes, s, ascending: one, or a list. If this and ``rate_per_h`` are omitted, it does not."""
    to: Steps | None = None
    """What it becomes then, one for each time, or one for all: ``invert``, ``redraw`` (the same tiles at random
    places), ``patch:0.3`` (tiles below a patch of that side, at a random place, vibrate; also discs and cracks),
    ``grow`` (still tiles beside vibrating ones vibrate), another floor of the same size, or its rows, such as
    ``0110/1001/1111``."""
    rate_per_h: Annotated[float, Field(gt=0, le=1e5)] | None = None
    """How often an hour each tile is redrawn, at random times."""
    shares: Shares | None = None
    """Probabilities of the kinds 0, 1 and so on when a tile is redrawn; if omitted, their shares at time 0."""

    @field_validator("at_s", "to", mode="before")
    @classmethod
    def _listed(cls, value: object) -> object:
        return [value] if isinstance(value, str | int | float) and not isinstance(value, bool) else value

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        times, to, is_one = self.at_s or (), self.to or (), abs(sum(self.shares or (1.0,)) - 1.0) <= SUM_TO_1
        is_timed = (
            0 < len(times) == len(set(times)) and list(times) == sorted(times) and len(to) in (1, len(times))
        )
        is_still = not (times or to)
        if not (is_still and is_one if self.rate_per_h else (is_still or is_timed) and self.shares is None):
            raise InputError(
                "give either ascending times at_s and what becomes of it then, to, one for all times or one for each; "
                "or rate_per_h, to which shares may be added that sum to 1",
                field="change",
            )
        return self

    @property
    def is_given(self) -> bool:
        """Whether the floor changes."""
        return self.at_s is not None or self.rate_per_h is not None

    @property
    def is_random(self) -> bool:
        """Whether runs on the same floor may differ in its changes."""
        return self.rate_per_h is not None or any(to == REDRAW or is_generated(to) for to in self.to or ())

    def steps(self) -> Iterator[tuple[float, str]]:
        """Yield each time (s), and what the floor becomes then; nothing if it does not change at given times."""
        times_s, to = self.at_s or (), self.to or ()
        yield from zip(times_s, to * len(times_s) if len(to) == 1 else to, strict=True)

    def changes(
        self, floor: Floor, arena_m: tuple[float, float], until_s: float, seed: int, run: int
    ) -> Changes:
        """Return the changes of a run's floor."""
        tiles = floor.tiles
        if self.rate_per_h is not None:
            shares = self.shares or (np.bincount(tiles.ravel()) / tiles.size).tolist()
            return markov_changes(tiles, self.rate_per_h, shares, until_s, seed, run)
        later: list[tuple[float, NDArray[np.uint8]]] = []
        before = tiles
        for step, (time_s, to) in enumerate(self.steps()):
            before = _next(to, replace(floor, levels=before), arena_m, step, seed, run)
            later.append((time_s, before))
        return changes_between(tiles, later)


def _next(
    to: str, floor: Floor, arena_m: tuple[float, float], number: int, seed: int, run: int
) -> NDArray[np.uint8]:
    tiles = floor.tiles
    if to == GROW:
        return grown(tiles)
    if to == REDRAW:
        return permuted(tiles, number, seed, run)
    with named("change.to"):
        if to == INVERT:
            return as_tiles(1 - tiles.astype(np.int64))
        if is_patches(to):
            return _patched(to, floor, arena_m, number, seed, run)
        is_rows = set(to) <= {*DIGITS, "/"}
        rows = [[int(tile, 16) for tile in row] for row in to.split("/")] if is_rows else None
        found = as_tiles(rows) if rows else named_tiles(to, tiles.shape[0], tiles.shape[1], seed, run)
    if found.shape != tiles.shape:
        raise InputError(f"'{to}' has {found.shape} tiles, and the floor {tiles.shape}", field="change.to")
    # A random floor is drawn in the order of tiles of the run's first floor, which would keep most tiles as they are.
    return permuted(found, number, seed, run) if is_random(to) else found


def _patched(
    name: str, floor: Floor, arena_m: tuple[float, float], number: int, seed: int, run: int
) -> NDArray[np.uint8]:
    """Return the tiles of a floor with patches that appear at change ``number`` of a run."""
    rows, columns, width_m, height_m, left_m, bottom_m = floor.geometry
    x_m = (left_m + (np.arange(columns) + 0.5) * width_m)[None, :]
    y_m = (bottom_m + (rows - np.arange(rows) - 0.5) * height_m)[:, None]
    tiles = floor.tiles.copy()
    for patch in named_patches(name, floor.box_within(*arena_m), seed, run, draw=number + 1):
        if patch.contrast != 1.0:
            raise InputError(f"'{name}' has a contrast; tiles vibrate or do not")
        tiles[patch.distance_m(x_m, y_m) <= 0.0] = 1
        tiles.ravel()[floor.tile_at(np.array([patch.x_m]), np.array([patch.y_m]))] = 1
    return tiles


def change_words(change: Change) -> str:
    """Return a sentence on how the floor changes; empty if it does not."""
    if change.rate_per_h is not None:
        return f"Each tile is redrawn {stated(change.rate_per_h)} times an hour on average."
    steps = [f"{to} at {stated(time_s)} s" for time_s, to in change.steps()]
    return f"The floor changes: {', '.join(steps)}." if steps else ""


Shift = Annotated[float, Field(ge=-1, le=1)]
Drift = Annotated[float, Field(ge=-1000, le=1000)]

MOTION_FAULTS: Final = ("stopped", "battery_empty")
SENSOR_FAULTS: Final = ("stuck_at_0", "stuck_at_1", "stuck", "biased")
FAULTS: Final = (*SENSOR_FAULTS, "opposite", "radio_dead", *MOTION_FAULTS)
"""Kinds of faults, each the name of a field."""
SINCE: Final = {kind: f"{kind}_from_s" for kind in FAULTS} | {
    **dict.fromkeys(SENSOR_FAULTS, "sensor_from_s"),
    "battery_empty": "battery_life_s",
}
"""The field that says since when a robot has the fault."""


Robots = Annotated[
    tuple[Annotated[int, Field(ge=0)], ...],
    Field(strict=False),
    AfterValidator(lambda robots: tuple(sorted(set(robots)))),
]
Affected = Annotated[float, Field(ge=0, le=1)] | Robots
"""A share of the swarm, or robots by their numbers."""
Time = Annotated[float, Field(ge=0, le=1e9)]
Range = Annotated[
    tuple[Time, Time], Field(strict=False), AfterValidator(lambda ends_s: tuple(sorted(ends_s)))
]
Since = Time | Range
"""A time, s, or the two ends of the range in which each robot's own is uniform, s."""


class MotionFaults(FrozenModel):
    """Faults that change motion."""

    stopped: Affected = 0.0
    """Robots that stop for good and stand in the others' way; they take no samples, but their radio and timer go on."""
    stopped_from_s: Since = 0.0
    """When they stop, s, or the range from which each robot's time is drawn (``[600, 1200]``). A sample that has begun
    is finished."""
    battery_empty: Affected = 0.0
    """Robots whose battery runs empty: they stop likewise, and hear, send and decide nothing."""
    battery_life_s: Since = 1200.0
    """When it is empty, s, or a range; at most 20 minutes in the paper."""

    @property
    def any_of_motion(self) -> bool:
        """Whether any robot may have a fault of motion; also true for a share that rounds to no robot."""
        return any(getattr(self, kind) for kind in MOTION_FAULTS)


class Faults(MotionFaults):
    """Robots that fail, and how; nobody by default. Which: a share of the swarm (rounded to whole robots, drawn for
    each run, those of a smaller share among those of a larger), or a list of robots (``[0, 3]``)."""

    stuck_at_0: Affected = 0.0
    """Robots whose sensor always reads 0."""
    stuck_at_1: Affected = 0.0
    """Robots whose sensor always reads 1. None of them is also stuck at 0."""
    stuck: Affected = 0.0
    """Robots whose sensor always reads ``stuck_class``, unless it is stuck at 0 or 1."""
    stuck_class: Annotated[int, Field(ge=0, le=15)] = 0
    """Class that they read."""
    biased: Affected = 0.0
    """Robots whose error rates differ by the six fields below."""
    misread_shift: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Share of samples that a biased sensor reads as another class, each equally often."""
    misread_drift_per_h: Drift = 0.0
    """By how much more with each hour that the fault lasts."""
    false_positive_shift: Shift = 0.0
    """With two kinds of tile: by how much the share of false positives is higher; the sum is cut off at 0 and 1."""
    false_negative_shift: Shift = 0.0
    """The same for false negatives."""
    false_positive_drift_per_h: Drift = 0.0
    """By how much more with each hour that the fault lasts."""
    false_negative_drift_per_h: Drift = 0.0
    """The same for false negatives."""
    sensor_from_s: Since = 0.0
    """When sensors fail, s, or the range from which each robot's time is drawn."""
    opposite: Affected = 0.0
    """Robots that send the opposite of what their strategy says, unknowingly."""
    opposite_from_s: Since = 0.0
    """When they begin to, s, or a range."""
    radio_dead: Affected = 0.0
    """Robots whose radio dies: they send and hear nothing, and go on alone."""
    radio_dead_from_s: Since = 0.0
    """When it dies, s, or a range."""

    @property
    def of_motion(self) -> MotionFaults:
        """The part that changes motion."""
        values: dict[str, Any] = {name: getattr(self, name) for name in MotionFaults.model_fields}
        return MotionFaults(**values)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of faults that at least one robot has, or a share above 0 of the swarm."""
        return tuple(kind for kind in FAULTS if getattr(self, kind))


def count_of(affected: Affected, robots: int) -> int:
    """Return how many robots a fault affects; shares are rounded half up despite rounding errors of the product."""
    if isinstance(affected, tuple):
        return len(affected)
    return math.floor(affected * robots + 0.5 + 1e-9)


def failing_sensors(faults: Faults, robots: int) -> list[str]:
    """Return the kinds of sensor faults that at least one of so many robots has."""
    return [kind for kind in SENSOR_FAULTS if count_of(getattr(faults, kind), robots)]


def check_faults(faults: Faults, robots: int) -> None:
    """Refuse faults of robots that do not exist, and sensors stuck at 0 and at 1 at once."""
    for kind in faults.kinds:
        affected = getattr(faults, kind)
        if isinstance(affected, tuple) and affected[-1] >= robots:  # the last is the greatest
            raise InputError(f"there is no robot {affected[-1]}, of {robots} from 0", field=f"faults.{kind}")
    at_0, at_1 = faults.stuck_at_0, faults.stuck_at_1
    of_both = isinstance(at_0, tuple) and isinstance(at_1, tuple) and not set(at_0).isdisjoint(at_1)
    if of_both or count_of(at_0, robots) + count_of(at_1, robots) > robots:
        raise InputError("no robot can be stuck at 0 and at 1 at once", field="faults.stuck_at_0")
