"""How much a sample's energy says for a vibrating tile: the log likelihood ratio, by the law that the sensor has.

| name | symbol | unit | equation |
|---|---|---|---|
| density | f(E) | - | of the kind's Gamma law; a mean over factors of tiles and robots if these differ |
| log ratio | L | - | ln f_vibrating(E) - ln f_still(E), cut off at +- ``MOST`` |
| of measured energies | L | - | ln of shares of both kinds in a bin of E, half an energy added to each bin and kind |

Near edges a sample senses the law of one kind or the other, never a mixture, so that L is the same there. What a failed
sensor reads is a bit alone: where the bit is not that of the energy, L is what the bit says by the error rates.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.observation.energy_model import error_rates, gamma_of, measured_of, typical_factors
from vibroswarm.scenario.fields import Sensor

MOST: Final = 8.0
"""No energy says more than this."""
BINS: Final = 16
"""Bins of measured energies, of equal numbers of both kinds together."""


def log_ratios(
    sensor: Sensor, observation: NDArray[np.uint8], energy: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return L of each sample, (samples,).

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
