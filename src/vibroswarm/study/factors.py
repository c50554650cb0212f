"""Turn the blocks of varied fields and values into points, one for each cell; name the cells.

A point maps the dotted names of varied fields to their values in one cell: ``{"strategy.soft.eta": 1250.0}``. A study's
file lists the varied fields in blocks:

| block | its points |
|---|---|
| ``grid`` | every combination of the fields' values |
| ``zip`` | the first values of all fields, the second values of all fields, ...; all lists are equally long |
| ``list`` | one point for each table of the list; a table may have a ``label`` |
| ``random``, ``sobol`` | as many as ``points`` says, between bounds: random, or evenly spread (a Sobol sequence) |

The points of several blocks are combined in all ways. A field's values are a list, or a range
``{from = 40, to = 80, steps = 5, scale = "log", whole = true}``. ``scale`` and ``whole`` may be left out. ``steps``
is the number of values in a grid or zip, and is not used in the other blocks. Besides the fields of a scenario,
``preset`` may be varied.

The name of a cell contains what distinguishes it from the other cells, with no more digits than needed.
"""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import product
from typing import Any, Final, TypeGuard

import numpy as np

from vibroswarm.core.numbers import number, rounded
from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.errors import InputError, check_kind, nearest, number_of, whole_number_of
from vibroswarm.scenario.plugins import is_code, name_in
from vibroswarm.scenario.scenario import field_types, nearest_field

Point = dict[str, Any]
"""The values of the varied fields in one cell, by the dotted names of the fields."""

BLOCKS: Final = ("grid", "zip", "list", "random", "sobol")
"""Names of the blocks of varied fields."""
LABEL: Final = "label"
"""Key of a table of a ``list`` that names its cells."""
PRESET: Final = "preset"
"""The preset as a varied field."""
LARGEST: Final = 100_000
"""Most cells of a study."""
LARGEST_NUMBER: Final = 1e150
"""Largest absolute value of an end of a range. The quotient of two ends is finite if both are at least its inverse."""


def points_of(blocks: Mapping[str, Any]) -> list[Point]:
    """Return every combination of the points of all blocks; the points of the last block vary fastest.

    Without blocks there is one empty point, for a study of one cell.

    Args:
        blocks: as TOML gives them, by the names of ``BLOCKS``, in the order in which they are written.
    Raises:
        InputError: an unknown block or field, an empty list, a field in two blocks, lists of unequal length, or more
            than ``LARGEST`` cells.
    """
    points_of_blocks: list[list[Point]] = []
    seen: set[str] = set()
    for name, block in blocks.items():
        check_names([name], BLOCKS, "block")
        points = _READERS[name](block, name)
        fields = {field for point in points for field in point}
        if both := sorted(fields & seen):
            raise InputError("is varied in two blocks", field=f"{name}.{both[0]}")
        seen |= fields
        points_of_blocks.append(points)
    if math.prod(len(points) for points in points_of_blocks) > LARGEST:
        raise InputError(f"has more than {LARGEST} cells; vary less", field="study")
    return [{k: v for part in parts for k, v in part.items()} for parts in product(*points_of_blocks)]


# Each reader of a block takes the block as TOML gives it, and its name for messages. It returns the block's points.


def _lists_in(block: Any, name: str) -> dict[str, list[Any]]:
    """Return the list of values of each field of a grid or zip; a range becomes the list of its values."""
    values = {field: _values(choices, f"{name}.{field}") for field, choices in fields_in(block, name).items()}
    if not values:
        raise InputError("is empty; name at least one field", field=name)
    return values


def _grid(block: Any, name: str) -> list[Point]:
    """Return every combination of the fields' values."""
    values = _lists_in(block, name)
    if math.prod(len(v) for v in values.values()) > LARGEST:
        raise InputError(f"has more than {LARGEST} cells; vary less", field=name)
    return [dict(zip(values, chosen, strict=True)) for chosen in product(*values.values())]


def _zip(block: Any, name: str) -> list[Point]:
    """Return a point with the first value of each field, a point with the second value of each, and so on."""
    values = _lists_in(block, name)
    if len({len(choices) for choices in values.values()}) > 1:
        lengths = ", ".join(f"{field} has {len(choices)}" for field, choices in values.items())
        raise InputError(f"its lists are not equally long: {lengths}", field=name)
    return [dict(zip(values, chosen, strict=True)) for chosen in zip(*values.values(), strict=True)]


def _list(block: Any, name: str) -> list[Point]:
    """Return one point for each table of a list."""
    if not isinstance(block, Sequence) or isinstance(block, str) or not block:
        raise InputError("must be a list of one or more tables: [[list]]", field=name)
    points = [fields_in(entry, f"{name}[{k}]", may_have=(LABEL,)) for k, entry in enumerate(block)]
    for k, point in enumerate(points):
        label = point.get(LABEL, "none")
        if not isinstance(label, str | int | float) or not str(label).strip():
            raise InputError(f"{label!r} is not a label; give a text", field=f"{name}[{k}].{LABEL}")
    return points


def sobol_points(rng: np.random.Generator, count: int, dimensions: int) -> np.ndarray[Any, Any]:
    """Return the first ``count`` points of a scrambled Sobol sequence in the unit cube, (count, dimensions)."""
    from scipy.stats import qmc

    # SciPy warns unless the number of drawn points is a power of two, since the points are balanced only then. To avoid
    # the warning, the next power of two is drawn. Its first ``count`` points are those that SciPy would draw for
    # ``count`` itself.
    power_of_two = 1 << (count - 1).bit_length()  # smallest power of two that is at least ``count``
    return np.asarray(qmc.Sobol(dimensions, scramble=True, rng=rng).random(power_of_two)[:count])


def _between_bounds(block: Any, name: str) -> list[Point]:
    """Return points between the bounds of the fields: uniform random ones, or those of a scrambled Sobol sequence.

    Args:
        block: ``points`` (how many), ``seed`` (0 if missing), and the range or list of choices of each field.
        name: of the block, "random" or "sobol".
    """
    check_kind(block, Mapping, name, "a table of fields with their bounds")
    count = whole_number_of(block.get("points"), f"{name}.points", 1, LARGEST)
    seed = whole_number_of(block.get("seed", 0), f"{name}.seed", 0, SEED_LIMIT - 1)
    fields = fields_in({k: v for k, v in block.items() if k not in _NOT_FIELDS}, name)
    if not fields:
        raise InputError("is empty; name at least one field", field=name)
    for field, choices in fields.items():
        if isinstance(choices, Mapping) and "steps" in choices:
            raise InputError(
                "belongs to a grid or zip; here 'points' sets the number of values",
                field=f"{name}.{field}.steps",
            )
    # A row for each point, with a number in [0, 1) for each field.
    rng, size = np.random.Generator(np.random.Philox(seed)), (count, len(fields))
    in_unit_cube = rng.random(size) if name == "random" else sobol_points(rng, *size)
    return [
        {
            field: _at(choices, float(u), f"{name}.{field}")
            for (field, choices), u in zip(fields.items(), row, strict=True)
        }
        for row in in_unit_cube
    ]


_READERS: Final = {
    "grid": _grid,
    "zip": _zip,
    "list": _list,
    "random": _between_bounds,
    "sobol": _between_bounds,
}
"""For each block, the function that returns its points."""

_NOT_FIELDS: Final = ("points", "seed")
"""Keys of the blocks ``random`` and ``sobol`` that are not names of fields."""
_RANGE: Final = ("from", "to", "steps", "scale", "whole")
"""Keys of a range."""


def fields_in(block: Any, name: str, may_have: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the fields of a block by their dotted names; nested tables are flattened.

    Args:
        block: as TOML gives it. name: of the block, for messages.
        may_have: keys that are allowed besides ``preset`` and the fields of a scenario.
    Raises:
        InputError: the block is not a table, or a field does not exist.
    """
    check_kind(block, Mapping, name, "a table of fields and their values")
    known, fields = {*field_types(), PRESET, *may_have}, {}
    for key, value in block.items():
        if key in known:
            fields[key] = value
        elif isinstance(value, Mapping) and any(k.startswith(f"{key}.") for k in known):
            fields |= fields_in({f"{key}.{k}": v for k, v in value.items()}, name, may_have)
        else:
            hint = nearest_field(key, (PRESET, *may_have))
            raise InputError(f"there is no such field{hint}", field=f"{name}.{key}")
    return fields


def flat(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a block, or of a table of a ``list``, by their dotted names."""
    return fields_in(entry, "list", may_have=(LABEL, *_NOT_FIELDS))


def _values(given: Any, name: str) -> list[Any]:
    """Return the values of a field of a grid or zip, which are given as a list or as a range with ``steps``."""
    if isinstance(given, Mapping):
        if "steps" not in given:
            raise InputError(
                "is required: the number of values from one end to the other", field=f"{name}.steps"
            )
        steps = whole_number_of(given["steps"], f"{name}.steps", 2, LARGEST)
        values = [_at(given, k / (steps - 1), name) for k in range(steps)]
        if len(set(values)) < steps:
            raise InputError(
                "has more steps than whole numbers; give fewer steps, or a wider range", field=name
            )
        return values
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise InputError(f"{given!r} is not a list; write [{given!r}]", field=name)
    if not given:
        raise InputError("is empty; give at least one value", field=name)
    return list(given)


def _at(given: Any, u: float, name: str) -> Any:
    """Return the value at the fraction ``u``, 0 to 1, of a range or of a list of choices.

    Args:
        given: range or list, as TOML gives it. A range has ``steps`` in a grid or zip, where u is the position of a
            step, both ends included. Without ``steps``, and for a list, u is drawn from [0, 1).
        name: of the field; it gives the field's type, and is shown in messages.
    """
    if isinstance(given, Sequence) and not isinstance(given, str):
        if not given:
            raise InputError("is empty; give at least one value", field=name)
        # ``min`` would give the last choice for u = 1, which is never drawn.
        return given[min(int(u * len(given)), len(given) - 1)]
    low, high, scale, is_whole = bounds_of(given, name)
    # Without steps, u is drawn: on a linear scale each whole number from low to high has the same probability. If the
    # ends are large, rounding may give high + 1, so ``min`` limits the number.
    if is_whole and "steps" not in given:
        end = high + 1
        value = low * (end / low) ** u if scale == "log" else low + u * (end - low)
        return int(min(math.floor(value), high))
    return value_between(low, high, scale, is_whole, u)


def value_between(low: float, high: float, scale: str, whole: bool, u: float) -> float | int:
    """Return the value at the fraction ``u``, 0 to 1, of a range whose scale is ``linear`` or ``log``.

    It is rounded to a whole number, or else to 15 significant digits, so that 0.1 + 0.2 is written 0.3.
    """
    # The ends exactly as they are written, without the rounding error of the formula.
    if u in (0.0, 1.0):
        value = low if u == 0.0 else high
    else:
        value = low * (high / low) ** u if scale == "log" else low + u * (high - low)
    return round(value) if whole else rounded(value, 15)


def check_names(names: Iterable[str], known: Collection[str], what: str, of: str = "") -> None:
    """Refuse a name that is not known; ``what`` says what it names, and with ``of`` before it, it is the error's field.

    Raises:
        InputError: the message suggests the known name with the most similar spelling.
    """
    for name in names:
        if name not in known:
            raise InputError(f"there is no such {what}{nearest(name, known)}", field=f"{of}{name}")


def bounds_of(given: Any, name: str) -> tuple[float, float, str, bool]:
    """Return the ends of a range, its scale (``linear`` or ``log``), and whether its numbers are whole.

    If the range does not say ``whole``, its numbers are whole if both ends are integers and the field holds integers.

    Args:
        given: the range as TOML gives it.
        name: dotted name that ends with the name of the field; it gives the field's type, and is shown in messages.
    Raises:
        InputError: it is not a range, or a part of it is wrong.
    """
    check_kind(given, Mapping, name, "a range; write {from = 1, to = 2}")
    check_names(given, _RANGE, "part of a range", of=f"{name}.")
    low, high = (
        number_of(given.get(end), f"{name}.{end}", -LARGEST_NUMBER, LARGEST_NUMBER) for end in ("from", "to")
    )
    if not low < high:
        raise InputError(f"{low} is not below {high}", field=f"{name}.from")
    scale = given.get("scale", "linear")
    if scale not in ("linear", "log") or (scale == "log" and low <= 0):
        raise InputError(
            f"{scale!r} must be 'linear', or 'log' if the range begins above 0", field=f"{name}.scale"
        )
    is_whole = given.get("whole", isinstance(low, int) and isinstance(high, int) and _is_whole_field(name))
    if not isinstance(is_whole, bool):
        raise InputError(f"{is_whole!r} is neither true nor false", field=f"{name}.whole")
    return low, high, scale, is_whole


def _is_whole(value: Any) -> TypeGuard[int]:
    """Return whether a value is an integer; True and False, which Python counts as integers, are none."""
    return isinstance(value, int) and not isinstance(value, bool)


def _is_whole_field(name: str) -> bool:
    # What precedes the field's dotted name (the block's name, or nothing) is not known, so every ending is tried.
    parts, types = name.split("."), field_types()
    return any(types.get(".".join(parts[first:])) is int for first in range(len(parts)))


PLAIN: Final = ("floor.source", "strategy.name", "network.name", "task.name", PRESET, LABEL)
"""Fields whose values are written without the name of the field."""
DIGITS: Final = 6
"""Significant digits of a value, if these distinguish it from the other values of its field."""
MOST_DIGITS: Final = 17
"""Significant digits with which different floats are always written differently."""
LONGEST: Final = 60
"""Longer values are not written in full."""


def fields_in_words(words: Mapping[str, str]) -> str:
    """Write values of fields: ``random:0.44, soft, eta 1250``."""
    return ", ".join(v if k in PLAIN else f"{k.rpartition('.')[2]} {v}" for k, v in words.items())


def value_in_words(value: Any, digits: int = DIGITS) -> str:
    """Write one value; if its text has more than ``LONGEST`` characters, write less, and a hash of all of it.

    Of a string its beginning is written, such as of a long label; of other values the number of elements, if they have.

    Args:
        digits: number of significant digits of a float.
    """
    if is_code(value):  # FILE.py:NAME is written as NAME
        return name_in(value)
    text = number(value, digits=digits) if isinstance(value, float) else str(value)
    if len(text) <= LONGEST:
        return text
    digest = hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()[:6]
    if isinstance(value, str):
        return f"{text[: LONGEST - len(digest) - 4]}... {digest}"
    count = f"{len(value)} " if isinstance(value, list | tuple | dict) else ""
    return f"{count}values {digest}"


def words_of_points(points: Sequence[Point]) -> list[dict[str, str]]:
    """Write the values of each point, with enough digits that different numbers of a field look different.

    Returns: for each point, the text of each value by the name of its field.
    """
    texts: dict[str, dict[str, str]] = {}  # for each field, the text of each value by the value's repr
    for name in dict.fromkeys(name for point in points for name in point):
        values = {repr(point[name]): point[name] for point in points if name in point}
        floats = {key for key, value in values.items() if isinstance(value, float)}
        for digits in range(DIGITS, MOST_DIGITS + 1):
            texts[name] = {key: value_in_words(value, digits) for key, value in values.items()}
            if len({texts[name][key] for key in floats}) == len(floats):
                break
    return [{name: texts[name][repr(value)] for name, value in point.items()} for point in points]


def names_of(words: Sequence[Mapping[str, str]], strategies: Sequence[str]) -> list[str]:
    """Name the cells of a study.

    A cell's name is its label. If the label is shared, the values in which the cells with this label differ follow in
    brackets. A cell without a label is named by its varied values, or by its strategy if nothing is varied. The cell's
    number is added if names are still equal.

    Args:
        words: the varied values of each cell as text (``words_of_points``). strategies: name of each cell's strategy.
    """
    cells_with = Counter(point.get(LABEL) for point in words)
    differing = _differing_fields(words)
    names = []
    for point, strategy in zip(words, strategies, strict=True):
        label = point.get(LABEL)
        if label is None:
            names.append(fields_in_words(point) or strategy)
            continue
        rest = fields_in_words({k: v for k, v in point.items() if k in differing[label]})
        names.append(f"{label} ({rest})" if cells_with[label] > 1 and rest else label)
    count = Counter(names)
    return [f"{name} (cell {k})" if count[name] > 1 else name for k, name in enumerate(names)]


def _differing_fields(words: Sequence[Mapping[str, str]]) -> dict[str | None, set[str]]:
    """Return for each label the fields whose values differ between the cells with this label.

    Args:
        words: the varied values of each cell as text.
    """
    by_label: dict[str | None, list[Mapping[str, str]]] = {}
    for point in words:
        by_label.setdefault(point.get(LABEL), []).append(point)
    return {
        label: {
            name
            for name in {name for point in points for name in point} - {LABEL}
            if len({point.get(name) for point in points}) > 1
        }
        for label, points in by_label.items()
    }
