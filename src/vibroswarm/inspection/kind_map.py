"""The probability that each tile of a known grid is of each of several kinds, given samples whose places are not exact.

| name | symbol | equation |
|---|---|---|
| share of a sample's place on tile t | q_t | as in ``tile_map`` |
| likelihood of the sample on kind k | r_k | P(reading given k) / P(reading given 0) |
| evidence of the sample on tile t for kind k | l_tk | ln((q_t r_k + R_t) / (q_t r_0 + R_t)), R_t = sum of q_u m_u |
| its likelihood on tile u, by the map | m_u | sum over k of p_uk r_k |
| map | p_tk | exp(sum of l_tk) / sum over k of the same |

The sum in R_t is over the other tiles u, with their map without this sample. As in ``tile_map`` the evidence of each
sample is renewed until nothing changes; with two kinds both are the same. Exact places are on one tile each, and then
the map is Bayes' rule.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import softmax

from vibroswarm.core.jit import inner, kernel
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.inspection.tile_map import CONVERGED, SWEEPS, Integers, Shares, ends_of, place_shares
from vibroswarm.observation.energy_model import claimed_rates, log_ratios_of_classes
from vibroswarm.scenario.scenario import Scenario


@inner
def _renew(
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
                change = max(change, _renew(columns, at, s, ratios[s], sites, odds, room))
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
