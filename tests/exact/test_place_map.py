"""The map of places against enumeration: all floors, and edges that are felt beyond themselves."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import expit, logit
from scipy.stats import norm

from vibroswarm.strategies import place_map
from vibroswarm.strategies.base import arrays_of
from vibroswarm.strategies.place_map import add_reading, score, share_place
from vibroswarm.strategies.places import Arrays

SIDE, TILE_M = 2, 0.2
TILES = SIDE * SIDE
FALSE_POSITIVE, FALSE_NEGATIVE = 0.1, 0.2
FLOORS = np.array(list(product((0, 1), repeat=TILES)))


def world(robots: int) -> Any:
    return SimpleNamespace(
        robots=robots, rows=SIDE, columns=SIDE, left_m=0.0, bottom_m=0.0, tile_width_m=TILE_M, tile_height_m=TILE_M,
        false_positive=FALSE_POSITIVE, false_negative=FALSE_NEGATIVE, decision_boundary=0.5,
    )  # fmt: skip


def params(**values: Any) -> Any:
    return SimpleNamespace(**{"edge_reach_m": 0.0, "variance_factor": 1.0} | values)


def memory(robots: int) -> Any:
    sizes = {"robots": robots, "rows": SIDE, "columns": SIDE, "tiles": TILES}
    a = SimpleNamespace(**{name: np.zeros(array.size(sizes)) for name, array in arrays_of(Arrays).items()})
    a.weight[:] = 1.0
    return a


def add(a: Any, j: int, bit: int, x_m: float, y_m: float, spread_m: float, p: Any, w: Any) -> float:
    return add_reading(a, j, bit, *share_place(a, x_m, y_m, spread_m, spread_m, p, w), w)


reading = st.tuples(st.integers(0, 1), st.integers(0, TILES - 1), st.integers(0, 1))


@settings(max_examples=30, deadline=None)
@given(readings=st.lists(reading, min_size=1, max_size=40), v=st.sampled_from([1.0, 2.0]))
def test_tiles_are_weighed_as_all_floors_are(readings: list[tuple[int, int, int]], v: float) -> None:
    """Places known: probability of each tile, and mean and variance of their number, by enumeration."""
    p, w = params(variance_factor=v), world(2)
    a = memory(2)
    likelihood = np.ones(len(FLOORS))
    for sender, t, bit in readings:
        x_m, y_m = (t % SIDE + 0.5) * TILE_M, (SIDE - t // SIDE - 0.5) * TILE_M
        one = np.where(FLOORS[:, t] == 1, 1.0 - FALSE_NEGATIVE, FALSE_POSITIVE)
        likelihood *= one if bit == 1 else 1.0 - one
        add(a, sender, bit, x_m, y_m, 0.001, p, w)
    by_floor = likelihood / likelihood.sum()
    p_tile = by_floor @ FLOORS
    assert expit(a.odds.reshape(2, TILES).sum(axis=0)) == pytest.approx(p_tile, abs=1e-9)
    variance = v * (p_tile * (1.0 - p_tile)).sum()
    assert score(a, p, w) == pytest.approx((0.5 * TILES - p_tile.sum()) / np.sqrt(variance), rel=1e-5)


@pytest.mark.parametrize("reach_m", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("at", [(0.1, 0.1), (0.19, 0.32), (0.205, 0.205), (0.39, 0.22)])
@pytest.mark.parametrize("bit", [0, 1])
def test_one_reading_near_edges_weighs_every_floor(reach_m: float, at: tuple[float, float], bit: int) -> None:
    """Integrated over the place on a grid and summed over 16 floors; vibration is felt up to the reach, in x and y."""
    p, w, spread_m, j = params(edge_reach_m=reach_m), world(2), 0.02, 1
    a = memory(2)
    a.odds[:TILES] = [0.5, -1.0, 2.0, 0.3]  # of the other sender
    line = (np.arange(800) + 0.5) * 0.0005
    place = np.outer(norm.pdf(line, at[1], spread_m), norm.pdf(line, at[0], spread_m))  # y by x
    place /= place.sum()
    prior = np.prod(np.where(FLOORS == 1, expit(a.odds[:TILES]), 1.0 - expit(a.odds[:TILES])), axis=1)
    chance = np.empty(len(FLOORS))
    for f, floor in enumerate(FLOORS):
        felt = np.zeros((line.size, line.size), dtype=bool)
        for t in np.flatnonzero(floor):
            x_m, y_m = (t % SIDE) * TILE_M, (SIDE - 1 - t // SIDE) * TILE_M
            near_x = (line > x_m - reach_m) & (line < x_m + TILE_M + reach_m)
            near_y = (line > y_m - reach_m) & (line < y_m + TILE_M + reach_m)
            felt |= np.outer(near_y, near_x)
        of_one = FALSE_POSITIVE + (1.0 - FALSE_NEGATIVE - FALSE_POSITIVE) * (place * felt).sum()
        chance[f] = of_one if bit == 1 else 1.0 - of_one
    posterior = prior * chance
    before = a.odds.copy()
    assert add(a, j, bit, *at, spread_m, p, w) == pytest.approx(posterior.sum(), abs=2e-3)
    changed = (a.odds - before).reshape(2, TILES)
    expected = logit(posterior @ FLOORS / posterior.sum()) - before[:TILES]
    assert changed[1] == pytest.approx(expected, abs=0.01)
    assert not changed[0].any()


def test_no_function_that_takes_arrays_is_cached_alone() -> None:
    """Their types belong to generated modules, which a later process may lack when it reads the cache's index."""
    caches = {
        name: type(value._cache).__name__
        for name, value in vars(place_map).items()
        if "a" in getattr(getattr(value, "py_func", None), "__annotations__", {})
    }
    assert len(caches) >= 6
    assert set(caches.values()) == {"NullCache"}, caches
