"""A source of motion that is no part of the package: it keeps the contract, and everything runs on it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from helpers.result_outcomes import assert_same_outcomes, from_result
from helpers.walk_checks import MOTION_CHECKS, Check
from vibroswarm import simulate
from vibroswarm.errors import InputError
from vibroswarm.motion import source as motion_source
from vibroswarm.motion.motion_tables import END_ROW, MOVE_ROW, SAMPLE_ROW, Failure, Sink
from vibroswarm.motion.source import Source, register, source
from vibroswarm.robot.walk import STOP
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import lattice_sites, start_region
from vibroswarm.search.outcomes import outcomes_of

EVERY_S = 10.0
WITH_MOVES = False


class Standing:
    """Robots that stand where they are, and sample every ten seconds."""

    failure: Failure | None = None

    def __init__(self, scenario: Scenario, moves: bool) -> None:
        self.scenario, self.moves, self.tick = scenario, moves, 0

    def begin(self, seed: int, run: int) -> None:
        s = self.scenario
        self.run, self.tick = run, 0
        (left, right, low, high), (columns, rows) = start_region(s), lattice_sites(s)
        sites = np.random.default_rng([seed, run]).permutation(columns * rows)[: s.swarm.robots]
        self.x_m = left + (right - left) / max(columns - 1, 1) * (sites % columns)
        self.y_m = low + (high - low) / max(rows - 1, 1) * (sites // columns)

    def rows(self, dtype: np.dtype[np.void], **values: float) -> NDArray[np.void]:
        rows = np.zeros(self.x_m.size, dtype=dtype)
        rows["robot"] = np.arange(rows.size)
        for name, value in {"run": self.run, "x_m": self.x_m, "y_m": self.y_m, **values}.items():
            rows[name] = value
        return rows

    def advance(self, until: int, sink: Sink) -> None:
        every = math.ceil(EVERY_S * 1000.0 / self.scenario.run.control_period_ms)
        for k in range(max(self.tick - 1, 0) // every, max(until - 1, 0) // every):
            times = {"sample": k, "tick": (k + 1) * every, "stop_tick": k * every, "stop": every}
            sink.samples(self.rows(SAMPLE_ROW, **times))
        self.tick = max(self.tick, until)

    def finish(self, sink: Sink) -> NDArray[np.void]:
        if self.moves and WITH_MOVES:
            sink.moves(self.rows(MOVE_ROW, kind=STOP, until=self.tick, ray_m=np.nan))
        return self.rows(END_ROW, tick=self.tick, stop_tick=-1)


STANDING = Source("standing", Standing)


@pytest.fixture(autouse=True)
def known() -> Iterator[None]:
    """The source is known by its name, as long as a test lasts."""
    register(STANDING)
    yield
    motion_source.forget("standing")


@pytest.mark.parametrize("check", MOTION_CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_the_contract(check: Check) -> None:
    check(STANDING)


@pytest.mark.parametrize("stop", ["t_end", "all_decided"])
def test_scenarios_run_on_it(stop: str) -> None:
    scenario = Scenario().with_values(
        {
            "run.t_end_s": 400.0,
            "run.stop": stop,
            "decision.min_observations": 5,
            "floor.source": "diagonal:0.46",
        }
    )
    told: list[float] = []
    result = simulate(scenario, 3, [0, 2], motion="standing", poses=True)
    assert result.source == "standing"
    assert result.poses is None
    assert result.same_tables(simulate(scenario, 3, [0, 2], motion="standing", progress=told.append))
    assert result.motion["time_s"].is_in([EVERY_S * k for k in range(1, 40)]).all()
    assert result.inference["decision"].n_unique() > 1, "somebody decides"
    if stop == "t_end":
        assert told[-1] == 1.0
        (found,) = outcomes_of([scenario], 3, [0, 2], "standing")
        assert_same_outcomes(found, from_result(result))
    else:
        assert result.motion.height < 2 * 39 * scenario.swarm.robots


@pytest.mark.parametrize("stop", ["t_end", "all_decided"])
def test_its_moves_are_taken(stop: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over a network that reads positions."""
    monkeypatch.setitem(globals(), "WITH_MOVES", True)
    values = {"run.t_end_s": 100.0, "run.stop": stop, "network.name": "range", "strategy.name": "soft"}
    result = simulate(Scenario().with_values(values), 3, [0, 2], motion="standing")
    assert result.inference["messages_received"].max() > 0


def test_a_name_is_taken_once() -> None:
    register(STANDING)
    with pytest.raises(InputError, match="there is a source of motion 'event' already"):
        register(Source("event", Standing))
    assert source("event") is not STANDING
