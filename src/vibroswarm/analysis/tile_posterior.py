"""Compute the exact posterior of the number of vibrating tiles, if each reading depends on one tile only.

| name | symbol | equation |
|---|---|---|
| likelihood ratio of tile t | L_t | product over its samples of P(reading, vibrating) / P(reading, still) |
| weight of k vibrating tiles | e_k | sum over all sets of k tiles of the product of their L_t |
| posterior | P(k) | pi_k e_k / C(N, k), over its sum; pi_k the prior, each set of k tiles as likely as any other |

e_k comes from the Poisson-binomial recursion with p_t = L_t / (1 + L_t), since prod (1 - p_t + p_t z) is
sum e_k z^k over prod (1 + L_t).
"""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, gammaln, logsumexp

from vibroswarm.errors import InputError
from vibroswarm.observation.energy_model import error_rates, gamma_of
from vibroswarm.posterior.boundary_side import needs_chains
from vibroswarm.result import Result
from vibroswarm.scenario.fields import Sensor

PriorName = Literal["tiles", "counts", "mirror"]
Prior = PriorName | ArrayLike
Values = NDArray[np.float64]

_BLOCK: Final = 4_000_000
"""Numbers in memory at once."""
_SMALL: Final = 1e-290
"""Sums below this may suffer from underflow and are recomputed in logarithms."""


def log_ratios(result: Result, energies: bool = False) -> Values:
    """Compute ln P(reading, vibrating) / P(reading, still) of each sample, shape (samples,).

    Raises:
        InputError: readings that depend on more than the tile below have no such ratio.
    """
    sensor = result.scenario.sensor
    if needs_chains(sensor):
        raise InputError(
            "where edges are felt, or tiles or robots differ, a reading does not depend on the tile below alone",
            field="sensor",
        )
    if energies:
        return _log_density_ratio(result.observations["energy"], sensor)
    a, b = error_rates(sensor)
    with np.errstate(divide="ignore"):
        of_one, of_zero = np.log([1.0 - b, a]), np.log([b, 1.0 - a])
    # A reading that only one kind of tile gives settles it: as good as certain, and still a number.
    of_bit = np.array([np.clip(of_zero[0], -700, 0) - np.clip(of_zero[1], -700, 0)])
    of_bit = np.append(of_bit, np.clip(of_one[0], -700, 0) - np.clip(of_one[1], -700, 0))
    return np.asarray(of_bit[result.observations["observation"].to_numpy()])


def _log_density_ratio(energy: pl.Series, sensor: Sensor) -> Values:
    """Compute the log ratio of the energy densities on vibrating and still tiles for each sample."""
    from scipy import stats

    if sensor.model != "gamma":
        raise InputError(
            "energies drawn from measured ones have no density; leave energies out", field="energies"
        )
    if energy.null_count():
        raise InputError(
            "this result holds none; simulate with energies, or leave them out", field="energies"
        )
    read = energy.cast(pl.Float64).to_numpy()
    densities = [
        stats.gamma.logpdf(read, shape, loc=location, scale=scale)
        for shape, scale, location in (gamma_of(sensor, kind) for kind in (True, False))
    ]
    return np.asarray(np.clip(densities[0], -700, None) - np.clip(densities[1], -700, None))


def log_prior(prior: Prior, tiles: int) -> Values:
    """Compute ln pi_k, shape (tiles + 1,).

    Raises:
        InputError: a prior of another name, or weights that are negative, all 0, or not tiles + 1.
    """
    if isinstance(prior, str):
        if prior == "tiles":
            return np.asarray(_log_choose(tiles) - tiles * math.log(2.0))
        if prior == "counts":
            return np.full(tiles + 1, -math.log(tiles + 1.0))
        raise InputError(
            f"'{prior}' is not a prior; tiles, counts, mirror or {tiles + 1} numbers", field="prior"
        )
    weights = np.asarray(prior, dtype=np.float64).ravel()
    if weights.size != tiles + 1 or not (weights >= 0).all() or not 0 < weights.sum() < np.inf:
        raise InputError(
            f"give a weight of at least 0 for each number of vibrating tiles from 0 to {tiles}", field="prior"
        )
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(weights / weights.sum()), dtype=np.float64)


def mirrored(vibrating: int, tiles: int, boundary: float) -> Values:
    """Return weights of 1 for a number of vibrating tiles and its mirror across the boundary, else 0, (tiles + 1,).

    The mirror, 2xN - k, is rounded to a possible whole number on the other side of the boundary. A number on the
    boundary has no mirror."""
    weights, on = np.zeros(tiles + 1), boundary * tiles
    weights[vibrating] = 1.0
    if vibrating > on + 1e-9:
        mirror = min(round(2.0 * on - vibrating), math.ceil(on - 1e-9) - 1)
    elif vibrating < on - 1e-9:
        mirror = max(round(2.0 * on - vibrating), math.floor(on + 1e-9) + 1)
    else:
        return weights
    weights[min(max(mirror, 0), tiles)] = 1.0
    return weights


def _log_choose(n: int) -> Values:
    k = np.arange(n + 1)
    return np.asarray(gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0), dtype=np.float64)


def count_weights(log_likelihood_ratios: Values) -> Values:
    """Compute e_k up to a constant of each row, (N + 1, rows), from ln L_t, (rows, N), by recursion over tiles."""
    vibrates, still = expit(log_likelihood_ratios.T), expit(-log_likelihood_ratios.T)
    weights = np.zeros((vibrates.shape[0] + 1, vibrates.shape[1]))
    weights[0] = 1.0
    for t in range(vibrates.shape[0]):
        weights[1 : t + 2] = weights[1 : t + 2] * still[t] + weights[: t + 1] * vibrates[t]
        weights[0] *= still[t]
    return weights


def log_count_weights(log_likelihood_ratios: Values) -> Values:
    """Compute ``count_weights`` in logarithms, without underflow; ten times slower."""
    vibrates, still = (
        -np.logaddexp(0.0, -log_likelihood_ratios.T),
        -np.logaddexp(0.0, log_likelihood_ratios.T),
    )
    weights = np.full((vibrates.shape[0] + 1, vibrates.shape[1]), -np.inf)
    weights[0] = 0.0
    for t in range(vibrates.shape[0]):
        weights[1 : t + 2] = np.logaddexp(weights[1 : t + 2] + still[t], weights[: t + 1] + vibrates[t])
        weights[0] += still[t]
    return weights


def posterior_of_counts(log_likelihood_ratios: Values, log_of_prior: Values) -> Values:
    """Compute P(k) for each row of ln L_t, from (rows, N) to (rows, N + 1)."""
    rows, tiles = log_likelihood_ratios.shape
    of_set = log_of_prior - _log_choose(tiles)
    of_set -= of_set.max()
    at_once = max(1, _BLOCK // (tiles + 1))
    parts = [np.empty((0, tiles + 1))]
    for first in range(0, rows, at_once):
        ratios = log_likelihood_ratios[first : first + at_once]
        joint = count_weights(ratios) * np.exp(of_set)[:, None]  # pi_k e_k / C(N, k)
        total = joint.sum(axis=0)
        small = total < _SMALL
        joint /= np.where(small, 1.0, total)
        if small.any():
            logs = log_count_weights(ratios[small]) + of_set[:, None]
            joint[:, small] = np.exp(logs - logsumexp(logs, axis=0))
        parts.append(joint.T)
    return np.concatenate(parts)


def sides_of(log_likelihood_ratios: Values, log_of_prior: Values, boundary: float) -> tuple[Values, Values]:
    """Compute P(k > x N) and P(k < x N) for each row of ln L_t, (rows,) each; the rest is P(k = x N)."""
    tiles = log_likelihood_ratios.shape[1]
    k = np.arange(tiles + 1)
    posterior = posterior_of_counts(log_likelihood_ratios, log_of_prior)
    above, below = k > boundary * tiles + 1e-9, k < boundary * tiles - 1e-9
    return posterior[:, above].sum(axis=1), posterior[:, below].sum(axis=1)
