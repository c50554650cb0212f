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

from helpers.motion_runs import RunRows, begun, ended, rows_of
from helpers.walk_checks import CASES, CHECKS, Check, assert_same_rows, check_in
from vibroswarm.errors import InputError
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.motion_tables import Collected, Sink
from vibroswarm.motion.source import Source
from vibroswarm.robot.walk import (
    AVOID,
    DRIVE,
    STOP,
    TIMERS,
    TURN,
    Dice,
    WalkState,
    begin_walk,
    steered,
    walk_step,
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
    state, taken = begun(engine, scenario, seed, run, moves=True), Collected()
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


@pytest.mark.parametrize("engine", [FixedStepRun, EventRun])
@pytest.mark.parametrize("name", ["five robots", "a crowd", "40 robots in a large arena", "often", "no stop"])
def test_nan_and_nan_is_not_to_steer(engine: type[KernelRun], name: str) -> None:
    """And samples that are handed over one control period at a time are those of a whole run."""
    scenario = BASE.with_values({"run.t_end_s": 100.0} | SETTINGS[name])
    whole = rows_of(begun(engine, scenario, 3, 1, moves=True))
    asked = steered_rows(engine, scenario, 3, 1, never)
    for table in ("samples", "ends", "moves"):
        assert getattr(whole, table).tobytes() == getattr(asked, table).tobytes(), table


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


PROGRAM_DICE = Dice(0.5, 0.75, 0.25)


def standing(resume: int) -> WalkState:
    from vibroswarm.motion.robot_params import walk_program

    state = begin_walk(walk_program(Scenario()), PROGRAM_DICE)
    return state._replace(
        resume=resume,
        samples=4,
        legs=6,
        avoidances=2,
        driven_ms=900,
        leg_ms=5000.0,
        error_deg=-40.0,
        timer_ms=2020,
    )


@pytest.mark.parametrize("resume", [DRIVE, TURN, AVOID])
def test_the_program_that_is_steered(resume: int) -> None:
    from vibroswarm.motion.robot_params import walk_program

    program, before = walk_program(Scenario()), standing(resume)

    def following(state: WalkState) -> WalkState:
        return walk_step(state, program, 0.0, math.inf, PROGRAM_DICE)

    unchanged = steered(before, NAN, NAN)
    assert following(unchanged)[:-1] == following(before)[:-1]
    turned = following(steered(before, 60.0, 1500.0))
    assert (turned.mode, turned.error_deg, turned.legs, turned.avoidances) == (TURN, 60.0, 6, 2)
    ended = walk_step(turned, program, 60.0, math.inf, PROGRAM_DICE)
    assert (ended.mode, ended.leg_ms, ended.driven_ms, ended.legs) == (DRIVE, 1500.0, program.tick_ms, 7)
    assert math.isnan(ended.next_leg_ms), "the leg after it is drawn"
    drawn = walk_step(following(steered(before, 60.0, NAN)), program, 60.0, math.inf, PROGRAM_DICE)
    assert drawn.leg_ms == program.location_ms  # the median of what is drawn
    driven = steered(before, NAN, 700.0)
    assert driven.resume == resume
    assert driven.error_deg == before.error_deg
    if resume == TURN:
        ended = walk_step(following(driven), program, -40.0, math.inf, PROGRAM_DICE)
        assert (ended.mode, ended.leg_ms) == (DRIVE, 700.0)
    else:
        assert driven.leg_ms == before.driven_ms + 700.0
    assert following(driven).mode == resume
    assert before.mode == STOP


@pytest.mark.parametrize("engine", [FixedStepRun, EventRun])
def test_what_cannot_be_steered_is_refused(engine: type[KernelRun]) -> None:
    state = begun(engine, BASE, 5)
    with pytest.raises(InputError, match="has not just sampled"):
        state.steer(0, 10.0)
    sampled: list[int] = []
    assert state.to_sample(5000, Sink(lambda rows: sampled.extend(rows["robot"].tolist())))
    for values, field in (
        ((99, 1.0, 1.0), "robot"),
        ((-1, 1.0, 1.0), "robot"),
        ((sampled[0], math.inf, 1.0), "turn_deg"),
        ((sampled[0], 1.0, -1.0), "drive_ms"),
        ((sampled[0], 1.0, math.inf), "drive_ms"),
    ):
        with pytest.raises(InputError) as said:
            state.steer(*values)
        assert said.value.field == field
    (other, *_) = set(range(BASE.swarm.robots)) - set(sampled)
    with pytest.raises(InputError, match="has not just sampled"):
        state.steer(other, 1.0, 1.0)
    state.advance(state.tick + 1, Collected().sink)
    with pytest.raises(InputError, match="has not just sampled"):
        state.steer(sampled[0], 1.0, 1.0)


def test_to_sample_stops_at_the_time_asked_for() -> None:
    state = begun(EventRun, BASE, 5)
    assert not state.to_sample(25, Sink(lambda rows: pytest.fail("nobody samples so early")))
    assert state.tick == 25
