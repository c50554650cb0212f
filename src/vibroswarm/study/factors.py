"""Turn the blocks of varied fields and values into points, one for each cell; name the cells.

| block | gives |
|---|---|
| ``grid`` | every combination of the values |
| ``zip`` | the first values together, then the second, ...; all lists equally long |
| ``list`` | one point for each table, which may have a ``label`` |
| ``random``, ``sobol`` | ``points`` between bounds, uniform or evenly spread |

Several blocks are combined in all ways. A field's values are a list, or a range
``{from = 40, to = 80, steps = 5, scale = "log", whole = true}`` (``scale`` and ``whole`` as needed; ``steps`` only in
a grid or zip). Besides the fields of a scenario, ``preset`` may be varied.

The name of a cell contains what distinguishes it from the other cells, with no more digits than needed.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, Final, TypeGuard

import numpy as np

from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.errors import InputError, nearest, number_of, whole_number_of
from vibroswarm.scenario import plugins
from vibroswarm.scenario.plugins import is_code, name_in
from vibroswarm.scenario.scenario import field_names

Point = dict[str, Any]

BLOCKS: Final = ("grid", "zip", "list", "random", "sobol")
LABEL: Final = "label"
PRESET: Final = "preset"
LARGEST: Final = 100_000
"""Most cells of a study."""
LARGEST_NUMBER: Final = 1e150
"""Largest end of a range, so that the quotient of two ends is finite."""


def points_of(blocks: Mapping[str, Any]) -> list[Point]:
    """Combine the points of all blocks, in the order in which they are written, the last varying fastest.

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


def _lists_in(block: Any, name: str) -> dict[str, list[Any]]:
    """Read the values of each field of a grid or zip."""
    values = {field: _values(choices, f"{name}.{field}") for field, choices in fields_in(block, name).items()}
    if not values:
        raise InputError("is empty; name at least one field", field=name)
    return values


def _grid(block: Any, name: str) -> list[Point]:
    values = _lists_in(block, name)
    if math.prod(len(v) for v in values.values()) > LARGEST:
        raise InputError(f"has more than {LARGEST} cells; vary less", field=name)
    return [dict(zip(values, chosen, strict=True)) for chosen in product(*values.values())]


def _zip(block: Any, name: str) -> list[Point]:
    """Combine the first values, the second values, and so on."""
    values = _lists_in(block, name)
    if len({len(choices) for choices in values.values()}) > 1:
        lengths = ", ".join(f"{field} has {len(choices)}" for field, choices in values.items())
        raise InputError(f"its lists are not equally long: {lengths}", field=name)
    return [dict(zip(values, chosen, strict=True)) for chosen in zip(*values.values(), strict=True)]


def _list(block: Any, name: str) -> list[Point]:
    if not isinstance(block, Sequence) or isinstance(block, str) or not block:
        raise InputError("is a list of tables, at least one: [[list]]", field=name)
    return [fields_in(entry, f"{name}[{k}]", may_have=(LABEL,)) for k, entry in enumerate(block)]


def _random(block: Any, name: str) -> list[Point]:
    return _spread(block, name, lambda seed, d, n: np.random.Generator(np.random.Philox(seed)).random((n, d)))


def _sobol(block: Any, name: str) -> list[Point]:
    """Draw points of a scrambled Sobol sequence."""

    def draw(seed: int, dimensions: int, count: int) -> np.ndarray[Any, Any]:
        """Return the first points of a scrambled Sobol sequence in the unit cube, (count, dimensions)."""
        from scipy.stats import qmc

        size = 1 << max(count - 1, 0).bit_length()  # a Sobol sequence is balanced at powers of two
        sampler = qmc.Sobol(dimensions, scramble=True, rng=np.random.Generator(np.random.Philox(seed)))
        points: np.ndarray[Any, Any] = sampler.random(size)[:count]
        return points

    return _spread(block, name, draw)


def _spread(block: Any, name: str, draw: Any) -> list[Point]:
    """Draw points in the unit cube and scale them to the bounds of the fields."""
    if not isinstance(block, Mapping):
        raise InputError("is a table of fields with bounds", field=name)
    count = whole_number_of(block.get("points"), f"{name}.points", 1, LARGEST)
    seed = whole_number_of(block.get("seed", 0), f"{name}.seed", 0, SEED_LIMIT - 1)
    fields = fields_in({k: v for k, v in block.items() if k not in _OF_SPREAD}, name)
    if not fields:
        raise InputError("is empty; name at least one field", field=name)
    for field, choices in fields.items():
        if isinstance(choices, Mapping) and "steps" in choices:
            raise InputError(
                "is of a grid or zip; here 'points' says how many", field=f"{name}.{field}.steps"
            )
    unit = draw(seed, len(fields), count)
    return [
        {
            field: _at(choices, float(u), f"{name}.{field}")
            for (field, choices), u in zip(fields.items(), row, strict=True)
        }
        for row in unit
    ]


_READERS: Final = {"grid": _grid, "zip": _zip, "list": _list, "random": _random, "sobol": _sobol}

_OF_SPREAD: Final = ("points", "seed")
_RANGE: Final = ("from", "to", "steps", "scale", "whole")


def fields_in(block: Any, name: str, may_have: tuple[str, ...] = ()) -> dict[str, Any]:
    """Map dotted field names to their values; nested tables become dotted names."""
    if not isinstance(block, Mapping):
        raise InputError("is a table of fields and their values", field=name)
    known, fields = {*field_names(), PRESET, *may_have}, {}
    for key, value in block.items():
        if key in known or _is_of_code(key):
            fields[key] = value
        elif isinstance(value, Mapping) and any(k.startswith(f"{key}.") for k in known):
            fields |= fields_in({f"{key}.{k}": v for k, v in value.items()}, name, may_have)
        else:
            last = key.rpartition(".")[2]
            same = [k for k in known if k.rpartition(".")[2] == last]
            hint = f", did you mean '{same[0]}'?" if same else nearest(key, known)
            raise InputError(f"there is no such field{hint}", field=f"{name}.{key}")
    return fields


def _is_of_code(name: str) -> bool:
    """Tell whether a field is a parameter of code that is not loaded: ``strategy.voter.phase_s``."""
    parts = name.split(".")
    return len(parts) == 3 and parts[0] in plugins.KINDS and plugins.is_code_name(parts[1])


def with_whole(block: Any, name: str = "") -> Any:
    """Add ``whole = true`` to ranges of whole-number parameters of user code: without the code the type is unknown."""
    if not isinstance(block, Mapping):
        return [with_whole(value, name) for value in block] if isinstance(block, list | tuple) else block
    if {"from", "to"} <= set(block):
        is_whole = "whole" not in block and _is_of_code(name) and _is_whole_field(name)
        return (
            {**block, "whole": True}
            if is_whole and _is_whole(block["from"]) and _is_whole(block["to"])
            else block
        )
    return {key: with_whole(value, f"{name}.{key}".strip(".")) for key, value in block.items()}


def flat(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Flatten a block, or an entry of a ``list``, to dotted names."""
    return fields_in(entry, "list", may_have=(LABEL, *_OF_SPREAD))


def _values(given: Any, name: str) -> list[Any]:
    """List the values of a list or a range."""
    if isinstance(given, Mapping):
        steps = whole_number_of(given.get("steps"), f"{name}.steps", 2, LARGEST)
        values = [_at(given, k / (steps - 1), name) for k in range(steps)]
        if len(set(values)) < steps:
            raise InputError("its steps are smaller than 1, and it is of whole numbers", field=name)
        return values
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise InputError(f"{given!r} is not a list; write [{given!r}]", field=name)
    if not given:
        raise InputError("is empty; give at least one value", field=name)
    return list(given)


def _at(given: Any, u: float, name: str) -> Any:
    """Return the value at the fraction ``u`` of a range, or of a list of choices."""
    if isinstance(given, Sequence) and not isinstance(given, str):
        if not given:
            raise InputError("is empty; give at least one value", field=name)
        return given[min(int(u * len(given)), len(given) - 1)]
    low, high, scale, is_whole = bounds_of(given, name)
    if is_whole and "steps" not in given:
        return int(min(math.floor(low + u * (high - low + 1)), high))
    if u in (0.0, 1.0):  # the ends as they are written
        return rounded((low, high)[int(u)], is_whole)
    value = low * (high / low) ** u if scale == "log" else low + u * (high - low)
    return rounded(value, is_whole)


def rounded(value: float, whole: bool) -> float | int:
    """Round a value to a whole number, or to 15 digits."""
    return round(value) if whole else float(f"{value:.15g}")


def bounds_of(given: Any, name: str) -> tuple[float, float, str, bool]:
    """Return the ends of a range of the field ``name``, its scale, and whether its numbers are whole."""
    if not isinstance(given, Mapping):
        raise InputError(f"{given!r} is not a range; write {{from = 1, to = 2}}", field=name)
    for key in given:
        if key not in _RANGE:
            raise InputError(f"there is no such part of a range{nearest(key, _RANGE)}", field=f"{name}.{key}")
    low, high = (
        number_of(given.get(end), f"{name}.{end}", -LARGEST_NUMBER, LARGEST_NUMBER) for end in ("from", "to")
    )
    if not low < high:
        raise InputError(f"{low} is not below {high}", field=f"{name}.from")
    scale = given.get("scale", "linear")
    if scale not in ("linear", "log") or (scale == "log" and low <= 0):
        raise InputError(f"{scale!r}: linear, or log from above 0", field=f"{name}.scale")
    is_whole = given.get("whole", isinstance(low, int) and isinstance(high, int) and _is_whole_field(name))
    if not isinstance(is_whole, bool):
        raise InputError(f"{is_whole!r}: true or false", field=f"{name}.whole")
    return low, high, scale, is_whole


def _is_whole(value: Any) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_whole_field(name: str) -> bool:
    """Tell whether the field at the end of ``name`` holds whole numbers."""
    from vibroswarm.scenario.scenario import kind_of

    parts = name.split(".")
    return any(kind_of(".".join(parts[first:])) is int for first in range(len(parts)))


PLAIN: Final = ("floor.source", "strategy.name", "network.name", PRESET, LABEL)
"""Fields whose values need no name beside them."""
DIGITS: Final = 6
MOST_DIGITS: Final = 17
"""Digits with which different numbers are always written differently."""
LONGEST: Final = 60


def fields_in_words(words: Mapping[str, str]) -> str:
    """Write values of fields: ``random:0.44, soft, eta 1250``."""
    return ", ".join(v if k in PLAIN else f"{k.rpartition('.')[2]} {v}" for k, v in words.items())


def value_in_words(value: Any, digits: int = DIGITS) -> str:
    """Write one value; a long one as its length and a hash."""
    if is_code(value):
        return name_in(value)
    text = f"{value:.{digits}g}" if isinstance(value, float) else str(value)
    if len(text) <= LONGEST:
        return text
    count = f"{len(value)} " if isinstance(value, str | list | tuple | dict) else ""
    return f"{count}values {hashlib.sha256(text.encode('utf-8', 'replace')).hexdigest()[:6]}"


def words_of_points(points: Sequence[Point]) -> list[dict[str, str]]:
    """Write each value of each point, so that different values of a field look different."""
    texts: dict[str, dict[str, str]] = {}
    for name in dict.fromkeys(name for point in points for name in point):
        values = {repr(point[name]): point[name] for point in points if name in point}
        for digits in range(DIGITS, MOST_DIGITS + 1):
            texts[name] = {key: value_in_words(value, digits) for key, value in values.items()}
            numbers = {key for key, value in values.items() if isinstance(value, float)}
            if len({texts[name][key] for key in numbers}) == len(numbers):
                break
    return [{name: texts[name][repr(value)] for name, value in point.items()} for point in points]


def names_of(words: Sequence[Mapping[str, str]], strategies: Sequence[str]) -> list[str]:
    """Name cells by their labels, and by their varied values if the label is missing or shared.

    Cells with equal points are distinguished by their numbers.

    Args:
        words: of each cell (``words_of_points``). strategies: of each cell's scenario.
    """
    labels = Counter(point.get(LABEL) for point in words)
    names = []
    for point, strategy in zip(words, strategies, strict=True):
        label = point.get(LABEL)
        if label is None:
            names.append(fields_in_words(point) or strategy)
            continue
        rest = fields_in_words({k: v for k, v in point.items() if k != LABEL and _differs(words, label, k)})
        names.append(f"{label} ({rest})" if labels[label] > 1 and rest else label)
    count = Counter(names)
    return [f"{name} (cell {k})" if count[name] > 1 else name for k, name in enumerate(names)]


def _differs(words: Sequence[Mapping[str, str]], label: str, name: str) -> bool:
    """Tell whether a field differs between the cells of a label."""
    return len({point.get(name) for point in words if point.get(LABEL) == label}) > 1
