"""The factors of robots and tiles, of which samples tell more than a law says: many samples share each of them.

A robot that measures too little makes damage look intact at all places at once. Its factor is estimated from all its
samples so far, beside those of the tiles that it met (best linear unbiased prediction; Henderson 1975), and values are
read as those of a typical robot.

The factor of a tile is one of a few nodes, whose probabilities follow from all samples of the tile
(``patches.ratios_at_looks``): samples beside damage say how its tile measures. Where tiles differ by at most half as
much as robots, and by 10 %, the factors of robots have nodes in their place (``judge_of``): a few dozen samples do not
yet tell a factor, and while it was taken as known, told 3.5 % was 5.2 %.

| name | symbol | equation |
|---|---|---|
| score of a value | - | min(F(v), 1/2), F the law of still places; max, if values on damage are smaller |
| rise of the mean score with the log factor | kappa | numerically |
| log factor that a value shows | y | (score - mean score of the law) / kappa |
| factors of robots and tiles | g_r, h_t | y = g_r + h_t + error, g_r and h_t normal with the spreads of the law |
| node of a tile | z | its log factor is s_t z - s_t^2 / 2, with the spread s_t of tiles |
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.inspection.damage import (
    contrast_ratios,
    draws_of,
    interpolated,
    log_density,
    quantiles_of,
    tables_of,
    tiles_below,
)
from vibroswarm.inspection.samples import Floats, Law, Samples, read_by
from vibroswarm.observation.energy_model import MOST

STEP: Final = 0.05
"""Change of the log factor over which kappa is computed."""
WIDEST: Final = 3.0
"""The outermost nodes of a tile, in standard deviations of its log factor."""
APART: Final = 0.15
"""Largest distance between nodes: a hundred samples tell the log factor to less than half of it."""
MOST_NODES: Final = 25
"""Enough for tiles that differ by 60 %; for others nodes are further apart, since more would take too long."""
MOST_TILES: Final = 0.1
"""Largest spread of tiles that may count as none: with 15 % fewer intact surfaces are cleared."""


class _Score(NamedTuple):
    """How values of typical robots on still places score, by a law."""

    of: Callable[[Floats], Floats]
    mean: float
    variance: float
    kappa: float


@lru_cache(maxsize=256)
def _score_of(law: Law) -> _Score:
    """Return how values score: those on damage hardly more, or less, than the median of still places."""
    table = quantiles_of(law.typical)
    is_lower = np.interp(0.5, table.u, table.vibrating) < np.interp(0.5, table.u, table.still)
    beyond = np.maximum if is_lower else np.minimum
    weight = np.gradient(table.u)

    def score(of: Floats) -> Floats:
        return np.asarray(beyond(interpolated(of, table.still, table.u), 0.5))

    typical = score(table.still)
    mean = np.average(typical, weights=weight)
    variance = np.average((typical - mean) ** 2, weights=weight)
    less, more = (np.average(score(table.still * np.exp(by)), weights=weight) for by in (-STEP, STEP))
    return _Score(score, float(mean), float(variance), float(more - less) / (2.0 * STEP))


def _shows_robots(law: Law) -> bool:
    """Return whether values show the factors of robots: readings hardly do, nor do still values that are all equal."""
    if law.bits:
        return False
    score = _score_of(law)
    return score.kappa > 0.0 and score.variance > 1e-12


def of_typical_robots(
    samples: Samples, law: Law, values: Floats, look: NDArray[np.int64], looks: int
) -> Floats:
    """Return values without the factors of their robots, as known when each sample counts, (samples, replicates).

    They stay as they are if robots do not differ by the law, or values do not show it.

    Args:
        law: by which values are judged. values: (samples, replicates). look: from which look on each sample counts,
            from 0, ascending.
    """
    if not law.sensor.robot_spread or not _shows_robots(law):
        return values
    of_robots, of_tiles = law.sensor.robot_spread**2, (law.sensor.tile_spread or 0.0) ** 2
    score = _score_of(law)
    error = score.variance / score.kappa**2
    log_factors = (score.of(values) - score.mean) / score.kappa + 0.5 * (of_robots + of_tiles)
    robot = np.unique(samples.frame["robot"].to_numpy(), return_inverse=True)[1]
    factor, tile = np.empty_like(values), tiles_below(samples)
    number = np.zeros((robot.max() + 1, tile.max() + 1))
    robot_sum, tile_sum = (np.zeros((groups, values.shape[1])) for groups in number.shape)
    ends = np.searchsorted(look, np.arange(looks), side="right")
    for new in itertools.starmap(slice, itertools.pairwise([0, *ends])):
        np.add.at(number, (robot[new], tile[new]), 1.0)
        np.add.at(robot_sum, robot[new], log_factors[new])
        np.add.at(tile_sum, tile[new], log_factors[new])
        share = number * of_tiles / (number.sum(axis=0) * of_tiles + error)
        matrix = np.diag(number.sum(axis=1) + error / of_robots) - share @ number.T
        estimate = np.linalg.solve(matrix, robot_sum - share @ tile_sum)
        factor[new] = np.exp(estimate - 0.5 * of_robots)[robot[new]]
    return np.asarray(values / factor)


@lru_cache(maxsize=16)
def judge_of(law: Law) -> Law:
    """Return the law by which samples are judged: robots' spread is in the place of that of tiles, if much larger.

    It must be so in each of the laws that are its error.
    """
    sensors = [law.sensor, *(one.judge for one in law.draws)]
    spreads = [(one.tile_spread or 0.0, one.robot_spread or 0.0) for one in sensors]
    tiles_count = any(of_tiles > min(MOST_TILES, of_robots / 2.0) for of_tiles, of_robots in spreads)
    if tiles_count or not any(map(max, spreads)):
        return law
    first, *others = (
        one.model_copy(update={"tile_spread": one.robot_spread, "robot_spread": None}) for one in sensors
    )
    draws = tuple(one._replace(judge=judge) for one, judge in zip(law.draws, others, strict=True))
    return replace(law, sensor=first, draws=draws)


def tiles_by(law: Law, samples: Samples) -> NDArray[np.int64]:
    """Return which samples share a factor by the law of ``judge_of``: the number of the tile, or robot, of each."""
    if nodes_of(law)[0].size == 1:
        return np.zeros(samples.frame.height, dtype=np.int64)
    if law is samples.law:
        return tiles_below(samples)
    return np.unique(samples.frame["robot"].to_numpy(), return_inverse=True)[1].astype(np.int64)


@lru_cache(maxsize=16)
def nodes_of(law: Law) -> tuple[Floats, Floats]:
    """Return the nodes z of tiles and their prior probabilities, (nodes,) each; one node, 0, if tiles do not differ."""
    spread = max(map(_tile_spread, (law, *draws_of(law)[0])))
    if spread == 0.0:
        return np.zeros(1), np.ones(1)
    node = np.linspace(-WIDEST, WIDEST, min(2 * math.ceil(WIDEST * spread / APART) + 1, MOST_NODES))
    density = np.exp(-0.5 * node**2)
    return node, density / density.sum()


def logs_at_node(law: Law, value: Floats, node: float, contrasts: tuple[float, ...]) -> Floats:
    """Return the log likelihood of values, by a typical robot, on an intact tile of a node, and their log ratios there.

    Returns: the log likelihood, or 0 if it is the same at all nodes, and the log ratio for damage of each contrast,
        (1 + contrasts, *shape of value).
    """
    factor = _factor(law, node)
    if law.bits and law.typical is not law:
        still, vibrating = _rates_at(law, factor)
        is_one = value == 1.0
        intact = np.where(is_one, math.log(still), math.log(1.0 - still))
        ratio = np.where(is_one, math.log(vibrating / still), math.log((1.0 - vibrating) / (1.0 - still)))
        return np.stack([intact, *[np.clip(ratio, -MOST, MOST)] * len(contrasts)])
    table = tables_of(law.typical)
    logs = interpolated(value / factor, table.value, _log_tables(law, contrasts), table.of_value)
    logs[0] -= math.log(factor)
    return logs


def _tile_spread(law: Law) -> float:
    """Return how much tiles differ; what values do not show of robots counts as differences of their tiles."""
    of_tiles, of_robots = law.sensor.tile_spread or 0.0, law.sensor.robot_spread or 0.0
    return math.hypot(of_tiles, of_robots) if of_robots and not _shows_robots(law) else of_tiles


def _factor(law: Law, node: float) -> float:
    spread = _tile_spread(law)
    return math.exp(spread * node - 0.5 * spread**2)


@lru_cache(maxsize=160)
def _log_tables(law: Law, contrasts: tuple[float, ...]) -> Floats:
    """Return what ``logs_at_node`` says of the values of a law's table on a typical tile, (1 + contrasts, values)."""
    value, typical = tables_of(law.typical).value, law.typical
    still = np.zeros(value.size)
    if _tile_spread(law):
        still = log_density(typical, 0.0, value)
    return np.stack([still, *(contrast_ratios(typical, value, contrast) for contrast in contrasts)])


@lru_cache(maxsize=4096)
def _rates_at(law: Law, factor: float) -> tuple[float, float]:
    """Return the probability, as robots claim it, of a reading of 1 on still and on vibrating tiles of a factor."""
    if law.sensor.claimed_rates is not None:
        still, vibrating = np.clip(np.array(law.sensor.claimed_rates)[:, 1], 1e-6, 1.0 - 1e-6)
        return float(still), float(vibrating)
    table = quantiles_of(law.typical)
    still, vibrating = (
        np.average(read_by(law, factor * each), weights=np.gradient(table.u))
        for each in (table.still, table.vibrating)
    )
    return float(np.clip(still, 1e-6, 1.0 - 1e-6)), float(np.clip(vibrating, 1e-6, 1.0 - 1e-6))
