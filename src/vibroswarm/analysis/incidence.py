"""Compute the cumulative incidence of right and wrong decisions, of robots and of swarms.

Runs go to t_end or stop when all robots have decided: there is no censoring before t_end, and the cumulative incidence
is a plain share. A robot that revises its decision counts at its final one. Limits are pointwise.
"""

from __future__ import annotations

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.cell_summary import run_figures
from vibroswarm.analysis.intervals import check_level, cluster_share_of_distinct, wilson_limits

POINTS = 121
"""Number of times in the default grid from 0 to t_end."""


def time_grid(t_end_s: float, times_s: ArrayLike | None) -> NDArray[np.float64]:
    """Return the given times, or an even grid from 0 to t_end, s."""
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
    """Compute the shares of robots that had decided right, wrong, or not yet at each time; limits over runs.

    Args:
        robots, runs: tables of a result. t_end_s: end of the runs, s. times_s: when, s; without, a grid up to the end.
        level: of the limits. seed: of the bootstrap.
    Returns: time_s, and ``right``, ``wrong``, ``undecided``, each with ``_low`` and ``_high``; one row per time. Right
    and wrong are of the runs whose truth is known, null where there are none.
    """
    table = run_figures(robots, runs, t_end_s)
    times = time_grid(t_end_s, times_s)
    known = table.filter(pl.col("truth").is_not_null())
    with_truth = robots.join(table.select("run", "truth"), on="run")
    decided = pl.col("decision") != -1
    parts = {
        "right": (known, decided & (pl.col("decision") == pl.col("truth"))),
        "wrong": (known, decided & (pl.col("decision") != pl.col("truth"))),
        "undecided": (table, decided),
    }
    columns: dict[str, NDArray[np.float64]] = {"time_s": times}
    for name, (table_of, which) in parts.items():
        counted = _counts_over_time(with_truth.filter(which), table_of, times)
        if name == "undecided":
            counted = [(size, size - count, number) for size, count, number in counted]
        limits = _limits(counted, times.size, level, seed)
        columns |= {name: limits[:, 0], f"{name}_low": limits[:, 1], f"{name}_high": limits[:, 2]}
    return pl.DataFrame(columns).fill_nan(None)


Counted = list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]]
"""For each time: robots of a run, how many of them decided, and the number of such runs; each (distinct,)."""


def _counts_over_time(decided: pl.DataFrame, of: pl.DataFrame, times: NDArray[np.float64]) -> Counted:
    """Count, for each time, in how many runs how many robots had decided.

    At least k robots of a run decided by t if its k-th decision time is at most t: one search for each k, without a
    table of runs by times."""
    ranked = (
        decided.lazy()
        .join(of.lazy().select("run", size="robots"), on="run")
        .sort("run", "decision_time_s")
        .select("size", "decision_time_s", rank=pl.int_range(1, pl.len() + 1).over("run"))
        .collect()
    )
    counted: list[list[tuple[int, int, int]]] = [[] for _ in times]
    for size, number in of.group_by("robots").len().sort("robots").iter_rows():
        at_least = np.zeros((times.size, size + 2), dtype=np.int64)
        at_least[:, 0] = number
        of_size = ranked.filter(pl.col("size") == size)
        for k in range(1, size + 1):
            kth = np.sort(of_size.filter(pl.col("rank") == k)["decision_time_s"].to_numpy())
            at_least[:, k] = np.searchsorted(kth, times, side="right")
        exactly = at_least[:, :-1] - at_least[:, 1:]
        for t in range(times.size):
            counted[t] += [(size, k, int(exactly[t, k])) for k in range(size + 1)]
    return [
        (rows[:, 0], rows[:, 1], rows[:, 2])
        for rows in (np.array(c, dtype=np.int64).reshape(-1, 3) for c in counted)
    ]


def _limits(counted: Counted, times: int, level: float, seed: int) -> NDArray[np.float64]:
    """Compute estimate, low and high at each time, shape (times, 3)."""
    limits = np.full((times, 3), np.nan)
    for t, (size, count, number) in enumerate(counted):
        limits[t] = cluster_share_of_distinct(count, size, number, level, seed)[:3]
    return limits


def swarm_incidence(
    robots: pl.DataFrame,
    runs: pl.DataFrame,
    t_end_s: float,
    times_s: ArrayLike | None = None,
    level: float = 0.95,
) -> pl.DataFrame:
    """Compute the shares of runs that had a right consensus, a wrong one, or none at each time; Wilson's limits.

    Args and returns: as ``robot_incidence``, with ``open`` (no consensus yet, or split) in place of ``undecided``.
    """
    check_level(level)
    table = run_figures(robots, runs, t_end_s)
    times = time_grid(t_end_s, times_s)
    known = table["truth"].count()
    together = table.filter(pl.col("consensus_time_s").is_not_null())
    columns = {"time_s": times}
    for name, outcomes, n in (
        ("right", ("right",), known),
        ("wrong", ("wrong",), known),
        ("open", ("right", "wrong", "truth_undefined"), table.height),
    ):
        reached = together.filter(pl.col("consensus").cast(pl.String).is_in(outcomes))
        at = np.sort(reached["consensus_time_s"].to_numpy())
        count = np.searchsorted(at, times, side="right").astype(np.float64)
        count = n - count if name == "open" else count
        low, high = wilson_limits(count, n, level)
        share = count / n if n else np.full(times.size, np.nan)
        columns |= {name: share, f"{name}_low": low, f"{name}_high": high}
    return pl.DataFrame(columns).fill_nan(None)
