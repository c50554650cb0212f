"""Columns of whole numbers in which some are missing."""

from __future__ import annotations

import math

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from polars.testing import assert_series_equal

from vibroswarm.inference.agents import as_column


@pytest.mark.parametrize(
    ("kind", "least", "most"), [(pl.UInt8, 0, 255), (pl.UInt32, 0, 2**32 - 1), (pl.Int8, -128, 127)]
)
@given(st.data())
def test_missing_numbers_are_null_and_the_others_as_they_were(
    kind: type[pl.DataType], least: int, most: int, data: st.DataObject
) -> None:
    numbers = data.draw(st.lists(st.one_of(st.none(), st.integers(least, most)), max_size=20))
    values = np.array([math.nan if one is None else one for one in numbers], dtype=np.float64)
    assert_series_equal(as_column("of robots", values, kind), pl.Series("of robots", numbers, dtype=kind))


def test_floats_stay_floats_with_null_for_nan() -> None:
    column = as_column("belief", np.array([0.5, math.nan]), pl.Float64)
    assert column.to_list() == [0.5, None]
