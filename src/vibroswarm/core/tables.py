"""Checks of tables from any source, and CSV that is safe to open in a spreadsheet.

The allowed range of a column depends on its name alone and is given in ``ALLOWED``. A ``Schema`` gives the type of each
column, which columns may be null, and the key (columns that identify a row). Relations between tables, and between
tables and the scenario, are checked in ``result_validation``.

A spreadsheet takes a cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a carriage return for a formula and
runs it, although the text may come from a stranger: a label, a file name, a message. ``escaped`` puts an apostrophe
before such texts, by which spreadsheets mark a text. Texts that are numbers ("-1.5") stay as they are. ``unescaped``
restores the texts.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import stated
from vibroswarm.core.untrusted_files import check_plain
from vibroswarm.errors import InputError

MAX_BYTES: Final = 64 * 2**30
"""Size limit of a table's file."""
MANY_CELLS: Final = 50_000_000
"""A table of at most this many cells is read, however small its file."""
MOST_CELLS_PER_BYTE: Final = 100
"""Largest number of cells per byte of the file of a larger table; those of results have about 1."""
FAR_M: Final = 1e5
LONG_S: Final = 1e7 + 1e5
"""A run lasts up to 1e7 s; a sample under way may end after it."""
LARGEST: Final = 1e300
"""Any number in a table that is not infinite is below this."""

_COUNT: Final = (0.0, float(2**32 - 1))
_SHARE: Final = (0.0, 1.0)
_TIME: Final = (0.0, LONG_S)
_PLACE: Final = (-FAR_M, FAR_M)
_LAST_KIND: Final = 15.0
"""Largest number of a kind of tile, of a class of readings and of a decision; ``result_validation`` checks them against
the scenario, which mostly has two."""
ALLOWED: Final[dict[str, tuple[float, float]]] = {
    **dict.fromkeys(
        ("run", "robot", "cell", "sample", "line", "samples", "sent", "messages_received"), _COUNT
    ),
    **dict.fromkeys(("lost_before", "right", "wrong", "undecided"), _COUNT),
    **dict.fromkeys(("alpha", "beta"), _COUNT),
    **dict.fromkeys(("belief_below", "belief_at_decision", "belief_in_truth", "message"), _SHARE),
    # A task may ask for any number; ``result_validation`` checks shares.
    **dict.fromkeys(("fill_ratio", "estimate"), (-LARGEST, LARGEST)),
    "estimate_spread": (0.0, LARGEST),
    "index": _COUNT,
    "value": (-math.inf, math.inf),  # a report, which may be any number
    **dict.fromkeys(("observation", "truth"), (0.0, _LAST_KIND)),
    "decision": (-1.0, _LAST_KIND),
    "tile": (-1.0, 2.0**31 - 1),
    "energy": (-1e9, 1e12),
    **dict.fromkeys(("time_s", "stop_start_s", "start_s", "end_s", "consensus_time_s"), _TIME),
    **dict.fromkeys(("decision_time_s", "avoid_total_s", "stop_total_s"), _TIME),
    **dict.fromkeys(("drive_s", "turn_s", "avoid_s", "stop_s"), (-1e3, LONG_S)),
    "from_s": _TIME,
    "position_age_s": (-1e9, 1e9),
    "lagged_sample": _COUNT,
    **dict.fromkeys(("x_m", "y_m", "left_m", "bottom_m", "lagged_x_m", "lagged_y_m"), _PLACE),
    **dict.fromkeys(("spread_m", "lagged_spread_x_m", "lagged_spread_y_m"), (0.0, FAR_M)),
    "heading_rad": (-1e9, 1e9),
    "turn_rate_rad_s": (-1e6, 1e6),
    "turned_rad": (-1e9, 1e9),
    "ray_m": (0.0, 1e6),
    "speed_m_s": (-1e3, 1e3),
    **dict.fromkeys(("rows", "columns"), (1.0, 1e8)),
    **dict.fromkeys(("tile_width_m", "tile_height_m"), (1e-12, 1e4)),
    "ones": _SHARE,
    **dict.fromkeys(("avoid_per_sample_s", "spacing_s"), (0.0, LONG_S)),
    "distance_m": (0.0, 1e9),
    # Infinite in analysis tables of two robots that always or never read alike.
    "effective_samples": (0.0, math.inf),
}
"""Least and greatest value of a column of this name; words and times of day have none."""


@dataclass(frozen=True)
class Schema:
    """Columns, types and keys of a table."""

    columns: Mapping[str, Any]
    """Name to type of each column."""
    nullable: frozenset[str] = frozenset()
    """Names of the columns that may be null."""
    key: tuple[str, ...] = ()
    """Names of the columns that together identify a row; empty: rows may repeat."""
    further: Any = None
    """Type of further columns, of any name, which may be null; None: there are no others."""


DAMAGED: Final = "is damaged: not a complete Parquet file"


def read_table(path: Path, schema: Schema, what: str) -> pl.DataFrame:
    """Read a table from a Parquet file and check it; return it with its columns in the order of the schema.

    Args:
        what: name of the table, for errors.
    Raises:
        InputError: the file is not a regular Parquet file, or the table does not pass ``check_table``.
    """
    return check_table(read_frame(path, what), schema, str(path), what)


def read_frame(path: Path, what: str) -> pl.DataFrame:
    """Read a Parquet file, whatever its columns.

    Args:
        what: name of the table, for errors.
    Raises:
        InputError: the file is missing, larger than MAX_BYTES, or not a complete Parquet file.
    """
    if not path.exists():
        raise InputError("is missing", field=str(path))
    size = check_plain(path, MAX_BYTES, f"the table '{what}'")
    try:
        lazy = scan_frame(path)
        _check_cells(lazy, size, str(path))
        return lazy.collect()
    except InputError:
        raise
    except PermissionError:  # of polars, which has its own words
        raise InputError("cannot be read: Permission denied", field=str(path)) from None
    except OSError as error:
        how = f"cannot be read: {error.strerror}" if error.strerror else DAMAGED
        raise InputError(how, field=str(path)) from None
    except (ValueError, OverflowError, pl.exceptions.PolarsError, pl.exceptions.PanicException):
        raise InputError(DAMAGED, field=str(path)) from None


def scan_frame(path: Path) -> pl.LazyFrame:
    """Return a lazy table of a Parquet file of any name; polars itself takes only names that are valid Unicode."""
    source = path if is_unicode(path) else io.BytesIO(path.read_bytes())
    return pl.scan_parquet(source, glob=False)  # a * in the path is part of the file's name, not a pattern


def parquet_bytes(frame: pl.DataFrame, metadata: dict[str, str] | None = None) -> bytes:
    """Return a table as a Parquet file, with ``metadata`` (texts by name) as the file's own metadata."""
    stream = io.BytesIO()
    frame.write_parquet(stream, compression="zstd", metadata=metadata)
    return stream.getvalue()


def frame_of(content: bytes) -> pl.DataFrame:
    """Return the table of a Parquet file of our own, as ``parquet_bytes`` makes it."""
    return pl.read_parquet(content)


def write_frame(frame: pl.DataFrame, path: Path, metadata: dict[str, str] | None = None) -> None:
    """Write a table as a Parquet file of any name, with ``metadata`` (texts by name) as the file's own metadata.

    Raises:
        OSError: it cannot be written; polars would say "Invalid thrift" of a full disk.
    """
    path.write_bytes(parquet_bytes(frame, metadata))


def is_unicode(path: Path) -> bool:
    """Return whether a path is valid Unicode; names of files on Linux may be any bytes."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def _check_cells(lazy: pl.LazyFrame, size: int, name: str) -> None:
    """Refuse a table that states far more cells than a file of its size holds: reading it would fill the memory.

    Args:
        lazy: the table, of which only the head is read. size: of the file, bytes. name: of the file, for errors.
    Raises:
        InputError: there are too many cells.
    """
    rows = int(lazy.select(pl.len()).collect().item())
    cells = rows * len(lazy.collect_schema())
    if cells > MANY_CELLS and cells > MOST_CELLS_PER_BYTE * size:
        raise InputError(
            f"states {rows:,} rows, too many for a file of {size:,} bytes: it is damaged, or made to fill the memory",
            field=name,
        )


def check_table(frame: pl.DataFrame, schema: Schema, name: str, what: str) -> pl.DataFrame:
    """Check that a frame conforms to a schema; return it with its columns in the order of the schema.

    Args:
        name: name of the file, for errors. what: name of the table, for errors.
    Raises:
        InputError: columns are missing, unexpected or of the wrong type; a value is missing, out of range or NaN; or
            two rows have the same key.
    """
    frame = _with_all_words(frame, schema)
    _check_columns(frame, schema, name, what)
    frame = frame.select([*schema.columns, *(name for name in frame.columns if name not in schema.columns)])
    for column in schema.columns:
        if fault := _fault_of(frame[column], schema):
            raise InputError(fault, field=name)
    if schema.key and frame.select(schema.key).is_duplicated().any():
        twice = frame.filter(frame.select(schema.key).is_duplicated()).select(schema.key).row(0, named=True)
        keys = ", ".join(f"{key} {value}" for key, value in twice.items())
        raise InputError(f"{keys} appears twice in the table '{what}'", field=name)
    return frame


def _with_all_words(frame: pl.DataFrame, schema: Schema) -> pl.DataFrame:
    """Return a table whose enumerations have all words of the schema: an older file may know fewer."""
    found = frame.schema
    fewer = {
        column: kind
        for column, kind in schema.columns.items()
        if isinstance(kind, pl.Enum)
        and isinstance(had := found.get(column), pl.Enum)
        and set(had.categories) < set(kind.categories)
    }
    return frame.with_columns(pl.col(column).cast(kind) for column, kind in fewer.items()) if fewer else frame


def _check_columns(frame: pl.DataFrame, schema: Schema, name: str, what: str) -> None:
    """Refuse a frame with missing, unexpected or wrongly typed columns; ``name`` and ``what`` as in ``check_table``."""
    has_not = f"does not have the columns of the table '{what}'"
    found = frame.schema
    for column, kind in schema.columns.items():
        if column not in found:
            raise InputError(f"{has_not}: '{column}' is missing", field=name)
        if found[column] != kind:
            raise InputError(f"{has_not}: '{column}' is {found[column]}, expected {_kind(kind)}", field=name)
    unexpected = [
        column
        for column, kind in found.items()
        if column not in schema.columns and (schema.further is None or kind != schema.further)
    ]
    if unexpected:
        raise InputError(f"{has_not}: '{unexpected[0][:40]}' is unexpected", field=name)


def _kind(kind: Any) -> str:
    return str(kind) if isinstance(kind, pl.DataType) else str(kind.__name__)


def _fault_of(values: pl.Series, schema: Schema) -> str | None:
    """Return what is wrong in a column: a null that it may not have, NaN, or a value outside its ``ALLOWED`` range.

    Columns without a range, and columns that are not numbers, are only checked for null. The message has the first row,
    from 0; None: nothing is wrong.
    """
    column = values.name
    if values.null_count() and column not in schema.nullable:
        return f"column '{column}' lacks a value in row {values.is_null().arg_max()}"
    if column not in ALLOWED or not values.dtype.is_numeric():
        return None
    low, high = ALLOWED[column]
    # A study checks thousands of small tables, and queries take a hundred times as long as these three.
    ends: tuple[Any, Any] = values.min(), values.max()  # None if all values are null
    # Of the three only the sum shows a NaN.
    if ends[0] is None or (low <= ends[0] and ends[1] <= high and not math.isnan(values.sum())):
        return None
    wrong = (~values.is_between(low, high)).fill_null(False)  # a NaN is above all numbers
    rows = wrong.arg_true()
    if rows.is_empty():  # the sum was infinite less infinite
        return None
    range_ = f"from {stated(low)} to {stated(high)}"
    return f"column '{column}' holds {values[rows[0]]} in row {rows[0]}; it has to be {range_}"


_FORMULA: Final = r"^'*[=+\-@\t\r]"
"""Texts that get an apostrophe: formulas, and formulas with apostrophes before them. Without one more apostrophe,
``unescaped`` would take one that belongs to the text for the mark, and remove it."""
_NUMBER: Final = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
"""Texts that are numbers."""
_MARK: Final = "'"
"""The apostrophe, by which spreadsheets mark a text."""


def csv_bytes(frame: pl.DataFrame) -> bytes:
    """Return a frame as CSV in UTF-8, with texts and column names as ``escaped`` returns them, and lists as text."""
    # polars holds valid UTF-8 only, so that "replace" has nothing to replace.
    return escaped(_without_nested_columns(frame)).write_csv().encode("utf-8", "replace")


def _without_nested_columns(frame: pl.DataFrame) -> pl.DataFrame:
    nested = [name for name, kind in frame.schema.items() if kind.is_nested()]
    return frame.with_columns(
        pl.Series(name, [None if value is None else str(value) for value in frame[name].to_list()])
        for name in nested
    )


def escaped(frame: pl.DataFrame) -> pl.DataFrame:
    """Return the frame with an apostrophe before texts and column names that a spreadsheet would take for formulas.

    Texts that are numbers stay as they are, and so does a single "-", which is no formula. A column name is judged by
    its first character alone. Columns of an ``Enum`` or a ``Categorical`` become text columns.
    """
    columns = []
    for name, kind in frame.schema.items():
        if kind in (pl.String, pl.Categorical, pl.Enum):
            text = pl.col(name).cast(pl.String)
            formula = text.str.contains(_FORMULA) & ~text.str.contains(_NUMBER) & (text != "-")
            columns.append(pl.when(formula).then(pl.lit(_MARK) + text).otherwise(text).alias(name))
    escaped_names = {name: f"{_MARK}{name}" for name in frame.columns if name.startswith(tuple("=+-@\t\r"))}
    return frame.with_columns(columns).rename(escaped_names)


def unescaped(frame: pl.DataFrame) -> pl.DataFrame:
    """Return the frame with its texts as they were before ``escaped``.

    Column names that ``escaped`` changed keep their apostrophe, and its text columns stay text columns.
    """
    return frame.with_columns(
        pl.when(pl.col(name).str.contains(r"^'+[=+\-@\t\r]"))
        .then(pl.col(name).str.slice(1))  # without the first apostrophe
        .otherwise(name)  # the column of this name, unchanged
        .alias(name)
        for name, kind in frame.schema.items()
        if kind == pl.String
    )
