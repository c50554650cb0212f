"""The difficulty of a floor: how its vibrating tiles cluster.

| name | symbol | unit | shape | equation |
|---|---|---|---|---|
| tiles | E, c_i | 1 vibrating, 0 still | (rows, columns) | Eq. 1 |
| fill_ratio | f | - | scalar | share of ones, Eq. 3 |
| neighbours | w_ij | 1 or 0 | pairs | 1 if tiles i and j share a side (no wrap-around); each pair counts twice |
| moran_index | E_MI | - | scalar | N / sum w_ij * sum w_ij (c_i - f)(c_j - f) / sum (c_i - f)^2 |
| ones | N_v | tiles | scalar | number of vibrating tiles, N f |
| clusters | C_1..C_M | tiles | (M,) | vibrating tiles joined through shared sides (4-connected) |
| cluster entropy | H_c | bit | scalar | - sum_i abs(C_i)/N_v log2(abs(C_i)/N_v) |
| its maximum | H_c^max | bit | scalar | log2(N_v): every vibrating tile alone |
| entropy | E_e | - | scalar | (H_c^max - H_c) / H_c^max: 0 if each vibrating tile is alone, 1 if all form one cluster |

Moran index: near 1 large patches, near 0 tiles placed at random, near -1 a checkerboard. Source: the paper's
equations of the Moran index and of the entropy, after Bartashevich and Mostaghim (2019).

Of several kinds of tile the products and squares of the Moran index are summed over the indicators of all kinds, and
clusters are those of each kind but 0; both are the paper's for two kinds. Values have the Moran index of their numbers,
and the clusters of tiles of 1/2 or more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibroswarm.floors.floor import Floor, as_levels, as_tiles


@dataclass(frozen=True)
class Difficulty:
    """Measures of a floor; ``moran_index`` and ``entropy`` are nan where undefined."""

    rows: int
    columns: int
    ones: int
    fill_ratio: float
    moran_index: float
    entropy: float
    clusters: int
    largest_cluster: int


def moran_index(tiles: ArrayLike) -> float:
    """Return the Moran index E_MI of a floor (Eq. 4), -1 (checkerboard) to 1 (large patches); nan if all are alike."""
    levels = as_levels(tiles)
    rows, columns = levels.shape
    kinds = range(int(levels.max()) + 1) if levels.max() > 1 else ()
    products = squares = 0.0
    for grid in [levels == kind for kind in kinds] or [levels]:
        apart = grid - grid.sum() / grid.size  # c_i - f
        products += np.sum(apart[:, 1:] * apart[:, :-1]) + np.sum(apart[1:] * apart[:-1])
        squares += np.sum(apart * apart)
    if levels.min() == levels.max():
        return math.nan
    # Each pair of neighbours is counted once here, and twice in Eq. 4; the factor 2 cancels.
    pairs = rows * (columns - 1) + columns * (rows - 1)
    return float(rows * columns / pairs * products / squares)  # Eq. 4


def cluster_sizes(tiles: ArrayLike) -> NDArray[np.int64]:
    """Return the number of tiles of each cluster of tiles of one kind but 0 (4-connected), largest first."""
    from scipy import ndimage  # here, so that importing this module does not load SciPy

    grid = as_tiles(tiles)
    # scipy's default structure joins through sides only; label 0, that of other tiles, is left out
    labels = [ndimage.label(grid == kind)[0] for kind in range(1, max(int(grid.max()), 1) + 1)]
    return np.sort(np.concatenate([np.bincount(each.ravel())[1:] for each in labels]))[::-1]


def entropy(tiles: ArrayLike, ones: int | None = None) -> float:
    """Return the entropy E_e of a floor (Eq. 5): 0 if every vibrating tile is alone, 1 if all form one cluster.

    ``ones`` replaces N_v: the paper's table uses 48 for all floors. It is nan if at most one tile vibrates.
    """
    return _entropy(cluster_sizes(tiles), ones)


def _entropy(sizes: NDArray[np.int64], ones: int | None = None) -> float:
    total = int(sizes.sum()) if ones is None else ones
    if total < 2 or sizes.size == 0:
        return math.nan
    shares = sizes / total
    most = math.log2(total)  # H_c^max
    # Eq. 5, with H_c = -sum(shares log2 shares). max: rounding must not give a number below 0, or -0.0.
    return max(0.0, (most + float(np.sum(shares * np.log2(shares)))) / most)


def measure(levels: ArrayLike) -> Difficulty:
    """Return all measures of a floor.

    Args:
        levels: (rows, columns) of kinds, such as 0 and 1, or of values from 0 to 1.
    Raises:
        InputError: ``levels`` is not a rectangle of levels.
    """
    return measure_floor(Floor.filling(levels))


def measure_floor(floor: Floor) -> Difficulty:
    """Return all measures of a floor at time 0; patches, which no tile shows, count in the fill ratio alone."""
    sizes = cluster_sizes(floor.tiles)
    return Difficulty(
        rows=floor.tiles.shape[0],
        columns=floor.tiles.shape[1],
        ones=int((floor.tiles == 1).sum()),
        fill_ratio=floor.fill_ratio,
        moran_index=moran_index(floor.levels),
        entropy=_entropy(sizes),
        clusters=sizes.size,
        largest_cluster=int(sizes.max(initial=0)),
    )
