"""What a study varies: blocks, ranges, and what is wrong with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.errors import InputError
from vibroswarm.study.factors import points_of
from vibroswarm.study.precision import Precision
from vibroswarm.study.spec import Study

ROBOTS, ETA = "swarm.robots", "strategy.soft.eta"


def test_a_grid_is_every_combination_the_last_varying_fastest():
    points = points_of({"grid": {ROBOTS: [5, 6], "strategy.name": ["none", "soft"]}})
    assert [tuple(p.values()) for p in points] == [(5, "none"), (5, "soft"), (6, "none"), (6, "soft")]


def test_a_zip_goes_together_and_blocks_are_combined():
    points = points_of({"zip": {ROBOTS: [5, 6], ETA: [1.0, 2.0]}, "grid": {"decision.gate": [True, False]}})
    found = [tuple(p.values()) for p in points]
    assert found == [(5, 1.0, True), (5, 1.0, False), (6, 2.0, True), (6, 2.0, False)]


def test_tables_within_tables_are_names_with_dots():
    assert points_of({"grid": {"swarm": {"robots": [5]}}}) == [{ROBOTS: 5}]
    assert points_of({"list": [{"label": "a", "swarm": {"robots": 5}}]}) == [{"label": "a", ROBOTS: 5}]


@pytest.mark.parametrize(
    ("given_range", "values"),
    [
        ({"from": 5, "to": 10, "steps": 6}, [5, 6, 7, 8, 9, 10]),
        ({"from": 4, "to": 64, "steps": 5, "scale": "log"}, [4, 8, 16, 32, 64]),
        ({"from": 5, "to": 6, "steps": 3, "whole": False}, [5, 5.5, 6]),
    ],
)
def test_ranges(given_range: dict[str, Any], values: list[float]) -> None:
    assert [p[ROBOTS] for p in points_of({"grid": {ROBOTS: given_range}})] == values


def test_a_range_of_a_field_that_is_no_whole_number_has_fractions():
    points = points_of({"grid": {"walk.walk_duration_scale_ms": {"from": 1, "to": 2, "steps": 3}}})
    assert [next(iter(p.values())) for p in points] == [1, 1.5, 2]


@given(
    kind=st.sampled_from(["random", "sobol"]),
    count=st.integers(1, 70),
    seed=st.integers(0, 2**40),
    low=st.integers(-50, 50),
    width=st.integers(1, 9),
)
@settings(max_examples=40, deadline=None)
def test_points_between_bounds_lie_there_and_come_again(kind, count, seed, low, width):
    block = {
        "points": count,
        "seed": seed,
        ROBOTS: {"from": low, "to": low + width},
        ETA: {"from": 0.5, "to": 8.0, "scale": "log"},
        "strategy.name": ["none", "soft"],
    }
    points = points_of({kind: block})
    assert points == points_of({kind: dict(block)})
    assert points != points_of({kind: block | {"seed": seed + 1}})
    assert len(points) == count
    for point in points:
        assert isinstance(point[ROBOTS], int)
        assert low <= point[ROBOTS] <= low + width
        assert 0.5 <= point[ETA] <= 8.0
        assert point["strategy.name"] in ("none", "soft")


def test_sobol_points_are_spread_more_evenly_than_random_ones():
    def largest_gap(kind: str) -> float:
        points = points_of({kind: {"points": 64, ETA: {"from": 0.0, "to": 1.0}}})
        places = sorted(p[ETA] for p in points)
        return max(b - a for a, b in zip([0.0, *places], [*places, 1.0], strict=True))

    assert largest_gap("sobol") < 2 / 64 + 1e-12 < largest_gap("random")


def test_whole_numbers_between_bounds_are_all_hit():
    points = points_of({"random": {"points": 600, ROBOTS: {"from": 5, "to": 7}}})
    counts = [sum(p[ROBOTS] == n for p in points) for n in (5, 6, 7)]
    assert min(counts) > 150


@pytest.mark.parametrize("kind", ["random", "sobol"])
def test_whole_numbers_are_drawn_on_a_logarithmic_scale_too(kind: str) -> None:
    """The scale was ignored: half were above 250."""
    points = points_of({kind: {"points": 400, ROBOTS: {"from": 1, "to": 500, "scale": "log"}}})
    robots = sorted(p[ROBOTS] for p in points)
    assert (robots[0], robots[-1] <= 500) == (1, True)
    assert 14 <= robots[200] <= 32, "three standard errors about the middle, sqrt(501)"
    few = [
        p[ROBOTS] for p in points_of({kind: {"points": 400, ROBOTS: {"from": 2, "to": 3, "scale": "log"}}})
    ]
    assert 133 <= few.count(3) <= 200, "three standard errors about ln(4 / 3) / ln(4 / 2) of them"


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "unknown block": ({"gird": {}}, "did you mean 'grid'"),
    "unknown field": ({"grid": {"swarm.robot": [5]}}, "did you mean 'swarm.robots'"),
    "field without its section": ({"grid": {"robots": [5]}}, "did you mean 'swarm.robots'"),
    "empty grid": ({"grid": {}}, "grid: is empty"),
    "empty zip": ({"zip": {}}, "zip: is empty"),
    "empty list": ({"list": []}, "one or more tables"),
    "empty values": ({"grid": {ROBOTS: []}}, "grid.swarm.robots: is empty"),
    "no list": ({"grid": {ROBOTS: 5}}, r"is not a list; write \[5\]"),
    "a text": ({"grid": {"strategy.name": "soft"}}, "is not a list"),
    "unequal": (
        {"zip": {ROBOTS: [5], ETA: [1.0, 2.0]}},
        "not equally long: swarm.robots has 1, strategy.soft.eta has 2",
    ),
    "twice": ({"grid": {ROBOTS: [5]}, "list": [{ROBOTS: 6}]}, "two blocks"),
    "no table": ({"grid": 3}, "3 is not a table of fields"),
    "list of no tables": ({"list": [3]}, "3 is not a table of fields"),
    "label in a grid": ({"grid": {"label": ["a"]}}, "no such field"),
    "no points": ({"random": {ROBOTS: {"from": 1, "to": 2}}}, "None is wrong; give a whole number from 1"),
    "points 0": ({"random": {"points": 0, ROBOTS: {"from": 1, "to": 2}}}, "0 is wrong; give a whole number from 1"),
    "bad seed": ({"random": {"points": 1, "seed": -1, ROBOTS: {"from": 1, "to": 2}}}, "-1 is wrong"),
    "no bounds": ({"random": {"points": 3}}, "is empty"),
    "no range": ({"sobol": {"points": 3, ROBOTS: 5}}, "is not a range"),
    "steps in random": ({"random": {"points": 3, ROBOTS: {"from": 1, "to": 2, "steps": 2}}}, "belongs to a grid"),
    "empty choices": ({"random": {"points": 3, "strategy.name": []}}, "is empty"),
    "no steps": ({"grid": {ROBOTS: {"from": 5, "to": 6}}}, "is required: the number of values"),
    "one step": ({"grid": {ROBOTS: {"from": 5, "to": 6, "steps": 1}}}, "1 is wrong; give a whole number from 2"),
    "too many steps": ({"grid": {ROBOTS: {"from": 5, "to": 6, "steps": 3}}}, "more steps than whole numbers"),
    "backwards": ({"grid": {ROBOTS: {"from": 6, "to": 5, "steps": 2}}}, "6 is not below 5"),
    "log of 0": ({"grid": {ETA: {"from": 0, "to": 5, "steps": 2, "scale": "log"}}}, "the range begins above 0"),
    "no such scale": ({"grid": {ETA: {"from": 1, "to": 5, "steps": 2, "scale": "cubic"}}}, "cubic"),
    "the nearest of four": ({"grid": {"strategy.sof.eta": [1, 2]}}, "did you mean 'strategy.soft.eta'"),
    "no such part": ({"grid": {ETA: {"from": 1, "to": 5, "stpes": 2, "steps": 2}}}, "did you mean 'steps'"),
    "no number": ({"grid": {ETA: {"from": "a", "to": 5, "steps": 2}}}, "'a' is wrong; give a number"),
    "no finite number": ({"grid": {ETA: {"from": 1, "to": float("inf"), "steps": 2}}}, "inf is wrong; give a number"),
    "far too large": ({"grid": {ETA: {"from": 1, "to": 10**400, "steps": 2}}}, "is wrong; give a number"),
    "whole what": ({"grid": {ETA: {"from": 1, "to": 5, "steps": 2, "whole": 3}}}, "neither true nor false"),
    "a range of presets": ({"grid": {"preset": {"from": 1, "to": 5, "steps": 2}}}, ""),
    "too many cells": ({"grid": {ROBOTS: list(range(1000)), ETA: list(range(1000))}}, "more than 100000 cells"),
    "too many together": (
        {"grid": {ROBOTS: list(range(1000))}, "zip": {ETA: list(range(1000))}}, "more than 100000 cells"
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", [k for k in BAD if k != "a range of presets"])
def test_what_is_wrong_is_said(what: str) -> None:
    blocks, words = BAD[what]
    with pytest.raises(InputError, match=words):
        points_of(blocks)


def test_a_range_of_presets_is_no_crash():
    assert len(points_of(BAD["a range of presets"][0])) == 2  # numbers, which no preset is named by


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["swarm.robots", "swarm", "robots", "label", "preset", "from", "to", "steps", "points",
                             "scale", "whole", "strategy.name", "floor.source", "x"]),
            inner, max_size=4,
        )
    ),
    max_leaves=8,
)  # fmt: skip
JUNK.validate()  # now: it reads the lambda's source from this file, which may be edited before the first draw


@given(st.dictionaries(st.sampled_from(["grid", "zip", "list", "random", "sobol", "x"]), JUNK, max_size=3))
@settings(max_examples=100, deadline=None)
def test_nothing_but_points_or_an_input_error_comes_of_anything(blocks):
    try:
        points = points_of(blocks)
    except InputError:
        return
    assert all(isinstance(point, dict) for point in points)


def test_wrong_and_numpy_values_of_a_study() -> None:
    with pytest.raises(InputError, match=r"floor\.source"):
        _ = Study({"floor": {"source": ["stripe:0.48"]}}, runs=2).cells
    with pytest.raises(InputError, match=r"floor\.source"):
        _ = Study({}, {"grid": {"floor.source": [["a"], ["b"]]}}, runs=2).cells
    until = Precision(0.1, max_runs=np.int64(1000))  # type: ignore[arg-type]
    assert "1000" in Study({}, until=until, runs=None).to_toml()
    assert Study({}, runs=2, keep=["samples"]) == Study({}, runs=2, keep=("samples",))  # type: ignore[arg-type]
    tiles = ["01", "10"]
    point = {"floor.source": "mine", "floor.tiles": tiles}
    assert Study({}, {"list": [point]}, runs=2).cells[0].scenario.floor.tiles is not None
