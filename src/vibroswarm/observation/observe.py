"""The reading of a sample: energy E and bit O, from the tile below and one uniform number.

| name | symbol | unit | shape | equation |
|---|---|---|---|---|
| energy | E | RMS of the filtered acceleration | (samples,) | the tile kind's quantile of u |
| threshold | theta_E | as E | scalar | |
| observation | O | 0, 1 | (samples,) | 1 if E > theta_E (Eq. 15): 1 if u > F(theta_E), E not needed |
| false positive, false negative | - | - | scalar | 1 - F_still(theta_E), F_vibrating(theta_E) |

Changing the floor changes no noise: the uniform number belongs to (seed, run, robot, sample). A place
without a tile does not vibrate and reads as a still tile does; its tile is -1. Near edges, and where tiles or
robots differ (off in the paper), the tile that is read and a factor come from ``edge_response``; the bits of failed
sensors come from ``faults``.

``observe`` reads whole tables; ``SensedFloor`` is a run's floor and sensors as the kernels of the closed loop read
them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, read_only, signed
from vibroswarm.core.rng import ALONE, SENSING, uniform
from vibroswarm.faults import SensorFaults, observation_of, of_run, sensor_faults
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.edge_response import (
    Place,
    Response,
    factor_row,
    factors_differ,
    place_of,
    response_of,
    sensed_tile,
    tile_below,
)
from vibroswarm.observation.energy_model import energies_of
from vibroswarm.robot.sensing import SenseProgram
from vibroswarm.scenario.scenario import Scenario


class SensedFloor(NamedTuple):
    """The floor of a run, its position, and the sensors' response."""

    tiles: NDArray[np.uint8]
    """(tiles,)"""
    place: Place
    response: Response
    """Of this run alone, as are the faults."""
    faults: SensorFaults


def sensed_floors(
    scenario: Scenario, seed: int, runs: Sequence[int], floors: Mapping[int, Floor]
) -> list[SensedFloor]:
    """Return the floor and sensors of each run, in the order of ``runs``."""
    own = [floors[run] for run in runs]
    response = response_of(
        scenario, seed, np.array(runs, dtype=np.int64), [floor.tiles.size for floor in own]
    )
    first, per_robot = response.first, response.per_robot
    faults = sensor_faults(scenario, seed, runs)
    return [
        SensedFloor(
            floor.tiles.ravel(),
            place_of(floor),
            response._replace(first=first[r : r + 1], per_robot=per_robot[r : r + 1]),
            of_run(faults, r),
        )
        for r, floor in enumerate(own)
    ]


@inner
def read(
    ground: SensedFloor, x_m: float, y_m: float, time_s: float, seed: int, run: int, robot: int, sample: int
) -> tuple[int, int, int, int]:
    """Return the reading of a sample: the tile below, the bit, the tile sensed, the row of factors."""
    tile = tile_below(x_m, y_m, ground.place)
    sensed = sensed_tile(
        x_m, y_m, tile, ground.place, ground.tiles, ground.response, seed, run, robot, sample
    )
    vibrates = sensed >= 0 and ground.tiles[sensed] == 1
    row = factor_row(ground.response, 0, robot, sensed)
    u = uniform(seed, run, robot, SENSING, sample, ALONE)
    below = ground.response.shares_below[row, int(vibrates)]
    return tile, observation_of(ground.faults, 0, robot, time_s, vibrates, u, below), sensed, row


USUAL_MS = 500.0


def sense_program(scenario: Scenario) -> SenseProgram:
    """Return the sensing parameters of a scenario: the robot settles, then reads the signal at the end of the
    stop."""
    stop_ms = scenario.sample.stop_ms
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


def vibrating_at(floor: Floor, tile: NDArray[np.integer[Any]]) -> NDArray[np.bool_]:
    """Return whether the tiles of these indices vibrate; False where there is none (-1)."""
    flat = np.append(floor.tiles.ravel(), 0)  # index -1 is the last
    return np.asarray(flat[tile] == 1)


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
    vibrating: NDArray[np.bool_],
    factors: NDArray[np.float64],
) -> None:
    """Compute the readings of samples.

    Args:
        bounds: the rows of run r are those from ``bounds[r]`` to ``bounds[r + 1]``. robot to time_s: (rows,).
        places: (runs, 6): ``Floor.geometry``. first_tiles: (runs,): where in ``tiles`` each run's begin.
        known: tile and numbers have been written before. tile, numbers: (rows,), written, or read where known.
        sensed_known, sensed: the same for the sensed tiles; empty if edges do not matter.
        observation: (rows,), written. vibrating, factors: (rows,), written, or of no rows: of the tile that was sensed.
    """
    with_vibrating = vibrating.size > 0
    for r in range(runs.size):
        rows, columns, width_m, height_m, left_m, bottom_m = places[r]
        place = Place(int(rows), int(columns), width_m, height_m, left_m, bottom_m + rows * height_m)
        own = tiles[first_tiles[r] : first_tiles[r] + place.rows * place.columns]
        for k in range(bounds[r], bounds[r + 1]):
            i, number = signed(robot[k]), signed(sample[k])
            if not known:
                tile[k] = tile_below(x_m[k], y_m[k], place)
                numbers[k] = uniform(seed, runs[r], i, SENSING, number, ALONE)
            at = signed(tile[k])
            if sensed_known:
                at = signed(sensed[k])
            elif response.edges:
                at = sensed_tile(x_m[k], y_m[k], at, place, own, response, seed, runs[r], i, number)
                sensed[k] = at
            vibrates = at >= 0 and own[at] == 1
            row = factor_row(response, r, i, at)
            below = response.shares_below[row, int(vibrates)]
            observation[k] = observation_of(faults, r, i, time_s[k], vibrates, numbers[k], below)
            if with_vibrating:
                vibrating[k], factors[k] = vibrates, response.factors[row]


class Readings(NamedTuple):
    """Readings of samples, (rows,) each."""

    tile: NDArray[np.int32]
    numbers: NDArray[np.float64]
    """Uniform numbers, from which the energies are drawn."""
    observation: NDArray[np.uint8]
    vibrating: NDArray[np.bool_]
    factors: NDArray[np.float64]
    """Of the sensed tile; empty unless requested, like ``vibrating``."""


class Places:
    """The sample positions of a motion; values shared by several floors and sensors are computed once.

    Args:
        seed: of the runs. samples: the motion table.
    """

    def __init__(self, seed: int, samples: pl.DataFrame) -> None:
        self.seed, self.samples = seed, samples
        run = samples["run"].to_numpy()
        begins = np.flatnonzero(np.append(run.size > 0, run[1:] != run[:-1]))
        self.runs = run[begins].astype(np.int64)
        self.bounds = np.append(begins, run.size)
        self._robot, self._sample = (read_only(samples[name].to_numpy()) for name in ("robot", "sample"))
        self._x_m, self._y_m, self._time_s = (
            read_only(samples[name].to_numpy()) for name in ("x_m", "y_m", "time_s")
        )
        self._met: dict[bytes, tuple[NDArray[np.int32], NDArray[np.float64]]] = {}
        self._sensed: dict[tuple[float, float, bytes], NDArray[np.int32]] = {}
        self._responses: dict[Any, Response] = {}

    def read(self, scenario: Scenario, floors: Mapping[int, Floor], energies: bool = False) -> Readings:
        """Return the readings of the samples.

        Args:
            floors: the floor of each run. energies: also what their energies depend on.
        """
        count, own = self.samples.height, [floors[run] for run in self.runs.tolist()]
        places, first_tiles, tiles = _laid_out(own)
        response = self._response(scenario, [floor.tiles.size for floor in own])
        met, known = self._met.get(places.tobytes()), True
        if met is None:
            met, known = (np.empty(count, dtype=np.int32), np.empty(count)), False
            self._met[places.tobytes()] = met
        sensed, sensed_known = self._sensed_tiles(response, places, first_tiles, tiles)
        kept = count if energies else 0
        observation, vibrating = np.empty(count, dtype=np.uint8), np.empty(kept, dtype=np.bool_)
        readings = Readings(*met, observation, vibrating, np.empty(kept))
        faults = sensor_faults(scenario, self.seed, self.runs.tolist())
        read_samples(
            self.seed, self.bounds, self.runs, self._robot, self._sample, self._x_m, self._y_m, self._time_s, places,
            first_tiles, tiles, response, faults, known, readings.tile, readings.numbers, sensed_known, sensed,
            readings.observation, readings.vibrating, readings.factors,
        )  # fmt: skip
        return readings

    def _sensed_tiles(
        self,
        response: Response,
        places: NDArray[np.float64],
        first_tiles: NDArray[np.int64],
        tiles: NDArray[np.uint8],
    ) -> tuple[NDArray[np.int32], bool]:
        """Return an array for the sensed tiles, (rows,), and whether it is filled: they depend on edges alone."""
        if not response.edges:
            return np.empty(0, dtype=np.int32), False
        laid = b"".join(part.tobytes() for part in (places, first_tiles, tiles))
        key = (response.reach_m, response.blur_m, laid)
        if key in self._sensed:
            return self._sensed[key], True
        self._sensed[key] = np.empty(self.samples.height, dtype=np.int32)
        return self._sensed[key], False

    def _response(self, scenario: Scenario, tiles: Sequence[int]) -> Response:
        key = (scenario.sensor, scenario.floor.redraw, scenario.swarm.robots, *tiles)
        if key not in self._responses:
            self._responses[key] = response_of(scenario, self.seed, self.runs, tiles)
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
        samples: the motion table; its order is kept.
        floors: the floor of each run.
        energies: also compute the energies (else null, unless the strategy reads them); the bits are the same.
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
) -> NDArray[np.float32]:
    """Return the energies of samples of one run, (samples,): those that ``observe`` gives.

    Args:
        robot, sample, x_m, y_m: (samples,).
    """
    vibrating, numbers, factors = (
        np.empty(robot.size, dtype=np.bool_),
        np.empty(robot.size),
        np.empty(robot.size),
    )
    for k in range(robot.size):
        i, number = int(robot[k]), int(sample[k])
        _, _, sensed, row = read(ground, x_m[k], y_m[k], 0.0, seed, run, i, number)
        vibrating[k] = sensed >= 0 and ground.tiles[sensed] == 1
        numbers[k] = uniform(seed, run, i, SENSING, number, ALONE)
        factors[k] = ground.response.factors[row]
    differ = factors if factors_differ(scenario.sensor) else None
    return energies_of(scenario.sensor, vibrating, numbers, differ)


def energies_read(scenario: Scenario, read: Readings) -> NDArray[np.float32]:
    """Return the energies of readings that were requested with energies, (rows,)."""
    differ = read.factors if factors_differ(scenario.sensor) else None
    return energies_of(scenario.sensor, read.vibrating, read.numbers, differ)


def observation_frame(
    scenario: Scenario, samples: pl.DataFrame, read: Readings, energies: bool
) -> pl.DataFrame:
    """Return the table of observations: each sample's tile, bit and energy (null without ``energies``)."""
    if energies:
        energy = pl.Series("energy", energies_read(scenario, read))
    else:
        energy = pl.repeat(None, samples.height, dtype=pl.Float32, eager=True).alias("energy")
    return pl.DataFrame(
        [
            *(samples[name] for name in ("run", "robot", "sample")),
            pl.Series("tile", read.tile),
            energy,
            pl.Series("observation", read.observation),
        ]
    )


def _laid_out(
    floors: Sequence[Floor],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
    """Return the floors' geometries, (floors, 6); start of each one's tiles; tiles of all floors, concatenated."""
    places = np.array([floor.geometry for floor in floors], dtype=np.float64).reshape(-1, 6)
    distinct = {id(floor): floor for floor in floors}
    first = dict(
        zip(distinct, accumulate((f.tiles.size for f in distinct.values()), initial=0), strict=False)
    )
    tiles = [floor.tiles.ravel() for floor in distinct.values()]
    return (
        places,
        np.array([first[id(floor)] for floor in floors], dtype=np.int64),
        np.concatenate(tiles) if tiles else np.zeros(0, dtype=np.uint8),
    )
