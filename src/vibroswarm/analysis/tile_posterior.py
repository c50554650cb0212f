"""Compute the exact posterior of the number of vibrating tiles, if each reading depends on one tile only.

| name | symbol | equation |
|---|---|---|
| number of tiles | N | - |
| likelihood ratio of tile t | L_t | product over its samples of P(reading given vibrating) / P(reading given still) |
| weight of k vibrating tiles | e_k | sum over all sets of k tiles of the product of their L_t |
| prior | pi_k | of k vibrating tiles; each set of k tiles has the same probability |
| posterior | P(k) | pi_k e_k / C(N, k), divided by the sum over k |

With p_t = L_t / (1 + L_t), prod_t (1 - p_t + p_t z) = sum_k e_k z^k / prod_t (1 + L_t). So e_k is, up to a constant,
the Poisson-binomial probability of k ones among N bits with probabilities p_t, which a recursion over tiles computes.

The functions compute many posteriors at once: a row of an array holds the L_t of all tiles at one state of knowledge,
such as one time of a run.
"""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, gammaln, logsumexp

from vibroswarm.errors import InputError
from vibroswarm.inference.replay import bits_and_energies
from vibroswarm.observation.decision_boundary import grid_of
from vibroswarm.observation.energy_model import (
    MOST_EXACT,
    claims_differ,
    factors_differ,
    log_ratios_of_bits,
    log_ratios_of_energies,
)
from vibroswarm.result import Result

PriorName = Literal["tiles", "counts", "mirror"]
Prior = PriorName | ArrayLike
Values = NDArray[np.float64]

_BLOCK: Final = 4_000_000
"""Largest number of entries, rows times (N + 1), of the arrays with which ``posterior_of_counts`` computes a block of
rows."""
_SMALL: Final = 1e-290
"""Sums below this may suffer from underflow and are recomputed in logarithms."""


def log_ratios(result: Result, energies: bool = False) -> Values:
    """Compute ln [P(reading given vibrating) / P(reading given still)] of each sample, shape (samples,).

    Samples off all tiles get a ratio too; the caller leaves them out.

    Args:
        energies: the reading is the sample's energy; by default it is the bit.
    Raises:
        InputError: readings depend on more than the tile below, or energies are missing or have no likelihood.
    """
    sensor, place = result.scenario.sensor, grid_of(result.scenario)
    if sensor.edge_reach_m is not None or sensor.edge_blur_m is not None or factors_differ(sensor):
        raise InputError(
            "where edges are felt, or tiles or robots differ, a reading does not depend on the tile below alone",
            field="sensor",
        )
    if not energies:
        return log_ratios_of_bits(
            sensor, result.observations["observation"].to_numpy(), exact=True, place=place
        )
    if claims_differ(sensor.model_copy(update={"claimed_rates": None}), place):
        raise InputError(
            f"the likelihood of '{sensor.model}' is what robots claim, and not the true law; leave energies out",
            field="energies",
        )
    _, energy = bits_and_energies(result.observations)
    if energy is None:
        raise InputError(
            "this result holds no energies; simulate with energies, or leave them out", field="energies"
        )
    return log_ratios_of_energies(sensor, energy, MOST_EXACT, place)


def log_prior(prior: Prior, tiles: int) -> Values:
    """Compute ln pi_k for k = 0 to ``tiles``, shape (tiles + 1,).

    Args:
        prior: "tiles" (each tile vibrates with probability 1/2), "counts" (all numbers have the same probability), or
            a weight for each number. "mirror" depends on the run: give the weights of ``mirrored``.
    Raises:
        InputError: another name, or weights that are negative, all 0, or not tiles + 1.
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
    """Return weights of 1 for a number of vibrating tiles and for its mirror across the boundary, else 0.

    The mirror of k is 2xN - k, rounded to a whole number on the other side of the boundary and cut off at 0 and N. A
    number on the boundary has no mirror.

    Args:
        vibrating: k. tiles: N. boundary: x, as a share of tiles.
    Returns: weights of the numbers 0 to N, (tiles + 1,).
    """
    weights, on_boundary = np.zeros(tiles + 1), boundary * tiles
    weights[vibrating] = 1.0
    if vibrating > on_boundary + 1e-9:  # the mirror is at most the largest number below the boundary
        mirror = min(round(2.0 * on_boundary - vibrating), math.ceil(on_boundary - 1e-9) - 1)
    elif vibrating < on_boundary - 1e-9:  # the mirror is at least the smallest number above the boundary
        mirror = max(round(2.0 * on_boundary - vibrating), math.floor(on_boundary + 1e-9) + 1)
    else:
        return weights
    weights[min(max(mirror, 0), tiles)] = 1.0
    return weights


def _log_choose(n: int) -> Values:
    """Compute ln C(n, k) for k = 0 to n."""
    k = np.arange(n + 1)
    return np.asarray(gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0), dtype=np.float64)


def count_weights(log_likelihood_ratios: Values) -> Values:
    """Compute the weights e_k, up to a constant factor of each row, by recursion over tiles.

    Args:
        log_likelihood_ratios: ln L_t, (rows, N).
    Returns: weights of k = 0 to N, (N + 1, rows).
    """
    vibrates, still = expit(log_likelihood_ratios.T), expit(-log_likelihood_ratios.T)
    weights = np.zeros((vibrates.shape[0] + 1, vibrates.shape[1]))
    weights[0] = 1.0
    # Of the tiles up to t, k vibrate if k of the tiles before t vibrate and t is still, or if k - 1 of them vibrate and
    # t vibrates too. weights[0] is updated last, because the line above reads its old value.
    for t in range(vibrates.shape[0]):
        weights[1 : t + 2] = weights[1 : t + 2] * still[t] + weights[: t + 1] * vibrates[t]
        weights[0] *= still[t]
    return weights


def log_count_weights(log_likelihood_ratios: Values) -> Values:
    """Compute the logarithms of the weights e_k without underflow; this is ten times slower than ``count_weights``.

    Args:
        log_likelihood_ratios: ln L_t, (rows, N).
    Returns: ln e_k up to an added constant of each row, for k = 0 to N, (N + 1, rows).
    """
    # ln p_t and ln (1 - p_t) of each tile. The recursion is that of ``count_weights``, with sums in place of products.
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
    """Compute the posterior P(k) for each row of likelihood ratios.

    Args:
        log_likelihood_ratios: ln L_t, (rows, N). log_of_prior: ln pi_k, (N + 1,).
    Returns: P(k), (rows, N + 1).
    """
    rows, tiles = log_likelihood_ratios.shape
    of_set = log_of_prior - _log_choose(tiles)  # ln [pi_k / C(N, k)], the prior of one set of k tiles
    # The largest becomes 0, so that exp does not underflow. This constant factor of all weights cancels below.
    of_set -= of_set.max()
    at_once = max(1, _BLOCK // (tiles + 1))
    parts = [np.empty((0, tiles + 1))]  # the result for 0 rows
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
    """Compute P(k > x N) and P(k < x N) for each row, (rows,) each; they add up to 1 - P(k = x N).

    Args:
        log_likelihood_ratios: ln L_t, (rows, N). log_of_prior: ln pi_k, (N + 1,). boundary: x.
    """
    tiles = log_likelihood_ratios.shape[1]
    k = np.arange(tiles + 1)
    posterior = posterior_of_counts(log_likelihood_ratios, log_of_prior)
    # A k that differs from x N by rounding alone is on the boundary.
    above, below = k > boundary * tiles + 1e-9, k < boundary * tiles - 1e-9
    return posterior[:, above].sum(axis=1), posterior[:, below].sum(axis=1)
