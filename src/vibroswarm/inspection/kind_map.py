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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import softmax

from vibroswarm.core.jit import inner, kernel
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.inspection.tile_map import (
    CONVERGED,
    SWEEPS,
    Memory,
    Reach,
    Taken,
    count_touched,
    kernel_arguments,
)
from vibroswarm.observation.energy_model import log_ratios_of_classes, rates
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.place_map import share_place


@inner
def _renew(
    a: Memory, p: Reach, w: Any, taken: Taken, ratios: Floats, s: int, first: int, sites: Floats, odds: Floats
) -> float:
    """Put the evidence of sample ``s``, given all others, in the place of its earlier evidence; return the change."""
    kinds, most = odds.shape[1], 0.0
    if taken.tile[s] >= 0:
        for k in range(kinds):
            change = ratios[s, k] - sites[first, k]
            odds[taken.tile[s], k] += change
            sites[first, k] = ratios[s, k]
            most = max(most, abs(change))
        return most
    left, right, upper, lower = share_place(
        a, taken.x_m[s], taken.y_m[s], taken.spread_x_m[s], taken.spread_y_m[s], p, w
    )
    if right < left:
        return 0.0  # off the floor
    width, expected = right - left + 1, 0.0
    for row in range(upper, lower + 1):
        for column in range(left, right + 1):
            t, site = row * w.columns + column, first + (row - upper) * width + column - left
            largest, total, likelihood = -math.inf, 0.0, 0.0
            for k in range(kinds):
                odds[t, k] -= sites[site, k]
                largest = max(largest, odds[t, k])
            for k in range(kinds):
                part = math.exp(odds[t, k] - largest)
                total += part
                likelihood += part * math.exp(ratios[s, k])
            a.p[t] = likelihood / total  # m_t
            expected += a.of_column[2 * column] * a.of_row[2 * row] / a.of_all[0] * a.p[t]
    for row in range(upper, lower + 1):
        for column in range(left, right + 1):
            t, site = row * w.columns + column, first + (row - upper) * width + column - left
            share = a.of_column[2 * column] * a.of_row[2 * row] / a.of_all[0]
            rest = max(expected - share * a.p[t], 0.0)  # R_t; rounding could make it negative
            still = math.log(share + rest) if share + rest > 0.0 else 0.0
            for k in range(kinds):
                found = share * math.exp(ratios[s, k]) + rest
                renewed = math.log(found) - still if found > 0.0 else 0.0
                most = max(most, abs(renewed - sites[site, k]))
                sites[site, k] = renewed
                odds[t, k] += renewed
    return most


@kernel
def _propagate_kinds(
    a: Memory,
    p: Reach,
    w: Any,
    taken: Taken,
    ratios: Floats,
    first: NDArray[np.int64],
    ends: NDArray[np.int64],
    sites: Floats,
    odds: Floats,
    out: Floats,
) -> None:
    """Write the log odds of all kinds against kind 0 after each number of samples to ``out``, (ends, tiles, kinds).

    Args:
        ratios: (samples, kinds), ln r_k. first: as ``count_touched`` writes it. sites: (touched, kinds), evidence of
            each sample on each tile that it touches. odds: (tiles, kinds). Both are all 0 at first, and changed.
    """
    for e in range(ends.size):
        for _ in range(SWEEPS):
            change = 0.0
            for s in range(ends[e]):
                change = max(change, _renew(a, p, w, taken, ratios, s, first[s], sites, odds))
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
    memory, reach, ground, taken, ends = kernel_arguments(samples, times_s)
    value, sensor = samples.column("value"), samples.law.sensor
    ratios = np.stack([log_ratios_of_classes(sensor, value, kind) for kind in range(sensor.kinds)], axis=1)
    first = np.zeros(value.size + 1, dtype=np.int64)
    count_touched(memory, reach, ground, taken, first)
    odds, out = (
        np.zeros((memory.odds.size, sensor.kinds)),
        np.empty((ends.size, memory.odds.size, sensor.kinds)),
    )
    _propagate_kinds(
        memory, reach, ground, taken, ratios, first, ends, np.zeros((first[-1], sensor.kinds)), odds, out
    )
    return np.asarray(softmax(out, axis=-1))


def any_but_still(samples: Samples) -> Samples:
    """Return samples of several kinds as samples of two: whether each reads as any kind but 0.

    The law is that of all kinds but 0 in equal shares. Readings that tell such kinds apart tell nothing more of whether
    there is one, unless kind 0 is taken for one of them more often than for another.
    """
    shares = rates(samples.law.sensor)
    zeros = (float(shares[0, 0]), float(shares[1:, 0].mean()))
    two = Scenario().with_values(
        {"sensor.model": "confusion", "sensor.confusion.rates": [[zero, 1.0 - zero] for zero in zeros]}
    )
    law = replace(samples.law, sensor=two.sensor)
    read = (samples.column("value") > 0).astype(np.float64)
    ratios = log_ratios_of_classes(two.sensor, read, 1)
    return replace(samples.with_columns(value=read, log_ratio=ratios), law=law, kinds=None)
