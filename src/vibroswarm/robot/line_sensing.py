"""Which kind of tile a robot stands on, by the largest line of its vibration: several motors, one for each kind.

| name | symbol | unit | equation |
|---|---|---|---|
| signal | s_i | as measured | filtered readings of the magnitude, or of one axis: means of ``every`` in a row |
| peak | f_p | Hz | frequency of the largest line of the signal (``features.spectrum_peak``) |
| seen | f_k | Hz | frequency of the motor of kind k, as the rate folds it |
| reading | O | - | 0 if E is at most theta_E; else the kind k, from 1, with the least abs(f_p - f_k), the first |

The signal is kept while it is read. Its spectrum takes longer than a control period, so it is computed afterwards, in
memory that is left alone until then.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.robot.features import POINTS


class LineProgram(NamedTuple):
    """Parameters."""

    axis: int
    """0: the signal is of the magnitude; 1, 2, 3: of x, y, z."""
    seen_hz: NDArray[np.float64]
    """(kinds - 1,): f_k."""
    every: int
    """Number of successive readings whose mean is one of the signal (``features.block_means``)."""


class Wave(NamedTuple):
    """What a robot keeps of a sample's signal."""

    signal: NDArray[np.float64]
    """s_i: as many as a sample has, at most ``POINTS``."""
    real: NDArray[np.float64]
    imaginary: NDArray[np.float64]
    """(POINTS,): the spectrum."""
    taken: int
    """Number of readings in ``signal``, set when the sample is taken."""
    last: float
    """The axis's last reading."""
    filtered: float
    """The axis's last number of the filtered signal."""
    waits: bool
    """Whether a signal waits for its spectrum."""


def empty_wave(readings: int, every: int) -> Wave:
    """Return the memory for samples of so many readings, of which means of ``every`` are kept."""
    return Wave(
        np.zeros(min(readings // every, POINTS)), np.zeros(POINTS), np.zeros(POINTS), 0, 0.0, 0.0, False
    )


@kernel
def kind_of_line(peak_hz: float, seen_hz: NDArray[np.float64]) -> int:
    """Return the kind whose motor is seen nearest to a peak."""
    nearest = 0
    for k in range(1, seen_hz.size):
        if abs(peak_hz - seen_hz[k]) < abs(peak_hz - seen_hz[nearest]):
            nearest = k
    return nearest + 1
