from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.floors.source import random_tiles


@settings(deadline=None, max_examples=60)
@given(
    st.integers(1, 12), st.integers(1, 12), st.data(), st.integers(0, 2**63 - 1), st.integers(0, 2**32 - 1)
)
def test_the_fill_ratio_is_exact_and_the_floor_repeats(rows, columns, data, seed, run):
    ones = data.draw(st.integers(0, rows * columns))
    tiles = random_tiles(rows, columns, ones / (rows * columns), seed, run)
    assert tiles.shape == (rows, columns)
    assert tiles.dtype == np.uint8
    assert int(tiles.sum()) == ones
    assert np.array_equal(tiles, random_tiles(rows, columns, ones / (rows * columns), seed, run))


def test_every_tile_vibrates_equally_often():
    runs = 4000
    share = sum(random_tiles(5, 5, 0.48, 7, run).astype(int) for run in range(runs)) / runs
    # Standard error 0.0079; 25 tiles at 4 of them.
    assert np.abs(share - 0.48).max() < 4 * np.sqrt(0.48 * 0.52 / runs)
