"""The reading of a sample: energy E and bit O, from the tile below and one uniform number.

| name | symbol | unit | shape | equation |
|---|---|---|---|---|
| energy | E | RMS of the filtered acceleration | (samples,) | the tile kind's quantile of u |
| threshold | theta_E | as E | scalar | |
| observation | O | 0, 1 | (samples,) | 1 if E > theta_E (Eq. 6): 1 if u > F(theta_E), E not needed |
| false positive, false negative | - | - | scalar | 1 - F_still(theta_E), F_vibrating(theta_E) |

Changing the floor changes no noise: the uniform number belongs to (seed, run, robot, sample). A place
without a tile does not vibrate and reads as a still tile does; its tile is -1. Near edges, and where tiles or
robots differ (off in the paper), the tile that is read and a factor come from ``felt``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import allocating_kernel, kernel, read_only, signed
from vibroswarm.draws import ALONE, SENSING, uniform
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.felt import (
    Place,
    Response,
    factor_row,
    factors_differ,
    felt_tile,
    response_of,
    tile_below,
)
from vibroswarm.observation.reading import energies_of
from vibroswarm.scenario import Scenario

OBSERVATIONS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "tile": pl.Int32,
    "energy": pl.Float32,
    "observation": pl.UInt8,
}


def vibrating_at(floor: Floor, tile: NDArray[np.integer[Any]]) -> NDArray[np.bool_]:
    """Whether the tiles of these indices vibrate; where there is none (-1), nothing does."""
    flat = np.append(floor.tiles.ravel(), 0)  # index -1 is the last
    return np.asarray(flat[tile] == 1)


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
    response: Response,
    tile: NDArray[np.int32],
    observation: NDArray[np.uint8],
    vibrating: NDArray[np.bool_],
    numbers: NDArray[np.float64],
    factors: NDArray[np.float64],
) -> None:
    """What the samples read.

    Args:
        bounds: the rows of run r are those from ``bounds[r]`` to ``bounds[r + 1]``. robot to y_m: (rows,).
        places: (runs, 6): ``Floor.geometry``. first_tiles: (runs,): where in ``tiles`` each run's begin.
        tile, observation: (rows,), written. vibrating, numbers, factors: (rows,), written, or of no rows: of the
            tile that was felt.
    """
    wanted = numbers.size > 0
    for r in range(runs.size):
        rows, columns, width_m, height_m, left_m, bottom_m = places[r]
        place = Place(int(rows), int(columns), width_m, height_m, left_m, bottom_m + rows * height_m)
        own = tiles[first_tiles[r] : first_tiles[r] + place.rows * place.columns]
        for k in range(bounds[r], bounds[r + 1]):
            at = tile_below(x_m[k], y_m[k], place)
            i, number = signed(robot[k]), signed(sample[k])
            felt = felt_tile(x_m[k], y_m[k], at, place, own, response, seed, runs[r], i, number)
            vibrates = felt >= 0 and own[felt] == 1
            row = factor_row(response, r, i, felt)
            u = uniform(seed, runs[r], i, SENSING, number, ALONE)
            tile[k], observation[k] = at, u > response.shares_below[row, int(vibrates)]
            if wanted:
                vibrating[k], numbers[k], factors[k] = vibrates, u, response.factors[row]


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
    own_floors = [floors[number] for number in runs.tolist()]
    places, first_tiles, tiles = _laid_out(own_floors)
    tile, observation = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.uint8)
    kept = count if energies else 0
    vibrating, numbers, factors = np.empty(kept, dtype=np.bool_), np.empty(kept), np.empty(kept)
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
        response_of(scenario, seed, runs, [floor.tiles.size for floor in own_floors]),
        tile,
        observation,
        vibrating,
        numbers,
        factors,
    )
    energy = pl.Series("energy", [None], dtype=pl.Float32).new_from_index(0, count)
    if energies:
        differ = factors if factors_differ(scenario.sensor) else None
        energy = pl.Series("energy", energies_of(scenario.sensor, vibrating, numbers, differ))
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
