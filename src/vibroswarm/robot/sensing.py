"""From acceleration to a bit: the robot's sensing during a stop (Algorithm 2).

| name | symbol | unit | equation |
|---|---|---|---|
| magnitude | a_i | as measured | sqrt(ax^2 + ay^2 + az^2) |
| filtered | a^_i | as measured | alpha_1 a^_(i-1) + alpha_2 a_i + alpha_3 a_(i-1): a first-order high-pass |
| energy | E | as measured | sqrt(mean of a^_i^2) over the n = rate * signal readings |
| observation | O | 0, 1 | 1 if E > theta_E |

The robots ran with alpha = (0.20, 0.60, -0.60) at 350 Hz, which has its -3 dB point at 65.5 Hz. The cutoff of 40 Hz
that the paper states would need (0.454, 0.727, -0.727) (``high_pass``). A filter that starts from zero responds to
gravity as to a step, which alone adds 0.45 to the RMS over half a second. With ``settled`` the filter starts as if all
readings before the first had been equal to it.

A robot stands for ``settle_ms``, then reads for ``signal_ms``: 500 ms each, which together are the scenario's
``sample.stop_ms``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel


class SenseProgram(NamedTuple):
    """Parameters of sensing; units in the names."""

    rate_hz: float = 350.0
    settle_ms: float = 500.0
    signal_ms: float = 500.0
    feedback: float = 0.20
    """alpha_1."""
    forward: float = 0.60
    """alpha_2."""
    before: float = -0.60
    """alpha_3."""
    settled: bool = True
    """Start the filter settled on the first reading (else from zero)."""


class SenseState(NamedTuple):
    """What the robot keeps between two readings."""

    magnitude: float
    """a_(i-1), of the last reading."""
    filtered: float
    """a^_(i-1), of the last reading."""
    squares: float
    """Sum of a^_i^2 over the readings so far."""
    taken: int
    """Number of readings so far."""


@kernel
def begin_sense() -> SenseState:
    """Return the state before the first reading."""
    return SenseState(0.0, 0.0, 0.0, 0)


@kernel
def readings(program: SenseProgram) -> int:
    """Return n, the number of readings of the accelerometer in the time ``signal_ms`` of a sample."""
    return round(program.rate_hz * program.signal_ms / 1000.0)


@kernel
def sense_step(state: SenseState, program: SenseProgram, ax: float, ay: float, az: float) -> SenseState:
    """Return the state after one more reading (ax, ay, az) of the accelerometer."""
    magnitude = math.sqrt(ax * ax + ay * ay + az * az)
    last, filtered = state.magnitude, state.filtered
    if state.taken == 0 and program.settled:  # start in the filter's steady state for this reading
        last = magnitude
        filtered = (program.forward + program.before) / (1.0 - program.feedback) * magnitude
    filtered = program.feedback * filtered + program.forward * magnitude + program.before * last  # Eq. 14
    return SenseState(magnitude, filtered, state.squares + filtered * filtered, state.taken + 1)


@kernel
def energy(state: SenseState) -> float:
    """Return E, the root mean square of the readings so far; 0 before the first."""
    return math.sqrt(state.squares / state.taken) if state.taken > 0 else 0.0  # Algorithm 2


class ClassBorders(NamedTuple):
    """Which class a robot reads of a value of its own sensor."""

    least: NDArray[np.float64]
    """(classes - 1,), ascending: the least value that reads as class 1, 2 and so on; inf: none does."""


@kernel
def class_read(borders: ClassBorders, value: float) -> int:
    """Return the class of a value: how many borders are at or below it."""
    found = 0
    for k in range(borders.least.size):
        if value >= borders.least[k]:
            found = k + 1
    return found


@kernel
def observation(state: SenseState, rms_threshold: float) -> int:
    """Return the observation O: 1 if E > ``rms_threshold`` (theta_E), else 0 (Eq. 15)."""
    return 1 if energy(state) > rms_threshold else 0  # Eq. 15


def high_pass(cutoff_hz: float, rate_hz: float = 350.0) -> tuple[float, float, float]:
    """Return (alpha_1, alpha_2, alpha_3) of a first-order Butterworth high-pass with -3 dB at ``cutoff_hz``."""
    # The bilinear transform distorts frequencies; the tangent compensates this, so that the cutoff is exact.
    bend = math.tan(math.pi * cutoff_hz / rate_hz)
    forward = 1.0 / (1.0 + bend)
    return (1.0 - bend) / (1.0 + bend), forward, -forward


def cutoff_hz(feedback: float, rate_hz: float = 350.0) -> float:
    """Return the -3 dB point (Hz) of a high-pass with alpha_3 = -alpha_2, by its alpha_1 alone.

    With a = alpha_1, b = alpha_2, c = cos(2 pi frequency / rate), |H|^2 = b^2 (2 - 2 c) / (1 + a^2 - 2 a c), largest
    at c = -1.
    """
    half = 2.0 / (1.0 + feedback) ** 2  # half of the largest |H|^2, for b = 1
    cosine = (2.0 - half * (1.0 + feedback**2)) / (2.0 - 2.0 * feedback * half)
    return math.acos(cosine) * rate_hz / (2.0 * math.pi)
