"""Compute the cumulative incidence of right and wrong decisions, of robots and of swarms, over time.

No observation is censored before t_end, so it is the share that has (finally) decided by each time. Limits hold at each
time by itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.statistics.intervals import Values, cluster_shares, wilson_limits

POINTS = 121
"""Number of times in the default grid from 0 to t_end."""
Limits = Callable[[Values, Values, float], tuple[Values, Values, Values]]
"""Shares and their limits at each time, from counts, (times, runs), of sizes, (runs,)."""


def robot_incidence(
    robots: pl.DataFrame,
    runs: pl.DataFrame,
    t_end_s: float,
    times_s: ArrayLike | None = None,
    level: float = 0.95,
) -> pl.DataFrame:
    """Compute the shares of robots that had decided right, decided wrong, or not decided by each time.

    Right and wrong are shares of the robots in runs with a truth, null without. Limits: ``intervals.cluster_shares``.
    """
    rows = robots.select("run", "decision", time_s="decision_time_s").join(
        runs.select("run", "truth"), on="run", maintain_order="left"
    )
    decided, is_truth = rows["decision"] != -1, rows["decision"] == rows["truth"]
    outcomes = {"right": decided & is_truth, "wrong": decided & ~is_truth, "undecided": decided}
    return _incidence(rows, outcomes, t_end_s, times_s, cluster_shares, level)


def swarm_incidence(
    robots: pl.DataFrame,
    runs: pl.DataFrame,
    t_end_s: float,
    times_s: ArrayLike | None = None,
    level: float = 0.95,
) -> pl.DataFrame:
    """Compute the shares of runs with a right consensus, a wrong consensus, or ``open`` by each time.

    Right and wrong are shares of the runs with a truth, null without. Limits are Wilson's.
    """
    rows = runs.select("run", "truth", time_s="consensus_time_s")
    ended = runs["consensus"].cast(pl.String)
    reached = ended.is_in(["right", "wrong", "truth_undefined"])
    outcomes = {"right": ended == "right", "wrong": ended == "wrong", "open": reached}
    return _incidence(rows, outcomes, t_end_s, times_s, _wilson_shares, level)


def _wilson_shares(counts: Values, sizes: Values, level: float) -> tuple[Values, Values, Values]:
    count, n = counts.sum(axis=-1), sizes.sum()
    with np.errstate(invalid="ignore"):  # 0 / 0 without runs
        return count / n, *wilson_limits(count, n, level)


def _incidence(
    rows: pl.DataFrame,
    outcomes: dict[str, pl.Series],
    t_end_s: float,
    times_s: ArrayLike | None,
    limits: Limits,
    level: float,
) -> pl.DataFrame:
    """Return shares by each time; of the last outcome the share without it, of all runs."""
    times = np.linspace(0.0, t_end_s, POINTS) if times_s is None else np.asarray(times_s, dtype=np.float64)
    run = np.unique(rows["run"].to_numpy(), return_inverse=True)[1]
    runs, at = int(run.max(initial=-1)) + 1, np.searchsorted(times, rows["time_s"].to_numpy())
    has_truth = rows["truth"].is_not_null().to_numpy()
    columns: dict[str, NDArray[np.float64]] = {"time_s": times}
    for name, outcome in outcomes.items():
        is_last = name not in ("right", "wrong")
        sizes = np.bincount(run[has_truth | is_last], minlength=runs).astype(np.float64)
        has_it = outcome.fill_null(False).to_numpy() & (has_truth | is_last)
        entered = np.bincount(at[has_it] * runs + run[has_it], minlength=(times.size + 1) * runs)
        counts = entered.reshape(times.size + 1, runs).cumsum(axis=0)[:-1].astype(np.float64)
        shares = limits(sizes - counts if is_last else counts, sizes, level)
        columns |= {f"{name}{end}": found for end, found in zip(("", "_low", "_high"), shares, strict=True)}
    return pl.DataFrame(columns).fill_nan(None)
