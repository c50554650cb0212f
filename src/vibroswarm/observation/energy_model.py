"""Distributions of energies on still and on vibrating tiles, with quantiles and error rates.

| name | symbol | unit | equation |
|---|---|---|---|
| share below | F(theta_E) | - | of the kind's distribution |
| false positive, false negative | - | - | 1 - F_still(theta_E), F_vibrating(theta_E) |
| factor | c | - | E = c G; E > theta_E if G > theta_E / c; log-normal of mean 1 |
"""

from __future__ import annotations

import math
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from vibroswarm.scenario.fields import Sensor


def share_below(sensor: Sensor, vibrating: bool) -> float:
    """Return F(theta_E): the probability that a tile of this kind reads as still."""
    if sensor.model == "energies":
        energies = np.sort(measured_of(sensor, vibrating))
        return float(np.searchsorted(energies, sensor.rms_threshold, side="right")) / energies.size
    return _gamma_below(sensor.rms_threshold, *gamma_of(sensor, vibrating))


@lru_cache(maxsize=64)
def _gamma_below(threshold: float, shape: float, scale: float, location: float) -> float:
    from scipy.special import gammainc

    return float(gammainc(shape, max(threshold - location, 0.0) / scale))


def error_rates(sensor: Sensor) -> tuple[float, float]:
    """Return (false positive, false negative): still tiles that read as vibrating, and vice versa.

    If tiles or robots differ, these are means over all of them. They hold away from edges, whatever
    ``sensor.edge_reach_m``: the effect of edges depends on the floor (``decision_boundary.sensed_shares_on``).
    """
    if sensor.tile_spread is None and sensor.robot_spread is None:
        return 1.0 - share_below(sensor, False), share_below(sensor, True)
    factors, weights = typical_factors(sensor)
    still, vibrating = (float(weights @ shares_below(sensor, kind, factors)) for kind in (False, True))
    return 1.0 - still, vibrating


def shares_below(sensor: Sensor, vibrating: bool, factors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``share_below`` with energies multiplied by these factors (above 0), shape as ``factors``."""
    thresholds = sensor.rms_threshold / factors
    if sensor.model == "energies":
        energies = np.sort(measured_of(sensor, vibrating))
        return np.asarray(np.searchsorted(energies, thresholds, side="right") / energies.size)
    from scipy.special import gammainc

    shape, scale, location = gamma_of(sensor, vibrating)
    return np.asarray(gammainc(shape, np.maximum(thresholds - location, 0.0) / scale))


def energy_of(sensor: Sensor, vibrating: bool, u: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the energies at quantiles ``u`` on a tile of this kind, shape as ``u``."""
    if sensor.model == "energies":
        energies = np.sort(measured_of(sensor, vibrating))
        return energies[(u * energies.size).astype(np.int64)].astype(np.float32)
    from scipy.special import gammaincinv

    shape, scale, location = gamma_of(sensor, vibrating)
    return (scale * gammaincinv(shape, u) + location).astype(np.float32)  # Eq. 20


def energies_of(
    sensor: Sensor,
    vibrating: NDArray[np.bool_],
    u: NDArray[np.float64],
    factors: NDArray[np.float64] | None = None,
) -> NDArray[np.float32]:
    """Return ``energy_of`` for places of both kinds, multiplied by ``factors`` if given, shape as ``u``."""
    energy = np.empty(u.size, dtype=np.float32)
    for kind in (False, True):
        energy[vibrating == kind] = energy_of(sensor, kind, u[vibrating == kind])
    return energy if factors is None else (energy * factors).astype(np.float32)


def gamma_of(sensor: Sensor, vibrating: bool) -> tuple[float, float, float]:
    """Return shape, scale and location of the Gamma law of a kind of tile."""
    if vibrating:
        return sensor.vibrating_shape, sensor.vibrating_scale, sensor.vibrating_location
    return sensor.still_shape, sensor.still_scale, sensor.still_location


def measured_of(sensor: Sensor, vibrating: bool) -> NDArray[np.float64]:
    """Return the measured energies of a kind of tile, if the sensor draws from these."""
    values = sensor.vibrating_energies if vibrating else sensor.still_energies
    assert values is not None, "checked by Scenario"
    return np.asarray(values, dtype=np.float64)


NODES = 33


def typical_factors(sensor: Sensor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return factors of tile and robot together, and weights, for means over all of them (Gauss-Hermite)."""
    spread = math.hypot(sensor.tile_spread or 0.0, sensor.robot_spread or 0.0)
    nodes, weights = _nodes()
    return np.exp(spread * nodes - 0.5 * spread**2), weights / weights.sum()


@cache
def _nodes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return nodes and weights of Gauss-Hermite, (NODES,) each."""
    return np.polynomial.hermite_e.hermegauss(NODES)
