"""A motion replayed under another scenario is what simulating that scenario gives."""

from __future__ import annotations

import pytest

from vibroswarm import preset, replay, simulate
from vibroswarm.errors import InputError
from vibroswarm.inference.replayer import MessagesReplayer
from vibroswarm.result import Result

BASE = preset("paper").with_values({"run.t_end_s": 200.0, "decision.min_observations": 20})


@pytest.fixture(scope="module")
def moved() -> Result:
    return simulate(BASE, 9, 3, segments=True)


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
    assert replay(moved, scenario) == simulate(scenario, 9, 3, segments=True)
    assert not replay(moved, scenario).same_tables(moved)


def test_nothing_changed_is_the_same_result(moved: Result) -> None:
    assert replay(moved, BASE) == moved


@pytest.mark.parametrize(
    "name", ["walk.leg_min_ms", "sample.sample_interval_ms", "arena.width_m", "run.t_end_s"]
)
def test_what_moves_the_robots_is_refused(moved: Result, name: str) -> None:
    section, _, field = name.partition(".")
    other = BASE.with_values({name: getattr(getattr(BASE, section), field) * 1.5})
    with pytest.raises(InputError, match=section):
        replay(moved, other)


def test_a_run_that_was_cut_short_is_refused() -> None:
    short = BASE.with_values({"run.stop": "all_decided"})
    with pytest.raises(InputError, match="cut short"):
        replay(simulate(short, 9), short)


def test_robots_that_steer_are_refused(moved: Result) -> None:
    """Neither their motion nor that of other robots is what simulating the other strategy gives."""
    steering = BASE.with_values({"strategy.name": "explore", "run.t_end_s": 20.0})
    with pytest.raises(InputError, match="'explore' steers its robots"):
        replay(moved, steering.with_values({"run.t_end_s": BASE.run.t_end_s}))
    steered = simulate(steering, 9)
    for other in ("none", "explore"):
        with pytest.raises(InputError, match="steer"):
            replay(steered, steering.with_values({"strategy.name": other}))


def test_more_messages_than_there_is_room_for_at_first_are_all_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is replayed again, with more room, leaves nothing of the attempts before."""
    scenario = BASE.with_values({"strategy.name": "three_valued", "strategy.three_valued.interval_s": 1.0})
    expected = simulate(scenario, 9, 3)
    rooms: list[int] = []
    first = MessagesReplayer._message_buffer

    def small(self: MessagesReplayer, room: int, under_way: int) -> object:
        rooms.append(room if rooms else 10)
        return first(self, room if len(rooms) > 1 else 10, under_way)

    monkeypatch.setattr(MessagesReplayer, "_message_buffer", small)
    assert simulate(scenario, 9, 3) == expected
    assert rooms[:3] == [10, 20, 40]
