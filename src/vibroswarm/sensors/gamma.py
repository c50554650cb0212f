"""The sensor of the paper: energies of still and of vibrating tiles have Gamma distributions (Eq. 20).

| name | symbol | unit | equation |
|---|---|---|---|
| energy | E | RMS of the filtered acceleration | Gamma(shape, scale) + location, of the tile's kind |
| reading | O | 0, 1 | 1 if E > theta_E (Eq. 15) |

Its parameters are fields of the section ``sensor`` itself: ``vibrating_shape``, ``still_shape`` and so on.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.elementary import exp, log
from vibroswarm.sensors.base import SensorModel, Values, register


def law_of(kind: int, p: Any) -> tuple[float, float, float]:
    """Return shape, scale and location of the Gamma law of vibrating (``kind`` 1) or of still tiles."""
    if kind == 1:
        return p.vibrating_shape, p.vibrating_scale, p.vibrating_location
    return p.still_shape, p.still_scale, p.still_location


def measure(kind: int, u: Values, p: Any) -> Values:
    """Return the energies at the quantiles ``u``."""
    from scipy.special import gammaincinv

    shape, scale, location = law_of(kind, p)
    return np.asarray(scale * gammaincinv(shape, u) + location)  # Eq. 20


def above_threshold(value: Values, p: Any) -> NDArray[np.bool_]:
    """Return the readings: whether energies are above theta_E (Eq. 15)."""
    return np.asarray(value > p.rms_threshold)


def share_at_most(kind: int, thresholds: Values, p: Any) -> Values:
    """Return the share of energies of a kind at or below each threshold."""
    from scipy.special import gammainc

    shape, scale, location = law_of(kind, p)
    with np.errstate(over="ignore"):
        return np.asarray(gammainc(shape, np.maximum(thresholds - location, 0.0) / scale))


def likelihood(kind: int, value: Values, p: Any) -> Values:
    """Return the density of energies on a kind of tile; 0 below the law's location."""
    shape, scale, location = law_of(kind, p)
    above = (value - location) / scale
    inside = np.maximum(above, 1e-300)  # so that the logarithm exists; the density is 0 where above <= 0
    density = exp((shape - 1.0) * log(inside) - inside - math.lgamma(shape)) / scale
    return np.where(above > 0.0, density, 0.0)


gamma = register(
    SensorModel(
        name="gamma",
        measure=measure,
        reading=above_threshold,
        share_at_most=share_at_most,
        likelihood=likelihood,
        in_section=True,
        scales=True,
        about="energies of still and of vibrating tiles have gamma distributions",
    )
)
