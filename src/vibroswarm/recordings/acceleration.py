"""Compute the energies of a session from recorded acceleration, by the robot's own sensing chain (``robot.sensing``).

The file is a CSV with a header: ``robot`` as in the log, ``time_s`` by the log's clock, ``ax``, ``ay``, ``az`` in the
unit of the energies. A row is one reading of the accelerometer. The energy of a sample is computed from the last N
readings of its robot up to the time of the sample, which must be evenly spaced at the rate of the sensing chain. N is
the number of readings in the time that the chain takes for a sample.

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

from vibroswarm.core.angles import wrapped
from vibroswarm.core.arrays import Bools, Floats
from vibroswarm.core.numbers import count, number, stated
from vibroswarm.errors import InputError
from vibroswarm.observation.observe import sense_program
from vibroswarm.recordings.column_map import check_columns, check_values, numbers_of, table_of, text_of
from vibroswarm.recordings.log import SAMPLES, Log, log_frame
from vibroswarm.robot.sensing import SenseProgram, SenseState, energy, readings, sense_step
from vibroswarm.scenario.scenario import Scenario

COLUMNS: Final = ("robot", "time_s", "ax", "ay", "az")
"""Columns of a file of acceleration."""
RATE_TOLERANCE: Final = 0.02
"""Relative difference allowed between the readings' rate and the chain's: the accuracy of a microcontroller's clock."""
WIDEST_GAP: Final = 1.6
"""Longest time between consecutive readings, in periods of the chain's rate or in median periods of the readings. In a
longer time a reading is missing."""
LONGEST_STOP: Final = 20
"""A stop of more than so many samples is no stop."""
AROUND_S: Final = 0.1
"""Speeds of robots are those from so long before to so long after a reading."""
SLOW_M_S: Final = 0.02
SLOW_RAD_S: Final = 0.5
"""A robot stands if it moves, and turns, more slowly than this: less than half of what it drives with."""
CLOCK_S: Final = 0.0011
"""A reading may be this much later than its sample: a little more than a millisecond, to which times are written."""


class Computed(NamedTuple):
    """A log with energies computed from acceleration, compared with the energies that it had before."""

    log: Log
    largest_difference: float
    """Largest difference between a computed energy and the one in the log; nan if the log has none."""


def energies_from(log: Log, path: Path, program: SenseProgram) -> Computed:
    """Replace the energies of a log by energies computed from recorded acceleration.

    Args:
        log: of the session. path: CSV file of the acceleration. program: settings of the sensing chain.
    Returns: the new log; ``log`` stays as it is.
    Raises:
        InputError: the file is no such CSV, its times do not increase, its rate is not the chain's, or readings of a
            sample are missing.
    """
    recorded = read_acceleration(path)
    count, found = readings(program), np.empty(log.samples.height)
    # For each robot an array with a row per reading; columns: time, three accelerations, line of the file.
    by_robot = {
        int(robot[0]): frame.select("time_s", "ax", "ay", "az", "line").to_numpy()
        for robot, frame in recorded.group_by("robot", maintain_order=True)
    }
    for robot, rows in by_robot.items():
        late = np.flatnonzero(np.diff(rows[:, 0]) <= 0.0)  # readings whose successor is not later
        if late.size:
            raise InputError(
                f"robot {robot}: its time, {rows[late[0] + 1, 0]:g} s, is not after that of the reading before",
                field=f"{path}, row {rows[late[0] + 1, 4]:.0f}",
            )
    for k, (robot, time_s) in enumerate(log.samples.select("robot", "time_s").iter_rows()):
        rows = by_robot.get(int(robot), np.empty((0, 5)))  # no readings: ``_check_window`` raises the error
        end = int(np.searchsorted(rows[:, 0], time_s + CLOCK_S, side="right"))
        window = rows[max(end - count, 0) : end]
        _check_window(window, count, int(robot), float(time_s), program, path)
        found[k] = chain_energy(window[:, 1:4], program)
    before = log.samples["energy"].to_numpy()
    difference = np.abs(found - before)
    largest = float(np.nanmax(difference)) if np.isfinite(difference).any() else float("nan")
    samples = log.samples.with_columns(energy=pl.Series(found))
    return Computed(replace(log, samples=samples), largest_difference=largest)


def samples_found(log: Log, path: Path, program: SenseProgram) -> Computed:
    """Find the samples of a log of places alone in recorded acceleration: one at the end of each long enough stop.

    Args:
        log: of the session, without samples. path: CSV file of the acceleration. program: settings of the chain.
    Returns: the log with samples at the places that it had at their times.
    Raises:
        InputError: as for ``energies_from``; or no stop is long enough, or a robot has no places.
    """
    count, rows = readings(program), []
    for (robot,), own in read_acceleration(path, optional=("sample",)).group_by("robot", maintain_order=True):
        track = log.tracks.filter(pl.col("robot") == robot).sort("time_s")
        if track.is_empty():
            raise InputError(f"has no places of robot {robot:g}, which {path} has", field=log.name)
        placed = own.with_columns(**_places_at(track, own["time_s"].to_numpy()))
        stops = stops_of(placed, path, program.signal_ms / 1000.0)
        rows += [_sample_of(stop[-count:], program, path) for stop in stops if stop.height >= count]
    if not rows:
        raise InputError(
            f"has no stop with the {count} readings of a sample; stops end where readings pause, or where the place "
            "changes",
            field=str(path),
        )
    samples = log_frame(pl.DataFrame(rows).to_dict(), SAMPLES).sort("time_s", "robot", maintain_order=True)
    return Computed(replace(log, samples=samples), largest_difference=float("nan"))


def _places_at(track: pl.DataFrame, time_s: Floats) -> dict[str, pl.Series]:
    """Return places of a robot at some times, on straight lines between tracked ones, and headings if all are known."""
    known = {name: track[name].to_numpy() for name in ("x_m", "y_m")}
    if track["heading_rad"].null_count() == 0:
        known["heading_rad"] = np.unwrap(track["heading_rad"].to_numpy())
    at_s = track["time_s"].to_numpy()
    return {name: pl.Series(np.interp(time_s, at_s, values)) for name, values in known.items()}


def _sample_of(window: pl.DataFrame, program: SenseProgram, path: Path) -> dict[str, float]:
    """Return the sample of the last readings of a stop, where the robot was at its end; the line is of the file."""
    numbers = window.select("time_s", "ax", "ay", "az", "line").to_numpy()
    sample: dict[str, float] = window.select("line", "robot", "time_s", "x_m", "y_m").row(-1, named=True)
    _check_window(numbers, window.height, int(sample["robot"]), sample["time_s"], program, path)
    return sample | {"energy": chain_energy(numbers[:, 1:4], program)}


def stops_of(rows: pl.DataFrame, path: Path, signal_s: float) -> Iterator[pl.DataFrame]:
    """Yield the readings of each stop of one robot.

    Args:
        rows: readings of one robot (``read_acceleration``): stops are those that a column ``sample`` numbers; otherwise
            they end at pauses, and if there is none for ``LONGEST_STOP`` samples, where the robot moves, if x_m and y_m
            (and heading_rad) are there.
        path: of the file, for errors. signal_s: time of a sample.
    Raises:
        InputError: times do not rise.
    """
    if "sample" in rows.columns:
        yield from rows.partition_by("sample", maintain_order=True)
        return
    time_s = rows["time_s"].to_numpy()
    spacing_s = np.diff(time_s)
    if spacing_s.size and spacing_s.min() <= 0.0:
        k = int(np.flatnonzero(spacing_s <= 0.0)[0])
        raise InputError("time does not rise", field=f"{path}, row {rows['line'][k + 1]}")
    usual_s = float(np.median(spacing_s)) if spacing_s.size else 0.0
    pauses = np.flatnonzero(spacing_s > WIDEST_GAP * usual_s) + 1
    for low, high in pairwise([0, *pauses, rows.height]):
        piece = rows[int(low) : int(high)]
        if time_s[high - 1] - time_s[low] > LONGEST_STOP * signal_s:
            yield from _standing_parts(piece)
        else:
            yield piece


def _standing_parts(rows: pl.DataFrame) -> Iterator[pl.DataFrame]:
    """Yield the readings between which a robot stands, as far as its places tell."""
    stands = _stands(rows, rows["time_s"].to_numpy())
    changes = np.flatnonzero(np.diff(stands)) + 1
    for low, high in pairwise([0, *changes, rows.height]):
        if stands[low]:
            yield rows[int(low) : int(high)]


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


def read_acceleration(path: Path, optional: Sequence[str] = ()) -> pl.DataFrame:
    """Read a file of acceleration: its ``COLUMNS`` as numbers, and ``line``, the line of the file.

    Args:
        optional: columns that are read too, if they are there.

    Raises:
        InputError: a column is missing, a cell is not a number, or a robot's number is not a whole number from 0 on;
            the error names the row.
    """
    name = str(path)
    lines, table = table_of(text_of(path, "the acceleration of one session"), name)
    check_columns({f"'{column}'": column for column in COLUMNS}, table.columns, name)
    there = [*COLUMNS, *(column for column in optional if column in table.columns)]
    numbers = {column: numbers_of(table[column], lines, name, column, missing=()) for column in there}
    check_values(numbers["robot"], lines, name, use="robot", column="robot")
    return pl.DataFrame({"line": lines, **numbers})


def _check_window(
    window: Floats,
    count: int,
    robot: int,
    time_s: float,
    program: SenseProgram,
    path: Path,
) -> None:
    """Check the readings of a sample: their number, rate and gaps, and that they are not those of an earlier stop.

    Args:
        window: the readings, (readings, 5); column 0 is their time, s. count: number of readings that are needed.
        robot, time_s: of the sample. program: settings of the sensing chain. path: of the file, for errors.
    Raises:
        InputError: too few readings, another rate than the chain's, a gap, or readings of an earlier stop.
    """
    what = f"robot {robot}, sample at {stated(time_s)} s"
    if window.shape[0] > 1:
        spacing_s = np.diff(window[:, 0])
        if spacing_s.min() <= 0.0:
            raise InputError(f"{what}: the times of its readings do not rise", field=str(path))
        # Gaps, which would lower the rate, have an error of their own, below.
        usual_s = spacing_s[spacing_s <= WIDEST_GAP * np.median(spacing_s)]
        rate_hz = 1.0 / float(usual_s.mean())
        if abs(rate_hz / program.rate_hz - 1.0) > RATE_TOLERANCE:
            raise InputError(
                f"{what}: readings at {rate_hz:.4g} Hz, but the sensing chain's filter is for {program.rate_hz:g} Hz; "
                "record at that rate",
                field=str(path),
            )
    signal_s = program.signal_ms / 1000.0
    gap_s = float(np.diff(window[:, 0]).max()) if window.shape[0] > 1 else 0.0
    # Readings without a gap span about signal_s. If they also end more than about signal_s + 0.5 s before the sample,
    # they are those of an earlier stop. The limit leaves room for a sample's row that is written late.
    age_s = float(time_s - window[0, 0]) if window.shape[0] else 0.0
    if window.shape[0] < count or gap_s > WIDEST_GAP / program.rate_hz or age_s > 2.0 * signal_s + 0.5:
        raise InputError(
            f"{what}: it lacks readings; {count} in a row up to the sample are needed ({signal_s:g} s at "
            f"{program.rate_hz:g} Hz)",
            field=str(path),
        )


def with_energies(
    logs: list[Log], scenario: Scenario, files: Sequence[Path] | None
) -> tuple[list[Log], list[str]]:
    """Replace the energies of logs by those computed from recorded acceleration.

    Args:
        files: the files of acceleration, one for each log in the same order; None to return the logs unchanged.
    Returns:
        The changed logs, and for each log a sentence: how its energies were computed, and how far they differ from the
        logged energies. Without files, the list of sentences is empty.
    """

    if files is None:
        return logs, []
    if len(files) != len(logs):
        raise InputError(f"{len(files)} files for {len(logs)} logs; give one per log", field="--acceleration")
    for log in logs:
        if log.has_timestamps:
            raise InputError(
                "times have to be those of the acceleration: numbers, not timestamps", field=log.name
            )
    program = sense_program(scenario)
    computed = [
        (samples_found if log.samples.is_empty() else energies_from)(log, path, program)
        for log, path in zip(logs, files, strict=True)
    ]
    words = [_words(item, path, program) for item, path in zip(computed, files, strict=True)]
    return [item.log for item in computed], words


def _words(item: Computed, path: Path, program: SenseProgram) -> str:
    """Say how the energies of a log were computed, and how far they differ from logged ones."""
    samples = item.log.samples.height
    each = f"{readings(program)} readings at {stated(program.rate_hz)} Hz each"
    if np.isnan(item.largest_difference):
        return f"{item.log.name}: {count(samples, 'sample')} found in {path} ({each})"
    return (
        f"{item.log.name}: {samples} energies computed from {path} ({each}); they differ from the log's by up to "
        f"{number(item.largest_difference, digits=3)}"
    )
