"""The reading of a sample: energy E and bit O, from the tile below and one uniform number.

| name | symbol | unit | shape | equation |
|---|---|---|---|---|
| energy | E | RMS of the filtered acceleration | (samples,) | the tile kind's quantile of u |
| threshold | theta_E | as E | scalar | |
| observation | O | 0, 1 | (samples,) | 1 if E > theta_E (Eq. 6): 1 if u > F(theta_E), E not needed |
| false positive, false negative | - | - | scalar | 1 - F_still(theta_E), F_vibrating(theta_E) |

Changing the floor changes no noise: the uniform number belongs to (seed, run, robot, sample). A place
without a tile does not vibrate and reads as a still tile does; its tile is -1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import accumulate
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import allocating_kernel, kernel, read_only, signed
from vibroswarm.draws import ALONE, SENSING, uniform
from vibroswarm.fields import Sensor
from vibroswarm.floors.floor import Floor
from vibroswarm.scenario import Scenario

OBSERVATIONS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "tile": pl.Int32,
    "energy": pl.Float32,
    "observation": pl.UInt8,
}


def share_below(sensor: Sensor, vibrating: bool) -> float:
    """F(theta_E): the probability that a tile of this kind reads as still."""
    if sensor.model == "energies":
        energies = np.sort(_measured(sensor, vibrating))
        return float(np.searchsorted(energies, sensor.rms_threshold, side="right")) / energies.size
    return _gamma_below(sensor.rms_threshold, *_gamma(sensor, vibrating))


@lru_cache(maxsize=64)
def _gamma_below(threshold: float, shape: float, scale: float, location: float) -> float:
    from scipy.special import gammainc

    return float(gammainc(shape, max(threshold - location, 0.0) / scale))


def error_rates(sensor: Sensor) -> tuple[float, float]:
    """(false positive, false negative): a still tile reads as vibrating, a vibrating one as still."""
    return 1.0 - share_below(sensor, False), share_below(sensor, True)


def energy_of(sensor: Sensor, vibrating: bool, u: NDArray[np.float64]) -> NDArray[np.float32]:
    """Energies at the quantiles ``u`` of a tile of this kind, shape as ``u``."""
    if sensor.model == "energies":
        energies = np.sort(_measured(sensor, vibrating))
        return energies[(u * energies.size).astype(np.int64)].astype(np.float32)
    from scipy.special import gammaincinv

    shape, scale, location = _gamma(sensor, vibrating)
    return (scale * gammaincinv(shape, u) + location).astype(np.float32)


def energies_of(sensor: Sensor, vibrating: NDArray[np.bool_], u: NDArray[np.float64]) -> NDArray[np.float32]:
    """``energy_of`` for places of both kinds, shape as ``u``."""
    energy = np.empty(u.size, dtype=np.float32)
    for kind in (False, True):
        energy[vibrating == kind] = energy_of(sensor, kind, u[vibrating == kind])
    return energy


def vibrating_at(floor: Floor, tile: NDArray[np.integer[Any]]) -> NDArray[np.bool_]:
    """Whether the tiles of these indices vibrate; where there is none (-1), nothing does."""
    flat = np.append(floor.tiles.ravel(), 0)  # index -1 is the last
    return np.asarray(flat[tile] == 1)


def _gamma(sensor: Sensor, vibrating: bool) -> tuple[float, float, float]:
    if vibrating:
        return sensor.vibrating_shape, sensor.vibrating_scale, sensor.vibrating_location
    return sensor.still_shape, sensor.still_scale, sensor.still_location


def _measured(sensor: Sensor, vibrating: bool) -> NDArray[np.float64]:
    values = sensor.vibrating_energies if vibrating else sensor.still_energies
    assert values is not None, "checked by Scenario"
    return np.asarray(values, dtype=np.float64)


@allocating_kernel
def sensing_numbers(
    seed: int, run: NDArray[np.uint32], robot: NDArray[np.uint16], sample: NDArray[np.uint32]
) -> NDArray[np.float64]:
    """The uniform number of each sample, shape (samples,)."""
    out = np.empty(run.size, dtype=np.float64)
    for k in range(run.size):
        out[k] = uniform(seed, int(run[k]), signed(robot[k]), SENSING, signed(sample[k]), ALONE)
    return out


@kernel
def tile_below(
    x_m: float,
    y_m: float,
    left_m: float,
    top_m: float,
    width_m: float,
    height_m: float,
    rows: int,
    columns: int,
) -> int:
    """Index of the tile under a point; -1 where there is none (as ``Floor.tile_at``, with the tiles' top edge)."""
    column, row = np.floor((x_m - left_m) / width_m), np.floor((top_m - y_m) / height_m)
    if column >= 0 and row >= 0 and column < columns and row < rows:
        index: int = int(row) * columns + int(column)
        return index
    return -1


@kernel
def read_samples(
    seed: int,
    bounds: NDArray[np.int64],
    runs: NDArray[np.int64],
    robot: NDArray[np.uint16],
    sample: NDArray[np.uint32],
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    places: NDArray[np.float64],
    first_tiles: NDArray[np.int64],
    tiles: NDArray[np.uint8],
    shares_below: tuple[float, float],
    tile: NDArray[np.int32],
    observation: NDArray[np.uint8],
    vibrating: NDArray[np.bool_],
    numbers: NDArray[np.float64],
) -> None:
    """What the samples read.

    Args:
        bounds: the rows of run r are those from ``bounds[r]`` to ``bounds[r + 1]``. robot to y_m: (rows,).
        places: (runs, 6): ``Floor.geometry``. first_tiles: (runs,): where in ``tiles`` each run's begin.
        shares_below: F(theta_E) of still and of vibrating tiles.
        tile, observation: (rows,), written. vibrating, numbers: (rows,), written, or of no rows.
    """
    wanted = numbers.size > 0
    for r in range(runs.size):
        rows, columns, width_m, height_m, left_m, bottom_m = places[r]
        top_m = bottom_m + rows * height_m
        for k in range(bounds[r], bounds[r + 1]):
            at = tile_below(x_m[k], y_m[k], left_m, top_m, width_m, height_m, int(rows), int(columns))
            vibrates = at >= 0 and tiles[first_tiles[r] + at] == 1
            u = uniform(seed, runs[r], signed(robot[k]), SENSING, signed(sample[k]), ALONE)
            tile[k], observation[k] = at, u > shares_below[int(vibrates)]
            if wanted:
                vibrating[k], numbers[k] = vibrates, u


def observe(
    scenario: Scenario,
    seed: int,
    samples: pl.DataFrame,
    floors: Mapping[int, Floor],
    *,
    energies: bool = True,
) -> pl.DataFrame:
    """The observation table of a motion table.

    Args:
        samples: the motion table; its order is kept.
        floors: the floor of each run.
        energies: also compute the energies (else null); the bits are the same.
    """
    run, count = samples["run"].to_numpy(), samples.height
    begins = np.r_[0, np.flatnonzero(run[1:] != run[:-1]) + 1] if count else np.zeros(0, dtype=np.int64)
    runs = run[begins].astype(np.int64)
    places, first_tiles, tiles = _laid_out([floors[number] for number in runs.tolist()])
    tile, observation = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.uint8)
    vibrating, numbers = (
        np.empty(count if energies else 0, dtype=np.bool_),
        np.empty(count if energies else 0),
    )
    read_samples(
        seed,
        np.append(begins, count),
        runs,
        read_only(samples["robot"].to_numpy()),
        read_only(samples["sample"].to_numpy()),
        read_only(samples["x_m"].to_numpy()),
        read_only(samples["y_m"].to_numpy()),
        places,
        first_tiles,
        tiles,
        (share_below(scenario.sensor, False), share_below(scenario.sensor, True)),
        tile,
        observation,
        vibrating,
        numbers,
    )
    energy = pl.Series("energy", [None], dtype=pl.Float32).new_from_index(0, count)
    if energies:
        energy = pl.Series("energy", energies_of(scenario.sensor, vibrating, numbers))
    return pl.DataFrame(
        [
            *(samples[name] for name in ("run", "robot", "sample")),
            pl.Series("tile", tile),
            energy,
            pl.Series("observation", observation),
        ]
    )


def _laid_out(
    floors: Sequence[Floor],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
    """The floors' geometries, (floors, 6); where each one's tiles begin; the tiles of all, one after the other."""
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
