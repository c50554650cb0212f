"""Checks of tables from any source, and CSV that is safe to open in a spreadsheet.

A spreadsheet takes a cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a carriage return for a formula and
runs it, although the text may come from a stranger: a label, a file name, a message. ``escaped`` puts an apostrophe
before such texts, by which spreadsheets mark a text. Texts that are numbers ("-1.5") stay as they are.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.untrusted_files import check_plain
from vibroswarm.errors import InputError

MAX_BYTES: Final = 64 * 2**30
"""Size limit of a table's file."""


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


def read_table(path: Path, schema: Schema, what: str) -> pl.DataFrame:
    """Read a table from a Parquet file and check it; return it with its columns in the order of the schema."""
    return check_table(read_frame(path, what), schema, str(path), what)


def read_frame(path: Path, what: str) -> pl.DataFrame:
    """Read a Parquet file, whatever its columns."""
    check_plain(path, MAX_BYTES, f"the table '{what}'")
    try:
        return pl.read_parquet(path, glob=False)  # a * in the path is part of the file's name, not a pattern
    except (OSError, pl.exceptions.PolarsError):
        raise InputError("is damaged: not a complete Parquet file", field=str(path)) from None


def parquet_bytes(frame: pl.DataFrame, metadata: dict[str, str] | None = None) -> bytes:
    """Return a table as a Parquet file, with ``metadata`` (texts by name) as the file's own metadata."""
    stream = io.BytesIO()
    frame.write_parquet(stream, compression="zstd", metadata=metadata)
    return stream.getvalue()


def check_table(frame: pl.DataFrame, schema: Schema, name: str, what: str) -> pl.DataFrame:
    """Check that a frame conforms to a schema; return it with its columns in the order of the schema."""
    found = frame.schema
    for column, kind in schema.columns.items():
        if found.get(column) != kind:
            is_there = found.get(column, "missing")
            raise InputError(f"column '{column}' of the table '{what}' is {is_there}, not {kind}", field=name)
        values = frame[column]
        has_gaps = values.null_count() > 0 or (values.dtype.is_float() and values.is_nan().any())
        if has_gaps and column not in schema.nullable:
            raise InputError(f"column '{column}' of the table '{what}' lacks a value", field=name)
    others = [column for column in found if column not in schema.columns]
    if any(found[column] != schema.further for column in others):
        raise InputError(f"the table '{what}' has no column '{others[0]}'", field=name)
    if schema.key and frame.select(schema.key).is_duplicated().any():
        raise InputError(f"the table '{what}' has two rows of one {', '.join(schema.key)}", field=name)
    return frame.select([*schema.columns, *others])


_FORMULA: Final = r"^'*[=+\-@\t\r]"
"""Texts that get an apostrophe: formulas, and formulas with apostrophes before them."""
_NUMBER: Final = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
"""Texts that are numbers."""


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
    """Return the frame with an apostrophe before texts and column names that a spreadsheet would take for formulas."""
    columns = []
    for name, kind in frame.schema.items():
        if kind in (pl.String, pl.Categorical, pl.Enum):
            text = pl.col(name).cast(pl.String)
            formula = text.str.contains(_FORMULA) & ~text.str.contains(_NUMBER) & (text != "-")
            columns.append(pl.when(formula).then(pl.lit("'") + text).otherwise(text).alias(name))
    return frame.with_columns(columns)
