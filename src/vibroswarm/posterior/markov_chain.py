"""A Markov chain over floors and factors whose stationary distribution is their posterior given some samples.

| name | symbol | equation |
|---|---|---|
| state | T, l_t, l_r | the tiles, ln of the factors of tiles and of robots |
| target | - | w_k(T) prod_s P(bit_s given T, l) N(l_t) N(l_r); k(T) tiles vibrate |
| flip of a tile | - | Gibbs: with the odds of the two states |
| swap of a vibrating with a still tile | - | Metropolis |
| factor | l' | Metropolis, l' - m = rho (l - m) + sqrt(1 - rho^2) s e: the prior is left as it is (Neal 1998) |
| flip of a tile with a new factor | - | Metropolis, the factor likewise with -rho |

w_k is a weight for each number of vibrating tiles. The prior may rule out the numbers between those that it allows; the
chain has to pass through these and gives them weights of their own, and what is counted there is multiplied by 0. Each
flip also gives the probabilities of both outcomes, and both are counted (Rao-Blackwell).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel
from vibroswarm.core.rng import ALONE, POSTERIOR, uniform
from vibroswarm.posterior.likelihood import Evidence, bit_likelihood

RHOS: Final = (0.0, 0.6, 0.9, 0.97)
"""Correlations of factor steps, one chosen at random each time, since the samples' information about factors
varies."""
_NEVER: Final = -30.0
"""A flip whose log odds are below this is not made (one in 10^13)."""
_FOLD: Final = 1e-200
"""Products of probabilities below this are folded into their logarithm."""


class Target(NamedTuple):
    """The chain's target and the counted quantities; all of shape (tiles + 1,), by number of vibrating tiles."""

    log_weight: NDArray[np.float64]
    """ln w_k; -inf where the chain never goes."""
    counts: NDArray[np.float64]
    """Prior over w_k: 0 for numbers that the prior rules out."""
    above: NDArray[np.float64]
    under: NDArray[np.float64]
    """1 if the number lies on this side of the boundary, else 0."""


class State(NamedTuple):
    """State of a chain, changed in place; for several chains, each array has a leading chain axis."""

    tiles: NDArray[np.uint8]
    """(tiles,)"""
    log_tile: NDArray[np.float64]
    """(tiles + 1,), the last 0: for samples off all tiles."""
    log_robot: NDArray[np.float64]
    """(robots,)"""
    likelihood: NDArray[np.float64]
    """(samples,): of each bit so far."""
    drawn: NDArray[np.int64]
    """(1,): random numbers drawn so far, index of the next."""
    trial: NDArray[np.float64]
    other: NDArray[np.float64]
    """(samples,): scratch for proposals that may be rejected."""


class DrawAddress(NamedTuple):
    """Address of a chain's random numbers."""

    seed: int
    run: int
    chain: int


@inner
def _draw(address: DrawAddress, state: State) -> float:
    u: float = uniform(address.seed, address.run, address.chain, POSTERIOR, state.drawn[0], ALONE)
    state.drawn[0] += 1
    return u


@inner
def _normal(address: DrawAddress, state: State) -> float:
    """Return a standard normal number, by Box and Muller."""
    radius = math.sqrt(-2.0 * math.log(_draw(address, state)))
    return radius * math.cos(2.0 * math.pi * _draw(address, state))


@inner
def _log_likelihood_ratio(
    evidence: Evidence,
    samples: NDArray[np.int64],
    count: int,
    state: State,
    trial: NDArray[np.float64],
    least: float,
) -> float:
    """Return ln of the bits' likelihood in the current state over that in ``state.likelihood``; fill ``trial``.

    If it is below ``least``, return -inf and leave ``trial`` unfilled: as no likelihood exceeds 1, a partial
    product is enough to tell.
    """
    old, log_old = 1.0, 0.0
    for k in range(samples.size):
        s = samples[k]
        if s >= count:
            break
        old *= state.likelihood[s]
        if old < _FOLD:
            log_old += math.log(old)
            old = 1.0
    log_old += math.log(old)
    new, log_new = 1.0, 0.0
    limit = math.exp(min(least + log_old, 0.0))
    for k in range(samples.size):
        s = samples[k]
        if s >= count:
            break
        trial[k] = bit_likelihood(evidence, s, state.tiles, state.log_tile, state.log_robot)
        new *= trial[k]
        if new < limit:
            return -np.inf
        if new < _FOLD:
            log_new += math.log(new)
            new = 1.0
            limit = math.exp(min(least + log_old - log_new, 0.0))
    return log_new + math.log(new) - log_old


@inner
def _swap_likelihoods(
    samples: NDArray[np.int64], count: int, likelihood: NDArray[np.float64], trial: NDArray[np.float64]
) -> None:
    """Exchange current and proposed likelihoods."""
    for k in range(samples.size):
        s = samples[k]
        if s >= count:
            break
        likelihood[s], trial[k] = trial[k], likelihood[s]


@inner
def _flips(
    evidence: Evidence,
    target: Target,
    count: int,
    vibrating: int,
    address: DrawAddress,
    state: State,
    sums: NDArray[np.float64],
) -> int:
    """Sample the kind of each tile by Gibbs; return the number of vibrating tiles.

    For each tile the probabilities of both kinds are added to ``sums``, (3,): of counted numbers of vibrating tiles
    above the boundary, of those under it, and of all counted ones.
    """
    for t in range(state.tiles.size):
        then = vibrating - 1 if state.tiles[t] else vibrating + 1
        flipped = 0.0
        if target.log_weight[then] > -np.inf:
            samples = evidence.of_tile[evidence.of_first[t] : evidence.of_first[t + 1]]
            state.tiles[t] = 1 - state.tiles[t]
            prior = target.log_weight[then] - target.log_weight[vibrating]
            odds = prior + _log_likelihood_ratio(evidence, samples, count, state, state.trial, _NEVER - prior)
            flipped = 1.0 / (1.0 + math.exp(-odds)) if odds > _NEVER else 0.0
        for k, share in ((vibrating, 1.0 - flipped), (then, flipped)):
            if share > 0.0:
                counted = share * target.counts[k]
                sums[0] += counted * target.above[k]
                sums[1] += counted * target.under[k]
                sums[2] += counted
        if target.log_weight[then] > -np.inf:
            if _draw(address, state) < flipped:
                _swap_likelihoods(samples, count, state.likelihood, state.trial)
                vibrating = then
            else:
                state.tiles[t] = 1 - state.tiles[t]
    return vibrating


@inner
def _swaps(evidence: Evidence, count: int, address: DrawAddress, state: State) -> None:
    """Propose to exchange the kinds of two tiles, for half as many random pairs as there are tiles."""
    number = state.tiles.size
    for _ in range((number + 1) // 2):
        i = int(_draw(address, state) * number)
        j = int(_draw(address, state) * number)
        if state.tiles[i] == state.tiles[j]:
            continue
        first = evidence.of_tile[evidence.of_first[i] : evidence.of_first[i + 1]]
        second = evidence.of_tile[evidence.of_first[j] : evidence.of_first[j + 1]]
        state.tiles[i] = 1 - state.tiles[i]
        log_ratio = _log_likelihood_ratio(evidence, first, count, state, state.trial, -np.inf)
        _swap_likelihoods(first, count, state.likelihood, state.trial)
        state.tiles[j] = 1 - state.tiles[j]
        least = math.log(_draw(address, state)) - log_ratio
        if _log_likelihood_ratio(evidence, second, count, state, state.other, least) > least:
            _swap_likelihoods(second, count, state.likelihood, state.other)
        else:
            state.tiles[i], state.tiles[j] = 1 - state.tiles[i], 1 - state.tiles[j]
            _swap_likelihoods(first, count, state.likelihood, state.trial)


@inner
def _stepped(log_factor: float, spread: float, rho: float, address: DrawAddress, state: State) -> float:
    """Return a proposal for ln of a factor that leaves its prior invariant."""
    middle = -0.5 * spread * spread
    step = math.sqrt(1.0 - rho * rho) * spread * _normal(address, state)
    return middle + rho * (log_factor - middle) + step


@inner
def _factors(
    evidence: Evidence,
    first: NDArray[np.int64],
    of: NDArray[np.int64],
    log_factors: NDArray[np.float64],
    number: int,
    spread: float,
    count: int,
    address: DrawAddress,
    state: State,
) -> None:
    """Update ln of each of the first ``number`` factors: propose a new value, and accept or reject it."""
    for n in range(number):
        samples = of[first[n] : first[n + 1]]
        before = log_factors[n]
        rho = RHOS[int(_draw(address, state) * len(RHOS))]
        log_factors[n] = _stepped(before, spread, rho, address, state)
        least = math.log(_draw(address, state))
        if _log_likelihood_ratio(evidence, samples, count, state, state.trial, least) > least:
            _swap_likelihoods(samples, count, state.likelihood, state.trial)
        else:
            log_factors[n] = before


@inner
def _flips_anew(
    evidence: Evidence, target: Target, count: int, vibrating: int, address: DrawAddress, state: State
) -> int:
    """Propose for each tile the other kind together with a new factor; return the number of vibrating tiles.

    The steps use -rho: readings of one kind with a large factor resemble those of the other with a small one.
    """
    for t in range(state.tiles.size):
        then = vibrating - 1 if state.tiles[t] else vibrating + 1
        if target.log_weight[then] == -np.inf:
            continue
        samples = evidence.of_tile[evidence.of_first[t] : evidence.of_first[t + 1]]
        before = state.log_tile[t]
        state.tiles[t] = 1 - state.tiles[t]
        rho = -RHOS[int(_draw(address, state) * len(RHOS))]
        state.log_tile[t] = _stepped(before, evidence.tile_spread, rho, address, state)
        least = math.log(_draw(address, state)) - target.log_weight[then] + target.log_weight[vibrating]
        if _log_likelihood_ratio(evidence, samples, count, state, state.trial, least) > least:
            _swap_likelihoods(samples, count, state.likelihood, state.trial)
            vibrating = then
        else:
            state.tiles[t], state.log_tile[t] = 1 - state.tiles[t], before
    return vibrating


@inner
def _advance(
    evidence: Evidence,
    target: Target,
    known: int,
    count: int,
    sweeps: int,
    address: DrawAddress,
    state: State,
    sums: NDArray[np.float64],
) -> None:
    """Sweep one chain; see ``advance``."""
    for s in range(known, count):
        state.likelihood[s] = bit_likelihood(evidence, s, state.tiles, state.log_tile, state.log_robot)
    vibrating = 0
    for t in range(state.tiles.size):
        vibrating += state.tiles[t]
    for _ in range(sweeps):
        if evidence.tile_spread > 0.0:
            _factors(
                evidence, evidence.of_first, evidence.of_tile, state.log_tile, state.tiles.size,
                evidence.tile_spread, count, address, state,
            )  # fmt: skip
            vibrating = _flips_anew(evidence, target, count, vibrating, address, state)
        if evidence.robot_spread > 0.0:
            _factors(
                evidence, evidence.of_robot_first, evidence.of_robot, state.log_robot, state.log_robot.size,
                evidence.robot_spread, count, address, state,
            )  # fmt: skip
        _swaps(evidence, count, address, state)
        vibrating = _flips(evidence, target, count, vibrating, address, state, sums)


@inner
def _log_choose(n: int, k: int) -> float:
    return math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0)


@inner
def _begin(
    target: Target, address: DrawAddress, tile_spread: float, robot_spread: float, state: State
) -> None:
    """Draw a state from the target without any samples."""
    number = state.tiles.size
    most, total = -np.inf, 0.0
    for k in range(number + 1):
        most = max(most, target.log_weight[k] + _log_choose(number, k))
    for k in range(number + 1):
        total += math.exp(target.log_weight[k] + _log_choose(number, k) - most)
    u, vibrating = _draw(address, state) * total, 0
    for k in range(number + 1):
        share = math.exp(target.log_weight[k] + _log_choose(number, k) - most)
        if share > 0.0:
            vibrating = k
            u -= share
            if u < 0.0:
                break
    left = vibrating
    for t in range(number):  # all sets of this size are equally likely
        state.tiles[t] = 1 if _draw(address, state) * (number - t) < left else 0
        left -= state.tiles[t]
        state.log_tile[t] = _stepped(0.0, tile_spread, 0.0, address, state) if tile_spread > 0.0 else 0.0
    state.log_tile[number] = 0.0
    for r in range(state.log_robot.size):
        state.log_robot[r] = _stepped(0.0, robot_spread, 0.0, address, state) if robot_spread > 0.0 else 0.0


@kernel
def begin(evidence: Evidence, target: Target, seed: int, run: int, states: State) -> None:
    """Draw each chain's state from the target without any samples."""
    for chain in range(states.tiles.shape[0]):
        address = DrawAddress(seed, run, chain)
        state = State(
            states.tiles[chain], states.log_tile[chain], states.log_robot[chain], states.likelihood[chain],
            states.drawn[chain], states.trial[chain], states.other[chain],
        )  # fmt: skip
        _begin(target, address, evidence.tile_spread, evidence.robot_spread, state)


@kernel
def advance(
    evidence: Evidence,
    target: Target,
    known: int,
    count: int,
    sweeps: int,
    seed: int,
    run: int,
    states: State,
    sums: NDArray[np.float64],
) -> None:
    """Sweep each chain, given the first ``count`` samples.

    Args:
        known: samples whose likelihoods the states already hold. states: arrays with a leading chain axis.
        sums: (chains, 3): what was counted above the boundary, under it, and in all is added.
    """
    for chain in range(states.tiles.shape[0]):
        address = DrawAddress(seed, run, chain)
        state = State(
            states.tiles[chain], states.log_tile[chain], states.log_robot[chain], states.likelihood[chain],
            states.drawn[chain], states.trial[chain], states.other[chain],
        )  # fmt: skip
        _advance(evidence, target, known, count, sweeps, address, state, sums[chain])
