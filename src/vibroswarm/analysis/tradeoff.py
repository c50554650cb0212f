"""Compute time against error over the credible threshold p_c and the minimum number of observations O_c, by replay.

A swarm that waits longer makes fewer errors: one pair of time and error says little, the curve over both settings of
the decision shows what a strategy can achieve. All points share motion and observations, so they are paired: compare
them with ``paired.compare``, not by whether their intervals overlap.

| name | equation |
|---|---|
| time | restricted mean decision time, s |
| error | share of robots wrong + u (share undecided) |
| Pareto front | points that no other point beats in one of time and error without losing in the other |

The front is that of the estimates: the best of many points are partly lucky, and worse on fresh seeds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.cell_summary import run_figures, summary
from vibroswarm.analysis.intervals import bootstrap_mean, cluster_share, plain
from vibroswarm.errors import InputError
from vibroswarm.inference.deliveries import needs_moves, timeline_of
from vibroswarm.motion.source import source
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import check_runs, floors_of, summarise


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
    """Compute the curve: one row for each pair of p_c and O_c, in the order given.

    Args:
        scenario: all else; it is run to t_end, whatever its ``run.stop``. seed, runs: as ``simulate`` has them.
        undecided_counts: u of the module's head, in [0, 1]. batch: runs at a time. workers: threads.
    Returns: credible_threshold, min_observations, error, error_low, error_high, all figures of
        ``cell_summary.summary``, and pareto. Meanwhile tables of all robots are in memory, some 100 bytes per robot and
        point.
    Raises:
        InputError: no settings, u outside [0, 1], or a setting that the scenario refuses.
    """
    settings = list(product(credible_thresholds, min_observations))
    if not settings:
        raise InputError("give at least one p_c and one O_c", field="credible_thresholds")
    if not 0.0 <= undecided_counts <= 1.0:
        raise InputError(f"{undecided_counts!r} is not a share; from 0 to 1", field="undecided_counts")
    for name, value in (("batch", batch), ("workers", workers)):
        if value < 1:
            raise InputError(f"{value} is too few; at least 1", field=name)
    base = scenario.with_values({"run.stop": "t_end"})
    points = [
        base.with_values({"decision.credible_threshold": p_c, "decision.min_observations": o_c})
        for p_c, o_c in settings
    ]
    robots: list[list[pl.DataFrame]] = [[] for _ in points]
    of_runs: list[list[pl.DataFrame]] = [[] for _ in points]
    for part in replayed(base, points, seed, check_runs(seed, runs), batch, workers):
        for k, (of_robots, of_run) in enumerate(part):
            robots[k].append(of_robots)
            of_runs[k].append(of_run)
    rows = [
        _point(pl.concat(robots[k]), pl.concat(of_runs[k]), base.run.t_end_s, undecided_counts, level)
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
"""The tables of robots and of runs, for each point."""


def replayed(
    base: Scenario, points: Sequence[Scenario], seed: int, runs: Sequence[int], batch: int, workers: int
) -> Iterator[Tables]:
    """Yield the tables of each batch of runs; motion and observations are shared by all points."""

    def one(part: Sequence[int]) -> Tables:
        moves = needs_moves(base)
        motion = source("event").batch(base, seed, part, False, moves)
        timeline, floors = timeline_of(base, motion), floors_of(base, seed, part)
        observations = observe(base, seed, motion.samples, floors, energies=False)
        return [summarise(point, seed, floors, timeline, observations) for point in points]

    parts = [runs[first : first + batch] for first in range(0, len(runs), batch)]
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(one, parts)


def _point(
    robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, undecided_counts: float, level: float
) -> dict[str, float | int | None]:
    """Compute error and figures of one point of the curve."""
    table = run_figures(robots, runs, t_end_s).filter(pl.col("truth").is_not_null())
    if undecided_counts in (0.0, 1.0):
        count = table["wrong"] + table["undecided"] * int(undecided_counts)
        error = cluster_share(count.to_numpy(), table["robots"].to_numpy(), level)
    else:
        error = bootstrap_mean(table["wrong_share"] + undecided_counts * table["undecided_share"], level)
    limits = dict(zip(("error", "error_low", "error_high"), map(plain, error[:3]), strict=True))
    return limits | summary(robots, runs, t_end_s, level).as_row()


def pareto_front(*figures: ArrayLike) -> NDArray[np.bool_]:
    """Tell which points are on the Pareto front: no other is as good in all figures and better in one.

    Args:
        figures: one or more, (points,) each; less is better. A point that lacks a figure (nan) is not on the front.
    """
    rows = np.column_stack([np.asarray(figure, dtype=np.float64) for figure in figures])
    as_good = (rows[:, None, :] <= rows[None, :, :]).all(axis=2)
    better = (rows[:, None, :] < rows[None, :, :]).any(axis=2)
    return np.asarray(~(as_good & better).any(axis=0) & ~np.isnan(rows).any(axis=1))
