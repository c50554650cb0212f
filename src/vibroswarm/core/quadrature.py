"""Nodes and weights of Gauss-Hermite quadrature with the same bits on every processor.

NumPy finds the nodes by linear algebra, so that their last digits depend on the processor. They are rounded here, and
the weights are computed from the rounded nodes.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.polynomial import hermite_e

from vibroswarm.core.arrays import Floats

DECIMALS: Final = 12
"""Decimals of a node: NumPy's differ by some 1e-15."""


@cache
def over_normal(nodes: int) -> tuple[Floats, Floats]:
    """Return nodes and weights, (nodes,) each, for means over the standard normal distribution; weights sum to 1."""
    at = np.round(hermite_e.hermegauss(nodes)[0], DECIMALS)
    before = hermite_e.hermeval(
        at, np.eye(nodes)[-1]
    )  # He_(n-1), of which the weights are the inverse square
    weights = (np.abs(before).max() / before) ** 2
    shares = weights / weights.sum()
    for values in (at, shares):
        values.setflags(write=False)
    return at, shares
