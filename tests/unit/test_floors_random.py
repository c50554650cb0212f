from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import TILE_LIMIT
from vibroswarm.floors.source import exact_ones, named_tiles, random_tiles


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


def test_runs_and_seeds_have_floors_of_their_own():
    floors = {random_tiles(10, 10, 0.48, seed, run).tobytes() for seed in range(20) for run in range(20)}
    assert len(floors) == 400


def test_every_tile_vibrates_equally_often():
    runs = 4000
    share = sum(random_tiles(5, 5, 0.48, 7, run).astype(int) for run in range(runs)) / runs
    # Standard error 0.0079; 25 tiles at 4 of them.
    assert np.abs(share - 0.48).max() < 4 * np.sqrt(0.48 * 0.52 / runs)


@pytest.mark.parametrize(
    ("rows", "columns", "fill_ratio", "ones"),
    [
        (5, 5, 0.48, 12),
        (3, 3, 0.333333, 3),
        (10, 10, 0.29, 29),
        (7, 1, 3 / 7, 3),
        (2000, 2000, 0.48, 1_920_000),
    ],
)
def test_rounding_of_the_fill_ratio_is_tolerated(rows, columns, fill_ratio, ones):
    assert exact_ones(rows, columns, fill_ratio) == ones


def test_a_fill_ratio_between_two_names_both_and_both_are_taken():
    with pytest.raises(InputError, match=r"0\.5 of 5 x 5 .* 0\.48 \(12 .* 0\.52 \(13") as caught:
        exact_ones(5, 5, 0.5)
    assert caught.value.field == "fill_ratio"
    assert exact_ones(5, 5, 0.52) == 13
    with pytest.raises(InputError, match=r"0\.428571429"):
        exact_ones(7, 1, 0.43)
    assert exact_ones(7, 1, 0.428571429) == 3


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ((5, 5, -0.1, 0, 0), "fill_ratio"),
        ((5, 5, float("nan"), 0, 0), "fill_ratio"),
        ((5, 5, 1.1, 0, 0), "fill_ratio"),
        ((0, 5, 0.5, 0, 0), "tiles"),
        ((TILE_LIMIT, 2, 0.5, 0, 0), "tiles"),
        ((5, 5, 0.48, -1, 0), "seed"),
        ((5, 5, 0.48, 2**63, 0), "seed"),
        ((5, 5, 0.48, 0, -1), "run"),
        ((5, 5, 0.48, 0, 2**32), "run"),
    ],
)
def test_what_cannot_be_is_refused(arguments, field):
    with pytest.raises(InputError) as caught:
        random_tiles(*arguments)
    assert caught.value.field == field


@pytest.mark.parametrize("source", ["random:0.5", "stripe:0.45,0.333,0.217"])
def test_a_share_that_a_floor_cannot_have_is_refused_with_the_floor(source):
    with pytest.raises(InputError, match=f"'{source}': .* the nearest that can be had") as caught:
        named_tiles(source, 5, 5, 1, 0)
    assert caught.value.field == "floor.source"
