"""Map the fields that a search may change to a unit cube and back.

    [space]
    "walk.walk_duration_scale_ms" = { from = 0, to = 20000 }
    "decision.min_observations" = { from = 1, to = 500, scale = "log" }
    "strategy.name" = ["none", "soft"]

Methods only use points of the cube. A field with whole numbers is rounded when a point is converted to values. The
values of a list occupy equal parts of [0, 1].

| name | symbol | bounds in the paper |
|---|---|---|
| walk.walk_duration_location_ms, walk.walk_duration_scale_ms | gamma_0, gamma | 0 to 20000 ms |
| sample.sample_interval_ms | tau | 1000 to 6000 ms |
| walk.avoidance_threshold_mm | theta_c | 50 to 150 mm |
| decision.min_observations | O_c | 0 to 500 |
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import Scenario, value_of
from vibroswarm.study.cells import bounds_of, fields_in, value_between

Point = NDArray[np.float64]
"""A point in the unit cube, (dimensions,)."""
Values = dict[str, Any]
"""Values of fields by dotted name."""

PAPER: Final[dict[str, Any]] = {
    "walk.walk_duration_location_ms": {"from": 0, "to": 20000},
    "walk.walk_duration_scale_ms": {"from": 0, "to": 20000},
    "sample.sample_interval_ms": {"from": 1000, "to": 6000},
    "walk.avoidance_threshold_mm": {"from": 50, "to": 150},
    "decision.min_observations": {"from": 0, "to": 500},
}
"""The paper's space."""


@dataclass(frozen=True)
class Dimension:
    """One field with its bounds and scale (``linear`` or ``log``), or its choices."""

    name: str
    low: float = 0.0
    high: float = 1.0
    scale: str = "linear"
    whole: bool = False
    """Whether values are whole numbers."""
    choices: tuple[Any, ...] = ()
    """Values of a list; empty for a range."""

    def value(self, u: float) -> Any:
        """Return the value at the coordinate ``u`` in [0, 1]."""
        if self.choices:
            return self.choices[self.choice_at(u)]
        return value_between(self.low, self.high, self.scale, self.whole, u)

    def choice_at(self, u: float) -> int:
        """Return the index of the choice at the coordinate ``u`` in [0, 1]; 1 belongs to the last."""
        return min(int(u * len(self.choices)), len(self.choices) - 1)

    def share(self, value: Any) -> float:
        """Return the coordinate of a value in [0, 1]; of a choice, the middle of its part."""
        value = _as_lists(value) if self.choices else value
        is_inside = value in self.choices if self.choices else self.low <= value <= self.high
        if not is_inside:
            bounds = list(self.choices) or f"between {self.low:g} and {self.high:g}"
            raise InputError(f"{value!r} is not in {bounds}", field=self.name)
        if self.choices:
            return (self.choices.index(value) + 0.5) / len(self.choices)
        if self.scale == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return float(value - self.low) / (self.high - self.low)


def _as_lists(value: Any) -> Any:
    """Return the tuples of a scenario as the lists of a search file, however deeply nested."""
    return list(map(_as_lists, value)) if isinstance(value, list | tuple) else value


@dataclass(frozen=True)
class Space:
    """The fields of a search. A point of the unit cube has one coordinate per field."""

    dimensions: tuple[Dimension, ...]

    @classmethod
    def of(cls, block: Mapping[str, Any]) -> Space:
        """Read a space from a table that maps fields to ranges or lists of values."""
        fields = fields_in(block, "space")
        if not fields or "preset" in fields:
            raise InputError("name at least one field with bounds, and no preset", field="space")
        return cls(
            tuple(
                Dimension(name, choices=tuple(given))
                if isinstance(given, list) and given
                else Dimension(name, *bounds_of(given, name))
                for name, given in fields.items()
            )
        )

    def __iter__(self) -> Iterator[Dimension]:
        return iter(self.dimensions)

    @property
    def names(self) -> list[str]:
        """Dotted names of the fields."""
        return [d.name for d in self.dimensions]

    def to_block(self) -> dict[str, Any]:
        """Return the table from which ``of`` reads an equal space."""
        return {
            d.name: list(d.choices) or {"from": d.low, "to": d.high, "scale": d.scale, "whole": d.whole}
            for d in self.dimensions
        }

    def values(self, point: Point) -> Values:
        """Return the values of all fields at a point of the cube."""
        return {d.name: d.value(float(u)) for d, u in zip(self.dimensions, point, strict=True)}

    def point(self, values: Mapping[str, Any]) -> Point:
        """Return the point of the unit cube at which all fields of the space have these values."""
        if differing := sorted(values.keys() ^ set(self.names)):
            raise InputError("give a value for every field of the space, and no other", field=differing[0])
        return np.array([d.share(values[d.name]) for d in self.dimensions])

    def values_of(self, scenario: Scenario) -> Values:
        """Return a scenario's values of the fields of the space."""
        return {name: value_of(scenario, name) for name in self.names}
