"""What a cost is computed from: what became of each robot in some runs of one scenario, as arrays.

| name | what it is | shape |
|---|---|---|
| decision | 0, 1; -1 undecided | (runs, robots) |
| decision_time_s | when it came to stand; nan where undecided | (runs, robots) |
| estimate | f = alpha / (alpha + beta), the posterior mean at the last own sample before ``end_s`` | (runs, robots) |
| end_s | when the run ended for the cost, see below | (runs,) |
| fill_ratio | f* | (runs,) |
| tiles, t_end_s | how many tiles the floor has; T_end | - |
| truth | 1 where f* lies above the boundary, 0 below, nan on it | (runs,) |

The study's search ended a run when all had decided, which it looked at every 20 s, or at T_end, and took the estimate
then. A run that goes on to T_end has the same decisions, so ``end_s`` is that moment, whatever ``run.stop`` says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.outcome import truth_of
from vibroswarm.result import Result
from vibroswarm.scenario import Scenario

POLL_S: Final = 20.0
"""How often the study's search looked whether all had decided."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Outcomes:
    """See the head of this module; times in s."""

    run: NDArray[np.int64]
    decision: NDArray[np.int64]
    decision_time_s: Array
    estimate: Array
    end_s: Array
    fill_ratio: Array
    truth: Array
    tiles: int
    """How many tiles the floor has."""
    t_end_s: float

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
        """(runs, robots)."""
        return np.asarray(self.decision == self.truth[:, None])

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """(runs, robots)."""
        return ~self.undecided & ~self.right

    @property
    def time_s(self) -> Array:
        """min(decision time, T_end): an undecided robot counts with T_end, (runs, robots)."""
        return np.where(self.undecided, self.t_end_s, self.decision_time_s)


def from_result(result: Result) -> Outcomes:
    """The outcomes of a result."""
    floor = result.floor(int(result.runs["run"][0]))
    return _outcomes(
        result.scenario,
        result.runs["run"].to_numpy().astype(np.int64),
        result.motion["time_s"],
        result.inference,
        result.robots,
        result.runs["fill_ratio"].to_numpy(),
        floor.tiles.size,
    )


def from_tables(scenario: Scenario, robots: pl.DataFrame, runs: pl.DataFrame, tiles: int) -> Outcomes:
    """The outcomes from a study's tables of robots and runs; the estimates are those at the end of the runs."""
    if robots.height != runs.height * scenario.swarm.robots:
        raise InputError("the tables of robots and of runs are not of the same runs", field="runs")
    shape = (runs.height, scenario.swarm.robots)
    alpha, beta = (robots[name].to_numpy().astype(np.float64).reshape(shape) for name in ("alpha", "beta"))
    time_s = robots["decision_time_s"].cast(pl.Float64).fill_null(float("nan")).to_numpy()
    return Outcomes(
        run=runs["run"].to_numpy().astype(np.int64),
        decision=robots["decision"].to_numpy().astype(np.int64).reshape(shape),
        decision_time_s=time_s.reshape(shape),
        estimate=alpha / (alpha + beta),
        end_s=runs["end_s"].to_numpy(),
        fill_ratio=runs["fill_ratio"].to_numpy(),
        truth=truths(scenario, runs["fill_ratio"].to_numpy()),
        tiles=tiles,
        t_end_s=scenario.run.t_end_s,
    )


def end_s(last_decision_s: float, t_end_s: float) -> float:
    """When a run ended for the cost: at the next look after its last decision (infinite: none), at most T_end, s."""
    if math.isinf(last_decision_s):
        return t_end_s
    return min(math.ceil(last_decision_s / POLL_S) * POLL_S, t_end_s)


def truths(scenario: Scenario, fills: Array) -> Array:
    """1 where the fill ratio lies above the boundary, 0 below, not a number on it, (runs,)."""
    boundary = scenario.decision.decision_boundary
    return np.array([truth_of(float(fill), boundary) for fill in fills], dtype=np.float64)  # None: nan


def _outcomes(
    scenario: Scenario,
    runs: NDArray[np.int64],
    time_s: pl.Series,
    inference: pl.DataFrame,
    robots: pl.DataFrame,
    fills: Array,
    tiles: int,
) -> Outcomes:
    """From the samples of the runs, by run and time, and what became of their robots, by run and robot."""
    t_end_s, shape = scenario.run.t_end_s, (runs.size, scenario.swarm.robots)
    decision = robots["decision"].to_numpy().astype(np.int64).reshape(shape)
    decision_time = robots["decision_time_s"].to_numpy().reshape(shape)
    last_s = np.where(decision == -1, np.inf, decision_time).max(axis=1)
    ends_s = np.array([end_s(float(last), t_end_s) for last in last_s])
    return Outcomes(
        run=runs,
        decision=decision,
        decision_time_s=decision_time,
        estimate=_estimates(scenario, runs, ends_s, time_s.to_numpy(), inference),
        end_s=ends_s,
        fill_ratio=fills,
        truth=truths(scenario, fills),
        tiles=tiles,
        t_end_s=t_end_s,
    )


def _estimates(
    scenario: Scenario, runs: NDArray[np.int64], end_s: Array, times_s: Array, inference: pl.DataFrame
) -> Array:
    """The posterior mean of each robot at its last sample up to the end of its run, (runs, robots)."""
    robots, decision = scenario.swarm.robots, scenario.decision
    run = np.searchsorted(runs, inference["run"].to_numpy())
    at = np.flatnonzero(times_s <= end_s[run])
    who = run[at] * robots + inference["robot"].to_numpy()[at]
    alpha, beta = (inference[name].to_numpy()[at].astype(np.float64) for name in ("alpha", "beta"))
    estimate = np.full(
        runs.size * robots, decision.prior_alpha / (decision.prior_alpha + decision.prior_beta)
    )
    estimate[who] = alpha / (alpha + beta)  # of a robot's samples the last is kept
    return estimate.reshape(-1, robots)
