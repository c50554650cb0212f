"""The turn controllers that are called unstable are those whose turns swing up, step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vibroswarm.motion.robot_params import (
    is_stable,
    passes_tolerance,
    scenario_warnings,
    spectral_radius,
    turn_gain_deg,
)
from vibroswarm.robot.walk import TURN, Dice, WalkState, walk_step, wheel_commands_percent
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario, preset

GAIN, INTEGRAL = "walk.turn_gain_percent_per_deg", "walk.turn_integral_gain_percent_per_deg_s"


def drawn(rng) -> Scenario:
    """A controller about the bound, of which about half are stable; turns that end are none."""
    period_ms = int(rng.choice([1, 7, 20, 100, 333]))
    values = {
        "run.control_period_ms": period_ms,
        "robot.full_speed_m_s": 0.002 * math.exp(rng.uniform(0.0, 2.0)),
        "robot.turn_track_m": math.exp(rng.uniform(math.log(0.01), math.log(0.1))),
    }
    gain = turn_gain_deg(Scenario().with_values(values))
    bound = math.exp(rng.uniform(math.log(0.2), math.log(5.0))) * 4.0 / gain
    share = float(rng.choice([0.0, rng.uniform(0.01, 0.95)]))
    gains = {
        GAIN: min(0.5 * bound * (1.0 - share), 1e4),
        INTEGRAL: min(bound * share * 1000.0 / period_ms, 1e4),
    }
    return Scenario().with_values(values | gains)


def grows(scenario: Scenario) -> bool:
    """Whether a small error of a turn becomes larger, by the robot's own program, fed with a gyro that is right."""
    from vibroswarm.motion.robot_params import walk_program

    program = walk_program(scenario)._replace(tolerance_deg=1e-300, sample_interval_ms=1e9)
    robot, scale = scenario.robot, 1e-6  # far from full command
    state = WalkState(TURN, TURN, False, 1e9, 0, 0, 0, scale, scale * scenario.tick_s, 1, 0, 0, math.nan)
    largest = []
    for _ in range(20):
        block = 0.0
        for _ in range(100):
            left, right = wheel_commands_percent(state, program)
            speed = 0.01 * robot.full_speed_m_s * robot.speed_factor_max
            gyro = math.degrees(speed * (right - left) / robot.turn_track_m * scenario.tick_s)
            if gyro == 0.0 and state.error_deg == 0.0:
                return False
            state = walk_step(state, program, gyro, math.inf, Dice(0.5, 0.5, 0.5))
            block = max(block, abs(state.error_deg))
        largest.append(block)
        if not 1e-250 < block < 1e-2:
            break
    return largest[-1] > largest[0] if len(largest) > 1 else largest[-1] > scale


def test_unstable_is_what_swings_up():
    rng = np.random.default_rng(3)
    found = []
    while len(found) < 60:
        scenario = drawn(rng)
        radius = spectral_radius(scenario)
        if abs(radius - 1.0) < 3e-3:  # too slow to be seen in 2000 steps
            continue
        assert (radius >= 1.0) == grows(scenario), (scenario.walk, radius)
        found.append(radius)
    assert 15 < sum(radius >= 1.0 for radius in found) < 45


def test_radius_is_that_of_the_matrix_and_of_the_bound():
    rng = np.random.default_rng(4)
    for _ in range(300):
        scenario = drawn(rng)
        g, kp, ki = (
            turn_gain_deg(scenario),
            *(getattr(scenario.walk, name.split(".")[1]) for name in (GAIN, INTEGRAL)),
        )
        dt = scenario.tick_s
        eigenvalues = np.linalg.eigvals([[1 - g * kp, -g * ki], [dt * (1 - g * kp), 1 - dt * g * ki]])
        radius = spectral_radius(scenario)
        if ki > 0.0:
            assert radius == pytest.approx(np.abs(eigenvalues).max(), rel=1e-6)
        assert is_stable(scenario) == (radius < 1.0)


def test_presets_are_stable():
    for name in preset_names():
        assert is_stable(preset(name))
        assert scenario_warnings(preset(name)) == []


def test_turns_that_cannot_pass_their_tolerance_need_no_warning():
    """The fastest robot turns 4.1 degrees a step at most, and is done within 2.5 on either side."""
    scenario = Scenario().with_values({GAIN: 200.0})
    assert spectral_radius(scenario) > 1.0
    assert not passes_tolerance(scenario)
    assert scenario_warnings(scenario) == []
    assert len(scenario_warnings(scenario.with_values({"walk.turn_tolerance_deg": 2.0}))) == 1
