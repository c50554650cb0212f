"""A Markov chain over floors and factors whose stationary distribution is their posterior given some samples.

| name | symbol | equation |
|---|---|---|
| state | T, l_t, l_r | the tiles, ln of the factors of tiles and of robots |
| target | - | w_k(T) prod_s P(bit_s given T, l) N(l_t) N(l_r), where k(T) is the number of tiles that vibrate |
| flip of a tile | - | Gibbs: the tile's kind is drawn anew, by the odds of the two states |
| swap of a vibrating with a still tile | - | Metropolis |
| factor | l' | Metropolis, l' - m = rho (l - m) + sqrt(1 - rho^2) s e, which leaves the prior invariant (Neal 1998) |
| flip of a tile with a new factor | - | Metropolis; the factor as above, with -rho |

w_k is a weight for each number of vibrating tiles. The prior may rule out some numbers between numbers that it allows.
The chain must pass through these, so they have weights too, but its states there count 0 in the results. At each flip
the probabilities of both outcomes are known; both are counted with these, in place of the outcome that is drawn
(Rao-Blackwell).

Arguments of the functions: ``evidence``: the samples of the run; ``target``: the weights; ``address``: where the
chain's random numbers come from; ``state``: the chain's state, changed in place.

A "proposal" changes the state first. ``_log_likelihood_ratio`` then computes the likelihoods of the affected samples in
the new state, and ``_swap_likelihoods`` stores them if the proposal is accepted. ``count`` is always the number of
samples that are known: of a list of samples, which is in order of time, only those with an index below ``count`` are
used.
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
"""Correlations of a factor with its proposal. One is drawn for each proposal, as the best one depends on how much the
samples say about the factor."""
_NEVER: Final = -30.0
"""Log odds below which a flip is taken to be impossible; its probability is below 10^-13."""
_FOLD: Final = 1e-200
"""A product of probabilities that falls below this is replaced by its logarithm, so that it cannot underflow."""


class Target(NamedTuple):
    """The chain's target and the counted quantities; all of shape (tiles + 1,), by number of vibrating tiles."""

    log_weight: NDArray[np.float64]
    """ln of the weight w_k of a single floor with k vibrating tiles; -inf for numbers that the chain never visits."""
    counts: NDArray[np.float64]
    """1 if the prior allows this number of vibrating tiles, else 0."""
    above: NDArray[np.float64]
    """1 if the number of vibrating tiles lies above the boundary, else 0."""
    under: NDArray[np.float64]
    """1 if the number of vibrating tiles lies under the boundary, else 0."""


class State(NamedTuple):
    """State of a chain, changed in place; for several chains, each array has a leading chain axis."""

    tiles: NDArray[np.uint8]
    """(tiles,): 1 vibrating, 0 still."""
    log_tile: NDArray[np.float64]
    """(tiles + 1,): ln of the factors of tiles; the last entry is 0 and serves for samples on no tile."""
    log_robot: NDArray[np.float64]
    """(robots,): ln of the factors of robots."""
    likelihood: NDArray[np.float64]
    """(samples,): likelihood of each known sample's bit in this state."""
    drawn: NDArray[np.int64]
    """(1,): number of random numbers drawn so far, which is the index of the next one."""
    trial: NDArray[np.float64]
    """(samples,): scratch for the likelihoods of a proposal that may be rejected."""
    other: NDArray[np.float64]
    """(samples,): scratch for the likelihoods of a second tile's flip in the same proposal."""


class DrawAddress(NamedTuple):
    """Address of a chain's random numbers."""

    seed: int
    """Seed of the run."""
    run: int
    """Number of the run."""
    chain: int
    """Number of the chain."""


@inner
def _draw(address: DrawAddress, state: State) -> float:
    """Return the chain's next uniform number in (0, 1), so that it has a logarithm; advance ``state.drawn``."""
    u: float = uniform(address.seed, address.run, address.chain, POSTERIOR, state.drawn[0], ALONE)
    state.drawn[0] += 1
    return u


@inner
def _normal(address: DrawAddress, state: State) -> float:
    """Return a standard normal number by Box and Muller; it uses two of the chain's uniform numbers."""
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
    """Return ln(new / old): the likelihood of some samples in the changed state over their stored likelihood.

    The stored likelihoods are those in ``state.likelihood``, from before the state was changed by a proposal.

    Args:
        samples: the samples whose likelihood may have changed. count: number of known samples.
        trial: at least as long as ``samples``; their likelihoods in the changed state are written to its beginning.
        least: the smallest result that matters. If the result would be below it, the function may return -inf early,
            with ``trial`` incomplete: as no likelihood exceeds 1, a product of some of them can show that the rest is
            in vain.
    """
    # A product is held as ``old`` and ``log_old``: its logarithm is log_old + ln old. The same for ``new``.
    old, log_old = 1.0, 0.0
    for k in range(samples.size):
        s = samples[k]
        if s >= count:  # later samples are not known yet
            break
        old *= state.likelihood[s]
        if old < _FOLD:
            log_old += math.log(old)
            old = 1.0
    log_old += math.log(old)
    new, log_new = 1.0, 0.0
    # Once the product ``new`` is below ``limit``, the ratio is certain to be below ``least``. min: exp must not
    # overflow. A limit of 1 does as well as a larger one, since ``new`` never exceeds 1.
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
    """Exchange the stored likelihoods of some samples with those that ``_log_likelihood_ratio`` wrote to ``trial``."""
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
    """Draw the kind of each tile anew, given all other tiles (Gibbs); return the new number of vibrating tiles.

    Args:
        vibrating: number of vibrating tiles before. sums: (3,): sums of probabilities of states above the boundary,
            under it, and of all states, changed. For each tile the probabilities of its two kinds are added, unless the
            prior rules out the number of vibrating tiles.
    """
    for t in range(state.tiles.size):
        # if_flipped: number of vibrating tiles if tile t is flipped
        if_flipped = vibrating - 1 if state.tiles[t] else vibrating + 1
        flipped = 0.0  # probability that the tile flips
        if target.log_weight[if_flipped] > -np.inf:
            samples = evidence.of_tile[evidence.of_first[t] : evidence.of_first[t + 1]]
            state.tiles[t] = 1 - state.tiles[t]
            prior = target.log_weight[if_flipped] - target.log_weight[vibrating]
            # odds: log odds of the flip; below _NEVER they need not be known exactly.
            odds = prior + _log_likelihood_ratio(evidence, samples, count, state, state.trial, _NEVER - prior)
            flipped = 1.0 / (1.0 + math.exp(-odds)) if odds > _NEVER else 0.0
        for k, share in ((vibrating, 1.0 - flipped), (if_flipped, flipped)):
            if share > 0.0:
                counted = share * target.counts[k]
                sums[0] += counted * target.above[k]
                sums[1] += counted * target.under[k]
                sums[2] += counted
        if target.log_weight[if_flipped] > -np.inf:
            # The tile is flipped already, for the likelihood; keep that or flip it back.
            if _draw(address, state) < flipped:
                _swap_likelihoods(samples, count, state.likelihood, state.trial)
                vibrating = if_flipped
            else:
                state.tiles[t] = 1 - state.tiles[t]
    return vibrating


@inner
def _swaps(evidence: Evidence, count: int, address: DrawAddress, state: State) -> None:
    """Propose to exchange the kinds of two random tiles, as many times as half the number of tiles (Metropolis).

    The number of vibrating tiles stays the same, so the prior does not matter.
    """
    number = state.tiles.size
    for _ in range((number + 1) // 2):
        i = int(_draw(address, state) * number)
        j = int(_draw(address, state) * number)
        if state.tiles[i] == state.tiles[j]:
            continue
        first = evidence.of_tile[evidence.of_first[i] : evidence.of_first[i + 1]]
        second = evidence.of_tile[evidence.of_first[j] : evidence.of_first[j + 1]]
        # Both tiles are flipped one after the other, as both flips may affect the same sample. The ratio of the swap is
        # the product of the two ratios.
        state.tiles[i] = 1 - state.tiles[i]
        # -inf: the first ratio is always computed in full, as the second one may make up for it.
        log_ratio = _log_likelihood_ratio(evidence, first, count, state, state.trial, -np.inf)
        _swap_likelihoods(first, count, state.likelihood, state.trial)
        state.tiles[j] = 1 - state.tiles[j]
        # The swap is accepted if the second ratio is above this.
        least = math.log(_draw(address, state)) - log_ratio
        if _log_likelihood_ratio(evidence, second, count, state, state.other, least) > least:
            _swap_likelihoods(second, count, state.likelihood, state.other)
        else:  # undo both flips
            state.tiles[i], state.tiles[j] = 1 - state.tiles[i], 1 - state.tiles[j]
            _swap_likelihoods(first, count, state.likelihood, state.trial)


@inner
def _stepped(log_factor: float, spread: float, rho: float, address: DrawAddress, state: State) -> float:
    """Return a proposed value for ln of a factor, drawn so that it leaves the factor's prior invariant.

    Args:
        log_factor: present value. spread: standard deviation of its prior, whose mean is -spread^2 / 2. rho:
            correlation of the proposal with the present value; 0: a draw from the prior.
    """
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
    """Propose a new value for ln of each factor of tiles or of robots, and accept or reject it (Metropolis).

    Args:
        first, of: ``of[first[n] : first[n + 1]]`` are the samples that factor n affects, as in ``Evidence``.
        log_factors: ln of the factors, of which the first ``number`` may change. spread: standard deviation of their
            prior.
    """
    for n in range(number):
        samples = of[first[n] : first[n + 1]]
        before = log_factors[n]
        rho = RHOS[int(_draw(address, state) * len(RHOS))]
        log_factors[n] = _stepped(before, spread, rho, address, state)
        # The proposal leaves the prior invariant: only the likelihood counts.
        least = math.log(_draw(address, state))
        if _log_likelihood_ratio(evidence, samples, count, state, state.trial, least) > least:
            _swap_likelihoods(samples, count, state.likelihood, state.trial)
        else:
            log_factors[n] = before


@inner
def _flips_anew(
    evidence: Evidence, target: Target, count: int, vibrating: int, address: DrawAddress, state: State
) -> int:
    """Propose for each tile the other kind together with a new factor; return the new number of vibrating tiles.

    The new factor is correlated with the old one by -rho, because a still tile with a large factor reads much like a
    vibrating tile with a small factor.

    Args:
        vibrating: number of vibrating tiles before.
    """
    for t in range(state.tiles.size):
        if_flipped = vibrating - 1 if state.tiles[t] else vibrating + 1
        if target.log_weight[if_flipped] == -np.inf:
            continue
        samples = evidence.of_tile[evidence.of_first[t] : evidence.of_first[t + 1]]
        before = state.log_tile[t]
        state.tiles[t] = 1 - state.tiles[t]
        rho = -RHOS[int(_draw(address, state) * len(RHOS))]
        state.log_tile[t] = _stepped(before, evidence.tile_spread, rho, address, state)
        # Accepted if ratio of likelihoods * ratio of weights > uniform number.
        least = math.log(_draw(address, state)) - target.log_weight[if_flipped] + target.log_weight[vibrating]
        if _log_likelihood_ratio(evidence, samples, count, state, state.trial, least) > least:
            _swap_likelihoods(samples, count, state.likelihood, state.trial)
            vibrating = if_flipped
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
    """Run ``sweeps`` sweeps of one chain, given the first ``count`` samples.

    The steps of a sweep are: if tiles differ, new factors of tiles, and flips of tiles with a new factor (Metropolis);
    if robots differ, new factors of robots; swaps; flips (Gibbs). Only the Gibbs flips add to ``sums``.

    Args:
        known: number of samples whose likelihoods the state already holds. state: changed.
        sums: (3,): the counted weights of states above the boundary, under it, and of all states are added.
    """
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
    """Return ln of the number of ways to choose k of n: the binomial coefficient."""
    return math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0)


@inner
def _begin(
    target: Target, address: DrawAddress, tile_spread: float, robot_spread: float, state: State
) -> None:
    """Draw a chain's first state from the target without any samples.

    Args:
        state: overwritten. tile_spread, robot_spread: standard deviations of ln of the factors; 0: all factors are 1.
    """
    number = state.tiles.size
    most, total = -np.inf, 0.0  # most: largest ln of a weight, subtracted so that exp does not overflow
    for k in range(number + 1):
        most = max(most, target.log_weight[k] + _log_choose(number, k))
    for k in range(number + 1):
        total += math.exp(target.log_weight[k] + _log_choose(number, k) - most)
    # Draw the number of vibrating tiles by its total weight over all floors that have this number.
    u, vibrating = _draw(address, state) * total, 0
    for k in range(number + 1):
        share = math.exp(target.log_weight[k] + _log_choose(number, k) - most)
        # Numbers of weight 0 are skipped: one must not be drawn even if rounding leaves u at 0 or above to the end.
        if share > 0.0:
            vibrating = k
            u -= share
            if u < 0.0:
                break
    # Draw which tiles vibrate; all sets of this size are equally probable. left: number of tiles still to be chosen.
    left = vibrating
    for t in range(number):
        state.tiles[t] = 1 if _draw(address, state) * (number - t) < left else 0
        left -= state.tiles[t]
        state.log_tile[t] = _stepped(0.0, tile_spread, 0.0, address, state) if tile_spread > 0.0 else 0.0
    state.log_tile[number] = 0.0
    for r in range(state.log_robot.size):
        state.log_robot[r] = _stepped(0.0, robot_spread, 0.0, address, state) if robot_spread > 0.0 else 0.0


@kernel
def begin(evidence: Evidence, target: Target, seed: int, run: int, states: State) -> None:
    """Draw the first state of each chain from the target without any samples.

    Args:
        evidence: only its spreads are used. seed, run: address of the random numbers. states: overwritten; its arrays
            have a leading chain axis.
    """
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
    """Run ``sweeps`` sweeps of each chain, given the first ``count`` samples.

    Args:
        known: number of samples whose likelihoods the states already hold. seed, run: address of the random numbers.
        states: changed; its arrays have a leading chain axis.
        sums: (chains, 3): the counted weights of states above the boundary, under it, and of all are added.
    """
    for chain in range(states.tiles.shape[0]):
        address = DrawAddress(seed, run, chain)
        state = State(
            states.tiles[chain], states.log_tile[chain], states.log_robot[chain], states.likelihood[chain],
            states.drawn[chain], states.trial[chain], states.other[chain],
        )  # fmt: skip
        _advance(evidence, target, known, count, sweeps, address, state, sums[chain])
