"""Any CSV by a column map in TOML; the robots' own format is one such map (``formats/rugbot.toml``).

A map says for each column of ``log.SAMPLES`` from which column of the file it is read:

    missing = ["None", ""]              # cells that hold nothing
    [columns]
    robot = "ROV Number"
    time_s = { name = "t_ms", times = 0.001 }
    y_m = { name = "z", times = -1.0, plus = 1.0 }
    sent = { name = "Swarm Send", wraps_at = 65536 }
    decision = { name = "d_f", values = { "2" = -1, "0" = 0, "1" = 1 } }
    [settings]                          # fields of the scenario that hold for every such file
    "sample.stop_ms" = 1000.0

``robot``, ``time_s``, ``x_m``, ``y_m`` and ``energy`` are needed. A row with an energy is a sample, one without a
tracking row. ``tag`` names a column that goes with the robot (the marker that it carries): a robot has one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.errors import InputError, nearest
from vibroswarm.lab.cells import check_columns, check_values, numbers_of, plain_number, table_of, text_of
from vibroswarm.lab.log import COUNTERS, REQUIRED, SAMPLES, TRACKS, Log, log_frame

USES: Final = (*(name for name in SAMPLES if name != "line"), "tag")


@dataclass(frozen=True)
class Column:
    """Where a use is read from: number of the file, times ``times``, plus ``plus``; or a table of values."""

    name: str
    times: float = 1.0
    plus: float = 0.0
    wraps_at: float | None = None
    """In the file's unit."""
    values: Mapping[str, float] | None = None


@dataclass(frozen=True)
class ColumnMap:
    """How a kind of CSV is read."""

    name: str
    columns: Mapping[str, Column]
    missing: tuple[str, ...] = ("", "None", "nan", "NaN")
    settings: Mapping[str, Any] = field(default_factory=dict)


@cache
def rugbot_map() -> ColumnMap:
    """The map of the CSV of the study's robots."""
    text = files("vibroswarm.lab").joinpath("formats/rugbot.toml").read_text(encoding="utf-8")
    return column_map(text, "rugbot")


def column_map(text: str, name: str) -> ColumnMap:
    """A map from TOML text.

    Raises:
        InputError: no TOML, an unknown use, or one that is needed and missing.
    """
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not TOML: {error}", field=name) from None
    unknown = set(values) - {"missing", "columns", "settings", "name", "about"}
    if unknown:
        raise InputError(f"there is no '{min(unknown)}' in a column map", field=name)
    columns = values.get("columns")
    if not isinstance(columns, dict):
        raise InputError("has no [columns]", field=name)
    lacking = [use for use in REQUIRED if use not in columns]
    if lacking:
        raise InputError(f"does not say from which column {lacking[0]} is read", field=f"{name}, [columns]")
    missing = values.get("missing", ["", "None", "nan", "NaN"])
    if not isinstance(missing, list) or not all(isinstance(one, str) for one in missing):
        raise InputError("is a list of texts", field=f"{name}, missing")
    settings = values.get("settings", {})
    if not isinstance(settings, dict):
        raise InputError("is a table of fields of the scenario", field=f"{name}, settings")
    return ColumnMap(
        name=str(values.get("name", name)),
        columns={use: _column(use, value, name) for use, value in columns.items()},
        missing=tuple(one.strip() for one in missing),
        settings=settings,
    )


def _column(use: str, value: Any, name: str) -> Column:
    where = f"{name}, columns.{use}"
    if use not in USES:
        raise InputError(f"there is no such column{nearest(use, USES)}", field=where)
    if isinstance(value, str):
        return Column(value)
    if not isinstance(value, dict) or not isinstance(value.get("name"), str):
        raise InputError('is the name of a column, or { name = "...", times = ..., plus = ... }', field=where)
    unknown = set(value) - {"name", "times", "plus", "wraps_at", "values"}
    if unknown:
        raise InputError(f"there is no '{min(unknown)}' here", field=where)
    table = value.get("values")
    if table is not None and not isinstance(table, dict):
        raise InputError("values is a table, text to number", field=where)
    wraps_at = value.get("wraps_at")
    if wraps_at is not None and use not in COUNTERS:
        raise InputError(f"only counters wrap ({', '.join(COUNTERS)})", field=where)
    return Column(
        value["name"],
        plain_number(value.get("times", 1.0), "times", where),
        plain_number(value.get("plus", 0.0), "plus", where),
        None if wraps_at is None else plain_number(wraps_at, "wraps_at", where),
        None if table is None else {key: plain_number(one, key, where) for key, one in table.items()},
    )


def read_mapped(path: Path, by: ColumnMap) -> Log:
    """A CSV as a log.

    Raises:
        InputError: missing columns, text in numbers, impossible values, a robot with two tags; with the row's number.
    """
    name = str(path)
    table = table_of(text_of(path), name)
    check_columns({use: column.name for use, column in by.columns.items()}, table.columns[1:], name)
    lines = table["line"]
    found: dict[str, pl.Series] = {"line": lines}
    for use, column in by.columns.items():
        found[use] = _converted(table[column.name], lines, name, use, column, by.missing)
    for use in ("robot", "time_s", "x_m", "y_m"):
        _check_there(found[use], lines, name, by.columns[use].name)
    _check_tags(found, name)
    is_sample = found["energy"].is_not_null()
    frame = pl.DataFrame({use: one.alias(use) for use, one in found.items() if use != "tag"})
    samples, tracks = frame.filter(is_sample), frame.filter(~is_sample)
    wraps_at = {use: one.wraps_at * one.times for use, one in by.columns.items() if one.wraps_at is not None}
    return Log(
        name=path.name,
        reader=by.name,
        samples=log_frame(samples.to_dict(), SAMPLES),
        tracks=log_frame({use: tracks[use] for use in TRACKS if use in tracks.columns}, TRACKS),
        wraps_at=wraps_at,
        settings=by.settings,
        told={"rows": table.height},
    )


def _converted(
    cells: pl.Series, lines: pl.Series, name: str, use: str, column: Column, missing: tuple[str, ...]
) -> pl.Series:
    if column.values is None:
        numbers = numbers_of(cells, lines, name, column.name, missing)
        if (column.times, column.plus) != (1.0, 0.0):
            numbers = numbers * column.times + column.plus
    else:
        keys = cells.str.strip_chars().str.replace(r"\.0$", "")
        unknown = ~keys.is_in(list(column.values)) & ~keys.is_in(list(missing))
        if unknown.any():
            k = int(unknown.arg_true()[0])
            raise InputError(
                f"'{str(cells[k])[:40]}' in column '{column.name}' is none of {', '.join(column.values)}",
                field=f"{name}, row {lines[k]}",
            )
        numbers = keys.replace_strict(dict(column.values), default=None, return_dtype=pl.Float64)
    check_values(numbers, lines, name, use, column.name)
    return numbers


def _check_there(numbers: pl.Series, lines: pl.Series, name: str, column: str) -> None:
    if numbers.null_count():
        k = int(numbers.is_null().arg_true()[0])
        raise InputError(f"nothing in column '{column}'", field=f"{name}, row {lines[k]}")


def _check_tags(found: Mapping[str, pl.Series], name: str) -> None:
    if "tag" not in found:
        return
    pairs = pl.DataFrame({use: found[use].alias(use) for use in ("line", "robot", "tag")}).drop_nulls()
    first = pairs.group_by("robot", maintain_order=True).agg(pl.col("tag").first().alias("first"))
    other = pairs.join(first, on="robot", maintain_order="left").filter(pl.col("tag") != pl.col("first"))
    if other.height:
        line, robot, tag, known = other.row(0)
        raise InputError(
            f"robot {robot:g} carries marker {tag:g}, and {known:g} before: unknown robot or marker",
            field=f"{name}, row {line}",
        )
