"""Compute how many robots are needed, and for how long, to keep misses and false alarms below wanted rates.

| name | what it is | limits |
|---|---|---|
| horizon | a time since the start of the run, s | |
| missed | share of runs without a right consensus by the horizon | Wilson |
| wrong | share of runs with a wrong consensus by the horizon | Wilson |
| false_alarm | wrong, on a floor below the boundary: the swarm decides "more" although it is less | Wilson |
| robots_missed | share of robots that had not decided right by the horizon | cluster bootstrap over runs |
| robots_wrong | share of robots that had decided wrong by the horizon | cluster bootstrap over runs |
| robots_false_alarm | robots_wrong, on a floor below the boundary | cluster bootstrap over runs |
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
from typing import Any, Final, Literal

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.figures import Swarms
from vibroswarm.analysis.incidence import robot_incidence, swarm_incidence, time_grid
from vibroswarm.analysis.intervals import check_level, plain
from vibroswarm.errors import InputError, check_choice
from vibroswarm.inference.outcomes import numbers

Cells = Iterable[tuple[pl.DataFrame, pl.DataFrame]]
"""Table of robots and table of runs of each cell: runs of one scenario, with one number of robots."""

HORIZONS: Final = 6
"""Default number of horizons, evenly spaced up to t_end."""
GRID: Final = 481
"""Number of times at which ``needed`` evaluates robots, whose limits are bootstrapped."""


def detection_curve(
    cells: Cells,
    t_end_s: float,
    horizons_s: ArrayLike | None = None,
    level: float = 0.95,
    seed: int = 0,
) -> pl.DataFrame:
    """Tabulate misses and false alarms of each cell at each horizon.

    Args:
        cells: for each cell its table of robots and its table of runs. t_end_s: end of all runs, s.
        horizons_s: times up to ``t_end_s``, s; by default ``HORIZONS`` evenly spaced times.
        level: confidence level of the intervals. seed: seed of the bootstrap.
    Returns: one row per cell and horizon, sorted by robots, fill_ratio and horizon_s. Columns: fill_ratio, truth (1:
        above the boundary, 0: below, null: neither, or different in different runs), robots (number of robots in a
        run), runs (number of runs), horizon_s, and the shares missed, wrong, false_alarm, robots_missed, robots_wrong
        and robots_false_alarm, each with ``_low`` and ``_high``. All shares are null if no run has a truth; false
        alarms are null unless truth is 0.
    Raises:
        InputError: no cell, a cell whose runs have different numbers of robots, or a level that is not between 0 and 1.
    """
    # By default without a horizon at 0, when no robot has decided.
    horizons = time_grid(
        t_end_s, np.linspace(0, t_end_s, HORIZONS + 1)[1:] if horizons_s is None else horizons_s
    )
    frames = []
    for robots, runs in cells:
        of_swarm = swarm_incidence(robots, runs, t_end_s, horizons, level)
        of_robots = robot_incidence(robots, runs, t_end_s, horizons, level, seed)
        frame = pl.DataFrame({"horizon_s": horizons}).select(
            *(
                # A truth may be null, which would have no type.
                pl.lit(value, dtype=pl.Int8 if name == "truth" else None).alias(name)
                for name, value in _about(robots, runs, t_end_s).items()
            ),
            "horizon_s",
            *_missed(of_swarm, "missed"),
            *_wrong(of_swarm, "wrong"),
            *_missed(of_robots, "robots_missed"),
            *_wrong(of_robots, "robots_wrong"),
        )
        is_below = pl.col("truth") == 0
        false_alarms = [
            pl.when(is_below).then(pl.col(f"{unit}wrong{end}")).alias(f"{unit}false_alarm{end}")
            for unit in ("", "robots_")
            for end in ("", "_low", "_high")
        ]
        frames.append(frame.with_columns(false_alarms))
    if not frames:
        raise InputError("give at least one cell", field="cells")
    return pl.concat(frames).sort("robots", "fill_ratio", "horizon_s")


def _about(robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float) -> dict[str, Any]:
    """Return the columns that describe a cell: fill_ratio (mean over runs), truth, robots (of each run) and runs.

    Raises:
        InputError: the runs have different numbers of robots, or there are no runs.
    """
    sizes = np.unique(Swarms.of_tables(robots, runs, t_end_s).count)
    if sizes.size != 1:
        raise InputError("all runs of a cell must have the same number of robots", field="cells")
    fills, truths = runs["fill_ratio"], runs["truth"]
    has_one_truth = truths.n_unique() == 1 and truths.null_count() == 0
    return {
        # Exactly the value if all are equal, since cells are grouped by it.
        "fill_ratio": float(fills[0] if fills.n_unique() == 1 else fills.mean()),  # type: ignore[arg-type]
        "truth": int(truths[0]) if has_one_truth else None,
        "robots": int(sizes[0]),
        "runs": runs.height,
    }


def _missed(frame: pl.DataFrame, name: str) -> list[pl.Series]:
    """Return the share of misses, which is 1 - the share ``right``, and its limits as three columns."""
    return [
        (1.0 - frame["right"]).alias(name),
        (1.0 - frame["right_high"]).alias(f"{name}_low"),
        (1.0 - frame["right_low"]).alias(f"{name}_high"),
    ]


def _wrong(frame: pl.DataFrame, name: str) -> list[pl.Series]:
    return [frame[f"wrong{end}"].alias(f"{name}{end}") for end in ("", "_low", "_high")]


def needed(
    cells: Cells,
    t_end_s: float,
    error: float,
    of: Literal["swarm", "robots"] = "swarm",
    level: float = 0.95,
    seed: int = 0,
    false_alarms: float | None = None,
) -> pl.DataFrame:
    """Compute for each cell the first time at which the upper limit of its misses is below ``error``.

    Args:
        cells: for each cell its table of robots and its table of runs. t_end_s: end of all runs, s.
        error: wanted rate of misses, above 0 and below 1.
        of: "swarm": the rates are shares of runs, with consensus as the decision; "robots": shares of robots, computed
            only at ``GRID`` times since their limits are bootstrapped.
        level: confidence level of the limits. seed: seed of the bootstrap.
        false_alarms: wanted rate of false alarms; by default ``error``.
    Returns: one row per cell, sorted by fill_ratio and robots. Columns: fill_ratio, truth, robots, runs; needed_s, the
        time (null: none by t_end); missed and missed_high, the share of misses at t_end and its upper limit; fewest,
        whether this cell has the smallest number of robots, of the cells of its fill ratio that have a needed_s.
        Columns that are null unless truth is 0:
        false_alarm and false_alarm_high, the share of false alarms at t_end and its upper limit; clear_until_s, the
        first time at which this limit is too high (0: from the start; null: never by t_end).
    Raises:
        InputError: no cell, a cell whose runs have different numbers of robots, a rate or level that is not between 0
            and 1, or ``of`` is neither swarm nor robots.
    """
    check_level(level)
    alarm_rate = error if false_alarms is None else false_alarms
    for name, value in (("error", error), ("false_alarms", alarm_rate)):
        if not 0.0 < value < 1.0:
            raise InputError(f"{value!r} is not a rate between 0 and 1; give one such as 0.05", field=name)
    check_choice(of, "of", ("swarm", "robots"))
    rows = []
    for robots, runs in cells:
        row = _about(robots, runs, t_end_s)
        shares = _over_time(robots, runs, t_end_s, of, level, seed)
        row |= _needed(shares, error)
        row |= _clear(shares, alarm_rate) if row["truth"] == 0 else dict.fromkeys(_ALARM)
        rows.append(row)
    if not rows:
        raise InputError("give at least one cell", field="cells")
    integers = {"truth": pl.Int8, "robots": pl.Int64, "runs": pl.Int64}
    floats = dict.fromkeys(("needed_s", "missed", "missed_high", *_ALARM), pl.Float64)
    frame = pl.DataFrame(rows, schema={"fill_ratio": pl.Float64, **integers, **floats})
    # Number of robots of a cell that reaches the wanted rate; null for other cells.
    enough = pl.when(pl.col("needed_s").is_not_null()).then(pl.col("robots"))
    fewest = (enough == enough.min().over("fill_ratio")).fill_null(False)
    return frame.with_columns(fewest=fewest).sort("fill_ratio", "robots")


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
    both = above.join(below, on="robots")
    clear = pl.col("clear_until_s").is_null() | (pl.col("needed_s") < pl.col("clear_until_s"))
    both = both.with_columns(time_s=pl.when(clear).then(pl.col("needed_s")))
    # Number of robots that distinguishes the two floors; null for a number that does not.
    enough = pl.when(pl.col("time_s").is_not_null()).then(pl.col("robots"))
    fewest = (enough == enough.min().over("fill_ratio", "fill_ratio_below")).fill_null(False)
    chosen = both.with_columns(fewest=fewest).select(
        "fill_ratio", "fill_ratio_below", "robots", "time_s", "fewest"
    )
    return chosen.sort("fill_ratio", "fill_ratio_below", "robots")


_ALARM: Final = ("false_alarm", "false_alarm_high", "clear_until_s")
"""Columns that are null unless the floor lies below the boundary."""


def _over_time(
    robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, of: str, level: float, seed: int
) -> pl.DataFrame:
    """Return the cumulative shares of runs with a right and with a wrong consensus, or of robots that decided so.

    Args:
        of: "swarm" or "robots". level, seed: as of ``needed``.
    Returns: a row for each time at which a run reaches a consensus; of robots at ``GRID`` times.
    """
    if of == "robots":
        return robot_incidence(robots, runs, t_end_s, np.linspace(0.0, t_end_s, GRID), level, seed)
    reached_s = runs["consensus_time_s"].drop_nulls().to_numpy()
    return swarm_incidence(robots, runs, t_end_s, np.unique(np.append(0.0, reached_s)), level)


def _needed(shares: pl.DataFrame, error: float) -> dict[str, float | None]:
    """Find the first time at which the upper limit of the misses is below ``error``, and the misses at the end."""
    missed, missed_high = (1.0 - numbers(shares[name]) for name in ("right", "right_low"))
    return {
        "needed_s": _first_time(shares, missed_high < error),
        "missed": plain(float(missed[-1])),
        "missed_high": plain(float(missed_high[-1])),
    }


def _clear(shares: pl.DataFrame, wanted: float) -> dict[str, float | None]:
    """Find the first time at which the upper limit of the false alarms is not below the rate ``wanted``.

    Returns: clear_until_s, the time (None if there is none), and false_alarm and false_alarm_high, the share of false
        alarms and its upper limit at the end.
    """
    wrong, wrong_high = (numbers(shares[name]) for name in ("wrong", "wrong_high"))
    return {
        "false_alarm": plain(float(wrong[-1])),
        "false_alarm_high": plain(float(wrong_high[-1])),
        # negated, so that a limit of nan counts as too high
        "clear_until_s": _first_time(shares, ~(wrong_high < wanted)),
    }


def _first_time(shares: pl.DataFrame, holds: NDArray[np.bool_]) -> float | None:
    return float(shares["time_s"][int(holds.argmax())]) if holds.any() else None
