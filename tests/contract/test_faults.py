"""Faults of sensors, messages, radios and bodies: every way to compute a run agrees, and nothing else is touched.

The ways: kernels that count bits or read messages, tables or a closed loop, and a plain account tick by tick.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.drawn_scenarios import QUICK
from helpers.plain_reference import differences, plain_run
from helpers.result_outcomes import assert_same_outcomes, from_result
from helpers.walk_checks import assert_engines_agree
from vibroswarm.result import Result
from vibroswarm.scenario.plugins import load_file
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.search.outcomes import outcomes_of
from vibroswarm.simulation import replay, simulate
from vibroswarm.strategies.base import forget

VOTER = Path(__file__).parents[2] / "examples" / "strategies" / "voter.py"
SENSORS = {"stuck_at_1": 0.4, "stuck_at_0": 0.2, "biased": 0.6, "false_positive_shift": 0.3,
           "false_negative_drift_per_h": 5.0, "sensor_from_s": [0.0, 30.0]}  # fmt: skip
OPPOSITE = {"opposite": 0.4, "opposite_from_s": [10.0, 50.0]}
RADIO = {"radio_dead": 0.4, "radio_dead_from_s": [10.0, 50.0]}
BODIES = {"stopped": 0.4, "stopped_from_s": [0.0, 50.0], "battery_empty": 0.6, "battery_life_s": [10.0, 60.0]}
CASES: dict[str, dict[str, Any]] = {
    "sensors": SENSORS, "opposite": OPPOSITE, "radio": RADIO, "bodies": BODIES,
    "all": SENSORS | OPPOSITE | RADIO | BODIES,
}  # fmt: skip
NETWORKS = {"ideal": {"network.name": "ideal"}, "loss": {"network.name": "loss", "network.loss.share": 0.2}}


@pytest.fixture(scope="module", autouse=True)
def voter() -> Iterator[None]:
    """A strategy with a timer and opinions, which the swarm settles on together."""
    load_file("strategy", f"{VOTER}:voter")
    yield
    forget("voter")


def faulty(faults: dict[str, Any], **more: Any) -> Scenario:
    values = QUICK | {"run.t_end_s": 70.0, "decision.hold_s": 4.0, "sample.sample_interval_ms": 2000.0}
    values |= {"strategy.voter.phase_s": 4.0}
    values |= {name.replace("__", "."): value for name, value in more.items()}
    return Scenario().with_values(values | {f"faults.{name}": value for name, value in faults.items()})


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("strategy", ["none", "soft", "voter"])
@pytest.mark.parametrize("case", CASES)
def test_every_way_gives_the_same_run(case: str, strategy: str, network: str) -> None:
    scenario = faulty(CASES[case], strategy__name=strategy).with_values(NETWORKS[network])
    result = simulate(scenario, 8, [3 if network == "ideal" else 4])
    plain = plain_run(scenario, 8, result.motion, result.ends, result.observations)
    assert list(differences(result, plain)) == []
    (found,) = outcomes_of([scenario], 8, [3, 4])
    assert_same_outcomes(found, from_result(simulate(scenario, 8, [3, 4], energies=False)))


MOTORS = {"sensor.model": "acceleration", "sensor.acceleration.motor_hz": [90.0, 140.0]}
OF_KINDS = {"strategy.name": "dirichlet", "task.name": "majority", "floor.source": "random:0.4,0.36,0.24"}
ALL_SENSORS = {
    "stuck": [1],
    "stuck_class": 2,
    "biased": [0, 3],
    "misread_shift": 0.3,
    "misread_drift_per_h": 20.0,
}


@pytest.mark.parametrize("sensor", [{"sensor.model": "confusion"}, MOTORS], ids=["law", "places"])
def test_every_way_gives_the_same_run_of_three_kinds(sensor: dict[str, Any]) -> None:
    faults = ALL_SENSORS | {"opposite": [4], "sensor_from_s": 20.0}
    values = OF_KINDS | sensor | {f"faults.{name}": value for name, value in faults.items()}
    scenario = faulty({}).with_values(values)
    result = simulate(scenario, 8, [3])
    plain = plain_run(scenario, 8, result.motion, result.ends, result.observations)
    assert list(differences(result, plain)) == []
    (found,) = outcomes_of([scenario], 8, [3, 4])
    by_tables = from_result(simulate(scenario, 8, [3, 4], energies=False))
    np.testing.assert_array_equal(found.decision, by_tables.decision)


def test_the_swarm_settles_when_those_that_work_agree() -> None:
    """A robot that never votes leaves the others' decision to them, though its own first opinion is another."""
    scenario = faulty(
        {"stopped": [0]}, strategy__name="voter", run__t_end_s=150.0, floor__source="random:0.92"
    )
    decided = simulate(scenario, 8, range(6, 9)).robots["decision"].to_numpy().reshape(3, 5)
    agreed = (decided[:, 1:] == 0).all(axis=1)
    assert (agreed & (decided[:, 0] == 1)).any()


def test_motion_is_untouched_by_what_does_not_touch_it() -> None:
    fine, failed = (
        simulate(faulty(faults), 8, [0, 1], poses=True) for faults in ({}, SENSORS | OPPOSITE | RADIO)
    )
    assert replay(fine, failed.scenario) == failed
    assert not fine.inference.equals(failed.inference)


# Bodies


TIMES: dict[str, dict[str, Any]] = {
    "some stop": {"faults.stopped": 0.4, "faults.stopped_from_s": [0.0, 300.0]},
    "batteries": {"faults.battery_empty": 1.0, "faults.battery_life_s": [100.0, 300.0]},
    "first the wheels": {
        "faults.battery_empty": 1.0, "faults.battery_life_s": [100.0, 300.0], "faults.stopped": 0.6,
        "faults.stopped_from_s": [0.0, 300.0],
    },
    "from the start": {"faults.stopped": [0, 2], "run.t_end_s": 200.0},
    "empty from the start": {"faults.battery_empty": [0], "faults.battery_life_s": 0.0, "run.t_end_s": 100.0},
    "a crowd": {"swarm.robots": 30, "faults.stopped": 0.5, "faults.stopped_from_s": [0.0, 60.0], "run.t_end_s": 90.0},
    "timer always on": {"sample.timer": "always", "faults.stopped": 0.6, "faults.stopped_from_s": [0.0, 200.0]},
}  # fmt: skip


@pytest.mark.parametrize("name", TIMES)
def test_both_engines_move_alike_where_robots_stop(name: str) -> None:
    scenario = preset("paper-empirical").with_values({"run.t_end_s": 400.0} | TIMES[name])
    assert_engines_agree(scenario, 5, range(6))


@pytest.mark.parametrize(
    ("values", "first_s"),
    [
        ({"faults.stopped": [0], "faults.stopped_from_s": 100.01}, 100.02),
        ({"faults.stopped": [0]}, 0.0),
        ({"faults.battery_empty": [0], "faults.battery_life_s": 0.0}, 0.0),
    ],
)
def test_a_robot_stops_at_its_time_and_stays_and_the_others_go_round_it(
    values: dict[str, Any], first_s: float
) -> None:
    usual = preset("paper-empirical").with_values({"run.t_end_s": 400.0})
    failed, fine = (simulate(one, 5, range(4), poses=True) for one in (usual.with_values(values), usual))
    changed = 0
    last_s = first_s and first_s + 1.01  # a robot that stands to sample stands for a second at most
    for run in range(4):
        mine, theirs = (one.poses.filter(run=run) for one in (failed, fine))  # type: ignore[union-attr]
        early = mine["time_s"] < first_s - 1e-9
        assert mine.filter(early).drop("kind").equals(theirs.filter(early).drop("kind")), (
            "nothing changes before"
        )
        own = mine.filter((mine["robot"] == 0) & (mine["time_s"] > last_s))
        assert own.select("x_m", "y_m", "heading_rad").is_duplicated().all()
        last = own.row(-1, named=True)
        assert last["kind"] == "stop"
        samples = failed.motion.filter((failed.motion["run"] == run) & (failed.motion["robot"] == 0))
        assert (samples["time_s"] <= last_s).all()
        changed += not mine.filter(mine["robot"] != 0).equals(theirs.filter(theirs["robot"] != 0))
    assert changed > 0, "nobody met it"


def test_robots_that_never_sample_report_nothing() -> None:
    for name in ("fading", "dirichlet"):
        result = simulate(faulty({"stopped": 1.0}, strategy__name=name), 3, 2)
        assert result.reports is not None
        assert result.reports.is_empty()
        assert result.robots["decision"].to_list() == [-1] * result.robots.height


def test_a_robot_that_stops_goes_on_hearing_and_one_with_an_empty_battery_does_not() -> None:
    for kind, hears in (("stopped", True), ("battery_empty", False)):
        scenario = faulty({kind: [0], "stopped_from_s": 20.0, "battery_life_s": 20.0})
        result = simulate(scenario, 8, [0])
        samples = result.motion.filter(result.motion["robot"] == 0)
        assert samples["time_s"].max() < 21.01
        before = result.inference.filter(result.inference["robot"] == 0)["messages_received"][-1]
        received = result.robots["messages_received"]
        assert (received[0] > before + 20) == hears
        assert received[1] > 40
        assert result.ends["stop_start_s"].is_null()[0] == hears
        if not hears:  # since its battery is empty, or since the stop that it then completed
            last = samples.row(-1, named=True)
            assert result.ends["stop_start_s"][0] == (last["stop_start_s"] if last["time_s"] > 20.0 else 20.0)


def test_without_faults_nothing_is_written_about_them() -> None:
    result = simulate(faulty({}), 8, [0])
    assert result.faults is None
    some: Result = simulate(faulty({"stopped": [2], "stopped_from_s": 60.0}), 8, [0, 1])
    assert some.faults is not None
    assert some.faults.rows() == [(0, 2, "stopped", 60.0), (1, 2, "stopped", 60.0)]


def test_the_comparison_sees_a_fault_that_one_way_forgets() -> None:
    """Negative control."""
    scenario = faulty(OPPOSITE | RADIO)
    result = simulate(scenario, 8, [3])
    for kind in ("opposite", "radio_dead"):
        forgets = scenario.with_values({f"faults.{kind}": 0.0})
        plain = plain_run(forgets, 8, result.motion, result.ends, result.observations)
        assert list(differences(result, plain)) != []
