"""Changes of a floor during a run: at given times, or each tile as a Markov chain between kinds.

| name | symbol | unit | equation |
|---|---|---|---|
| rate | lambda | 1/s | at this rate each tile is redrawn, independently of all others |
| shares | pi_k | - | probability that a tile that is redrawn becomes kind k |
| holding time | - | s | a tile of kind k keeps it for an exponential time of mean 1 / (lambda (1 - pi_k)) |
| stationary share | - | - | of kind k: pi_k, whatever the floor at time 0 was |

A change that is due at the time of a sample has happened when the sample is taken. The numbers are addressed: those of
tile j's n-th draw are at (seed, run, 0, CHANGE, j, 1 + 2 n) and the next peer, so a longer run has the changes of a
shorter one, and then more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import allocating_kernel, read_only
from vibroswarm.core.rng import CHANGE, Purpose, uniform, uniforms

Tiles = NDArray[np.uint8]


class Changes(NamedTuple):
    """Tiles that become another kind, in the order of time, (changes,) each."""

    time_s: NDArray[np.float64]
    """When the tile changes."""
    tile: NDArray[np.int32]
    """Index of the tile, row * columns + column."""
    kind: Tiles
    """What it becomes."""

    @property
    def times_s(self) -> NDArray[np.float64]:
        """The different times of changes, ascending."""
        return np.unique(self.time_s)


NO_CHANGES: Final = Changes(np.empty(0), np.empty(0, dtype=np.int32), np.empty(0, dtype=np.uint8))
"""A floor that stays as it is."""


def grown(tiles: Tiles) -> Tiles:
    """Grow damage by one tile: each still tile takes the highest kind of its neighbours."""
    padded = np.pad(tiles, 1)
    beside = (padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:])
    return np.where(tiles == 0, np.maximum.reduce(beside), tiles).astype(np.uint8)


def changes_between(start: Tiles, later: Sequence[tuple[float, Tiles]]) -> Changes:
    """Return the changes that turn a floor into other floors of the same size, one after the other."""
    parts, before = [], start.ravel()
    for time_s, tiles in later:
        now = tiles.ravel()
        tile = np.flatnonzero(now != before)
        parts.append(Changes(np.full(tile.size, time_s), tile.astype(np.int32), now[tile]))
        before = now
    return Changes(*map(np.concatenate, zip(*parts, strict=True))) if parts else NO_CHANGES


def permuted(tiles: Tiles, number: int, seed: int, run: int) -> Tiles:
    """Return the same tiles at random places, for change ``number`` (from 0) of a run."""
    u = uniforms(seed, run, number, Purpose.CHANGE, tiles.size)
    return tiles.ravel()[np.argsort(u, kind="stable")].reshape(tiles.shape)


def markov_changes(
    start: Tiles, rate_per_h: float, shares: Sequence[float], until_s: float, seed: int, run: int
) -> Changes:
    """Return the changes up to ``until_s`` of tiles that are redrawn at random times."""
    below = np.cumsum(np.asarray(shares, dtype=np.float64))
    time_s, tile, kind = _markov(read_only(start.ravel()), rate_per_h / 3600.0, below, until_s, seed, run)
    order = np.argsort(time_s, kind="stable")
    return Changes(time_s[order], tile[order], kind[order])


@allocating_kernel
def _markov(
    start: Tiles, rate_per_s: float, below: NDArray[np.float64], until_s: float, seed: int, run: int
) -> tuple[NDArray[np.float64], NDArray[np.int32], Tiles]:
    """Return time, tile and new kind of each change, tile by tile; draws that give the present kind are none."""
    room = 64
    time_s, tile, kind = np.empty(room), np.empty(room, dtype=np.int32), np.empty(room, dtype=np.uint8)
    found = 0
    for j in range(start.size):
        present, now_s, n = int(start[j]), 0.0, 0
        while True:
            now_s -= math.log(uniform(seed, run, 0, CHANGE, j, 1 + 2 * n)) / rate_per_s
            if now_s > until_s:
                break
            u, drawn = uniform(seed, run, 0, CHANGE, j, 2 + 2 * n), 0
            while drawn < below.size - 1 and u >= below[drawn]:
                drawn += 1
            n += 1
            if drawn == present:
                continue
            if found == room:
                time_s, tile, kind = (
                    np.append(time_s, np.empty(room)),
                    np.append(tile, np.empty(room, dtype=np.int32)),
                    np.append(kind, np.empty(room, dtype=np.uint8)),
                )
                room *= 2
            present = drawn
            time_s[found], tile[found], kind[found] = now_s, j, drawn
            found += 1
    return time_s[:found].copy(), tile[:found].copy(), kind[:found].copy()
