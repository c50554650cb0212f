"""How many robots, and for how long, for a wanted error: from cells of different fill ratios and swarm sizes.

| name | what it is | limits |
|---|---|---|
| missed | share of runs without a right consensus by the horizon | Wilson |
| wrong | share of runs with a wrong consensus by then | Wilson |
| robots_missed | share of robots that had not decided right by then | cluster bootstrap over runs |
| robots_wrong | share that had decided wrong | cluster bootstrap over runs |
| needed | the first time at which the upper limit of the miss lies below the wanted error | |

A miss is not an error made: undecided counts as missed. "Needed" takes the upper limit, not the estimate: with too few
runs (fewer than about 73 for 5 % at the level of 95 %) nothing is enough.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Final, Literal

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from vibroswarm.analysis.incidence import robot_incidence, swarm_incidence, time_grid
from vibroswarm.analysis.intervals import check_level, plain, wilson_limits
from vibroswarm.analysis.per_run import run_figures
from vibroswarm.errors import InputError

Cells = Iterable[tuple[pl.DataFrame, pl.DataFrame]]
"""Tables of robots and of runs of each cell, one scenario's runs; fill ratio and number of robots stand in them."""

HORIZONS: Final = 6
"""Even parts of t_end at which misses are told where no horizons are given."""
GRID: Final = 481
"""Times that ``needed`` looks at for robots, whose limits are drawn."""


def detection_curve(
    cells: Cells,
    t_end_s: float,
    horizons_s: ArrayLike | None = None,
    level: float = 0.95,
    seed: int = 0,
) -> pl.DataFrame:
    """Misses against the fill ratio at each horizon; a row a cell and horizon, by robots, fill ratio, horizon.

    Args:
        cells: tables ``robots`` and ``runs`` of each. t_end_s: end of their runs, s. horizons_s: times, s, up to it.
        level: of the intervals. seed: of the bootstrap.
    Returns: fill_ratio, robots, runs, horizon_s, and missed, wrong, robots_missed, robots_wrong, each with ``_low``
        and ``_high``; null where no decision is right.
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
    if not frames:
        raise InputError("give at least one cell", field="cells")
    return pl.concat(frames).sort("robots", "fill_ratio", "horizon_s")


def _about(robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float) -> dict[str, Any]:
    sizes = run_figures(robots, runs, t_end_s)["robots"].unique()
    if sizes.len() != 1:
        raise InputError("a cell is of one scenario, with one number of robots", field="cells")
    return {
        "fill_ratio": _fill_ratio(runs["fill_ratio"]),
        "robots": int(sizes[0]),
        "runs": runs.height,
    }


def _fill_ratio(fills: pl.Series) -> float:
    """The mean, and just the value where all are equal."""
    return float(fills[0] if fills.n_unique() == 1 else fills.mean())  # type: ignore[arg-type]


def _missed(frame: pl.DataFrame, name: str) -> list[pl.Series]:
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
) -> pl.DataFrame:
    """How long each cell needs until the upper limit of its miss lies below ``error``.

    Args:
        t_end_s: end of the runs, s. error: the wanted probability of a miss.
        of: of a right consensus, or of a robot that has decided right (then to the next of 481 times).
    Returns: fill_ratio, robots, runs, needed_s (null: not by t_end), missed and missed_high at t_end, and ``fewest``:
        whether no cell of this fill ratio gets there with fewer robots; by fill ratio and robots.
    Raises:
        InputError: an error or level outside 0 to 1, neither swarm nor robots.
    """
    check_level(level)
    if not 0.0 < error < 1.0:
        raise InputError(f"{error!r} is no error to aim at; give a share such as 0.05", field="error")
    if of not in ("swarm", "robots"):
        raise InputError(f"'{of}' cannot miss; swarm or robots", field="of")
    rows = []
    for robots, runs in cells:
        find = _swarm_needs if of == "swarm" else _robots_need
        needed_s, missed, high = find(robots, runs, t_end_s, error, level, seed)
        found = {"needed_s": plain(needed_s), "missed": plain(missed), "missed_high": plain(high)}
        rows.append(_about(robots, runs, t_end_s) | found)
    if not rows:
        raise InputError("give at least one cell", field="cells")
    schema = {"fill_ratio": pl.Float64, "robots": pl.Int64, "runs": pl.Int64, "needed_s": pl.Float64}
    frame = pl.DataFrame(rows, schema=schema | {"missed": pl.Float64, "missed_high": pl.Float64})
    enough = pl.when(pl.col("needed_s").is_not_null()).then(pl.col("robots"))
    fewest = (enough == enough.min().over("fill_ratio")).fill_null(False)
    return frame.with_columns(fewest=fewest).sort("fill_ratio", "robots")


Found = tuple[float, float, float]
"""Time needed (infinite: never), and the miss at t_end with its upper limit."""


def _swarm_needs(
    robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, error: float, level: float, seed: int
) -> Found:
    """Exactly: the time of that right consensus which is the k-th, with the least k whose limit is low enough."""
    table = run_figures(robots, runs, t_end_s).filter(pl.col("truth").is_not_null())
    n = table.height
    if n == 0:
        return math.inf, math.nan, math.nan
    at = np.sort(table.filter(pl.col("consensus") == "right")["consensus_time_s"].to_numpy())
    _, high = wilson_limits(n - np.arange(at.size + 1), n, level)
    enough = np.flatnonzero(high < error)
    needed_s = math.inf
    if enough.size:
        needed_s = float(at[enough[0] - 1]) if enough[0] else 0.0
    return needed_s, 1.0 - at.size / n, float(high[-1])


def _robots_need(
    robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, error: float, level: float, seed: int
) -> Found:
    times = np.linspace(0.0, t_end_s, GRID)
    right = robot_incidence(robots, runs, t_end_s, times, level, seed)
    missed, high = (1.0 - right[name].fill_null(np.nan).to_numpy() for name in ("right", "right_low"))
    enough = np.flatnonzero(high < error)
    return float(times[enough[0]]) if enough.size else math.inf, float(missed[-1]), float(high[-1])
