"""exp and log of arrays, as the C library computes them.

NumPy's own round otherwise on processors with AVX-512, so runs take these; the few sines and cosines that they need
outside of kernels are those of ``math``. For the same reason runs add up products by ``sum``: linear algebra adds in an
order that depends on the processor.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
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
