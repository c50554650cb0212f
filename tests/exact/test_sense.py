"""The sensing chain against scipy.signal, and the numbers that are known of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from vibroswarm.robot.sensing import (
    SenseProgram,
    SenseState,
    begin_sense,
    energy,
    high_pass,
    sense_step,
)

RATE_HZ = 350.0


def sensed(program: SenseProgram, acceleration: np.ndarray) -> tuple[SenseState, np.ndarray]:
    state, filtered = begin_sense(), []
    for ax, ay, az in acceleration.tolist():
        state = sense_step(state, program, ax, ay, az)
        filtered.append(state.filtered)
    return state, np.array(filtered)


def shaken(seed: int, count: int = 175) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = np.arange(count) / RATE_HZ
    shake = np.stack(
        [a * np.sin(2 * np.pi * f * t) for a, f in ((0.5, 90.0), (0.3, 60.0), (2.0, 120.0))], axis=1
    )
    return np.array([0.0, 0.0, 9.81]) + shake + rng.normal(0, 0.1, (count, 3))


@pytest.mark.parametrize("settled", [True, False])
@pytest.mark.parametrize("coefficients", [(0.20, 0.60, -0.60), high_pass(40.0), (0.5, 0.9, -0.3)])
def test_the_filter_is_scipys(coefficients: tuple[float, float, float], settled: bool) -> None:
    a, b0, b1 = coefficients
    program = SenseProgram(feedback=a, forward=b0, before=b1, settled=settled)
    for seed in range(5):
        acceleration = shaken(seed)
        magnitude = np.sqrt((acceleration**2).sum(axis=1))
        start = signal.lfilter_zi([b0, b1], [1.0, -a]) * magnitude[0] if settled else np.zeros(1)
        wanted, _ = signal.lfilter([b0, b1], [1.0, -a], magnitude, zi=start)
        state, filtered = sensed(program, acceleration)
        assert np.allclose(filtered, wanted, atol=1e-12)
        assert energy(state) == pytest.approx(np.sqrt((wanted**2).mean()), rel=1e-12)


def test_gravity_alone_adds_0_45_when_started_from_zero() -> None:
    still = np.tile([0.0, 0.0, 9.81], (175, 1))
    assert energy(sensed(SenseProgram(settled=False), still)[0]) == pytest.approx(0.45, abs=0.005)
    assert energy(sensed(SenseProgram(settled=True), still)[0]) == 0.0
    assert energy(begin_sense()) == 0.0
