"""A robot's speed that wanders at samples about its own: its distribution, its bounds, and off in the paper."""

from __future__ import annotations

import numpy as np
from scipy import stats

from vibroswarm.core.jit import kernel
from vibroswarm.motion.robot_params import AT_ONCE, draw_speed_factors, setup_of, speed_quantiles
from vibroswarm.scenario.scenario import Scenario, preset


@kernel
def fill(setup, speeds, robot, out):
    for first in range(0, out.size, AT_ONCE):
        draw_speed_factors(out[first : first + AT_ONCE], setup, speeds, 5, 0, robot, first)


def factors(scenario: Scenario, robot: int = 0, count: int = 4000) -> np.ndarray:
    out = np.empty(-(-count // AT_ONCE) * AT_ONCE)
    fill(setup_of(scenario), speed_quantiles(scenario.robot), robot, out)
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
