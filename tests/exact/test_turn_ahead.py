"""A turn worked out ahead, by sums and powers of matrices, is the turn taken step by step."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from vibroswarm.motion.event.trajectory import turn_ahead

HORIZON = 250


def stepped(setup, gain, error, integral):
    """(error, integral, gyro) just before each step ahead, as the robot's program does it, until the turn is done."""
    states = []
    for _ in range(HORIZON):
        gyro = gain * min(max(setup.gain * error + setup.integral_gain * integral, -100.0), 100.0)
        states.append((error, integral, gyro))
        error -= gyro
        if abs(error) <= setup.tolerance_deg:
            break
        integral += error * setup.tick_s
    return states


def stable_turn(rng):
    """A controller that is linearly stable, and a turn just begun."""
    while True:
        tick_ms = int(rng.choice([1, 7, 20, 50, 100, 150, 333, 1000]))
        setup = SimpleNamespace(
            gain=math.exp(rng.uniform(math.log(0.05), math.log(100.0))),
            integral_gain=float(rng.choice([0.0, 0.15, math.exp(rng.uniform(math.log(0.01), math.log(50.0)))])),
            tolerance_deg=math.exp(rng.uniform(math.log(0.01), math.log(30.0))),
            tick_ms=tick_ms, tick_s=tick_ms / 1000.0,
        )  # fmt: skip
        gain = math.exp(rng.uniform(math.log(1e-5), math.log(3.0)))
        if gain * (2.0 * setup.gain + setup.tick_s * setup.integral_gain) < 3.9:
            error = rng.uniform(-180.0, 180.0)
            return setup, gain, error, error * setup.tick_s


@pytest.mark.parametrize("block", range(2))
def test_a_turn_worked_out_ahead_is_that_of_single_steps(block):
    rng = np.random.default_rng(block)
    swings = 0
    for _ in range(400):
        setup, gain, error, integral = stable_turn(rng)
        if abs(error) <= setup.tolerance_deg:
            continue
        states = stepped(setup, gain, error, integral)
        beside = stepped(
            setup, gain, error * (1.0 + 1e-12), integral
        )  # at full command some swing rounding up
        swings += any(state[0] * error < 0.0 for state in states)
        planned, *_ = turn_ahead(setup, gain, error, integral, HORIZON)
        assert 1 <= planned <= len(states)  # it may end before the turn does, and is then planned anew
        for n in {planned, *(int(n) for n in rng.integers(1, planned + 1, size=6))}:
            ahead, *state = turn_ahead(setup, gain, error, integral, n)
            assert ahead == n, (setup, gain, error, n)
            rounding = np.abs(np.subtract(states[n - 1], beside[min(n, len(beside)) - 1])).max()
            assert np.abs(np.subtract(state, states[n - 1])).max() <= 1e-9 + 10.0 * rounding, (setup, gain, n)
    assert swings > 20
