"""What a sensor that fails reads.

| name | symbol | unit | equation |
|---|---|---|---|
| below | F(theta_E) | - | share of energies below the threshold: 1 - false positives, or false negatives |
| hours | h | h | time since the fault began |
| still | - | - | F(theta_E) - shift - drift h: more false positives, cut off at 0 and 1 |
| vibrating | - | - | F(theta_E) + shift + drift h: more false negatives, cut off at 0 and 1 |
| observation | O | 0, 1 | 1 if u > that share, u the same number as without the fault |

A sensor that is stuck reads its bit whatever it stands on. The energy of a sample is that of the floor in any case: the
fault lies in what the robot makes of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, read_only
from vibroswarm.faults.assignment import onset_s
from vibroswarm.scenario.scenario import Scenario

PER_H: Final = 1.0 / 3600.0


class SensorFaults(NamedTuple):
    """The sensors of some runs that fail, (runs, robots) each unless stated; of no rows if none does."""

    at_0_from_s: NDArray[np.float64]
    """Since when a sensor is stuck at 0, s; inf: never. ``at_1_from_s``, ``biased_from_s``: likewise."""
    at_1_from_s: NDArray[np.float64]
    biased_from_s: NDArray[np.float64]
    shifts: NDArray[np.float64]
    """(4,): shift and drift per s of the false positives, then of the false negatives."""


_NONE: Final = read_only(np.empty((0, 0)))
NO_SENSOR_FAULTS: Final = SensorFaults(_NONE, _NONE, _NONE, read_only(np.zeros(4)))


def sensor_faults(scenario: Scenario, seed: int, runs: Sequence[int]) -> SensorFaults:
    """Return the sensors that fail in some runs."""
    faults = scenario.faults
    if not (faults.stuck_at_0 or faults.stuck_at_1 or faults.biased):
        return NO_SENSOR_FAULTS
    at_0, at_1, biased = (
        read_only(onset_s(scenario, seed, runs, kind)) for kind in ("stuck_at_0", "stuck_at_1", "biased")
    )
    shifts = np.array(
        [
            faults.false_positive_shift,
            faults.false_positive_drift_per_h * PER_H,
            faults.false_negative_shift,
            faults.false_negative_drift_per_h * PER_H,
        ]
    )
    return SensorFaults(at_0, at_1, biased, read_only(shifts))


def of_run(faults: SensorFaults, r: int) -> SensorFaults:
    """Return the faults of run ``r``, counted from the first, alone."""
    at_0, at_1, biased = (onset[r : r + 1] for onset in faults[:3])
    return SensorFaults(at_0, at_1, biased, faults.shifts)


@inner
def observation_of(
    faults: SensorFaults, r: int, i: int, time_s: float, vibrates: bool, u: float, below: float
) -> int:
    """Return the bit that robot ``i`` of run ``r``, counted from the first, reads.

    Args:
        vibrates: whether the tile that it senses does. u: the sample's uniform number. below: share of energies there
            that are not above the threshold, without faults.
    """
    if faults.at_0_from_s.shape[0] == 0:
        return 1 if u > below else 0
    if time_s >= faults.at_1_from_s[r, i]:
        return 1
    if time_s >= faults.at_0_from_s[r, i]:
        return 0
    for_s = time_s - faults.biased_from_s[r, i]
    if for_s >= 0.0:
        if vibrates:
            below += faults.shifts[2] + faults.shifts[3] * for_s
        else:
            below -= faults.shifts[0] + faults.shifts[1] * for_s
    return 1 if u > below else 0
