"""Outcomes of some runs of one scenario as arrays, from which costs are computed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import Array, capped_time_s, estimate_of, numbers, right_of, wrong_of
from vibroswarm.scenario.scenario import Scenario

POLL_S: Final = 20.0
"""Interval at which the study's search checked whether all robots had decided."""


@dataclass(frozen=True, eq=False)
class Outcomes(NotebookView):
    """Outcomes of some runs of one scenario as arrays; times in s, ``t_end_s`` is the end of the runs.

    The study's search ended a run when all had decided, which it checked every 20 s, or at T_end, and took the
    estimate then. A run that goes on to T_end has the same decisions, so ``end_s`` is that moment, regardless of
    ``run.stop``.
    """

    run: NDArray[np.int64]
    """(runs,): run numbers."""
    decision: NDArray[np.int64]
    """0, 1; -1 undecided, (runs, robots)."""
    decision_time_s: Array
    """Time of the current decision; nan if undecided, (runs, robots)."""
    estimate: Array
    """Posterior mean of the fill ratio at the last own sample before ``end_s``, (runs, robots); nan where the strategy
    keeps none."""
    end_s: Array
    """End of the run for the cost, (runs,)."""
    fill_ratio: Array
    """(runs,)."""
    truth: Array
    """1 where the fill ratio lies above the boundary, 0 below, nan on it, (runs,)."""
    tiles: int
    """Number of tiles of the floor."""
    t_end_s: float
    """End of a run that does not stop early."""
    strategy: str = ""
    """Name of the strategy, for messages."""

    @property
    def robots(self) -> int:
        """Number of robots of a run."""
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
    """Return the end of a run for the cost: the next check after its last decision (inf: none), at most T_end, s."""
    if math.isinf(last_decision_s):
        return t_end_s
    return min(math.ceil(last_decision_s / POLL_S) * POLL_S, t_end_s)
