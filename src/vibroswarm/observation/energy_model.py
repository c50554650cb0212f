"""Distributions of energies on still and on vibrating tiles: quantiles, error rates, log likelihood ratios.

| name | symbol | unit | equation |
|---|---|---|---|
| share below | F(theta_E) | - | probability of an energy of at most theta_E on a tile of one kind |
| false positive, false negative | - | - | 1 - F_still(theta_E), F_vibrating(theta_E) |
| factor | c | - | E = c G, with G of the kind's distribution; so E > theta_E if G > theta_E / c; log-normal of mean 1 |
| density | f(E) | - | density of the kind's Gamma law; a mean over factors of tiles and robots if these differ |
| log ratio | L | - | ln f_vibrating(E) - ln f_still(E), limited to +- ``MOST`` |
| log ratio, measured energies | L | - | ln of the ratio of the kinds' shares in a bin of E, 0.5 added to each count |

A sensor either has Gamma laws or draws from measured energies (``sensor.model = "energies"``). Near edges a sample has
an energy of one kind or the other, never a mixture, so L is the same there. A faulty sensor changes only the bit. If
a fault has changed the bit, so that it contradicts the energy, L is the log ratio of the bit, by the error rates.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.scenario.fields import Sensor


def share_below(sensor: Sensor, vibrating: bool) -> float:
    """Return F(theta_E), the probability of the bit 0, on a vibrating tile (``vibrating`` true) or on a still tile."""
    if sensor.model == "energies":
        energies = np.sort(measured_of(sensor, vibrating))
        return float(np.searchsorted(energies, sensor.rms_threshold, side="right")) / energies.size
    return _gamma_below(sensor.rms_threshold, *gamma_of(sensor, vibrating))


@lru_cache(maxsize=64)
def _gamma_below(threshold: float, shape: float, scale: float, location: float) -> float:
    """Return the probability that a shifted Gamma law gives at most ``threshold``."""
    from scipy.special import gammainc

    return float(gammainc(shape, max(threshold - location, 0.0) / scale))


def error_rates(sensor: Sensor) -> tuple[float, float]:
    """Return the probabilities that a still tile reads as vibrating, and that a vibrating tile reads as still.

    If tiles or robots differ, the rates are means over the distributions of their factors. They do not include the
    effect of edges, which depends on the floor (``decision_boundary.sensed_shares_on``).
    """
    if sensor.tile_spread is None and sensor.robot_spread is None:
        return 1.0 - share_below(sensor, False), share_below(sensor, True)
    factors, weights = typical_factors(sensor)
    still, vibrating = (float(weights @ shares_below(sensor, kind, factors)) for kind in (False, True))
    return 1.0 - still, vibrating


def shares_below(sensor: Sensor, vibrating: bool, factors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return F(theta_E), the probability of the bit 0, for energies that are multiplied by each of these factors.

    Args:
        vibrating: whether on vibrating tiles, else on still ones. factors: above 0, of any shape; the result has the
            same shape.
    """
    thresholds = sensor.rms_threshold / factors  # c G <= theta_E is G <= theta_E / c
    if sensor.model == "energies":
        energies = np.sort(measured_of(sensor, vibrating))
        return np.asarray(np.searchsorted(energies, thresholds, side="right") / energies.size)
    from scipy.special import gammainc

    shape, scale, location = gamma_of(sensor, vibrating)
    return np.asarray(gammainc(shape, np.maximum(thresholds - location, 0.0) / scale))


def energy_of(sensor: Sensor, vibrating: bool, u: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the energies at the quantiles ``u`` (in (0, 1)) on a vibrating or a still tile, in the shape of ``u``."""
    if sensor.model == "energies":
        energies = np.sort(measured_of(sensor, vibrating))
        # Of n sorted energies, the quantile u is the one with index floor(u n).
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
    """Return the energy of each sample, (samples,): the quantile, at its uniform number, of its tile kind's energies.

    Args:
        vibrating: (samples,): whether the sensed tile vibrates. u: (samples,): uniform numbers in (0, 1). factors:
            (samples,): factors of the energies; None: all 1.
    """
    energy = np.empty(u.size, dtype=np.float32)
    for kind in (False, True):
        energy[vibrating == kind] = energy_of(sensor, kind, u[vibrating == kind])
    return energy if factors is None else (energy * factors).astype(np.float32)


def gamma_of(sensor: Sensor, vibrating: bool) -> tuple[float, float, float]:
    """Return shape, scale and location of the Gamma law of vibrating or of still tiles."""
    if vibrating:
        return sensor.vibrating_shape, sensor.vibrating_scale, sensor.vibrating_location
    return sensor.still_shape, sensor.still_scale, sensor.still_location


def measured_of(sensor: Sensor, vibrating: bool) -> NDArray[np.float64]:
    """Return the measured energies of vibrating or of still tiles, for a sensor that draws from measured energies."""
    values = sensor.vibrating_energies if vibrating else sensor.still_energies
    assert values is not None, "checked by Scenario"
    return np.asarray(values, dtype=np.float64)


NODES = 33
"""Number of nodes of the Gauss-Hermite quadrature over factors."""


def typical_factors(sensor: Sensor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return factors and weights, (NODES,) each, for means over all tiles and robots (Gauss-Hermite quadrature).

    The mean of a function of the factor is the sum of weight times the function's value at the factor. A factor is the
    product of a tile's and a robot's own, which have mean 1.
    """
    # The logarithms of a tile's and a robot's factor are normal, so their variances add up.
    spread = math.hypot(sensor.tile_spread or 0.0, sensor.robot_spread or 0.0)
    nodes, weights = _nodes()
    # The term -spread^2 / 2 gives the log-normal distribution mean 1. The weights are scaled to a sum of 1.
    return np.exp(spread * nodes - 0.5 * spread**2), weights / weights.sum()


@cache
def _nodes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return nodes and weights of Gauss-Hermite quadrature for a standard normal weight function, (NODES,) each."""
    return np.polynomial.hermite_e.hermegauss(NODES)


MOST: Final = 8.0
"""Limit on the absolute value of L, so that no single energy can decide alone."""
BINS: Final = 16
"""Number of bins of measured energies. Each bin holds the same number of energies, counting both kinds together; if
tiles or robots differ, the same number of products of an energy and a typical factor, regardless of their weights."""


def log_ratios(
    sensor: Sensor, observation: NDArray[np.uint8], energy: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the log ratio L of each sample, (samples,): L of its energy or, if a fault changed the bit, L of its bit.

    Args:
        observation, energy: (samples,): bit and energy of each sample. The bit contradicts the energy (it is not 1
            exactly for energies above the threshold) only if a fault changed it.
    """
    of_energy = _of_energies(sensor, energy.astype(np.float64))
    # Error rates of exactly 0 or 1 would give infinite ratios.
    positive, negative = (min(max(rate, 1e-6), 1.0 - 1e-6) for rate in error_rates(sensor))
    of_bit = np.where(
        observation == 1, math.log((1.0 - negative) / positive), math.log(negative / (1.0 - positive))
    )
    # The bit that this energy gives without a fault, compared in the precision of the table.
    without_fault = (energy > np.float32(sensor.rms_threshold)).astype(np.uint8)
    return np.clip(np.where(without_fault == observation, of_energy, of_bit), -MOST, MOST)


def _of_energies(sensor: Sensor, energy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return L of each energy; infinite values become +-``MOST``. The caller limits finite values.

    L is 0 for an energy whose density is 0 on both kinds of tile.
    """
    factors, weights = np.ones(1), np.ones(1)  # a single factor, 1, if tiles and robots do not differ
    if sensor.tile_spread is not None or sensor.robot_spread is not None:
        factors, weights = typical_factors(sensor)
    if sensor.model == "energies":
        return _of_measured(sensor, energy, factors, weights)
    still, vibrating = (
        _log_density(gamma_of(sensor, kind), energy, factors, weights) for kind in (False, True)
    )
    with np.errstate(invalid="ignore"):  # where both densities are 0, -inf - -inf is nan
        return np.nan_to_num(vibrating - still, nan=0.0, posinf=MOST, neginf=-MOST)


def _log_density(
    law: tuple[float, float, float],
    energy: NDArray[np.float64],
    factors: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return ln of the density of energies, in the shape of ``energy``; -inf where the density is 0.

    Args:
        law: shape, scale and location of the Gamma law. factors, weights: the density is the mean, with these weights,
            of the densities of energies with each of these factors.
    """
    shape, scale, location = law
    total = np.zeros(energy.shape)
    for factor, weight in zip(factors.tolist(), weights.tolist(), strict=True):
        # The energy is factor * G, so its density is that of the shifted Gamma law at energy / factor, over factor.
        above = (energy / factor - location) / scale
        # So that the logarithm exists; where above <= 0, the density is set to 0.
        inside = np.maximum(above, 1e-300)
        density = np.exp((shape - 1.0) * np.log(inside) - inside - math.lgamma(shape)) / (scale * factor)
        total += weight * np.where(above > 0.0, density, 0.0)
    with np.errstate(divide="ignore"):  # ln 0 is -inf
        return np.log(total)


def _of_measured(
    sensor: Sensor, energy: NDArray[np.float64], factors: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return L of energies from a histogram of the measured energies, in the shape of ``energy``.

    L of a bin is the logarithm of the share of the vibrating tiles' energies in the bin over that of the still tiles'.

    Args:
        factors, weights: (factors,): each measured energy is multiplied by each factor, and the product is counted with
            the factor's weight.
    """
    # Products of energies and factors, for still and for vibrating tiles, (energies, factors) each.
    kinds = [np.outer(measured_of(sensor, kind), factors) for kind in (False, True)]
    weights_of_kinds = [np.broadcast_to(weights, values.shape) for values in kinds]
    together = np.concatenate([values.ravel() for values in kinds])
    # The bins' edges are quantiles of the products without their weights; only the counts below are weighted. If many
    # products are equal, some edges coincide; each is used once, so there are fewer bins.
    edges = np.unique(np.quantile(together, np.arange(1, BINS) / BINS))
    shares = []
    for values, weight in zip(kinds, weights_of_kinds, strict=True):
        counts = np.bincount(
            np.searchsorted(edges, values.ravel(), side="right"),
            weights=weight.ravel(),
            minlength=edges.size + 1,
        )
        shares.append((counts + 0.5) / (counts + 0.5).sum())  # 0.5: an empty bin must not have the share 0
    ratio = np.log(shares[1] / shares[0])  # L of each bin: vibrating over still
    return np.asarray(ratio[np.searchsorted(edges, energy, side="right")])
