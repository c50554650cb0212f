"""Types of arrays, of any shape, and angles of arrays; kernels have ``motion.geometry.wrapped_rad``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def wrapped(angle_rad: Floats) -> Floats:
    """Return the same angles in [-pi, pi), in the shape of ``angle_rad``."""
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
