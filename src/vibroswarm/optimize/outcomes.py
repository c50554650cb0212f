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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.inference.replay import infer
from vibroswarm.motion.contract import source
from vibroswarm.observation.model import observe
from vibroswarm.outcome import truth_of
from vibroswarm.result import Result
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import OF_MOTION, floors_of, simulate

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


def outcomes_of(
    scenarios: Sequence[Scenario], seed: int, runs: Sequence[int], motion: str = "event"
) -> list[Outcomes]:
    """The outcomes of these runs of each scenario; those that move alike share their motion, and floors their samples.

    Args:
        scenarios: one or several. seed, runs, motion: as of ``simulate``.
    Raises:
        InputError: a scenario cannot be simulated.
    """
    if any(scenario.run.stop == "all_decided" for scenario in scenarios):
        return [from_result(simulate(one, seed, runs, motion=motion, energies=False)) for one in scenarios]
    found: list[Outcomes] = []
    moved, seen = None, None
    for k, scenario in enumerate(scenarios):
        before = scenarios[k - 1] if k else None
        if before is None or any(getattr(scenario, s) != getattr(before, s) for s in OF_MOTION):
            moved, seen = source(motion).batch(scenario, seed, runs, False), None
        assert moved is not None
        if (
            seen is None
            or before is None
            or (scenario.floor, scenario.sensor) != (before.floor, before.sensor)
        ):
            floors = floors_of(scenario, seed, runs)
            seen = observe(scenario, seed, moved.samples, floors, energies=False)
            known = {id(floor): floor.fill_ratio_within(scenario.arena.width_m, scenario.arena.height_m)
                     for floor in floors.values()}  # fmt: skip
            fills = np.array([known[id(floors[run])] for run in runs])
            tiles = floors[runs[0]].tiles.size
        inference, robots = infer(scenario, seed, moved, seen)
        found.append(
            _outcomes(scenario, np.array(runs), moved.samples["time_s"], inference, robots, fills, tiles)
        )
    return found


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
        truth=_truths(scenario, runs["fill_ratio"].to_numpy()),
        tiles=tiles,
        t_end_s=scenario.run.t_end_s,
    )


def _truths(scenario: Scenario, fills: Array) -> Array:
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
    end_s = np.full(runs.size, t_end_s)
    all_there = (decision != -1).all(axis=1)
    end_s[all_there] = np.minimum(np.ceil(decision_time[all_there].max(axis=1) / POLL_S) * POLL_S, t_end_s)
    return Outcomes(
        run=runs,
        decision=decision,
        decision_time_s=decision_time,
        estimate=_estimates(scenario, runs, end_s, time_s.to_numpy(), inference),
        end_s=end_s,
        fill_ratio=fills,
        truth=_truths(scenario, fills),
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
