"""How hard a floor is to judge: how its tiles hang together.

| name | symbol | unit | shape | equation |
|---|---|---|---|---|
| tiles | E, c_i | 1 vibrating, 0 still | (rows, columns) | Eq. 1 |
| fill_ratio | f | - | scalar | share of ones, Eq. 3 |
| neighbours | w_ij | 1 or 0 | pairs | tiles that share a side, no wrap-around; every ordered pair once |
| moran_index | E_MI | - | scalar | N / sum w_ij * sum w_ij (c_i - f)(c_j - f) / sum (c_i - f)^2 |
| ones | N_v | tiles | scalar | number of vibrating tiles, N f |
| clusters | C_1..C_M | tiles | (M,) | vibrating tiles joined through shared sides (4-connected) |
| cluster entropy | H_c | bit | scalar | - sum_i abs(C_i)/N_v log2(abs(C_i)/N_v) |
| its maximum | H_c^max | bit | scalar | log2(N_v): every vibrating tile alone |
| entropy | E_e | - | scalar | (H_c^max - H_c) / H_c^max: 0 all tiles alone, 1 one cluster |

Moran index: near 1 large patches, near 0 tiles thrown at random, near -1 a checkerboard. Source: the paper's
equations of the Moran index and of the entropy, after Bartashevich and Mostaghim (2019).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import as_tiles


@dataclass(frozen=True)
class Difficulty:
    """What ``measure`` found on a floor; ``moran_index`` and ``entropy`` are nan where they have no value.

    Args:
        rows, columns: how many tiles there are. ones: how many of them vibrate. fill_ratio: which share.
        moran_index, entropy: E_MI (Eq. 4) and E_e (Eq. 5). clusters: of vibrating tiles. largest_cluster: its tiles.
    """

    rows: int
    columns: int
    ones: int
    fill_ratio: float
    moran_index: float
    entropy: float
    clusters: int
    largest_cluster: int


def moran_index(tiles: ArrayLike) -> float:
    """The Moran index E_MI of a floor: how alike neighbouring tiles are.

    Args:
        tiles: (rows, columns) of 0 and 1.
    Returns: about -1 (checkerboard) to 1 (large patches); nan where all tiles are alike, which leaves 0 / 0.
    Raises:
        InputError: not a rectangle of 0 and 1.
    """
    grid = as_tiles(tiles)
    rows, columns = grid.shape
    ones = int(grid.sum())
    if ones in (0, grid.size):
        return math.nan
    apart = grid - ones / grid.size
    # Each unordered pair once above and below: the factor 2 of the ordered pairs cancels.
    pairs = rows * (columns - 1) + columns * (rows - 1)
    alike = np.sum(apart[:, 1:] * apart[:, :-1]) + np.sum(apart[1:] * apart[:-1])
    return float(grid.size / pairs * alike / np.sum(apart * apart))


def cluster_sizes(tiles: ArrayLike) -> NDArray[np.int64]:
    """Sizes of the clusters of vibrating tiles (4-connected), in tiles, largest first, shape (M,)."""
    from scipy import ndimage

    labels, _ = ndimage.label(as_tiles(tiles))  # scipy's default structure joins through sides only
    sizes = np.bincount(np.asarray(labels).ravel())[1:].astype(np.int64)
    return np.sort(sizes)[::-1]


def entropy(tiles: ArrayLike, ones: int | None = None) -> float:
    """The entropy E_e of a floor: 0 where every vibrating tile is alone, 1 where all are one cluster.

    Args:
        tiles: (rows, columns) of 0 and 1.
        ones: N_v where it shall not be the true number of vibrating tiles (at least 2). The paper's table
            took 48 for all its floors, those of 46 vibrating tiles included.
    Returns: in [0, 1] with the true N_v; nan with fewer than two vibrating tiles, where H_c^max is 0.
    Raises:
        InputError: not a rectangle of 0 and 1, or ``ones`` below 2.
    """
    return _entropy(cluster_sizes(tiles), ones)


def measure(tiles: ArrayLike) -> Difficulty:
    """All measures of a floor at once.

    Args:
        tiles: (rows, columns) of 0 and 1.
    Raises:
        InputError: not a rectangle of 0 and 1.
    """
    grid = as_tiles(tiles)
    sizes = cluster_sizes(grid)
    ones = int(grid.sum())
    return Difficulty(
        rows=grid.shape[0],
        columns=grid.shape[1],
        ones=ones,
        fill_ratio=ones / grid.size,
        moran_index=moran_index(grid),
        entropy=_entropy(sizes, None),
        clusters=sizes.size,
        largest_cluster=int(sizes[0]) if sizes.size else 0,
    )


def _entropy(sizes: NDArray[np.int64], ones: int | None) -> float:
    if ones is not None and ones < 2:
        raise InputError(f"{ones} is too few; the entropy needs at least 2 vibrating tiles", field="ones")
    total = int(sizes.sum()) if ones is None else ones
    if total < 2 or sizes.size == 0:
        return math.nan
    shares = sizes / total
    most = math.log2(total)
    return max(0.0, (most + float(np.sum(shares * np.log2(shares)))) / most)  # not -0.0 by rounding
