"""Options of places: as in plain Python, in pieces as in whole tables, absent when off, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from helpers.result_outcomes import assert_same_outcomes, from_result
from vibroswarm import preset, simulate
from vibroswarm.analysis.map_figures import floor_maps
from vibroswarm.inference.agents import strategy_used
from vibroswarm.optimize.outcomes import outcomes_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import replay
from vibroswarm.strategies import strategy
from vibroswarm.study.scenario_words import warnings_of
from vibroswarm.testing import plain_run
from vibroswarm.testing.runs import differences

SEED = 31
TRUE = Scenario().with_values(
    {
        "strategy.name": "places",
        "localisation.method": "true",
        "run.t_end_s": 150.0,
        "strategy.places.min_samples": 10,
        "sensor.tile_spread": 0.1,
        "network.name": "loss",
        "network.loss.share": 0.0,
    }
)
"""On a network that may lose messages throughout: kernels of another network would take ten seconds an option."""
ESTIMATED = TRUE.with_values({"localisation.method": "mixture", "odometry.level": "poor"})
OPTIONS: dict[str, dict[str, Any]] = {
    "energies": {"energies": True},
    "draws": {"draws": 3},
    "both": {"energies": True, "draws": 2},
    "map": {"share_map": True},
    "map, energies, seldom": {"share_map": True, "energies": True, "map_every": 3},
}


def of(scenario: Scenario, option: str, **more: Any) -> Scenario:
    return scenario.with_values(
        {f"strategy.places.{name}": value for name, value in OPTIONS[option].items()} | more
    )


@pytest.mark.parametrize("option", OPTIONS)
def test_kernels_do_what_plain_python_does(option: str) -> None:
    """At true places, with a lossy network and a robot that sends the opposite."""
    faults = {"faults.opposite": 0.2, "network.loss.share": 0.2}
    scenario = of(TRUE, option, **faults)
    result = simulate(scenario, SEED, [2])
    plain = plain_run(scenario, SEED, result.motion, result.ends, result.observations)
    assert list(differences(result, plain)) == []
    assert result.robots["messages_received"].sum() > 50


@pytest.mark.slow
@pytest.mark.parametrize("option", OPTIONS)
def test_pieces_give_what_whole_tables_give(option: str) -> None:
    """Places, energies and draws as they become known; with another option decisions are others."""
    scenario = of(ESTIMATED, option, **{"run.t_end_s": 400.0})
    (found,) = outcomes_of([scenario], SEED, [0, 3], "event")
    tables = from_result(simulate(scenario, SEED, [0, 3], energies=False))
    assert_same_outcomes(found, tables)
    plain = from_result(simulate(ESTIMATED.with_values({"run.t_end_s": 400.0}), SEED, [0, 3]))
    assert not np.array_equal(plain.decision_time_s, tables.decision_time_s)


def test_what_is_off_is_the_strategy_itself() -> None:
    """Neither memory nor functions of an option are in the kernels without it."""
    assert strategy_used(TRUE) is strategy("places")
    assert strategy_used(TRUE.with_values({"strategy.places.map_every": 3})) is strategy("places")
    for option in OPTIONS:
        used = strategy_used(of(TRUE, option))
        assert used.on_sample is not strategy("places").on_sample
        assert used is strategy_used(of(TRUE, option)) or used == strategy_used(of(TRUE, option))


@pytest.mark.parametrize(
    ("option", "values", "size"),
    [
        ("energies", {}, 8),
        ("energies", {"arena.width_m": 5.0, "arena.height_m": 1.0}, 9),
        ("draws", {}, 16),
        ("both", {}, 13),
        ("map", {}, 30),
        ("map", {"floor.rows": 10, "floor.columns": 10}, 105),
    ],
)
def test_bytes_of_messages_are_counted(option: str, values: dict[str, Any], size: int) -> None:
    assert strategy_used(of(TRUE, option, **values)).bytes_on_air == size


def test_energies_are_computed_for_who_reads_them_and_bits_stay() -> None:
    result = simulate(of(TRUE, "energies"), SEED, [0], energies=False)
    assert result.observations["energy"].null_count() == 0
    without = simulate(of(TRUE, "draws"), SEED, [0], energies=False)
    assert without.observations["energy"].null_count() == without.observations.height
    assert result.observations["observation"].equals(without.observations["observation"])
    again = replay(without, of(TRUE, "map"))
    assert again.robots.equals(simulate(of(TRUE, "map"), SEED, [0]).robots)
    with pytest.raises(ValueError, match="energies"):
        replay(without, of(TRUE, "energies"))


@pytest.mark.parametrize("option", OPTIONS)
def test_maps_are_shown(option: str) -> None:
    result = simulate(of(ESTIMATED, option), SEED, [0], moves=True)
    maps = floor_maps(result)
    assert maps.height == 6 * 25
    pooled = maps.filter(maps["robot"].is_null())
    on, off = (pooled.filter(pooled["vibrates"] == kind)["vibrating"].mean() for kind in (1, 0))
    assert on > off + 0.3  # type: ignore[operator]


@pytest.mark.slow
def test_energies_tell_more_than_bits_and_maps_survive_losses() -> None:
    """30 runs: decisions sooner with energies; with half of the messages lost, sooner by maps than by samples."""
    hard = preset("paper").with_values(
        {
            "strategy.name": "places", "localisation.method": "mixture", "floor.source": "random:0.48",
            "strategy.places.variance_factor": 2.0, "network.name": "loss", "network.loss.share": 0.0,
        }
    )  # fmt: skip
    lossy = hard.with_values({"network.loss.share": 0.5})
    results = {}
    for name, scenario in (
        ("bits", hard), ("energies", of(hard, "energies")), ("lossy", lossy), ("lossy maps", of(lossy, "map")),
    ):  # fmt: skip
        time_s = simulate(scenario, SEED, 30).robots["decision_time_s"].fill_null(1200.0)
        results[name] = time_s.to_numpy().reshape(30, 5).mean(axis=1)
    for sooner, later in (("energies", "bits"), ("lossy maps", "lossy")):
        less = results[later] - results[sooner]
        assert less.mean() > 2.0 * less.std() / np.sqrt(less.size), (sooner, later)


@pytest.mark.parametrize("name", ["places", "fading", "field", "none"])
def test_tiles_outside_the_arena_are_warned_of_where_robots_map_them(name: str) -> None:
    cut = preset("paper").with_values({"strategy.name": name, "floor.tile_width_m": 0.25})
    assert not warnings_of(cut.with_values({"arena.width_m": 1.25}))
    assert ["beyond the arena" in text for text in warnings_of(cut)] == [True] * (
        name in ("places", "fading")
    )
