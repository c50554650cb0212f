"""The probability that each tile of a known grid vibrates, given samples whose places are not exact.

| name | symbol | equation |
|---|---|---|
| share of a sample's place on tile t | q_t | normal in x and y, by ``strategies.place_map`` |
| likelihood ratio of the sample | r | density where it vibrates over that where it is still |
| likelihood of the sample, given the floor x | L | 1 + (r - 1) sum over t of q_t x_t, x_t = 1 where t vibrates |
| evidence of the sample on tile t | l_t | ln((1 + (r - 1)(q_t + R_t)) / (1 + (r - 1) R_t)), R_t = sum of q_u p_u |
| map | p_t | 1 / (1 + exp(-prior log odds - sum of l_t)) |

The sum in R_t is over the other tiles u that the place may be on, and p_u is their map without this sample. A robot of
strategy ``places`` adds each sample once, in the order in which it hears them, so that its map depends on that order.
Here the same update (``strategies.place_evidence``) is repeated, each time with the sample's earlier evidence taken
out, until nothing changes: expectation propagation with independent tiles (Minka 2001). Exact places are on one tile
each, and then the map is exact. Edges are felt as ``strategies.place_map`` says; the blur of an edge is a spread of the
place.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, logit

from vibroswarm.core.jit import inner, kernel
from vibroswarm.errors import InputError
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.strategies.place_evidence import add_evidence
from vibroswarm.strategies.place_map import share_place

SWEEPS: Final = 50
"""Most repetitions."""
CONVERGED: Final = 1e-6
"""Largest change of log odds in the last repetition."""


class Ground(NamedTuple):
    """The grid, under the names by which ``place_map`` reads what a robot knows of it."""

    robots: int
    rows: int
    columns: int
    tile_width_m: float
    tile_height_m: float
    left_m: float
    bottom_m: float


class Reach(NamedTuple):
    """How far beyond its edges a tile is felt."""

    edge_reach_m: float


class Memory(NamedTuple):
    """A robot's arrays as ``place_evidence`` uses them: one map, one sender."""

    odds: Floats
    weight: Floats
    of_column: Floats
    of_row: Floats
    of_all: Floats
    p: Floats
    p_without: Floats
    before: Floats
    """(tiles,): room for the earlier evidence of a sample."""


class Taken(NamedTuple):
    """Where samples were taken and what they say, (samples,) each."""

    tile: NDArray[np.int64]
    """The tile of an exact place; -1: the place is not exact, or on no tile."""
    x_m: Floats
    y_m: Floats
    spread_x_m: Floats
    spread_y_m: Floats
    log_ratio: Floats


@kernel
def count_touched(a: Memory, p: Reach, w: Any, taken: Taken, first: NDArray[np.int64]) -> None:
    """Write to ``first``, (samples + 1,), where the evidence of each sample begins: one number for each tile."""
    for s in range(taken.tile.size):
        first[s + 1] = first[s] + 1
        if taken.tile[s] < 0:
            left, right, upper, lower = share_place(
                a, taken.x_m[s], taken.y_m[s], taken.spread_x_m[s], taken.spread_y_m[s], p, w
            )
            first[s + 1] = first[s] + (right - left + 1) * (lower - upper + 1)


@inner
def _renew(a: Memory, p: Reach, w: Any, taken: Taken, s: int, first: int, sites: Floats) -> float:
    """Put the evidence of sample ``s``, given all others, in the place of its earlier evidence; return the change."""
    if taken.tile[s] >= 0:
        change: float = abs(taken.log_ratio[s] - sites[first])
        a.odds[taken.tile[s]] += taken.log_ratio[s] - sites[first]
        sites[first] = taken.log_ratio[s]
        return change
    left, right, upper, lower = share_place(
        a, taken.x_m[s], taken.y_m[s], taken.spread_x_m[s], taken.spread_y_m[s], p, w
    )
    if right < left:
        return 0.0  # off the floor
    width = right - left + 1
    for row in range(upper, lower + 1):
        for column in range(left, right + 1):
            t, k = row * w.columns + column, first + (row - upper) * width + column - left
            a.before[t] = sites[k]
            a.odds[t] -= sites[k]
            sites[k] = a.odds[t]  # the log odds without this sample, until its evidence is known
    add_evidence(a, 0, 0, taken.log_ratio[s], left, right, upper, lower, w)
    most = 0.0
    for row in range(upper, lower + 1):
        for column in range(left, right + 1):
            t, k = row * w.columns + column, first + (row - upper) * width + column - left
            sites[k] = a.odds[t] - sites[k]
            most = max(most, abs(sites[k] - a.before[t]))
    return most


@kernel
def _propagate(
    a: Memory,
    p: Reach,
    w: Any,
    taken: Taken,
    first: NDArray[np.int64],
    ends: NDArray[np.int64],
    sites: Floats,
    sweeps: int,
    out: Floats,
) -> float:
    """Write the log odds of all tiles after each number of samples in ``ends`` to ``out``, (ends, tiles).

    Args:
        a: memory, with the prior log odds in ``odds``. first: as ``count_touched`` writes it.
        sites: evidence of each sample on each tile that it touches, all 0 at first, changed.
    Returns: the largest change of evidence in the last sweep.
    """
    change = 0.0
    for e in range(ends.size):
        for _ in range(sweeps):
            change = 0.0
            for s in range(ends[e]):
                change = max(change, _renew(a, p, w, taken, s, first[s], sites))
            if change < CONVERGED:
                break
        for t in range(a.odds.size):
            out[e, t] = a.odds[t]
    return change


def tile_map(samples: Samples, times_s: ArrayLike, *, prior: float = 0.5, sweeps: int = SWEEPS) -> Floats:
    """Return the probability that each tile vibrates, from the samples that count by each time, (times, tiles).

    Args:
        samples: with a grid. times_s: increasing. prior: probability that a tile vibrates, before any sample.
        sweeps: most repetitions; 1: each sample counts once, in its order, as a robot's own map has it.
    Raises:
        InputError: there is no grid.
    """
    return np.asarray(expit(_log_odds(samples, times_s, prior, sweeps)))


def _log_odds(samples: Samples, times_s: ArrayLike, prior: float, sweeps: int) -> Floats:
    """Return the log odds of each tile of which ``tile_map`` returns the probabilities, (times, tiles)."""
    memory, reach, ground, taken, ends = kernel_arguments(samples, times_s)
    memory.odds[:] = logit(prior)
    first = np.zeros(taken.tile.size + 1, dtype=np.int64)
    count_touched(memory, reach, ground, taken, first)
    out = np.empty((ends.size, memory.odds.size))
    _propagate(memory, reach, ground, taken, first, ends, np.zeros(first[-1]), sweeps, out)
    return out


def kernel_arguments(
    samples: Samples, times_s: ArrayLike
) -> tuple[Memory, Reach, Ground, Taken, NDArray[np.int64]]:
    """Return what kernels of maps need: empty memory, edges, the grid, the samples, and how many count by each time.

    Raises:
        InputError: there is no grid.
    """
    if samples.floor is None:
        raise InputError(
            "a map of tiles needs a grid; give --tiles, or leave it to the raster", field="--tiles"
        )
    rows, columns, *position = samples.floor.geometry
    ground, taken, reach = Ground(1, int(rows), int(columns), *position), _taken(samples), _reach(samples)
    tiles = ground.rows * ground.columns
    memory = Memory(
        odds=np.zeros(tiles),
        weight=np.ones(1),
        of_column=np.zeros(2 * ground.columns),
        of_row=np.zeros(2 * ground.rows),
        of_all=np.zeros(1),
        p=np.zeros(tiles),
        p_without=np.zeros(tiles),
        before=np.zeros(tiles),
    )
    ends = np.searchsorted(samples.column("time_s"), np.atleast_1d(times_s), side="right").astype(np.int64)
    return memory, reach, ground, taken, ends


def _reach(samples: Samples) -> Reach:
    return Reach(max(samples.law.sensor.edge_reach_m or 0.0, 0.0))


def _taken(samples: Samples) -> Taken:
    """Return the samples as the kernels read them; the blur of edges is added to the spread of places."""
    assert samples.floor is not None
    x_m, y_m = samples.column("x_m"), samples.column("y_m")
    blur_m = samples.law.sensor.edge_blur_m or 0.0
    spread_x_m, spread_y_m = (np.hypot(samples.column(name), blur_m) for name in ("spread_x_m", "spread_y_m"))
    is_exact = (spread_x_m == 0.0) & (spread_y_m == 0.0) & (_reach(samples).edge_reach_m == 0.0)
    tile = np.where(is_exact, samples.floor.tile_at(x_m, y_m), -1).astype(np.int64)
    return Taken(tile, x_m, y_m, spread_x_m, spread_y_m, samples.column("log_ratio"))
