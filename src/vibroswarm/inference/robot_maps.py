"""The maps of the floor that robots of ``places``, ``explore`` and ``fading`` keep, at the end of runs.

A robot keeps log odds of each tile by sender, and weights of senders; the probabilities follow from both.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def beliefs_of(arrays: Any, runs: int, robots: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each robot's map, (runs, robots, tiles), and the pooled map, (runs, tiles).

    Args:
        arrays: of all robots of all runs at the end (``Swarm.arrays``).
    """
    from scipy.special import expit  # its import takes long

    # Axes: run, robot, sender, tile.
    odds = arrays.odds.reshape(runs, robots, robots, -1)
    weight = arrays.weight.reshape(runs, robots, robots, 1)
    # Log odds of a tile of which nothing is known, as each robot has learned them; 0 if tiles are independent.
    prior = arrays.prior_odds.reshape(runs, robots, 1)
    # Robot i's log odds from sender i are those from its own samples.
    own = odds[:, np.arange(robots), np.arange(robots)].sum(axis=1)
    return expit((odds * weight).sum(axis=2) + prior), expit(own + prior.mean(axis=1))
