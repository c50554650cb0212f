"""Cells of a CSV file as numbers, with the row named where one is wrong."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.errors import InputError, nearest
from vibroswarm.plain_files import read_bytes

LARGEST_BYTES: Final = 64 * 2**20
"""Of a log; read, it takes some 25 times as much memory. An hour of ten robots has 10 MB."""

_ALLOWED: Final[dict[str, tuple[float, float, str]]] = {
    "robot": (0, 2**31, "a whole number from 0 on"),
    "energy": (0.0, 1e9, "a number of 0 or more"),
    "x_m": (-1e4, 1e4, "a length in metres"),
    "y_m": (-1e4, 1e4, "a length in metres"),
    "time_s": (0.0, 1e9, "a time in seconds from 0 on"),
    "belief": (0.0, 1.0, "a probability"),
    "observation": (0, 1, "0 or 1"),
    "message": (0, 1, "0 or 1"),
    "decision": (-1, 1, "-1, 0 or 1"),
    "alpha": (1, 2**31, "a whole number from 1 on"),
    "beta": (1, 2**31, "a whole number from 1 on"),
    "sent": (0, 2**31, "a whole number from 0 on"),
    "received": (0, 2**31, "a whole number from 0 on"),
    "avoid_total_s": (0.0, 1e9, "a time from 0 on"),
    "stop_total_s": (0.0, 1e9, "a time from 0 on"),
}


def text_of(path: Path) -> str:
    """The text of a log.

    Raises:
        InputError: it is no plain file, larger than ``LARGEST_BYTES``, or no text.
    """
    name = str(path)
    text = read_bytes(path, LARGEST_BYTES, "a log of one session").decode("utf-8-sig", errors="replace")
    if "\0" in text[:4096]:
        raise InputError("is a binary file; give a log in text", field=name)
    if not text.strip():
        raise InputError("is empty", field=name)
    return text


def table_of(text: str, name: str) -> pl.DataFrame:
    """A CSV text with a head line as columns of strings, and ``line``.

    Raises:
        InputError: a row has another number of cells than the first.
    """
    lines = text.splitlines()
    try:
        head = next(csv.reader(lines[:1]))
        rows = list(csv.reader(lines[1:]))
    except (csv.Error, StopIteration) as error:
        raise InputError(f"is no CSV file: {error}", field=name) from None
    head = [cell.strip() for cell in head]
    kept = [(number, row) for number, row in enumerate(rows, start=2) if row]
    for number, row in kept:
        if len(row) != len(head):
            raise InputError(
                f"{len(row)} cells where the first line has {len(head)}", field=f"{name}, row {number}"
            )
    columns = list(zip(*(row for _, row in kept), strict=True)) or [()] * len(head)
    named = {f"{place}": list(cells) for place, cells in enumerate(columns)}
    frame = pl.DataFrame(
        {"line": [number for number, _ in kept], **named},
        schema={"line": pl.UInt32, **dict.fromkeys(named, pl.String)},
    )
    unique = {
        cell if head.index(cell) == place else f"{cell} ({place + 1})" for place, cell in enumerate(head)
    }
    assert len(unique) == len(head)
    return frame.rename(
        {
            f"{place}": cell if head.index(cell) == place else f"{cell} ({place + 1})"
            for place, cell in enumerate(head)
        }
    )


def check_columns(wanted: Mapping[str, str], there: list[str], name: str) -> None:
    """Refuse a file that lacks a column; ``wanted``: what for, to the column's name."""
    missing = [(use, column) for use, column in wanted.items() if column not in there]
    if missing:
        use, column = missing[0]
        others = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        raise InputError(
            f"has no column '{column}'{nearest(column, there)}, from which {use} would be read{others}; it has "
            f"{', '.join(repr(one) for one in there[:20])}",
            field=name,
        )


def numbers_of(
    cells: pl.Series, lines: pl.Series, name: str, column: str, missing: tuple[str, ...]
) -> pl.Series:
    """The numbers in a column of text, null where a cell is one of ``missing``.

    Raises:
        InputError: a cell is neither a finite number nor missing; its row is named.
    """
    stripped = cells.str.strip_chars()
    empty = stripped.is_in(list(missing))
    found = stripped.cast(pl.Float64, strict=False)
    wrong = ~empty & ~found.is_finite().fill_null(False)
    if wrong.any():
        k = int(wrong.arg_true()[0])
        raise InputError(
            f"'{str(cells[k])[:40]}' in column '{column}' is no number", field=f"{name}, row {lines[k]}"
        )
    return pl.select(pl.when(~empty).then(found)).to_series()


def check_values(values: pl.Series, lines: pl.Series, name: str, use: str, column: str) -> None:
    """Refuse numbers that this use of a column cannot have; the row is named."""
    if use not in _ALLOWED:
        return
    low, high, words = _ALLOWED[use]
    whole = isinstance(low, int)
    numbers = values.to_numpy()
    with np.errstate(invalid="ignore"):
        wrong = (numbers < low) | (numbers > high)
        if whole:
            wrong |= numbers != np.rint(numbers)
    wrong &= ~np.isnan(numbers)
    if wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"{numbers[k]:g} in column '{column}' is wrong; {words}", field=f"{name}, row {lines[k]}"
        )


def plain_number(value: Any, what: str, name: str) -> float:
    """A number of a TOML file."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise InputError(f"{value!r} is no number", field=f"{name}, {what}")
    return float(value)
