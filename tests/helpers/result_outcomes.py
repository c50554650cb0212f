"""Outcomes of a result, computed from its tables of samples: the reference for searches, which keep no such tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.inference.agents import estimate_of
from vibroswarm.inference.outcomes import Array, numbers
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.outcomes import Outcomes, end_s, from_tables
from vibroswarm.strategies import strategy


def from_result(result: Result) -> Outcomes:
    """Return the outcomes of a result; the estimates are those when all had decided."""
    tiles = result.floor(int(result.runs["run"][0])).tiles.size
    found = from_tables(result.scenario, result.robots, result.runs, tiles)
    last_s = np.where(found.undecided, np.inf, found.decision_time_s).max(axis=1)
    ends_s = np.array([end_s(float(last), found.t_end_s) for last in last_s])
    estimate = _estimates(result.scenario, found.run, ends_s, result.motion["time_s"], result.inference)
    return replace(found, end_s=ends_s, estimate=estimate)


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


def assert_same_outcomes(one: Outcomes, other: Outcomes) -> None:
    """Bit by bit."""
    for name in ("run", "decision", "decision_time_s", "estimate", "end_s", "fill_ratio", "truth"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert (one.tiles, one.t_end_s) == (other.tiles, other.t_end_s)
