"""The maps of the floor that robots of ``places``, ``explore`` and ``fading`` keep, at the end of runs.

A robot keeps log odds of each tile by sender, and weights of senders; the probabilities follow from both.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.strategies.place_map import PAIRS


def beliefs_of(
    arrays: Any, runs: int, robots: int, draws: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each robot's map, (runs, robots, tiles), and the pooled map, (runs, tiles).

    Args:
        arrays: of all robots of all runs at the end (``Swarm.arrays``). draws: number of draws of each place; 0: none.
    """
    from scipy.special import expit  # its import takes long

    # A robot keeps one map for each pair of error rates (with the pair's probability, ``credence``) or for each draw.
    has_pairs = hasattr(arrays, "credence")
    maps = PAIRS if has_pairs else max(draws, 1)
    # Axes: run, robot, map, sender, tile.
    odds = arrays.odds.reshape(runs, robots, maps, robots, -1)
    weight = arrays.weight.reshape(runs, robots, 1, robots, 1)
    credence = np.full((runs, robots, maps, 1), 1.0 / maps)
    if has_pairs:
        credence = arrays.credence.reshape(runs, robots, PAIRS, 1)
    # Log odds of a tile of which nothing is known, as each robot has learned them; 0 if tiles are independent.
    prior = np.zeros((runs, robots, 1, 1))
    if hasattr(arrays, "prior_odds"):
        prior = arrays.prior_odds.reshape(runs, robots, 1, 1)
    by_robot = (expit((odds * weight).sum(axis=3) + prior) * credence).sum(axis=2)
    # Robot i's log odds from sender i are those from its own samples; indexing puts the axis of robots first.
    own = odds[:, np.arange(robots), :, np.arange(robots)].sum(axis=0)
    pooled = (expit(own + prior.mean(axis=1)) * credence.mean(axis=1)).sum(axis=1)
    # Rounding may put a sum of weighted probabilities outside [0, 1].
    return np.clip(by_robot, 0.0, 1.0), np.clip(pooled, 0.0, 1.0)
