"""Features of a signal against NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from vibroswarm.robot.features import (
    POINTS,
    Band,
    alias_hz,
    band_coefficient,
    band_energy,
    band_step,
    signal_variance,
    spectrum_peak,
    transform,
)

Floats = NDArray[np.float64]
RATE_HZ = 350.0


def noisy(seed: int = 1, count: int = 175, hz: float = 61.3) -> Floats:
    rng = np.random.default_rng(seed)
    t = np.arange(count) / RATE_HZ
    return np.asarray(2.0 * np.sin(2 * np.pi * hz * t + 0.4) + 0.3 * rng.standard_normal(count) + 0.1)


def band_of(signal: Floats, hz: float, rate_hz: float = RATE_HZ) -> float:
    band, coefficient = Band(0.0, 0.0), band_coefficient(hz, rate_hz)
    for value in signal.tolist():
        band = band_step(band, coefficient, value)
    return band_energy(band, coefficient, signal.size)


def test_goertzels_bands_are_those_of_numpys_transform() -> None:
    signal = noisy(count=200)
    right = 2 * np.abs(np.fft.rfft(signal)) ** 2 / signal.size**2
    found = [band_of(signal, k * RATE_HZ / signal.size) for k in range(1, 100)]
    assert found == pytest.approx(right[1:100], rel=1e-9, abs=1e-12)
    assert band_of(signal, 61.25) == pytest.approx(2.0, rel=0.1)  # A^2 / 2


@pytest.mark.parametrize("points", [2, 8, 64, POINTS])
def test_the_transform_is_numpys(points: int) -> None:
    rng = np.random.default_rng(points)
    real, imaginary = rng.standard_normal(points), rng.standard_normal(points)
    right = np.fft.fft(real + 1j * imaginary)
    transform(real, imaginary)
    assert np.abs(real + 1j * imaginary - right).max() < 1e-12 * points


@pytest.mark.parametrize("hz", [20.0, 61.3, 97.7, 140.2, 165.0])
@pytest.mark.parametrize("count", [100, 175, POINTS])
def test_the_peak_is_the_sine(hz: float, count: int) -> None:
    signal = 3.0 * np.sin(2 * np.pi * hz * np.arange(count) / RATE_HZ + 1.0)
    peak = spectrum_peak(signal, count, RATE_HZ, np.empty(POINTS), np.empty(POINTS))
    assert abs(peak.hz - hz) < 0.15 * RATE_HZ / count  # a seventh of what the time resolves
    assert peak.height == pytest.approx(3.0, rel=0.04)  # as its documentation says


def test_the_variance_is_numpys() -> None:
    assert signal_variance(noisy()) == pytest.approx(noisy().var(), rel=1e-12)


def test_a_signal_that_does_not_vary_has_no_features() -> None:
    assert signal_variance(np.zeros(20)) == 0.0
    assert spectrum_peak(np.zeros(20), 20, RATE_HZ, np.empty(POINTS), np.empty(POINTS)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("hz", "seen"), [(165.0, 165.0), (185.0, 165.0), (350.0, 0.0), (360.0, 10.0), (515.0, 165.0)]
)
def test_readings_fold_frequencies(hz: float, seen: float) -> None:
    assert alias_hz(hz, RATE_HZ) == pytest.approx(seen)
    i = np.arange(50)
    same = np.cos(2 * np.pi * seen * i / RATE_HZ)
    assert np.cos(2 * np.pi * hz * i / RATE_HZ) == pytest.approx(same, abs=1e-9)
