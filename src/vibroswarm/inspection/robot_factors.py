"""The factors of robots, as far as their samples have shown them: values are read as those of typical robots.

A robot that measures too little makes damage look intact at all places at once, which a mean over places takes for as
many independent findings. Its factor is therefore estimated from all its samples so far.

| name | symbol | equation |
|---|---|---|
| score of a value | - | min(F(v), 1/2), F the law of still places: damage scores hardly more than its median |
| rise of the mean score with the log factor | kappa | numerically |
| estimate of the log factor | g | ((mean score - that of the law) / kappa + s_t^2 / 2) s_r^2 / (s_r^2 + V) |
| its variance | V | that of a score / (kappa^2 n) + s_t^2 sum of m^2 / n^2 |

n samples of the robot so far, m of them on each tile; s_t and s_r the spreads of tiles and robots.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.inspection.damage import interpolated, tables_of, tiles_below
from vibroswarm.inspection.samples import Floats, Law, Samples

STEP: Final = 0.05
"""Change of the log factor over which kappa is computed."""


def of_typical_robots(
    samples: Samples, law: Law, values: Floats, look: NDArray[np.int64], looks: int
) -> Floats:
    """Return values without the factors of their robots, as known when each sample counts, (samples, replicates).

    Readings stay as they are, as do values by a law whose robots do not differ.

    Args:
        law: by which values are judged. values: (samples, replicates). look: from which look on each sample counts,
            from 0, ascending.
    """
    spread, table = law.sensor.robot_spread or 0.0, tables_of(law)

    def score(of: Floats) -> Floats:
        return np.minimum(interpolated(of, table.still, table.u), 0.5)

    weight = np.gradient(table.u)
    typical = score(table.still)
    mean = np.average(typical, weights=weight)
    variance = np.average((typical - mean) ** 2, weights=weight)
    less, more = (np.average(score(table.still * np.exp(by)), weights=weight) for by in (-STEP, STEP))
    kappa = (more - less) / (2.0 * STEP)
    if law.bits or not spread or kappa <= 0.0:
        return values
    of_tiles = (law.sensor.tile_spread or 0.0) ** 2  # the mean of their log factors is minus half of it
    scores = score(values) - mean + 0.5 * kappa * of_tiles
    tile, robots = tiles_below(samples), samples.frame["robot"].to_numpy()
    factor = np.ones_like(values)
    for robot in samples.robots:
        own = np.flatnonzero(robots == robot)
        last = np.maximum(np.searchsorted(look[own], np.arange(looks), side="right"), 1) - 1
        number = last + 1.0
        together = _sums_of_squares(tile[own])[last] / number**2
        error = variance / kappa**2 / number + of_tiles * together
        known = spread**2 / (spread**2 + error) / kappa / number
        factor[own] = np.exp(known[:, None] * scores[own].cumsum(axis=0)[last])[look[own]]
    return np.asarray(values / factor)


def _sums_of_squares(tile: NDArray[np.int64]) -> Floats:
    """Return, after each sample, the sum of the squared numbers of samples on each tile, (samples,)."""
    order = np.argsort(tile, kind="stable")
    begin = np.searchsorted(tile[order], tile[order])
    before = np.empty(tile.size)
    before[order] = np.arange(tile.size) - begin
    return np.asarray((2.0 * before + 1.0).cumsum())
