"""Recorded acceleration, and the energies of a session computed from it by the robot's own chain (``robot.sensing``).

A file has the columns ``robot`` as in the log, ``time_s`` by the log's clock, and ``ax``, ``ay``, ``az``, or one of
them, in the unit of the energies (or in m/s^2, if their names have a unit). A row is one reading of the accelerometer.
The energy of a sample is computed from the last N readings of its robot up to the time of the sample, which must be
evenly spaced at the rate of the sensing chain. N is the number of readings in the time that the chain takes for one.

The chain measures the magnitude, in which gravity makes vibration along it linear. Without gravity in the readings, as
of phones, of ROS logs and of sensors that are AC-coupled, gravity is added to the axis that is shaken most.

A log without energies has places only. Its samples are then found as the robot takes them: a sample is the last N
readings of a stop. A robot stands between two pauses of the recording; without pauses while its place does not change
(and its heading, if that is recorded), or as a column ``sample`` numbers its stops.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Bools, Floats, wrapped
from vibroswarm.core.numbers import count, number, stated
from vibroswarm.errors import InputError
from vibroswarm.lab.recordings.log import SAMPLES, Log
from vibroswarm.lab.recordings.read_tables import ACCELERATIONS, Use, files_of, plain_name, read_rows
from vibroswarm.observation.observe import sense_program
from vibroswarm.robot.sensing import SenseProgram, SenseState, energy, readings, sense_step
from vibroswarm.scenario.scenario import Scenario

COLUMNS: Final = ("robot", "time_s", *ACCELERATIONS)
"""Columns of a file of acceleration."""
_READING: Final = Use(pl.Float64, -1e9, 1e9, "an acceleration")
_SCHEMA: Final = {
    "robot": SAMPLES["robot"],
    "time_s": Use(pl.Float64, -1e12, 1e12, "a time", required=True),
    **dict.fromkeys(ACCELERATIONS, _READING),
    **{name: SAMPLES[name]._replace(required=False) for name in ("x_m", "y_m", "heading_rad")},
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
LONGEST_STOP: Final = 20
"""Longer stretches, in samples, are not stops."""
AROUND_S: Final = 0.1
"""Speeds of robots are those from so long before to so long after a reading."""
SLOW_M_S: Final = 0.02
SLOW_RAD_S: Final = 0.5
"""A robot stands if it moves, and turns, more slowly than this: less than half of what it drives with."""
CLOCK_S: Final = 0.0011
"""A reading may be this much later than its sample: a little more than a millisecond, to which times are written."""


class Acceleration(NamedTuple):
    """The readings of a session."""

    rows: pl.DataFrame
    """Columns of ``COLUMNS``, and x_m, y_m, heading_rad and sample if the file has them; by robot and time."""
    axes: tuple[str, ...]
    """Those of ``ACCELERATIONS`` that the file has; the others are 0."""
    in_m_s2: bool
    """Whether the names of the columns have a unit."""
    missing: int
    """Readings that are missing."""


def read_acceleration(path: Path, rate_hz: float | None = None) -> Acceleration:
    """Read the acceleration of a session: a file, or a folder of one for each robot.

    Missing readings are left out, or bridged if there are few in a row.

    Args:
        rate_hz: readings per second, from which times are computed where readings have equal times; None: unknown.
    Raises:
        InputError: a column is missing, a cell is no number, or times do not rise; the error names the row.
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
    """Return whether gravity is in the readings of samples, (readings, 3) each.

    Args:
        unit: the one that is stated; readings without gravity are taken to have it.
    """
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
    """Replace the energies of logs by those computed from recorded acceleration, or find their samples in it.

    Args:
        files: the files of acceleration, one for each log in the same order; None to return the logs unchanged.
    Returns: the changed logs, and for each a sentence; without files, the list of sentences is empty.
    Raises:
        InputError: another number of files, timestamps, or see ``computed``.
    """
    if files is None:
        return list(logs), []
    if len(files) != len(logs):
        raise InputError(f"{len(files)} files for {len(logs)} logs; give one per log", field="--acceleration")
    program = sense_program(scenario)
    found = [computed(log, path, program) for log, path in zip(logs, files, strict=True)]
    return [one.log for one in found], [one.words for one in found]


def computed(log: Log, path: Path, program: SenseProgram) -> Computed:
    """Compute the energies of a log from recorded acceleration; of a log of places alone also its samples.

    Args:
        log: of the session; it stays as it is. path: of the acceleration. program: settings of the sensing chain.
    Raises:
        InputError: the file is no such table, its rate is not the chain's, readings of a sample are missing, no stop is
            long enough, or a robot has no places.
    """
    if log.has_timestamps:
        raise InputError(
            "times have to be those of the acceleration: numbers, not timestamps", field=log.name
        )
    found, before = read_acceleration(path, program.rate_hz), log.samples["energy"].to_numpy()
    samples = log.samples
    windows = list(_windows(samples, found.rows, path, program))
    gravity = gravity_in(windows)
    if not gravity.is_there:  # along the axis that is shaken most
        axis = strongest_axis(windows)
        windows = [_along(one[:, axis]) for one in windows]
    energies = np.array([chain_energy(one, program) for one in windows])
    words = (
        f"{log.name}: {samples.height} energies computed from {path} ({readings(program)} readings at "
        f"{stated(program.rate_hz)} Hz each)"
    )
    if before.size and np.isfinite(before).any():
        largest = float(np.nanmax(np.abs(energies - before)))
        words += f"; they differ from the log's by up to {number(largest, digits=3)}"
    if not gravity.is_there:
        words += f"; gravity is not in the readings: computed from a{'xyz'[axis]}, which is shaken most"
    elif gravity.unit != "m/s2":
        words += f"; the mean is {number(gravity.steady, digits=4)}, not gravity in m/s2: energies have another unit"
    if found.missing:
        words += f"; {count(found.missing, 'reading')} missing"
    ordered = samples.with_columns(energy=pl.Series(energies)).sort("time_s", "robot", maintain_order=True)
    return Computed(replace(log, samples=ordered), words)


def _along(values: Floats) -> Floats:
    """Return readings of an axis without gravity as readings, (readings, 3), with gravity along this axis."""
    zeros = np.zeros_like(values)
    return np.column_stack([zeros, zeros, values - values.mean() + GRAVITY["m/s2"]])


def _windows(
    samples: pl.DataFrame, rows: pl.DataFrame, path: Path, program: SenseProgram
) -> Iterator[Floats]:
    """Yield the readings, (readings, 3), from which a robot computed the energy of each sample.

    Raises:
        InputError: too few readings, another rate than the chain's, a gap, or readings of an earlier stop.
    """
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


def stops_of(rows: pl.DataFrame, signal_s: float, stop_s: float | None = None) -> Iterator[pl.DataFrame]:
    """Yield the readings of each stop of one robot.

    Args:
        rows: readings of one robot (``read_acceleration``): stops are those that a column ``sample`` numbers; otherwise
            they end at pauses. A stretch longer than ``LONGEST_STOP`` samples is cut where the robot moves, if x_m and
            y_m (and heading_rad) are there.
        signal_s: time of a sample. stop_s: length of the pieces into which stretches are cut instead; None: they are
            not.
    """
    if "sample" in rows.columns:
        yield from rows.partition_by("sample", maintain_order=True)
        return
    time_s = rows["time_s"].to_numpy()
    steps = np.diff(time_s)
    cuts = steps > WIDEST_GAP * (float(np.median(steps)) if steps.size else 0.0)
    for piece in _cut(rows, cuts):
        at_s = piece["time_s"].to_numpy()
        if stop_s is not None:
            yield from _cut(piece, np.diff(np.floor((at_s - at_s[0]) / stop_s + 1e-9)) > 0)
        elif at_s[-1] - at_s[0] > LONGEST_STOP * signal_s:
            stands = _stands(piece, at_s)
            parts = _cut(piece.with_columns(stands=stands), np.diff(stands))
            yield from (part.drop("stands") for part in parts if part["stands"][0])
        else:
            yield piece


def _cut(rows: pl.DataFrame, cuts: Bools) -> Iterator[pl.DataFrame]:
    """Yield the parts of a table between cuts, (rows - 1): whether it is cut after each row."""
    for low, high in pairwise([0, *(np.flatnonzero(cuts) + 1).tolist(), rows.height]):
        yield rows[low:high]


def _stands(rows: pl.DataFrame, time_s: Floats) -> Bools:
    """Return at which readings a robot stands, as far as its places tell."""
    first = np.searchsorted(time_s, time_s - AROUND_S)
    last = np.searchsorted(time_s, time_s + AROUND_S, side="right") - 1
    stands, between_s = np.ones(time_s.size, dtype=np.bool_), time_s[last] - time_s[first]
    if {"x_m", "y_m"} <= set(rows.columns):
        x_m, y_m = rows["x_m"].to_numpy(), rows["y_m"].to_numpy()
        stands &= np.hypot(x_m[last] - x_m[first], y_m[last] - y_m[first]) <= SLOW_M_S * between_s
    if "heading_rad" in rows.columns:
        turned_rad = rows["heading_rad"].to_numpy()[last] - rows["heading_rad"].to_numpy()[first]
        stands &= np.abs(wrapped(turned_rad)) <= SLOW_RAD_S * between_s
    return stands


def chain_energy(acceleration: Floats, program: SenseProgram) -> float:
    """Compute the energy of one sample by the robot's sensing chain.

    Args:
        acceleration: ax, ay, az of the readings of one stop, in the order of time, (readings, 3).
        program: settings of the sensing chain.
    """
    # The function without Numba, since compiling it takes longer than thousands of calls.
    step: Any = getattr(sense_step, "py_func", sense_step)
    state = SenseState(magnitude=0.0, filtered=0.0, squares=0.0, taken=0)  # before the first reading
    for ax, ay, az in acceleration.tolist():
        state = step(state, program, ax, ay, az)
    return energy(state)
