"""Spaces: bounds, scales, whole numbers, choices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibroswarm import preset
from vibroswarm.search.space import PAPER, Dimension, Space


def test_the_papers_space_holds_its_parameters() -> None:
    space = Space.of(PAPER)
    low, high = space.values(np.zeros(5)), space.values(np.ones(5))
    assert list(low.values()) == [0, 0, 1000, 50, 0]
    assert list(high.values()) == [20000, 20000, 6000, 150, 500]
    for name in ("paper", "paper-empirical"):
        values = space.values_of(preset(name))
        assert space.values(space.point(values)) == pytest.approx(values)
    assert space.values_of(preset("paper")) == dict(
        zip(space.names, [7860.0, 10725.0, 3778.0, 55.0, 381], strict=True)
    )


@given(st.floats(0, 1), st.sampled_from(["linear", "log"]), st.booleans())
def test_values_stay_in_bounds_and_come_back(u: float, scale: str, whole: bool) -> None:
    dimension = Dimension("decision.min_observations", 1.0, 500.0, scale, whole)
    value = dimension.value(u)
    assert 1 <= value <= 500
    assert isinstance(value, int) == whole
    assert dimension.value(dimension.share(value)) == pytest.approx(value, rel=1e-12)


def test_a_log_scale_has_its_geometric_mean_in_the_middle() -> None:
    assert Dimension("x", 1.0, 10000.0, "log").value(0.5) == pytest.approx(100.0)


def test_choices_have_equal_shares() -> None:
    space = Space.of({"strategy.name": ["none", "positive", "soft"]})
    assert [space.values(np.array([u]))["strategy.name"] for u in (0.0, 0.3, 0.4, 0.7, 1.0)] == [
        "none", "none", "positive", "soft", "soft",
    ]  # fmt: skip
    assert space.point({"strategy.name": "soft"}) == pytest.approx([5 / 6])  # the middle of its part
    assert space.values(space.point({"strategy.name": "soft"})) == {"strategy.name": "soft"}


def test_a_space_comes_back_from_its_block() -> None:
    space = Space.of({
        "walk.leg_min_ms": {"from": 1, "to": 100, "scale": "log"},
        "decision": {"min_observations": {"from": 0, "to": 9}},
        "strategy.name": ["none", "soft"],
    })  # fmt: skip
    assert Space.of(space.to_block()) == space
    assert space.dimensions[1].whole
