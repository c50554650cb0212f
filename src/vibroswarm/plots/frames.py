"""What a picture asks of a frame, and what it says when the frame has it not."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

from vibroswarm.errors import InputError, nearest
from vibroswarm.plots.palette import SERIES_UP_TO

SERIES = "series"


def tidy(
    frame: pl.DataFrame,
    *,
    numbers: Sequence[str] = (),
    texts: Sequence[str] = (),
    other: Sequence[str] = (),
    optional_numbers: Sequence[str] = (),
    complete: Sequence[str] = (),
) -> pl.DataFrame:
    """The frame with numbers as Float64 (NaN becomes null) and texts as String, checked.

    Args:
        frame: one row a mark, or a run.
        numbers: columns that must be there and hold numbers. texts: columns that must be there.
        other: columns that must be there, of any type.
        optional_numbers: columns made of nulls where they are missing.
        complete: those of ``numbers`` in which nothing may be missing.

    Raises:
        InputError: no rows, a column missing or of the wrong kind, an infinite or a missing number.
    """
    for name in (*numbers, *texts, *other):
        if name not in frame.columns:
            have = ", ".join(frame.columns) or "none"
            raise InputError(
                f"the frame has no such column{nearest(name, frame.columns)}; it has: {have}", field=name
            )
    if frame.is_empty():
        raise InputError("the frame has no rows; there is nothing to draw")
    made = frame.with_columns(
        pl.lit(None, dtype=pl.Float64).alias(name) for name in optional_numbers if name not in frame.columns
    )
    wanted = (*numbers, *optional_numbers)
    for name in wanted:
        if not (made.schema[name].is_numeric() or made.schema[name] in (pl.Null, pl.Boolean)):
            raise InputError(f"holds {made.schema[name]}, not numbers", field=name)
    made = made.with_columns(
        *(pl.col(name).cast(pl.Float64).fill_nan(None) for name in wanted),
        *(pl.col(name).cast(pl.String).fill_null("(no name)") for name in texts),
    )
    for name in wanted:
        if made[name].is_infinite().any():
            raise InputError("holds an infinite number; leave null where there is no value", field=name)
    for name in complete:
        if made[name].has_nulls():
            raise InputError("holds a missing number where one is needed", field=name)
    return made


def with_series(frame: pl.DataFrame) -> tuple[pl.DataFrame, list[str]]:
    """The frame with a text column ``series``, and the names of the series in the order of their coming.

    Raises:
        InputError: more series than there are marks to tell them apart.
    """
    if SERIES not in frame.columns:
        return frame.with_columns(pl.lit("").alias(SERIES)), [""]
    frame = frame.with_columns(pl.col(SERIES).cast(pl.String).fill_null("(no name)"))
    names = frame[SERIES].unique(maintain_order=True).to_list()
    if len(names) > SERIES_UP_TO:
        raise InputError(
            f"{len(names)} series cannot be told apart; at most {SERIES_UP_TO}: put some of them into cells",
            field=SERIES,
        )
    return frame, names


def check_once(frame: pl.DataFrame, columns: Sequence[str]) -> None:
    """Refuse a frame in which two rows would be drawn at the same place.

    Raises:
        InputError: two rows are alike in ``columns``.
    """
    twice = frame.filter(pl.struct(*columns).is_duplicated())
    if twice.height:
        at = ", ".join(f"{name} {twice[name][0]}" for name in columns if twice[name][0] != "")
        raise InputError(f"two rows have {at}; each place holds one", field=columns[0])


def check_bounds(frame: pl.DataFrame, low: str, middle: str, high: str) -> None:
    """Refuse intervals that do not hold their estimate (a rounding error's breadth is let pass).

    Raises:
        InputError: an interval ends before its estimate or begins behind it.
    """
    slack = 1e-9 + 1e-9 * pl.col(middle).abs()
    amiss = frame.filter((pl.col(low) > pl.col(middle) + slack) | (pl.col(high) < pl.col(middle) - slack))
    if amiss.height:
        row = amiss.row(0, named=True)
        raise InputError(f"{row[middle]} does not lie in [{row[low]}, {row[high]}]", field=middle)


def run_counts(frame: pl.DataFrame, column: str = "runs") -> list[int]:
    """The numbers of runs that the frame tells, if it does."""
    if column not in frame.columns:
        return []
    return [int(count) for count in frame[column].drop_nulls().to_list()]


def most(*columns: pl.Series, otherwise: float = 0.0) -> float:
    """The greatest number in some columns; ``otherwise`` where there is none."""
    values = [value for column in columns for value in column.drop_nulls().to_list()]
    return float(max(values)) if values else otherwise
