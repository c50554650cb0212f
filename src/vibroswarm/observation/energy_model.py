"""Distributions of energies on still and on vibrating tiles: quantiles, error rates, and what an energy says of a tile.

| name | symbol | unit | equation |
|---|---|---|---|
| share below | F(theta_E) | - | of the kind's distribution |
| false positive, false negative | - | - | 1 - F_still(theta_E), F_vibrating(theta_E) |
| factor | c | - | E = c G; E > theta_E if G > theta_E / c; log-normal of mean 1 |
| density | f(E) | - | of the kind's Gamma law; a mean over factors of tiles and robots if these differ |
| log ratio | L | - | ln f_vibrating(E) - ln f_still(E), cut off at +- ``MOST`` |
| of measured energies | L | - | ln of shares of both kinds in a bin of E, half an energy added to each bin and kind |

Near edges a sample senses the law of one kind or the other, never a mixture, so that L is the same there. What a failed
sensor reads is a bit alone: where the bit is not that of the energy, L is what the bit says by the error rates.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from typing import Final

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


MOST: Final = 8.0
"""No energy says more than this."""
BINS: Final = 16
"""Bins of measured energies, of equal numbers of both kinds together."""


def log_ratios(
    sensor: Sensor, observation: NDArray[np.uint8], energy: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return L of each sample, (samples,), from its energy; from its bit if the energy would give the other bit.

    Args:
        observation, energy: (samples,): its bit and its energy.
    """
    found = _of_energies(sensor, energy.astype(np.float64))
    positive, negative = (min(max(rate, 1e-6), 1.0 - 1e-6) for rate in error_rates(sensor))
    of_bit = np.where(
        observation == 1, math.log((1.0 - negative) / positive), math.log(negative / (1.0 - positive))
    )
    read = (energy > np.float32(sensor.rms_threshold)).astype(np.uint8)
    return np.clip(np.where(read == observation, found, of_bit), -MOST, MOST)


def _of_energies(sensor: Sensor, energy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return L of energies, not cut off."""
    factors, weights = np.ones(1), np.ones(1)
    if sensor.tile_spread is not None or sensor.robot_spread is not None:
        factors, weights = typical_factors(sensor)
    if sensor.model == "energies":
        return _of_measured(sensor, energy, factors, weights)
    still, vibrating = (
        _log_density(gamma_of(sensor, kind), energy, factors, weights) for kind in (False, True)
    )
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(vibrating - still, nan=0.0, posinf=MOST, neginf=-MOST)


def _log_density(
    law: tuple[float, float, float],
    energy: NDArray[np.float64],
    factors: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return ln of the density of a Gamma law, averaged over factors, shape as ``energy``."""
    shape, scale, location = law
    total = np.zeros(energy.shape)
    for factor, weight in zip(factors.tolist(), weights.tolist(), strict=True):
        above = (energy / factor - location) / scale
        inside = np.maximum(above, 1e-300)
        density = np.exp((shape - 1.0) * np.log(inside) - inside - math.lgamma(shape)) / (scale * factor)
        total += weight * np.where(above > 0.0, density, 0.0)
    with np.errstate(divide="ignore"):
        return np.log(total)


def _of_measured(
    sensor: Sensor, energy: NDArray[np.float64], factors: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return L by the shares of measured energies of both kinds in bins."""
    kinds = [np.outer(measured_of(sensor, kind), factors) for kind in (False, True)]
    of_each = [np.broadcast_to(weights, values.shape) for values in kinds]
    together = np.concatenate([values.ravel() for values in kinds])
    edges = np.unique(np.quantile(together, np.arange(1, BINS) / BINS))
    shares = []
    for values, weight in zip(kinds, of_each, strict=True):
        counts = np.bincount(
            np.searchsorted(edges, values.ravel(), side="right"), weight.ravel(), edges.size + 1
        )
        shares.append((counts + 0.5) / (counts + 0.5).sum())
    ratio = np.log(shares[1] / shares[0])
    return np.asarray(ratio[np.searchsorted(edges, energy, side="right")])
