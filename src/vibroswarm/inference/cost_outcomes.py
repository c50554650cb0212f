"""Outcomes of some runs of one scenario as arrays: what a cost is computed from."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.outcomes import (
    Array,
    capped_time_s,
    estimate_of,
    numbers,
    right_of,
    wrong_of,
)
from vibroswarm.scenario import Scenario
from vibroswarm.strategies import strategy

POLL_S: Final = 20.0
"""How often the study's search checked whether all robots had decided."""


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Outcomes of some runs of one scenario as arrays; times in s, ``t_end_s`` is the end of the runs.

    The study's search ended a run when all had decided, which it checked every 20 s, or at T_end, and took the
    estimate then. A run that goes on to T_end has the same decisions, so ``end_s`` is that moment, whatever
    ``run.stop`` says.
    """

    run: NDArray[np.int64]
    """(runs,)."""
    decision: NDArray[np.int64]
    """0, 1; -1 undecided, (runs, robots)."""
    decision_time_s: Array
    """Time at which it came to stand; nan where undecided, (runs, robots)."""
    estimate: Array
    """Posterior mean of the fill ratio at the last own sample before ``end_s``, (runs, robots); nan where the strategy
    keeps none."""
    end_s: Array
    """When the run ended for the cost, (runs,)."""
    fill_ratio: Array
    """(runs,)."""
    truth: Array
    """1 where the fill ratio lies above the boundary, 0 below, nan on it, (runs,)."""
    tiles: int
    """How many tiles the floor has."""
    t_end_s: float
    """End of a run that does not stop early."""
    strategy: str = ""
    """Its name, for messages."""

    @property
    def robots(self) -> int:
        """How many robots a run has."""
        return int(self.decision.shape[1])

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """(runs, robots)."""
        return np.asarray(self.decision == -1)

    @property
    def right(self) -> NDArray[np.bool_]:
        """(runs, robots); none where the truth is nan."""
        return right_of(self.decision, self.truth)

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """(runs, robots); none where the truth is nan."""
        return wrong_of(self.decision, self.truth)

    @property
    def time_s(self) -> Array:
        """min(decision time, T_end): an undecided robot counts with T_end, (runs, robots)."""
        return capped_time_s(self.decision_time_s, self.t_end_s)


class Tables(Protocol):
    """What is read of a ``Result``, which this layer does not know."""

    @property
    def scenario(self) -> Scenario:
        """The scenario of all runs."""

    @property
    def motion(self) -> pl.DataFrame:
        """A row a sample."""

    @property
    def inference(self) -> pl.DataFrame:
        """A row a sample, those of ``motion``."""

    @property
    def robots(self) -> pl.DataFrame:
        """``outcomes.ROBOTS``."""

    @property
    def runs(self) -> pl.DataFrame:
        """``outcomes.RUNS``."""

    def floor(self, run: int = 0) -> Floor:
        """Return the floor of a run."""


def from_result(result: Tables) -> Outcomes:
    """Return the outcomes of a result; the estimates are those when all had decided."""
    tiles = result.floor(int(result.runs["run"][0])).tiles.size
    found = from_tables(result.scenario, result.robots, result.runs, tiles)
    last_s = np.where(found.undecided, np.inf, found.decision_time_s).max(axis=1)
    ends_s = np.array([end_s(float(last), found.t_end_s) for last in last_s])
    estimate = _estimates(result.scenario, found.run, ends_s, result.motion["time_s"], result.inference)
    return replace(found, end_s=ends_s, estimate=estimate)


def from_tables(scenario: Scenario, robots: pl.DataFrame, runs: pl.DataFrame, tiles: int) -> Outcomes:
    """Return the outcomes of the tables of robots and runs; the estimates are those at the end of the runs."""
    if robots.height != runs.height * scenario.swarm.robots:
        raise InputError("the tables of robots and of runs are not of the same runs", field="runs")
    shape = (runs.height, scenario.swarm.robots)
    time_s, alpha, beta = (
        numbers(robots[name]).reshape(shape) for name in ("decision_time_s", "alpha", "beta")
    )
    return Outcomes(
        run=runs["run"].to_numpy().astype(np.int64),
        decision=robots["decision"].to_numpy().astype(np.int64).reshape(shape),
        decision_time_s=time_s,
        estimate=estimate_of(alpha, beta),
        end_s=runs["end_s"].to_numpy(),
        fill_ratio=runs["fill_ratio"].to_numpy(),
        truth=numbers(runs["truth"]),
        tiles=tiles,
        t_end_s=scenario.run.t_end_s,
        strategy=scenario.strategy.name,
    )


def end_s(last_decision_s: float, t_end_s: float) -> float:
    """Return when a run ended for the cost: at the next check after its last decision (inf: none), at most T_end, s."""
    if math.isinf(last_decision_s):
        return t_end_s
    return min(math.ceil(last_decision_s / POLL_S) * POLL_S, t_end_s)


def _estimates(
    scenario: Scenario, runs: NDArray[np.int64], ends_s: Array, time_s: pl.Series, inference: pl.DataFrame
) -> Array:
    """Return the posterior mean of each robot at its last sample up to the end of its run, (runs, robots).

    That of a robot without a sample is its prior's; nan where the strategy keeps no posterior.
    """
    robots, decision = scenario.swarm.robots, scenario.decision
    if not {"alpha", "beta"} <= set(strategy(scenario.strategy.name).state_type.names or ()):
        return np.full((runs.size, robots), np.nan)
    run = np.searchsorted(runs, inference["run"].to_numpy())
    at = np.flatnonzero(time_s.to_numpy() <= ends_s[run])
    who = run[at] * robots + inference["robot"].to_numpy()[at]
    alpha = np.full(runs.size * robots, float(decision.prior_alpha))
    beta = np.full(runs.size * robots, float(decision.prior_beta))
    alpha[who], beta[who] = (
        numbers(inference[name])[at] for name in ("alpha", "beta")
    )  # a robot's last stays
    return estimate_of(alpha, beta).reshape(-1, robots)
