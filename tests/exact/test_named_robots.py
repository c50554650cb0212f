"""Robots named one by one, and that they heed no ray just after a turn; all off in the paper."""

from __future__ import annotations

import math

import numpy as np
import polars as pl
import pytest

from helpers.motion_runs import begun
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate

PLAIN = {
    "robot.speed_redraw": "robot",
    "robot.misalignment_min": 0.0,
    "robot.misalignment_max": 0.0,
    "robot.battery_life_s": 1e9,
}
"""Even robots that keep their speeds."""


@pytest.mark.parametrize("engine", [FixedStepRun, EventRun])
def test_each_robot_has_the_body_that_is_named_and_beyond_the_last_it_begins_again(engine) -> None:
    scenario = Scenario().with_values(
        PLAIN | {"robot.speed_factors": [1.0, 1.25], "robot.misalignments": [0.1, -0.2, 0.05], "swarm.robots": 4,
                 "rays.forward_each_m": [0.01, 0.02, 0.03]}
    )  # fmt: skip
    swarm = begun(engine, scenario, 3).swarm
    assert swarm["speed_factor"].tolist() == [1.0, 1.25, 1.0, 1.25]
    assert swarm["misalignment"].tolist() == [0.1, -0.2, 0.05, 0.1]
    assert swarm["ray_forward_m"].tolist() == [0.01, 0.02, 0.03, 0.01]


def test_named_speeds_are_those_that_are_driven() -> None:
    speeds = [0.95, 1.4]
    scenario = Scenario().with_values(
        PLAIN | {"robot.speed_factors": speeds, "swarm.robots": 2, "arena.width_m": 1000.0, "arena.height_m": 1000.0,
                 "walk.leg_min_ms": 1e8, "walk.leg_max_ms": 1e8, "run.t_end_s": 60.0}
    )  # fmt: skip
    motion = simulate(scenario, 1, [0], energies=False).motion.sort("robot", "time_s")
    for robot, speed in enumerate(speeds):
        own = motion.filter(motion["robot"] == robot)
        apart = np.hypot(np.diff(own["x_m"]), np.diff(own["y_m"]))
        # tau, the tick that exceeds it, and the one at which the robot has just sampled.
        np.testing.assert_allclose(apart, speed * 0.0549 * (3.778 // 0.02 + 1) * 0.02, rtol=1e-6)


def blind_spans(blind_ms: float | None) -> list[float]:
    """Driving time between the end of an avoidance and the beginning of the next, s, in a narrow arena."""
    scenario = Scenario().with_values(
        {"arena.width_m": 0.2, "arena.height_m": 0.2, "swarm.robots": 1, "walk.blind_after_turn_ms": blind_ms,
         "sample.sample_interval_ms": 1e6, "walk.leg_min_ms": 1e8, "walk.leg_max_ms": 1e8, "run.t_end_s": 100.0}
    )  # fmt: skip
    paths = simulate(scenario, 4, 1, motion="fixed-step", moves=True).moves
    assert paths is not None
    modes = paths.filter(pl.col("kind") != pl.col("kind").shift(1, fill_value=""))
    before, after = (modes["kind"].shift(by) == "avoid" for by in (1, -1))
    lasted_s = modes["start_s"].shift(-1) - modes["start_s"]
    return lasted_s.filter(before & after & (modes["kind"] == "drive")).to_list()


def test_after_a_turn_no_ray_is_heeded_for_so_long() -> None:
    assert min(blind_spans(310.0)) == pytest.approx(math.ceil(310 / 20) * 0.02)
    # Negative control: without it turns follow each other sooner.
    assert min(blind_spans(None)) < 0.2
