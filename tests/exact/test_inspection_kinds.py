"""Inspection of floors with more than two kinds of tile: exact for exact places, and refused where it means nothing."""

from __future__ import annotations

from io import StringIO
from typing import Any

import numpy as np
import pytest

import vibroswarm as v
from vibroswarm.documents.inspection import inspection_document
from vibroswarm.inspection.inspection import Inspection
from vibroswarm.inspection.stopping import Question
from vibroswarm.inspection.tile_map import any_but_still, kind_map, tile_map
from vibroswarm.observation.energy_model import rates
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.document import Text
from vibroswarm.show.terminal import print_document

BASE: dict[str, Any] = {
    "strategy.name": "dirichlet",
    "task.name": "majority",
    "floor.source": "random:0.4,0.36,0.24",
    "run.t_end_s": 300.0,
}
CONFUSION = BASE | {"sensor.model": "confusion", "sensor.confusion.accuracy": 0.7}
ACCELERATION = BASE | {
    "sensor.model": "acceleration", "sensor.acceleration.motor_hz": (90.0, 140.0), "sensor.rms_threshold": 1.0,
}  # fmt: skip


def test_the_map_of_kinds_is_bayes_rule() -> None:
    result = v.simulate(Scenario().with_values(CONFUSION), 1, 1)
    found = v.inspect(result)
    shares = rates(result.scenario.sensor)
    right = np.zeros((25, 3))
    for tile, reading in result.observations.select("tile", "observation").iter_rows():
        right[tile] += np.log(shares[:, reading])
    right = np.exp(right - right.max(axis=1, keepdims=True))
    right /= right.sum(axis=1, keepdims=True)
    assert found.by_kind == pytest.approx(right, abs=1e-9)
    assert found.pooled is not None
    assert found.pooled[-1] == pytest.approx(1.0 - right[:, 0], abs=1e-9)
    # Negative control: a robot alone knows less.
    assert np.abs(found.own[0][-1] - found.pooled[-1]).max() > 0.01


def test_tiles_are_told_by_their_motors() -> None:
    result = v.simulate(Scenario().with_values(ACCELERATION | {"run.t_end_s": 900.0}), 1, 1)
    found = v.inspect(result)
    assert found.by_kind is not None
    right = (found.by_kind.argmax(axis=1) == result.floor(0).tiles.ravel()).mean()
    assert right >= 0.92
    assert "Most probable kind of each tile" in shown(found)


def shown(found: Inspection) -> str:
    text = StringIO()
    print_document(inspection_document(found), text, width=100)
    return text.getvalue()


def test_with_two_kinds_the_map_of_kinds_is_that_of_tiles() -> None:
    values = CONFUSION | {
        "sensor.confusion.kinds": 2, "floor.source": "random:0.4", "localisation.method": "mixture",
    }  # fmt: skip
    samples = v.inspect(v.simulate(Scenario().with_values(values), 1, 1), bits=True).samples
    times_s = [100.0, 300.0]
    assert samples.column("spread_x_m").any()  # places are not exact
    found = kind_map(samples, times_s)
    assert found[..., 1] == pytest.approx(tile_map(samples, times_s), abs=1e-6)
    assert found.sum(axis=-1) == pytest.approx(1.0)


def test_three_kinds_at_estimated_places_are_weighed_against_each_other() -> None:
    """Compared each with kind 0 alone, as if all other tiles were of kind 0, the log loss was 0.058."""
    scenario = Scenario().with_values(CONFUSION | {"localisation.method": "mixture", "run.t_end_s": 600.0})
    losses = []
    for seed in range(3):
        result = v.simulate(scenario, seed, 1)
        found = v.inspect(result)
        assert found.by_kind is not None
        right = found.by_kind[np.arange(25), result.floor(0).tiles.ravel()]
        losses.append(-np.log(np.maximum(right, 1e-12)).mean())
    assert np.mean(losses) < 0.055


def test_damage_is_any_kind_but_0() -> None:
    question = Question(contrasts=(1.0,))
    floors = {"intact": "random:1,0,0", "two motors": "random:0.8,0.12,0.08"}
    p_values = {}
    for name, floor in floors.items():
        result = v.simulate(Scenario().with_values(CONFUSION | {"floor.source": floor}), 1, 1)
        found = v.inspect(result, question=question, replicates=99)
        assert found.assessment is not None
        p_values[name] = found.assessment.scan.p_value
    assert p_values["two motors"] <= 0.02
    assert p_values["intact"] > 0.1
    unequal = {"sensor.confusion.rates": [[0.8, 0.1, 0.1], [0.3, 0.6, 0.1], [0.1, 0.1, 0.8]]}
    samples = v.inspect(v.simulate(Scenario().with_values(CONFUSION | unequal), 1, 1)).samples
    assert rates(any_but_still(samples).law.sensor) == pytest.approx(np.array([[0.8, 0.2], [0.2, 0.8]]))


def test_robots_with_one_sample_each_have_no_correlation_of_places() -> None:
    """numpy warned about the mean of nothing, and the sentence said that errors are correlated by nan."""
    scenario = v.preset("optimised-places").with_values({"swarm.robots": 25, "run.t_end_s": 5.0})
    found = v.inspect(scenario, seed=1)
    assert found.samples.frame.height == 25
    words = " ".join(part.words for part in inspection_document(found).parts if isinstance(part, Text))
    assert "(68.3, 95.4 and 100 % expected)." in words
