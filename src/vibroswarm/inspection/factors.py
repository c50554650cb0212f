"""The factors of robots and tiles, of which samples tell more than a law says: many samples share each of them.

A robot that measures too little makes damage look intact at all places at once. Its factor is estimated from all its
samples so far, beside those of the tiles that it met (best linear unbiased prediction; Henderson 1975), and values are
read as those of a typical robot.

The factor of a tile is one of a few nodes, whose probabilities follow from all samples of the tile
(``patches.OnTiles``): samples beside damage say how its tile measures.

| name | symbol | equation |
|---|---|---|
| score of a value | - | min(F(v), 1/2), F the law of still places: damage scores hardly more than its median |
| rise of the mean score with the log factor | kappa | numerically |
| log factor that a value shows | y | (score - mean score of the law) / kappa |
| factors of robots and tiles | g_r, h_t | y = g_r + h_t + error, g_r and h_t normal with the spreads of the law |
| node of a tile | z | its log factor is s_t z - s_t^2 / 2, with the spread s_t of tiles |
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.inspection.damage import contrast_ratios, interpolated, tables_of, tiles_below
from vibroswarm.inspection.samples import Floats, Law, Samples, read_by
from vibroswarm.observation.energy_model import MOST, likelihood_at

STEP: Final = 0.05
"""Change of the log factor over which kappa is computed."""
WIDEST: Final = 3.0
"""The outermost nodes of a tile, in standard deviations of its log factor."""
APART: Final = 0.15
"""Largest distance between nodes: a hundred samples tell the log factor to half of it."""


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
    error, of_robots, of_tiles = variance / kappa**2, spread**2, (law.sensor.tile_spread or 0.0) ** 2
    log_factors = (score(values) - mean) / kappa + 0.5 * (of_robots + of_tiles)
    robot = np.unique(samples.frame["robot"].to_numpy(), return_inverse=True)[1]
    factor, tile = np.empty_like(values), tiles_below(samples)
    number = np.zeros((robot.max() + 1, tile.max() + 1))
    robot_sum, tile_sum = (np.zeros((groups, values.shape[1])) for groups in number.shape)
    ends = np.searchsorted(look, np.arange(looks), side="right")
    for new in itertools.starmap(slice, itertools.pairwise([0, *ends])):
        on_robot, on_tile = (
            (group[new] == np.arange(groups)[:, None]).astype(np.float64)
            for group, groups in zip((robot, tile), number.shape, strict=True)
        )
        number += on_robot @ on_tile.T
        robot_sum += on_robot @ log_factors[new]
        tile_sum += on_tile @ log_factors[new]
        share = number * of_tiles / (number.sum(axis=0) * of_tiles + error)
        matrix = np.diag(number.sum(axis=1) + error / of_robots) - share @ number.T
        estimate = np.linalg.solve(matrix, robot_sum - share @ tile_sum)
        factor[new] = np.exp(estimate - 0.5 * of_robots)[robot[new]]
    return np.asarray(values / factor)


def nodes_of(law: Law) -> tuple[Floats, Floats]:
    """Return the nodes z of tiles and their prior probabilities, (nodes,) each; one node, 0, if tiles do not differ."""
    spread = max(map(_tile_spread, (law, *(replace(law, sensor=one.judge) for one in law.draws))))
    if spread == 0.0:
        return np.zeros(1), np.ones(1)
    node = np.linspace(-WIDEST, WIDEST, 2 * math.ceil(WIDEST * spread / APART) + 1)
    density = np.exp(-0.5 * node**2)
    return node, density / density.sum()


def intact_at_node(law: Law, value: Floats, node: float) -> Floats:
    """Return the log likelihood of values, by a typical robot, on an intact tile of a node, in the shape of value."""
    factor = _factor(law, node)
    if law.bits:
        ones, _ = _rates_at(law, factor)
        return np.asarray(np.log(np.where(value == 1.0, ones, 1.0 - ones)))
    table = tables_of(law.typical)
    logs = interpolated(value / factor, table.value, _still_table(law.typical), table.of_value)
    return logs - math.log(factor)


def ratios_at_node(law: Law, value: Floats, node: float, contrast: float) -> Floats:
    """Return the log likelihood ratio of values for damage of a contrast on a tile of a node, in the shape of value."""
    factor = _factor(law, node)
    if not law.bits or law.typical is law:
        return contrast_ratios(law.typical, value / factor, contrast)
    still, vibrating = _rates_at(law, factor)
    of_zero, of_one = math.log((1.0 - vibrating) / (1.0 - still)), math.log(vibrating / still)
    return np.asarray(np.clip(np.where(value == 1.0, of_one, of_zero), -MOST, MOST))


def _tile_spread(law: Law) -> float:
    """Return how much tiles differ; readings hardly show a robot's factor, which counts as that of their tiles."""
    return math.hypot(law.sensor.tile_spread or 0.0, (law.bits and law.sensor.robot_spread) or 0.0)


def _factor(law: Law, node: float) -> float:
    spread = _tile_spread(law)
    return math.exp(spread * node - 0.5 * spread**2)


@lru_cache(maxsize=160)
def _still_table(law: Law) -> Floats:
    """Return the log likelihood of the values of a law's table on an intact place."""
    likelihood = likelihood_at(law.sensor, 0.0, tables_of(law).value, law.place)
    return np.asarray(np.log(np.maximum(likelihood, 1e-12)))


def _rates_at(law: Law, factor: float) -> tuple[float, float]:
    """Return the probability of a reading of 1 on still and on vibrating tiles of a factor."""
    table = tables_of(law.typical)
    still, vibrating = (
        np.average(read_by(law, factor * each), weights=np.gradient(table.u))
        for each in (table.still, table.vibrating)
    )
    return float(np.clip(still, 1e-6, 1.0 - 1e-6)), float(np.clip(vibrating, 1e-6, 1.0 - 1e-6))
