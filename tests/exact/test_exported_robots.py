"""Exported robots do what the simulated ones do: plain Python, C in double and single precision, on a Cortex-M0.

One inspection of 1200 s by five robots; each exported robot is fed what one of them measured and heard.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.exported_robots import Swarm, built, built_for_arm, run_on_arm, run_program
from vibroswarm import preset, simulate
from vibroswarm.strategies import names

SEED = 4
STRATEGIES = [name for name in names() if name != "places"]
BASE = preset("paper").with_values({"floor.source": "random:0.48", "run.stop": "t_end"})
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
needs_arm = pytest.mark.skipif(
    shutil.which("arm-none-eabi-gcc") is None or shutil.which("qemu-system-arm") is None,
    reason="arm-none-eabi-gcc or qemu-system-arm is not installed",
)


@pytest.fixture(scope="module")
def inspection() -> Any:
    return simulate(BASE.with_values({"strategy.name": "soft"}), SEED, [0])


@pytest.fixture(scope="module")
def swarms(inspection: Any) -> dict[str, Swarm]:
    return {}


def swarm_of(name: str, inspection: Any, swarms: dict[str, Swarm]) -> Swarm:
    if name not in swarms:
        readings = inspection.observations["observation"].to_list()
        scenario = BASE.with_values({"strategy.name": name})
        swarms[name] = Swarm(scenario, SEED, inspection.motion, inspection.ends, readings)
        swarms[name].run()
    return swarms[name]


def rows(numbers: list[float], swarm: Swarm) -> np.ndarray[Any, Any]:
    """Events: kind, tick, sends, decision, belief, heard, message."""
    return np.array(numbers).reshape(-1, 6 + len(swarm.fields))


@pytest.mark.parametrize("name", ["soft"])
def test_exported_python_decides_as_the_simulation(
    name: str, inspection: Any, swarms: dict[str, Swarm]
) -> None:
    swarm = swarm_of(name, inspection, swarms)
    for i, robot in enumerate(swarm.robots):
        found, expected = rows(swarm.did[i], swarm), inspection.inference.filter(robot=i)
        assert found.shape[0] == expected.height > 150
        np.testing.assert_array_equal(found[:, 3], expected["decision"])
        np.testing.assert_array_equal(found[:, 6], expected["message"])
        np.testing.assert_allclose(found[:, 4], expected["belief_below"], rtol=0, atol=1e-12)
        assert robot.decided_s == inspection.robots["decision_time_s"][i]


@needs_gcc
@pytest.mark.parametrize("name", STRATEGIES)
def test_c_in_double_precision_is_the_exported_python_bit_by_bit(
    name: str, inspection: Any, swarms: dict[str, Swarm], tmp_path: Path
) -> None:
    swarm = swarm_of(name, inspection, swarms)
    program = built(BASE.with_values({"strategy.name": name}), tmp_path, precision=3)
    for events, did in zip(swarm.events, swarm.did, strict=True):
        assert np.array(run_program(program, events)).tobytes() == np.array(did).tobytes()


@needs_arm
@pytest.mark.parametrize("name", STRATEGIES)
def test_a_cortex_m0_makes_the_same_events(
    name: str, inspection: Any, swarms: dict[str, Swarm], tmp_path: Path
) -> None:
    swarm = swarm_of(name, inspection, swarms)
    program = built_for_arm(BASE.with_values({"strategy.name": name}), tmp_path)
    for events, did in zip(swarm.events, swarm.did, strict=True):
        found, expected = rows(run_on_arm(program, events), swarm), rows(did, swarm)
        np.testing.assert_array_equal(found[:, [0, 1, 2, 3, 5]], expected[:, [0, 1, 2, 3, 5]])
        np.testing.assert_allclose(found[:, 4], expected[:, 4], rtol=0, atol=1e-4)
