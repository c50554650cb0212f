"""The side of the boundary on which a floor's fill ratio lies, estimated by Markov chains at several times of a run.

A "sweep" of a chain redraws the kind of each tile and, if tiles or robots differ, proposes a new value of each
factor by which they multiply the energy, besides other changes (``markov_chain``). A "look" is an estimate, at one
time, of the posterior given the samples so far: P(above the boundary) and P(under it). A side is known when its
posterior is at least ``1 - alpha``, alpha being the accepted error. At each look all chains run some sweeps, starting
from their states at the last look. If a side's posterior may then have reached ``1 - alpha``, more sweeps follow, until
the posterior is clearly above or below ``1 - alpha``, or its Monte Carlo error is small. That error is the larger of
two estimates: one from the differences between chains, one from the differences between batches of sweeps. Chains start
from independent draws of the prior, so that a chain that is stuck differs from the others and increases the error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from vibroswarm.floors.floor import Floor
from vibroswarm.observation.edge_response import factors_differ
from vibroswarm.posterior.likelihood import Evidence, evidence_of
from vibroswarm.posterior.markov_chain import State, Target, advance, begin
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario

CHAINS: Final = 8
"""Number of chains of a run."""
SCREENING: Final = 10
"""Sweeps of each chain at each look; the first half is discarded."""
BATCH: Final = 25
"""Sweeps of each chain in a batch, after which a look that may decide is estimated again."""
BATCHES: Final = 150
"""Largest number of batches of a look."""
SMALL: Final = 0.008
"""Monte Carlo error (standard error of the posterior) that is small enough."""
LARGE: Final = 0.02
"""Error above which a look is unsettled (its estimate is not reliable) after all batches."""
CLEAR: Final = 3.0
"""Distance from ``1 - alpha``, in standard errors, from which a posterior is clearly above or below it."""
NEAR: Final = 0.03
"""Looks whose first sweeps come this near to ``1 - alpha``, or within ``CLEAR`` errors of it, get batches of sweeps."""

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Look:
    """The posterior at one time: P(above the boundary), P(under it), and the standard error of the larger of them."""

    above: float
    """P(fill ratio above the boundary)."""
    under: float
    """P(fill ratio under the boundary)."""
    error: float
    """Monte Carlo standard error of the larger of the two."""
    settled: bool
    """Whether the estimate is reliable: the error is small, or the posterior clearly above or below ``1 - alpha``."""

    @property
    def larger(self) -> float:
        """Posterior probability of the side that is more probable."""
        return max(self.above, self.under)


def needs_chains(sensor: Sensor) -> bool:
    """Return whether readings depend on more than the tile below, so that the posterior needs Markov chains."""
    return sensor.edge_reach_m is not None or sensor.edge_blur_m is not None or factors_differ(sensor)


def chain_target(log_prior: Values, boundary: float) -> Target:
    """Return the prior as a weight of each floor, and the numbers of vibrating tiles on each side of the boundary.

    Chains change the number of vibrating tiles by one at a time. So they must be able to pass through numbers that the
    prior rules out, if these lie between numbers that it allows. All these "bridges" together get as much weight as all
    allowed numbers together; states on bridges are not counted in the posterior, although chains may start there.

    Args:
        log_prior: (tiles + 1,): ln of the prior of each number of vibrating tiles, -inf where it is ruled out; at least
            one is finite.
        boundary: decision boundary, a fill ratio; a floor of exactly this fill ratio is on neither side.
    """
    tiles = log_prior.size - 1
    k = np.arange(tiles + 1)
    allowed = np.flatnonzero(np.isfinite(log_prior))
    weight = log_prior - logsumexp(log_prior)  # ln of weights that sum to 1 over the allowed numbers
    bridges = np.setdiff1d(np.arange(allowed[0], allowed[-1] + 1), allowed)
    if bridges.size:
        weight[bridges] = -math.log(bridges.size)  # their weights sum to 1 too
    counts = np.zeros(tiles + 1)
    counts[allowed] = 1.0
    # Divide the weight of each number k of vibrating tiles by the number of floors that have k (a binomial
    # coefficient).
    weight -= gammaln(tiles + 1.0) - gammaln(k + 1.0) - gammaln(tiles - k + 1.0)
    above, under = k > boundary * tiles + 1e-9, k < boundary * tiles - 1e-9  # 1e-9: for rounding
    return Target(
        log_weight=weight, counts=counts, above=above.astype(np.float64), under=under.astype(np.float64)
    )


class Chains:
    """Markov chains over the floors of one run; each starts from a draw of the prior, and continues as samples arrive.

    Args:
        evidence: the samples of the run. target: the distribution to sample from (``chain_target``). robots: number of
            robots of the swarm. seed, run: address of the chains' random numbers. chains: number of chains,
            at least 2, since the error is estimated from their differences.
    """

    def __init__(
        self, evidence: Evidence, target: Target, robots: int, seed: int, run: int, chains: int = CHAINS
    ) -> None:
        """Allocate the chains' states, and draw their first states from the prior."""
        self.evidence, self.target, self.seed, self.run = evidence, target, seed, run
        tiles, samples = target.counts.size - 1, evidence.bit.size
        self.states = State(
            tiles=np.zeros((chains, tiles), dtype=np.uint8),
            log_tile=np.zeros((chains, tiles + 1)),
            log_robot=np.zeros((chains, robots)),
            likelihood=np.zeros((chains, samples)),
            drawn=np.zeros((chains, 1), dtype=np.int64),
            trial=np.zeros((chains, samples)),
            other=np.zeros((chains, samples)),
        )
        self.known = 0  # number of samples, from the first on, whose likelihoods the states hold
        begin(evidence, target, seed, run, self.states)

    def sweep(self, count: int, sweeps: int) -> Values:
        """Run ``sweeps`` sweeps of each chain, given the first ``count`` samples; ``count`` must not decrease.

        Returns: (chains, 3): for each chain the weight of its states above the boundary, under it, and of all its
            states; states with a number of vibrating tiles that the prior rules out do not count.
        """
        sums = np.zeros((self.states.tiles.shape[0], 3))
        advance(self.evidence, self.target, self.known, count, sweeps, self.seed, self.run, self.states, sums)
        self.known = count
        return sums

    def look(self, count: int, alpha: float) -> Look:
        """Estimate the posterior given the first ``count`` samples, precisely enough to compare it with 1 - alpha."""
        self.sweep(count, SCREENING // 2)  # discarded: the chains approach the new posterior
        first = _estimate(np.array([self.sweep(count, SCREENING - SCREENING // 2)]))  # a stack of one batch
        # If the posterior is clearly below 1 - alpha already, the side is not known yet, and no precision is needed.
        # The margin is CLEAR errors, but at least NEAR, as the error itself is estimated from these few sweeps only.
        if first.larger + max(CLEAR * first.error, NEAR) < 1.0 - alpha:
            return first
        batches: list[Values] = []
        while True:
            batches.append(self.sweep(count, BATCH))
            estimate = _estimate(np.array(batches))
            clear = abs(estimate.larger - (1.0 - alpha)) > CLEAR * estimate.error
            # The error between batches requires at least two.
            if len(batches) > 1 and (clear or estimate.error <= SMALL):
                return estimate
            if len(batches) == BATCHES:
                return replace(estimate, settled=estimate.error <= LARGE)


def _estimate(sums: Values) -> Look:
    """Estimate the posterior from the weights of states that batches of sweeps returned.

    Args:
        sums: (batches, chains, 3): stacked results of ``Chains.sweep``: weights above the boundary, under it, and in
            all.
    Returns: a look, settled except if all weights are 0, because no chain visited a number of vibrating tiles that the
        prior allows.
    """
    totals = sums.sum(axis=(0, 1))
    if totals[2] <= 0.0:
        return Look(above=0.0, under=0.0, error=1.0, settled=False)
    above, under = totals[:2] / totals[2]
    side = 0 if above >= under else 1
    share = totals[side] / totals[2]
    between_chains = _ratio_error(sums.sum(axis=0), side, share)  # one row per chain
    between_batches = _ratio_error(sums.reshape(-1, 3), side, share)  # one row per batch and chain
    return Look(
        above=float(above), under=float(under), error=max(between_chains, between_batches), settled=True
    )


def _ratio_error(sums: Values, side: int, share: float) -> float:
    """Return the standard error of ``share``, the ratio ``sums[:, side].sum() / sums[:, 2].sum()``.

    Args:
        sums: (n, 3), n at least 2: rows that are taken to be independent: weights above the boundary, under it, and in
            all.
        side: 0 above, 1 under.
    """
    n = sums.shape[0]
    residual = sums[:, side] - share * sums[:, 2]  # linearised error of a ratio of two sums
    return float(math.sqrt(n / (n - 1) * (residual @ residual)) / sums[:, 2].sum())


@dataclass(frozen=True)
class UntilKnown:
    """When the side of the boundary was known."""

    time_s: float | None
    """First time at which the side was known, s; None: it was not known at the last time."""
    look: Look
    """The look at that time, or at the last time if the side was not known."""
    settled: bool
    """Whether that look and all before it were settled."""


def sides_until_known(
    scenario: Scenario,
    floor: Floor,
    samples: pl.DataFrame,
    bit: NDArray[np.uint8],
    log_prior: Values,
    alpha: float,
    times: Values,
    seed: int,
    run: int,
) -> UntilKnown:
    """Find the first of ``times`` at which the posterior of one side of the boundary is 1 - alpha or more.

    Times whose look is not settled, so that its estimate is not reliable, are passed over.

    Args:
        floor: only its geometry is used, as its tiles are what is to be estimated. samples: the motion table of one
            run, in order of time.
        bit: (samples,): the bit of each sample. log_prior: (tiles + 1,): ln of the prior of each number of vibrating
            tiles.
        alpha: accepted error: the side is known when its posterior is at least 1 - alpha. times: times at which to
            look, increasing, s.
        seed, run: address of the chains' random numbers.
    Raises:
        InputError: edges reach over too many tiles.
    """
    robots = scenario.swarm.robots
    robot, x_m, y_m = (samples[name].to_numpy() for name in ("robot", "x_m", "y_m"))
    evidence = evidence_of(scenario.sensor, floor, robots, robot, x_m, y_m, bit)
    target = chain_target(log_prior, scenario.decision.decision_boundary)
    chains = Chains(evidence, target, robots, seed, run)
    counts = np.searchsorted(samples["time_s"].to_numpy(), times, side="right")
    look, settled = _without_samples(log_prior, target), True
    for time_s, count in zip(times.tolist(), counts.tolist(), strict=True):
        if count > chains.known:  # without new samples the last look still holds
            look = chains.look(count, alpha)
        settled &= look.settled
        if look.settled and look.larger >= 1.0 - alpha:
            return UntilKnown(time_s=time_s, look=look, settled=settled)
    return UntilKnown(time_s=None, look=look, settled=settled)


def _without_samples(log_prior: Values, target: Target) -> Look:
    """Return the look before any sample: P(above) and P(under) by the prior, which has no error."""
    weights = np.exp(log_prior - logsumexp(log_prior))
    return Look(
        above=float(weights @ target.above), under=float(weights @ target.under), error=0.0, settled=True
    )
