"""Exported robots do what the simulated ones do: the plain program, C in double and single precision, on a Cortex-M0.

One inspection of 500 s by five robots, for every strategy that can be exported. Each exported robot is fed what one of
them measured and heard; all decide, but for a few under DC, DMVD and DMMD.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.example_strategies import load_example
from helpers.exported_robots import (
    EXPORTED,
    HAS_ARM,
    Swarm,
    built,
    built_for_arm,
    check_events,
    measured_at_each_tick,
    needs_arm,
    needs_gcc,
    rows,
    run_on_arm,
    run_program,
)
from helpers.plain_program import plain_program
from vibroswarm import preset, simulate
from vibroswarm.export.assembly import parts_of
from vibroswarm.export.c_program import NEEDS_DOUBLE
from vibroswarm.robot.walk import AVOID, TURN

SEED, TICKS = 4, 25_000
BASE = preset("paper").with_values(
    {
        "floor.source": "random:0.4",
        "run.stop": "t_end",
        "run.t_end_s": 500.0,
        "decision.min_observations": 150,
    }
)
WHOLE = ("soft", "dmmd")
"""Strategies, one without and one with timers, of which the whole program is run, walk and inbox included."""
OF_SINGLE = [name for name in EXPORTED if name not in NEEDS_DOUBLE]


@pytest.fixture(scope="module")
def inspection() -> Any:
    return simulate(BASE.with_values({"strategy.name": "soft"}), SEED, [0])


@pytest.fixture(scope="module")
def measured() -> np.ndarray[Any, Any]:
    return measured_at_each_tick(BASE, SEED, TICKS - 1)


@pytest.fixture(scope="module")
def swarms(inspection: Any, measured: np.ndarray[Any, Any]) -> Any:
    made: dict[str, Swarm] = {}
    readings = [inspection.observations.filter(robot=i)["observation"].to_list() for i in range(5)]

    def swarm_of(name: str) -> Swarm:
        if name not in made:
            swarm = Swarm(BASE.with_values({"strategy.name": name}), SEED, measured, readings)
            if name in WHOLE:
                swarm.run()
            else:
                swarm.run_as(swarm_of(WHOLE[0]))
            made[name] = swarm
        return made[name]

    return swarm_of


def test_the_plain_program_does_what_the_simulation_did(inspection: Any, swarms: Any) -> None:
    swarm = swarms("soft")
    for i, robot in enumerate(swarm.robots):
        found, expected = rows(swarm.did[i], swarm), inspection.inference.filter(robot=i)
        samples = inspection.motion.filter(robot=i)
        assert found.shape[0] == expected.height > 80
        np.testing.assert_array_equal(found[:, 1], np.rint(samples["time_s"].to_numpy() * 50.0))
        np.testing.assert_array_equal(found[:, 3], expected["decision"])
        np.testing.assert_array_equal(found[:, 5], expected["messages_received"])
        np.testing.assert_array_equal(found[:, 6], expected["message"])
        np.testing.assert_allclose(found[:, 4], expected["belief_below"], rtol=0, atol=1e-12)
        assert robot.decided_s == inspection.robots["decision_time_s"][i]


def started(**values: float) -> tuple[Any, Any]:
    """The plain program of a robot that decides by its first sample, and that robot."""
    first = {"min_observations": 0, "gate": "own", "gate_counts_current": True, "credible_threshold": 0.6}
    decides = {f"decision.{name}": value for name, value in first.items()}
    module = plain_program(parts_of(BASE.with_values(decides | values)))
    robot = module.Robot()
    module.start(robot, SEED, 0, 0)
    return module, robot


def period(module: Any, robot: Any, ray_mm: float) -> bool:
    """Do a control period of a robot that turns as far as it wants to; return whether it samples."""
    gyro_deg = robot.walk.error_deg if robot.walk.mode in (TURN, AVOID) else 0.0
    return bool(module.step(robot, gyro_deg, ray_mm))


def until(module: Any, robot: Any, it_is_so: Callable[[], bool]) -> None:
    """Do control periods in the open until something is so."""
    for _ in range(TICKS):
        if it_is_so():
            return
        period(module, robot, 5000.0)
    raise AssertionError("it never is")


def test_messages_that_find_a_full_inbox_are_lost_and_those_in_it_are_not() -> None:
    module, robot = started()
    kept = [module.receive(robot, 1, number, module.Message()) for number in range(len(robot.inbox) + 1)]
    assert kept == [True] * len(robot.inbox) + [False]
    assert (robot.waiting, robot.dropped, robot.inbox_number[0]) == (len(robot.inbox), 1, 0)


@needs_gcc
@pytest.mark.parametrize("name", EXPORTED)
def test_c_in_double_precision_is_the_plain_program_bit_by_bit(
    name: str, swarms: Any, tmp_path: Path
) -> None:
    swarm = swarms(name)
    program = built(BASE.with_values({"strategy.name": name}), tmp_path, precision=3, optimise="-O0")
    for events, did in zip(swarm.short, swarm.did, strict=True):
        assert np.array(run_program(program, events)).tobytes() == np.array(did).tobytes()
    if name in WHOLE:
        for events, walked in zip(swarm.whole, swarm.walked, strict=True):
            assert np.array(run_program(program, events)).tobytes() == np.array(walked).tobytes()


@needs_gcc
@pytest.mark.skipif(HAS_ARM, reason="the Cortex-M0 runs them")
@pytest.mark.parametrize("name", OF_SINGLE)
def test_single_precision_makes_the_same_events(name: str, swarms: Any, tmp_path: Path) -> None:
    swarm = swarms(name)
    program = built(BASE.with_values({"strategy.name": name}), tmp_path, precision=1)
    for events, did in zip(swarm.short, swarm.did, strict=True):
        check_events(run_program(program, events), did, swarm)


@needs_gcc
def test_single_precision_does_not_serve_three_valued(swarms: Any, tmp_path: Path) -> None:
    load_example("three_valued")
    swarm = swarms("three_valued")
    program = built(BASE.with_values({"strategy.name": "three_valued"}), tmp_path, precision=1)
    found = [run_program(program, events) for events in swarm.short]
    assert any(
        not np.array_equal(rows(ours, swarm)[:, :4], rows(theirs, swarm)[:, :4])
        for ours, theirs in zip(found, swarm.did, strict=True)
    )


@needs_arm
@pytest.mark.parametrize("name", EXPORTED)
def test_a_cortex_m0_makes_the_same_events(name: str, swarms: Any, tmp_path: Path) -> None:
    swarm = swarms(name)
    program = built_for_arm(BASE.with_values({"strategy.name": name}), tmp_path)
    # One inspection, since starting the emulator takes longest.
    check_events(run_on_arm(program, swarm.short[0]), swarm.did[0], swarm)


@needs_arm
def test_a_cortex_m0_walks_the_same_walk(swarms: Any, tmp_path: Path) -> None:
    swarm = swarms("soft")
    program = built_for_arm(BASE.with_values({"strategy.name": "soft"}), tmp_path)
    found, walked = np.array(run_on_arm(program, swarm.whole[0])), np.array(swarm.walked[0])
    np.testing.assert_allclose(found, walked, rtol=1e-3, atol=1e-4)
    ticks = walked == np.rint(walked)
    np.testing.assert_array_equal(found[ticks], walked[ticks])
