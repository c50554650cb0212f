"""Checks of tables from any source, and CSV that is safe to open in a spreadsheet.

The allowed range of a column depends on its name alone and is given in ``ALLOWED``; a ``Schema`` adds the types
of the columns, which may be null, and the key. Relations between tables and to the scenario are checked in
``result_validation``.

Spreadsheets take a cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a carriage return for a formula,
wherever its text came from: a label, a file name, a message. Such texts get a leading apostrophe, as spreadsheets
write it; numbers stay numbers, in text columns too. ``unescaped`` restores the original.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.untrusted_files import check_plain
from vibroswarm.errors import InputError

MAX_BYTES: Final = 64 * 2**30
"""Size limit of a table's file."""
FAR_M: Final = 1e5
LONG_S: Final = 1e7 + 1e5
"""A run lasts up to 1e7 s; a sample under way may end after it."""

_COUNT: Final = (0.0, float(2**32 - 1))
_SHARE: Final = (0.0, 1.0)
_TIME: Final = (0.0, LONG_S)
_PLACE: Final = (-FAR_M, FAR_M)
ALLOWED: Final[dict[str, tuple[float, float]]] = {
    **dict.fromkeys(
        ("run", "robot", "cell", "sample", "line", "samples", "sent", "messages_received"), _COUNT
    ),
    **dict.fromkeys(("lost_before", "right", "wrong", "undecided"), _COUNT),
    **dict.fromkeys(("alpha", "beta"), (1.0, float(2**32 - 1))),
    **dict.fromkeys(("belief_below", "belief_at_decision", "belief_in_truth", "fill_ratio"), _SHARE),
    **dict.fromkeys(("message", "observation", "truth"), _SHARE),
    "decision": (-1.0, 1.0),
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
    "effective_samples": (0.0, float("inf")),
}
"""Least and greatest value of a column of this name; words and times of day have none."""


@dataclass(frozen=True)
class Schema:
    """Columns, types and keys of a table.

    Args:
        columns: name to type. nullable: columns that may be null. key: columns that identify a row.
    """

    columns: Mapping[str, Any]
    nullable: frozenset[str] = frozenset()
    key: tuple[str, ...] = ()


def read_table(path: Path, schema: Schema, what: str) -> pl.DataFrame:
    """Read a table from a Parquet file and check it; columns in schema order.

    Raises:
        InputError: not a regular Parquet file, or see ``check_table``.
    """
    return check_table(read_frame(path, what), schema, str(path), what)


def read_frame(path: Path, what: str) -> pl.DataFrame:
    """Read a Parquet file, whatever its columns.

    Raises:
        InputError: it is missing, larger than MAX_BYTES, or not a complete Parquet file.
    """
    if not path.exists():
        raise InputError("is missing", field=str(path))
    check_plain(path, MAX_BYTES, f"the table '{what}'")
    try:
        return pl.read_parquet(path, glob=False)
    except (OSError, ValueError, OverflowError, pl.exceptions.PolarsError) as error:
        words = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"is damaged ({words[:120]})", field=str(path)) from None
    except pl.exceptions.PanicException as error:  # of polars; not an Exception
        raise InputError(f"is damaged ({str(error)[:80]})", field=str(path)) from None


def check_table(frame: pl.DataFrame, schema: Schema, name: str, what: str) -> pl.DataFrame:
    """Return the frame with its columns in schema order, if it conforms to the schema.

    Args:
        name: name of the file, for errors. what: name of the table, for errors.
    Raises:
        InputError: missing, unexpected or wrongly typed columns; values that are missing, out of range or not finite;
            duplicate rows. Names the file and the column.
    """
    _check_columns(frame, schema, name, what)
    frame = frame.select(list(schema.columns))
    for column, kind in schema.columns.items():
        _check_values(frame[column], kind, column in schema.nullable, name)
    if schema.key and frame.select(schema.key).is_duplicated().any():
        twice = frame.filter(frame.select(schema.key).is_duplicated()).select(schema.key).row(0, named=True)
        words = ", ".join(f"{key} {value}" for key, value in twice.items())
        raise InputError(f"{words} appears twice in the table '{what}'", field=name)
    return frame


def _check_columns(frame: pl.DataFrame, schema: Schema, name: str, what: str) -> None:
    """Refuse missing, unexpected and wrongly typed columns."""
    has_not = f"does not have the columns of the table '{what}'"
    for column, kind in schema.columns.items():
        if column not in frame.columns:
            raise InputError(f"{has_not}: '{column}' is missing", field=name)
        if frame.schema[column] != kind:
            raise InputError(
                f"{has_not}: '{column}' is {frame.schema[column]}, expected {_kind(kind)}", field=name
            )
    more = [column for column in frame.columns if column not in schema.columns]
    if more:
        raise InputError(f"{has_not}: '{more[0][:40]}' is unexpected", field=name)


def _kind(kind: Any) -> str:
    return str(kind) if isinstance(kind, pl.DataType) else str(kind.__name__)


def _check_values(values: pl.Series, kind: Any, nullable: bool, name: str) -> None:
    """Refuse missing values and values outside the range of the column."""
    column = values.name
    if not nullable and values.null_count():
        raise InputError(f"column '{column}' lacks a value in row {_first(values.is_null())}", field=name)
    if column not in ALLOWED or not values.dtype.is_numeric():
        return
    low, high = ALLOWED[column]
    wrong = (values < low) | (values > high)
    if values.dtype.is_float():
        wrong |= values.is_nan()
    wrong = wrong.fill_null(False)
    if wrong.any():
        row = _first(wrong)
        raise InputError(
            f"column '{column}' holds {values[row]} in row {row}; it has to be from {low:g} to {high:g}",
            field=name,
        )


def _first(where: pl.Series) -> int:
    return int(where.arg_true()[0])


_FORMULA: Final = r"^'*[=+\-@\t\r]"
_NUMBER: Final = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
_MARK: Final = "'"


def csv_bytes(frame: pl.DataFrame) -> bytes:
    """Return a frame as CSV in UTF-8, texts escaped; nested values must have become text before."""
    return escaped(frame).write_csv().encode("utf-8", "replace")


def escaped(frame: pl.DataFrame) -> pl.DataFrame:
    """Return the frame with its texts and column names escaped; words of an ``Enum`` become texts."""
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
    """Return the frame with its texts as they were before ``escaped``."""
    return frame.with_columns(
        pl.when(pl.col(name).str.contains(r"^'+[=+\-@\t\r]"))
        .then(pl.col(name).str.slice(1))
        .otherwise(name)
        .alias(name)
        for name, kind in frame.schema.items()
        if kind == pl.String
    )
