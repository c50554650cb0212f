"""Tables of others, read: logs, surveys, acceleration, robots' own logs, measured energies.

Files are CSV with commas, semicolons or tabs between columns; with the latter two, numbers may have decimal commas. A
table is read by a schema, which declares columns once (``Use``). Without a column map a file's columns have the names
of the schema, in any case, with blanks or ``_``; the unit may be another one, also in parentheses: ``Time (ms)`` is
``time_s``, ``X_mm`` is ``x_m``, ``ax (g)`` is ``ax`` in m/s^2. A column map (TOML) names other columns:

    missing = ["None", ""]              # texts of empty cells
    [columns]
    robot = "ROV Number"
    time_s = { name = "t_ms", times = 0.001 }
    y_m = { name = "z", times = -1.0, plus = 1.0 }
    sent = { name = "Swarm Send", wraps_at = 65536 }
    decision = { name = "d_f", values = { "2" = -1, "0" = 0, "1" = 1 } }
    [settings]                          # fields of the scenario that hold for every such file
    "sample.stop_ms" = 1000.0

A number in the file is multiplied by ``times``, then ``plus`` is added; a text is looked up in ``values``. ``wraps_at``
is the number at which a counter starts again from 0. ``first`` of ``time_s`` is the time of the earliest row, s, for
clocks that do not begin with the session. Timestamps (ISO 8601) count from the earliest row.

Without a column of robots each file is of one robot. Robots with names get numbers in the order of their names.
"""

from __future__ import annotations

import io
import re
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple, TypeVar

import polars as pl
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from vibroswarm.core.numbers import some
from vibroswarm.core.untrusted_files import parsed_toml, read_bytes, read_text
from vibroswarm.errors import InputError

LARGEST_BYTES: Final = 64 * 2**20
"""Size of the largest file; an hour of ten robots has 10 MB."""
UNITS: Final = (
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048},
    {"m_s2": 1.0, "mm_s2": 1e-3, "g": 9.80665},
)
"""Units of a quantity, and how many of the first each is."""
ACCELERATIONS: Final = ("ax", "ay", "az")
"""Columns whose unit is not in their name; it is that of the file, unless the file's column says another."""
_PREAMBLE: Final = re.compile(
    r"""(?:\s*(?:#[^\r\n]*|"?sep=.?"?[ \t]*)[\r\n]++(?!\s*[\d.+-]))*+\s*""", re.ASCII | re.IGNORECASE
)
"""Lines before the header: blanks, comments, and the separator as spreadsheets write it. A comment directly above
numbers is the header."""
_TIMESTAMP: Final = r"^\s*\d{4}-\d\d-\d\d[T ]"


class Use(NamedTuple):
    """What a column is used for: its type, and what is allowed."""

    kind: Any
    low: float
    high: float
    allowed: str
    """The range in words, for errors."""
    required: bool = False
    """Whether each row has a value; a file need not have the column if it is ``robot``."""
    also: tuple[str, ...] = ()
    """Other names of the column."""


Schema = Mapping[str, Use]


class Column(BaseModel):
    """A column of the file, and how its cells are converted to numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    name: str
    times: float = 1.0
    plus: float = 0.0
    wraps_at: float | None = Field(None, gt=0)
    values: dict[str, float] | None = None
    first: float | None = None


class ColumnMap(BaseModel):
    """How a kind of file is read."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str = "table"
    about: str = ""
    missing: tuple[str, ...] = ("", "None", "nan", "NaN", "NA")
    columns: dict[
        str,
        Annotated[
            Column, BeforeValidator(lambda value: {"name": value} if isinstance(value, str) else value)
        ],
    ] = {}
    settings: dict[str, Any] = {}


M = TypeVar("M", bound=BaseModel)


def read_model(model: type[M], path: Path, what: str) -> M:
    """Read a model from a TOML file; ``what`` names the kind of file, for errors."""
    values = parsed_toml(read_text(path, what), str(path))
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(first["msg"], field=f"{path}, {'.'.join(map(str, first['loc']))}") from None


class Read(NamedTuple):
    """A table that was read."""

    rows: pl.DataFrame
    """The columns of the schema that the files have, and ``file`` and ``line``, from 1."""
    columns: Mapping[str, Column]
    robots: Mapping[str, int]
    """Numbers of robots that have names; empty: robots have numbers."""
    has_timestamps: bool
    missing: int
    """Rows that lack a value that each row needs; they are left out."""
    unread: pl.DataFrame
    """Columns of the files that were not read."""


def read_rows(paths: Sequence[Path], schema: Schema, by: ColumnMap | None = None) -> Read:
    """Read the rows of files, one below the other; without a column map, columns have the names of the schema."""
    by = by or ColumnMap()
    cells = pl.concat([cells_of(path) for path in paths], how="diagonal")
    return converted(cells, _columns_of(cells.columns, schema, by, paths[0]), schema, by.missing)


def converted(
    cells: pl.DataFrame, columns: Mapping[str, Column], schema: Schema, missing: Sequence[str]
) -> Read:
    """Convert cells, texts in columns beside ``file`` and ``line``; ``missing`` are texts of empty cells."""
    found, robots, has_timestamps = [cells["file"], cells["line"]], dict[str, int](), False
    for use, column in columns.items():
        text = cells[column.name].str.strip_chars()
        text = text.set(text.is_in(list(missing)), None)
        if use == "robot" and column.values is None:
            robots = _numbers_for(text)
            column = column.model_copy(update={"values": robots or None})
        if use == "time_s" and text.str.contains(_TIMESTAMP).any():
            numbers, has_timestamps = _seconds_of(text) + (column.first or column.plus), True
        else:
            numbers = _numbers_of(text, column)
        allowed = numbers.is_between(schema[use].low, schema[use].high) & (
            (numbers == numbers.round()) | (schema[use].kind != pl.Int64)
        )
        if (wrong := text.is_not_null() & ~allowed.fill_null(False)).any():
            k = int(wrong.arg_true()[0])
            raise InputError(
                f"'{text[k][:40]}' in column '{column.name}' is not {schema[use].allowed}",
                field=f"{cells['file'][k]}, row {cells['line'][k]}",
            )
        found.append(numbers.cast(schema[use].kind).alias(use))
    if "robot" in schema and "robot" not in columns:  # each file is of one robot
        found.append(cells["file"].rle_id().cast(schema["robot"].kind).alias("robot"))
    rows = pl.DataFrame(found)
    whole = rows.drop_nulls([use for use, one in schema.items() if one.required and use in rows.columns])
    unread = cells.drop("file", "line", *{column.name for column in columns.values()})
    return Read(whole, columns, robots, has_timestamps, rows.height - whole.height, unread)


def text_of(path: Path) -> str:
    """Return the text of a file; bytes that are not UTF-8 are replaced by U+FFFD."""
    text = read_bytes(path, LARGEST_BYTES, "a table").decode("utf-8-sig", errors="replace")
    if "\0" in text[:4096] or not text.strip():
        raise InputError("is empty, a binary file, or text in UTF-16; give text in UTF-8", field=str(path))
    return text


def files_of(path: Path, name: str = "") -> list[Path]:
    """Return the files of one session: the file itself, or in a folder ``name``, or else all its tables, in order."""
    if not path.is_dir():
        return [path]
    if name and (path / name).is_file():
        return [path / name]
    found = sorted(
        (one for one in path.iterdir() if one.suffix.lower() in (".csv", ".tsv", ".txt")),
        key=lambda one: _natural(one.name),
    )
    if not found:
        raise InputError("is a folder without a table (.csv)", field=str(path))
    return found


def plain_name(name: str) -> str:
    """Return the name of a column in small letters, with ``_`` for all else: ``Time (µs)`` is ``time_us``."""
    text = unicodedata.normalize("NFKC", name).casefold().replace("μ", "u")
    return re.sub(r"\W+", "_", text).strip("_")


def _natural(name: str) -> list[tuple[int, int, str]]:
    """Return a key of sorting by which ``r2`` comes before ``r10``."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", name)]


def cells_of(path: Path) -> pl.DataFrame:
    """Return the cells of a file as texts, with ``file``, its path, and ``line``; without rows of blanks."""
    text = text_of(path)
    before = _PREAMBLE.match(text)[0]  # type: ignore[index]  # it matches always, if only nothing
    body = text[len(before) :]
    head = body.split("\n", 1)[0]
    separator = max(",;\t", key=head.count)
    try:
        frame = pl.read_csv(io.BytesIO(body.encode()), separator=separator, infer_schema=False)
        frame = frame.rename(str.strip).with_row_index("line", len(before.splitlines()) + 2)
    except pl.exceptions.PolarsError as error:
        raise InputError(
            f"is no table with '{separator}' between columns: {error}", field=str(path)
        ) from None
    if separator != ",":
        frame = frame.with_columns(pl.col(pl.String).str.replace(r"^(\s*[+-]?\d*),(\d)", "$1.$2"))
    is_blank = pl.all_horizontal(pl.exclude("line").fill_null("").str.strip_chars() == "")
    return frame.filter(~is_blank).select(pl.lit(str(path)).alias("file"), pl.all())


def _columns_of(names: Sequence[str], schema: Schema, by: ColumnMap, path: Path) -> dict[str, Column]:
    """Return the columns of a file, by use: those of the column map, or those with the names of the schema."""
    there = {plain_name(name): name for name in reversed(names)}
    found = {}
    for use, column in by.columns.items() if by.columns else ():
        if use not in schema or plain_name(column.name) not in there:
            why = (
                f"has no column '{column.name}'"
                if use in schema
                else f"'{use}' is none of {', '.join(schema)}"
            )
            raise InputError(f"{why}; it has {some(list(names[2:]), 20)}", field=str(path))
        found[use] = column.model_copy(update={"name": there[plain_name(column.name)]})
    for use in () if by.columns else schema:
        for spelling in (use, *schema[use].also):
            for name, times in _spellings(spelling).items():
                if name in there:
                    found.setdefault(use, Column(name=there[name], times=times))
    lacking = [use for use, one in schema.items() if one.required and use not in found and use != "robot"]
    if lacking:
        raise InputError(
            f"has no column '{lacking[0]}'; it has {some(list(names[2:]), 20)} (a column map, --columns, can name it)",
            field=str(path),
        )
    return found


def _spellings(use: str) -> dict[str, float]:
    """Return the names that a column may have, and the factor of each."""
    for units in UNITS:
        first, *_ = units
        if use in ACCELERATIONS and first == "m_s2":
            return {use: 1.0} | {f"{use}_{unit}": times for unit, times in units.items()}
        base, _, unit = use.rpartition("_")
        if base and unit == first:
            return {f"{base}_{other}": times for other, times in units.items()}
    return {use: 1.0}


def _numbers_for(text: pl.Series) -> dict[str, int]:
    """Return a number for each name of a robot, in their order; empty if robots have numbers."""
    if text.cast(pl.Float64, strict=False).count():
        return {}
    return {name: k for k, name in enumerate(sorted(text.drop_nulls().unique(), key=_natural))}


def _seconds_of(text: pl.Series) -> pl.Series:
    """Return timestamps as seconds since the earliest; null where a text is none, or has another zone."""
    first = text.filter(text.str.contains(_TIMESTAMP).fill_null(False))[0]
    has_zone = re.search(r"(Z|[+-]\d\d(:?\d\d)?)$", first[len("2026-05-01") :]) is not None
    stamps = text.str.replace(" ", "T", literal=True)
    times = stamps.str.to_datetime("%FT%T%.f%#z" if has_zone else "%FT%T%.f", time_unit="us", strict=False)
    return (times - times.min()).dt.total_microseconds() / 1e6


def _numbers_of(text: pl.Series, column: Column) -> pl.Series:
    """Return cells as numbers: null where they are missing, and where they are none."""
    if column.values is not None:
        keys = text.str.replace(r"\.0$", "").str.to_lowercase()  # a spreadsheet writes 1 as 1.0
        values = {key.lower(): value for key, value in column.values.items()}
        return keys.replace_strict(values, default=None, return_dtype=pl.Float64)
    numbers = text.cast(pl.Float64, strict=False)
    if column.first is not None:
        return (numbers - numbers.min()) * column.times + column.first
    return numbers if (column.times, column.plus) == (1.0, 0.0) else numbers * column.times + column.plus
