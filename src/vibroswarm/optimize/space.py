"""Map the fields that a search may change to a unit cube and back.

    [space]
    "walk.walk_duration_scale_ms" = { from = 0, to = 20000 }
    "decision.min_observations" = { from = 1, to = 500, scale = "log" }
    "strategy.name" = ["none", "soft"]

Methods only use points of the cube. Fields with whole numbers are rounded when a point is turned into values; the
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

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import Scenario, value_of
from vibroswarm.study.factors import bounds_of, fields_in, rounded

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
    high: float
    scale: str = "linear"
    whole: bool = False
    choices: tuple[Any, ...] = ()

    @classmethod
    def of(cls, name: str, given: Any) -> Dimension:
        """Read a dimension from ``{from, to, scale, whole}`` or a list of values.

        Raises:
            InputError: the bounds are reversed, a log scale starts at 0, or the list is empty.
        """
        field = f"space.{name}"
        if isinstance(given, Sequence) and not isinstance(given, str):
            if len(given) < 2:
                raise InputError(
                    "is a list of one value or none; give at least two to choose from", field=field
                )
            return cls(name, 0.0, float(len(given)), choices=tuple(given))
        if isinstance(given, Mapping) and "steps" in given:
            raise InputError("'steps' is for a grid; leave it out", field=field)
        low, high, scale, is_whole = bounds_of(given, field)
        return cls(name, float(low), float(high), scale, is_whole)

    def value(self, u: float) -> Any:
        """Return the value at the fraction ``u`` in [0, 1]."""
        if self.choices:
            return self.choices[min(int(u * len(self.choices)), len(self.choices) - 1)]
        if u in (0.0, 1.0):
            return rounded((self.low, self.high)[int(u)], self.whole)
        if self.scale == "log":
            return rounded(self.low * (self.high / self.low) ** u, self.whole)
        return rounded(self.low + u * (self.high - self.low), self.whole)

    def share(self, value: Any) -> float:
        """Return the fraction of the range at which a value lies.

        Raises:
            InputError: the value is out of bounds or not among the choices.
        """
        if self.choices:
            if value not in self.choices:
                raise InputError(f"{value!r} is not among {list(self.choices)}", field=self.name)
            return (self.choices.index(value) + 0.5) / len(self.choices)
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
class Space(NotebookView):
    """The fields of a search, in order: its ``dimensions``."""

    dimensions: tuple[Dimension, ...]

    @classmethod
    def of(cls, block: Mapping[str, Any]) -> Space:
        """Read a space from a table of fields, the ``block``.

        Raises:
            InputError: a field is unknown or has wrong bounds, or there is none.
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
        """Return the table that ``of`` reads."""
        block: dict[str, Any] = {}
        for d in self.dimensions:
            ends = {"from": d.low, "to": d.high, "scale": d.scale, "whole": d.whole}
            block[d.name] = list(d.choices) if d.choices else ends
        return block

    def values(self, point: Point) -> Values:
        """Return the values at a point of the cube."""
        return {d.name: d.value(float(u)) for d, u in zip(self.dimensions, point, strict=True)}

    def point(self, values: Mapping[str, Any]) -> Point:
        """Return the point of the cube for values.

        Raises:
            InputError: a field is missing, unknown to the space, or out of bounds.
        """
        for name in values:
            if name not in self.names:
                raise InputError("is not in the space that is searched", field=name)
        for name in self.names:
            if name not in values:
                raise InputError("is missing; give a value for every field of the space", field=name)
        return np.array([d.share(values[d.name]) for d in self.dimensions])

    def values_of(self, scenario: Scenario) -> Values:
        """Return a scenario's values of these fields."""
        return {name: value_of(scenario, name) for name in self.names}
