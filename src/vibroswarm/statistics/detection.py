"""Compute how many robots are needed, and for how long, to keep misses and false alarms below wanted rates.

| name | what it is | limits |
|---|---|---|
| horizon | a time since the start of the run, s | |
| missed | share of runs without a right consensus by the horizon | Wilson |
| wrong | share of runs with a wrong consensus by the horizon | Wilson |
| false_alarm | wrong, on a floor below the boundary: the swarm decides "more" although it is less | Wilson |
| robots_missed | share of robots that had not decided right by the horizon | ``cluster_share`` |
| robots_wrong | share of robots that had decided wrong by the horizon | ``cluster_share`` |
| robots_false_alarm | robots_wrong, on a floor below the boundary | ``cluster_share`` |
| needed | the first time at which the upper limit of the misses is below the wanted rate of misses | |
| clear until | the first time at which the upper limit of the false alarms is not below their wanted rate | |

An undecided run or robot counts as missed, although it made no error. Misses fall with time and false alarms rise. So a
floor above the boundary and a floor below it are distinguished at the wanted rates between two times: "needed" of the
floor above, and "clear until" of the floor below. The upper limits are compared with the wanted rates, not the
estimates: with few runs (fewer than about 73 for a rate of 5 % at a level of 95 %) the limits never fall below the
wanted rate. Each limit by itself is wrong with probability 1 - level. The time of a pair of floors rests on two limits;
the probability that at least one of the two is wrong is up to 2 (1 - level).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.inference.outcomes import numbers
from vibroswarm.statistics.incidence import robot_incidence, swarm_incidence

Cells = Iterable[tuple[pl.DataFrame, pl.DataFrame]]
"""Table of robots and table of runs of each cell: runs of one scenario, with one number of robots."""

HORIZONS: Final = 6
"""Default number of horizons, evenly spaced up to t_end."""
ABOUT: Final[dict[str, Any]] = {
    "fill_ratio": pl.Float64,
    "truth": pl.Int8,
    "robots": pl.Int64,
    "runs": pl.Int64,
}
"""Columns that describe a cell."""
NEEDED: Final = ABOUT | dict.fromkeys(
    ("needed_s", "missed", "missed_high", "false_alarm", "false_alarm_high", "clear_until_s"), pl.Float64
)


def detection_curve(
    cells: Cells,
    t_end_s: float,
    horizons_s: ArrayLike | None = None,
    level: float = 0.95,
) -> pl.DataFrame:
    """Tabulate misses and false alarms of each cell at each horizon.

    Args:
        cells: for each cell its table of robots and its table of runs. t_end_s: end of all runs, s.
        horizons_s: times up to ``t_end_s``, s; by default ``HORIZONS`` evenly spaced times.
        level: confidence level of the intervals.
    Returns: one row per cell and horizon, sorted by robots, fill_ratio and horizon_s. Columns: fill_ratio, truth (1:
        above the boundary, 0: below, null: neither, or different in different runs), robots (number of robots in a
        run), runs (number of runs), horizon_s, and the shares missed, wrong, false_alarm, robots_missed, robots_wrong
        and robots_false_alarm, each with ``_low`` and ``_high``. All shares are null if no run has a truth; false
        alarms are null unless truth is 0.
    """
    # By default without a horizon at 0, when no robot has decided.
    horizons = np.linspace(0, t_end_s, HORIZONS + 1)[1:] if horizons_s is None else horizons_s
    frames = []
    for robots, runs in cells:
        about = _about(robots, runs)
        columns = [pl.lit(value, ABOUT[name]).alias(name) for name, value in about.items()]
        by_swarms = swarm_incidence(robots, runs, t_end_s, horizons, level)
        by_robots = robot_incidence(robots, runs, t_end_s, horizons, level)
        frame = by_swarms.select(*columns, horizon_s="time_s")
        for unit, shares in (("", by_swarms), ("robots_", by_robots)):
            for end, other in (("", ""), ("_low", "_high"), ("_high", "_low")):
                wrong = shares[f"wrong{end}"]
                alarm: pl.Series | pl.Expr = wrong if about["truth"] == 0 else pl.lit(None, pl.Float64)
                frame = frame.with_columns(
                    (1.0 - shares[f"right{other}"]).alias(f"{unit}missed{end}"),
                    wrong.alias(f"{unit}wrong{end}"),
                    alarm.alias(f"{unit}false_alarm{end}"),
                )
        frames.append(frame)
    return pl.concat(frames).sort("robots", "fill_ratio", "horizon_s")


def _about(robots: pl.DataFrame, runs: pl.DataFrame) -> dict[str, Any]:
    """Return the columns ``ABOUT`` of a cell; the fill ratio is the mean over runs."""
    fills, truths = runs["fill_ratio"], runs["truth"]
    has_one_truth = truths.n_unique() == 1 and truths.null_count() == 0
    return {
        # Exactly the value if all are equal, since cells are grouped by it.
        "fill_ratio": fills[0] if fills.n_unique() == 1 else fills.mean(),
        "truth": truths[0] if has_one_truth else None,
        "robots": robots.height // runs.height,
        "runs": runs.height,
    }


def needed(
    cells: Cells,
    t_end_s: float,
    error: float,
    level: float = 0.95,
    false_alarms: float | None = None,
) -> pl.DataFrame:
    """Compute for each cell the first time at which the upper limit of its misses is below ``error``.

    Args:
        cells: for each cell its table of robots and its table of runs. t_end_s: end of all runs, s.
        error: wanted rate of misses, above 0 and below 1.
        level: confidence level of the limits.
        false_alarms: wanted rate of false alarms; by default ``error``.
    Returns: one row per cell, sorted by fill_ratio and robots. Columns: fill_ratio, truth, robots, runs; needed_s, the
        time (null: none by t_end); missed and missed_high, the share of misses at t_end and its upper limit; fewest,
        whether this cell has the smallest number of robots, of the cells of its fill ratio that have a needed_s.
        Columns that are null unless truth is 0:
        false_alarm and false_alarm_high, the share of false alarms at t_end and its upper limit; clear_until_s, the
        first time at which this limit is too high (0: from the start; null: never by t_end).
    """
    alarm_rate = error if false_alarms is None else false_alarms
    rows = []
    for robots, runs in cells:
        reached_s = runs["consensus_time_s"].drop_nulls().to_numpy()
        shares = swarm_incidence(robots, runs, t_end_s, np.unique(np.append(0.0, reached_s)), level)
        time_s, right, right_low, wrong, wrong_high = (
            numbers(shares[name]) for name in ("time_s", "right", "right_low", "wrong", "wrong_high")
        )
        row = _about(robots, runs) | {
            "needed_s": _first_time(time_s, 1.0 - right_low < error),
            "missed": 1.0 - right[-1],
            "missed_high": 1.0 - right_low[-1],
        }
        if row["truth"] == 0:
            row |= {"false_alarm": wrong[-1], "false_alarm_high": wrong_high[-1]}
            # negated, so that a limit of nan counts as too high
            row["clear_until_s"] = _first_time(time_s, ~(wrong_high < alarm_rate))
        rows.append(row)
    frame = pl.DataFrame(rows, schema=NEEDED).fill_nan(None)
    return frame.with_columns(_fewest("needed_s", "fill_ratio")).sort("fill_ratio", "robots")


def _first_time(time_s: NDArray[np.float64], holds: NDArray[np.bool_]) -> float | None:
    return float(time_s[holds.argmax()]) if holds.any() else None


def _fewest(time: str, *cells: str) -> pl.Expr:
    """Return whether this is the smallest number of robots that has a time, of the rows with the same ``cells``."""
    enough = pl.when(pl.col(time).is_not_null()).then("robots")
    return (enough == enough.min().over(*cells)).fill_null(False).alias("fewest")


def pairs(found: pl.DataFrame) -> pl.DataFrame:
    """Compute when a floor above the boundary is distinguished from a floor below it at the wanted rates.

    Args:
        found: table from ``needed``.
    Returns: one row for each pair of floors and each number of robots that both floors have in ``found``. Columns, by
        the first three of which the rows are sorted: fill_ratio (of the floor above the boundary), fill_ratio_below (of
        the floor below it), robots, time_s, and fewest (whether this is the smallest number of robots with a time_s,
        for these two floors). time_s is needed_s of the floor above the boundary; it is null unless that time is before
        clear_until_s of the floor below it (null there: never too many false alarms).
    """
    above = found.filter(pl.col("truth") == 1).select("fill_ratio", "robots", "needed_s")
    below = found.filter(pl.col("truth") == 0).select(
        "robots", "clear_until_s", fill_ratio_below="fill_ratio"
    )
    clear = pl.col("clear_until_s").is_null() | (pl.col("needed_s") < pl.col("clear_until_s"))
    both = above.join(below, on="robots").with_columns(time_s=pl.when(clear).then("needed_s"))
    floors = ("fill_ratio", "fill_ratio_below")
    return both.select(*floors, "robots", "time_s", _fewest("time_s", *floors)).sort(*floors, "robots")
