"""Compute time against error over the credible threshold p_c and the minimum number of observations O_c.

A swarm that waits longer makes fewer errors. So a single pair of time and error says little; the curve over both
settings of the decision shows what a strategy can achieve. All points of the curve share motion and observations:
compare them run by run with ``paired.compare``, not by whether their intervals overlap.

| name | equation |
|---|---|
| time | restricted mean decision time, s |
| error | share of robots wrong + u (share undecided), u from 0 to 1 (``undecided_counts``); with costs of mistakes \
(``task.costs``) a mistake counts by its cost relative to the dearest |
| Pareto front | points for which no other point is at least as good in time and error and better in one of them |

The front is computed from estimates. The best of many points are partly lucky, and will be worse on fresh seeds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.analysis.cell_summary import summary
from vibroswarm.analysis.figures import run_figures
from vibroswarm.analysis.intervals import cluster_share, columns_of, share_interval
from vibroswarm.analysis.pareto import pareto_front
from vibroswarm.errors import InputError, number_of
from vibroswarm.inference.outcomes import Array, costs_of, forced_errors, numbers
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import refuse_steering
from vibroswarm.study.run import run
from vibroswarm.study.spec import Study


@dataclass(frozen=True)
class Tradeoff:
    """Time against error over p_c and O_c, and what was simulated for it."""

    curve: pl.DataFrame
    """From ``time_error_curve`` with ``undecided_counts`` 0: its errors are shares of robots wrong."""
    scenario: Scenario
    seed: int


def tradeoff(
    scenario: Scenario,
    seed: int,
    runs: int,
    credible_thresholds: Sequence[float],
    min_observations: Sequence[int],
    **how: Any,
) -> Tradeoff:
    """Compute time and share of robots wrong for each pair of p_c and O_c; arguments as of ``time_error_curve``."""
    curve = time_error_curve(scenario, seed, runs, credible_thresholds, min_observations, **how)
    return Tradeoff(curve, scenario, seed)


def time_error_curve(
    scenario: Scenario,
    seed: int,
    runs: int,
    credible_thresholds: Sequence[float],
    min_observations: Sequence[int],
    *,
    undecided_counts: float = 0.0,
    level: float = 0.95,
    **how: Any,
) -> pl.DataFrame:
    """Compute time and error for each pair of p_c and O_c.

    Args:
        scenario: gives all settings but p_c and O_c; it is run to t_end, whatever its ``run.stop``. Its strategy must
            not steer, because the points share their motion. seed: of the runs. runs: their number.
        credible_thresholds: values of p_c. min_observations: values of O_c.
        undecided_counts: u, how much an undecided robot counts as an error, 0 to 1. level: confidence level.
        how: further arguments of ``study.run.run``, such as workers.
    Returns: one row for each pair, in the given order, with all values of O_c for the first p_c first.
        Columns: credible_threshold, min_observations, error, error_low, error_high, all columns of
        ``CellSummary.as_row``, and pareto (whether the point is on the Pareto front). The error is over the runs with
        a truth; if there are none, it is null and no point is on the front.
    Raises:
        InputError: no settings, u outside [0, 1], a seed or a number of runs that ``Study`` refuses, a level outside
            (0, 1), a setting that the scenario refuses, or a strategy that steers.
    """
    settings = list(dict.fromkeys(product(credible_thresholds, min_observations)))
    if not settings:
        raise InputError("give at least one p_c and one O_c", field="credible_thresholds")
    undecided_counts = number_of(undecided_counts, "undecided_counts", 0.0, 1.0)
    refuse_steering(scenario)
    base = scenario.with_values({"run.stop": "t_end"})
    points = {
        f"p_c {p_c}, O_c {o_c}": base.with_values(
            {"decision.credible_threshold": p_c, "decision.min_observations": o_c}
        )
        for p_c, o_c in settings
    }
    result = run(Study.of_scenarios(points, runs, seed), **how)
    tables = [result.tables(cell.number) for cell in result.study.cells]
    rows = [_point(*of_point, base, undecided_counts, level) for of_point in tables]
    table = pl.DataFrame(
        [
            {"credible_threshold": float(p_c), "min_observations": int(o_c), **row}
            for (p_c, o_c), row in zip(settings, rows, strict=True)
        ],
        infer_schema_length=None,
    )
    times, errors = (
        table[name].cast(pl.Float64).fill_null(math.nan) for name in ("decision_time_s", "error")
    )
    return table.with_columns(pareto=pl.Series(pareto_front(times.to_numpy(), errors.to_numpy())))


def _point(
    robots: pl.DataFrame, runs: pl.DataFrame, scenario: Scenario, undecided_counts: float, level: float
) -> dict[str, float | int | None]:
    """Compute the error of one point of the curve with its limits, and its figures, as columns of a row.

    The error is that of the runs with a truth.

    Args:
        scenario: its end of the run and its costs of mistakes are used.
    """
    t_end_s, costs = scenario.run.t_end_s, costs_of(scenario)
    table = run_figures(robots, runs, t_end_s, costs=costs).filter(pl.col("truth").is_not_null())
    # With u = 0 or 1, and without costs, each robot counts as an error or not, so the error is a share of robots. With
    # another u, or with costs, it is only a mean over runs of weighted shares.
    if costs is None and undecided_counts in (0.0, 1.0):
        count = table["wrong"] + table["undecided"] * int(undecided_counts)
        error = cluster_share(count.to_numpy(), table["robots"].to_numpy(), level)
    else:
        mistakes = table["wrong_share"].to_numpy() if costs is None else _mistakes(robots, runs, costs)
        errors = mistakes + undecided_counts * table["undecided_share"].to_numpy()
        error = share_interval(errors, level)
    return columns_of("error", error) | summary(robots, runs, t_end_s, level, costs=costs).as_row()


def _mistakes(robots: pl.DataFrame, runs: pl.DataFrame, costs: Array) -> Array:
    """Return the mean cost of robots' mistakes in each run with a truth, in the order of runs."""
    decided = robots.join(runs.select("run", "truth"), on="run").filter(pl.col("truth").is_not_null())
    # With belief 1 in the truth an undecided robot leans to it: it has made no mistake.
    cost = forced_errors(
        decided["decision"].to_numpy(), np.ones(decided.height), numbers(decided["truth"]), costs
    )
    by_run = decided.select("run", cost=pl.Series(cost)).group_by("run").agg(pl.col("cost").mean())
    return numbers(by_run.sort("run")["cost"])
