"""Compute the exact posterior of the numbers of tiles of each kind, if each reading depends on one tile only.

| name | symbol | equation |
|---|---|---|
| number of tiles | N | - |
| numbers of tiles | k | of each kind from 1 on; with two kinds, the number of vibrating tiles |
| likelihood ratio of tile t | L_tj | product over its samples of P(reading given kind j) / P(reading given kind 0) |
| weight of the numbers k | e_k | sum over all floors with these numbers of the product of each tile's L of its kind |
| prior | pi_k | of the numbers k; each of the M(k) floors with these numbers has the same probability |
| posterior | P(k) | pi_k e_k / M(k), divided by the sum over k |

With p_tj = L_tj / (sum over kinds), e_k is, up to a constant, the probability of the numbers k if each tile is of kind
j with the probability p_tj, independently. A recursion over tiles computes it. With two kinds M(k) = C(N, k).

The functions compute many posteriors at once: a row of an array holds the L_t of all tiles at one state of knowledge,
such as one time of a run.
"""

from __future__ import annotations

import math
from itertools import permutations
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, gammaln, log_softmax, logsumexp, softmax

from vibroswarm.errors import InputError
from vibroswarm.inference.replay import classes_and_values
from vibroswarm.observation.decision_boundary import grid_of
from vibroswarm.observation.energy_model import (
    MOST_EXACT,
    claims_differ,
    factors_differ,
    log_ratios_of_bits,
    log_ratios_of_energies,
    rates,
)
from vibroswarm.result import Result

Prior = Literal["tiles", "counts", "mirror"] | ArrayLike
Values = NDArray[np.float64]

_BLOCK: Final = 4_000_000
"""Largest number of entries, rows times (N + 1), of the arrays with which ``posterior_of_counts`` computes a block of
rows."""
MOST_NUMBERS: Final = 200_000
"""Largest (N + 1)^(kinds - 1) of which a posterior is computed."""
_SMALL: Final = 1e-290
"""Sums below this may suffer from underflow and are recomputed in logarithms."""


def log_ratios(result: Result, energies: bool = False) -> Values:
    """Compute ln [P(reading given vibrating) / P(reading given still)] of each sample, shape (samples,).

    With several kinds or classes it is that of each kind from 1 on against kind 0, (samples, kinds - 1). Samples off
    all tiles get a ratio too; the caller leaves them out.

    Args:
        energies: the reading is the sample's energy; by default it is the bit, or class.
    Raises:
        InputError: readings depend on more than the tile below, or energies are missing or have no likelihood.
    """
    sensor, place = result.scenario.sensor, grid_of(result.scenario)
    if sensor.edge_reach_m is not None or sensor.edge_blur_m is not None or factors_differ(sensor):
        raise InputError(
            "where edges are felt, or tiles or robots differ, a reading does not depend on the tile below alone",
            field="sensor",
        )
    if max(sensor.kinds, sensor.readings) > 2:
        if energies:
            raise InputError(
                "of several kinds only classes are weighed; leave energies out", field="energies"
            )
        with np.errstate(divide="ignore"):
            logs = np.maximum(np.log(rates(sensor, place)), -MOST_EXACT)
        return np.asarray((logs[1:] - logs[0]).T[result.observations["observation"].to_numpy()])
    if not energies:
        return log_ratios_of_bits(
            sensor, result.observations["observation"].to_numpy(), exact=True, place=place
        )
    if claims_differ(sensor.model_copy(update={"claimed_rates": None}), place):
        raise InputError(
            f"the likelihood of '{sensor.model}' is what robots claim, and not the true law; leave energies out",
            field="energies",
        )
    _, energy = classes_and_values(result.observations)
    if energy is None:
        raise InputError(
            "this result holds no energies; simulate with energies, or leave them out", field="energies"
        )
    return log_ratios_of_energies(sensor, energy, MOST_EXACT, place)


def log_prior(prior: Prior, tiles: int, kinds: int = 2) -> Values:
    """Compute ln pi_k for all numbers k of tiles, (tiles + 1,), with an axis for each kind from 1 on.

    Args:
        prior: "tiles" (each tile is of each kind with the same probability), "counts" (all numbers have the same
            probability), or a weight for each number. "mirror" depends on the run: give the weights of ``mirrored``, or
            of ``permuted``.
    Raises:
        InputError: another name, or weights that are negative, all 0, or not tiles + 1 along each axis; too many
            numbers.
    """
    shape = (tiles + 1,) * (kinds - 1)
    if math.prod(shape) > MOST_NUMBERS:
        raise InputError(f"{tiles} tiles of {kinds} kinds have too many numbers of each", field="floor")
    floors = _log_floors(tiles, kinds)
    if isinstance(prior, str):
        if prior == "tiles":
            return np.asarray(floors - tiles * math.log(kinds))
        if prior == "counts":
            return np.where(np.isfinite(floors), -math.log(np.isfinite(floors).sum()), -np.inf)
        raise InputError(
            f"'{prior}' is not a prior; tiles, counts, mirror or {tiles + 1} numbers", field="prior"
        )
    weights = np.asarray(prior, dtype=np.float64)
    weights = weights.ravel() if kinds == 2 else weights
    if weights.shape != shape or not (weights >= 0).all() or not 0 < weights.sum() < np.inf:
        raise InputError(
            f"give a weight of at least 0 for each number of vibrating tiles from 0 to {tiles}"
            if kinds == 2
            else f"give weights of at least 0, {tiles + 1} along an axis for each kind from 1 on",
            field="prior",
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


def permuted(numbers: ArrayLike) -> Values:
    """Return weights of 1 where the kinds have these numbers of tiles in any order, else 0: ``mirrored`` for kinds.

    Args:
        numbers: of tiles of each kind, (kinds,).
    Returns: (tiles + 1,) along an axis for each kind from 1 on.
    """
    given = np.asarray(numbers, dtype=np.int64)
    weights = np.zeros((int(given.sum()) + 1,) * (given.size - 1))
    for order in orders_of(given):
        weights[order[1:]] = 1.0
    return weights


def orders_of(numbers: ArrayLike) -> list[tuple[int, ...]]:
    """Return the different orders of some numbers, the given one first."""
    return list(dict.fromkeys(permutations(np.asarray(numbers).tolist())))


def _numbers(tiles: int, kinds: int) -> NDArray[np.int64]:
    """Return the numbers of tiles of each kind at each place of an array of weights, (kinds, tiles + 1, ...).

    Where more than all tiles are of the kinds from 1 on, that of kind 0 is negative.
    """
    others = np.indices((tiles + 1,) * (kinds - 1))
    return np.concatenate([tiles - others.sum(axis=0, keepdims=True), others])


def _log_floors(tiles: int, kinds: int) -> Values:
    """Compute ln M(k), -inf where there is no such floor."""
    numbers = _numbers(tiles, kinds).astype(np.float64)
    total = np.full(numbers.shape[1:], gammaln(tiles + 1.0))
    for of_kind in numbers[::-1]:
        total -= gammaln(np.maximum(of_kind, 0.0) + 1.0)
    return np.where(numbers[0] >= 0.0, total, -np.inf)


def count_weights(shares: Values, *, in_logs: bool = False) -> Values:
    """Compute the weights e, up to a constant factor of each row, by recursion over tiles.

    Args:
        shares: p_tj, or their logarithms if ``in_logs``, (kinds, N, rows). in_logs: without underflow, ten times
            slower.
    Returns: weights, or their logarithms, (N + 1, ..., rows): an axis for the number of tiles of each kind from 1 on.
    """
    kinds, tiles, rows = shares.shape
    times, plus, nothing = (np.add, np.logaddexp, -np.inf) if in_logs else (np.multiply, np.add, 0.0)
    weights = np.full((*(tiles + 1,) * (kinds - 1), rows), nothing)
    weights[(0,) * (kinds - 1)] = 0.0 if in_logs else 1.0
    # Tile t is of kind 0 and leaves the numbers of the tiles before it, or is of another kind, of which one more is.
    for t in range(tiles):
        within = (slice(t + 2),) * (kinds - 1)
        before = weights[within]
        after = times(before, shares[0, t])
        for kind in range(1, kinds):
            one_more = _along(kind - 1, kinds, slice(1, None))
            one_fewer = _along(kind - 1, kinds, slice(None, -1))
            added = times(before[one_fewer], shares[kind, t])
            after[one_more] = plus(after[one_more], added)
        weights[within] = after
    return weights


def _along(axis: int, axes: int, part: slice) -> tuple[slice, ...]:
    """Return the index of a part of an array along one of its axes."""
    return tuple(part if each == axis else slice(None) for each in range(axes))


def _shares(ratios: Values, *, in_logs: bool) -> Values:
    """Return p_tj of likelihood ratios, (rows, N) or (rows, N, kinds - 1): (kinds, N, rows), or their logarithms."""
    if ratios.ndim == 2 and in_logs:
        return np.stack([-np.logaddexp(0.0, ratios.T), -np.logaddexp(0.0, -ratios.T)])
    if ratios.ndim == 2:
        return np.stack([expit(-ratios.T), expit(ratios.T)])
    of_all = np.concatenate([np.zeros((*ratios.shape[:2], 1)), ratios], axis=2)
    return np.asarray((log_softmax if in_logs else softmax)(of_all, axis=2).transpose(2, 1, 0))


def posterior_of_counts(log_likelihood_ratios: Values, log_of_prior: Values) -> Values:
    """Compute the posterior P(k) for each row of likelihood ratios.

    Args:
        log_likelihood_ratios: ln L_t, (rows, N), or ln L_tj of the kinds from 1 on, (rows, N, kinds - 1).
        log_of_prior: ln pi_k, as of ``log_prior``.
    Returns: P(k), (rows, N + 1), with an axis for each kind from 1 on.
    """
    rows, tiles = log_likelihood_ratios.shape[:2]
    axes = tuple(range(log_of_prior.ndim))
    with np.errstate(invalid="ignore"):  # where there are no such floors, -inf - -inf is nan
        of_floor = np.nan_to_num(
            log_of_prior - _log_floors(tiles, log_of_prior.ndim + 1), nan=-np.inf, neginf=-np.inf
        )
    # ln [pi_k / M(k)], the prior of one floor. The largest becomes 0, so that exp does not underflow. This constant
    # factor of all weights cancels below.
    of_floor -= of_floor.max()
    at_once = max(1, _BLOCK // log_of_prior.size)
    parts = [np.empty((0, *log_of_prior.shape))]  # the result for 0 rows
    for first in range(0, rows, at_once):
        ratios = log_likelihood_ratios[first : first + at_once]
        joint = count_weights(_shares(ratios, in_logs=False)) * np.exp(of_floor)[..., None]  # pi_k e_k / M(k)
        total = joint.sum(axis=axes)
        small = total < _SMALL
        joint /= np.where(small, 1.0, total)
        if small.any():
            logs = count_weights(_shares(ratios[small], in_logs=True), in_logs=True) + of_floor[..., None]
            joint[..., small] = np.exp(logs - logsumexp(logs, axis=axes))
        parts.append(np.moveaxis(joint, -1, 0))
    return np.concatenate(parts)


def most_common_of(log_likelihood_ratios: Values, log_of_prior: Values) -> Values:
    """Compute for each row the probability that each kind has more tiles than any other, (kinds, rows).

    They add up to 1 minus the probability of a tie.

    Args:
        log_likelihood_ratios: ln L_tj, (rows, N, kinds - 1). log_of_prior: ln pi_k, as of ``log_prior``.
    """
    posterior = posterior_of_counts(log_likelihood_ratios, log_of_prior)
    numbers = _numbers(log_likelihood_ratios.shape[1], log_of_prior.ndim + 1)
    is_most = numbers == numbers.max(axis=0)
    alone = is_most & (is_most.sum(axis=0) == 1)
    return np.stack([posterior[:, of_kind].sum(axis=1) for of_kind in alone])


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
