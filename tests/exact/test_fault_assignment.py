"""Who fails and since when, and what sensors that fail read: against the definitions, and by their statistics."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vibroswarm.core.rng import Purpose, uniform, uniforms
from vibroswarm.errors import InputError
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.result import Result
from vibroswarm.scenario.disturbance_fields import FAULTS
from vibroswarm.scenario.fault_draws import fault_frame, onset_s, working
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import replay, simulate

RUNS = list(range(40))


def scenario(**faults: Any) -> Scenario:
    return Scenario().with_values({f"faults.{name}": value for name, value in faults.items()})


def who(one: Scenario, kind: str, run: int = 0) -> set[int]:
    return set(np.flatnonzero(np.isfinite(onset_s(one, 7, [run], kind)[0])).tolist())


@pytest.mark.parametrize("kind", FAULTS)
def test_a_larger_share_contains_the_robots_of_a_smaller_one(kind: str) -> None:
    swarm = Scenario().with_values({"swarm.robots": 10})
    for run in RUNS:
        sets = [who(swarm.with_values({f"faults.{kind}": k / 10}), kind, run) for k in range(11)]
        assert [len(one) for one in sets] == list(range(11))
        assert all(smaller < larger for smaller, larger in pairwise(sets))


def test_each_robot_fails_as_often_as_any_other() -> None:
    """Two of five: 400 runs, 160 of each expected; five standard deviations are 49."""
    found = np.isfinite(onset_s(scenario(opposite=0.4), 3, range(400), "opposite"))
    assert (found.sum(axis=1) == 2).all()
    assert (np.abs(found.sum(axis=0) - 160) < 49).all()
    kinds = [
        np.isfinite(onset_s(scenario(**{kind: 0.4}), 3, range(400), kind)) for kind in ("opposite", "stopped")
    ]
    alike = (kinds[0] & kinds[1]).sum() / 800
    assert abs(alike - 0.4) < 0.1, "kinds do not fall on the same robots"


@example(robots=50, share=0.29, other=0.0)  # 14.5, but for rounding errors of the product
@given(robots=st.integers(1, 60), share=st.floats(0, 1), other=st.floats(0, 1))
@settings(max_examples=80, deadline=None, derandomize=True, database=None)
def test_shares_are_rounded_half_up_and_no_sensor_is_stuck_at_both(
    robots: int, share: float, other: float
) -> None:
    values = {
        "swarm.robots": robots,
        "arena.width_m": 3.0,
        "faults.stuck_at_1": share,
        "faults.stuck_at_0": other,
    }
    counts = [math.floor(x * robots + 0.5 + 1e-9) for x in (share, other)]
    if sum(counts) > robots:
        with pytest.raises(InputError, match="stuck at 0 and at 1"):
            Scenario().with_values(values)
        return
    one = Scenario().with_values(values)
    ones, zeros = who(one, "stuck_at_1"), who(one, "stuck_at_0")
    assert [len(ones), len(zeros)] == counts
    assert not ones & zeros


def test_robots_that_are_named_fail_in_every_run() -> None:
    one = scenario(stopped=[3, 1], stopped_from_s=[100.0, 200.0], stuck_at_1=[4], stuck_at_0=0.8)
    times = onset_s(one, 7, RUNS, "stopped")
    assert np.isfinite(times).all(axis=0).tolist() == [False, True, False, True, False]
    drawn = times[:, [1, 3]]
    assert ((drawn >= 100.0) & (drawn <= 200.0)).all()
    assert np.unique(drawn).size == drawn.size
    assert times[5, 1] == 100.0 + 100.0 * uniform(7, 5, 1, int(Purpose.FAULT), 4, 1)
    assert all(who(one, "stuck_at_0", run) == {0, 1, 2, 3} for run in RUNS)


def test_faults_after_the_end_are_none() -> None:
    one = scenario(battery_empty=1.0, battery_life_s=[600.0, 1800.0])
    times = onset_s(one, 7, RUNS, "battery_empty")
    fine = working(one, 7, RUNS)
    assert (fine == (times >= 1200.0)).all()
    assert 0.3 < fine.mean() < 0.7
    table = fault_frame(one, 7, RUNS, np.full(len(RUNS), 1200.0))
    assert table is not None
    assert table.height == (~fine).sum()
    assert sorted(table["from_s"].to_list()) == sorted(times[~fine].tolist())
    assert fault_frame(Scenario(), 7, RUNS, np.full(len(RUNS), 1200.0)) is None
    assert working(Scenario(), 7, RUNS).all()
    at_the_end = scenario(stopped=[0], stopped_from_s=1200.0)
    assert working(at_the_end, 7, [0]).all()
    none = fault_frame(at_the_end, 7, [0], np.full(1, 1200.02))  # a whole tick
    assert none is not None
    assert none.is_empty()


# Sensors


@pytest.fixture(scope="module")
def fine() -> Result:
    return simulate(Scenario(), 5, [0, 1])


def bits(result: Result) -> Any:
    return result.observations["observation"].to_numpy()


def refit(fine: Result, **faults: Any) -> Result:
    return replay(fine, scenario(**faults))


def test_stuck_sensors_read_their_bit_from_then_on_and_the_others_what_they_did(fine: Result) -> None:
    stuck = refit(fine, stuck_at_1=[0], stuck_at_0=[3], sensor_from_s=400.0)
    robot, time_s = (fine.motion[name].to_numpy() for name in ("robot", "time_s"))
    late = time_s >= 400.0
    assert (bits(stuck)[(robot == 0) & late] == 1).all()
    assert (bits(stuck)[(robot == 3) & late] == 0).all()
    rest = ~(np.isin(robot, [0, 3]) & late)
    assert (bits(stuck)[rest] == bits(fine)[rest]).all()
    assert (bits(stuck) != bits(fine)).any()
    assert stuck.observations["energy"].equals(fine.observations["energy"])


def test_biased_sensors_follow_their_definition_sample_by_sample(fine: Result) -> None:
    """The same uniform number, against a threshold that is shifted: drawn here by its address."""
    shift = {"false_positive_shift": 0.1, "false_negative_shift": 0.02}
    drift = {"false_positive_drift_per_h": -0.6, "false_negative_drift_per_h": 1.2}
    biased = refit(fine, biased=[1, 2], sensor_from_s=100.0, **shift, **drift)
    positive, negative = error_rates(Scenario().sensor)
    tiles = {run: fine.floor(run).tiles.ravel() for run in (0, 1)}
    numbers = {(run, i): uniforms(5, run, i, Purpose.SENSING, 400) for run in (0, 1) for i in range(5)}
    expected, changed = [], 0
    rows = zip(*(fine.motion[name].to_list() for name in ("run", "robot", "sample", "time_s")),
               fine.observations["tile"].to_list(), bits(fine).tolist(), strict=True)  # fmt: skip
    for run, robot, sample, time_s, tile, bit in rows:
        u, vibrates = numbers[run, robot][sample], tiles[run][tile] == 1
        faulty, hours = robot in (1, 2) and time_s >= 100.0, (time_s - 100.0) / 3600.0
        false_positive = positive + (0.1 - 0.6 * hours if faulty else 0.0)
        false_negative = negative + (0.02 + 1.2 * hours if faulty else 0.0)
        expected.append(int(u > (false_negative if vibrates else 1.0 - false_positive)))
        changed += expected[-1] != bit
    assert bits(biased).tolist() == expected
    assert changed > 50
