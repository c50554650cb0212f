"""Energies of a session from its recorded acceleration, by the robot's own chain (``robot.sensing``, Algorithm 2).

The file is a CSV with a head line: ``robot`` as in the log, ``time_s`` of the log's clock, ``ax``, ``ay``, ``az`` in
the unit of the energies. Each sample is made from the last ``readings`` rows of its robot up to the sample's time,
which must be evenly spaced at the chain's rate.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.recordings.column_map import check_columns, numbers_of, table_of, text_of
from vibroswarm.recordings.log import Log
from vibroswarm.robot.sensing import SenseProgram, SenseState, energy, readings, sense_step

COLUMNS: Final = ("robot", "time_s", "ax", "ay", "az")
RATE_TOLERANCE: Final = 0.02
"""Share by which the readings' rate may differ from the chain's: the accuracy of a microcontroller's clock."""
WIDEST_GAP: Final = 1.6
"""Longest time between two readings of a sample, in periods: one is missing beyond."""
CLOCK_S: Final = 0.001
"""A reading may be this much later than its sample: times are written to a millisecond."""


class Computed(NamedTuple):
    """A log with energies from acceleration, and how they compare with those that it had."""

    log: Log
    samples: int
    largest_difference: float
    """Largest difference between a computed energy and the one in the log; NaN if the log has none."""


def energies_from(log: Log, path: Path, program: SenseProgram) -> Computed:
    """Replace a log's energies by those computed from recorded acceleration.

    Args:
        log: as read. path: CSV file of the acceleration. program: settings of the sensing chain.
    Raises:
        InputError: the file is wrong, has another rate than the chain's, or lacks readings of a sample.
    """
    recorded = read_acceleration(path)
    count, found = readings(program), np.empty(log.samples.height)
    by_robot = {
        int(robot[0]): frame.select("time_s", "ax", "ay", "az", "line").to_numpy()
        for robot, frame in recorded.group_by("robot", maintain_order=True)
    }
    for robot, rows in by_robot.items():
        late = np.flatnonzero(np.diff(rows[:, 0]) <= 0.0)
        if late.size:
            raise InputError(
                f"robot {robot}: its time, {rows[late[0] + 1, 0]:g} s, is not after that of the reading before",
                field=f"{path}, row {rows[late[0] + 1, 4]:.0f}",
            )
    for k, (robot, time_s) in enumerate(log.samples.select("robot", "time_s").iter_rows()):
        rows = by_robot.get(int(robot), np.empty((0, 5)))
        end = int(np.searchsorted(rows[:, 0], time_s + CLOCK_S, side="right"))
        window = rows[max(end - count, 0) : end]
        _check_window(window, count, int(robot), float(time_s), program, path)
        found[k] = chain_energy(window[:, 1:4], program)
    before = log.samples["energy"].to_numpy()
    difference = np.abs(found - before)
    largest = float(np.nanmax(difference)) if np.isfinite(difference).any() else float("nan")
    samples = log.samples.with_columns(energy=pl.Series(found))
    return Computed(replace(log, samples=samples), log.samples.height, largest)


def chain_energy(acceleration: NDArray[np.float64], program: SenseProgram) -> float:
    """Return the energy that the robot's sensing chain computes from the readings of one stop, (readings, 3)."""
    step: Any = getattr(
        sense_step, "py_func", sense_step
    )  # plain: compiling it takes longer than thousands of calls
    state = SenseState(0.0, 0.0, 0.0, 0)
    for ax, ay, az in acceleration.tolist():
        state = step(state, program, ax, ay, az)
    return energy(state)


def read_acceleration(path: Path) -> pl.DataFrame:
    """Return the readings of a file: ``COLUMNS`` and ``line``.

    Raises:
        InputError: not such a file; names the row.
    """
    name = str(path)
    table = table_of(text_of(path), name)
    check_columns({f"'{column}'": column for column in COLUMNS}, table.columns, name)
    numbers = {column: numbers_of(table[column], table["line"], name, column, ()) for column in COLUMNS}
    return pl.DataFrame({"line": table["line"], **numbers})


def _check_window(
    window: NDArray[np.float64],
    count: int,
    robot: int,
    time_s: float,
    program: SenseProgram,
    path: Path,
) -> None:
    """Refuse readings of a sample that are too few, of another rate, or with gaps."""
    what = f"robot {robot}, sample at {time_s:g} s"
    if window.shape[0] > 1:
        spacing_s = np.diff(window[:, 0])
        rate_hz = 1.0 / float(np.median(spacing_s))
        mean_hz = (window.shape[0] - 1) / float(window[-1, 0] - window[0, 0])
        is_even = float(spacing_s.max()) <= WIDEST_GAP * float(np.median(spacing_s))
        rate_hz = mean_hz if is_even else rate_hz
        if abs(rate_hz / program.rate_hz - 1.0) > RATE_TOLERANCE:
            raise InputError(
                f"{what}: readings at {rate_hz:.4g} Hz, but the sensing chain's filter is for {program.rate_hz:g} Hz; "
                "record at that rate",
                field=str(path),
            )
    signal_s = program.signal_ms / 1000.0
    lasting_s = float(time_s - window[0, 0]) if window.shape[0] else 0.0
    gap = float(np.diff(window[:, 0]).max()) if window.shape[0] > 1 else 0.0
    if window.shape[0] < count or gap > WIDEST_GAP / program.rate_hz or lasting_s > 2.0 * signal_s + 0.5:
        raise InputError(
            f"{what}: it lacks readings; {count} in a row up to the sample are needed ({signal_s:g} s at "
            f"{program.rate_hz:g} Hz)",
            field=str(path),
        )
