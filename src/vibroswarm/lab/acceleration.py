"""Recorded acceleration, and the energies of a session computed from it by the robot's own chain (``robot.sensing``).

The energy of a sample is computed from the last N readings of its robot up to the time of the sample, which must be
evenly spaced at the rate of the sensing chain. The chain measures the magnitude, in which gravity makes vibration along
it linear. Without gravity in the readings, gravity is added to the axis that is shaken most.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import count, number, stated
from vibroswarm.core.read_tables import ACCELERATIONS, Use, files_of, plain_name, read_rows
from vibroswarm.errors import InputError
from vibroswarm.observation.observe import sense_program
from vibroswarm.recordings.read import SAMPLES, Log
from vibroswarm.robot.sensing import SenseProgram, SenseState, energy, readings, sense_step
from vibroswarm.scenario.scenario import Scenario

COLUMNS: Final = ("robot", "time_s", *ACCELERATIONS)
"""Columns of a file of acceleration."""
_READING: Final = Use(pl.Float64, -1e9, 1e9, "an acceleration")
_SCHEMA: Final = {
    "robot": SAMPLES["robot"],
    "time_s": Use(pl.Float64, -1e12, 1e12, "a time", required=True),
    **dict.fromkeys(ACCELERATIONS, _READING),
    **{name: SAMPLES[name]._replace(required=False) for name in ("x_m", "y_m")},
    "sample": Use(pl.Int64, 0, 2**31, "a whole number from 0 on"),
}
GRAVITY: Final = {"m/s2": 9.80665, "mm/s2": 9806.65, "g": 1.0}
"""Gravity by unit."""
GRAVITY_WITHIN: Final = 0.2
"""A steady acceleration within this share of gravity is gravity."""
BRIDGED: Final = 3
"""So many missing readings in a row are bridged by a straight line; more are a pause."""
RATE_TOLERANCE: Final = 0.02
"""Relative difference allowed between the readings' rate and the chain's: the accuracy of a microcontroller's clock."""
WIDEST_GAP: Final = 1.6
"""Longest time between consecutive readings, in periods of the chain's rate or in median periods of the readings. In a
longer time a reading is missing."""
CLOCK_S: Final = 0.0011
"""A reading may be this much later than its sample: a little more than a millisecond, to which times are written."""


class Acceleration(NamedTuple):
    """The readings of a session."""

    rows: pl.DataFrame
    """Columns of ``COLUMNS``, and x_m, y_m and sample if the file has them; by robot and time."""
    axes: tuple[str, ...]
    """Those of ``ACCELERATIONS`` that the file has; the others are 0."""
    in_m_s2: bool
    """Whether the names of the columns have a unit."""
    missing: int


def read_acceleration(path: Path, rate_hz: float | None = None) -> Acceleration:
    """Read the acceleration of a session: a file, or a folder of one for each robot.

    Missing readings are left out, or bridged if there are few in a row.

    Args:
        rate_hz: readings per second, from which times are computed where readings have equal times; None: unknown.
    """
    read = read_rows(files_of(path), _SCHEMA)
    axes = tuple(axis for axis in ACCELERATIONS if axis in read.columns)
    if not axes:
        raise InputError(f"has none of the columns {', '.join(ACCELERATIONS)}", field=str(path))
    lacks = pl.any_horizontal(pl.col(axes).is_null())
    few = pl.len().over("robot", lacks.rle_id().over("robot")) <= BRIDGED
    whole = read.rows.with_columns(
        pl.when(few | ~lacks).then(pl.col(axis).interpolate().over("robot")).alias(axis) for axis in axes
    ).drop_nulls(axes)
    parts = whole.partition_by("robot", maintain_order=True)
    if rate_hz is not None:
        parts = [part.with_columns(time_s=_spread(part["time_s"].to_numpy(), rate_hz)) for part in parts]
    rows = pl.concat(parts).with_columns(
        pl.lit(0.0).alias(axis) for axis in ACCELERATIONS if axis not in axes
    )
    late = rows.filter(pl.col("time_s").diff().over("robot") <= 0.0)
    if late.height:
        raise InputError(
            "its time is not after that of the robot's reading before; if a buffer is read at once, state the rate",
            field=f"{late['file'][0]}, row {late['line'][0]}",
        )
    has_unit = plain_name(read.columns[axes[0]].name) != axes[0]
    return Acceleration(rows, axes, has_unit, read.missing + read.rows.select(lacks.sum()).item())


def _spread(time_s: Floats, rate_hz: float) -> Floats:
    """Return times that rise at a rate from each pause on, if some are equal: a buffer is read at once."""
    steps = np.diff(time_s)
    if steps.size == 0 or (steps > 0.0).all() or not (steps > 0.0).any():
        return time_s if steps.any() or time_s.size < 2 else time_s[0] + np.arange(time_s.size) / rate_hz
    pauses = steps > WIDEST_GAP * float(np.median(steps[steps > 0.0]))
    first = np.append(0, np.flatnonzero(pauses) + 1)
    stretch = np.append(0, np.cumsum(pauses))
    return np.asarray(time_s[first][stretch] + (np.arange(time_s.size) - first[stretch]) / rate_hz)


class Gravity(NamedTuple):
    """Whether gravity is in readings, and in which unit."""

    is_there: bool
    unit: str | None
    """One of ``GRAVITY``; None: unknown, that of no unit."""
    steady: float
    """Median length of the mean acceleration of samples."""


def gravity_in(samples: Sequence[Floats], unit: str = "m/s2") -> Gravity:
    """Return whether gravity is in the readings of samples, (readings, 3) each; without it they have ``unit``."""
    steady = float(np.median([np.linalg.norm(one.mean(axis=0)) for one in samples]))
    shaken = float(np.median([np.sqrt(one.var(axis=0).sum()) for one in samples]))
    for name in (unit, *GRAVITY):
        if abs(steady / GRAVITY[name] - 1.0) < GRAVITY_WITHIN and (name == unit or steady > shaken):
            return Gravity(True, name, steady)
    is_unknown = steady > max(shaken, GRAVITY[unit])
    return Gravity(is_unknown, None if is_unknown else unit, steady)


def strongest_axis(samples: Sequence[Floats]) -> int:
    """Return the axis of samples, (readings, 3) each, that is shaken most."""
    return int(np.argmax(np.mean([one.var(axis=0) for one in samples], axis=0)))


class Computed(NamedTuple):
    """A log with energies computed from acceleration."""

    log: Log
    words: str
    """How they were computed, and how far they differ from those that the log had."""


def with_energies(
    logs: Sequence[Log], scenario: Scenario, files: Sequence[Path] | None
) -> tuple[list[Log], list[str]]:
    """Replace the energies of logs by those of recorded acceleration, a file for each log; say how."""
    if files is None:
        return list(logs), []
    if len(files) != len(logs):
        raise InputError(f"{len(files)} files for {len(logs)} logs; give one per log", field="--acceleration")
    program = sense_program(scenario)
    found = [computed(log, path, program) for log, path in zip(logs, files, strict=True)]
    return [one.log for one in found], [one.words for one in found]


def computed(log: Log, path: Path, program: SenseProgram) -> Computed:
    """Compute the energies of a log from recorded acceleration."""
    if log.has_timestamps:
        raise InputError(
            "times have to be those of the acceleration: numbers, not timestamps", field=log.name
        )
    found, samples = read_acceleration(path, program.rate_hz), log.samples
    windows = list(_windows(samples, found.rows, path, program))
    gravity = gravity_in(windows)
    if not gravity.is_there:  # along the axis that is shaken most
        axis = strongest_axis(windows)
        shaken = [one[:, axis] - one[:, axis].mean() for one in windows]
        windows = [np.outer(one + GRAVITY["m/s2"], (0.0, 0.0, 1.0)) for one in shaken]
    energies = np.array([chain_energy(one, program) for one in windows])
    words = (
        f"{log.name}: {samples.height} energies computed from {path} ({readings(program)} readings at "
        f"{stated(program.rate_hz)} Hz each)"
    )
    if samples["energy"].count():
        largest = (samples["energy"] - pl.Series(energies)).abs().max()
        words += f"; they differ from the log's by up to {number(largest, digits=3)}"  # type: ignore[arg-type]  # to polars a maximum may be of dates
    if not gravity.is_there:
        words += f"; gravity is not in the readings: computed from a{'xyz'[axis]}, which is shaken most"
    elif gravity.unit != "m/s2":
        words += f"; the mean is {number(gravity.steady, digits=4)}, not gravity in m/s2: energies have another unit"
    if found.missing:
        words += f"; {count(found.missing, 'reading')} missing"
    ordered = samples.with_columns(energy=pl.Series(energies)).sort("time_s", "robot", maintain_order=True)
    return Computed(replace(log, samples=ordered), words)


def _windows(
    samples: pl.DataFrame, rows: pl.DataFrame, path: Path, program: SenseProgram
) -> Iterator[Floats]:
    """Yield the readings, (readings, 3), from which a robot computed the energy of each sample."""
    count, signal_s = readings(program), program.signal_ms / 1000.0
    by_robot = {
        robot: (own["time_s"].to_numpy(), own.select(ACCELERATIONS).to_numpy())
        for (robot,), own in rows.group_by("robot")
    }
    for robot, at_s in samples.select("robot", "time_s").iter_rows():
        time_s, values = by_robot.get(robot, (np.empty(0), np.empty((0, 3))))
        end = int(np.searchsorted(time_s, at_s + CLOCK_S, side="right"))
        window = slice(max(end - count, 0), end)
        steps = np.diff(time_s[window])
        hz = 1.0 / float(steps.mean()) if steps.size else 0.0
        # Readings without a gap span about signal_s. If they also end more than about signal_s + 0.5 s before the
        # sample, they are those of an earlier stop. The limit leaves room for a sample's row that is written late.
        age_s = at_s - time_s[window.start] if steps.size else np.inf
        is_whole = end >= count and age_s < 2.0 * signal_s + 0.5 and steps.max() < WIDEST_GAP * steps.mean()
        if not is_whole or abs(hz / program.rate_hz - 1.0) > RATE_TOLERANCE:
            raise InputError(
                f"robot {robot}, sample at {stated(at_s)} s: {count} readings in a row at {program.rate_hz:g} Hz up to "
                f"the sample are needed; there are {min(end, count)} at {hz:.4g} Hz",
                field=str(path),
            )
        yield values[window]


def chain_energy(acceleration: Floats, program: SenseProgram) -> float:
    """Compute the energy of one sample by the robot's sensing chain; acceleration is (readings, 3)."""
    # The function without Numba, since compiling it takes longer than thousands of calls.
    step: Any = getattr(sense_step, "py_func", sense_step)
    state = SenseState(magnitude=0.0, filtered=0.0, squares=0.0, taken=0)  # before the first reading
    for ax, ay, az in acceleration.tolist():
        state = step(state, program, ax, ay, az)
    return energy(state)
