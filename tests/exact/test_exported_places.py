"""Exported robots that localise and map the floor: the plain program, C in double and mixed precision, on a Cortex-M0.

The robots' gyro has no errors here but they presume some, so that the turns which the program adds up period by period
are those of the package's tables, but for the last bits.
"""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.exported_robots import (
    Swarm,
    built,
    built_for_arm,
    measured_at_each_tick,
    needs_arm,
    run_on_arm,
    run_program,
    steered_and_measured,
)
from vibroswarm import preset, simulate
from vibroswarm.export.assembly import parts_of
from vibroswarm.export.plain_program import plain_program
from vibroswarm.robot.walk import AVOID, TURN
from vibroswarm.scenario.scenario import Scenario

SEED = 4
NO_ERRORS = {
    f"odometry.{name}": 0.0
    for name in ("gyro_scale_spread", "gyro_bias_spread_deg_s", "turn_noise_deg", "gyro_walk_deg_sqrt_s")
}
SCENARIO = preset("paper").with_values(
    {
        "floor.source": "random:0.4",
        "run.stop": "t_end",
        "run.t_end_s": 350.0,
        "strategy.name": "places",
        "localisation.method": "mixture",
        "localisation.assumed_level": "good",
        **NO_ERRORS,
    }
)
EXPLORE = SCENARIO.with_values({"strategy.name": "explore"})
ESTIMATES = 9


@pytest.fixture(scope="module")
def inspection() -> Any:
    return simulate(SCENARIO, SEED, [0])


@pytest.fixture(scope="module")
def swarm(inspection: Any) -> Swarm:
    return driven(SCENARIO, inspection)


def driven(scenario: Scenario, inspection: Any, measured: np.ndarray[Any, Any] | None = None) -> Swarm:
    """Robots of the plain program that measured what the simulation's did."""
    readings = [inspection.observations.filter(robot=i)["observation"].to_list() for i in range(5)]
    ticks = round(scenario.run.t_end_s / scenario.tick_s) - 1
    if measured is None:
        measured = measured_at_each_tick(scenario, SEED, ticks)
    assert measured.shape[0] == ticks
    made = Swarm(scenario, SEED, measured, readings)
    starts = inspection.moves.group_by("robot", maintain_order=True).first().sort("robot")
    made.told(starts.select("x_m", "y_m", "heading_rad").rows())
    made.run()
    return made


def events(numbers: list[float], swarm: Swarm) -> np.ndarray[Any, Any]:
    """Of each sample: the estimate, then kind, tick, sends, decision, belief, heard, message; without an open stop."""
    width = ESTIMATES + 6 + len(swarm.fields)
    return np.array(numbers[: len(numbers) // width * width]).reshape(-1, width)


def test_the_plain_program_does_what_the_simulation_did(inspection: Any, swarm: Swarm) -> None:
    check_inspection(inspection, swarm, least=55)
    assert sum(robot.decided_s is not None for robot in swarm.robots) >= 3
    for i, robot in enumerate(swarm.robots):
        assert robot.decided_s == inspection.robots["decision_time_s"][i]


def check_inspection(inspection: Any, swarm: Swarm, least: int) -> None:
    for i in range(len(swarm.robots)):
        found, expected = events(swarm.did[i], swarm), inspection.inference.filter(robot=i)
        places = inspection.places.filter(robot=i).select("x_m", "y_m", "heading_rad", "spread_m").to_numpy()
        assert found.shape[0] == expected.height > least
        np.testing.assert_allclose(found[:, :4], places, rtol=0, atol=1e-6)
        np.testing.assert_allclose(found[:, 13], expected["belief_below"], rtol=0, atol=1e-6)
        np.testing.assert_array_equal(found[:, 12], expected["decision"])
        np.testing.assert_array_equal(found[:, 14], expected["messages_received"])


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_c_in_double_precision_is_the_plain_program_bit_by_bit(swarm: Swarm, tmp_path: Path) -> None:
    program = built(SCENARIO, tmp_path, precision=3)
    assert_same_bits(program, swarm.short, swarm.did)
    assert_same_bits(program, swarm.whole, swarm.walked)


def assert_same_bits(program: Path, fed: list[list[float]], expected: list[list[float]]) -> None:
    """A program that is fed what each robot measured gives these numbers, bit by bit."""
    for events_of_robot, numbers in zip(fed, expected, strict=True):
        assert np.array(run_program(program, events_of_robot)).tobytes() == np.array(numbers).tobytes()


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_work_that_takes_many_periods_gives_the_same_numbers(swarm: Swarm, tmp_path: Path) -> None:
    """Control periods pass while localisation and map are under way: walk and events stay the same, bit by bit."""
    walk, events_later, periods_late = (
        built(SCENARIO, tmp_path, precision=3, optimise="-O0", rows=rows, polls=25) for rows in (1, 2, 4)
    )
    for fed, walks, did in zip(swarm.whole, swarm.walks, swarm.events, strict=True):
        assert run_program(walk, fed) == walks
        assert run_program(events_later, fed) == did
        late = run_program(periods_late, fed)
        assert max(late) > 10
        assert np.mean(np.array(late) > 0) > 0.5


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_robots_of_field_do_the_same_in_python_and_c(tmp_path: Path) -> None:
    """Kriging of the arena, 80 s of it: a covariance matrix makes it the slowest strategy in plain Python."""
    scenario = SCENARIO.with_values({"strategy.name": "field", "run.t_end_s": 80.0})
    inspection = simulate(scenario, SEED, [0])
    swarm = driven(scenario, inspection)
    check_inspection(inspection, swarm, least=8)
    check_c(scenario, swarm, tmp_path)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_a_prior_that_tiles_share_does_the_same_in_python_and_c(tmp_path: Path) -> None:
    """ "More than 20 %?" of half of the tiles, 150 s of it."""
    scenario = SCENARIO.with_values({"decision.decision_boundary": 0.2, "run.t_end_s": 150.0})
    inspection = simulate(scenario, SEED, [0])
    independent = simulate(SCENARIO.with_values({"run.t_end_s": 150.0}), SEED, [0])
    assert not inspection.inference["belief_below"].equals(independent.inference["belief_below"])
    swarm = driven(scenario, inspection)
    check_inspection(inspection, swarm, least=18)
    check_c(scenario, swarm, tmp_path)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_robots_that_map_three_kinds_do_the_same_in_python_and_c(tmp_path: Path) -> None:
    scenario = SCENARIO.with_values(
        {
            "sensor.model": "confusion",
            "sensor.confusion.accuracy": 0.95,
            "task.name": "majority",
            "floor.source": "random:0.2,0.6,0.2",
            "decision.credible_threshold": 0.7,
            "run.t_end_s": 200.0,
        }
    )
    inspection = simulate(scenario, SEED, [0])
    swarm = driven(scenario, inspection)
    check_inspection(inspection, swarm, least=25)
    assert (inspection.robots["decision"] == 1).sum() >= 3
    for i, robot in enumerate(swarm.robots):
        maps = inspection.reports.filter(name="by_kind", robot=i).sort("index")["value"]
        np.testing.assert_allclose(robot.arrays.by_kind, maps, rtol=0, atol=1e-6)
    check_c(scenario, swarm, tmp_path)


def check_c(scenario: Scenario, swarm: Swarm, folder: Path) -> Path:
    """C in double precision gives the same bits, with arrays of float the same events; return the former."""
    double = built(scenario, folder / "double", precision=3, optimise="-O0")
    mixed = built(scenario, folder / "mixed", precision=2, optimise="-O0")
    assert_same_bits(double, swarm.short, swarm.did)
    for fed, did in zip(swarm.short, swarm.did, strict=True):
        check_events(run_program(mixed, fed), did, swarm)
    return double


def check_events(found: list[float], expected: list[float], swarm: Swarm) -> None:
    ours, theirs = events(found, swarm)[:, ESTIMATES:], events(expected, swarm)[:, ESTIMATES:]
    np.testing.assert_array_equal(ours[:, [0, 1, 2, 3, 5]], theirs[:, [0, 1, 2, 3, 5]])
    np.testing.assert_allclose(ours[:, 4], theirs[:, 4], rtol=0, atol=1e-3)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize("precision", [2, 1])
def test_arrays_of_float_make_the_same_events_and_float_alone_does_not(
    swarm: Swarm, precision: int, tmp_path: Path
) -> None:
    program = built(SCENARIO, tmp_path, precision=precision, optimise="-O0")
    found = [run_program(program, fed) for fed in swarm.short]
    if precision == 2:
        for ours, theirs in zip(found, swarm.did, strict=True):
            check_events(ours, theirs, swarm)
        return
    apart = [
        float(np.abs(events(ours, swarm)[:, :2] - events(theirs, swarm)[:, :2]).max())
        for ours, theirs in zip(found, swarm.did, strict=True)
    ]
    assert max(apart) > 0.005  # m: some component took another wall


@needs_arm
def test_a_cortex_m0_makes_the_same_events(swarm: Swarm, tmp_path: Path) -> None:
    program = built_for_arm(SCENARIO, tmp_path)
    check_events(run_on_arm(program, swarm.short[0]), swarm.did[0], swarm)  # the others take as long


@pytest.fixture(scope="module")
def exploring() -> tuple[Any, Swarm]:
    """An inspection in which robots steer, and the robots of the plain program that did the same."""
    inspection, measured = steered_and_measured(EXPLORE, SEED)
    return inspection, driven(EXPLORE, inspection, measured)


def test_the_plain_program_steers_as_the_simulation_does(
    exploring: tuple[Any, Swarm], inspection: Any
) -> None:
    explored, swarm = exploring
    check_inspection(explored, swarm, least=55)
    assert [robot.decided_s for robot in swarm.robots] == explored.robots["decision_time_s"].to_list()
    assert not explored.motion["x_m"].head(200).equals(inspection.motion["x_m"].head(200))  # it did steer


def test_a_robot_that_is_steered_stands_until_it_knows_where_to_go() -> None:
    """Periods missed meanwhile are counted, and change nothing but the clock."""
    module = plain_program(parts_of(EXPLORE))
    robots = [module.Robot() for _ in range(2)]
    for robot in robots:
        module.start(robot, SEED, 0, 0)
        module.told_pose(robot, 0.5, 0.5, 0.0)
    for late, robot in zip((0, 7), robots, strict=True):
        while not module.step(robot, 0.0, math.inf):
            while robot.jobs:
                module.work(robot)
        module.sample(robot, 1)
        walk = robot.walk
        for _ in range(late):
            assert not module.looks_now(robot, 0.0)
            assert not module.step(robot, 0.0, math.inf)
            assert (module.left_percent(robot), module.right_percent(robot)) == (0.0, 0.0)
            assert robot.walk == walk
        while robot.jobs:
            module.work(robot)
        assert not module.step(robot, 0.0, math.inf)
        assert module.left_percent(robot) != 0.0
    at_once, later = robots
    assert (at_once.missed, later.missed) == (0, 7)
    assert later.tick == at_once.tick + 7
    assert (later.walk, later.belief, later.decision) == (at_once.walk, at_once.belief, at_once.decision)


def test_a_robot_with_too_much_work_stands_and_does_all_of_it() -> None:
    """A robot that turns away from walls again and again, and is given no time for work."""
    module = plain_program(parts_of(SCENARIO))
    robot = module.Robot()
    module.start(robot, SEED, 0, 0)
    module.told_pose(robot, 0.5, 0.5, 0.0)
    while not module.is_busy(robot):
        turns = robot.walk.mode in (TURN, AVOID)
        assert not module.step(robot, robot.walk.error_deg if turns else 0.0, 20.0)
    walk, start_s, ends = robot.walk, robot.move_start_s, robot.jobs
    assert ends <= len(robot.queue)
    for _ in range(5):
        assert not module.step(robot, 0.25, 20.0)
        assert (module.left_percent(robot), module.right_percent(robot)) == (0.0, 0.0)
    assert (robot.walk, robot.jobs, robot.missed) == (walk, ends, 5)
    assert robot.move_start_s == pytest.approx(start_s + 5 * SCENARIO.tick_s)  # it did not move meanwhile
    while robot.jobs:
        module.work(robot)
    turned_deg = robot.move_turned_deg
    assert not module.step(robot, 0.0, 1000.0)
    assert not robot.stands
    # What the gyro saw while it stood counts in the move that goes on, or in that which has just ended.
    assert robot.move_turned_deg == turned_deg + 5 * 0.25 or robot.queue[robot.first_job].turned_rad != 0.0


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_robots_that_steer_do_the_same_in_python_and_c(exploring: tuple[Any, Swarm], tmp_path: Path) -> None:
    _, swarm = exploring
    assert_same_bits(check_c(EXPLORE, swarm, tmp_path), swarm.whole, swarm.walked)


@needs_arm
def test_a_cortex_m0_that_explores_makes_the_same_events(
    exploring: tuple[Any, Swarm], tmp_path: Path
) -> None:
    _, swarm = exploring
    program = built_for_arm(EXPLORE, tmp_path)
    check_events(run_on_arm(program, swarm.short[0]), swarm.did[0], swarm)
