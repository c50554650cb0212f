"""Features of a sample's signal: what a robot can compute of its readings beside their energy.

| name | symbol | unit | equation |
|---|---|---|---|
| signal | s_i | as measured | readings of the magnitude after the high-pass |
| band | B(f) | as measured, squared | 2 abs(X)^2 / n^2, X = sum of s_i exp(-2 pi j f i / rate): A^2 / 2 of a sine of amplitude A at f |
| peak_hz | f_p | Hz | frequency of the largest bin of the Hann-windowed spectrum, by a parabola through three bins |
| peak_height | - | as measured | amplitude of the sine at f_p, to 4 % |
| variance | m_2 | as measured, squared | second central moment |

All take a fixed memory: the variance is two sums, a band is Goertzel's recursion of two numbers, and the spectrum needs
``POINTS`` readings and as many numbers beside. Of a longer signal it takes the first ``POINTS`` readings.
"""  # noqa: E501

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel

POINTS: Final = 256
"""Number of points of the spectrum, a power of two. A shorter signal is padded with zeros."""

LEAST: Final = 1e-37
"""Power that stands for 0 in a logarithm: a robot's float holds it, too."""


@kernel
def signal_variance(signal: NDArray[np.float64]) -> float:
    """Return m_2, the variance of a signal of at least one reading."""
    total = squares = 0.0
    for i in range(signal.shape[0]):
        total += signal[i]
        squares += signal[i] * signal[i]
    mean = total / signal.shape[0]
    return float(max(squares / signal.shape[0] - mean * mean, 0.0))


class Band(NamedTuple):
    """Goertzel's recursion for one frequency: its last two numbers."""

    last: float
    before: float


@kernel
def band_coefficient(band_hz: float, rate_hz: float) -> float:
    """Return 2 cos(2 pi f / rate), the coefficient of ``band_step``."""
    return 2.0 * math.cos(2.0 * math.pi * band_hz / rate_hz)


@kernel
def band_step(band: Band, coefficient: float, value: float) -> Band:
    """Return the recursion after one more reading of the signal."""
    return Band(value + coefficient * band.last - band.before, band.last)


@kernel
def band_energy(band: Band, coefficient: float, taken: int) -> float:
    """Return B(f) after ``taken`` readings, at least one."""
    power = band.last * band.last + band.before * band.before - coefficient * band.last * band.before
    return 2.0 * power / (float(taken) * float(taken))


@kernel
def transform(real: NDArray[np.float64], imaginary: NDArray[np.float64]) -> None:
    """Replace complex numbers by their discrete Fourier transform, in place (radix 2, decimation in time)."""
    n = real.shape[0]
    j = 0
    for i in range(1, n):  # numbers in the order of their indices' reversed bits
        bit = n // 2
        while j >= bit:
            j -= bit
            bit = bit // 2
        j += bit
        if i < j:
            real_i, imaginary_i = real[i], imaginary[i]
            real[i], imaginary[i] = real[j], imaginary[j]
            real[j], imaginary[j] = real_i, imaginary_i
    half = 1
    while half < n:
        # One rotation for all butterflies with the same place in their block; each follows from the one before, as a
        # robot's sine takes as long as ten products.
        turn_cosine, turn_sine = math.cos(math.pi / half), -math.sin(math.pi / half)
        cosine, sine = 1.0, 0.0
        for k in range(half):
            for block in range(n // (2 * half)):
                upper = 2 * half * block + k
                lower = upper + half
                turned_real = cosine * real[lower] - sine * imaginary[lower]
                turned_imaginary = cosine * imaginary[lower] + sine * real[lower]
                real[lower], imaginary[lower] = real[upper] - turned_real, imaginary[upper] - turned_imaginary
                real[upper], imaginary[upper] = real[upper] + turned_real, imaginary[upper] + turned_imaginary
            next_cosine = turn_cosine * cosine - turn_sine * sine
            sine = turn_cosine * sine + turn_sine * cosine
            cosine = next_cosine
        half *= 2


class Peak(NamedTuple):
    """The largest peak of a spectrum."""

    hz: float
    height: float
    """Amplitude of the sine at this frequency."""


@kernel
def spectrum_peak(
    signal: NDArray[np.float64],
    taken: int,
    rate_hz: float,
    real: NDArray[np.float64],
    imaginary: NDArray[np.float64],
) -> Peak:
    """Return the largest peak of the spectrum of a signal."""
    points = real.shape[0]
    count = min(taken, points)
    for i in range(points):
        real[i], imaginary[i] = 0.0, 0.0
    # Hann's window, 1/2 - 1/2 cos(2 pi (i + 1/2) / count); the cosine of each reading follows from the one before.
    turn_cosine, turn_sine = math.cos(2.0 * math.pi / count), math.sin(2.0 * math.pi / count)
    cosine, sine = math.cos(math.pi / count), math.sin(math.pi / count)
    for i in range(count):
        real[i] = (0.5 - 0.5 * cosine) * signal[i]
        next_cosine = turn_cosine * cosine - turn_sine * sine
        sine = turn_cosine * sine + turn_sine * cosine
        cosine = next_cosine
    transform(real, imaginary)
    best, largest = 1, -1.0
    for k in range(1, points // 2):
        power = power_of(real, imaginary, k)
        if power > largest:
            best, largest = k, power
    if largest <= 0.0:
        return Peak(0.0, 0.0)
    # The logarithm of a window's main lobe is nearly a parabola, whose top lies between bins.
    low = math.log(max(power_of(real, imaginary, best - 1), LEAST))
    middle = math.log(largest)
    high = math.log(max(power_of(real, imaginary, best + 1), LEAST))
    bend = low - 2.0 * middle + high
    shift = 0.5 * (low - high) / bend if bend < 0.0 else 0.0
    shift = min(max(shift, -0.5), 0.5)
    top = middle - 0.25 * (low - high) * shift
    # Hann's window has the mean 1/2, so that a sine of amplitude A has a line of height A count / 4.
    return Peak((best + shift) * rate_hz / points, 4.0 * math.exp(0.5 * top) / count)


@kernel
def power_of(real: NDArray[np.float64], imaginary: NDArray[np.float64], k: int) -> float:
    """Return the squared magnitude of bin ``k``."""
    power: float = real[k] * real[k] + imaginary[k] * imaginary[k]
    return power


@kernel
def alias_hz(frequency_hz: float, rate_hz: float) -> float:
    """Return the frequency, from 0 to half of the rate, at which readings at this rate show a frequency."""
    folded = frequency_hz - rate_hz * math.floor(frequency_hz / rate_hz)
    return min(folded, rate_hz - folded)
