"""The reading of a sample: value E and class O, drawn from the tile below and one uniform number u.

| name | symbol | unit | shape | equation |
|---|---|---|---|---|
| energy | E | RMS of the filtered acceleration | (samples,) | the tile kind's quantile of u |
| threshold | theta_E | as E | scalar | |
| observation | O | 0, 1 | (samples,) | 1 if E > theta_E (Eq. 15), which is u > F(theta_E); so E itself is not needed |
| false positive, false negative | - | - | scalar | 1 - F_still(theta_E), F_vibrating(theta_E) |

Changing the floor does not change the noise, as the uniform number depends on (seed, run, robot, sample) only. A place
without a tile reads as a still tile does; its tile has index -1. Edges, and differences between tiles or between robots
(all off in the paper), are those of ``edge_response``: near an edge another tile may be sensed, and energies have a
factor. The classes of faulty sensors are those of ``faults``.

``observe`` computes whole tables. ``SensedFloor`` is the floor and the sensors of one run, as the kernels of the closed
loop read them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, read_only, signed
from vibroswarm.core.rng import ALONE, SENSING, uniform
from vibroswarm.floors.floor import Floor, Place, place_of, tile_below
from vibroswarm.observation.edge_response import (
    Response,
    factor_row,
    index_of,
    levels_on,
    patched_kind,
    response_of,
    sensed_tile,
)
from vibroswarm.observation.energy_model import energies_of, factors_differ, is_sensed, model_of, readings_of
from vibroswarm.robot.sensing import SenseProgram
from vibroswarm.scenario.fault_draws import SensorFaults, apply_faults, observation_of, of_run, sensor_faults
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.sensors import Samples


class SensedFloor(NamedTuple):
    """The floor of a run, its position, and the sensors' response."""

    tiles: NDArray[np.uint8]
    """(tiles,): kinds of the tiles, such as 0 still and 1 vibrating, top row first."""
    place: Place
    """Grid and position of the floor."""
    response: Response
    """Response of the sensors of this run alone: its arrays over runs have one entry."""
    faults: SensorFaults
    """Faults of the sensors of this run alone: its arrays over runs have one entry."""


class Ground(NamedTuple):
    """The floor and the sensors of a run, from one change of the floor to the next; one stage if it does not change."""

    since_s: NDArray[np.float64]
    """(stages,): when each stage begins, s; 0 first."""
    stages: list[SensedFloor]

    def parts(self, time_s: NDArray[np.float64]) -> list[tuple[SensedFloor, slice]]:
        """Return the stages in which samples were taken, and the samples of each. Shapes: ``time_s`` (samples,)."""
        if len(self.stages) == 1:
            return [(self.stages[0], slice(0, time_s.size))]
        bounds = np.append(np.searchsorted(time_s, self.since_s), time_s.size).tolist()
        slices = (slice(low, high) for low, high in pairwise(bounds))
        return [part for part in zip(self.stages, slices, strict=True) if part[1].start < part[1].stop]


def sensed_floors(
    scenario: Scenario, seed: int, runs: Sequence[int], floors: Mapping[int, Floor]
) -> list[Ground]:
    """Return the floor and the sensors of each run, in the order of ``runs``."""
    levels = levels_on(scenario.sensor, (floors[run] for run in runs))
    faults, grounds = sensor_faults(scenario, seed, runs), []
    for r, run in enumerate(runs):
        own = response_of(scenario, seed, run, floors[run], levels), of_run(faults, r)
        since_s, stages = zip(*floors[run].stages(), strict=True)
        tiles = [read_only(index_of(stage.levels.ravel(), levels)) for stage in stages]
        place = place_of(floors[run])
        grounds.append(Ground(np.array(since_s), [SensedFloor(each, place, *own) for each in tiles]))
    return grounds


@inner
def read(
    ground: SensedFloor, x_m: float, y_m: float, time_s: float, seed: int, run: int, robot: int, sample: int
) -> tuple[int, int, int, int]:
    """Compute the reading of one sample."""
    tile = tile_below(x_m, y_m, ground.place)
    sensed = sensed_tile(
        x_m, y_m, tile, ground.place, ground.tiles, ground.response, seed, run, robot, sample
    )
    kind = kind_of(ground.tiles, sensed)
    if ground.response.patches.shape[0] > 0:
        kind = patched_kind(x_m, y_m, kind, ground.response, seed, run, robot, sample)
    row = factor_row(ground.response, robot, sensed)
    u = uniform(seed, run, robot, SENSING, sample, ALONE)
    shares, levels = ground.response.shares_below, ground.response.levels
    return (
        tile,
        observation_of(ground.faults, 0, robot, time_s, kind, u, shares, levels, row, seed, run, sample),
        kind,
        row,
    )


@inner
def kind_of(tiles: NDArray[np.uint8], tile: int) -> int:
    """Return the kind of a tile of a floor; 0, as of still tiles, for -1, no tile."""
    return signed(tiles[tile]) if tile >= 0 else 0


USUAL_MS = 500.0
"""Duration of the signal if ``sample.signal_ms`` is not given; if this is more than half of the stop, half of it."""


def sense_program(scenario: Scenario) -> SenseProgram:
    """Return how a real robot's readings become an energy: it stands until vibrations settle, then reads the signal."""
    stop_ms = scenario.sample.stop_ms
    model = model_of(scenario.sensor)
    if model.accelerometer is not None:
        program = model.accelerometer(scenario.sensor.params)
        return program._replace(settle_ms=stop_ms - program.signal_ms)
    # If the time of reading is not given, it is the usual one, but at most half of the stop.
    signal_ms = scenario.sample.signal_ms or min(USUAL_MS, 0.5 * stop_ms)
    return SenseProgram(settle_ms=stop_ms - signal_ms, signal_ms=signal_ms)


OBSERVATIONS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "tile": pl.Int32,
    "energy": pl.Float32,
    "observation": pl.UInt8,
}
"""Columns of the table of observations. If a sample measures several numbers, the first is the energy, and the others
are further columns of the type ``MEASURED``, by their names."""
MEASURED: Final[Any] = pl.Float32


def kinds_at(floor: Floor, tile: NDArray[np.integer[Any]], time_s: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the kind of each of these tiles at its time, (samples,); 0 for index -1, no tile."""
    kinds = np.zeros(tile.size, dtype=np.uint8)
    for since_s, stage in floor.stages():
        later = time_s >= since_s
        kinds[later] = np.append(stage.tiles.ravel(), 0)[tile[later]]  # index -1 reads the entry 0 at the end
    return kinds


class Readings(NamedTuple):
    """Readings of samples, (rows,) each."""

    tile: NDArray[np.int32]
    """Index of the tile below; -1: none."""
    observation: NDArray[np.uint8]
    """Classes that the robots read."""
    numbers: NDArray[np.float64]
    """Uniform numbers, from which the energies are drawn. This and the next two are empty unless energies were
    requested."""
    kinds: NDArray[np.uint8]
    """Kind of the sensed tile."""
    factors: NDArray[np.float64]
    """Factor of the energy on the sensed tile."""
    values: NDArray[np.float64]
    """(rows, numbers): what a sensor that depends on the place measures; of others no rows."""
    levels: NDArray[np.float64]
    """Levels of which ``kinds`` are indices (``Response.levels``)."""


def read_samples(
    scenario: Scenario, seed: int, motion: pl.DataFrame, floors: Mapping[int, Floor], energies: bool = False
) -> Readings:
    """Return the readings of all samples of a motion table, in which the rows of each run are contiguous."""
    run = motion["run"].to_numpy()
    begins = np.flatnonzero(np.append(run.size > 0, run[1:] != run[:-1]))
    runs = run[begins].tolist()
    columns = _columns(*(motion[name].to_numpy() for name in ("robot", "sample", "x_m", "y_m", "time_s")))
    time_s = columns[2]
    grounds = sensed_floors(scenario, seed, runs, floors)
    levels = grounds[0].stages[0].response.levels if grounds else np.empty(0)
    readings = _no_readings(scenario.sensor, run.size, energies, levels)
    bounds = pairwise([*begins.tolist(), run.size])
    for one, ground, (begin, end) in zip(runs, grounds, bounds, strict=True):
        for floor, part in ground.parts(time_s[begin:end]):
            rows = slice(begin + part.start, begin + part.stop)
            x_m, y_m, times, robot, sample = (column[rows] for column in columns)
            samples = Samples(floor.place, floor.tiles, x_m, y_m, times, robot, sample, seed, one)
            part_of = Readings._make([*(column[rows] for column in readings[:-1]), levels])
            _read_part(scenario.sensor, floor, samples, part_of)
    return readings


def _columns(robot: Any, sample: Any, x_m: Any, y_m: Any, time_s: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Return the columns of ``Samples``, read-only so that kernels are compiled once."""
    x, y, time = (read_only(np.ascontiguousarray(column, np.float64)) for column in (x_m, y_m, time_s))
    return x, y, time, read_only(robot.astype(np.int64)), read_only(sample.astype(np.int64))


def _no_readings(sensor: Sensor, count: int, energies: bool, levels: NDArray[np.float64]) -> Readings:
    """Return arrays for readings of as many samples."""
    numbers = len(model_of(sensor).names_of_numbers(sensor.params))
    drawn = count if energies else 0
    return Readings(
        tile=np.empty(count, dtype=np.int32),
        observation=np.empty(count, dtype=np.uint8),
        numbers=np.empty(drawn),
        kinds=np.empty(drawn, dtype=np.uint8),
        factors=np.empty(drawn),
        values=np.empty((count if is_sensed(sensor) else 0, numbers)),
        levels=levels,
    )


def _read_part(sensor: Sensor, floor: SensedFloor, samples: Samples, out: Readings) -> None:
    """Write the readings of samples of one run, between two changes of its floor."""
    _read_rows(floor, samples, out)
    if is_sensed(sensor):
        out.values[:] = model_of(sensor).sensed(samples, sensor.params)
        out.observation[:] = readings_of(sensor, out.values)
        apply_faults(
            floor.faults, np.zeros(samples.robot.size, dtype=np.int64), samples.robot, samples.sample, samples.time_s,
            sensor.readings, samples.seed, np.array([samples.run]), out.observation,
        )  # fmt: skip


@kernel
def _read_rows(floor: SensedFloor, samples: Samples, out: Readings) -> None:
    """Write the readings of samples of one run, but not the values of a sensor that depends on the place."""
    seed, run = samples.seed, samples.run
    for k in range(samples.robot.size):
        i, number = samples.robot[k], samples.sample[k]
        tile, observation, kind, row = read(
            floor, samples.x_m[k], samples.y_m[k], samples.time_s[k], seed, run, i, number
        )
        out.tile[k], out.observation[k] = tile, observation
        if out.kinds.size > 0:
            out.numbers[k] = uniform(seed, run, i, SENSING, number, ALONE)
            out.kinds[k], out.factors[k] = kind, floor.response.factors[row]


def observe(
    scenario: Scenario,
    seed: int,
    samples: pl.DataFrame,
    floors: Mapping[int, Floor],
    *,
    energies: bool = True,
) -> pl.DataFrame:
    """Return the observation table of a motion table."""
    energies = energies or reads_energies(scenario)
    readings = read_samples(scenario, seed, samples, floors, energies)
    names = model_of(scenario.sensor).names_of_numbers(scenario.sensor.params)
    if energies:
        columns = energies_read(scenario, readings).reshape(samples.height, len(names)).T
        measured = [pl.Series(name, column) for name, column in zip(names, columns, strict=True)]
    else:
        # not by ``pl.repeat``, which hangs in a forked process
        measured = [pl.Series(name, [None], MEASURED).new_from_index(0, samples.height) for name in names]
    return pl.DataFrame(
        [
            *(samples[name] for name in ("run", "robot", "sample")),
            pl.Series("tile", readings.tile),
            measured[0].alias("energy"),
            pl.Series("observation", readings.observation),
            *measured[1:],
        ]
    )


def reads_energies(scenario: Scenario) -> bool:
    """Return whether the strategy's parameters say that robots read energies."""
    return bool(getattr(scenario.strategy.params, "energies", False))


def readings_at(
    scenario: Scenario,
    ground: SensedFloor,
    seed: int,
    run: int,
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    time_s: NDArray[np.float64],
) -> Readings:
    """Return the readings of samples of one run, with what energies are computed from."""
    columns = _columns(robot, sample, x_m, y_m, time_s)
    samples = Samples(ground.place, ground.tiles, *columns, seed=seed, run=run)
    readings = _no_readings(scenario.sensor, robot.size, True, ground.response.levels)
    _read_part(scenario.sensor, ground, samples, readings)
    return readings


def energies_read(scenario: Scenario, read: Readings) -> NDArray[np.float32]:
    """Return the energies of readings, (rows,); of a sensor that depends on the place all numbers, (rows, numbers)."""
    if is_sensed(scenario.sensor):
        return read.values.astype(np.float32)
    factors = read.factors if factors_differ(scenario.sensor) else None  # None: all are 1
    return energies_of(scenario.sensor, read.kinds, read.numbers, factors, read.levels)
