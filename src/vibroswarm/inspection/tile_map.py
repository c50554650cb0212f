"""The probability that each tile of a known grid vibrates, given samples whose places are not exact.

| name | symbol | equation |
|---|---|---|
| share of a sample's place in a region | s | normal in x and y, by ``strategies.place_map`` |
| likelihood ratio of the sample | r | density where it vibrates over that where it is still |
| likelihood of the sample | L | 1 + (r - 1) F, F the probability that it feels vibration |
| nothing vibrates in a region | - | product over its tiles u of c_u = 1 - p_u |
| shares of tile t alone | A_t | sum over regions with t of s times the product of c_u over their other tiles |
| other regions | R_t | sum over regions without t of s times the product of c_u |
| evidence of the sample on tile t | e_t | (1 + (r - 1)(1 - R_t)) / (1 + (r - 1)(1 - R_t - A_t)) |
| map | p_t | 1 - 1 / (1 + prior odds * product of e_t) |

A region is a tile; where vibration is felt beyond edges also the strip around an edge or a corner, with the tiles on
its sides. p_u is the map without this sample. A robot of strategy ``places`` adds each sample once, in the order in
which it hears them, so that its map depends on that order (``strategies.place_map``, whose evidence is ln e_t).
Here the same update is repeated, each time with the sample's earlier evidence taken out, until nothing changes:
expectation propagation with independent tiles (Minka 2001). Exact places are on one tile each, and then the map is
exact. The blur of an edge is a spread of the place.

Evidence is multiplied, not added, and shares are computed once, which takes a quarter of the time.

With several kinds (``kind_map``), the probability that each tile is of each kind:

| name | symbol | equation |
|---|---|---|
| share of a sample's place on tile t | q_t | as above |
| likelihood of the sample on kind k | r_k | P(reading given k) / P(reading given 0) |
| evidence of the sample on tile t for kind k | l_tk | ln((q_t r_k + R_t) / (q_t r_0 + R_t)), R_t = sum of q_u m_u |
| its likelihood on tile u, by the map | m_u | sum over k of p_uk r_k |
| map | p_tk | exp(sum of l_tk) / sum over k of the same |

The sum in R_t is over the other tiles u, with their map without this sample. As above, the evidence of each
sample is renewed until nothing changes; with two kinds both are the same. Exact places are on one tile each, and then
the map is Bayes' rule.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, logit, softmax

from vibroswarm.core.jit import inner, kernel
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.observation.energy_model import claimed_rates, log_ratios_of_classes
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.place_map import share_place

Integers = NDArray[np.int64]

SWEEPS: Final = 50
"""Most repetitions."""
CONVERGED: Final = 1e-6
"""Largest change of log odds in the last repetition."""
LARGEST: Final = 1e200
"""Limit of odds within a repetition, and of products before their logarithm is taken."""


class Ground(NamedTuple):
    """The grid, and how far beyond its edges a tile is felt, under the names by which ``place_map`` reads them."""

    rows: int
    columns: int
    tile_width_m: float
    tile_height_m: float
    left_m: float
    bottom_m: float
    edge_reach_m: float


class Shares(NamedTuple):
    """Shares of the samples' places, as ``place_map.share_place`` writes them, divided by their sum."""

    box: Integers
    """(samples, 4): first and last column, first and last row; the last column is before the first: off the grid."""
    of_column: Floats
    """(samples, 2 columns)."""
    of_row: Floats
    """(samples, 2 rows)."""
    first: Integers
    """(samples + 1,): where the evidence of each sample begins, one number for each tile of its box."""
    has_strips: bool
    """Whether vibration is felt beyond edges."""


class Room(NamedTuple):
    """Where ``place_map.share_place`` writes."""

    of_column: Floats
    of_row: Floats
    of_all: Floats


@kernel
def _share_places(
    tile: Integers, x_m: Floats, y_m: Floats, spread_x_m: Floats, spread_y_m: Floats,
    ground: Any, box: Integers, of_column: Floats, of_row: Floats, of_all: Floats,
) -> None:  # fmt: skip
    """Write the shares of each place.

    Args:
        tile: tile of each exact place, -1: on none; -2: the place is not exact. of_all: room, (1,).
    """
    for s in range(tile.size):
        if tile[s] >= 0:
            row, column = tile[s] // ground.columns, tile[s] % ground.columns
            box[s, 0], box[s, 1], box[s, 2], box[s, 3] = column, column, row, row
            of_column[s, 2 * column], of_row[s, 2 * row] = 1.0, 1.0
        elif tile[s] == -1:
            box[s, 0], box[s, 1], box[s, 2], box[s, 3] = 0, -1, 0, -1
        else:
            room = Room(of_column[s], of_row[s], of_all)
            left, right, upper, lower = share_place(
                room, x_m[s], y_m[s], spread_x_m[s], spread_y_m[s], ground, ground
            )
            box[s, 0], box[s, 1], box[s, 2], box[s, 3] = left, right, upper, lower
            for c in range(2 * left, 2 * right + 2):
                of_column[s, c] /= of_all[0]


@inner
def _add_strips(
    columns: int, of_column: Floats, of_row: Floats, box: Integers, c: Floats, alone: Floats
) -> float:
    """Add the strips around edges and corners to ``alone``, A_t; return their sum of s times the products of c."""
    total, right, lower = 0.0, box[1], box[3]
    for row in range(box[2], lower + 1):
        for column in range(box[0], right + 1):
            t = row * columns + column
            if column < right:
                share = of_column[2 * column + 1] * of_row[2 * row]
                alone[t] += share * c[t + 1]
                alone[t + 1] += share * c[t]
                total += share * c[t] * c[t + 1]
            if row < lower:
                below = t + columns
                share = of_column[2 * column] * of_row[2 * row + 1]
                alone[t] += share * c[below]
                alone[below] += share * c[t]
                total += share * c[t] * c[below]
            if column < right and row < lower:
                share = of_column[2 * column + 1] * of_row[2 * row + 1]
                above, under = c[t] * c[t + 1], c[below] * c[below + 1]
                alone[t] += share * c[t + 1] * under
                alone[t + 1] += share * c[t] * under
                alone[below] += share * c[below + 1] * above
                alone[below + 1] += share * c[below] * above
                total += share * above * under
    return total


@inner
def _renew(
    columns: int, at: Shares, s: int, more: float, sites: Floats, room: Floats, log_odds: Floats
) -> float:
    """Put the evidence of sample ``s``, given all others, in the place of its earlier evidence; return the change.

    Args:
        more: r - 1. sites: evidence of the samples. room: odds of the tiles, their c, shares alone, and the product of
            the evidence of samples up to this one, (4, tiles). log_odds: gets the logarithm of products too large.
    """
    odds, c, alone, product = room[0], room[1], room[2], room[3]
    left, right, k, total = at.box[s, 0], at.box[s, 1], at.first[s], 0.0
    for row in range(at.box[s, 2], at.box[s, 3] + 1):
        for column in range(left, right + 1):
            t = row * columns + column
            c[t] = 1.0 / (1.0 + odds[t] / sites[k])
            alone[t] = at.of_column[s, 2 * column] * at.of_row[s, 2 * row]
            total += alone[t] * c[t]
            k += 1
    if at.has_strips:
        total += _add_strips(columns, at.of_column[s], at.of_row[s], at.box[s], c, alone)
    most, k = 0.0, at.first[s]
    for row in range(at.box[s, 2], at.box[s, 3] + 1):
        for column in range(left, right + 1):
            t = row * columns + column
            felt = 1.0 - (total - c[t] * alone[t])
            found = (1.0 + more * felt) / (1.0 + more * (felt - alone[t]))
            change = found / sites[k]
            most = max(most, abs(change - 1.0))
            sites[k] = found
            odds[t] = min(max(odds[t] * change, 1.0 / LARGEST), LARGEST)
            product[t] *= found
            if not 1.0 / LARGEST < product[t] < LARGEST:
                log_odds[t] += math.log(product[t])
                product[t] = 1.0
            k += 1
    return most


@kernel
def _propagate(
    columns: int, at: Shares, more: Floats, ends: Integers, sweeps: int, prior: float, sites: Floats, room: Floats,
    log_odds: Floats,
) -> None:  # fmt: skip
    """Write the log odds of all tiles after each number of samples in ``ends`` to ``log_odds``, (ends, tiles).

    Args:
        more: r - 1 of each sample. prior: log odds of a tile before any sample. sites: evidence of the samples on the
            tiles of their boxes, all 1 at first, changed. room: (4, tiles).
    """
    odds, product = room[0], room[3]
    for e in range(ends.size):
        now = log_odds[e]
        for t in range(now.size):
            now[t] = log_odds[e - 1, t] if e > 0 else prior
        for _ in range(sweeps):
            for t in range(
                now.size
            ):  # computed again from all evidence: within a repetition odds are limited
                odds[t] = min(max(math.exp(min(now[t], 700.0)), 1.0 / LARGEST), LARGEST)
                now[t], product[t] = prior, 1.0
            change = 0.0
            for s in range(ends[e]):
                change = max(change, _renew(columns, at, s, more[s], sites, room, now))
            for t in range(now.size):
                now[t] += math.log(product[t])
            if change < CONVERGED:
                break


def tile_map(samples: Samples, times_s: ArrayLike, *, prior: float = 0.5, sweeps: int = SWEEPS) -> Floats:
    """Return the probability that each tile vibrates, from the samples that count by each time, (times, tiles).

    Args:
        samples: with a grid. times_s: increasing. prior: probability that a tile vibrates, before any sample.
        sweeps: most repetitions; 1: each sample counts once, in its order, as a robot's own map has it.
    Raises:
        InputError: there is no grid.
    """
    at, ends = place_shares(samples), ends_of(samples, times_s)
    rows, columns = samples.grid.tiles.shape
    out, room, sites = (
        np.empty((ends.size, rows * columns)),
        np.empty((4, rows * columns)),
        np.ones(at.first[-1]),
    )
    more = np.expm1(samples.column("log_ratio"))
    _propagate(columns, at, more, ends, sweeps, float(logit(prior)), sites, room, out)
    return np.asarray(expit(out))


def ends_of(samples: Samples, times_s: ArrayLike) -> Integers:
    """Return how many samples count by each time, (times,)."""
    counted = np.searchsorted(samples.column("time_s"), np.atleast_1d(times_s), side="right")
    return np.asarray(counted, dtype=np.int64)


def place_shares(samples: Samples) -> Shares:
    """Return the shares of the samples' places; the blur of edges is added to the spread of places.

    Raises:
        InputError: there is no grid.
    """
    sensor = samples.law.sensor
    reach_m = max(sensor.edge_reach_m or 0.0, 0.0)
    ground = Ground(*samples.grid.geometry, reach_m)
    x_m, y_m, blur_m = samples.column("x_m"), samples.column("y_m"), sensor.edge_blur_m or 0.0
    spread_x_m, spread_y_m = (np.hypot(samples.column(name), blur_m) for name in ("spread_x_m", "spread_y_m"))
    is_exact = (spread_x_m == 0.0) & (spread_y_m == 0.0) & (reach_m == 0.0)
    tile = np.where(is_exact, samples.grid.tile_at(x_m, y_m), -2).astype(np.int64)
    box = np.empty((tile.size, 4), dtype=np.int64)
    of_column, of_row = np.zeros((tile.size, 2 * ground.columns)), np.zeros((tile.size, 2 * ground.rows))
    _share_places(tile, x_m, y_m, spread_x_m, spread_y_m, ground, box, of_column, of_row, np.empty(1))
    touched = (box[:, 1] - box[:, 0] + 1) * (box[:, 3] - box[:, 2] + 1)
    return Shares(box, of_column, of_row, np.append(0, np.cumsum(touched)), reach_m > 0.0)


def felt_on(samples: Samples, p: Floats) -> Floats:
    """Return the probability that each sample feels vibration at its place, by a map of the tiles, (samples,).

    Args:
        p: probability that each tile vibrates, (tiles,).
    """
    at = place_shares(samples)
    quiet = 1.0 - p.reshape(samples.grid.tiles.shape)
    rows, columns = (at.of_row[:, ::2], at.of_row[:, 1:-1:2]), (at.of_column[:, ::2], at.of_column[:, 1:-1:2])
    still = (rows[0] @ quiet * columns[0]).sum(axis=1)
    if at.has_strips:
        below, beside = quiet[:-1] * quiet[1:], quiet[:, :-1] * quiet[:, 1:]
        still += (rows[1] @ below * columns[0]).sum(axis=1) + (rows[0] @ beside * columns[1]).sum(axis=1)
        still += (rows[1] @ (below[:, :-1] * below[:, 1:]) * columns[1]).sum(axis=1)
    # Off the grid nothing vibrates.
    return np.asarray(np.where(at.box[:, 1] < at.box[:, 0], 0.0, 1.0 - still))


@inner
def _renew_kinds(
    columns: int, at: Shares, s: int, ratios: Floats, sites: Floats, odds: Floats, likelihood: Floats
) -> float:
    """Put the evidence of sample ``s``, given all others, in the place of its earlier evidence; return the change.

    Args:
        ratios: ln r_k of the sample, (kinds,). likelihood: room, (tiles,).
    """
    box, of_column, of_row, site, expected = at.box[s], at.of_column[s], at.of_row[s], at.first[s], 0.0
    for row in range(box[2], box[3] + 1):
        for column in range(box[0], box[1] + 1):
            t, largest, total, found = row * columns + column, -math.inf, 0.0, 0.0
            for k in range(ratios.size):
                odds[t, k] -= sites[site, k]
                largest = max(largest, odds[t, k])
            for k in range(ratios.size):
                part = math.exp(odds[t, k] - largest)
                total += part
                found += part * math.exp(ratios[k])
            likelihood[t] = found / total  # m_t
            expected += of_column[2 * column] * of_row[2 * row] * likelihood[t]
            site += 1
    most, site = 0.0, at.first[s]
    for row in range(box[2], box[3] + 1):
        for column in range(box[0], box[1] + 1):
            t, share = row * columns + column, of_column[2 * column] * of_row[2 * row]
            rest = max(expected - share * likelihood[t], 0.0)  # R_t; rounding could make it negative
            still = math.log(share + rest) if share + rest > 0.0 else 0.0
            for k in range(ratios.size):
                found = share * math.exp(ratios[k]) + rest
                renewed = math.log(found) - still if found > 0.0 else 0.0
                most = max(most, abs(renewed - sites[site, k]))
                sites[site, k] = renewed
                odds[t, k] += renewed
            site += 1
    return most


@kernel
def _propagate_kinds(
    columns: int, at: Shares, ratios: Floats, ends: Integers, sites: Floats, odds: Floats, room: Floats, out: Floats
) -> None:  # fmt: skip
    """Write the log odds of all kinds against kind 0 after each number of samples to ``out``, (ends, tiles, kinds).

    Args:
        ratios: (samples, kinds), ln r_k. sites: (touched, kinds), evidence of each sample on each tile of its box.
            odds: (tiles, kinds). Both are all 0 at first, and changed. room: (tiles,).
    """
    for e in range(ends.size):
        for _ in range(SWEEPS):
            change = 0.0
            for s in range(ends[e]):
                change = max(change, _renew_kinds(columns, at, s, ratios[s], sites, odds, room))
            if change < CONVERGED:
                break
        for t in range(odds.shape[0]):
            for k in range(odds.shape[1]):
                out[e, t, k] = odds[t, k]


def kind_map(samples: Samples, times_s: ArrayLike) -> Floats:
    """Return the probability that each tile is of each kind, by each time, (times, tiles, kinds).

    All kinds have the same probability before any sample.

    Args:
        samples: with a grid, and with readings of classes as values. times_s: increasing.
    """
    at, ends = place_shares(samples), ends_of(samples, times_s)
    value, sensor = samples.column("value"), samples.law.sensor
    ratios = np.stack(
        [log_ratios_of_classes(sensor, value, kind, samples.law.place) for kind in range(sensor.kinds)],
        axis=1,
    )
    tiles, columns = samples.grid.tiles.size, samples.grid.tiles.shape[1]
    odds, sites = np.zeros((tiles, sensor.kinds)), np.zeros((at.first[-1], sensor.kinds))
    out = np.empty((ends.size, *odds.shape))
    _propagate_kinds(columns, at, ratios, ends, sites, odds, np.empty(tiles), out)
    return np.asarray(softmax(out, axis=-1))


def any_but_still(samples: Samples) -> Samples:
    """Return samples of several kinds as samples of two: whether each reads as any kind but 0.

    The law is that of all kinds but 0 in equal shares. Readings that tell such kinds apart tell nothing more of whether
    there is one, unless kind 0 is taken for one of them more often than for another.
    """
    shares = claimed_rates(samples.law.sensor, samples.law.place)
    read_0 = (float(shares[0, 0]), float(shares[1:, 0].mean()))
    two = Scenario().with_values(
        {"sensor.model": "confusion", "sensor.confusion.rates": [[share, 1.0 - share] for share in read_0]}
    )
    law = replace(samples.law, sensor=two.sensor, bits=True)
    read = (samples.column("value") > 0).astype(np.float64)
    ratios = log_ratios_of_classes(two.sensor, read, 1)
    return replace(samples.with_columns(value=read, log_ratio=ratios), law=law, kinds=None)
