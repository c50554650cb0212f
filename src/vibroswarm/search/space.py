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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError, plain_value
from vibroswarm.scenario.scenario import Scenario, field_types, value_of
from vibroswarm.study.factors import bounds_of, fields_in, value_between

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
    """One field with its bounds and scale, or its choices."""

    name: str
    low: float
    """Lower bound; 0 for choices."""
    high: float
    """Upper bound; the number of choices for choices."""
    scale: str = "linear"
    """``linear`` or ``log``."""
    whole: bool = False
    """Whether values are whole numbers."""
    choices: tuple[Any, ...] = ()
    """Values of a list; empty for a range."""

    @classmethod
    def of(cls, name: str, given: Any) -> Dimension:
        """Make the dimension of the field ``name`` from its entry in a search file.

        ``given`` is a table with the keys from, to, and optionally scale and whole; or it is a list of values. Without
        ``whole``, values are whole numbers if both bounds are integers and the field holds integers.

        Raises:
            InputError: a bound is missing; a bound, the scale or ``whole`` is wrong; the bounds are reversed, or not
                whole for whole numbers or a field that holds integers; a log scale starts at 0 or below; the table has
                another key, such as ``steps``, which is for a grid; or a list has fewer than two values.
        """
        field, given = f"space.{name}", plain_value(given)
        if isinstance(given, Sequence) and not isinstance(given, str):
            if len(given) < 2:
                raise InputError(
                    "is a list of one value or none; give at least two to choose from", field=field
                )
            return cls(name, low=0.0, high=float(len(given)), choices=tuple(given))
        if isinstance(given, Mapping) and "steps" in given:
            raise InputError("'steps' is for a grid; leave it out", field=field)
        low, high, scale, is_whole = bounds_of(given, name)
        if field_types().get(name) is int and not is_whole:
            raise InputError("holds whole numbers; give whole ends, such as 1 and 20", field=field)
        if is_whole and not (float(low).is_integer() and float(high).is_integer()):
            raise InputError(
                f"{low:g} to {high:g} are not bounds of whole numbers; give whole ones", field=field
            )
        return cls(name, low=float(low), high=float(high), scale=scale, whole=is_whole)

    def value(self, u: float) -> Any:
        """Return the value of the field at the coordinate ``u`` in [0, 1].

        The value at ``share(v)`` is ``v`` again, up to rounding errors, for whole numbers and choices exactly.
        """
        if self.choices:
            return self.choices[self.choice_at(u)]
        return value_between(self.low, self.high, self.scale, self.whole, u)

    def choice_at(self, u: float) -> int:
        """Return the index of the choice at the coordinate ``u`` in [0, 1]; 1 belongs to the last."""
        return min(int(u * len(self.choices)), len(self.choices) - 1)

    def share(self, value: Any) -> float:
        """Return the coordinate of a value in [0, 1].

        The choices of a list occupy equal parts of [0, 1]; the coordinate of a choice is the middle of its part.

        Raises:
            InputError: the value is not a finite number, is out of bounds, or is not among the choices.
        """
        if self.choices:
            chosen = _as_lists(value)
            if chosen not in self.choices:
                raise InputError(f"{chosen!r} is not among {list(self.choices)}", field=self.name)
            return (self.choices.index(chosen) + 0.5) / len(self.choices)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{value!r} is not a number", field=self.name)
        if not self.low <= value <= self.high:
            raise InputError(
                f"{value:g} lies outside the bounds {self.low:g} to {self.high:g}; widen them or move it",
                field=self.name,
            )
        if self.scale == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Space:
    """The fields of a search. A point of the unit cube has one coordinate per field."""

    dimensions: tuple[Dimension, ...]
    """The fields with their bounds or choices, in the order of the coordinates."""

    @classmethod
    def of(cls, block: Mapping[str, Any]) -> Space:
        """Read a space from the table ``block``, which maps fields to ranges or lists of values.

        Raises:
            InputError: a field is unknown or has wrong bounds, or the table is empty.
        """
        fields = fields_in(block, "space")
        if not fields:
            raise InputError("is empty; name at least one field with bounds", field="space")
        if "preset" in fields:
            raise InputError("a preset cannot be searched over; name fields", field="space.preset")
        return cls(tuple(Dimension.of(name, bounds) for name, bounds in fields.items()))

    def __iter__(self) -> Iterator[Dimension]:
        return iter(self.dimensions)

    @property
    def size(self) -> int:
        """Number of fields."""
        return len(self.dimensions)

    @property
    def names(self) -> list[str]:
        """Dotted names of the fields."""
        return [d.name for d in self.dimensions]

    def to_block(self) -> dict[str, Any]:
        """Return the table from which ``of`` reads an equal space."""
        block: dict[str, Any] = {}
        for d in self.dimensions:
            ends = {"from": d.low, "to": d.high, "scale": d.scale, "whole": d.whole}
            block[d.name] = list(d.choices) if d.choices else ends
        return block

    def values(self, point: Point) -> Values:
        """Return the values of all fields at a point of the cube."""
        return {d.name: d.value(float(u)) for d, u in zip(self.dimensions, point, strict=True)}

    def point(self, values: Mapping[str, Any]) -> Point:
        """Return the point of the unit cube at which the fields have the given values.

        ``values`` must have a value for every field of the space, and no other fields.

        Raises:
            InputError: a field is missing, is not in the space, or has a value that ``Dimension.share`` refuses.
        """
        for name in values:
            if name not in self.names:
                raise InputError("is not in the space that is searched", field=name)
        for name in self.names:
            if name not in values:
                raise InputError("is missing; give a value for every field of the space", field=name)
        return np.array([d.share(values[d.name]) for d in self.dimensions])

    def values_of(self, scenario: Scenario) -> Values:
        """Return a scenario's values of the fields of the space."""
        return {name: value_of(scenario, name) for name in self.names}


def _as_lists(value: Any) -> Any:
    """Return the tuples of a scenario as the lists of a search file, however deeply nested."""
    return list(map(_as_lists, value)) if isinstance(value, list | tuple) else value
