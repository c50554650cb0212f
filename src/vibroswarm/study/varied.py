"""What a study varies: blocks of fields and values, turned into points; one point a cell.

| block | gives |
|---|---|
| ``grid`` | every combination of the values |
| ``zip`` | the first values together, then the second, ...; all lists equally long |
| ``list`` | one point a table; each may also have a ``label`` |
| ``random``, ``sobol`` | so many ``points``, uniform or evenly spread, between bounds |

Several blocks are combined, each with each. A field's values are a list, or a range
``{from = 40, to = 80, steps = 5, scale = "log", whole = true}`` (``scale`` and ``whole`` as needed; ``steps`` only in
a grid or zip). Beside the fields of a scenario there is ``preset``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, Final, TypeGuard

import numpy as np

from vibroswarm import code_files
from vibroswarm.errors import InputError, nearest
from vibroswarm.scenario import field_names

Point = dict[str, Any]

BLOCKS: Final = ("grid", "zip", "list", "random", "sobol")
LABEL: Final = "label"
PRESET: Final = "preset"
LARGEST: Final = 100_000
"""Cells that a study may have."""
LARGEST_NUMBER: Final = 1e150
"""Ends of a range; their quotient is still a number."""


def points_of(blocks: Mapping[str, Any]) -> list[Point]:
    """The points of all blocks combined, in the order in which they are written, the last varying fastest.

    Args:
        blocks: as TOML gives them, by the names of ``BLOCKS``.
    Raises:
        InputError: an unknown field, an empty list, a field in two blocks, lists of unequal length, too many.
    """
    columns: list[list[Point]] = []
    seen: set[str] = set()
    for name, block in blocks.items():
        if name not in BLOCKS:
            raise InputError(f"there is no such block{nearest(name, BLOCKS)}", field=name)
        points = _READERS[name](block, name)
        fields = {field for point in points for field in point}
        if both := sorted(fields & seen):
            raise InputError("is varied in two blocks", field=f"{name}.{both[0]}")
        seen |= fields
        columns.append(points)
    if math.prod(len(points) for points in columns) > LARGEST:
        raise InputError(f"has more than {LARGEST} cells; vary less", field="study")
    return [{k: v for part in parts for k, v in part.items()} for parts in product(*columns)]


def _grid(block: Any, name: str) -> list[Point]:
    values = {field: _values(given, f"{name}.{field}") for field, given in fields_in(block, name).items()}
    if not values:
        raise InputError("is empty; name at least one field", field=name)
    if math.prod(len(v) for v in values.values()) > LARGEST:
        raise InputError(f"has more than {LARGEST} cells; vary less", field=name)
    return [dict(zip(values, chosen, strict=True)) for chosen in product(*values.values())]


def _zip(block: Any, name: str) -> list[Point]:
    values = {field: _values(given, f"{name}.{field}") for field, given in fields_in(block, name).items()}
    lengths = {field: len(found) for field, found in values.items()}
    if not lengths:
        raise InputError("is empty; name at least one field", field=name)
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{field} has {length}" for field, length in lengths.items())
        raise InputError(f"its lists are not equally long: {told}", field=name)
    return [dict(zip(values, chosen, strict=True)) for chosen in zip(*values.values(), strict=True)]


def _list(block: Any, name: str) -> list[Point]:
    if not isinstance(block, Sequence) or isinstance(block, str) or not block:
        raise InputError("is a list of tables, at least one: [[list]]", field=name)
    return [fields_in(entry, f"{name}[{k}]", may_have=(LABEL,)) for k, entry in enumerate(block)]


def _random(block: Any, name: str) -> list[Point]:
    return _spread(block, name, lambda seed, d, n: np.random.Generator(np.random.Philox(seed)).random((n, d)))


def _sobol(block: Any, name: str) -> list[Point]:
    def draw(seed: int, dimensions: int, count: int) -> np.ndarray[Any, Any]:
        from scipy.stats import qmc

        whole = 1 << max(count - 1, 0).bit_length()  # a Sobol sequence is balanced at powers of two
        sampler = qmc.Sobol(dimensions, scramble=True, rng=np.random.Generator(np.random.Philox(seed)))
        points: np.ndarray[Any, Any] = sampler.random(whole)[:count]
        return points

    return _spread(block, name, draw)


def _spread(block: Any, name: str, draw: Any) -> list[Point]:
    """Points in the unit cube, taken to the bounds of the fields."""
    if not isinstance(block, Mapping):
        raise InputError("is a table of fields with bounds", field=name)
    count, seed = block.get("points"), block.get("seed", 0)
    if not _is_whole(count) or not 1 <= count <= LARGEST:
        raise InputError(f"{count!r} is no number of points; give 1 to {LARGEST}", field=f"{name}.points")
    if not _is_whole(seed) or seed < 0:
        raise InputError(f"{seed!r} is no seed; give a whole number from 0", field=f"{name}.seed")
    fields = fields_in({k: v for k, v in block.items() if k not in _OF_SPREAD}, name)
    if not fields:
        raise InputError("is empty; name at least one field", field=name)
    for field, given in fields.items():
        if isinstance(given, Mapping) and "steps" in given:
            raise InputError(
                "is of a grid or zip; here 'points' says how many", field=f"{name}.{field}.steps"
            )
    unit = draw(seed, len(fields), count)
    return [
        {
            field: _at(given, float(u), f"{name}.{field}")
            for (field, given), u in zip(fields.items(), row, strict=True)
        }
        for row in unit
    ]


_READERS: Final = {"grid": _grid, "zip": _zip, "list": _list, "random": _random, "sobol": _sobol}

_OF_SPREAD: Final = ("points", "seed")
_RANGE: Final = ("from", "to", "steps", "scale", "whole")


def fields_in(block: Any, name: str, may_have: tuple[str, ...] = ()) -> dict[str, Any]:
    """Dotted names to what is given for them; tables within tables are names with dots."""
    if not isinstance(block, Mapping):
        raise InputError("is a table of fields and their values", field=name)
    known, found = {*field_names(), PRESET, *may_have}, {}
    for key, value in block.items():
        if key in known or _is_of_code(key):
            found[key] = value
        elif isinstance(value, Mapping) and any(k.startswith(f"{key}.") for k in known):
            found |= fields_in({f"{key}.{k}": v for k, v in value.items()}, name, may_have)
        else:
            last = key.rpartition(".")[2]
            same = [k for k in known if k.rpartition(".")[2] == last]
            hint = f", did you mean '{same[0]}'?" if same else nearest(key, known)
            raise InputError(f"there is no such field{hint}", field=f"{name}.{key}")
    return found


def _is_of_code(name: str) -> bool:
    """Whether a field is a parameter of code that is not loaded: ``strategy.voter.phase_s``."""
    parts = name.split(".")
    return len(parts) == 3 and parts[0] in code_files.KINDS and code_files.is_told(parts[1])


def with_whole(block: Any, name: str = "") -> Any:
    """A block in which ranges of whole parameters of the user's code say so, for who reads it without the code."""
    if not isinstance(block, Mapping):
        return [with_whole(one, name) for one in block] if isinstance(block, list | tuple) else block
    if {"from", "to"} <= set(block):
        whole = "whole" not in block and _is_of_code(name) and _is_whole_field(name)
        return (
            {**block, "whole": True}
            if whole and _is_whole(block["from"]) and _is_whole(block["to"])
            else block
        )
    return {key: with_whole(one, f"{name}.{key}".strip(".")) for key, one in block.items()}


def flat(entry: Mapping[str, Any]) -> dict[str, Any]:
    """A block, or an entry of a ``list``, its fields by dotted names."""
    return fields_in(entry, "list", may_have=(LABEL, *_OF_SPREAD))


def _values(given: Any, name: str) -> list[Any]:
    """The values that a list or a range stands for."""
    if isinstance(given, Mapping):
        steps = given.get("steps")
        if not _is_whole(steps) or not 2 <= steps <= LARGEST:
            raise InputError(f"{steps!r} is no number of steps; give 2 or more", field=f"{name}.steps")
        values = [_at(given, k / (steps - 1), name) for k in range(steps)]
        if len(set(values)) < steps:
            raise InputError("its steps are smaller than 1, and it is of whole numbers", field=name)
        return values
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise InputError(f"{given!r} is no list; write [{given!r}]", field=name)
    if not given:
        raise InputError("is empty; give at least one value", field=name)
    return list(given)


def _at(given: Any, u: float, name: str) -> Any:
    """The value at the share ``u`` of a range, or of a list of choices."""
    if isinstance(given, Sequence) and not isinstance(given, str):
        if not given:
            raise InputError("is empty; give at least one value", field=name)
        return given[min(int(u * len(given)), len(given) - 1)]
    low, high, scale, whole = bounds_of(given, name)
    if whole and "steps" not in given:
        return int(min(math.floor(low + u * (high - low + 1)), high))
    if u in (0.0, 1.0):  # the ends as they are written
        return rounded((low, high)[int(u)], whole)
    value = low * (high / low) ** u if scale == "log" else low + u * (high - low)
    return rounded(value, whole)


def rounded(value: float, whole: bool) -> float | int:
    """A value as a field has it: whole, or of 15 digits."""
    return round(value) if whole else float(f"{value:.15g}")


def bounds_of(given: Any, name: str) -> tuple[float, float, str, bool]:
    """The ends, the scale (linear or log) and whether it is of whole numbers, of a range of the field ``name``."""
    if not isinstance(given, Mapping):
        raise InputError(f"{given!r} is no range; write {{from = 1, to = 2}}", field=name)
    for key in given:
        if key not in _RANGE:
            raise InputError(f"there is no such part of a range{nearest(key, _RANGE)}", field=f"{name}.{key}")
    low, high = _number(given.get("from"), f"{name}.from"), _number(given.get("to"), f"{name}.to")
    if not low < high:
        raise InputError(f"{low} is not below {high}", field=f"{name}.from")
    scale = given.get("scale", "linear")
    if scale not in ("linear", "log") or (scale == "log" and low <= 0):
        raise InputError(f"{scale!r}: linear, or log from above 0", field=f"{name}.scale")
    whole = given.get("whole", isinstance(low, int) and isinstance(high, int) and _is_whole_field(name))
    if not isinstance(whole, bool):
        raise InputError(f"{whole!r}: true or false", field=f"{name}.whole")
    return low, high, scale, whole


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST_NUMBER:
        raise InputError(f"{value!r} is no number of this world", field=name)
    return value


def _is_whole(value: Any) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_whole_field(name: str) -> bool:
    """Whether the field at the end of ``name`` holds whole numbers."""
    from vibroswarm.scenario import kind_of

    parts = name.split(".")
    return any(kind_of(".".join(parts[first:])) is int for first in range(len(parts)))
