"""Cells, scenarios that are run many times, and the points of varied fields from which they are made.

A point maps the dotted names of varied fields to their values in one cell: ``{"strategy.soft.eta": 1250.0}``. Blocks of
a study's file are combined in all ways:

| block | its points |
|---|---|
| ``grid`` | every combination of the fields' values: lists, or ranges ``{from = 40, to = 80, steps = 5}`` |
| ``list`` | one point for each table of the list; a table may have a ``label`` |
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, Final

from vibroswarm.core.numbers import number
from vibroswarm.errors import InputError, check_kind, check_known_keys, number_of, whole_number_of
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario, field_types, nearest_field


@dataclass(frozen=True)
class Cell:
    """One scenario of a study, and the values in which it differs from others."""

    number: int
    point: Point
    """Its values of the varied fields."""
    scenario: Scenario
    name: str = ""
    """A name that no other cell has; the scenario's strategy if nothing is varied."""

    @cached_property
    def texts(self) -> dict[str, str]:
        """Each varied value as text."""
        return {name: value_as_text(value) for name, value in self.point.items()}

    def text_of(self, fields: Iterable[str]) -> str:
        """Write the cell's values of these fields: ``random:0.44, soft, eta 1250``; fields not varied are left out."""
        return fields_as_text({name: self.texts[name] for name in fields if name in self.texts})


Point = dict[str, Any]
"""The values of the varied fields in one cell, by the dotted names of the fields."""
BLOCKS: Final = ("grid", "list")
"""Names of the blocks of varied fields."""
LABEL: Final = "label"
"""Key of a table of a ``list`` that names its cells."""
PRESET: Final = "preset"
"""The preset as a varied field."""
PLAIN: Final = ("floor.source", "strategy.name", "network.name", "task.name", PRESET, LABEL)
"""Fields whose values are written without the name of the field."""
MOST: Final = 100_000
"""Most values of a range."""


def points_of(blocks: Mapping[str, Any]) -> list[Point]:
    """Return every combination of the points of all blocks, those of the last fastest; without blocks an empty one."""
    check_known_keys(blocks, "study", BLOCKS)
    parts = [_points_in(name, block) for name, block in blocks.items()]
    fields = Counter(field for part in parts for field in {field for point in part for field in point})
    for field, times in fields.items():
        if times > 1:
            raise InputError("is varied in two blocks", field=field)
    return [{k: v for part in chosen for k, v in part.items()} for chosen in product(*parts)]


def _points_in(name: str, block: Any) -> list[Point]:
    if name == "list":
        check_kind(block, Sequence, name, "a list of tables: [[list]]")
        return [fields_in(entry, "list", (LABEL,)) for entry in block]
    check_kind(block, Mapping, name, "a table of fields and their values")
    values = {field: _values(field, given) for field, given in fields_in(block, name).items()}
    return [dict(zip(values, each, strict=True)) for each in product(*values.values())]


def fields_in(block: Mapping[str, Any], name: str, may_have: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the fields of a block by their dotted names; nested tables are flattened."""
    known, fields = {*field_types(), PRESET, *may_have}, dict[str, Any]()
    for key, value in block.items():
        if key in known:
            fields[key] = value
        elif isinstance(value, Mapping) and any(k.startswith(f"{key}.") for k in known):
            fields |= fields_in({f"{key}.{k}": v for k, v in value.items()}, name, may_have)
        else:
            hint = nearest_field(key, (PRESET, *may_have))
            raise InputError(f"there is no such field{hint}", field=f"{name}.{key}")
    return fields


def _values(field: str, given: Any) -> list[Any]:
    """Return the values of a field of a grid, which are given as a list or as a range with ``steps``."""
    if isinstance(given, Mapping):
        bounds = bounds_of(given, field)
        steps = whole_number_of(given.get("steps"), f"{field}.steps", 2, MOST)
        return [value_between(*bounds, k / (steps - 1)) for k in range(steps)]
    if not isinstance(given, list | tuple) or not given:
        raise InputError(f"{given!r} is not a list of values", field=field)
    return list(given)


def bounds_of(given: Any, field: str) -> tuple[float, float, str, bool]:
    """Return the ends of a range, its scale, and whether its numbers are whole: as stated, or as the field's."""
    check_kind(given, Mapping, field, "a range; write {from = 1, to = 2}")
    check_known_keys(given, field, ("from", "to", "steps", "scale", "whole"))
    low, high = (number_of(given.get(end), f"{field}.{end}", -1e150, 1e150) for end in ("from", "to"))
    scale = given.get("scale", "linear")
    if not low < high or scale not in ("linear", "log") or (scale == "log" and low <= 0):
        raise InputError(
            f"{dict(given)} is no range from a lower to a higher end, linear, or log above 0", field=field
        )
    are_whole = isinstance(low, int) and isinstance(high, int) and field_types().get(field) is int
    return low, high, scale, bool(given.get("whole", are_whole))


def value_between(low: float, high: float, scale: str, whole: bool, u: float) -> float | int:
    """Return the value at the fraction ``u`` of a range, whole or to 15 digits, so that 0.1 + 0.2 is written 0.3."""
    if u in (0.0, 1.0):  # exactly as they are written
        value = low if u == 0.0 else high
    else:
        value = low * (high / low) ** u if scale == "log" else low + u * (high - low)
    return round(value) if whole else float(f"{value:.15g}")


def fields_as_text(texts: Mapping[str, str]) -> str:
    """Write values of fields: ``random:0.44, soft, eta 1250``."""
    return ", ".join(v if k in PLAIN else f"{k.rpartition('.')[2]} {v}" for k, v in texts.items())


def value_as_text(value: Any, digits: int = 6) -> str:
    """Write one value; of code its name, and of long lists how many values there are."""
    if plugins.is_code(value):
        return plugins.name_in(value)
    text = number(value, digits=digits) if isinstance(value, float) else str(value)
    return text if isinstance(value, str) or len(text) <= 60 else f"{len(value)} values"


def names_of(points: Sequence[Mapping[str, str]], strategies: Sequence[str]) -> list[str]:
    """Name cells by label and what else differs, by varied values, or by strategy; equal names get a number."""
    names = []
    for point, strategy in zip(points, strategies, strict=True):
        if LABEL in point:
            alike = [other for other in points if other.get(LABEL) == point[LABEL]]
            differing = {k: v for k, v in point.items() if any(other.get(k) != v for other in alike)}
            rest = fields_as_text(differing)
            names.append(f"{point[LABEL]} ({rest})" if rest else point[LABEL])
        else:
            names.append(fields_as_text(point) or strategy)
    count = Counter(names)
    return [f"{name} (cell {k})" if count[name] > 1 else name for k, name in enumerate(names)]
