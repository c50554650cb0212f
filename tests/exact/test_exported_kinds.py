"""Exported robots that tell several kinds of tile apart do what simulated ones do, in double precision bit by bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.exported_robots import (
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
from vibroswarm import preset, simulate

SEED = 4
CLASSES = preset("paper").with_values(
    {
        "sensor.model": "confusion",
        "task.name": "majority",
        "strategy.name": "dirichlet",
        "floor.source": "random:0.28,0.48,0.24",
        "run.stop": "t_end",
        "run.t_end_s": 300.0,
        "decision.min_observations": 30,
    }
)
STRATEGIES = ["averaging", "dirichlet", "dirichlet_positive", "dirichlet_soft"]
WHOLE = "dirichlet"
"""The strategy of which the whole program is run, walk and inbox included; the others walk as it does."""


@pytest.fixture(scope="module")
def measured() -> np.ndarray[Any, Any]:
    return measured_at_each_tick(CLASSES, SEED, 14_999)


@pytest.fixture(scope="module")
def swarms(measured: np.ndarray[Any, Any]) -> Any:
    made: dict[str, tuple[Any, Swarm]] = {}

    def swarm_of(name: str) -> tuple[Any, Swarm]:
        if name not in made:
            scenario = CLASSES.with_values({"strategy.name": name})
            inspection = simulate(scenario, SEED, [0])
            readings = [inspection.observations.filter(robot=i)["observation"].to_list() for i in range(5)]
            swarm = Swarm(scenario, SEED, measured, readings)
            if name == WHOLE:
                swarm.run()
            else:
                swarm.run_as(swarm_of(WHOLE)[1])
            made[name] = inspection, swarm
        return made[name]

    return swarm_of


@pytest.mark.parametrize("name", STRATEGIES)
def test_the_plain_program_does_what_the_simulation_did(name: str, swarms: Any) -> None:
    inspection, swarm = swarms(name)
    decided = set()
    for i in range(5):
        found, expected = rows(swarm.did[i], swarm), inspection.inference.filter(robot=i)
        assert found.shape[0] == expected.height > 45
        np.testing.assert_array_equal(found[:, 3], expected["decision"])
        np.testing.assert_array_equal(found[:, 5], expected["messages_received"])
        final = inspection.reports.filter(robot=i).sort("sample", "index").tail(3)["value"]
        np.testing.assert_array_equal(swarm.robots[i].arrays.counts, final)  # of what all sent
        decided.add(int(found[-1, 3]))
    assert decided == {1}
    sent = {float(kind) for i in range(5) for kind in rows(swarm.did[i], swarm)[:, 6]}
    assert sent == (
        {1.0, 2.0} if name == "averaging" else {0.0, 1.0, 2.0}
    )  # whose share of kind 0 is the rest


@needs_gcc
@pytest.mark.parametrize("name", STRATEGIES)
def test_c_in_double_precision_is_the_plain_program_bit_by_bit(
    name: str, swarms: Any, tmp_path: Path
) -> None:
    _, swarm = swarms(name)
    program = built(CLASSES.with_values({"strategy.name": name}), tmp_path, precision=3, optimise="-O0")
    for events, did in zip(swarm.short, swarm.did, strict=True):
        assert np.array(run_program(program, events)).tobytes() == np.array(did).tobytes()
    if name == WHOLE:
        for events, walked in zip(swarm.whole, swarm.walked, strict=True):
            assert np.array(run_program(program, events)).tobytes() == np.array(walked).tobytes()


@needs_arm
@pytest.mark.parametrize("name", STRATEGIES)
def test_a_cortex_m0_makes_the_same_events(name: str, swarms: Any, tmp_path: Path) -> None:
    _, swarm = swarms(name)
    program = built_for_arm(CLASSES.with_values({"strategy.name": name}), tmp_path)
    check_events(run_on_arm(program, swarm.short[0]), swarm.did[0], swarm)
