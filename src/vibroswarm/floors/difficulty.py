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

The module also has the paper's table of difficulties, with the correct values beside the printed ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, as_tiles
from vibroswarm.floors.source import pattern
from vibroswarm.floors.surfaces import STEPS, steps_of


@dataclass(frozen=True)
class Difficulty:
    """Measures of a floor; ``moran_index`` and ``entropy`` are nan where undefined.

    Args:
        rows, columns: size of the floor, tiles. ones: number of vibrating tiles. fill_ratio: share of vibrating tiles.
        moran_index, entropy: E_MI (Eq. 4) and E_e (Eq. 5). clusters: number of clusters of vibrating tiles.
        largest_cluster: number of tiles of the largest cluster; 0 if no tile vibrates.
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
    """Return the Moran index E_MI of a floor (Eq. 4): how similar neighbouring tiles are.

    Args:
        tiles: (rows, columns) of kinds, such as 0 and 1.
    Returns: from about -1 (checkerboard) to 1 (large patches); nan (0 / 0) if all tiles are of one kind.
    Raises:
        InputError: ``tiles`` is not a rectangle of kinds.
    """
    grid = as_tiles(tiles)
    if grid.max() > 1:
        return _moran_of([grid == kind for kind in range(int(grid.max()) + 1)])
    return _moran_of([grid])


def moran_of_values(values: ArrayLike) -> float:
    """Return the Moran index of a floor whose tiles have values, (rows, columns); nan if all are equal."""
    return _moran_of([np.asarray(values, dtype=np.float64)])


def _moran_of(grids: Sequence[NDArray[Any]]) -> float:
    """Return the Moran index of numbers of tiles, (rows, columns) each, whose products and squares are added up."""
    rows, columns = grids[0].shape
    products = squares = 0.0
    for grid in grids:
        apart = grid - grid.sum() / grid.size  # c_i - f
        products += np.sum(apart[:, 1:] * apart[:, :-1]) + np.sum(apart[1:] * apart[:-1])
        squares += np.sum(apart * apart)
    if all(grid.min() == grid.max() for grid in grids):
        return math.nan
    # Each pair of neighbours is counted once here, and twice in Eq. 4; the factor 2 cancels.
    pairs = rows * (columns - 1) + columns * (rows - 1)
    return float(rows * columns / pairs * products / squares)  # Eq. 4


def cluster_sizes(tiles: ArrayLike) -> NDArray[np.int64]:
    """Return the number of tiles of each cluster of tiles of one kind but 0 (4-connected), largest first.

    Args:
        tiles: (rows, columns) of kinds, such as 0 and 1.
    Returns: shape (number of clusters,).
    Raises:
        InputError: ``tiles`` is not a rectangle of kinds.
    """
    from scipy import ndimage  # here, so that importing this module does not load SciPy

    grid, sizes = as_tiles(tiles), []
    for kind in range(1, max(int(grid.max()), 1) + 1):
        labels, _ = ndimage.label(grid == kind)  # scipy's default structure joins through sides only
        # Label 0, that of other tiles, is left out.
        sizes.append(np.bincount(np.asarray(labels).ravel())[1:].astype(np.int64))
    return np.sort(np.concatenate(sizes))[::-1]


def entropy(tiles: ArrayLike, ones: int | None = None) -> float:
    """Return the entropy E_e of a floor (Eq. 5): 0 if every vibrating tile is alone, 1 if all form one cluster.

    Args:
        tiles: (rows, columns) of 0 and 1.
        ones: N_v, at least 2; None: the number of tiles that vibrate. Other values serve to reproduce the paper's
            table, which uses N_v = 48 for all floors, even for those with 46 vibrating tiles.
    Returns: in [0, 1] if ``ones`` is None. nan if no tile vibrates; and if ``ones`` is None and a single tile vibrates,
        as H_c^max is then 0.
    Raises:
        InputError: ``tiles`` is not a rectangle of 0 and 1, or ``ones`` is below 2.
    """
    return _entropy(cluster_sizes(tiles), ones)


def measure_floor(floor: Floor) -> Difficulty:
    """Return all measures of a floor at time 0; patches, which no tile shows, count in the fill ratio alone."""
    values = floor.surface.values
    found = measure(floor.tiles, None if values is None else values / STEPS)
    return replace(found, fill_ratio=floor.fill_ratio) if floor.has_patches else found


def measure(tiles: ArrayLike, values: ArrayLike | None = None) -> Difficulty:
    """Return all measures of a floor.

    Args:
        tiles: (rows, columns) of kinds, such as 0 and 1. values: of the same tiles, from 0 to 1; None: they have none.
    Raises:
        InputError: ``tiles`` is not a rectangle of kinds, or ``values`` is not one of numbers from 0 to 1, of the same
            size.
    """
    grid = as_tiles(tiles)
    if values is not None and (shape := steps_of(values, "values").shape) != grid.shape:
        raise InputError(f"are of shape {shape}, and the tiles of {grid.shape}", field="values")
    sizes = cluster_sizes(grid)
    ones = int((grid == 1).sum())
    return Difficulty(
        rows=grid.shape[0],
        columns=grid.shape[1],
        ones=ones,
        fill_ratio=ones / grid.size if values is None else float(np.mean(np.asarray(values))),
        moran_index=moran_index(grid) if values is None else moran_of_values(values),
        entropy=_entropy(sizes, None),
        clusters=sizes.size,
        largest_cluster=int(sizes[0]) if sizes.size else 0,
    )


def _entropy(sizes: NDArray[np.int64], ones: int | None) -> float:
    """Return the entropy E_e of a floor.

    Args:
        sizes: number of tiles of each cluster of vibrating tiles. ones: N_v; None: the sum of ``sizes``.
    Returns: nan if there are no clusters; and if ``ones`` is None and a single tile vibrates, as H_c^max is then 0.
    Raises:
        InputError: ``ones`` is below 2.
    """
    if ones is not None and ones < 2:
        raise InputError(f"{ones} is too few; the entropy needs at least 2 vibrating tiles", field="ones")
    total = int(sizes.sum()) if ones is None else ones
    if total < 2 or sizes.size == 0:
        return math.nan
    shares = sizes / total
    most = math.log2(total)  # H_c^max
    # Eq. 5, with H_c = -sum(shares log2 shares). max: rounding must not give a number below 0, or -0.0.
    return max(0.0, (most + float(np.sum(shares * np.log2(shares)))) / most)


_PRINTED: Final = {
    "diagonal": (0.73, 1.00, 0.71, 0.99),
    "stripe": (0.88, 1.00, 0.88, 0.99),
    "block-diagonal": (0.76, 0.85, 0.75, 0.84),
    "alternating": (-0.96, 0.00, -0.91, 0.00),
    "random-fixed": (0.00, 0.51, -0.05, 0.46),
}
"""Printed values by pattern: Moran index and entropy at a fill ratio of 0.48, then Moran index and entropy at 0.46."""
_PAPER_ONES: Final = 48
"""The number N_v of vibrating tiles that the paper uses for all entropies."""


@dataclass(frozen=True)
class Entry:
    """One number of the paper's table.

    Args:
        pattern: name of the floor, as in ``source.NAMES``. measure: "Moran index" or "entropy".
        printed: the number in the paper.
        as_the_paper: the number computed as the paper did, on the floor that it used and with N_v = 48.
        right: the correct number, on the floor of the stated fill ratio and with its true N_v.
    """

    pattern: str
    measure: str
    printed: float
    as_the_paper: float
    right: float

    @property
    def wrong(self) -> bool:
        """Whether the printed number is not the correct one, rounded to two decimals."""
        return abs(self.printed - self.right) > 0.005 + 1e-9  # 1e-9: for floating-point rounding


def paper_table() -> list[Entry]:
    """Return the 20 entries of the paper's table of Moran index and entropy, with the correct numbers."""
    table: list[Entry] = []
    for kind, (moran_48, entropy_48, moran_46, entropy_46) in _PRINTED.items():
        for fill, printed_moran, printed_entropy in (
            ("0.48", moran_48, entropy_48),
            ("0.46", moran_46, entropy_46),
        ):
            name = f"{kind}:{fill}"
            # At 0.46 the paper's alternating floor has 48 vibrating tiles; the correct one has 46.
            used_by_paper = pattern("alternating:paper-0.46" if name == "alternating:0.46" else name)
            correct = pattern(name)
            table += [
                Entry(
                    name, "Moran index", printed_moran,
                    as_the_paper=moran_index(used_by_paper), right=moran_index(correct),
                ),
                Entry(
                    name, "entropy", printed_entropy,
                    as_the_paper=entropy(used_by_paper, _PAPER_ONES), right=entropy(correct),
                ),
            ]  # fmt: skip
    return table
