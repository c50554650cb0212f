"""Test whether the energies of a log were read on this floor, or on one of its rotations or mirror images.

| name | symbol | equation |
|---|---|---|
| energy of a tile | m_t | mean of ln E over the samples on tile t |
| contrast | C | mean of m_t over vibrating tiles minus that over still ones, sampled tiles only |
| p-value | p | share of random floors with as many vibrating tiles whose contrast is at least C |

A tile counts once however often it was sampled: neighbouring samples are not independent, tiles are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor

FLOORS: Final = 20_000
"""Number of random floors."""
UNLIKELY: Final = 0.01
LIKELY: Final = 0.001
AGAINST: Final = 10.0
"""An orientation whose p-value is smaller by this factor is taken as the right one."""

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
    """Fit of one orientation of a floor."""

    orientation: str
    contrast: float
    probability: float
    """p-value: probability that a random floor fits as well."""


def turned(tiles: NDArray[np.uint8], orientation: str) -> NDArray[np.uint8]:
    """Return the tiles in one of ``ORIENTATIONS``."""
    k = ORIENTATIONS.index(orientation)
    if k < 4:
        return np.rot90(tiles, k)
    mirrored = (np.fliplr(tiles), np.flipud(tiles), tiles.T, np.rot90(tiles, 2).T)
    return mirrored[k - 4]


def floor_fits(floor: Floor, samples: pl.DataFrame) -> list[FloorFit]:
    """Return how well the floor fits the energies in each orientation that keeps its shape, best first.

    An orientation in which all sampled tiles are of one kind is left out. Empty if fewer than four tiles were
    sampled, or if all tiles of the floor are of one kind.

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
    fits = []
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
        fits.append(FloorFit(orientation, contrast, (above + 1) / (FLOORS + 1)))
    return sorted(fits, key=lambda fit: -fit.contrast)


def _random_contrasts(mean: NDArray[np.float64], ones: int) -> NDArray[np.float64]:
    """Return the contrasts, (``FLOORS``,), of random floors with ``ones`` vibrating tiles among those sampled.

    Args:
        mean: mean logarithm of the energy of each sampled tile.
    """
    u = uniforms(0, 0, 0, Purpose.BOOTSTRAP, FLOORS * mean.size).reshape(FLOORS, mean.size)
    chosen = np.argpartition(u, ones - 1, axis=1)[:, :ones]
    upper = mean[chosen].sum(axis=1)
    return np.asarray(upper / ones - (mean.sum() - upper) / (mean.size - ones))


def check_floor(floor: Floor, samples: pl.DataFrame) -> str:
    """Return a sentence that says whether the floor fits the energies, may be wrong, or cannot be tested.

    Raises:
        InputError: the floor fits clearly better if it is rotated or mirrored.
    """
    fits = floor_fits(floor, samples)
    if not fits:
        return (
            "The fit of the floor is inconclusive: too few of its tiles were sampled, or all are of one kind."
        )
    as_given = next((fit for fit in fits if fit.orientation == ORIENTATIONS[0]), None)
    if as_given is None:
        return "The fit of the floor is inconclusive: all sampled tiles are of one kind."
    best = fits[0]
    odds = f"of random floors {_percent(as_given.probability)} fit the energies as well"
    if as_given.probability < UNLIKELY and best is as_given:
        return f"The floor fits: {odds}."
    if best.probability < LIKELY and as_given.probability > AGAINST * best.probability:
        turn = best.orientation[0].upper() + best.orientation[1:]
        raise InputError(
            f"'{floor.name or 'this floor'}' does not fit: {odds}. {turn} it fits "
            f"({_percent(best.probability)}). Correct the floor's file, or add --any-floor to continue",
            field="--floor",
        )
    better = (
        "" if best is as_given else f"; {best.orientation} it would fit better ({_percent(best.probability)})"
    )
    return f"The floor may be wrong: {odds}{better}."


def _percent(share: float) -> str:
    return "less than 0.01 %" if share < 1e-4 else f"{100 * share:.2g} %"
