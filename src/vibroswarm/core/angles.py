"""Angles of arrays; kernels have ``motion.geometry.wrapped_rad``."""

from __future__ import annotations

import numpy as np

from vibroswarm.core.arrays import Floats


def wrapped(angle_rad: Floats) -> Floats:
    """Return the same angles in [-pi, pi), in the shape of ``angle_rad``."""
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
