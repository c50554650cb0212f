"""Compute time against error over the credible threshold p_c and the minimum number of observations O_c, by replay.

A swarm that waits longer makes fewer errors. So a single pair of time and error says little; the curve over both
settings of the decision shows what a strategy can achieve. All points of the curve share motion and observations:
compare them run by run with ``paired.compare``, not by whether their intervals overlap.

| name | equation |
|---|---|
| time | restricted mean decision time, s |
| error | share of robots wrong + u (share undecided), u from 0 to 1 (``undecided_counts``) |
| Pareto front | points for which no other point is at least as good in time and error and better in one of them |

The front is computed from estimates. The best of many points are partly lucky, and will be worse on fresh seeds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.cell_summary import summary
from vibroswarm.analysis.figures import run_figures
from vibroswarm.analysis.intervals import bootstrap_mean, cluster_share, plain
from vibroswarm.errors import InputError
from vibroswarm.inference.deliveries import needs_moves, timeline_of
from vibroswarm.motion.source import source
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import check_runs, floors_of, refuse_steering, summarise


def time_error_curve(
    scenario: Scenario,
    seed: int,
    runs: int | Sequence[int],
    credible_thresholds: Sequence[float],
    min_observations: Sequence[int],
    *,
    undecided_counts: float = 0.0,
    level: float = 0.95,
    batch: int = 200,
    workers: int = 1,
) -> pl.DataFrame:
    """Compute time and error for each pair of p_c and O_c.

    The tables of all robots of all points are in memory at once, some 100 bytes per robot and point.

    Args:
        scenario: gives all settings but p_c and O_c; it is run to t_end, whatever its ``run.stop``. Its strategy must
            not steer, because the points share their motion. seed: of the runs.
        runs: number of runs, or their numbers.
        credible_thresholds: values of p_c. min_observations: values of O_c.
        undecided_counts: u, how much an undecided robot counts as an error, 0 to 1. level: confidence level.
        batch: number of runs computed together. workers: number of threads.
    Returns: one row for each pair; pairs are in the given order, with all values of O_c for the first p_c first.
        Columns: credible_threshold, min_observations, error, error_low, error_high, all columns of
        ``CellSummary.as_row``, and pareto (whether the point is on the Pareto front). The error is over the runs with
        a truth; if there are none, it is null and no point is on the front.
    Raises:
        InputError: no settings, u outside [0, 1], batch or workers below 1, a seed or runs that ``check_runs`` refuses,
            a level outside (0, 1), a setting that the scenario refuses, or a strategy that steers.
    """
    settings = list(product(credible_thresholds, min_observations))
    if not settings:
        raise InputError("give at least one p_c and one O_c", field="credible_thresholds")
    if not 0.0 <= undecided_counts <= 1.0:
        raise InputError(
            f"{undecided_counts!r} is not a share; give a number from 0 to 1", field="undecided_counts"
        )
    for name, value in (("batch", batch), ("workers", workers)):
        if value < 1:
            raise InputError(f"{value} is too few; at least 1", field=name)
    base = scenario.with_values({"run.stop": "t_end"})
    points = [
        base.with_values({"decision.credible_threshold": p_c, "decision.min_observations": o_c})
        for p_c, o_c in settings
    ]
    # For each point, the tables of robots and of runs of all batches.
    robot_tables: list[list[pl.DataFrame]] = [[] for _ in points]
    run_tables: list[list[pl.DataFrame]] = [[] for _ in points]
    for part in replayed(base, points, seed, check_runs(seed, runs), batch, workers):
        for k, (robots_of_point, runs_of_point) in enumerate(part):
            robot_tables[k].append(robots_of_point)
            run_tables[k].append(runs_of_point)
    rows = [
        _point(
            pl.concat(robot_tables[k]), pl.concat(run_tables[k]), base.run.t_end_s, undecided_counts, level
        )
        for k in range(len(points))
    ]
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


Tables = list[tuple[pl.DataFrame, pl.DataFrame]]
"""For each point (a scenario), its table of robots and its table of runs."""


def replayed(
    base: Scenario, points: Sequence[Scenario], seed: int, runs: Sequence[int], batch: int, workers: int
) -> Iterator[Tables]:
    """Simulate the motion of runs once, compute decisions with the settings of each point, and yield their tables.

    Args:
        base: scenario of the motion and the observations; its strategy must not steer.
        points: scenarios that differ from ``base`` only in decisions.
        seed: of the runs. runs: numbers of the runs. batch: number of runs computed together. workers: number of
            threads, each with one batch at a time.
    Yields: for each batch of runs, in the order of ``runs``, the tables of robots and of runs of each point.
    Raises:
        InputError: the strategy steers; raised when the first batch is requested.
    """
    refuse_steering(base)

    def tables_of(part: Sequence[int]) -> Tables:
        """Return the tables of all points for one batch of runs."""
        # Event-driven motion is the default of ``simulate``. Decisions need no segments (the paths between samples);
        # moves are recorded only for a network or localisation that reads them.
        motion = source("event").batch(base, seed, part, segments=False, moves=needs_moves(base))
        timeline, floors = timeline_of(base, motion), floors_of(base, seed, part)
        observations = observe(base, seed, motion.samples, floors, energies=False)
        return [summarise(point, seed, floors, timeline, observations) for point in points]

    parts = [runs[first : first + batch] for first in range(0, len(runs), batch)]
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(tables_of, parts)


def _point(
    robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, undecided_counts: float, level: float
) -> dict[str, float | int | None]:
    """Compute the error of one point of the curve with its limits, and its figures, as columns of a row.

    The error is that of the runs with a truth.
    """
    table = run_figures(robots, runs, t_end_s).filter(pl.col("truth").is_not_null())
    # With u = 0 or 1 each robot counts as an error or not, so the error is a share of robots. With another u it is only
    # a mean over runs of weighted shares.
    if undecided_counts in (0.0, 1.0):
        count = table["wrong"] + table["undecided"] * int(undecided_counts)
        error = cluster_share(count.to_numpy(), table["robots"].to_numpy(), level)
    else:
        error = bootstrap_mean(table["wrong_share"] + undecided_counts * table["undecided_share"], level)
    limits = dict(zip(("error", "error_low", "error_high"), map(plain, error[:3]), strict=True))
    return limits | summary(robots, runs, t_end_s, level).as_row()


def pareto_front(*figures: ArrayLike) -> NDArray[np.bool_]:
    """Return which points are on the Pareto front, (points,).

    A point is on the front if no other point is at least as good in all figures and better in one of them.

    Args:
        figures: one or more figures of the points, (points,) each; less is better. A point with a figure of nan is not
            on the front.
    """
    rows = np.column_stack([np.asarray(figure, dtype=np.float64) for figure in figures])
    # Element (i, j) of the two arrays: whether point i is at least as good as point j in all figures; and whether it is
    # better in at least one.
    as_good = (rows[:, None, :] <= rows[None, :, :]).all(axis=2)
    better = (rows[:, None, :] < rows[None, :, :]).any(axis=2)
    return np.asarray(~(as_good & better).any(axis=0) & ~np.isnan(rows).any(axis=1))
