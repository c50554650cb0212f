"""Columns of the frames that pictures draw."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

from vibroswarm.errors import InputError, check_kind, nearest


def tidy(
    frame: pl.DataFrame,
    *,
    numbers: Sequence[str] = (),
    texts: Sequence[str] = (),
    optional: Sequence[str] = (),
) -> pl.DataFrame:
    """Return a frame whose columns of numbers are Float64 (nan is null) and whose texts are texts."""
    check_kind(frame, pl.DataFrame, "frame", "a polars data frame")
    for name in (*numbers, *texts):
        if name not in frame.columns:
            raise InputError(f"the frame has no such column{nearest(name, frame.columns)}", field=name)
    if frame.is_empty():
        raise InputError("the frame has no rows; there is nothing to draw")
    new = [pl.lit(None, dtype=pl.Float64).alias(name) for name in optional if name not in frame.columns]
    return frame.with_columns(new).with_columns(
        *(pl.col(name).cast(pl.Float64).fill_nan(None) for name in (*numbers, *optional)),
        *(pl.col(name).cast(pl.String).fill_null("(no name)") for name in texts),
    )


def with_series(frame: pl.DataFrame) -> tuple[pl.DataFrame, list[str]]:
    """Return the frame with a text column ``series``, by default one empty name, and the names as they appear."""
    series = (
        pl.col("series").cast(pl.String).fill_null("(no name)") if "series" in frame.columns else pl.lit("")
    )
    frame = frame.with_columns(series=series)
    return frame, frame["series"].unique(maintain_order=True).to_list()


def run_counts(frame: pl.DataFrame) -> list[int]:
    """Return the numbers of runs in the column ``runs`` of a tidy frame, for a caption."""
    return [int(count) for count in frame["runs"].drop_nulls()]


def most(*columns: pl.Series) -> float:
    """Return the greatest number in some columns, or 0 if they have no numbers."""
    return float(max((value for column in columns for value in column.drop_nulls()), default=0.0))
