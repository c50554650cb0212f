"""Compute how many robots are needed, and for how long, to keep misses and false alarms below wanted rates.

| name | what it is | limits |
|---|---|---|
| missed | share of runs without a right consensus by the horizon | Wilson |
| wrong | share of runs with a wrong consensus by then | Wilson |
| false alarm | a wrong consensus on a floor below the boundary: the swarm says "more", and it is not so | Wilson |
| robots_missed | share of robots that had not decided right by then | cluster bootstrap over runs |
| robots_wrong, robots_false_alarm | share that had decided wrong; that on floors below the boundary | the same |
| needed | the first time at which the upper limit of the misses lies below the wanted error | |
| clear until | the time from which on the upper limit of the false alarms is no longer below what is wanted | |

A miss is not an error made: undecided counts as missed. Misses fall with time and false alarms rise, so a floor above
the boundary and one below it are distinguished as wanted at a time T with needed <= T < clear until: the first is T =
needed. All upper limits are taken, not the estimates: with too few runs (fewer than about 73 for 5 % at the level of
95 %) nothing is enough. Each limit holds by itself; both of a pair together hold at twice the error of the level.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.cell_summary import run_figures
from vibroswarm.analysis.incidence import robot_incidence, swarm_incidence, time_grid
from vibroswarm.analysis.intervals import check_level, plain, wilson_limits
from vibroswarm.errors import InputError

Cells = Iterable[tuple[pl.DataFrame, pl.DataFrame]]
"""Tables of robots and of runs of each cell, one scenario's runs; fill ratio and number of robots stand in them."""

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
    """Tabulate misses against the fill ratio at each horizon; one row for each cell and horizon.

    Args:
        cells: tables ``robots`` and ``runs`` of each. t_end_s: end of their runs, s. horizons_s: times, s, up to it.
        level: of the intervals. seed: of the bootstrap.
    Returns: fill_ratio, truth (1: above the boundary), robots, runs, horizon_s, and missed, wrong, false_alarm,
        robots_missed, robots_wrong, robots_false_alarm, each with ``_low`` and ``_high``; null where no decision is
        right, false alarms also above the boundary.
    """
    horizons = time_grid(
        t_end_s, np.linspace(0, t_end_s, HORIZONS + 1)[1:] if horizons_s is None else horizons_s
    )
    frames = []
    for robots, runs in cells:
        swarm = swarm_incidence(robots, runs, t_end_s, horizons, level)
        each = robot_incidence(robots, runs, t_end_s, horizons, level, seed)
        frames.append(
            pl.DataFrame({"horizon_s": horizons}).select(
                *(pl.lit(value).alias(name) for name, value in _about(robots, runs, t_end_s).items()),
                "horizon_s",
                *_missed(swarm, "missed"),
                *_same(swarm, "wrong"),
                *_missed(each, "robots_missed"),
                *_same(each, "robots_wrong"),
            )
        )
        below = pl.col("truth") == 0
        frames[-1] = frames[-1].with_columns(
            pl.when(below).then(pl.col(f"{unit}wrong{end}")).alias(f"{unit}false_alarm{end}")
            for unit in ("", "robots_")
            for end in ("", "_low", "_high")
        )
    if not frames:
        raise InputError("give at least one cell", field="cells")
    return pl.concat(frames).sort("robots", "fill_ratio", "horizon_s")


def _about(robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float) -> dict[str, Any]:
    """Return fill ratio, truth, number of robots and number of runs of a cell."""
    sizes = run_figures(robots, runs, t_end_s)["robots"].unique()
    if sizes.len() != 1:
        raise InputError("a cell is of one scenario, with one number of robots", field="cells")
    return {
        "fill_ratio": _fill_ratio(runs["fill_ratio"]),
        "truth": _truth(runs["truth"]),
        "robots": int(sizes[0]),
        "runs": runs.height,
    }


def _fill_ratio(fills: pl.Series) -> float:
    """Return the mean, or exactly the value if all are equal."""
    return float(fills[0] if fills.n_unique() == 1 else fills.mean())  # type: ignore[arg-type]


def _truth(truths: pl.Series) -> int | None:
    """Return the truth of all runs; None if it differs between runs or no decision is right."""
    return int(truths[0]) if truths.n_unique() == 1 and truths.null_count() == 0 else None


def _missed(frame: pl.DataFrame, name: str) -> list[pl.Series]:
    """Return the share of misses with limits: 1 - the share of right decisions."""
    return [
        (1.0 - frame["right"]).alias(name),
        (1.0 - frame["right_high"]).alias(f"{name}_low"),
        (1.0 - frame["right_low"]).alias(f"{name}_high"),
    ]


def _same(frame: pl.DataFrame, name: str) -> list[pl.Series]:
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
    """Compute how long each cell needs until the upper limit of its misses is below ``error``.

    Args:
        t_end_s: end of the runs, s. error: the wanted probability of a miss.
        of: of a right consensus, or of a robot that has decided right (then to the next of 481 times).
        false_alarms: the wanted probability of a false alarm; without, ``error``.
    Returns: fill_ratio, truth, robots, runs, needed_s (null: not by t_end), missed and missed_high at t_end, and
        ``fewest``: whether no cell of this fill ratio gets there with fewer robots; of floors below the boundary
        false_alarm and false_alarm_high at t_end, and clear_until_s (null: to the end; 0: never); by fill ratio and
        robots.
    Raises:
        InputError: an error or level outside 0 to 1, neither swarm nor robots.
    """
    check_level(level)
    alarm_rate = error if false_alarms is None else false_alarms
    for name, value in (("error", error), ("false_alarms", alarm_rate)):
        if not 0.0 < value < 1.0:
            raise InputError(f"{value!r} is not an error to aim at; give a share such as 0.05", field=name)
    if of not in ("swarm", "robots"):
        raise InputError(f"'{of}' cannot miss; swarm or robots", field="of")
    rows = []
    for robots, runs in cells:
        row = _about(robots, runs, t_end_s)
        events = _swarm_events if of == "swarm" else _robot_events
        right, wrong = events(robots, runs, t_end_s, level, seed)
        row |= _first_below(right, error)
        row |= _clear(wrong, alarm_rate) if row["truth"] == 0 else dict.fromkeys(_ALARM)
        rows.append(row)
    if not rows:
        raise InputError("give at least one cell", field="cells")
    integers = {"truth": pl.Int8, "robots": pl.Int64, "runs": pl.Int64}
    shares = dict.fromkeys(("needed_s", "missed", "missed_high", *_ALARM), pl.Float64)
    frame = pl.DataFrame(rows, schema={"fill_ratio": pl.Float64, **integers, **shares})
    enough = pl.when(pl.col("needed_s").is_not_null()).then(pl.col("robots"))
    fewest = (enough == enough.min().over("fill_ratio")).fill_null(False)
    return frame.with_columns(fewest=fewest).sort("fill_ratio", "robots")


def pairs(found: pl.DataFrame) -> pl.DataFrame:
    """Compute when a floor above the boundary is distinguished from one below it at the wanted error rates.

    Args:
        found: of ``needed``.
    Returns: fill_ratio (above), fill_ratio_below, robots, time_s (null: not by the end, or only with more false
        alarms), fewest (whether no fewer robots do it); a row for each two floors and number of robots.
    """
    above = found.filter(pl.col("truth") == 1).select("fill_ratio", "robots", "needed_s")
    below = found.filter(pl.col("truth") == 0).select(
        "robots", "clear_until_s", fill_ratio_below="fill_ratio"
    )
    both = above.join(below, on="robots")
    clear = pl.col("clear_until_s").is_null() | (pl.col("needed_s") < pl.col("clear_until_s"))
    both = both.with_columns(time_s=pl.when(clear).then(pl.col("needed_s")))
    enough = pl.when(pl.col("time_s").is_not_null()).then(pl.col("robots"))
    fewest = (enough == enough.min().over("fill_ratio", "fill_ratio_below")).fill_null(False)
    chosen = both.with_columns(fewest=fewest).select(
        "fill_ratio", "fill_ratio_below", "robots", "time_s", "fewest"
    )
    return chosen.sort("fill_ratio", "fill_ratio_below", "robots")


_ALARM: Final = ("false_alarm", "false_alarm_high", "clear_until_s")


class _Events(NamedTuple):
    """A cumulative share: increasing times, and the share from each time on, with its limits.

    All are of shape (times,), the first time being 0.
    """

    time_s: NDArray[np.float64]
    share: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def _swarm_events(
    robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, level: float, seed: int
) -> tuple[_Events, _Events]:
    """Compute the shares of right and wrong consensus at each time at which one is reached."""
    table = run_figures(robots, runs, t_end_s).filter(pl.col("truth").is_not_null())
    n, events = table.height, []
    for outcome in ("right", "wrong"):
        at = np.sort(table.filter(pl.col("consensus") == outcome)["consensus_time_s"].to_numpy())
        count = np.arange(at.size + 1)
        low, high = wilson_limits(count, n, level)
        share = count / n if n else np.full(count.size, np.nan)
        events.append(_Events(np.append(0.0, at), share, low, high))
    return events[0], events[1]


def _robot_events(
    robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, level: float, seed: int
) -> tuple[_Events, _Events]:
    """Compute the shares of robots that had decided right, and wrong, on an even grid of times."""
    times = np.linspace(0.0, t_end_s, GRID)
    table = robot_incidence(robots, runs, t_end_s, times, level, seed)
    events = [
        _Events(times, *(table[f"{name}{end}"].fill_null(np.nan).to_numpy() for end in ("", "_low", "_high")))
        for name in ("right", "wrong")
    ]
    return events[0], events[1]


def _first_below(right: _Events, error: float) -> dict[str, float | None]:
    """Find when the upper limit of the misses first is below ``error`` (None: never), and the misses at the end."""
    enough = np.flatnonzero(1.0 - right.low < error)
    return {
        "needed_s": float(right.time_s[enough[0]]) if enough.size else None,
        "missed": plain(1.0 - float(right.share[-1])),
        "missed_high": plain(1.0 - float(right.low[-1])),
    }


def _clear(wrong: _Events, wanted: float) -> dict[str, float | None]:
    """Find until when the upper limit of false alarms is below ``wanted`` (None: to the end), and those at the end."""
    over = np.flatnonzero(~(wrong.high < wanted))
    return {
        "false_alarm": plain(float(wrong.share[-1])),
        "false_alarm_high": plain(float(wrong.high[-1])),
        "clear_until_s": float(wrong.time_s[over[0]]) if over.size else None,
    }
