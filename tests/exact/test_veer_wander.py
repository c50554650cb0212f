"""A robot's veer that varies from sample to sample, slowly, and from run to run; off in the paper."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.motion_runs import Taken, begun
from vibroswarm.core.jit import kernel
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.robot_params import AT_ONCE, draw_veer_shifts, setup_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import widest_veer_shift


@kernel
def fill(setup, seed, robot, drawn, out):
    for first in range(0, out.size, AT_ONCE):
        draw_veer_shifts(out[first : first + AT_ONCE], drawn, setup, seed, 0, robot, first)


def shifts(values: dict[str, float], robot: int = 0, count: int = 6000) -> np.ndarray:
    out = np.empty(count)
    fill(setup_of(Scenario().with_values(values)), 5, robot, np.empty((2, AT_ONCE)), out)
    return out


def lagged(values: np.ndarray, lag: int) -> float:
    return float(np.corrcoef(values[lag:], values[:-lag])[0, 1])


def test_it_is_new_at_every_sample() -> None:
    found = shifts({"robot.misalignment_wander": 0.03})
    assert found.std() == pytest.approx(0.03, rel=0.04)
    assert abs(found.mean()) < 0.0015
    assert abs(lagged(found, 1)) < 0.05
    assert not np.array_equal(found, shifts({"robot.misalignment_wander": 0.03}, robot=1))


def test_it_changes_slowly_and_has_its_spread_over_a_run() -> None:
    values = {"robot.misalignment_drift": 0.03, "robot.misalignment_drift_samples": 20}
    found = np.concatenate([shifts(values, robot) for robot in range(5)])
    assert found.std() == pytest.approx(0.03, rel=0.1)
    assert np.abs(np.diff(found[:6000])).max() < 2 * widest(values) / 20 + 1e-12
    assert lagged(found, 2) > 0.95
    assert abs(lagged(found, 60)) < 0.12


def widest(values: dict[str, float]) -> float:
    return widest_veer_shift(Scenario().with_values(values))


def test_it_stays_within_the_bound_that_motion_counts_on() -> None:
    values = {"robot.misalignment_wander": 0.05, "robot.misalignment_drift": 0.04}
    found = np.abs(shifts(values, count=20_000)).max()
    assert 0.6 * widest(values) < found <= widest(values)


@pytest.mark.parametrize("drift_samples", [1, 3, 8, 30])
def test_a_robot_has_the_shift_of_its_latest_sample(drift_samples: int) -> None:
    """At any sample of a block that is drawn at once, its first and its last one too."""
    own = {"robot.misalignments": [0.01, -0.02], "swarm.robots": 2}
    veer = {"robot.misalignment_wander": 0.02, "robot.misalignment_drift": 0.01}
    values = own | veer | {"robot.misalignment_drift_samples": drift_samples}
    state, met = begun(EventRun, Scenario().with_values(values), 5, 0), set()
    for time_s in range(0, 400, 4):
        state.advance(50 * time_s, Taken().sink)
        for robot, misalignment in enumerate(own["robot.misalignments"]):
            samples = int(state.swarm["samples"][robot])
            met.add(samples % AT_ONCE)
            every = misalignment + shifts(values, robot, 400)
            assert state.swarm["misalignment"][robot] == pytest.approx(every[samples], abs=1e-12)
            assert abs(state.swarm["misalignment"][robot] - every[samples + 1]) > 1e-6, "not that of the next"
    assert met == set(range(AT_ONCE))
