"""Features of a signal against NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from vibroswarm.robot.features import (
    POINTS,
    Band,
    Moments,
    alias_hz,
    band_coefficient,
    band_energy,
    band_step,
    begin_moments,
    block_gain,
    block_means,
    crossings_hz,
    kurtosis,
    moments_step,
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


def moments_of(signal: Floats) -> Moments:
    state = begin_moments()
    for value in signal.tolist():
        state = moments_step(state, value)
    return state


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


def test_means_of_blocks_are_numpys_and_keep_a_known_share_of_a_sine() -> None:
    signal, means = noisy(count=175), np.full(POINTS, -1.0)
    assert block_means(signal, 175, 4, means) == 43
    assert means[:43] == pytest.approx(signal[:172].reshape(43, 4).mean(axis=1), rel=1e-12)
    assert (means[43:] == -1.0).all()
    assert block_means(signal, 175, 1, means) == 175
    assert np.array_equal(means[:175], signal)
    assert block_means(np.zeros(9000), 9000, 4, means) == POINTS  # as many as there is room for
    sine = np.sin(2 * np.pi * 90.0 * np.arange(1000) / 1000.0 + 0.3)
    kept = block_means(sine, 1000, 4, means)
    peak = spectrum_peak(means, kept, 250.0, np.empty(POINTS), np.empty(POINTS))
    assert peak.hz == pytest.approx(90.0, abs=0.1)
    assert peak.height < 0.85  # as its means keep 80 %
    assert peak.height / block_gain(90.0, 1000.0, 4) == pytest.approx(1.0, rel=0.04)
    assert block_gain(80.0, 1000.0, 4) == pytest.approx(abs(np.exp(-2j * np.pi * 0.08 * np.arange(4)).mean()))


def test_moments_are_scipys() -> None:
    signal = noisy()
    state = moments_of(signal)
    assert signal_variance(state) == pytest.approx(signal.var(), rel=1e-12)
    assert kurtosis(state) == pytest.approx(stats.kurtosis(signal, fisher=False), rel=1e-9)
    assert state.largest == np.abs(signal).max()
    crossings = np.count_nonzero(np.diff(signal >= 0)) / 2 * RATE_HZ / (signal.size - 1)
    assert crossings_hz(state, RATE_HZ) == pytest.approx(crossings)
    sine = moments_of(np.sin(2 * np.pi * 35.0 * np.arange(1000) / RATE_HZ + 0.1))
    assert kurtosis(sine) == pytest.approx(1.5, rel=1e-6)
    assert crossings_hz(moments_of(np.array([0.0, 1.0, 0.0, 1.0])), RATE_HZ) == 0.0  # 0 counts as positive
    assert abs(crossings_hz(sine, RATE_HZ) - 35.0) < 0.5 * RATE_HZ / 999  # at most one change of sign


def test_a_signal_that_does_not_vary_has_no_features() -> None:
    still = moments_of(np.zeros(20))
    assert (signal_variance(still), kurtosis(still), crossings_hz(still, RATE_HZ)) == (0.0, 0.0, 0.0)
    assert spectrum_peak(np.zeros(20), 20, RATE_HZ, np.empty(POINTS), np.empty(POINTS)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("hz", "seen"), [(165.0, 165.0), (185.0, 165.0), (350.0, 0.0), (360.0, 10.0), (515.0, 165.0)]
)
def test_readings_fold_frequencies(hz: float, seen: float) -> None:
    assert alias_hz(hz, RATE_HZ) == pytest.approx(seen)
    i = np.arange(50)
    same = np.cos(2 * np.pi * seen * i / RATE_HZ)
    assert np.cos(2 * np.pi * hz * i / RATE_HZ) == pytest.approx(same, abs=1e-9)
