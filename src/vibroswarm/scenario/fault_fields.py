"""Fields of ``[faults]``: which robots fail, how, and from when on (``fault_draws``); by default none."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final

from pydantic import AfterValidator, Field

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.errors import InputError

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
