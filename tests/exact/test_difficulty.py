"""The measures of difficulty against brute force, closed forms, and the paper's table."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from vibroswarm.floors.difficulty import (
    cluster_sizes,
    entropy,
    measure,
    moran_index,
)
from vibroswarm.paper.items.difficulty import paper_table

grids = hnp.arrays(
    np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=7), elements=st.integers(0, 1)
)


def neighbours(row, column, shape):
    steps = ((0, 1), (0, -1), (1, 0), (-1, 0))
    near = ((row + down, column + right) for down, right in steps)
    return [(r, c) for r, c in near if 0 <= r < shape[0] and 0 <= c < shape[1]]


def brute_moran(tiles):
    """The paper's equation, as printed: a sum over all ordered pairs of tiles."""
    fill = tiles.mean()
    weights = pairs = squares = 0.0
    for i in np.ndindex(tiles.shape):
        squares += (tiles[i] - fill) ** 2
        for j in np.ndindex(tiles.shape):
            if j in neighbours(*i, tiles.shape):
                weights += 1
                pairs += (tiles[i] - fill) * (tiles[j] - fill)
    return tiles.size / weights * pairs / squares


def brute_clusters(tiles):
    """Sizes by flood fill."""
    left = set(zip(*np.nonzero(tiles), strict=True))
    sizes = []
    while left:
        edge = [left.pop()]
        size = 0
        while edge:
            here = edge.pop()
            size += 1
            for near in neighbours(*here, tiles.shape):
                if near in left:
                    left.remove(near)
                    edge.append(near)
        sizes.append(size)
    return sorted(sizes, reverse=True)


def brute_entropy(tiles, ones):
    most = -sum(1 / ones * math.log2(1 / ones) for _ in range(ones))
    found = -sum(size / ones * math.log2(size / ones) for size in brute_clusters(tiles))
    return (most - found) / most


@settings(deadline=None, max_examples=80)
@given(grids)
def test_moran_index_is_the_papers_double_sum(tiles):
    if tiles.min() == tiles.max():
        assert math.isnan(moran_index(tiles))
    else:
        assert moran_index(tiles) == pytest.approx(brute_moran(tiles), abs=1e-12)


@settings(deadline=None, max_examples=80)
@given(grids)
def test_clusters_and_entropy_are_those_of_a_flood_fill(tiles):
    assert cluster_sizes(tiles).tolist() == brute_clusters(tiles)
    ones = int(tiles.sum())
    if ones < 2:
        assert math.isnan(entropy(tiles))
    else:
        assert entropy(tiles) == pytest.approx(brute_entropy(tiles, ones), abs=1e-12)
        assert entropy(tiles, 48) == pytest.approx(brute_entropy(tiles, 48), abs=1e-12)


def test_the_papers_table_comes_out_to_its_two_digits_in_the_papers_way():
    table = list(paper_table())
    assert len(table) == 20
    for entry in table:
        assert entry.printed == pytest.approx(entry.as_the_paper, abs=0.005), entry


def test_the_entries_that_the_paper_gets_wrong_and_their_right_values():
    wrong = {(e.pattern, e.measure): (e.printed, round(e.right, 2)) for e in paper_table() if e.wrong}
    assert wrong == {
        ("diagonal:0.46", "entropy"): (0.99, 1.00),
        ("stripe:0.46", "entropy"): (0.99, 1.00),
        ("random-fixed:0.46", "entropy"): (0.46, 0.44),
        ("alternating:0.46", "Moran index"): (-0.91, -0.88),
    }


def test_values_have_a_moran_index_of_their_own() -> None:
    values = np.tile(np.linspace(0.0, 1.0, 12), (12, 1))
    found = measure(values)
    assert found.fill_ratio == pytest.approx(0.5)
    assert found.moran_index > 0.8
    shuffled = np.random.default_rng(1).permutation(values.ravel()).reshape(12, 12)
    assert abs(measure(shuffled).moran_index) < 0.2
    assert np.isnan(measure(np.full((12, 12), 0.4)).moran_index)
