from __future__ import annotations

import numpy as np
import pytest

from vibroswarm.floors.source import FAMILIES, NAMES, pattern

ONES = {
    "diagonal:0.48": 48,
    "diagonal:0.46": 46,
    "stripe:0.48": 48,
    "stripe:0.46": 46,
    "block-diagonal:0.48": 48,
    "block-diagonal:0.46": 46,
    "alternating:0.48": 48,
    "alternating:0.46": 46,
    "alternating:paper-0.46": 48,
    "random-fixed:0.48": 48,
    "random-fixed:0.46": 46,
}
BOARD = {(r, c) for r in range(10) for c in range(10) if (r + c) % 2 == 0}


def test_all_patterns_are_known():
    assert set(NAMES) == set(ONES)
    assert set(FAMILIES) == {"diagonal", "stripe", "block-diagonal", "alternating", "random-fixed"}


@pytest.mark.parametrize(("name", "ones"), ONES.items())
def test_the_number_of_vibrating_tiles(name, ones):
    tiles = pattern(name)
    assert tiles.shape == (10, 10)
    assert tiles.dtype == np.uint8
    assert int(tiles.sum()) == ones


def rows(name):
    return ["".join(map(str, row)) for row in pattern(name).tolist()]


def test_the_drawings():
    assert rows("diagonal:0.46")[0] == "1110000000"
    assert rows("diagonal:0.46")[9] == "0000000111"
    assert rows("diagonal:0.48")[3:6] == ["1111110000", "0011111000", "0001111100"]
    assert rows("stripe:0.48")[3:6] == ["1111111111", "0011111111", "0000000000"]
    assert rows("stripe:0.46")[4] == "0000111111"
    assert rows("block-diagonal:0.48")[5:] == [
        "1111110000",
        "0000001100",
        "0000001111",
        "0000000111",
        "0000000111",
    ]
    assert rows("block-diagonal:0.46")[6:8] == ["0000001000", "0000000111"]
    assert rows("random-fixed:0.48")[7] == "0101011111"
    assert rows("random-fixed:0.46")[7] == "0101010101"


@pytest.mark.parametrize(
    ("name", "lacks"),
    [
        ("alternating:0.48", {(0, 0), (9, 9)}),
        ("alternating:0.46", {(0, 0), (9, 9), (4, 4), (4, 6)}),
        ("alternating:paper-0.46", {(4, 4), (4, 6)}),
    ],
)
def test_alternating_is_a_checkerboard_less_some_tiles(name, lacks):
    assert set(zip(*np.nonzero(pattern(name)), strict=True)) == BOARD - lacks


def test_a_pattern_may_be_changed_without_changing_the_next():
    first = pattern("stripe:0.48")
    first[:] = 0
    assert int(pattern("stripe:0.48").sum()) == 48
