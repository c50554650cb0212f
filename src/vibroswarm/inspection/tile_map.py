"""The probability of each kind of each tile of a known grid, given samples whose places are not exact.

| name | symbol | equation |
|---|---|---|
| share of a sample's place on tile t | q_t | normal in x and y; their sum is 1, on the grid |
| likelihood of the sample on kind k | r_k | P(value given k) / P(value given 0) |
| its likelihood on tile u, by the map | m_u | sum over k of p_uk r_k |
| evidence of the sample on tile t for kind k | l_tk | ln((q_t r_k + R_t) / (q_t r_0 + R_t)), R_t = sum of q_u m_u |
| map | p_tk | exp(sum of l_tk) / sum over k of the same |

The sum in R_t is over the other tiles u, with their map without this sample. The evidence of each sample is renewed
until nothing changes: expectation propagation with independent tiles (Minka 2001). Exact places are on one tile each,
and then the map is Bayes' rule. Blur and reach of an edge are a spread of the place: near an edge a sample counts for
both tiles. All kinds have the same probability before any sample.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, softmax

from vibroswarm.core.jit import kernel
from vibroswarm.inspection.laws import sensor_of_bits
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.observation.energy_model import claimed_rates, log_ratios_of_classes

Integers = NDArray[np.int64]

SWEEPS: Final = 50
"""Most repetitions."""
CONVERGED: Final = 1e-6
"""Largest change of evidence in the last repetition."""
LEAST: Final = 1e-6
"""Smaller shares of a place count as none."""


class Shares(NamedTuple):
    """Shares of the samples' places on tiles, sample by sample."""

    first: Integers
    """(samples + 1,): where the entries of each sample begin."""
    tile: Integers
    share: Floats


def place_shares(samples: Samples) -> Shares:
    """Return the shares of the samples' places on the tiles."""
    rows, columns, width_m, height_m, left_m, bottom_m = samples.grid.geometry
    sensor = samples.law.sensor
    edge_m = math.hypot(sensor.edge_blur_m or 0.0, sensor.edge_reach_m or 0.0)

    def along(axis: str, low_m: float, side_m: float, number: int) -> Floats:
        spread_m = np.hypot(samples.column(f"spread_{axis}_m"), edge_m)[:, None]
        ends = low_m + side_m * np.arange(number + 1) - samples.column(f"{axis}_m")[:, None]
        below = np.where(spread_m > 0.0, ndtr(ends / np.maximum(spread_m, 1e-12)), ends > 0.0)
        return np.diff(below)

    across = along("x", left_m, width_m, columns)
    up = along("y", bottom_m, height_m, rows)[:, ::-1]  # from the top
    sample, tile = np.nonzero((up[:, :, None] * across[:, None, :] > LEAST).reshape(len(up), -1))
    share = up[sample, tile // columns] * across[sample, tile % columns]
    total = np.bincount(sample, share, len(up))
    first = np.append(0, np.cumsum(np.bincount(sample, minlength=len(up))))
    return Shares(first.astype(np.int64), tile.astype(np.int64), share / total[sample])


@kernel
def _propagate(
    at: Shares, ratios: Floats, ends: Integers, sites: Floats, odds: Floats, mean: Floats, out: Floats
) -> None:
    """Write the log odds of all kinds against kind 0 after each number of samples to ``out``, (ends, tiles, kinds)."""
    kinds = ratios.shape[1]
    for e in range(ends.size):
        for _ in range(SWEEPS):
            change = 0.0
            for s in range(ends[e]):
                expected = 0.0
                for i in range(at.first[s], at.first[s + 1]):
                    t, largest, total, found = at.tile[i], -math.inf, 0.0, 0.0
                    for k in range(kinds):
                        odds[t, k] -= sites[i, k]
                        largest = max(largest, odds[t, k])
                    for k in range(kinds):
                        part = math.exp(odds[t, k] - largest)
                        total += part
                        found += part * math.exp(ratios[s, k])
                    mean[t] = found / total
                    expected += at.share[i] * mean[t]
                for i in range(at.first[s], at.first[s + 1]):
                    t = at.tile[i]
                    rest = max(expected - at.share[i] * mean[t], 0.0)  # R_t; rounding could make it negative
                    for k in range(kinds):
                        renewed = math.log(
                            (at.share[i] * math.exp(ratios[s, k]) + rest) / (at.share[i] + rest)
                        )
                        change = max(change, abs(renewed - sites[i, k]))
                        sites[i, k] = renewed
                        odds[t, k] += renewed
            if change < CONVERGED:
                break
        for t in range(len(odds)):
            for k in range(kinds):
                out[e, t, k] = odds[t, k]


def kind_map(samples: Samples, times_s: ArrayLike) -> Floats:
    """Return the probability that each tile is of each kind, by each time, (times, tiles, kinds)."""
    at, law = place_shares(samples), samples.law
    ends = np.searchsorted(samples.column("time_s"), np.atleast_1d(times_s), side="right").astype(np.int64)
    kinds, log_ratio = law.sensor.kinds, samples.column("log_ratio")
    columns = [np.zeros_like(log_ratio), log_ratio]
    if kinds > 2:
        value = samples.column("value")
        columns = [log_ratios_of_classes(law.sensor, value, kind, law.place) for kind in range(kinds)]
    odds = np.zeros((samples.grid.tiles.size, kinds))
    out = np.empty((ends.size, *odds.shape))
    sites = np.zeros((at.tile.size, kinds))
    _propagate(at, np.stack(columns, axis=1), ends, sites, odds, np.empty(len(odds)), out)
    return np.asarray(softmax(out, axis=-1))


def tile_map(samples: Samples, times_s: ArrayLike) -> Floats:
    """Return the probability that each tile vibrates, or is not of kind 0, by each time, (times, tiles)."""
    return 1.0 - kind_map(samples, times_s)[..., 0]


def felt_on(samples: Samples, p: Floats) -> Floats:
    """Return the probability that each sample feels vibration at its place, by a map of the tiles, (samples,)."""
    at, number = place_shares(samples), samples.frame.height
    sample = np.repeat(np.arange(number), np.diff(at.first))
    return np.bincount(sample, at.share * p[at.tile], number).astype(np.float64)


def any_but_still(samples: Samples) -> Samples:
    """Return samples of several kinds as samples of two, 0 and any other; the law is that of the others alike."""
    shares = 1.0 - claimed_rates(samples.law.sensor, samples.law.place)[:, 0]
    law = replace(samples.law, sensor=sensor_of_bits(np.array([shares[0], shares[1:].mean()])), bits=True)
    read = (samples.column("value") > 0).astype(np.float64)
    ratios = log_ratios_of_classes(law.sensor, read, 1)
    return replace(samples.with_columns(value=read, log_ratio=ratios), law=law, kinds=None)
