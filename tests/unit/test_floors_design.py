from __future__ import annotations

import itertools

import numpy as np
import pytest

from vibroswarm.errors import InputError
from vibroswarm.floors.design import TOLERANCE, constructions, make_floor
from vibroswarm.floors.difficulty import measure


@pytest.mark.parametrize(("rows", "columns", "ones"), [(5, 5, 12), (7, 4, 3), (20, 20, 192), (1, 9, 4)])
def test_regular_floors_have_the_number_of_tiles_asked_for(rows, columns, ones):
    floors = list(constructions(rows, columns, ones))
    assert all(floor.shape == (rows, columns) and int(floor.sum()) == ones for floor in floors)
    if rows == 20:
        found = [measure(floor) for floor in floors]
        assert max(f.moran_index for f in found) > 0.93
        assert min(f.moran_index for f in found) < -0.93
        assert any(f.clusters == 1 and f.moran_index < 0.15 for f in found)  # the comb


@pytest.mark.parametrize(("rows", "columns", "ones"), [(4, 4, 4), (3, 4, 6), (2, 7, 4)])
def test_on_small_floors_all_that_can_be_had_is_found(rows, columns, ones):
    """Every floor of this size is looked at: what some of them are must be made, and nothing else is claimed."""
    can = set()
    for cells in itertools.combinations(range(rows * columns), ones):
        tiles = np.zeros(rows * columns, dtype=np.uint8)
        tiles[list(cells)] = 1
        found = measure(tiles.reshape(rows, columns))
        can.add((round(found.moran_index, 9), round(found.entropy, 9)))
    there = np.array(sorted(can))
    fill = ones / (rows * columns)
    for moran, wanted in there[:: max(1, len(there) // 12)]:
        made = make_floor(rows, columns, fill, moran, wanted)
        assert made.reached, (moran, wanted)
    for moran, wanted in itertools.product((-0.9, 0.0, 0.3), (0.0, 0.6, 1.0)):
        nearest = np.abs(there - (moran, wanted)).max(axis=1).min()
        made = make_floor(rows, columns, fill, moran, wanted)
        assert made.reached == (nearest <= TOLERANCE), (moran, wanted)


def test_of_what_cannot_be_had_the_nearest_is_made():
    made = make_floor(20, 20, 0.48, 0.5, 0.2)
    assert not made.reached
    assert 0.35 < made.difficulty.moran_index < 0.5
    assert 0.2 < made.difficulty.entropy < 0.42


def test_the_moran_index_alone_may_be_out_of_reach():
    made = make_floor(5, 5, 0.48, 0.95)
    assert not made.reached
    assert made.difficulty.moran_index == pytest.approx(0.69872, abs=1e-5)  # the highest of all 5,200,300


def test_the_same_seed_makes_the_same_floor_and_another_another():
    first, again, other = (make_floor(12, 17, 0.45, 0.4, 0.7, seed) for seed in (5, 5, 6))
    assert np.array_equal(first.tiles, again.tiles)
    assert other.reached
    assert not np.array_equal(first.tiles, other.tiles)


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ((20, 20, 0.0025, 0.0, 0.5), "fill_ratio"),
        ((20, 20, 0.0005, 0.5), "fill_ratio"),
        ((0, 20, 0.5, 0.5), "fill_ratio"),
        ((101, 100, 0.5, 0.5), "fill_ratio"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, field):
    with pytest.raises(InputError) as caught:
        make_floor(*arguments)
    assert caught.value.field == field
