"""Tables of polars as data frames of pandas and data sets of xarray, which are optional dependencies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import polars as pl

from vibroswarm.core.optional_library import needed
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def pandas_of(frame: pl.DataFrame) -> pd.DataFrame:
    """Convert a table to pandas.

    Raises:
        InputError: pandas or pyarrow is not installed.
    """
    for library in ("pandas", "pyarrow"):  # the ``to_pandas`` of polars needs both
        needed(library, "frames", "to_pandas")
    return frame.to_pandas()


def dataset_of(table: pl.DataFrame, index: Sequence[str]) -> xr.Dataset:
    """Convert a table to an xarray Dataset.

    Args:
        index: the columns that become its dimensions, in order; empty: the only dimension is ``index``.
    Raises:
        InputError: several rows have the same place in the dimensions, or xarray, pandas or pyarrow is not installed.
    """
    xarray = needed("xarray", "frames", "to_xarray")
    frame = pandas_of(table)
    for name in frame.select_dtypes("category"):  # xarray has no categories
        frame[name] = frame[name].astype(str)
    indexed = frame.set_index(list(index)) if index else frame
    if not indexed.index.is_unique:
        raise InputError("several cells have the same varied values", field="to_xarray")
    dataset: xr.Dataset = xarray.Dataset.from_dataframe(indexed)
    return dataset
