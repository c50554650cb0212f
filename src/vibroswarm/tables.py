"""The one door for tables from anywhere: columns, types, missing values, ranges and keys are checked before use.

What a column may hold depends on its name alone, and stands in ``ALLOWED``; a ``Schema`` adds the types of its columns,
which of them may be null, and by which its rows are told apart. What tables must be to each other and to the scenario
is in ``result_checks``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.plain_files import check_plain

MOST_BYTES: Final = 64 * 2**30
"""Of a table's file."""
FAR_M: Final = 1e5
LONG_S: Final = 1e7 + 1e5
"""A run lasts up to 1e7 s; a sample under way may end after it."""

_COUNT: Final = (0.0, float(2**32 - 1))
_SHARE: Final = (0.0, 1.0)
_TIME: Final = (0.0, LONG_S)
_PLACE: Final = (-FAR_M, FAR_M)
ALLOWED: Final[dict[str, tuple[float, float]]] = {
    **dict.fromkeys(("run", "robot", "cell", "sample", "line", "samples", "sent", "received"), _COUNT),
    **dict.fromkeys(("lost_before", "right", "wrong", "undecided"), _COUNT),
    **dict.fromkeys(("alpha", "beta"), (1.0, float(2**32 - 1))),
    **dict.fromkeys(("belief", "belief_at_decision", "belief_in_truth", "fill_ratio"), _SHARE),
    **dict.fromkeys(("message", "observation", "truth"), _SHARE),
    "decision": (-1.0, 1.0),
    "tile": (-1.0, 2.0**31 - 1),
    "energy": (-1e9, 1e12),
    **dict.fromkeys(("time_s", "stop_start_s", "start_s", "end_s", "consensus_time_s"), _TIME),
    **dict.fromkeys(("decision_time_s", "avoid_total_s", "stop_total_s"), _TIME),
    **dict.fromkeys(("drive_s", "turn_s", "avoid_s", "stop_s"), (-1e3, LONG_S)),
    "position_age_s": (-1e9, 1e9),
    **dict.fromkeys(("x_m", "y_m", "left_m", "bottom_m"), _PLACE),
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
    # Analysis gives it for two robots that always read alike, or never.
    "effective_samples": (0.0, float("inf")),
}
"""The least and the greatest value of a column of this name; words and times of day have none."""


@dataclass(frozen=True)
class Schema:
    """What a table must be.

    Args:
        columns: name to type. nullable: names of those that may lack a value. key: columns by which rows differ.
    """

    columns: Mapping[str, Any]
    nullable: frozenset[str] = frozenset()
    key: tuple[str, ...] = ()


def read_table(path: Path, schema: Schema, what: str) -> pl.DataFrame:
    """A table of a Parquet file, checked, its columns in order.

    Raises:
        InputError: no plain file or no Parquet, or what ``check_table`` finds.
    """
    return check_table(read_frame(path, what), schema, str(path), what)


def read_frame(path: Path, what: str) -> pl.DataFrame:
    """What is in a Parquet file, whatever its columns.

    Raises:
        InputError: it is no plain file, or no whole Parquet.
    """
    if not path.exists():
        raise InputError("is missing", field=str(path))
    check_plain(path, MOST_BYTES, f"the table '{what}'")
    try:
        return pl.read_parquet(path, glob=False)
    except (OSError, ValueError, OverflowError, pl.exceptions.PolarsError) as error:
        words = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"is damaged ({words[:120]})", field=str(path)) from None
    except pl.exceptions.PanicException as error:  # of polars, which is no Exception
        raise InputError(f"is damaged ({str(error)[:80]})", field=str(path)) from None


def check_table(frame: pl.DataFrame, schema: Schema, name: str, what: str) -> pl.DataFrame:
    """The frame with its columns in order, if it is what the schema says.

    Args:
        name: of the file, for errors. what: the name of the table.
    Raises:
        InputError: columns that are missing, too many or of other types; values that are missing, outside of what the
            column may hold, or not finite; rows that stand twice. Names the file and the column.
    """
    _check_columns(frame, schema, name, what)
    frame = frame.select(list(schema.columns))
    for column, kind in schema.columns.items():
        _check_values(frame[column], kind, column in schema.nullable, name)
    if schema.key and frame.select(schema.key).is_duplicated().any():
        twice = frame.filter(frame.select(schema.key).is_duplicated()).select(schema.key).row(0, named=True)
        words = ", ".join(f"{key} {value}" for key, value in twice.items())
        raise InputError(f"{words} stands twice in the table '{what}'", field=name)
    return frame


def _check_columns(frame: pl.DataFrame, schema: Schema, name: str, what: str) -> None:
    has_not = f"has not the columns of the table '{what}'"
    for column, kind in schema.columns.items():
        if column not in frame.columns:
            raise InputError(f"{has_not}: '{column}' is missing", field=name)
        if frame.schema[column] != kind:
            raise InputError(
                f"{has_not}: '{column}' is {frame.schema[column]}, where {_kind(kind)} is right", field=name
            )
    more = [column for column in frame.columns if column not in schema.columns]
    if more:
        raise InputError(f"{has_not}: '{more[0][:40]}' is one too many", field=name)


def _kind(kind: Any) -> str:
    return str(kind) if isinstance(kind, pl.DataType) else str(kind.__name__)


def _check_values(values: pl.Series, kind: Any, nullable: bool, name: str) -> None:
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
