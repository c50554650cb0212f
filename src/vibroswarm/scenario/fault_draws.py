"""Faults: which robots of a run fail, from what time on, and what faulty sensors read.

| name | symbol | unit | equation |
|---|---|---|---|
| order | - | - | robots sorted by their uniform number at (seed, run, robot, FAULT, kind): the first n fail |
| n | - | - | share of the swarm that fails times number of robots, rounded half up |
| since | - | s | given, or low + (high - low) u, with u a second uniform number of the robot at that address |
| below | F(theta_E) | - | share of energies at or below the threshold, on still or on vibrating tiles |
| hours | h | h | time since the fault began |
| still | - | - | biased sensor, still tile: F(theta_E) - shift - drift h, so more false positives |
| vibrating | - | - | biased sensor, vibrating tile: F(theta_E) + shift + drift h, so more false negatives |
| observation | O | 0, 1 | 1 if u > that share, with u the same number as without the fault |
| misread | q | - | biased sensor of any kind: shift + drift h; if v < q it reads the class \
O + 1 + floor((k - 1) v / q) modulo the number of classes k, with v a uniform number at \
(seed, run, robot, MISREAD, sample) |

The uniform numbers depend on seed and run only. So the robots that fail at a small share also fail at a larger one, and
curves over the share are paired. Each kind of fault sorts the robots by numbers of its own. But sensors stuck at 0 and
sensors stuck at 1 use the same order, from its end and from its start, so that no sensor is stuck at both.

A stuck sensor reads its class on any tile. The recorded energy of a sample is never changed by a fault: the fault is in
the class that the robot derives from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, read_only, signed
from vibroswarm.core.rng import ALONE, FAULT, MISREAD, uniform
from vibroswarm.scenario.disturbance_fields import FAULTS, SENSOR_FAULTS, SINCE, count_of
from vibroswarm.scenario.scenario import Scenario

NUMBER_OF: Final = {
    "stuck_at_0": 0, "stuck_at_1": 0, "biased": 1, "opposite": 2, "radio_dead": 3, "stopped": 4, "battery_empty": 5,
    "stuck": 6,
}  # fmt: skip
"""Index of each kind's random numbers; the two kinds of stuck sensors share one order of the robots."""
OF_TIME: Final = 1
"""Last part of the address of the number that a fault's time is drawn from (``ALONE``: that of the order)."""

FAULT_COLUMNS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "fault": pl.Enum(list(FAULTS)),
    "from_s": pl.Float64,
}
"""Columns of the table of faults, a row for each run, robot and kind that begins before the end of the run."""


def onset_s(scenario: Scenario, seed: int, runs: Sequence[int], kind: str) -> NDArray[np.float64]:
    """Return the time from which each robot has a fault of one kind, s: (runs, robots), inf for robots without it."""
    robots, affected = scenario.swarm.robots, getattr(scenario.faults, kind)
    onset = np.full((len(runs), robots), math.inf)
    # One time for all robots, or the range that each robot's time is drawn from.
    since = getattr(scenario.faults, SINCE[kind])
    low_s, high_s = since if isinstance(since, tuple) else (since, since)
    for r, run in enumerate(runs if affected else ()):
        for i in _who(scenario, seed, run, kind):
            u = uniform(seed, run, i, FAULT, NUMBER_OF[kind], OF_TIME) if high_s > low_s else 0.0
            onset[r, i] = low_s + (high_s - low_s) * float(u)
    return onset


def _who(scenario: Scenario, seed: int, run: int, kind: str) -> Sequence[int]:
    """Return the robots of a run that have a fault of one kind: those listed, or some drawn to make up a share."""
    affected, robots = getattr(scenario.faults, kind), scenario.swarm.robots
    if isinstance(affected, tuple):
        return affected
    other = {"stuck_at_0": "stuck_at_1", "stuck_at_1": "stuck_at_0"}.get(kind)
    # No sensor is stuck at both: leave out robots that the scenario lists for the other kind. ``check_faults`` has made
    # sure that enough robots are left, and that two shares, taken from both ends of the order, do not meet.
    taken = getattr(scenario.faults, other) if other else ()
    free = set(range(robots)).difference(taken if isinstance(taken, tuple) else ())
    order = sorted(free, key=lambda i: (uniform(seed, run, i, FAULT, NUMBER_OF[kind], ALONE), i))
    if kind == "stuck_at_0":  # taken from the end of the order; "stuck_at_1" is taken from its start
        order.reverse()
    return order[: count_of(affected, robots)]


def working(scenario: Scenario, seed: int, runs: Sequence[int]) -> NDArray[np.bool_]:
    """Return whether each robot has no fault of any kind before ``run.t_end_s``: (runs, robots)."""
    fine = np.ones((len(runs), scenario.swarm.robots), dtype=np.bool_)
    for kind in scenario.faults.kinds:
        fine &= onset_s(scenario, seed, runs, kind) >= scenario.run.t_end_s
    return fine


def fault_frame(
    scenario: Scenario, seed: int, runs: Sequence[int], end_s: NDArray[np.float64]
) -> pl.DataFrame | None:
    """Return the table of faults (``FAULT_COLUMNS``), sorted by run, robot and kind; None if the scenario has none."""
    if not scenario.faults.kinds:
        return None
    numbers, parts = np.array(runs, dtype=np.int64), []  # runs need not be consecutive
    # A run may end with a whole tick after ``t_end_s``.
    until_s = np.minimum(end_s, scenario.run.t_end_s)[:, None]
    for kind in FAULTS:
        onset = onset_s(scenario, seed, runs, kind)
        rows, robots = np.nonzero(onset < until_s)
        found = (numbers[rows], robots, [kind] * robots.size, onset[rows, robots])
        parts.append(pl.DataFrame(dict(zip(FAULT_COLUMNS, found, strict=True)), schema=FAULT_COLUMNS))
    return pl.concat(parts).sort("run", "robot", "fault")


def fault_words(kind: str) -> str:
    """Return a kind of fault in words: ``stuck at 1``."""
    return "sends the opposite" if kind == "opposite" else kind.replace("_", " ")


class SensorFaults(NamedTuple):
    """Faulty sensors of some runs."""

    from_s: NDArray[np.float64]
    """Time from which each sensor has each of ``SENSOR_FAULTS``, s, inf: never: (runs, faults, robots); without rows if
    no sensor can fail."""
    shifts: NDArray[np.float64]
    """(6,): shift and drift per s of the false positive rate, of the false negative rate, and of the share that is read
    as any other class."""
    stuck_class: int


NO_SENSOR_FAULTS: Final = SensorFaults(read_only(np.empty((0, 0, 0))), read_only(np.zeros(6)), stuck_class=0)
"""The faults of runs in which no sensor can fail: without rows of times."""


def sensor_faults(scenario: Scenario, seed: int, runs: Sequence[int]) -> SensorFaults:
    """Return the times from which sensors are faulty in some runs, and how; ``NO_SENSOR_FAULTS`` if none fails."""
    faults = scenario.faults
    if not any(getattr(faults, kind) for kind in SENSOR_FAULTS):
        return NO_SENSOR_FAULTS
    from_s = np.stack([onset_s(scenario, seed, runs, kind) for kind in SENSOR_FAULTS], axis=1)
    per_h = 1.0 / 3600.0
    shifts = np.array(
        [
            faults.false_positive_shift,
            faults.false_positive_drift_per_h * per_h,
            faults.false_negative_shift,
            faults.false_negative_drift_per_h * per_h,
            faults.misread_shift,
            faults.misread_drift_per_h * per_h,
        ]
    )
    return SensorFaults(read_only(from_s), read_only(shifts), faults.stuck_class)


def of_run(faults: SensorFaults, r: int) -> SensorFaults:
    """Return the faults of one run alone, as row 0 of the result; ``r`` is its row in the arrays of ``faults``."""
    return faults._replace(from_s=faults.from_s[r : r + 1])


@inner
def observation_of(
    faults: SensorFaults,
    r: int,
    i: int,
    time_s: float,
    kind: int,
    u: float,
    shares: NDArray[np.float64],
    levels: NDArray[np.float64],
    row: int,
    seed: int,
    run: int,
    sample: int,
) -> int:
    """Return the class that robot ``i`` reads at ``time_s``, with the faults of its sensor, from the number ``u``."""
    below = shares[row, kind, 0]
    if faults.from_s.shape[0] == 0:  # no rows: no sensor can fail
        return class_of(u, below, shares, row, kind)
    stuck = stuck_class_of(faults, r, i, time_s)
    if stuck >= 0:
        return stuck
    # Higher error rates: the sensor reads 0 more often on vibrating tiles, and less often on still ones; in between
    # the contrast weighs both. A share beyond 0 or 1 acts as 0 or 1, because u is strictly between them.
    for_s = time_s - faults.from_s[r, 3, i]  # how long it has been biased
    if for_s >= 0.0:
        contrast = levels[kind]
        below += contrast * (faults.shifts[2] + faults.shifts[3] * for_s)
        below -= (1.0 - contrast) * (faults.shifts[0] + faults.shifts[1] * for_s)
    found = class_of(u, below, shares, row, kind)
    return misread(faults, for_s, found, shares.shape[2] + 1, seed, run, i, sample)


@inner
def stuck_class_of(faults: SensorFaults, r: int, i: int, time_s: float) -> int:
    """Return the class at which the sensor of robot ``i`` is stuck by ``time_s``; -1 if it is not."""
    if time_s >= faults.from_s[r, 1, i]:
        return 1
    if time_s >= faults.from_s[r, 0, i]:
        return 0
    if time_s >= faults.from_s[r, 2, i]:
        return faults.stuck_class
    return -1


@inner
def misread(
    faults: SensorFaults, for_s: float, found: int, classes: int, seed: int, run: int, robot: int, sample: int
) -> int:
    """Return the class that is read in the place of ``found`` by a sensor that has been biased for ``for_s``."""
    share = faults.shifts[4] + faults.shifts[5] * for_s if for_s >= 0.0 else 0.0
    if share <= 0.0:
        return found
    v = uniform(seed, run, robot, MISREAD, sample, ALONE)
    if v >= share:
        return found
    # Where it misreads, v is uniform below the share, or below 1 if that is more.
    other = int(v / min(share, 1.0) * (classes - 1))
    return (found + 1 + min(other, classes - 2)) % classes


@kernel
def apply_faults(
    faults: SensorFaults, run_index: NDArray[np.int64], robot: NDArray[Any], sample: NDArray[Any],
    time_s: NDArray[np.float64], classes: int, seed: int, runs: NDArray[np.int64], observation: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Replace readings, (samples,), of a sensor that depends on the place by those with its faults."""
    if faults.from_s.shape[0] == 0:  # no rows: no sensor can fail
        return
    for k in range(observation.size):
        r, i = run_index[k], signed(robot[k])
        stuck = stuck_class_of(faults, r, i, time_s[k])
        if stuck >= 0:
            observation[k] = stuck
        else:
            for_s = time_s[k] - faults.from_s[r, 3, i]
            found = signed(observation[k])
            observation[k] = misread(faults, for_s, found, classes, seed, runs[r], i, signed(sample[k]))


@inner
def class_of(u: float, below: float, shares: NDArray[np.float64], row: int, kind: int) -> int:
    """Return the reading of a sample: how many of the shares of its row and kind are below its uniform number."""
    found = 1 if u > below else 0
    for j in range(1, shares.shape[2]):  # none, if there are two classes
        if u > shares[row, kind, j]:
            found += 1
    return found
