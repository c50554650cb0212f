"""Robots that are steered after their samples: both engines do the same, and a source keeps its contract."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from helpers.motion_runs import RunRows, Taken, begun, ended
from helpers.walk_checks import CASES, CHECKS, Check, assert_same_rows, check_in
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.motion_tables import Sink
from vibroswarm.motion.source import Source
from vibroswarm.robot.walk import (
    DRIVE,
    TIMERS,
    TURN,
)
from vibroswarm.scenario.scenario import Scenario, preset

BASE = preset("paper-empirical")
NAN = math.nan
Way = tuple[float, float]
Decide = Callable[[int, int, int], Way]
"""(run, robot, sample) -> turn_deg, drive_ms."""


@cache
def at_random(salt: int = 0) -> Decide:
    """Each way to steer a third of the time, or none; the same for a sample, whoever asks."""

    @cache
    def decide(run: int, robot: int, sample: int) -> Way:
        rng = np.random.default_rng([salt, run, robot, sample])
        turns = (NAN, rng.uniform(-180.0, 180.0), rng.uniform(-6.0, 6.0), 0.0)
        drives = (NAN, rng.uniform(0.0, 9000.0), rng.uniform(0.0, 60.0), 0.0)
        turn, drive = rng.integers(0, 4, 2).tolist()
        return turns[turn], drives[drive]

    return decide


def never(run: int, robot: int, sample: int) -> Way:
    return NAN, NAN


def steer_to(state: KernelRun, until: int, sink: Sink, decide: Decide) -> None:
    """Advance a state up to a tick, steered after each sample."""
    here: list[NDArray[np.void]] = []

    def take(rows: NDArray[np.void]) -> None:
        here.append(rows.copy())
        sink.samples(rows)

    while state.tick < until:
        here.clear()
        if not state.to_sample(until, Sink(take, sink.moves)):
            continue
        (rows,) = here
        assert (rows["tick"] == state.tick - 1).all(), "samples are of the last control period"
        assert (np.diff(rows["robot"].astype(int)) > 0).all()
        for row in rows:
            state.steer(int(row["robot"]), *decide(state.run, int(row["robot"]), int(row["sample"])))


def steered_rows(engine: type[KernelRun], scenario: Scenario, seed: int, run: int, decide: Decide) -> RunRows:
    state, taken = begun(engine, scenario, seed, run, moves=True), Taken()
    steer_to(state, scenario.ticks, taken.sink, decide)
    return ended(state, taken)


def both(scenario: Scenario, seed: int, run: int, decide: Decide) -> tuple[RunRows, RunRows]:
    stepped, jumped = (
        steered_rows(engine, scenario, seed, run, decide) for engine in (FixedStepRun, EventRun)
    )
    return stepped, jumped


SETTINGS: dict[str, dict[str, Any]] = {
    "one robot": {"swarm.robots": 1, "run.t_end_s": 400.0},
    "five robots": {"run.t_end_s": 400.0},
    "thirty robots": {"swarm.robots": 30, "run.t_end_s": 60.0},
    "a crowd": {
        "swarm.robots": 20, "arena.width_m": 0.4, "arena.height_m": 0.4, "swarm.start_margin_m": 0.0,
        "run.t_end_s": 60.0,
    },
    "40 robots in a large arena": {
        "swarm.robots": 40, "arena.width_m": 2.9, "arena.height_m": 2.9, "run.t_end_s": 60.0,
    },
    "timer always on": {"sample.timer": "always", "run.t_end_s": 200.0},
    "timer held in turns": {"sample.timer": "hold_in_turn", "run.t_end_s": 200.0},
    "timer frozen in avoidance": {"sample.timer": "frozen_in_avoidance", "run.t_end_s": 200.0},
    "avoidance goes before": {"sample.interrupts_avoidance": False, "sample.timer": "always", "run.t_end_s": 200.0},
    "blind after turns": {"walk.blind_after_turn_ms": 730.0, "run.t_end_s": 200.0},
    "samples far between": {"sample.sample_interval_ms": 60_000.0, "run.t_end_s": 300.0},
    "no stop": {"sample.stop_ms": 0.0, "sample.sample_interval_ms": 500.0, "run.t_end_s": 60.0},
    "no driving between samples": {"sample.sample_interval_ms": 0.0, "run.t_end_s": 50.0},
    "often": {"sample.sample_interval_ms": 300.0, "sample.stop_ms": 100.0, "sample.timer": "always"},
    "ticks of 7 ms": {"run.control_period_ms": 7, "run.t_end_s": 100.0},
    "a corridor": {"arena.width_m": 0.12, "arena.height_m": 2.0, "run.t_end_s": 100.0},
    "much bent": {"robot.misalignment_min": -0.9, "robot.misalignment_max": 0.9, "run.t_end_s": 200.0},
}  # fmt: skip


@pytest.mark.parametrize("name", SETTINGS)
def test_both_engines_are_steered_the_same_way(name: str) -> None:
    scenario = BASE.with_values({"run.t_end_s": 100.0} | SETTINGS[name])
    for run in range(3):
        assert_same_rows(*both(scenario, 21, run, at_random()))


@pytest.mark.slow
@given(
    robots=st.integers(1, 30),
    side=st.floats(0.35, 1.2),
    threshold=st.floats(0.0, 120.0),
    tau=st.floats(0.0, 4000.0),
    timer=st.sampled_from(TIMERS),
    interrupts=st.booleans(),
    period=st.integers(10, 50),
    seed=st.integers(0, 2**63 - 1),
)
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_any_setting_is_steered_the_same_way(
    robots: int,
    side: float,
    threshold: float,
    tau: float,
    timer: str,
    interrupts: bool,
    period: int,
    seed: int,
) -> None:
    scenario = BASE.with_values(
        {
            "swarm.robots": robots,
            "arena.width_m": side,
            "arena.height_m": side,
            "swarm.start_margin_m": 0.0,
            "walk.avoidance_threshold_mm": threshold,
            "sample.sample_interval_ms": tau,
            "sample.timer": timer,
            "sample.interrupts_avoidance": interrupts,
            "run.control_period_ms": period,
            "run.t_end_s": 40.0,
        }
    )
    assert_same_rows(*both(scenario, seed, 0, at_random(seed % 1000)))


# A source that steers keeps the contract


class SteeredRun:
    """A run steered at random after each sample."""

    def __init__(self, state: KernelRun) -> None:
        self.state = state

    def __getattr__(self, name: str) -> Any:
        return getattr(self.state, name)

    def advance(self, until: int, sink: Sink) -> None:
        steer_to(self.state, until, sink, at_random())


STEERED = [
    Source("fixed-step, steered", lambda *wanted: SteeredRun(FixedStepRun(*wanted))),
    Source("event, steered", lambda *wanted: SteeredRun(EventRun(*wanted))),
]


@pytest.mark.slow
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("engine", STEERED, ids=lambda engine: engine.name)
def test_a_source_that_steers_keeps_the_contract(engine: Source, check: Check) -> None:
    """In all cases but that of a hundred robots, half of the time: steering asks each robot by itself."""
    check_in(tuple(case for case in CASES if case.name != "hundred robots"), check, engine)


# What a robot does that is steered


def of_robot(rows: RunRows, robot: int) -> NDArray[np.void]:
    return rows.moves[rows.moves["robot"] == robot]


OPEN = {"swarm.robots": 2, "arena.width_m": 200.0, "arena.height_m": 200.0, "swarm.start_margin_m": 90.0}
"""Two robots that hardly ever meet."""


@pytest.mark.parametrize("engine", [FixedStepRun, EventRun])
def test_a_robot_turns_and_drives_as_it_is_told_and_then_walks_on_as_drawn(engine: type[KernelRun]) -> None:
    scenario = BASE.with_values(OPEN | {"sample.sample_interval_ms": 20_000.0, "run.t_end_s": 300.0})

    def once(run: int, robot: int, sample: int) -> Way:
        return (77.0, 3000.0) if (robot, sample) == (0, 1) else (NAN, NAN)

    rows = steered_rows(engine, scenario, 8, 0, once)
    plain = steered_rows(engine, scenario, 8, 0, never)
    (sample,) = rows.samples[(rows.samples["robot"] == 0) & (rows.samples["sample"] == 1)]
    moves = of_robot(rows, 0)
    after = moves[moves["tick"] > sample["tick"]]
    assert after["kind"][:3].tolist() == [TURN, DRIVE, TURN]
    assert math.degrees(after["turned_rad"][0]) == pytest.approx(77.0, abs=scenario.walk.turn_tolerance_deg)
    drove_ms = (after["until"][1] - after["tick"][1]) * scenario.run.control_period_ms
    assert drove_ms == pytest.approx(3000.0, abs=scenario.run.control_period_ms)
    # The other robot's numbers are its own.
    assert of_robot(rows, 1).tobytes() == of_robot(plain, 1).tobytes()
    assert of_robot(rows, 0).tobytes() != of_robot(plain, 0).tobytes()


def test_to_sample_stops_at_the_time_asked_for() -> None:
    state = begun(EventRun, BASE, 5)
    assert not state.to_sample(25, Sink(lambda rows: pytest.fail("nobody samples so early")))
    assert state.tick == 25
