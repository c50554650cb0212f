"""Maps of simulated inspections, and the controls that must fail."""

from __future__ import annotations

import numpy as np
import pytest

from vibroswarm.inspection.inspection import inspect
from vibroswarm.inspection.laws import law_of_scenario
from vibroswarm.inspection.samples import Samples
from vibroswarm.inspection.sources import samples_of_result
from vibroswarm.inspection.tile_map import tile_map
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate
from vibroswarm.statistics.map_scores import calibration, map_scores

RUNS = range(20)
AT_S = (60.0, 120.0, 300.0)


@pytest.fixture(scope="module")
def inspected() -> list[Samples]:
    scenario = preset("optimised-places").with_values({"run.t_end_s": 320.0})
    return [inspect(scenario, seed=700, run=run).samples for run in RUNS]


def brier(samples: Samples) -> np.ndarray:
    return np.array([map_scores(p, samples.floor)["brier"] for p in tile_map(samples, AT_S)])


def test_the_map_becomes_right_and_is_calibrated(inspected: list[Samples]) -> None:
    scores = np.array([brier(samples) for samples in inspected]).mean(axis=0)
    assert (scores < [0.15, 0.08, 0.02]).all()
    p = np.concatenate([tile_map(samples, AT_S)[:2].ravel() for samples in inspected])
    x = np.concatenate([np.tile(samples.floor.tiles.ravel(), 2) for samples in inspected])
    table = calibration(p, x)
    assert (abs(table["probability"] - table["vibrating"]) < 0.15).all()


def test_the_robots_say_how_wrong_their_places_are(inspected: list[Samples]) -> None:
    errors = [samples.place_errors for samples in inspected if samples.place_errors]
    assert len(errors) == len(RUNS)
    assert 0.6 < np.mean([one.lag_one for one in errors]) < 0.95
    assert np.mean([one.within[1] for one in errors]) > 0.9


@pytest.mark.parametrize("control", ["shuffled", "mirrored", "swapped"])
def test_a_control_must_fail(inspected: list[Samples], control: str) -> None:
    random = np.random.default_rng(1)
    scores = []
    for samples in inspected[:10]:
        order = random.permutation(samples.frame.height)
        wrong = {
            "shuffled": {
                name: samples.column(name)[order] for name in ("x_m", "y_m", "spread_x_m", "spread_y_m")
            },
            "mirrored": {"x_m": 1.0 - samples.column("x_m")},
            "swapped": {"log_ratio": -samples.column("log_ratio")},
        }[control]
        scores.append(map_scores(tile_map(samples.with_columns(**wrong), [300.0])[0], samples.floor))
    assert np.mean([score["brier"] for score in scores]) > 0.25  # worse than a map that knows nothing
    assert np.mean([score["surely_wrong"] for score in scores]) >= 4


@pytest.mark.parametrize(
    ("name", "factor", "score"),
    [
        ("optimised-places", 0.1, "brier"),
        ("calibrated", 0.1, "brier"),
        ("optimised-places", 0.5, "surely_wrong"),
    ],
)
def test_places_that_are_stated_too_exactly_must_fail(name: str, factor: float, score: str) -> None:
    """On tiles of 10 cm, spreads a tenth of those stated cost more than chance; halved ones give more sure mistakes.

    Halved ones cost nothing in ``calibrated``, whose robots overstate them: 88 % of the errors are within one.
    """
    small = {"floor.rows": 10, "floor.columns": 10, "floor.tile_width_m": 0.1, "floor.tile_height_m": 0.1}
    scenario = preset(name).with_values(
        {"run.t_end_s": 310.0, "strategy.name": "places", "floor.source": "random:0.48", **small}
    )
    result, law, costs = simulate(scenario, 900, 16), law_of_scenario(scenario, "the preset"), []
    for run in range(16):
        samples = samples_of_result(result, run, law)
        exact = {axis: factor * samples.column(axis) for axis in ("spread_x_m", "spread_y_m")}
        told, wrong = (
            map_scores(tile_map(one, [300.0])[0], samples.floor)[score]
            for one in (samples, samples.with_columns(**exact))
        )
        costs.append(wrong - told)
    assert np.mean(costs) > 2.5 * np.std(costs, ddof=1) / 4.0
