"""Strategies that read places get estimates unless true places are asked for, which every answer then says first."""

from __future__ import annotations

from typing import Any

import pytest

from vibroswarm import preset, simulate, strategies
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.static_analysis import reads_places

READERS = {"places", "explore", "fading"}


def of(strategy: str, **values: Any) -> Scenario:
    more = {name.replace("__", "."): value for name, value in values.items()}
    return preset("paper").with_values({"strategy.name": strategy, "run.t_end_s": 30.0, **more})


def test_who_reads_places_is_found() -> None:
    assert {name for name, one in strategies.known().items() if reads_places(one)} == READERS


@pytest.mark.parametrize("strategy", sorted(strategies.known()))
def test_the_default_is_estimated_places_for_those_who_read_them(strategy: str) -> None:
    """And it has the hash of what it means, so that hashes of all other strategies stay."""
    default, mixture, true = (
        of(strategy, localisation__method=method) for method in ("auto", "mixture", "true")
    )
    assert of(strategy) == default
    same, other = (mixture, true) if strategy in READERS else (true, mixture)
    assert default.hash == same.hash != other.hash
    assert default.place_method == same.place_method
    assert not default.reads_true_places
    assert true.reads_true_places == (strategy in READERS)


def test_presets_leave_it_to_the_strategy() -> None:
    for name in preset_names():
        for strategy in READERS:
            assert preset(name).with_values({"strategy.name": strategy}).place_method == "mixture", name


def test_the_default_decides_as_estimated_places_do() -> None:
    default, mixture, true = (
        simulate(of("places", localisation__method=method, run__t_end_s=120.0), 3, 1)
        for method in ("auto", "mixture", "true")
    )
    assert default.places is not None
    assert default.inference.equals(mixture.inference)
    assert not default.inference.equals(true.inference)
    assert default.motion.equals(true.motion)
    assert simulate(of("soft"), 3, 1).places is None
