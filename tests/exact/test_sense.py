"""The sensing chain against scipy.signal, and the numbers that are known of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from vibroswarm.errors import InputError
from vibroswarm.observation.observe import sense_program
from vibroswarm.robot.sensing import (
    SenseProgram,
    SenseState,
    begin_sense,
    cutoff_hz,
    energy,
    high_pass,
    observation,
    readings,
    sense_step,
)
from vibroswarm.scenario.scenario import Scenario

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


@given(st.floats(1.0, 170.0), st.floats(345.0, 2000.0))
def test_a_cutoff_gives_the_butterworth_filter(cutoff: float, rate: float) -> None:
    numerator, denominator = signal.butter(1, cutoff, "high", fs=rate)
    feedback, forward, before = high_pass(cutoff, rate)
    assert np.allclose([forward, before], numerator, atol=1e-12)
    assert feedback == pytest.approx(-denominator[1], abs=1e-12)
    assert cutoff_hz(feedback, rate) == pytest.approx(cutoff, rel=1e-6)


def test_what_is_known_of_the_robots_filter() -> None:
    assert cutoff_hz(0.20) == pytest.approx(65.5, abs=0.05)
    assert high_pass(40.0) == pytest.approx((0.454, 0.727, -0.727), abs=0.0006)
    _, response = signal.freqz([0.6, -0.6], [1.0, -0.2], worN=[cutoff_hz(0.20)], fs=RATE_HZ)
    assert abs(response[0]) ** 2 == pytest.approx(0.5, abs=1e-9)
    assert readings(SenseProgram()) == 175


def test_gravity_alone_adds_0_45_when_started_from_zero() -> None:
    still = np.tile([0.0, 0.0, 9.81], (175, 1))
    assert energy(sensed(SenseProgram(settled=False), still)[0]) == pytest.approx(0.45, abs=0.005)
    assert energy(sensed(SenseProgram(settled=True), still)[0]) == 0.0
    assert energy(begin_sense()) == 0.0


def test_the_bit_is_strict() -> None:
    state, _ = sensed(SenseProgram(), shaken(1))
    assert observation(state, energy(state)) == 0
    assert observation(state, np.nextafter(energy(state), 0.0)) == 1
    longer = SenseProgram(signal_ms=1000.0)
    assert readings(longer) == 350


def test_stop_and_signal_are_fields_of_the_scenario() -> None:
    assert sense_program(Scenario()) == SenseProgram()
    longer = Scenario().with_values({"sample.stop_ms": 1500.0, "sample.signal_ms": 1200.0})
    program = sense_program(longer)
    assert (program.settle_ms, program.signal_ms) == (300.0, 1200.0)
    assert readings(program) == 420
    short = sense_program(Scenario().with_values({"sample.stop_ms": 600.0}))
    assert (short.settle_ms, short.signal_ms) == (300.0, 300.0)
    with pytest.raises(InputError, match=r"sample.signal_ms: 1200.0 is longer than the stop"):
        Scenario().with_values({"sample.signal_ms": 1200.0})
