"""exp and log of arrays as the C library computes them, and quadrature, with the same bits on every processor.

NumPy's own round otherwise on processors with AVX-512, so runs take these; the few sines and cosines that they need
outside of kernels are those of ``math``. For the same reason runs add up products by ``sum``: linear algebra adds in an
order that depends on the processor. NumPy finds the nodes of Gauss-Hermite quadrature by it, so they are rounded here,
and the weights are computed from the rounded nodes.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Final

import numpy as np
from numpy.polynomial import hermite_e
from numpy.typing import ArrayLike

from vibroswarm.core.arrays import Floats
from vibroswarm.core.jit import kernel

LARGEST: Final = 709.782712893384
"""exp of any larger number is infinite."""


def exp(x: ArrayLike) -> Floats:
    """Return exp of each number, of the shape of ``x``."""
    found = np.array(x, dtype=np.float64, order="C")
    _exp(found.reshape(-1))
    return found


def log(x: ArrayLike) -> Floats:
    """Return ln of each number, none of them below 0, of the shape of ``x``; -inf of 0."""
    found = np.array(x, dtype=np.float64, order="C")
    _log(found.reshape(-1))
    return found


@kernel
def _exp(x: Floats) -> None:
    for i in range(x.size):
        x[i] = math.inf if x[i] > LARGEST else math.exp(x[i])


@kernel
def _log(x: Floats) -> None:
    for i in range(x.size):
        x[i] = -math.inf if x[i] == 0.0 else math.log(x[i])


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
