"""Parquet files of tables, and CSV that is safe to open in a spreadsheet.

A spreadsheet takes a cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a carriage return for a formula and
runs it, although the text may come from a stranger: a label, a file name, a message. ``escaped`` puts an apostrophe
before such texts, by which spreadsheets mark a text. Texts that are numbers ("-1.5") stay as they are.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.untrusted_files import check_plain
from vibroswarm.errors import InputError

MAX_BYTES: Final = 64 * 2**30
"""Size limit of a table's file."""


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


_FORMULA: Final = r"^'*[=+\-@\t\r]"
"""Texts that get an apostrophe: formulas, and formulas with apostrophes before them."""
_NUMBER: Final = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
"""Texts that are numbers."""


def csv_bytes(frame: pl.DataFrame) -> bytes:
    """Return a frame as CSV in UTF-8, with texts and column names as ``escaped`` returns them, and lists as text."""
    plain = frame.with_columns(
        pl.Series(name, [None if value is None else str(value) for value in frame[name].to_list()])
        for name, kind in frame.schema.items()
        if kind.is_nested()
    )
    # polars holds valid UTF-8 only, so that "replace" has nothing to replace.
    return escaped(plain).write_csv().encode("utf-8", "replace")


def escaped(frame: pl.DataFrame) -> pl.DataFrame:
    """Return the frame with an apostrophe before texts and column names that a spreadsheet would take for formulas."""
    columns = []
    for name, kind in frame.schema.items():
        if kind in (pl.String, pl.Categorical, pl.Enum):
            text = pl.col(name).cast(pl.String)
            formula = text.str.contains(_FORMULA) & ~text.str.contains(_NUMBER) & (text != "-")
            columns.append(pl.when(formula).then(pl.lit("'") + text).otherwise(text).alias(name))
    return frame.with_columns(columns)
