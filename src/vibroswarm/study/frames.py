"""Convert tables of a study to pandas and xarray, which are optional."""

from __future__ import annotations

from typing import TYPE_CHECKING

import polars as pl

from vibroswarm.errors import InputError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from vibroswarm.study.study_result import StudyResult


def pandas_of(frame: pl.DataFrame) -> pd.DataFrame:
    """Convert a table to pandas.

    Raises:
        InputError: pandas or pyarrow is not installed.
    """
    try:
        import pandas  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise _missing(error, "to_pandas") from None
    return frame.to_pandas()


def dataset_of(result: StudyResult, table: str) -> xr.Dataset:
    """Convert a table of a study to an xarray Dataset, see ``StudyResult.to_xarray``.

    Raises:
        InputError: the cells form no grid of the varied fields, or xarray is not installed.
    """
    try:
        import xarray
    except ImportError as error:
        raise _missing(error, "to_xarray") from None
    index = [
        *result.study.varied,
        *(["run"] if table in ("runs", "robots") else []),
        *(["robot"] if table == "robots" else []),
    ]
    frame = result.to_pandas(table).drop(columns="cell")
    for name in frame.select_dtypes("category"):
        frame[name] = frame[name].astype(str)
    indexed = frame.set_index(index) if index else frame
    if not indexed.index.is_unique:
        raise InputError("several cells have the same varied values", field="to_xarray")
    return xarray.Dataset.from_dataframe(indexed)


def _missing(error: ImportError, field: str) -> InputError:
    """Return the error that names the package that is missing, and the extra that has it."""
    return InputError(f"needs {error.name}: pip install 'vibroswarm[frames]'", field=field)
