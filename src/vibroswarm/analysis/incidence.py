"""Compute the cumulative incidence of right and wrong decisions, of robots and of swarms, over time.

Runs go to t_end, or stop when all robots have decided. So no observation is censored before t_end, and the cumulative
incidence is simply the share that has decided by each time. A robot that revises its decision counts from the time of
its final decision. Limits hold at each time by itself.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.figures import Swarms
from vibroswarm.analysis.intervals import cluster_share_of_distinct, wilson_limits

POINTS = 121
"""Number of times in the default grid from 0 to t_end."""
READ: Final = ("decision", "decision_time_s", "truth", "consensus", "consensus_time_s")
"""Columns of the tables that are read, besides run and robot."""


def time_grid(t_end_s: float, times_s: ArrayLike | None) -> NDArray[np.float64]:
    """Return the given times as a flat array, or by default ``POINTS`` evenly spaced times from 0 to t_end, s."""
    if times_s is None:
        return np.linspace(0.0, t_end_s, POINTS)
    return np.asarray(times_s, dtype=np.float64).ravel()


def robot_incidence(
    robots: pl.DataFrame,
    runs: pl.DataFrame,
    t_end_s: float,
    times_s: ArrayLike | None = None,
    level: float = 0.95,
    seed: int = 0,
) -> pl.DataFrame:
    """Compute the shares of robots that had decided right, decided wrong, or not decided by each time.

    Args:
        robots, runs: tables of a result. t_end_s: end of the runs, s.
        times_s: at which shares are computed, s; by default the grid of ``time_grid``.
        level: confidence level of the limits. seed: of their bootstrap over runs.
    Returns: one row per time: time_s, and ``right``, ``wrong``, ``undecided``, each with ``_low`` and ``_high``. Right
        and wrong are shares of the robots in runs with a truth; null if there are no such runs.
    """
    table = _sized(robots, runs, t_end_s)
    times = time_grid(t_end_s, times_s)
    known = table.filter(pl.col("truth").is_not_null())
    decisions = robots.select("run", "decision", "decision_time_s")
    robots_and_truth = decisions.join(table.select("run", "truth"), on="run")
    decided = pl.col("decision") != -1
    # For each share, the runs whose robots count, and which robots are counted at their decision times.
    parts = {
        "right": (known, decided & (pl.col("decision") == pl.col("truth"))),
        "wrong": (known, decided & (pl.col("decision") != pl.col("truth"))),
        "undecided": (table, decided),
    }
    columns: dict[str, NDArray[np.float64]] = {"time_s": times}
    for name, (runs_counted, robots_counted) in parts.items():
        size, count, number = _counts_over_time(robots_and_truth.filter(robots_counted), runs_counted, times)
        if name == "undecided":  # the rest of a run: its size - number that had decided
            count = size - count
        shares = [cluster_share_of_distinct(count, size, of_time, level, seed)[:3] for of_time in number]
        limits = np.array(shares).reshape(-1, 3)
        columns |= {name: limits[:, 0], f"{name}_low": limits[:, 1], f"{name}_high": limits[:, 2]}
    return pl.DataFrame(columns).fill_nan(None)


def _sized(robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float) -> pl.DataFrame:
    """Return truth, consensus and its time, and number of robots of each run, sorted by run."""
    swarms = Swarms.of_tables(robots, runs, t_end_s)
    table = runs.sort("run").select("run", "truth", "consensus", "consensus_time_s")
    return table.with_columns(robots=pl.Series(swarms.count))


def _counts_over_time(
    decided: pl.DataFrame, of: pl.DataFrame, times: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Count for each time the runs in which 0, 1, 2, ... robots had decided.

    At least k robots of a run had decided by t if its k-th decision time is at most t. So one sorted list of k-th
    decision times per k serves all times, without a table of runs by times.

    Args:
        decided: rows of the robots that decided. of: the runs that count, as of ``_sized``. times: times, s.
    Returns: the kinds of runs, one for each size of a run and each count from 0 to this size: number of robots of a
        run, (kinds,); number of them that had decided, (kinds,); and number of runs of each kind, (times, kinds).
    """
    ranked = (
        decided.lazy()
        .join(of.lazy().select("run", size="robots"), on="run")
        .sort("run", "decision_time_s")
        .select("size", "decision_time_s", rank=pl.int_range(1, pl.len() + 1).over("run"))
        .collect()
    )
    sizes, counts = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    numbers = [np.empty((times.size, 0), dtype=np.int64)]
    for size, number in of.group_by("robots").len().sort("robots").iter_rows():
        # at_least[t, k]: number of runs with at least k decided robots at time t. The last column, for size + 1 robots,
        # stays 0, so that the differences of columns give the runs with exactly k.
        at_least = np.zeros((times.size, size + 2), dtype=np.int64)
        at_least[:, 0] = number
        of_size = ranked.filter(pl.col("size") == size)
        for k in range(1, size + 1):
            kth = np.sort(of_size.filter(pl.col("rank") == k)["decision_time_s"].to_numpy())
            at_least[:, k] = np.searchsorted(kth, times, side="right")
        sizes.append(np.full(size + 1, size))
        counts.append(np.arange(size + 1))
        numbers.append(at_least[:, :-1] - at_least[:, 1:])
    return np.concatenate(sizes), np.concatenate(counts), np.concatenate(numbers, axis=1)


def swarm_incidence(
    robots: pl.DataFrame,
    runs: pl.DataFrame,
    t_end_s: float,
    times_s: ArrayLike | None = None,
    level: float = 0.95,
) -> pl.DataFrame:
    """Compute the shares of runs with a right consensus, a wrong consensus, or no consensus by each time.

    Args:
        robots, runs: tables of a result. t_end_s: end of the runs, s.
        times_s: at which shares are computed, s; by default the grid of ``time_grid``.
        level: confidence level of the limits.
    Returns: one row per time: time_s, and ``right``, ``wrong``, ``open``, each with Wilson's limits ``_low`` and
        ``_high``. ``open`` is the share of runs without consensus yet, or with split decisions. Right and wrong are
        shares of the runs with a truth; null if there are no such runs.
    """
    table = _sized(robots, runs, t_end_s)
    times = time_grid(t_end_s, times_s)
    with_truth = table["truth"].count()
    with_consensus = table.filter(pl.col("consensus_time_s").is_not_null())
    columns = {"time_s": times}
    for name, outcomes, n in (
        ("right", ("right",), with_truth),
        ("wrong", ("wrong",), with_truth),
        ("open", ("right", "wrong", "truth_undefined"), table.height),
    ):
        reached = with_consensus.filter(pl.col("consensus").cast(pl.String).is_in(outcomes))
        reached_s = np.sort(reached["consensus_time_s"].to_numpy())
        count = np.searchsorted(reached_s, times, side="right").astype(np.float64)
        # Open runs are all runs except those with a consensus of any kind, which ``count`` has counted.
        count = n - count if name == "open" else count
        low, high = wilson_limits(count, n, level)
        share = count / n if n else np.full(times.size, np.nan)
        columns |= {name: share, f"{name}_low": low, f"{name}_high": high}
    return pl.DataFrame(columns).fill_nan(None)
