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
from itertools import accumulate, pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, read_only, signed
from vibroswarm.core.rng import ALONE, SENSING, uniform
from vibroswarm.floors.floor import Floor, Place, place_of, tile_below
from vibroswarm.floors.surfaces import PLAIN
from vibroswarm.observation.edge_response import (
    Response,
    factor_row,
    kinds_with,
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
        """Return the stages in which samples were taken, and the samples of each.

        Args:
            time_s: (samples,), ascending.
        """
        if len(self.stages) == 1:
            return [(self.stages[0], slice(0, time_s.size))]
        bounds = np.append(np.searchsorted(time_s, self.since_s), time_s.size).tolist()
        slices = (slice(low, high) for low, high in pairwise(bounds))
        return [part for part in zip(self.stages, slices, strict=True) if part[1].start < part[1].stop]


def sensed_floors(
    scenario: Scenario, seed: int, runs: Sequence[int], floors: Mapping[int, Floor]
) -> list[Ground]:
    """Return the floor and the sensors of each run, in the order of ``runs``.

    Args:
        runs: run numbers. floors: the floor of each run, by run number.
    """
    floor_of_each = [floors[run] for run in runs]
    response = response_of(scenario, seed, np.array(runs, dtype=np.int64), floor_of_each)
    faults = sensor_faults(scenario, seed, runs)
    result = []
    for r, floor in enumerate(floor_of_each):
        # ``first`` and ``per_robot`` have one entry per run: keep that of this run. They index the rows of ``factors``
        # and ``shares_below``, which stay those of all runs.
        own_response = response._replace(
            first=response.first[r : r + 1],
            per_robot=response.per_robot[r : r + 1],
            first_patch=response.first_patch[r : r + 2],
        )
        faults_of_run = of_run(faults, r)
        stages = [
            (
                since_s,
                SensedFloor(
                    read_only(kinds_with(stage, response.contrasts)),
                    place_of(stage),
                    own_response,
                    faults_of_run,
                ),
            )
            for since_s, stage in floor.stages()
        ]
        result.append(Ground(np.array([since_s for since_s, _ in stages]), [stage for _, stage in stages]))
    return result


@inner
def read(
    ground: SensedFloor, x_m: float, y_m: float, time_s: float, seed: int, run: int, robot: int, sample: int
) -> tuple[int, int, int, int]:
    """Compute the reading of one sample.

    Args:
        ground: floor and sensors of the run. x_m, y_m, time_s: place and time of the sample.
        seed, run, robot, sample: address of the sample's random numbers.
    Returns: index of the tile below (-1: none); the reading; the kind of the tile sensed (0 if none); row of the sample
        in ``ground.response.factors``.
    """
    tile = tile_below(x_m, y_m, ground.place)
    sensed = sensed_tile(
        x_m, y_m, tile, ground.place, ground.tiles, ground.response, seed, run, robot, sample
    )
    kind = kind_of(ground.tiles, sensed)
    if ground.response.patches.shape[0] > 0:
        kind = patched_kind(x_m, y_m, kind, ground.response, 0, seed, run, robot, sample)
    row = factor_row(ground.response, 0, robot, sensed)  # 0: ``ground`` holds a single run
    u = uniform(seed, run, robot, SENSING, sample, ALONE)
    shares, contrasts = ground.response.shares_below, ground.response.contrasts
    return (
        tile,
        observation_of(ground.faults, 0, robot, time_s, kind, u, shares, contrasts, row, seed, run, sample),
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
    """Return the parameters with which a real robot's readings become an energy; simulated energies are drawn instead.

    A stop has two parts: the robot stands until vibrations settle, then reads the signal until the stop ends. Rate,
    filter and time of reading are those of a sensor of the accelerometer; for others, rate and filter have the defaults
    of ``SenseProgram``.
    """
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
    """Return the kind of each of these tiles at its time, (samples,); 0 for index -1, no tile.

    Args:
        tile: (samples,), indices of tiles. time_s: (samples,), in any order.
    """
    kinds = np.zeros(tile.size, dtype=np.uint8)
    stages = list(floor.stages())
    stage = np.searchsorted([since_s for since_s, _ in stages], time_s, side="right") - 1
    for k in np.unique(stage).tolist():
        flat = np.append(stages[k][1].tiles.ravel(), 0)  # the entry 0 is at the end, where index -1 reads it
        here = stage == k
        kinds[here] = flat[tile[here]]
    return kinds


@kernel
def read_samples(
    seed: int,
    bounds: NDArray[np.int64],
    runs: NDArray[np.int64],
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    time_s: NDArray[np.float64],
    places: NDArray[np.float64],
    first_tiles: NDArray[np.int64],
    tiles: NDArray[np.uint8],
    response: Response,
    faults: SensorFaults,
    known: bool,
    tile: NDArray[np.int32],
    numbers: NDArray[np.float64],
    sensed_known: bool,
    sensed: NDArray[np.int32],
    observation: NDArray[np.uint8],
    kinds: NDArray[np.uint8],
    factors: NDArray[np.float64],
) -> None:
    """Compute the readings of all samples of some runs; one row is one sample.

    Args:
        bounds: (runs + 1,): run r has the rows from ``bounds[r]`` to ``bounds[r + 1]``. runs: (runs,), run numbers.
        robot, sample, x_m, y_m, time_s: (rows,), columns of the motion table.
        places: (runs, 6): ``Floor.geometry`` of each run's floor. tiles: tiles of all floors, one after another.
            first_tiles: (runs,): index in ``tiles`` of the first tile of each run's floor.
        response, faults: response and faults of the sensors in these runs.
        tile, numbers: (rows,): tile below (-1: none) and uniform number of each sample. They are read if ``known`` is
            true, else written.
        sensed: (rows,): tile sensed by each sample. It is read if ``sensed_known`` is true, else written. If edges do
            not matter, it is empty and not used.
        observation: (rows,), written. kinds, factors: (rows,): kind of the sensed tile, and the value's factor,
            written; if they are empty, they are not computed.
    """
    with_kinds, shares, contrasts = kinds.size > 0, response.shares_below, response.contrasts
    for r in range(runs.size):
        rows, columns, width_m, height_m, left_m, bottom_m = places[r]
        place = Place(int(rows), int(columns), width_m, height_m, left_m, bottom_m + rows * height_m)
        own = tiles[first_tiles[r] : first_tiles[r] + place.rows * place.columns]
        for k in range(bounds[r], bounds[r + 1]):
            i, number = signed(robot[k]), signed(sample[k])
            if not known:
                tile[k] = tile_below(x_m[k], y_m[k], place)
                numbers[k] = uniform(seed, runs[r], i, SENSING, number, ALONE)
            at = signed(tile[k])  # the tile that is sensed: the tile below, unless an edge is near
            if sensed_known:
                at = signed(sensed[k])
            elif response.edges:
                at = sensed_tile(x_m[k], y_m[k], at, place, own, response, seed, runs[r], i, number)
                sensed[k] = at
            kind, row = kind_of(own, at), factor_row(response, r, i, at)
            observation[k] = observation_of(
                faults, r, i, time_s[k], kind, numbers[k], shares, contrasts, row, seed, runs[r], number
            )
            if with_kinds:
                kinds[k], factors[k] = kind, response.factors[row]


def values_at(
    sensor: Sensor,
    tiles: NDArray[np.uint8],
    place: Place,
    seed: int,
    run: int,
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    time_s: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return what a sensor that depends on the place measures at samples of one run, (samples, numbers).

    Args:
        tiles: (tiles,), kinds of the floor's tiles. place: its grid and position. seed, run: address of chance.
        robot, sample, x_m, y_m, time_s: (samples,), columns of the motion table.
    """
    samples = Samples(
        place, tiles, x_m, y_m, time_s, robot.astype(np.int64), sample.astype(np.int64), seed, run
    )
    return model_of(sensor).sensed(samples, sensor.params)


@kernel
def read_patches(
    seed: int,
    bounds: NDArray[np.int64],
    runs: NDArray[np.int64],
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    time_s: NDArray[np.float64],
    tile: NDArray[np.int32],
    numbers: NDArray[np.float64],
    response: Response,
    faults: SensorFaults,
    observation: NDArray[np.uint8],
    kinds: NDArray[np.uint8],
) -> None:
    """Write the readings of samples that sense a patch, over those of the still tiles on which patches lie.

    Arguments are those of ``read_samples``. It is a kernel of its own, since floors without patches need none of it.
    """
    shares, contrasts = response.shares_below, response.contrasts
    for r in range(runs.size):
        for k in range(bounds[r], bounds[r + 1]):
            i, number = signed(robot[k]), signed(sample[k])
            kind = patched_kind(x_m[k], y_m[k], 0, response, r, seed, runs[r], i, number)
            if kind > 0:
                row = factor_row(response, r, i, signed(tile[k]))
                observation[k] = observation_of(
                    faults, r, i, time_s[k], kind, numbers[k], shares, contrasts, row, seed, runs[r], number
                )
                if kinds.size > 0:
                    kinds[k] = kind


class Readings(NamedTuple):
    """Readings of samples, (rows,) each."""

    tile: NDArray[np.int32]
    """Index of the tile below; -1: none."""
    numbers: NDArray[np.float64]
    """Uniform numbers, from which the energies are drawn."""
    observation: NDArray[np.uint8]
    """Classes that the robots read."""
    kinds: NDArray[np.uint8]
    """Kind of the sensed tile; empty unless energies were requested."""
    factors: NDArray[np.float64]
    """Factor of the energy on the sensed tile; empty unless energies were requested."""
    values: NDArray[np.float64]
    """(rows, numbers): what a sensor that depends on the place measured; without rows for other sensors."""
    contrasts: NDArray[np.float64]
    """Contrasts of kinds beyond those of the sensor (``Response.contrasts``)."""


class Places:
    """The sample positions of a motion, read on several floors and by several sensors.

    What several readings have in common is computed once: tiles below and uniform numbers (for floors of the same
    geometry), sensed tiles (for the same floors and edges) and sensor responses.

    Args:
        seed: seed of the runs. samples: the motion table.
    """

    def __init__(self, seed: int, samples: pl.DataFrame) -> None:
        """Find the runs of the motion table, and the range of rows of each run; start with empty caches.

        The rows of each run must be contiguous.
        """
        self.seed, self.samples = seed, samples
        run = samples["run"].to_numpy()
        # Index of the first row of each run: row 0 (if the table is not empty) and each row with another run than the
        # row before.
        begins = np.flatnonzero(np.append(run.size > 0, run[1:] != run[:-1]))
        self.runs = run[begins].astype(np.int64)
        self.bounds = np.append(begins, run.size)
        self._robot, self._sample = (read_only(samples[name].to_numpy()) for name in ("robot", "sample"))
        self._x_m, self._y_m, self._time_s = (
            read_only(samples[name].to_numpy()) for name in ("x_m", "y_m", "time_s")
        )
        # Tiles below and uniform numbers of all samples, by the bytes of the floors' geometries.
        self._tiles_and_numbers: dict[bytes, tuple[NDArray[np.int32], NDArray[np.float64]]] = {}
        # Tiles sensed by all samples, by reach and blur of edges and the bytes of the floors.
        self._sensed: dict[tuple[float, float, bytes], NDArray[np.int32]] = {}
        # What sensors that depend on the place measured, by their settings and the bytes of the floors.
        self._sensed_values: dict[Any, NDArray[np.float64]] = {}
        # Sensor responses, by all settings on which they depend, see ``_response``.
        self._responses: dict[Any, Response] = {}
        # Parts of runs in which a floor stays as it is, by first row and last row + 1.
        self._parts: dict[tuple[int, int], Places] = {}

    def read(self, scenario: Scenario, floors: Mapping[int, Floor], energies: bool = False) -> Readings:
        """Return the readings of all samples.

        Args:
            floors: the floor of each run, by run number. energies: whether to fill also ``kinds`` and ``factors``
                of the readings, from which energies are computed.
        Returns: the readings. All calls with floors of the same geometry share the arrays ``tile`` and ``numbers``,
            which must not be changed.
        """
        if any(floors[run].is_changing for run in self.runs.tolist()):
            return self._read_stages(scenario, floors, energies)
        count = self.samples.height
        floor_of_each = [floors[run] for run in self.runs.tolist()]
        response = self._response(scenario, floor_of_each)
        places, first_tiles, tiles = _laid_out(floor_of_each, response.contrasts)
        tiles_and_numbers, known = self._tiles_and_numbers.get(places.tobytes()), True
        if tiles_and_numbers is None:  # ``read_samples`` fills these new arrays
            tiles_and_numbers, known = (np.empty(count, dtype=np.int32), np.empty(count)), False
            self._tiles_and_numbers[places.tobytes()] = tiles_and_numbers
        sensed, sensed_known = self._sensed_tiles(response, places, first_tiles, tiles)
        tile, numbers = tiles_and_numbers
        with_energies = count if energies else 0  # empty arrays are not filled
        readings = Readings(
            tile=tile,
            numbers=numbers,
            observation=np.empty(count, dtype=np.uint8),
            kinds=np.empty(with_energies, dtype=np.uint8),
            factors=np.empty(with_energies),
            values=self._values(scenario, floor_of_each),
            contrasts=response.contrasts,
        )
        faults = sensor_faults(scenario, self.seed, self.runs.tolist())
        read_samples(
            self.seed, self.bounds, self.runs, self._robot, self._sample, self._x_m, self._y_m, self._time_s, places,
            first_tiles, tiles, response, faults, known, readings.tile, readings.numbers, sensed_known, sensed,
            readings.observation, readings.kinds, readings.factors,
        )  # fmt: skip
        if response.patches.size:
            read_patches(
                self.seed, self.bounds, self.runs, self._robot, self._sample, self._x_m, self._y_m, self._time_s,
                readings.tile, readings.numbers, response, faults, readings.observation, readings.kinds,
            )  # fmt: skip
        if is_sensed(scenario.sensor):
            run_index = np.repeat(np.arange(self.runs.size), np.diff(self.bounds))
            readings.observation[:] = readings_of(scenario.sensor, readings.values)
            apply_faults(
                faults, run_index, self._robot, self._sample, self._time_s, scenario.sensor.readings, self.seed,
                self.runs, readings.observation,
            )  # fmt: skip
        return readings

    def _read_stages(self, scenario: Scenario, floors: Mapping[int, Floor], energies: bool) -> Readings:
        """Return the readings on floors that change: those of each part of a run in which its floor stays as it is."""
        parts = []
        for r, run in enumerate(self.runs.tolist()):
            low, high = self.bounds[r : r + 2].tolist()
            stages = list(floors[run].stages())
            # Rows are in the order of time. first: of each stage, the number of rows of the run before it.
            first = np.searchsorted(self._time_s[low:high], [since_s for since_s, _ in stages]).tolist()
            for (_, floor), begin, end in zip(stages, first, [*first[1:], high - low], strict=True):
                if begin < end:
                    rows = self._part(low + begin, low + end)
                    parts.append(rows.read(scenario, {run: floor}, energies))
        return Readings(*map(np.concatenate, zip(*parts, strict=True)))

    def _part(self, low: int, high: int) -> Places:
        """Return the cached ``Places`` of some rows of one run."""
        if (low, high) not in self._parts:
            self._parts[low, high] = Places(self.seed, self.samples[low:high])
        return self._parts[low, high]

    def _values(self, scenario: Scenario, floors: Sequence[Floor]) -> NDArray[np.float64]:
        """Return what a sensor that depends on the place measures at all samples, (rows, numbers); cached.

        Args:
            floors: the floor of each run. Returns: for other sensors, an array without rows.
        """
        if not is_sensed(scenario.sensor):
            return np.empty((0, 1))
        key = (scenario.sensor, *((floor.tiles.tobytes(), floor.geometry) for floor in floors))
        if key not in self._sensed_values:
            names = model_of(scenario.sensor).names_of_numbers(scenario.sensor.params)
            parts = [np.empty((0, len(names)))]  # there may be no samples at all
            for run, floor, begin, end in zip(self.runs, floors, self.bounds, self.bounds[1:], strict=False):
                rows = slice(begin, end)
                parts.append(
                    values_at(
                        scenario.sensor, floor.tiles.ravel(), place_of(floor), self.seed, int(run), self._robot[rows],
                        self._sample[rows], self._x_m[rows], self._y_m[rows], self._time_s[rows],
                    )
                )  # fmt: skip
            self._sensed_values[key] = read_only(np.concatenate(parts))
        return self._sensed_values[key]

    def _sensed_tiles(
        self,
        response: Response,
        places: NDArray[np.float64],
        first_tiles: NDArray[np.int64],
        tiles: NDArray[np.uint8],
    ) -> tuple[NDArray[np.int32], bool]:
        """Return the array of the sensed tiles, (rows,), and whether it is filled; if not, the caller fills it.

        The array is cached by floors and edges, on which alone sensed tiles depend. If edges do not matter, the array
        is empty and the caller does not use it.

        Args:
            response: the sensor response, whose reach and blur of edges are used. places, first_tiles, tiles: the
                floors, as ``_laid_out`` returns them.
        """
        if not response.edges:
            return np.empty(0, dtype=np.int32), False
        floors = b"".join(part.tobytes() for part in (places, first_tiles, tiles))
        key = (response.reach_m, response.blur_m, floors)
        if key in self._sensed:
            return self._sensed[key], True
        self._sensed[key] = np.empty(self.samples.height, dtype=np.int32)
        return self._sensed[key], False

    def _response(self, scenario: Scenario, floors: Sequence[Floor]) -> Response:
        """Return the cached sensor response of a scenario; ``floors``: of each run."""
        # ``redraw`` is part of the key because it determines whether each run has its own factors of tiles.
        tiles = [floor.tiles.size for floor in floors]
        key: tuple[Any, ...] = (scenario.sensor, scenario.floor.redraw, scenario.swarm.robots, *tiles)
        if any(floor.surface is not PLAIN for floor in floors):
            key = (*key, scenario.floor, scenario.arena)
        if key not in self._responses:
            self._responses[key] = response_of(scenario, self.seed, self.runs, floors)
        return self._responses[key]


def observe(
    scenario: Scenario,
    seed: int,
    samples: pl.DataFrame,
    floors: Mapping[int, Floor],
    *,
    energies: bool = True,
) -> pl.DataFrame:
    """Return the observation table of a motion table.

    Args:
        samples: the motion table; the rows of the result are in the same order.
        floors: the floor of each run, by run number.
        energies: whether to compute the energies, which are null otherwise. If the strategy reads energies, they are
            computed in any case. The classes do not depend on this.
    """
    energies = energies or reads_energies(scenario)
    read = Places(seed, samples).read(scenario, floors, energies)
    return observation_frame(scenario, samples, read, energies)


def reads_energies(scenario: Scenario) -> bool:
    """Return whether the strategy's parameters say that robots read energies."""
    return bool(getattr(scenario.strategy.params, "energies", False))


def energies_at(
    scenario: Scenario,
    ground: SensedFloor,
    seed: int,
    run: int,
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    time_s: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return what samples of one run measure, equal to the table of ``observe``: see ``energies_read``.

    Args:
        ground: floor and sensors of the run.
        robot, sample, x_m, y_m, time_s: (samples,), columns of the motion table.
    """
    if is_sensed(scenario.sensor):
        values = values_at(
            scenario.sensor, ground.tiles, ground.place, seed, run, robot, sample, x_m, y_m, time_s
        )
        return values.astype(np.float32)
    kinds = np.empty(robot.size, dtype=np.uint8)
    numbers, factors = np.empty(robot.size), np.empty(robot.size)
    for k in range(robot.size):
        i, number = int(robot[k]), int(sample[k])
        # The time matters only to the class of a faulty sensor, which is not used here, so any time will do.
        any_time_s = 0.0
        _, _, kinds[k], row = read(ground, x_m[k], y_m[k], any_time_s, seed, run, i, number)
        numbers[k] = uniform(seed, run, i, SENSING, number, ALONE)
        factors[k] = ground.response.factors[row]
    # None stands for factors that are all 1.
    differ = factors_differ(scenario.sensor)
    return energies_of(
        scenario.sensor, kinds, numbers, factors if differ else None, ground.response.contrasts
    )


def energies_read(scenario: Scenario, read: Readings) -> NDArray[np.float32]:
    """Return the energies of readings, (rows,); of a sensor that depends on the place all numbers, (rows, numbers).

    Args:
        read: readings for which energies were requested, so that ``kinds`` and ``factors`` are filled.
    """
    if is_sensed(scenario.sensor):
        return read.values.astype(np.float32)
    factors = read.factors if factors_differ(scenario.sensor) else None  # None: all are 1
    return energies_of(scenario.sensor, read.kinds, read.numbers, factors, read.contrasts)


def observation_frame(
    scenario: Scenario, samples: pl.DataFrame, read: Readings, energies: bool
) -> pl.DataFrame:
    """Return the table of observations (``OBSERVATIONS``), with a row for each row of ``samples``.

    Args:
        samples: the motion table. read: the readings of its samples. energies: whether to compute the energies, for
            which they must have been requested when reading; if false, what is measured is null.
    """
    names = model_of(scenario.sensor).names_of_numbers(scenario.sensor.params)
    if energies:
        columns = energies_read(scenario, read).reshape(samples.height, len(names)).T
        measured = [pl.Series(name, column) for name, column in zip(names, columns, strict=True)]
    else:
        # not by ``pl.repeat``, which hangs in a forked process
        measured = [pl.Series(name, [None], MEASURED).new_from_index(0, samples.height) for name in names]
    return pl.DataFrame(
        [
            *(samples[name] for name in ("run", "robot", "sample")),
            pl.Series("tile", read.tile),
            measured[0].alias("energy"),
            pl.Series("observation", read.observation),
            *measured[1:],
        ]
    )


def _laid_out(
    floors: Sequence[Floor], contrasts: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
    """Convert floors to arrays for kernels; the tiles of a floor object that occurs several times are stored once.

    Args:
        contrasts: those that occur (``contrasts_of``).
    Returns: geometry of each floor, (floors, 6); index of each floor's first tile, (floors,); tiles of all distinct
        floors, concatenated.
    """
    places = np.array([floor.geometry for floor in floors], dtype=np.float64).reshape(-1, 6)
    distinct = {id(floor): floor for floor in floors}
    # Index of the first tile of each distinct floor, by the floor's id: the sum of the sizes of the floors before it.
    # ``accumulate`` gives the total too, which ``strict=False`` drops.
    first = dict(
        zip(distinct, accumulate((f.tiles.size for f in distinct.values()), initial=0), strict=False)
    )
    tiles = [kinds_with(floor, contrasts) for floor in distinct.values()]
    return (
        places,
        np.array([first[id(floor)] for floor in floors], dtype=np.int64),
        np.concatenate(tiles) if tiles else np.zeros(0, dtype=np.uint8),
    )
