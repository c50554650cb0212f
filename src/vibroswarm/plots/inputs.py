"""Checks of the frames that pictures draw."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

from vibroswarm.errors import InputError, check_kind, nearest
from vibroswarm.plots.style import SERIES_UP_TO


def check_frame(frame: object) -> None:
    """Refuse what is not a data frame of polars, such as one of pandas.

    Raises:
        InputError: as said.
    """
    check_kind(frame, pl.DataFrame, "frame", "a polars data frame")


def tidy(
    frame: pl.DataFrame,
    *,
    numbers: Sequence[str] = (),
    texts: Sequence[str] = (),
    other: Sequence[str] = (),
    optional_numbers: Sequence[str] = (),
    complete: Sequence[str] = (),
    once: Sequence[str] = (),
    bounds: Sequence[tuple[str, str, str]] = (),
) -> pl.DataFrame:
    """Check the columns of a frame, and convert numbers to Float64 (NaN becomes null) and texts to String.

    Columns of booleans, and of nulls alone, count as columns of numbers too. A missing text becomes "(no name)".

    Args:
        frame: one row per mark, or per run.
        numbers: required columns of numbers. texts: required columns that are converted to text.
        other: required columns of any type, which are not changed.
        optional_numbers: columns of numbers that are added, filled with nulls, if the frame does not have them.
        complete: columns among ``numbers`` that must not have missing values.
        once: columns in which no two rows may have the same values.
        bounds: columns of lower limits, estimates and upper limits that must be in this order.
    Returns:
        The frame with these columns, and with all its other columns unchanged.
    Raises:
        InputError: the frame is not one of polars, has no rows or lacks a column; or a column of numbers holds
            something else, an infinite number, or a missing number although it must be complete; or two rows have the
            same values; or an estimate is outside its limits.
    """
    check_frame(frame)
    for name in (*numbers, *texts, *other):
        if name not in frame.columns:
            have = ", ".join(frame.columns) or "none"
            raise InputError(
                f"the frame has no such column{nearest(name, frame.columns)}; it has: {have}", field=name
            )
    if frame.is_empty():
        raise InputError("the frame has no rows; there is nothing to draw")
    tidied = frame.with_columns(
        pl.lit(None, dtype=pl.Float64).alias(name) for name in optional_numbers if name not in frame.columns
    )
    number_columns = (*numbers, *optional_numbers)
    for name in number_columns:
        if not (tidied.schema[name].is_numeric() or tidied.schema[name] in (pl.Null, pl.Boolean)):
            raise InputError(f"holds {tidied.schema[name]}, not numbers", field=name)
    tidied = tidied.with_columns(
        *(pl.col(name).cast(pl.Float64).fill_nan(None) for name in number_columns),
        *(pl.col(name).cast(pl.String).fill_null("(no name)") for name in texts),
    )
    for name in number_columns:
        if tidied[name].is_infinite().any():
            raise InputError("holds an infinite number; leave null where there is no value", field=name)
    for name in complete:
        if tidied[name].has_nulls():
            raise InputError("holds a missing number where one is needed", field=name)
    if once:
        check_once(tidied, once)
    for interval in bounds:
        check_bounds(tidied, *interval)
    return tidied


def with_series(frame: pl.DataFrame) -> tuple[pl.DataFrame, list[str]]:
    """Return the frame with a text column ``series``, and the names of the series in order of appearance.

    A frame without the column gets one series with an empty name. A missing name becomes "(no name)".

    Raises:
        InputError: there are more series than markers, so that they could not be distinguished.
    """
    if "series" not in frame.columns:
        return frame.with_columns(series=pl.lit("")), [""]
    frame = frame.with_columns(pl.col("series").cast(pl.String).fill_null("(no name)"))
    names = frame["series"].unique(maintain_order=True).to_list()
    if len(names) > SERIES_UP_TO:
        raise InputError(
            f"{len(names)} series cannot be distinguished; at most {SERIES_UP_TO}: put some of them into cells",
            field="series",
        )
    return frame, names


def check_once(frame: pl.DataFrame, columns: Sequence[str]) -> None:
    """Check that no two rows have the same values in ``columns``: they would be drawn at the same place.

    Raises:
        InputError: there are such rows; the message has the values of the first.
    """
    repeated = frame.filter(pl.struct(*columns).is_duplicated())
    if repeated.height:
        # an empty name is not shown: ``with_series`` gives it if the frame has no column of series
        values = ", ".join(f"{name} {repeated[name][0]}" for name in columns if repeated[name][0] != "")
        raise InputError(f"two rows have {values}; each place holds one", field=columns[0])


def check_bounds(frame: pl.DataFrame, low: str, middle: str, high: str) -> None:
    """Check that each interval contains its estimate, except for rounding errors.

    Missing values are not checked.

    Args:
        frame: one row per interval. low, middle, high: names of the columns of lower limit, estimate and upper limit.
    Raises:
        InputError: an estimate is outside its interval.
    """
    slack = 1e-9 + 1e-9 * pl.col(middle).abs()
    outside = frame.filter((pl.col(low) > pl.col(middle) + slack) | (pl.col(high) < pl.col(middle) - slack))
    if outside.height:
        row = outside.row(0, named=True)
        raise InputError(f"{row[middle]} does not lie in [{row[low]}, {row[high]}]", field=middle)


def run_counts(frame: pl.DataFrame) -> list[int]:
    """Return the numbers of runs in the column ``runs`` of a tidy frame, for a caption; nulls are left out."""
    return [int(count) for count in frame["runs"].drop_nulls()]


def most(*columns: pl.Series) -> float:
    """Return the greatest number in some columns, or 0 if they have no numbers."""
    return float(max((value for column in columns for value in column.drop_nulls()), default=0.0))
