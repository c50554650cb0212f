"""Values of a study as TOML, as plain values for JSON, and the floors that its file defines."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import vibroswarm.simulation  # noqa: F401  (makes the engines known)
from vibroswarm.errors import InputError, check_kind
from vibroswarm.floors.source import family, is_generated
from vibroswarm.study.factors import BLOCKS, flat


def as_toml(values: Mapping[str, Any]) -> str:
    """Write a study's values as TOML, blocks last.

    Blocks and their fields keep their order, since the order of the cells follows from it. Names of fields are written
    with dots, in quotes.
    """
    import tomli_w

    parts = [tomli_w.dumps({k: v for k, v in values.items() if k not in BLOCKS})]
    for name in (name for name in values if name in BLOCKS):
        # The block ``list`` is an array of tables, each with the head [[list]]; every other block is one table.
        head, tables = (f"[[{name}]]", values[name]) if name == "list" else (f"[{name}]", [values[name]])
        for table in tables:
            # A name in quotes is written alike in JSON and in TOML.
            lines = (f"{json.dumps(field)} = {_inline(value)}" for field, value in flat(table).items())
            parts.append("\n".join([head, *lines]))
    return "\n".join(parts) + "\n"


def _inline(value: Any) -> str:
    """Write a value as TOML, as it stands after ``name =``.

    A mapping (a range) is written as an inline table. ``tomli_w`` would write it as a table of its own, which TOML puts
    after all fields of its block and so out of order.
    """
    import tomli_w

    if type(value) is int:  # numbers are written without tomli_w, which is faster
        return str(value)
    if type(value) is float and math.isfinite(value):
        return repr(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_inline(part)}" for name, part in value.items()) + " }"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").strip()


def copy_of(base: Mapping[str, Any]) -> dict[str, Any]:
    """Copy the base of a study: sections of a scenario by name, and possibly the name of a ``preset``.

    Each section is copied too, so that its fields can be set without changing the base. Tables within a section are
    not copied.
    """
    return {k: dict(v) if isinstance(v, Mapping) else v for k, v in base.items()}


Rows = tuple[str, ...] | tuple[tuple[float, ...], ...]
"""Rows of a floor, the top row first: a text of kinds of tile each, or values of tiles."""


def _checked_floors(values: Any) -> dict[str, Rows]:
    """Return the floors of a study by name. That rows consist of kinds or values is checked when a cell uses them."""
    check_kind(values, Mapping, "floors", "a table of floors by name")
    return {name: _checked_rows(name, rows) for name, rows in values.items()}


def _checked_rows(name: str, rows: Any) -> Rows:
    if is_generated(name) or family(name) is not None:
        raise InputError(
            "is the name of a pattern or of a random floor; give this one a name of its own",
            field=f"floors.{name}",
        )
    if isinstance(rows, list | tuple):
        if all(isinstance(row, str) for row in rows):
            return tuple(rows)
        if all(isinstance(row, list | tuple) for row in rows):
            return tuple(map(tuple, rows))
    raise InputError(
        "must be a list of rows of 0 and 1, or of rows of values, the top row first", field=f"floors.{name}"
    )


def fields_of_floor(rows: Rows | None) -> dict[str, Rows | None]:
    """Return the fields of a scenario's floor that hold its rows; None without rows, for a floor that its name says."""
    has_values = rows is not None and any(not isinstance(row, str) for row in rows)
    return {"tiles": None if has_values else rows, "values": rows if has_values else None}
