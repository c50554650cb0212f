"""Robots that fail: which of a run, from when on, and what sensors that fail read.

| name | symbol | unit | equation |
|---|---|---|---|
| order | - | - | robots by their uniform number at (seed, run, robot, FAULT, kind): the first n fail |
| n | - | - | share of the swarm times its robots, rounded half up |
| since | - | s | given, or low + (high - low) u, u the robot's second number at that address |
| below | F(theta_E) | - | share of energies below the threshold: 1 - false positives, or false negatives |
| hours | h | h | time since the fault began |
| still | - | - | F(theta_E) - shift - drift h: more false positives, cut off at 0 and 1 |
| vibrating | - | - | F(theta_E) + shift + drift h: more false negatives, cut off at 0 and 1 |
| observation | O | 0, 1 | 1 if u > that share, u the same number as without the fault |

The numbers belong to seed and run, so a larger share contains the robots of a smaller one, and curves over shares are
paired. Each kind has an order of its own, but for sensors stuck at 0 and at 1: these share one, from its two ends, so
that no sensor is stuck at both.

A sensor that is stuck reads its bit whatever it stands on. The energy of a sample is that of the floor in any case: the
fault lies in what the robot makes of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, read_only
from vibroswarm.core.rng import ALONE, FAULT, uniform
from vibroswarm.scenario.fault_fields import FAULTS, SINCE, count_of
from vibroswarm.scenario.scenario import Scenario

NUMBER_OF: Final = {
    "stuck_at_0": 0, "stuck_at_1": 0, "biased": 1, "opposite": 2, "radio_dead": 3, "stopped": 4, "battery_empty": 5,
}  # fmt: skip
"""Index of each kind's random numbers."""
OF_TIME: Final = 1
"""Peer of the number that a fault's time is drawn from."""

FAULT_COLUMNS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "fault": pl.Enum(list(FAULTS)),
    "from_s": pl.Float64,
}
"""Columns of the table of faults, a row for each run, robot and kind that begins before the end of the run."""


def onset_s(scenario: Scenario, seed: int, runs: Sequence[int], kind: str) -> NDArray[np.float64]:
    """Return the time from which each robot has a fault, (runs, robots), s; inf: never.

    Args:
        kind: one of ``FAULTS``.
    """
    robots, affected = scenario.swarm.robots, getattr(scenario.faults, kind)
    onset = np.full((len(runs), robots), math.inf)
    if not affected:
        return onset
    since = getattr(scenario.faults, SINCE[kind])
    for r, run in enumerate(runs):
        for i in _who(scenario, seed, run, kind):
            onset[r, i] = since if isinstance(since, float) else _time_s(since, seed, run, i, kind)
    return onset


def _who(scenario: Scenario, seed: int, run: int, kind: str) -> Sequence[int]:
    """Return the robots of a run that have a fault."""
    affected, robots = getattr(scenario.faults, kind), scenario.swarm.robots
    if isinstance(affected, tuple):
        return affected
    count, number = count_of(affected, robots), NUMBER_OF[kind]
    free = list(range(robots))
    if kind in ("stuck_at_0", "stuck_at_1"):
        other = getattr(scenario.faults, "stuck_at_1" if kind == "stuck_at_0" else "stuck_at_0")
        if isinstance(other, tuple):
            free = [i for i in free if i not in other]
    order = sorted(free, key=lambda i: (uniform(seed, run, i, FAULT, number, ALONE), i))
    if kind == "stuck_at_0":
        order.reverse()
    return order[:count]


def _time_s(since: tuple[float, ...], seed: int, run: int, robot: int, kind: str) -> float:
    """Return the time at which a robot's fault begins, s."""
    low_s, high_s = since
    return low_s + (high_s - low_s) * float(uniform(seed, run, robot, FAULT, NUMBER_OF[kind], OF_TIME))


def working(scenario: Scenario, seed: int, runs: Sequence[int]) -> NDArray[np.bool_]:
    """Return which robots have no fault before the end of the run (``run.t_end_s``), (runs, robots)."""
    fine = np.ones((len(runs), scenario.swarm.robots), dtype=np.bool_)
    for kind in scenario.faults.kinds:
        fine &= onset_s(scenario, seed, runs, kind) >= scenario.run.t_end_s
    return fine


def fault_frame(scenario: Scenario, seed: int, runs: Sequence[int]) -> pl.DataFrame | None:
    """Return the table of faults (``FAULT_COLUMNS``), in the order of run, robot and kind; None: nobody can fail."""
    if not scenario.faults.kinds:
        return None
    numbers = np.array(runs, dtype=np.int64)
    rows: list[tuple[int, int, int, float]] = []
    for place, kind in enumerate(FAULTS):
        onset = onset_s(scenario, seed, runs, kind)
        found, robots = np.nonzero(onset < scenario.run.t_end_s)
        rows += zip(
            numbers[found].tolist(),
            robots.tolist(),
            [place] * found.size,
            onset[found, robots].tolist(),
            strict=True,
        )
    rows.sort()
    run, robot, kinds, since = zip(*rows, strict=True) if rows else ((), (), (), ())
    return pl.DataFrame(
        {"run": run, "robot": robot, "fault": [FAULTS[k] for k in kinds], "from_s": since},
        schema=FAULT_COLUMNS,
    )


def fault_words(kind: str) -> str:
    """Return a kind of fault in words: ``stuck at 1``."""
    return "sends the opposite" if kind == "opposite" else kind.replace("_", " ")


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
