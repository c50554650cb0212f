"""Whether the energies of a log were read on this floor, or on one of its rotations or mirror images.

| name | symbol | equation |
|---|---|---|
| energy of a tile | m_t | mean of ln E over the samples on tile t |
| contrast | C | mean of m_t over vibrating tiles less that over still ones, tiles that were sampled |
| probability | p | share of floors with as many vibrating tiles, thrown at random, with a contrast of at least C |

A tile counts once however often it was sampled: neighbouring samples are not independent, tiles are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.draws import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor

FLOORS: Final = 20_000
"""Floors thrown at random that a floor is set against."""
UNLIKELY: Final = 0.01
LIKELY: Final = 0.001
AGAINST: Final = 10.0
"""An orientation this much less probable to fit by chance is taken for the right one."""

ORIENTATIONS: Final = (
    "as it is",
    "turned by 90 degrees anticlockwise",
    "turned by 180 degrees",
    "turned by 90 degrees clockwise",
    "mirrored left to right",
    "mirrored top to bottom",
    "mirrored along the diagonal from the top left",
    "mirrored along the diagonal from the top right",
)


@dataclass(frozen=True)
class FloorFit:
    """How well one orientation of a floor fits."""

    orientation: str
    contrast: float
    probability: float
    """Of a floor thrown at random fitting as well."""


def turned(tiles: NDArray[np.uint8], orientation: str) -> NDArray[np.uint8]:
    """The tiles in one of ``ORIENTATIONS``."""
    k = ORIENTATIONS.index(orientation)
    if k < 4:
        return np.rot90(tiles, k)
    made = (np.fliplr(tiles), np.flipud(tiles), tiles.T, np.rot90(tiles, 2).T)
    return made[k - 4]


def floor_fits(floor: Floor, samples: pl.DataFrame) -> list[FloorFit]:
    """How well the floor fits in each orientation of its shape, the best first; empty: too few tiles were sampled.

    Args:
        samples: x_m, y_m, energy.
    """
    tile = floor.tile_at(samples["x_m"].to_numpy(), samples["y_m"].to_numpy())
    energy = samples["energy"].to_numpy()
    on = (tile >= 0) & (energy > 0)
    count = np.bincount(tile[on], minlength=floor.tiles.size)
    total = np.bincount(tile[on], np.log(energy[on]), floor.tiles.size)
    seen = count > 0
    if seen.sum() < 4 or floor.tiles.all() or not floor.tiles.any():
        return []
    mean = total[seen] / count[seen]
    found = []
    nulls: dict[int, NDArray[np.float64]] = {}
    for orientation in ORIENTATIONS:
        tiles = turned(floor.tiles, orientation)
        if tiles.shape != floor.tiles.shape:
            continue
        ones = tiles.ravel()[seen] == 1
        if not ones.any() or ones.all():
            continue
        if int(ones.sum()) not in nulls:
            nulls[int(ones.sum())] = _random_contrasts(mean, int(ones.sum()))
        contrast = float(mean[ones].mean() - mean[~ones].mean())
        above = int((nulls[int(ones.sum())] >= contrast - 1e-12).sum())
        found.append(FloorFit(orientation, contrast, (above + 1) / (FLOORS + 1)))
    return sorted(found, key=lambda fit: -fit.contrast)


def _random_contrasts(mean: NDArray[np.float64], ones: int) -> NDArray[np.float64]:
    """Contrasts of floors thrown at random, (FLOORS,)."""
    u = uniforms(0, 0, 0, Purpose.BOOTSTRAP, FLOORS * mean.size).reshape(FLOORS, mean.size)
    chosen = np.argpartition(u, ones - 1, axis=1)[:, :ones]
    upper = mean[chosen].sum(axis=1)
    return np.asarray(upper / ones - (mean.sum() - upper) / (mean.size - ones))


def check_floor(floor: Floor, samples: pl.DataFrame) -> str:
    """What is to be said of the floor's fit.

    Raises:
        InputError: the energies do not fit it, and fit it turned or mirrored.
    """
    fits = floor_fits(floor, samples)
    if not fits:
        return "Whether the floor fits cannot be told: too few of its tiles were sampled, or all are alike."
    mine = next((fit for fit in fits if fit.orientation == ORIENTATIONS[0]), None)
    if mine is None:
        return "Whether the floor fits cannot be told: the tiles that were sampled are all alike."
    best = fits[0]
    odds = f"of floors thrown at random {_percent(mine.probability)} fit the energies as well"
    if mine.probability < UNLIKELY and best is mine:
        return f"The floor fits: {odds}."
    if best.probability < LIKELY and mine.probability > AGAINST * best.probability:
        turn = best.orientation[0].upper() + best.orientation[1:]
        raise InputError(
            f"'{floor.name or 'this floor'}' does not fit: {odds}. {turn} it fits "
            f"({_percent(best.probability)}). Mend the floor's file, or say --any-floor to go on",
            field="--floor",
        )
    better = (
        "" if best is mine else f"; {best.orientation} it would fit better ({_percent(best.probability)})"
    )
    return f"The floor may be wrong: {odds}{better}."


def _percent(share: float) -> str:
    return "less than 0.01 %" if share < 1e-4 else f"{100 * share:.2g} %"
