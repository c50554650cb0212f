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

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import allocating_kernel
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
    from scipy.special import gammainc

    shape, scale, location = _gamma(sensor, vibrating)
    return float(gammainc(shape, max(sensor.rms_threshold - location, 0.0) / scale))


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
        out[k] = uniform(seed, int(run[k]), int(robot[k]), SENSING, int(sample[k]), ALONE)
    return out


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
    run = samples["run"].to_numpy()
    u = sensing_numbers(seed, run, samples["robot"].to_numpy(), samples["sample"].to_numpy())
    tile, vibrating = _tiles_below(samples, run, floors)
    below = np.where(vibrating, share_below(scenario.sensor, True), share_below(scenario.sensor, False))
    energy: pl.Expr | pl.Series = pl.lit(None, dtype=pl.Float32)
    if energies:
        energy = pl.Series(energies_of(scenario.sensor, vibrating, u))
    return samples.select("run", "robot", "sample").with_columns(
        tile=pl.Series(tile, dtype=pl.Int32),
        energy=energy,
        observation=pl.Series((u > below).astype(np.uint8), dtype=pl.UInt8),
    )


def _tiles_below(
    samples: pl.DataFrame, run: NDArray[np.uint32], floors: Mapping[int, Floor]
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Tile index below each sample, and whether it vibrates."""
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    tile = np.empty(run.size, dtype=np.int32)
    vibrating = np.zeros(run.size, dtype=np.bool_)
    bounds = (
        np.r_[0, np.flatnonzero(run[1:] != run[:-1]) + 1, run.size] if run.size else np.zeros(1, np.int64)
    )
    for start, end in pairwise(bounds):
        floor = floors[int(run[start])]
        part = slice(int(start), int(end))
        tile[part] = floor.tile_at(x[part], y[part])
        vibrating[part] = vibrating_at(floor, tile[part])
    return tile, vibrating
