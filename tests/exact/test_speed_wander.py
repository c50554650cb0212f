"""A robot's speed that wanders at samples, or differs by run, about its own: distribution, bounds, off in the paper."""

from __future__ import annotations

import numpy as np
from scipy import stats

from helpers.motion_runs import begun
from vibroswarm.core.jit import kernel
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.robot_params import AT_ONCE, draw_speed_factors, setup_of, speed_quantiles
from vibroswarm.scenario.scenario import Scenario, preset


@kernel
def fill(setup, speeds, robot, drawn, out):
    for first in range(0, out.size, AT_ONCE):
        draw_speed_factors(out[first : first + AT_ONCE], drawn, setup, speeds, 5, 0, robot, first)


def factors(scenario: Scenario, robot: int = 0, count: int = 4000) -> np.ndarray:
    out = np.empty(-(-count // AT_ONCE) * AT_ONCE)
    fill(setup_of(scenario), speed_quantiles(scenario.robot), robot, np.empty((2, AT_ONCE)), out)
    return out[:count]


WIDE = {"robot.speed_redraw": "robot", "robot.speed_factor_min": 0.1, "robot.speed_factor_max": 3.0}


def test_it_is_triangular_about_the_robots_own_speed() -> None:
    own = factors(Scenario().with_values(WIDE), count=1)[0]
    found = factors(Scenario().with_values(WIDE | {"robot.speed_wander": 0.06}), count=20_000) / own
    half = 0.06 * np.sqrt(6.0)
    triangle = stats.triang(0.5, loc=1 - half, scale=2 * half)
    assert stats.kstest(found, triangle.cdf).pvalue > 1e-3
    assert abs(found.std() - 0.06) < 0.002
    # Negative control: of 10 % more spread; and neighbours are independent.
    wider = stats.triang(0.5, loc=1 - 1.1 * half, scale=2.2 * half)
    assert stats.kstest(found, wider.cdf).pvalue < 1e-3
    assert abs(np.corrcoef(found[1:], found[:-1])[0, 1]) < 0.06


def test_it_stays_within_the_bounds_that_motion_counts_on() -> None:
    values = {"robot.speed_redraw": "robot", "robot.speed_wander": 0.4}
    found = np.concatenate([factors(Scenario().with_values(values), robot, 500) for robot in range(5)])
    assert found.min() == 0.9
    assert found.max() == 1.5


def test_without_it_a_robot_keeps_its_speed() -> None:
    assert preset("paper").robot.speed_wander is None
    kept = factors(Scenario().with_values({"robot.speed_redraw": "robot"}), count=50)
    assert np.unique(kept).size == 1


LISTED = {"robot.speed_redraw": "robot", "robot.speed_factors": [1.0, 1.2], "swarm.robots": 2} | {
    "robot.speed_factor_min": 0.1,
    "robot.speed_factor_max": 3.0,
}


def speeds_at_start(values: dict[str, object], runs: int) -> np.ndarray:
    scenario = Scenario().with_values(values)
    return np.array([begun(EventRun, scenario, 3, run).swarm["speed_factor"].tolist() for run in range(runs)])


def test_a_run_has_another_speed_which_the_robot_keeps() -> None:
    differing = LISTED | {"robot.speed_run_spread": 0.05}
    found = speeds_at_start(differing, 2000) / [1.0, 1.2]
    half = 0.05 * np.sqrt(6.0)
    triangle = stats.triang(0.5, loc=1 - half, scale=2 * half)
    assert stats.kstest(found.ravel(), triangle.cdf).pvalue > 1e-3
    assert abs(np.corrcoef(found.T)[0, 1]) < 0.08
    # Negative controls: 10 % more spread; robots without it; and it does not change within a run.
    wider = stats.triang(0.5, loc=1 - 1.1 * half, scale=2.2 * half)
    assert stats.kstest(found.ravel(), wider.cdf).pvalue < 1e-3
    assert np.unique(speeds_at_start(LISTED, 5), axis=0).tolist() == [[1.0, 1.2]]
    assert np.unique(factors(Scenario().with_values(differing), count=50)).size == 1


def test_runs_that_differ_stay_within_the_bounds_too() -> None:
    found = speeds_at_start({"robot.speed_redraw": "robot", "robot.speed_run_spread": 0.4}, 300)
    assert found.min() == 0.9
    assert found.max() == 1.5
