"""A motion replayed under another scenario is what simulating that scenario gives."""

from __future__ import annotations

from typing import Any

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from vibroswarm import preset, replay, simulate
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.replay import infer
from vibroswarm.inference.replayer import Replayer
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


def test_more_messages_than_there_is_room_for_at_first_are_all_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is replayed again, with more room, leaves nothing of the attempts before."""
    scenario = BASE.with_values({"strategy.name": "dmmd"})
    expected = simulate(scenario, 9, 3)
    rooms: list[int] = []
    first = Replayer._message_buffer

    def small(self: Replayer, room: int) -> object:
        rooms.append(room if rooms else 10)
        return first(self, rooms[-1])

    monkeypatch.setattr(Replayer, "_message_buffer", small)
    assert simulate(scenario, 9, 3) == expected
    assert rooms[:3] == [10, 20, 40]


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
        infer(scenario, seed, timeline, observations),
        infer(scenario, seed, motion, observations),
        strict=True,
    ):
        assert_frame_equal(mine, theirs, check_exact=True)


def test_the_strategies_differ(seen: tuple[Scenario, Motion, pl.DataFrame]) -> None:
    """Negative control."""
    base, motion, observations = seen
    found = [infer(base.with_values(values), 5, motion, observations)[1] for values in VARIANTS]
    assert not any(one.equals(other) for k, one in enumerate(found) for other in found[:k])


def test_other_rows_are_refused(seen: tuple[Scenario, Motion, pl.DataFrame]) -> None:
    base, motion, observations = seen
    wrong = [
        observations[:-1],
        observations.reverse(),
        observations.with_columns(pl.col("run") + 1),
        observations.with_columns(pl.col("sample").gather((pl.int_range(pl.len()) + 1) % pl.len())),
    ]
    for table in wrong:
        with pytest.raises(ValueError, match="rows of the motion"):
            infer(base, 5, motion, table)
    again = infer(base, 5, motion, observations.clone().rechunk())
    assert again[1].equals(infer(base, 5, motion, observations)[1])
    fewer = base.with_values({"swarm.robots": 3})
    with pytest.raises(ValueError, match="robot 4; there are 3 robots"):
        timeline_of(fewer, motion)


def test_a_replay_of_a_result_read_again_is_the_same(
    seen: tuple[Scenario, Motion, pl.DataFrame],
) -> None:
    """Tables in other pieces of memory."""
    base = seen[0]
    result = simulate(base, 5, [1, 2, 6])
    again = {name: pl.concat([getattr(result, name)[:100], getattr(result, name)[100:]], rechunk=False)
             for name in ("motion", "observations")}  # fmt: skip
    pieces = Result(**{**vars(result), **again})
    scenario = base.with_values(VARIANTS[2])
    assert replay(pieces, scenario).same_tables(replay(result, scenario))
    assert isinstance(timeline_of(base, Motion(pieces.motion, pieces.ends)), Timeline)
