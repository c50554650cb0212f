"""A source of motion that is no part of the package: it keeps the contract, and everything runs on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from helpers.result_outcomes import assert_same_outcomes, from_result
from helpers.walk_checks import TABLE_CHECKS, Check
from vibroswarm import simulate
from vibroswarm.errors import InputError
from vibroswarm.inference.closed_loop import max_samples
from vibroswarm.motion import source as motion_source
from vibroswarm.motion.source import ENDS, FAILURES, MOTION, MOVES, Motion, Source, register, source
from vibroswarm.optimize.outcomes import outcomes_of
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import lattice_sites, start_region

EVERY_S = 10.0


@dataclass
class Standing:
    """Robots that stand where they are, and sample every ten seconds."""

    scenario: Scenario
    seed: int
    run: int
    tick: int = 0

    @property
    def time_s(self) -> float:
        return self.tick * self.scenario.run.control_period_ms / 1000.0

    def advance(self, until_s: float) -> Motion:
        s = self.scenario
        robots, tick_ms = np.arange(s.swarm.robots), s.run.control_period_ms
        since, self.tick = self.tick, max(self.tick, math.ceil(until_s * 1000.0 / tick_ms - 1e-9))
        (left, right, low, high), (columns, rows) = start_region(s), lattice_sites(s)
        sites = np.random.default_rng([self.seed, self.run]).permutation(columns * rows)[: robots.size]
        x_m = left + (right - left) / max(columns - 1, 1) * (sites % columns)
        y_m = low + (high - low) / max(rows - 1, 1) * (sites // columns)
        places = {"run": self.run, "x_m": x_m, "y_m": y_m, "heading_rad": 0.0, "robot": robots}
        every = math.ceil(EVERY_S * 1000.0 / tick_ms)
        numbers = np.arange(max(since - 1, 0) // every, max(self.tick - 1, 0) // every)
        samples = [
            pl.DataFrame(
                places
                | {"sample": k, "time_s": (k + 1) * every * tick_ms / 1000.0}
                | {"stop_start_s": k * every * tick_ms / 1000.0, "stop_s": every * tick_ms / 1000.0}
                | {"drive_s": 0.0, "turn_s": 0.0, "avoid_s": 0.0}
            )
            for k in numbers.tolist()
        ]
        ends = pl.DataFrame(places | {"end_s": self.time_s, "stop_start_s": None})
        empty = pl.DataFrame(schema=MOTION)
        return Motion(
            pl.concat([empty, *(rows.select(list(MOTION)).cast(MOTION) for rows in samples)]),
            ends.select(list(ENDS)).cast(ENDS),
        )

    def copy(self) -> Standing:
        return replace(self)


def init(scenario: Scenario, seed: int, run: int, segments: bool = False, moves: bool = False) -> Standing:
    return Standing(scenario, seed, run)


STANDING = Source("standing", init)


@pytest.fixture(autouse=True)
def known() -> Iterator[None]:
    """The source is known by its name, as long as a test lasts."""
    register(STANDING)
    yield
    motion_source.forget("standing")


@pytest.mark.parametrize("check", TABLE_CHECKS, ids=lambda check: check.__name__)
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
    result = simulate(scenario, 3, [0, 2], motion="standing")
    assert result.source == "standing"
    assert result.segments is None
    assert result.same_tables(simulate(scenario, 3, [0, 2], motion="standing", progress=told.append))
    assert result.motion["time_s"].is_in([EVERY_S * k for k in range(1, 40)]).all()
    assert result.inference["decision"].n_unique() > 1, "somebody decides"
    if stop == "t_end":
        assert told[-1] == 1.0
        (found,) = outcomes_of([scenario], 3, [0, 2], "standing")
        assert_same_outcomes(found, from_result(result))
    else:
        assert result.motion.height < 2 * 39 * scenario.swarm.robots


@pytest.mark.parametrize("more", [{}, {"strategy.name": "totals"}], ids=["counts", "messages"])
def test_robots_may_sample_more_often_than_the_scenario_says(
    more: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody decides at first, so a run in closed loop gets more samples than the scenario's own timer would allow."""
    monkeypatch.setitem(globals(), "EVERY_S", 0.2)
    scenario = Scenario().with_values({"run.t_end_s": 24.0, "decision.min_observations": 125, **more})
    whole = simulate(scenario, 3, [0, 2], motion="standing")
    closed = simulate(scenario.with_values({"run.stop": "all_decided"}), 3, [0, 2], motion="standing")
    assert closed.motion.height > 2 * max_samples(scenario)
    rows = whole.inference.join(closed.motion.select("run", "robot", "sample"), on=["run", "robot", "sample"])
    assert_frame_equal(closed.inference, rows, check_exact=True, check_row_order=False)
    assert closed.inference["decision"].n_unique() > 1, "somebody decides"


def standing_moves(piece: Motion) -> pl.DataFrame:
    """Return one stop of each robot, from the start of the run on."""
    still = dict.fromkeys(("start_s", "speed_m_s", "turn_rate_rad_s", "turned_rad"), 0.0)
    columns = [pl.lit(value).alias(name) for name, value in still.items()]
    table = piece.ends.with_columns(*columns, kind=pl.lit("stop"), ray_m=None)
    return table.select(list(MOVES)).cast(MOVES)


def simulate_with(change: Callable[[Motion], Motion], stop: str) -> Result:
    """Simulate the standing robots with moves, each piece of motion changed, over a network that reads positions."""

    class Moving(Standing):
        def advance(self, until_s: float) -> Motion:
            piece = super().advance(until_s)
            return change(replace(piece, moves=standing_moves(piece)))

    motion_source.forget("standing")
    register(replace(STANDING, init=lambda scenario, seed, run, **wanted: Moving(scenario, seed, run)))
    values = {"run.t_end_s": 100.0, "run.stop": stop, "network.name": "range", "strategy.name": "soft"}
    return simulate(Scenario().with_values(values), 3, [0, 2], motion="standing")


def with_table(name: str, change: Callable[[pl.DataFrame], object]) -> Callable[[Motion], Motion]:
    return lambda piece: replace(piece, **{name: change(getattr(piece, name))})


def with_failures(table: object) -> Callable[[Motion], Motion]:
    return with_table("failures", lambda none: table)


FAILED = pl.DataFrame({"run": [7], "time_s": [3.0], "reason": ["fell over"]}, schema=FAILURES)


@pytest.mark.parametrize("stop", ["t_end", "all_decided"])
def test_right_moves_and_failures_are_taken(stop: str) -> None:
    result = simulate_with(with_failures(FAILED.clear()), stop)
    assert result.inference["messages_received"].max() > 0


def test_a_name_is_taken_once() -> None:
    register(STANDING)
    with pytest.raises(InputError, match="there is a source of motion 'event' already"):
        register(Source("event", init))
    assert source("event") is not STANDING
    for wrong in ("standing", None):
        with pytest.raises(InputError, match="is not a Source"):
            register(wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no function init"):
        Source("none", None)  # type: ignore[arg-type]
