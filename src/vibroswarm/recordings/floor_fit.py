"""Test whether the energies of a log were read on a given floor, or on one of its rotations or mirror images.

The contrast C is the mean of m_t over vibrating tiles minus that over still ones, with m_t the mean of ln E (of bits,
their mean) over the samples on tile t. p is the share of random floors, with as many vibrating tiles among those
sampled, whose contrast is at least C. Each tile counts once, because neighbouring samples are not independent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import percent, stated
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor

Tiles = NDArray[np.uint8]
FLOORS: Final = 20_000
UNLIKELY: Final = 0.01
"""A floor with a p-value below this fits, if no other orientation fits better."""
LIKELY: Final = 0.001
"""Another orientation may be taken as the right one if its p-value is below this; see ``AGAINST``."""
AGAINST: Final = 10.0
"""Another orientation is taken as the right one if its p-value is below ``LIKELY``, and smaller than that of the floor
as given by more than the factor ``AGAINST``."""

ORIENTATIONS: Final[dict[str, Callable[[Tiles], Tiles]]] = {
    "as it is": lambda tiles: tiles,
    "turned by 90 degrees anticlockwise": np.rot90,
    "turned by 180 degrees": lambda tiles: np.rot90(tiles, 2),
    "turned by 90 degrees clockwise": lambda tiles: np.rot90(tiles, 3),
    "mirrored left to right": np.fliplr,
    "mirrored top to bottom": np.flipud,
    "mirrored along the diagonal from the top left": np.transpose,
    "mirrored along the diagonal from the top right": lambda tiles: np.rot90(tiles, 2).T,
}


@dataclass(frozen=True)
class FloorFit:
    """Fit of one orientation of a floor: contrast C, and p-value."""

    orientation: str
    contrast: float
    probability: float


def turned(tiles: Tiles, orientation: str) -> Tiles:
    """Return the tiles of a floor, (rows, columns), rotated or mirrored as one of ``ORIENTATIONS`` says."""
    return ORIENTATIONS[orientation](tiles)


def floor_fits(floor: Floor, samples: pl.DataFrame) -> list[FloorFit]:
    """Compute how well a floor fits the energies in each orientation, sorted by falling contrast.

    None if fewer than four tiles were sampled, or if the floor has still tiles only, vibrating ones only, or other
    kinds.

    Args:
        samples: with the columns x_m, y_m, energy and observation; observations count if no sample has an energy.
            Samples off all tiles, or with an energy of 0 among other energies, do not count.
    """
    tile = floor.tile_at(samples["x_m"].to_numpy(), samples["y_m"].to_numpy())
    has_energies = samples["energy"].count() > 0
    value = samples["energy" if has_energies else "observation"].cast(pl.Float64).to_numpy()
    is_bits = bool(np.isin(value, (0.0, 1.0)).all())
    on = (tile >= 0) & ((value > 0) | is_bits)
    count = np.bincount(tile[on], minlength=floor.tiles.size)
    total = np.bincount(tile[on], value[on] if is_bits else np.log(value[on]), floor.tiles.size)
    seen = count > 0
    if seen.sum() < 4 or floor.tiles.min() == 1 or floor.tiles.max() != 1:
        return []
    mean = total[seen] / count[seen]
    fits = []
    for orientation in ORIENTATIONS:
        tiles = turned(floor.tiles, orientation)
        if tiles.shape != floor.tiles.shape:
            continue
        vibrates = tiles.ravel()[seen] == 1
        if not vibrates.any() or vibrates.all():
            continue
        contrast = float(mean[vibrates].mean() - mean[~vibrates].mean())
        # Random floors that fit as well or better; equal contrasts may differ by rounding.
        above = int((_random_contrasts(mean, int(vibrates.sum())) >= contrast - 1e-12).sum())
        # The floor itself counts as one of the random floors, so that p is never 0.
        fits.append(FloorFit(orientation, contrast, probability=(above + 1) / (FLOORS + 1)))
    return sorted(fits, key=lambda fit: -fit.contrast)


def _random_contrasts(mean: Floats, ones: int) -> Floats:
    """Compute the contrasts of random floors with ``ones`` vibrating tiles among those sampled, (``FLOORS``,)."""
    # Seed, run and robot are 0: the same random floors for every log.
    u = uniforms(0, 0, 0, Purpose.BOOTSTRAP, FLOORS * mean.size).reshape(FLOORS, mean.size)
    # The tiles with the smallest uniform numbers vibrate: every set of ``ones`` tiles has the same probability.
    chosen = np.argpartition(u, ones - 1, axis=1)[:, :ones]
    upper = mean[chosen].sum(axis=1)
    return np.asarray(upper / ones - (mean.sum() - upper) / (mean.size - ones))


def check_floor(floor: Floor, samples: pl.DataFrame) -> str:
    """Return whether a floor fits, as a sentence; refuse one that fits clearly better rotated or mirrored."""
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    if (floor.tile_at(x, y) < 0).all():
        raise InputError(
            f"no sample lies on '{floor.name or 'this floor'}': their x is {stated(x.min())} to {stated(x.max())} m, "
            f"their y {stated(y.min())} to {stated(y.max())} m. "
            "Positions must be in metres from its lower left corner; correct them, or add --any-floor to continue",
            field="floor",
        )
    if floor.is_changing:
        samples = samples.filter(pl.col("time_s") < floor.changes.time_s[0])
    fits = floor_fits(floor, samples)
    as_given = next((fit for fit in fits if fit.orientation == "as it is"), None)
    if as_given is None:
        return "The fit of the floor is inconclusive: too few of its tiles were sampled, or they are of one kind."
    best = fits[0]
    evidence = f"of random floors {percent(as_given.probability, None, digits=2)} fit the energies as well"
    if as_given.probability < UNLIKELY and best is as_given:
        return f"The floor fits: {evidence}."
    if best.probability < LIKELY and as_given.probability > AGAINST * best.probability:
        raise InputError(
            f"'{floor.name or 'this floor'}' does not fit: {evidence}. It fits {best.orientation} "
            f"({percent(best.probability, None, digits=2)}). Correct the floor's file, or add --any-floor to continue",
            field="floor",
        )
    return f"The fit of the floor is inconclusive: {evidence}."
