"""A floor: a rectangle of tiles, each of a kind such as vibrating or still, somewhere in an arena.

| name | symbol | unit | shape |
|---|---|---|---|
| tiles | E (Eq. 1) | kind: 0 still, 1 vibrating, others as the sensor tells | (rows, columns), top row first |
| fill ratio | f (Eq. 3) | - | scalar; of values and patches the mean contrast |
| tile index | - | row * columns + column | -1: on no tile |

x points right, y points up, the origin is the arena's lower left corner. A floor may be smaller than its arena; the
border around it then has no tiles, and neither vibrates nor is still. A floor may also extend beyond the arena.

A floor may change during a run: ``tiles`` are those at time 0, and ``Floor.at`` gives the floor at another time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.errors import InputError
from vibroswarm.floors.changes import NO_CHANGES, Changes
from vibroswarm.floors.surfaces import PLAIN, STEPS, Box, Surface, rectangle

TILE_LIMIT: Final = 4_000_000
"""Maximum number of tiles of a floor."""
DIGITS: Final = "0123456789abcdef"
"""Characters of the kinds of tile in text without separators."""
DRAWN, WITHIN = 40, 5
"""Rows and columns of cells in which patches are drawn, and of the points of each cell at which they are looked for."""
KIND_LIMIT: Final = len(DIGITS)
"""Maximum number of kinds of tile."""
KINDS_IN_WORDS: Final = f"a tile is 0 (still) or 1 (vibrating), or another kind up to {KIND_LIMIT - 1}"
"""What a tile may be, for messages."""

Geometry = tuple[int, int, float, float, float, float]
"""Rows, columns, tile width and height, left and bottom of a floor, m."""


class Place(NamedTuple):
    """Grid and position of a floor, as kernels use it."""

    rows: int
    """Number of rows of tiles."""
    columns: int
    """Number of columns of tiles."""
    width_m: float
    """Width of a tile."""
    height_m: float
    """Height of a tile."""
    left_m: float
    """Left end of the floor."""
    top_m: float
    """Upper end of the floor."""


def place_at(geometry: Geometry) -> Place:
    """Return the grid and the position of a floor as kernels use them."""
    rows, columns, width_m, height_m, left_m, bottom_m = geometry
    return Place(rows, columns, width_m, height_m, left_m, bottom_m + rows * height_m)


def place_of(floor: Floor) -> Place:
    """Return the grid and the position of a floor as kernels use them."""
    return place_at(floor.geometry)


@kernel
def tile_below(x_m: float, y_m: float, place: Place) -> int:
    """Return the index of the tile under a point; -1 if no tile is there.

    A point on the edge between two tiles belongs to the tile on the right, or to the lower one. A point on the right or
    on the lower border of the floor is on no tile.
    """
    column = np.floor((x_m - place.left_m) / place.width_m)
    row = np.floor((place.top_m - y_m) / place.height_m)
    if column >= 0 and row >= 0 and column < place.columns and row < place.rows:
        index: int = int(row) * place.columns + int(column)
        return index
    return -1


@dataclass(frozen=True, eq=False)
class Floor:
    """Tiles and their position.

    Args:
        tiles: (rows, columns) of kinds, 0 (still), 1 (vibrating) up to 15, top row first; copied.
        tile_width_m, tile_height_m: size of one tile, m.
        left_m, bottom_m: the floor's lower left corner in the arena, m.
        name: name of the floor in titles and results; equality ignores it.
        changes: tiles that become another kind during a run; by default the floor stays as it is.
        surface: values of tiles, and patches; by default kinds of tile say all.

    Raises:
        InputError: ``tiles`` are no rectangle of kinds, or a size is not above 0.
    """

    tiles: NDArray[np.uint8]
    tile_width_m: float
    tile_height_m: float
    left_m: float = 0.0
    bottom_m: float = 0.0
    name: str = ""
    changes: Changes = NO_CHANGES
    surface: Surface = PLAIN

    def __post_init__(self) -> None:
        # The dataclass is frozen, so its field is set past its own __setattr__.
        object.__setattr__(self, "tiles", as_tiles(self.tiles))
        self.tiles.setflags(write=False)
        if not (0.0 < self.tile_width_m < math.inf and 0.0 < self.tile_height_m < math.inf):
            raise InputError("width and height of a tile must be finite and above 0", field="floor")

    def __eq__(self, other: object) -> bool:
        """Return whether both floors have equal tiles at equal places, and equal changes; names are ignored."""
        if not isinstance(other, Floor) or self.geometry != other.geometry:
            return False
        mine, theirs = self.surface, other.surface
        pairs = [(self.tiles, other.tiles), *zip(self.changes, other.changes, strict=True)]
        return (
            mine.patches == theirs.patches
            and np.array_equal(self._contrasts, other._contrasts)
            and (mine.values is None) == (theirs.values is None)
            and all(map(np.array_equal, *zip(*pairs, strict=True)))
        )

    def __hash__(self) -> int:
        """Return a hash of what ``__eq__`` compares."""
        return hash((self.geometry, self.tiles.tobytes()))

    @property
    def geometry(self) -> Geometry:
        """Rows, columns, tile width and height, left and bottom (m)."""
        rows, columns = self.tiles.shape
        return rows, columns, self.tile_width_m, self.tile_height_m, self.left_m, self.bottom_m

    @property
    def is_changing(self) -> bool:
        """Whether any tile changes."""
        return self.changes.time_s.size > 0

    def at(self, time_s: float) -> Floor:
        """Return the floor as it is at a time, without changes.

        Args:
            time_s: the time; a change at this very time has happened.
        """
        if not self.is_changing:
            return self
        until = int(np.searchsorted(self.changes.time_s, time_s, side="right"))
        return self._after(self.tiles, slice(0, until))

    def stages(self) -> Iterator[tuple[float, Floor]]:
        """Yield the floor between its changes: the time from which it is so (s, 0 first), and a floor that stays."""
        floor = self.at(0.0)
        yield 0.0, floor
        times_s = self.changes.times_s
        first = np.searchsorted(self.changes.time_s, times_s).tolist()
        for time_s, which in zip(times_s.tolist(), pairwise([*first, None]), strict=True):
            floor = self._after(floor.tiles, slice(*which))
            yield time_s, floor

    def _after(self, tiles: NDArray[np.uint8], which: slice) -> Floor:
        """Return a floor with ``tiles`` after these changes, of which a later one of the same tile counts."""
        changed = tiles.copy()
        changed.ravel()[self.changes.tile[which]] = self.changes.kind[which]
        return Floor(changed, *self.geometry[2:], name=self.name)

    @property
    def has_patches(self) -> bool:
        """Whether patches, which may be none in a run, say what it is like, and not its tiles."""
        return self.surface is not PLAIN and self.surface.values is None

    @property
    def drawn_tiles(self) -> NDArray[np.uint8]:
        """Tiles as drawings show them; with patches, ``DRAWN`` x ``DRAWN`` cells, 1 where a patch lies in them."""
        if not self.has_patches:
            return self.tiles
        rows, columns, width_m, height_m, left_m, bottom_m = self.geometry
        share = (np.arange(DRAWN * WITHIN) + 0.5) / (DRAWN * WITHIN)
        x_m, y_m = np.meshgrid(left_m + columns * width_m * share, bottom_m + rows * height_m * share[::-1])
        touched = self.contrast_at(x_m, y_m) > 0.0
        cells = np.any(touched.reshape(DRAWN, WITHIN, DRAWN, WITHIN), axis=(1, 3))
        return np.asarray(cells, dtype=np.uint8)

    @property
    def fill_ratio(self) -> float:
        """Share of tiles that vibrate, f (Eq. 3), at time 0: kind 1; of values and patches the mean contrast."""
        rows, columns, width_m, height_m, _, _ = self.geometry
        patched_m2 = sum(patch.contrast * patch.area_m2 for patch in self.surface.patches)
        return _share_of(self._mean_value + patched_m2 / (rows * columns * width_m * height_m))  # Eq. 3

    def box_within(self, width_m: float, height_m: float) -> Box:
        """Return left, bottom, right and top, m, of the part inside an arena of ``width_m`` by ``height_m``."""
        rows, columns, tile_width_m, tile_height_m, left_m, bottom_m = self.geometry
        right_m, top_m = left_m + columns * tile_width_m, bottom_m + rows * tile_height_m
        return max(left_m, 0.0), max(bottom_m, 0.0), min(right_m, width_m), min(top_m, height_m)

    def fill_ratio_within(self, width_m: float, height_m: float) -> float:
        """Return the fill ratio inside an arena of ``width_m`` by ``height_m``: ``share_within`` of kind 1."""
        return self.share_within(1, width_m, height_m)

    def share_within(self, kind: int, width_m: float, height_m: float) -> float:
        """Return the share of a kind of tile in the part of the floor inside an arena of ``width_m`` by ``height_m``.

        It is a share of the tiled area inside the arena; a tile that is cut by an edge of the arena counts with the
        area that is inside.

        Raises:
            InputError: all tiles lie outside the arena.
        """
        sides = sides_inside(self.geometry, width_m, height_m)
        if sides is None and self.surface is PLAIN:
            of_kind = self.tiles == kind
            return float(np.count_nonzero(of_kind) / of_kind.size)
        if sides is not None and not sides[0].sum() * sides[1].sum():
            raise InputError(f"lies outside the arena of {width_m:g} m x {height_m:g} m", field="floor")
        if self.surface is not PLAIN:
            if sides is None and not self.surface.patches and kind < 2:  # exactly, as of kinds
                return self._mean_value if kind == 1 else 1.0 - self._mean_value
            contrast, share = self.contrast_shares(width_m, height_m)
            return _share_of((share * (contrast if kind == 1 else 1.0 - contrast)).sum()) if kind < 2 else 0.0
        assert sides is not None
        across, up = sides  # the width of each column and the height of each row inside the arena, m
        return _share_of((up[:, None] * (self.tiles == kind) * across).sum() / (up.sum() * across.sum()))

    def contrast_shares(
        self, width_m: float, height_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return contrasts, from 0 (still) to 1 (vibrating), and which share of the floor inside an arena has each.

        Contrasts may occur several times. Patches lie on still tiles, so their shares are taken off those of contrast
        0, one by one.

        Args:
            width_m, height_m: size of the arena, m.
        """
        rows, columns, tile_width_m, tile_height_m, _, _ = self.geometry
        sides = sides_inside(self.geometry, width_m, height_m)
        across, up = (
            sides if sides is not None else (np.full(columns, tile_width_m), np.full(rows, tile_height_m))
        )
        area_m2 = np.outer(up, across)
        whole_m2, patches = area_m2.sum(), self.surface.patches
        patched = np.array([patch.area_m2 for patch in patches]) / whole_m2
        of_patches = np.array([patch.contrast for patch in patches])
        contrast = np.concatenate([self._contrasts.ravel(), of_patches, np.zeros(len(patches))])
        return contrast, np.concatenate([area_m2.ravel() / whole_m2, patched, -patched])

    @property
    def _mean_value(self) -> float:
        """The mean contrast of the tiles, without patches; correctly rounded."""
        values = self.surface.values
        if values is None:
            return float(np.count_nonzero(self.tiles == 1) / self.tiles.size)  # Eq. 3
        return int(values.sum(dtype=np.int64)) / (STEPS * values.size)

    @property
    def _contrasts(self) -> NDArray[np.float64]:
        values = self.surface.values
        return (self.tiles == 1).astype(np.float64) if values is None else np.asarray(values / STEPS)

    def contrast_at(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.float64]:
        """Return the contrast at each point, 0 (still, or no tile) to 1 (vibrating), in the shape of the points.

        Args:
            x_m, y_m: coordinates of the points in the arena, m, in two arrays of the same shape.
        """
        tile = self.tile_at(x_m, y_m)
        found = np.append(self._contrasts, 0.0)[tile]  # -1, no tile, reads the last entry
        x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
        for patch in self.surface.patches:
            found = np.where(patch.distance_m(x, y) < 0.0, patch.contrast, found)
        return np.asarray(found)

    @classmethod
    def filling(cls, tiles: ArrayLike, width_m: float = 1.0, height_m: float = 1.0, name: str = "") -> Floor:
        """Return a floor whose tiles fill the rectangle from the origin to (``width_m``, ``height_m``).

        Args:
            tiles: (rows, columns) of kinds, top row first. name: name of the floor.
        Raises:
            InputError: ``tiles`` is not a rectangle of kinds, or a size is not above 0.
        """
        grid = as_tiles(tiles)
        return cls(grid, width_m / grid.shape[1], height_m / grid.shape[0], name=name)

    def tile_at(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.int32]:
        """Return the index of the tile under each point; -1 if no tile is there.

        A point on the edge between two tiles belongs to the tile on the right, or to the lower one. So a point on the
        floor's right or lower edge is on no tile. Numbers are as they are rounded: 0.6 / 0.2 is below 3, so a point at
        0.6 m is to the left of that edge.

        Args:
            x_m, y_m: coordinates of the points in the arena, m, in two arrays of the same shape.
        Returns: int32 of the same shape.
        """
        rows, columns = self.tiles.shape
        x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
        top_m = self.bottom_m + rows * self.tile_height_m
        column = np.floor((x - self.left_m) / self.tile_width_m)
        row = np.floor((top_m - y) / self.tile_height_m)
        # Compared before the conversion to integers, so that a point at nan or infinity is on no tile.
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        return np.where(inside, row * columns + column, -1).astype(np.int32)


def _share_of(value: float) -> float:
    """Return a share that was summed up: rounding must not move it beyond 0 or 1."""
    return min(max(float(value), 0.0), 1.0)


def refuse_changes(floor: Floor) -> None:
    """Refuse a floor that changes, for what presumes that tiles stay as they are."""
    if floor.is_changing:
        raise InputError("changes during the run, and this presumes that it stays as it is", field="floor")


def refuse_kinds(floor: Floor) -> None:
    """Refuse a floor with more kinds of tile than two, at any time."""
    if any((stage.tiles > 1).any() for _, stage in floor.stages()):
        raise InputError(
            "has tiles of other kinds than 0 (still) and 1 (vibrating); this is for two", field="floor"
        )


@lru_cache(maxsize=64)
def sides_inside(
    geometry: Geometry, width_m: float, height_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return how much of the width of each column and of the height of each row lies inside an arena, m.

    Args:
        geometry: rows, columns, tile width and height, left and bottom of the floor (``Floor.geometry``).
        width_m, height_m: size of the arena.
    Returns: the widths, (columns,), from the left; the heights, (rows,), from the top; 0 for columns and rows outside.
        None instead of both if all tiles lie inside. The arrays are cached, so they must not be changed.
    """
    rows, columns, tile_width_m, tile_height_m, left_m, bottom_m = geometry
    left = left_m + tile_width_m * np.arange(columns)
    bottom = bottom_m + tile_height_m * np.arange(rows)[::-1]  # the top row comes first
    across = np.clip(np.minimum(left + tile_width_m, width_m) - np.maximum(left, 0.0), 0.0, None)
    up = np.clip(np.minimum(bottom + tile_height_m, height_m) - np.maximum(bottom, 0.0), 0.0, None)
    # Rounding of the far edges must not turn whole tiles into cut ones.
    if np.allclose(across, tile_width_m, rtol=1e-9) and np.allclose(up, tile_height_m, rtol=1e-9):
        return None
    return across, up


def check_size(rows: int, columns: int) -> None:
    """Refuse a floor without tiles, or with more than ``TILE_LIMIT`` tiles."""
    if rows < 1 or columns < 1 or rows * columns > TILE_LIMIT:
        raise InputError(f"{rows} x {columns} is no floor of 1 to {TILE_LIMIT:,} tiles", field="tiles")


def rows_of(tiles: NDArray[np.uint8]) -> tuple[str, ...]:
    """Return tiles as a scenario holds them: one string a row, top row first, one hexadecimal digit a tile."""
    return tuple("".join(DIGITS[kind] for kind in row) for row in tiles.tolist())


def as_tiles(values: ArrayLike) -> NDArray[np.uint8]:
    """Return a contiguous copy of ``values`` as uint8 of shape (rows, columns) of kinds of tile.

    Raises:
        InputError: ``values`` is not a rectangle, is empty, or has values other than 0 to ``KIND_LIMIT`` - 1.
    """
    # For speed: an array of the right type and values is only copied.
    if isinstance(values, np.ndarray) and values.dtype == np.uint8 and values.ndim == 2 and values.size:
        copied = np.array(values, order="C")
        if copied.max() < KIND_LIMIT:
            return copied
    grid = rectangle(values, KIND_LIMIT - 1, "floor")
    if (grid % 1).any():
        raise InputError(KINDS_IN_WORDS, field="floor")
    return np.ascontiguousarray(grid, dtype=np.uint8)
