"""The difficulty of a floor: how its vibrating tiles cluster.

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

Moran index: near 1 large patches, near 0 tiles placed at random, near -1 a checkerboard. Source: the paper's
equations of the Moran index and of the entropy, after Bartashevich and Mostaghim (2019).

The module also has the paper's table of difficulties, beside the correct values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import as_tiles
from vibroswarm.floors.source import pattern


@dataclass(frozen=True)
class Difficulty(NotebookView):
    """Measures of a floor; ``moran_index`` and ``entropy`` are nan where undefined.

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
    """Return the Moran index E_MI of a floor (Eq. 4): how similar neighbouring tiles are.

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
    # Unordered pairs in numerator and denominator: the factor 2 of the ordered pairs cancels.
    pairs = rows * (columns - 1) + columns * (rows - 1)
    alike = np.sum(apart[:, 1:] * apart[:, :-1]) + np.sum(apart[1:] * apart[:-1])
    return float(grid.size / pairs * alike / np.sum(apart * apart))  # Eq. 4


def cluster_sizes(tiles: ArrayLike) -> NDArray[np.int64]:
    """Return the sizes of the clusters of vibrating tiles (4-connected), in tiles, largest first, shape (M,)."""
    from scipy import ndimage

    labels, _ = ndimage.label(as_tiles(tiles))  # scipy's default structure joins through sides only
    sizes = np.bincount(np.asarray(labels).ravel())[1:].astype(np.int64)
    return np.sort(sizes)[::-1]


def entropy(tiles: ArrayLike, ones: int | None = None) -> float:
    """Return the entropy E_e of a floor (Eq. 5): 0 if every vibrating tile is alone, 1 if all form one cluster.

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
    """Return all measures of a floor.

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
    """Compute E_e from cluster sizes; see ``entropy``."""
    if ones is not None and ones < 2:
        raise InputError(f"{ones} is too few; the entropy needs at least 2 vibrating tiles", field="ones")
    total = int(sizes.sum()) if ones is None else ones
    if total < 2 or sizes.size == 0:
        return math.nan
    shares = sizes / total
    most = math.log2(total)
    return max(0.0, (most + float(np.sum(shares * np.log2(shares)))) / most)  # Eq. 5; not -0.0 by rounding


_PRINTED: Final = {
    # pattern: Moran index at 0.48, entropy at 0.48, Moran index at 0.46, entropy at 0.46
    "diagonal": (0.73, 1.00, 0.71, 0.99),
    "stripe": (0.88, 1.00, 0.88, 0.99),
    "block-diagonal": (0.76, 0.85, 0.75, 0.84),
    "alternating": (-0.96, 0.00, -0.91, 0.00),
    "random-fixed": (0.00, 0.51, -0.05, 0.46),
}
_PAPER_ONES: Final = 48  # the N_v of all its entropies


@dataclass(frozen=True)
class Entry:
    """One number of the paper's table.

    Args:
        pattern: its name here. measure: "Moran index" or "entropy".
        printed: as the paper has it.
        as_the_paper: computed as the paper did: on the floor that it used, with N_v = 48.
        right: on the floor of the fill ratio named, with its own N_v.
    """

    pattern: str
    measure: str
    printed: float
    as_the_paper: float
    right: float

    @property
    def wrong(self) -> bool:
        """Whether the printed number differs from the correct one to its two digits."""
        return abs(self.printed - self.right) > 0.005 + 1e-9


def paper_table() -> list[Entry]:
    """Return all 20 numbers of the paper's table of Moran index and entropy, beside the correct ones."""
    table: list[Entry] = []
    for kind, printed in _PRINTED.items():
        for fill, moran, clustering in (("0.48", *printed[:2]), ("0.46", *printed[2:])):
            name = f"{kind}:{fill}"
            used = pattern("alternating:paper-0.46" if name == "alternating:0.46" else name)
            true = pattern(name)
            table.append(Entry(name, "Moran index", moran, moran_index(used), moran_index(true)))
            table.append(Entry(name, "entropy", clustering, entropy(used, _PAPER_ONES), entropy(true)))
    return table
