"""Tables as CSV that a spreadsheet opens without running anything: texts that it would take for a formula are escaped.

A cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a carriage return is a formula to a spreadsheet, wherever
its text came from: a label, a file's name, a message. Such texts get an apostrophe before them, as spreadsheets write
it; numbers stay numbers, in columns of text too. ``unescaped`` gives back what was.
"""

from __future__ import annotations

from typing import Final

import polars as pl

_FORMULA: Final = r"^'*[=+\-@\t\r]"
_NUMBER: Final = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
_MARK: Final = "'"


def csv_bytes(frame: pl.DataFrame) -> bytes:
    """A frame as CSV in UTF-8, texts escaped; lists and other nested values must have become text before."""
    return escaped(frame).write_csv().encode("utf-8", "replace")


def escaped(frame: pl.DataFrame) -> pl.DataFrame:
    """The frame with its texts escaped, those of its head too; words of an ``Enum`` become texts."""
    columns = []
    for name, kind in frame.schema.items():
        if kind in (pl.String, pl.Categorical, pl.Enum):
            text = pl.col(name).cast(pl.String)
            formula = text.str.contains(_FORMULA) & ~text.str.contains(_NUMBER) & (text != "-")
            columns.append(pl.when(formula).then(pl.lit(_MARK) + text).otherwise(text).alias(name))
        else:
            columns.append(pl.col(name))
    head = {name: f"{_MARK}{name}" for name in frame.columns if name[:1] in "=+-@\t\r" and name}
    return frame.select(columns).rename(head)


def unescaped(frame: pl.DataFrame) -> pl.DataFrame:
    """The frame with its texts as they were before ``escaped``."""
    return frame.with_columns(
        pl.when(pl.col(name).str.contains(r"^'+[=+\-@\t\r]"))
        .then(pl.col(name).str.slice(1))
        .otherwise(name)
        .alias(name)
        for name, kind in frame.schema.items()
        if kind == pl.String
    )
