"""A motion replayed under another scenario is what simulating that scenario gives."""

from __future__ import annotations

from typing import Any

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from vibroswarm import preset, replay, simulate
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import infer
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.source import moved as motion_of
from vibroswarm.observation.observe import observe
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import floors_of

BASE = preset("paper").with_values({"run.t_end_s": 200.0, "decision.min_observations": 20})


@pytest.fixture(scope="module")
def moved() -> Result:
    return simulate(BASE, 9, 3, poses=True)


@pytest.mark.parametrize(
    "values",
    [
        {"strategy.name": "positive"},
        {"strategy.name": "soft", "strategy.soft.eta": 750.0, "strategy.soft.kappa": 1.0},
        {"strategy.name": "soft", "network.name": "loss", "network.loss.share": 0.2},
        {"decision.credible_threshold": 0.8, "decision.gate": "own", "decision.min_observations": 3},
        {"decision.decision_boundary": 0.03},
        {"floor.source": "diagonal:0.46"},
        {"floor.source": "random:0.52"},
        {"sensor.rms_threshold": 1.55},
        {"floor.source": "stripe:0.48", "sensor.rms_threshold": 1.0, "strategy.name": "positive"},
    ],
)
def test_a_replay_is_the_simulation(moved: Result, values: dict[str, object]) -> None:
    scenario = BASE.with_values(values)
    assert replay(moved, scenario) == simulate(scenario, 9, 3, poses=True)
    assert not replay(moved, scenario).same_tables(moved)


def test_nothing_changed_is_the_same_result(moved: Result) -> None:
    assert replay(moved, BASE) == moved


# One motion, many strategies


@pytest.fixture(scope="module")
def seen() -> tuple[Scenario, Motion, pl.DataFrame]:
    scenario = Scenario().with_values({"run.t_end_s": 150.0, "decision.min_observations": 20})
    motion = motion_of("event", scenario, 5, [1, 2, 6])
    return scenario, motion, observe(scenario, 5, motion.samples, floors_of(scenario, 5, [1, 2, 6]))


VARIANTS: list[dict[str, Any]] = [
    {"strategy.name": "none"},
    {"strategy.name": "positive", "decision.credible_threshold": 0.7},
    {"strategy.name": "soft", "strategy.soft.kappa": 0.5, "strategy.soft.eta": 10.0},
    {"strategy.name": "soft", "network.name": "loss", "network.loss.share": 0.2},
    {"decision.decision_boundary": 0.03},
]


@pytest.mark.parametrize("values", VARIANTS)
@pytest.mark.parametrize("seed", [5, 6])
def test_a_timeline_serves_every_strategy_and_seed(
    seen: tuple[Scenario, Motion, pl.DataFrame], values: dict[str, Any], seed: int
) -> None:
    base, motion, observations = seen
    timeline = timeline_of(base, motion)
    for before in (
        base.with_values({"strategy.name": "soft"}),
        base,
    ):  # what was asked before does not matter
        infer(before, 5, timeline, observations)
    scenario = base.with_values(values)
    for mine, theirs in zip(
        infer(scenario, seed, timeline, observations)[:2],
        infer(scenario, seed, motion, observations)[:2],
        strict=True,
    ):
        assert_frame_equal(mine, theirs, check_exact=True)


def test_the_strategies_differ(seen: tuple[Scenario, Motion, pl.DataFrame]) -> None:
    """Negative control."""
    base, motion, observations = seen
    found = [infer(base.with_values(values), 5, motion, observations)[1] for values in VARIANTS]
    assert not any(one.equals(other) for k, one in enumerate(found) for other in found[:k])
