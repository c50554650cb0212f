"""Which side of the boundary a floor is on, look by look, from chains that follow the samples as they come.

At each look all chains take some sweeps given the samples so far, from where the last look left them. Where that says
that one side may be sure enough, fresh sweeps follow until it is clear on which side of ``1 - alpha`` the posterior
lies, or its Monte Carlo error is small. That error is the larger of two: between the chains, and between batches of
sweeps of all chains. Chains begin where the prior draws them, each by itself, so that one that is stuck shows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from vibroswarm.fields import Sensor
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.felt import factors_differ
from vibroswarm.posterior.chain import State, Target, advance, begin
from vibroswarm.posterior.evidence import Evidence, evidence_of
from vibroswarm.scenario import Scenario

CHAINS: Final = 8
SCREENING: Final = 10
"""Sweeps of each chain at a look; the first half of them is not counted."""
BATCH: Final = 25
"""Sweeps of each chain between two estimates of a look that matters."""
BATCHES: Final = 150
"""After so many the look is left as it is."""
SMALL: Final = 0.008
"""A Monte Carlo error (standard error of the posterior) that is small enough."""
LARGE: Final = 0.02
"""One that is not: after all batches, the look is not settled."""
CLEAR: Final = 3.0
"""Standard errors from ``1 - alpha`` at which a look is clear."""
NEAR: Final = 0.03
"""Looks so near ``1 - alpha`` by the first sweeps, or nearer than ``CLEAR`` of their errors, get more of them."""

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Look:
    """The posterior at one time: P(above), P(under), standard error of the larger of them by Monte Carlo."""

    above: float
    under: float
    error: float
    settled: bool
    """Whether the error is small, or the side of ``1 - alpha`` clear."""

    @property
    def larger(self) -> float:
        """The posterior of the likelier side."""
        return max(self.above, self.under)


def needs_chains(sensor: Sensor) -> bool:
    """Whether a reading depends on more than the tile below."""
    return sensor.edge_reach_m is not None or sensor.edge_blur_m is not None or factors_differ(sensor)


def chain_target(log_prior: Values, boundary: float) -> Target:
    """What chains tend to for ln of the prior of each number of vibrating tiles, (tiles + 1,).

    Numbers that the prior rules out between those that it allows weigh together as much as all that it allows.
    """
    tiles = log_prior.size - 1
    k = np.arange(tiles + 1)
    allowed = np.flatnonzero(np.isfinite(log_prior))
    weight = log_prior - logsumexp(log_prior)
    stones = np.setdiff1d(np.arange(allowed[0], allowed[-1] + 1), allowed)
    if stones.size:
        weight[stones] = -math.log(stones.size)
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
        """What was counted in some sweeps given the first ``count`` samples: above, under, in all; (chains, 3)."""
        sums = np.zeros((self.states.tiles.shape[0], 3))
        advance(self.evidence, self.target, self.known, count, sweeps, self.seed, self.run, self.states, sums)
        self.known = count
        return sums

    def look(self, count: int, alpha: float) -> Look:
        """The posterior given the first ``count`` samples, as exactly as a posterior error of ``alpha`` asks for."""
        self.sweep(count, SCREENING // 2)
        first = _estimate(np.array([self.sweep(count, SCREENING - SCREENING // 2)]))
        if first.larger + max(CLEAR * first.error, NEAR) < 1.0 - alpha:
            return first
        batches: list[Values] = []
        while True:
            batches.append(self.sweep(count, BATCH))
            found = _estimate(np.array(batches))
            clear = abs(found.larger - (1.0 - alpha)) > CLEAR * found.error
            if len(batches) > 1 and (clear or found.error <= SMALL):
                return found
            if len(batches) == BATCHES:
                return Look(found.above, found.under, found.error, found.error <= LARGE)


def _estimate(sums: Values) -> Look:
    """From what was counted, (batches, chains, 3). A chain that never was where the prior allows makes it unsettled."""
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
    """Standard error of the ratio of sums of n independent parts, (n, 3)."""
    n = sums.shape[0]
    rest = sums[:, side] - share * sums[:, 2]
    return float(math.sqrt(n / (n - 1) * (rest @ rest)) / sums[:, 2].sum())


@dataclass(frozen=True)
class UntilKnown:
    """When the side was known, s (None: not by the last time), the look that said so or the last one."""

    time_s: float | None
    look: Look
    settled: bool
    """Whether all looks up to then were."""


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
    """The first of ``times`` at which the posterior of one side is 1 - alpha or more.

    Args:
        floor: of which the geometry alone is used. samples: the motion table of the run, in order of time.
        bit: what they read, (samples,). log_prior: of each number of vibrating tiles, (tiles + 1,).
        seed, run: of the chains' numbers.
    Raises:
        InputError: edges reach over so many tiles that it cannot be computed.
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
