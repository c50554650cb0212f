"""The side of the boundary on which a floor lies, look by look, from Markov chains that follow the samples.

At each look all chains take some sweeps given the samples so far, starting where the last look left them. If one
side may then be certain enough, more sweeps follow until the posterior is clearly on one side of ``1 - alpha``,
or its Monte Carlo error is small. That error is the larger of two: between chains, and between batches of sweeps
of all chains. Chains start from independent draws of the prior, so that a chain that is stuck shows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
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
SCREENING: Final = 10
"""Sweeps of each chain at a look; the first half is discarded."""
BATCH: Final = 25
"""Sweeps of each chain between two estimates at a look that matters."""
BATCHES: Final = 150
"""Limit on the batches of a look."""
SMALL: Final = 0.008
"""Monte Carlo error (standard error of the posterior) that is small enough."""
LARGE: Final = 0.02
"""Error above which a look is not settled after all batches."""
CLEAR: Final = 3.0
"""Distance from ``1 - alpha``, in standard errors, at which a look is clear."""
NEAR: Final = 0.03
"""Looks whose first sweeps lie this near to ``1 - alpha``, or within ``CLEAR`` errors of it, get more sweeps."""

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Look:
    """The posterior at one time: P(above), P(under), Monte Carlo standard error of the larger."""

    above: float
    under: float
    error: float
    settled: bool
    """Whether the error is small, or the side of ``1 - alpha`` clear."""

    @property
    def larger(self) -> float:
        """Posterior of the likelier side."""
        return max(self.above, self.under)


def needs_chains(sensor: Sensor) -> bool:
    """Return whether a reading depends on more than the tile below."""
    return sensor.edge_reach_m is not None or sensor.edge_blur_m is not None or factors_differ(sensor)


def chain_target(log_prior: Values, boundary: float) -> Target:
    """Return the chains' target, given ln of the prior of each number of vibrating tiles, (tiles + 1,).

    Chains change the number by one tile at a time, so they must be able to pass numbers that the prior rules out
    between allowed ones. These get, together, the weight of all allowed ones; states there are not counted.
    """
    tiles = log_prior.size - 1
    k = np.arange(tiles + 1)
    allowed = np.flatnonzero(np.isfinite(log_prior))
    weight = log_prior - logsumexp(log_prior)
    bridges = np.setdiff1d(np.arange(allowed[0], allowed[-1] + 1), allowed)
    if bridges.size:
        weight[bridges] = -math.log(bridges.size)
    counts = np.zeros(tiles + 1)
    counts[allowed] = 1.0
    weight -= gammaln(tiles + 1.0) - gammaln(k + 1.0) - gammaln(tiles - k + 1.0)
    above, under = k > boundary * tiles + 1e-9, k < boundary * tiles - 1e-9
    return Target(weight, counts, above.astype(np.float64), under.astype(np.float64))


class Chains:
    """Chains that follow the samples of one run.

    Args:
        evidence: of the run. target: see ``chain_target``. robots: of the swarm.
        seed, run: address of the chains' numbers.
    """

    def __init__(
        self, evidence: Evidence, target: Target, robots: int, seed: int, run: int, chains: int = CHAINS
    ) -> None:
        self.evidence, self.target, self.seed, self.run = evidence, target, seed, run
        tiles, samples = target.counts.size - 1, evidence.bit.size
        self.states = State(
            np.zeros((chains, tiles), dtype=np.uint8), np.zeros((chains, tiles + 1)), np.zeros((chains, robots)),
            np.zeros((chains, samples)), np.zeros((chains, 1), dtype=np.int64), np.zeros((chains, samples)),
            np.zeros((chains, samples)),
        )  # fmt: skip
        self.known = 0
        begin(evidence, target, seed, run, self.states)

    def sweep(self, count: int, sweeps: int) -> Values:
        """Run ``sweeps`` sweeps of each chain, given the first ``count`` samples.

        Returns: for each chain the sums of its states above the boundary, below it, and of all, (chains, 3).
        """
        sums = np.zeros((self.states.tiles.shape[0], 3))
        advance(self.evidence, self.target, self.known, count, sweeps, self.seed, self.run, self.states, sums)
        self.known = count
        return sums

    def look(self, count: int, alpha: float) -> Look:
        """Return the posterior given the first ``count`` samples, as precisely as a posterior error of ``alpha``
        requires."""
        self.sweep(count, SCREENING // 2)
        first = _estimate(np.array([self.sweep(count, SCREENING - SCREENING // 2)]))
        if first.larger + max(CLEAR * first.error, NEAR) < 1.0 - alpha:
            return first
        batches: list[Values] = []
        while True:
            batches.append(self.sweep(count, BATCH))
            estimate = _estimate(np.array(batches))
            clear = abs(estimate.larger - (1.0 - alpha)) > CLEAR * estimate.error
            if len(batches) > 1 and (clear or estimate.error <= SMALL):
                return estimate
            if len(batches) == BATCHES:
                return Look(estimate.above, estimate.under, estimate.error, estimate.error <= LARGE)


def _estimate(sums: Values) -> Look:
    """Estimate the posterior from sums, (batches, chains, 3); unsettled if no chain was where the prior allows."""
    totals = sums.sum(axis=(0, 1))
    if totals[2] <= 0.0:
        return Look(0.0, 0.0, 1.0, False)
    above, under = totals[:2] / totals[2]
    side = 0 if above >= under else 1
    share = totals[side] / totals[2]
    return Look(
        float(above),
        float(under),
        max(_ratio_error(sums.sum(axis=0), side, share), _ratio_error(sums.reshape(-1, 3), side, share)),
        True,
    )


def _ratio_error(sums: Values, side: int, share: float) -> float:
    """Return the standard error of the ratio of sums of n independent parts, (n, 3)."""
    n = sums.shape[0]
    rest = sums[:, side] - share * sums[:, 2]
    return float(math.sqrt(n / (n - 1) * (rest @ rest)) / sums[:, 2].sum())


@dataclass(frozen=True)
class UntilKnown:
    """When the side was known, s (None: not by the last time), and the deciding or last look."""

    time_s: float | None
    look: Look
    settled: bool
    """Whether all looks up to then were settled."""


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
    """Return the first of ``times`` at which the posterior of one side is 1 - alpha or more.

    Args:
        floor: only its geometry is used. samples: the motion table of the run, in order of time.
        bit: what they read, (samples,). log_prior: of each number of vibrating tiles, (tiles + 1,).
        seed, run: of the chains' numbers.
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
        if count > chains.known:
            look = chains.look(count, alpha)
        settled &= look.settled
        if look.settled and look.larger >= 1.0 - alpha:
            return UntilKnown(time_s, look, settled)
    return UntilKnown(None, look, settled)


def _without_samples(log_prior: Values, target: Target) -> Look:
    weights = np.exp(log_prior - logsumexp(log_prior))
    return Look(float(weights @ target.above), float(weights @ target.under), 0.0, True)
