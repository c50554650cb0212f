"""A floor: a rectangle of tiles, each of a kind such as vibrating or still, somewhere in an arena.

| name | symbol | unit | shape |
|---|---|---|---|
| level | E (Eq. 1) | a kind (0 still, 1 vibrating, others as the sensor tells), or a contrast between | scalar |
| levels, tiles | - | level of each tile; its kind, of contrasts the nearest | (rows, columns), top row first |
| fill ratio | f (Eq. 3) | - | scalar; of contrasts and patches the mean contrast |
| tile index | - | row * columns + column | -1: on no tile |

x points right, y points up, the origin is the arena's lower left corner. A floor may be smaller than its arena; the
border around it then has no tiles, and neither vibrates nor is still. A floor may also extend beyond the arena.

A floor may change during a run: ``tiles`` are those at time 0, and ``Floor.at`` gives the floor at another time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.errors import InputError
from vibroswarm.floors.changes import NO_CHANGES, Changes
from vibroswarm.floors.surfaces import STEPS, Box, Patch

TILE_LIMIT: Final = 4_000_000
"""Maximum number of tiles of a floor."""
DIGITS: Final = "0123456789abcdef"
"""Characters of the kinds of tile in text without separators."""
DRAWN, WITHIN = 40, 5
"""Rows and columns of cells in which patches are drawn, and of the points of each cell at which they are looked for."""
KIND_LIMIT: Final = len(DIGITS)
"""Maximum number of kinds of tile."""
KINDS_IN_WORDS: Final = f"a tile is 0 (still) or 1 (vibrating), or another kind up to {KIND_LIMIT - 1}"

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
    return Place(*geometry[:5], geometry[5] + geometry[0] * geometry[3])


def place_of(floor: Floor) -> Place:
    """Return the grid and the position of a floor as kernels use them."""
    return place_at(floor.geometry)


@kernel
def tile_below(x_m: float, y_m: float, place: Place) -> int:
    """Return the index of the tile under a point; -1 if none. On an edge it is the tile on the right or below."""
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
        levels: (rows, columns), top row first: kinds, 0 (still), 1 (vibrating) up to 15, or contrasts between 0 and 1,
            which are rounded to multiples of 1 / ``STEPS``; copied.
        tile_width_m, tile_height_m: size of one tile, m.
        left_m, bottom_m: the floor's lower left corner in the arena, m.
        name: name of the floor in titles and results; equality ignores it.
        changes: tiles that become another kind during a run; by default the floor stays as it is.
        patches: they do not overlap, and lie on still tiles.

    Raises:
        InputError: ``levels`` are no rectangle of levels.
    """

    levels: NDArray[Any]
    tile_width_m: float
    tile_height_m: float
    left_m: float = 0.0
    bottom_m: float = 0.0
    name: str = ""
    changes: Changes = NO_CHANGES
    patches: tuple[Patch, ...] = ()

    def __post_init__(self) -> None:
        # The dataclass is frozen, so its field is set past its own __setattr__.
        object.__setattr__(self, "levels", as_levels(self.levels))
        self.levels.setflags(write=False)

    def __eq__(self, other: object) -> bool:
        """Return whether both floors have equal levels at equal places, and equal changes; names are ignored."""
        if not isinstance(other, Floor) or self.geometry != other.geometry:
            return False
        same_levels = self.patches == other.patches and np.array_equal(self.levels, other.levels)
        pairs: Any = zip(self.changes, other.changes, strict=True)
        return same_levels and all(np.array_equal(*pair) for pair in pairs)

    def __hash__(self) -> int:
        """Return a hash of what ``__eq__`` compares."""
        return hash((self.geometry, self.levels.tobytes()))

    @cached_property
    def tiles(self) -> NDArray[np.uint8]:
        """The kind of each tile; of contrasts from 1/2 on it is 1."""
        kinds = np.floor(self.levels + 0.5).astype(np.uint8)
        kinds.setflags(write=False)
        return kinds

    @cached_property
    def has_contrasts(self) -> bool:
        """Whether any tile is between still and vibrating."""
        return bool((self.levels % 1.0).any())

    @property
    def geometry(self) -> Geometry:
        """Rows, columns, tile width and height, left and bottom (m)."""
        rows, columns = self.levels.shape
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
        return self._after(self.levels, slice(0, until))

    def stages(self) -> Iterator[tuple[float, Floor]]:
        """Yield the floor between its changes: the time from which it is so (s, 0 first), and a floor that stays."""
        floor = self.at(0.0)
        yield 0.0, floor
        if not self.is_changing:
            return
        times_s = self.changes.times_s
        first = np.searchsorted(self.changes.time_s, times_s).tolist()
        for time_s, which in zip(times_s.tolist(), pairwise([*first, None]), strict=True):
            floor = self._after(floor.levels, slice(*which))
            yield time_s, floor

    def _after(self, levels: NDArray[np.float64], which: slice) -> Floor:
        """Return a floor with ``levels`` after these changes, of which a later one of the same tile counts."""
        changed = levels.copy()
        changed.ravel()[self.changes.tile[which]] = self.changes.kind[which]
        return Floor(changed, *self.geometry[2:], name=self.name)

    @property
    def drawn_tiles(self) -> NDArray[np.uint8]:
        """Tiles as drawings show them; with patches, ``DRAWN`` x ``DRAWN`` cells, 1 where a patch lies in them."""
        if not self.patches:
            return self.tiles
        rows, columns, width_m, height_m, left_m, bottom_m = self.geometry
        share = (np.arange(DRAWN * WITHIN) + 0.5) / (DRAWN * WITHIN)
        x_m, y_m = np.meshgrid(left_m + columns * width_m * share, bottom_m + rows * height_m * share[::-1])
        touched = (self.contrast_at(x_m, y_m) > 0.0).reshape(DRAWN, WITHIN, DRAWN, WITHIN)
        return np.asarray(touched.any(axis=(1, 3)), dtype=np.uint8)

    @property
    def fill_ratio(self) -> float:
        """Share of tiles that vibrate, f (Eq. 3), at time 0: kind 1; of contrasts and patches the mean contrast."""
        rows, columns, width_m, height_m, _, _ = self.geometry
        patched_m2 = sum(patch.contrast * patch.area_m2 for patch in self.patches)
        return _share_of(self._mean_of(1) + patched_m2 / (rows * columns * width_m * height_m))  # Eq. 3

    def _mean_of(self, kind: int) -> float:
        steps = np.rint(weight_of(kind, self.levels) * STEPS).astype(np.int64)
        return int(steps.sum()) / (STEPS * steps.size)

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
        if not self.patches and sides_inside(self.geometry, width_m, height_m) is None:
            return self._mean_of(kind)
        level, share = self.level_shares(width_m, height_m)
        return _share_of((share * weight_of(kind, level)).sum())

    def level_shares(
        self, width_m: float, height_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return levels, 0 first, and which share of the floor inside an arena has each.

        Levels may occur several times. Patches lie on still tiles, so their shares are taken off those of level 0.

        Args:
            width_m, height_m: size of the arena, m.
        Raises:
            InputError: all tiles lie outside the arena.
        """
        levels = np.append(0.0, np.unique(self.levels[self.levels > 0.0]))
        rows, columns, tile_width_m, tile_height_m, _, _ = self.geometry
        sides = sides_inside(self.geometry, width_m, height_m)
        # the width of each column and the height of each row inside the arena, m
        across, up = sides or (np.full(columns, tile_width_m), np.full(rows, tile_height_m))
        if not up.sum() * across.sum():
            raise InputError(f"lies outside the arena of {width_m:g} m x {height_m:g} m", field="floor")
        if sides is None:
            share = [np.count_nonzero(self.levels == level) / self.levels.size for level in levels]
        else:
            areas = [(up[:, None] * (self.levels == level) * across).sum() for level in levels]
            share = [area / (up.sum() * across.sum()) for area in areas]
        patched = [patch.area_m2 / np.outer(up, across).sum() for patch in self.patches]
        level = np.concatenate([levels, [patch.contrast for patch in self.patches], np.zeros(len(patched))])
        return level, np.concatenate([share, patched, -np.array(patched)])

    def contrast_at(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.float64]:
        """Return the contrast at each point, 0 (still, or no tile) to 1 (vibrating), in the shape of the points.

        Args:
            x_m, y_m: coordinates of the points in the arena, m, in two arrays of the same shape.
        """
        found = np.append(weight_of(1, self.levels), 0.0)[self.tile_at(x_m, y_m)]  # -1 reads the last entry
        for patch in self.patches:
            inside = patch.distance_m(np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)) < 0.0
            found = np.where(inside, patch.contrast, found)
        return np.asarray(found)

    @classmethod
    def filling(cls, levels: ArrayLike, width_m: float = 1.0, height_m: float = 1.0, name: str = "") -> Floor:
        """Return a floor whose tiles fill the rectangle from the origin to (``width_m``, ``height_m``).

        Args:
            levels: (rows, columns) of kinds or contrasts, top row first. name: name of the floor.
        Raises:
            InputError: ``levels`` is not a rectangle of levels.
        """
        grid = as_levels(levels)
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
        rows, columns = self.levels.shape
        x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
        top_m = self.bottom_m + rows * self.tile_height_m
        column = np.floor((x - self.left_m) / self.tile_width_m)
        row = np.floor((top_m - y) / self.tile_height_m)
        # Compared before the conversion to integers, so that a point at nan or infinity is on no tile.
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        return np.where(inside, row * columns + column, -1).astype(np.int32)


def weight_of(kind: int, levels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weight of a kind in each level: 0 or 1, at contrasts their share of the kinds 0 and 1."""
    of_two = levels if kind == 1 else 1.0 - levels if kind == 0 else np.zeros(levels.shape)
    return np.where(levels <= 1.0, of_two, levels == kind)


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
    """Return how much of each column's width, from the left, and row's height, from the top, is inside an arena, m.

    None instead of both if all tiles are inside. The arrays are cached and must not be changed.
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


def rows_of(tiles: NDArray[np.uint8]) -> tuple[str, ...]:
    """Return tiles as a scenario holds them: one string a row, top row first, one hexadecimal digit a tile."""
    return tuple("".join(DIGITS[kind] for kind in row) for row in tiles.tolist())


def as_levels(values: ArrayLike) -> NDArray[np.float64]:
    """Return levels as float64 of shape (rows, columns), contrasts rounded to multiples of 1 / ``STEPS``; a copy."""
    try:
        grid = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        grid = np.empty(0)
    if grid.ndim != 2 or grid.size == 0 or not ((grid >= 0.0) & (grid < KIND_LIMIT)).all():
        raise InputError(
            f"is not a rectangle of numbers from 0 to {KIND_LIMIT - 1}, row by row", field="floor"
        )
    if ((grid > 1.0) & (grid % 1.0 > 0.0)).any():
        raise InputError(KINDS_IN_WORDS, field="floor")
    return np.ascontiguousarray(np.rint(grid * STEPS) / STEPS)


def as_tiles(values: ArrayLike) -> NDArray[np.uint8]:
    """Return a contiguous copy of ``values`` as uint8 of shape (rows, columns) of kinds of tile."""
    levels = as_levels(values)
    if (np.asarray(values, dtype=np.float64) % 1.0).any():
        raise InputError(KINDS_IN_WORDS, field="floor")
    return levels.astype(np.uint8)
