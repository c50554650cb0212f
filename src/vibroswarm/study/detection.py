"""Detection: how many robots, and how much time, for few misses and few false alarms.

| name | what it is | limits |
|---|---|---|
| horizon | a time since the start of the run, s | |
| missed | share of runs without a right consensus by the horizon, undecided ones too | Wilson |
| wrong | share of runs with a wrong consensus by the horizon | Wilson |
| false_alarm | wrong, on a floor below the boundary: the swarm decides "more" although it is less | Wilson |
| robots_... | the same shares of robots | ``cluster_share`` |
| needed | the first time at which the upper limit of the misses is below the wanted rate of misses | |
| clear until | the first time at which the upper limit of the false alarms is not below their wanted rate | |

A floor above the boundary and one below it are distinguished at the wanted rates between "needed" of the one and "clear
until" of the other. Upper limits are compared, so fewer than about 73 runs never show a rate of 5 %. Each
interval is wrong with probability 5 %; the time of a pair rests on two.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import stated
from vibroswarm.errors import InputError
from vibroswarm.floors.source import source_of
from vibroswarm.inference.outcomes import numbers
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.decidability import decidability
from vibroswarm.statistics.incidence import robot_incidence, swarm_incidence
from vibroswarm.statistics.intervals import wilson_limits
from vibroswarm.study.runs import Runs
from vibroswarm.study.spec import Study
from vibroswarm.study.summary import outcome_of

FILLS: Final = (0.24, 0.32, 0.36, 0.40, 0.44, 0.48, 0.52, 0.56, 0.60, 0.64, 0.68, 0.76)
"""Fill ratios around a boundary of one half."""
TIMES_ROBOTS: Final = (1, 2, 4)
"""Numbers of robots that are tried, relative to the scenario's."""


@dataclass(frozen=True)
class Detection:
    """What a detection found."""

    tables: Mapping[str, pl.DataFrame]
    """``detection``, ``needed``, ``pairs``, and ``summary``, all figures of each cell."""
    scenario: Scenario
    """The scenario of all runs, in which floor and number of robots vary."""
    seed: int
    runs: int
    """Of each fill ratio and number of robots."""
    error: float
    """Tolerated probability of a miss."""
    false_alarms: float
    """Tolerated probability of a false alarm."""
    warnings: tuple[str, ...] = ()
    """Fill ratios on which the swarm cannot be right, however many samples robots take, each as a sentence."""

    @property
    def runs_needed(self) -> int:
        """Fewest runs that can show that misses and false alarms are rare enough: with none of them."""
        least = min(self.error, self.false_alarms)
        return next(n for n in count(1) if float(wilson_limits(0, n, 0.95)[1]) < least)


def detection_study(
    scenario: Scenario,
    robots: Sequence[int] | None = None,
    fills: Sequence[float] | None = None,
    runs: int = 300,
    seed: int = 1,
) -> Study:
    """Return the study of random floors (``fills_around``) with these numbers of robots (``TIMES_ROBOTS``)."""
    if scenario.task.name != "fill_ratio":
        raise InputError(f"must be fill_ratio to detect, not '{scenario.task.name}'", field="task.name")
    if scenario.change.is_given:
        raise InputError("must be left out: what is detected is on a floor that stays", field="change")
    sizes = [scenario.swarm.robots * times for times in TIMES_ROBOTS] if robots is None else list(robots)
    floors = [source_of("random", fill) for fill in (fills_around(scenario) if fills is None else fills)]
    return replace(
        Study.of(scenario, runs, seed, swarm__robots=sizes, floor__source=floors), name="Detection"
    )


def detection_of(runs: Runs, error: float = 0.05, false_alarms: float | None = None) -> Detection:
    """Return what the runs of a ``detection_study`` say, for tolerated probabilities of misses and false alarms."""
    scenario, alarms = runs.cells[0].scenario, error if false_alarms is None else false_alarms
    runs.check_complete()
    cells = [runs.tables(cell) for cell in runs.cells]
    need = needed(cells, scenario.run.t_end_s, error, false_alarms=alarms)
    tables = {
        "detection": detection_curve(cells, scenario.run.t_end_s),
        "needed": need,
        "pairs": pairs(need),
        "summary": outcome_of(runs).table,
    }
    verdicts = [decidability(cell.scenario) for cell in runs.cells]
    warnings = dict.fromkeys(
        f"fill ratio {stated(verdict.fill_ratio)}: {verdict.says}"
        for verdict in verdicts
        if verdict.is_warning
    )
    return Detection(tables, scenario, runs.seed, runs.runs, error, alarms, tuple(warnings))


def fills_around(scenario: Scenario) -> list[float]:
    """Return the fill ratios to simulate: some below the boundary, and others above it, whole numbers of tiles."""
    boundary, tiles = scenario.decision.decision_boundary, scenario.floor.rows * scenario.floor.columns

    def in_tiles(shares: Iterable[float]) -> list[float]:
        fills = dict.fromkeys(round(tiles * min(max(share, 0.0), 1.0)) / tiles for share in shares)
        # On a floor whose fill ratio is the boundary, no decision is right; 1e-9 allows for rounding errors.
        return [fill for fill in fills if abs(fill - boundary) > 1e-9]

    if boundary == 0.5:  # FILLS are chosen for this boundary
        return in_tiles(FILLS)
    below = [fill for fill in in_tiles((0.0, boundary / 3, boundary * 2 / 3)) if fill < boundary]
    # Floors are hardest near the boundary, so the fill ratios above it are dense there. The unit of distance is a third
    # of the way from the boundary to 0 or to 1, whichever is nearer.
    step = min(boundary, 1.0 - boundary) / 3
    above = in_tiles(boundary + step * times for times in (1, 2, 3, 5, 7))
    return below + [fill for fill in above if fill > boundary]


Cells = Iterable[tuple[pl.DataFrame, pl.DataFrame]]
"""Table of robots and table of runs of each cell: runs of one scenario, with one number of robots."""

HORIZONS: Final = 6
"""Number of horizons, evenly spaced up to t_end."""
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


def detection_curve(cells: Cells, t_end_s: float) -> pl.DataFrame:
    """Tabulate misses and false alarms of each cell at each of ``HORIZONS`` horizons, with 95 % limits.

    Columns are null where they do not apply: all shares without a truth, false alarms unless truth is 0 (below).
    """
    horizons = np.linspace(0, t_end_s, HORIZONS + 1)[1:]  # at 0 no robot has decided
    frames = []
    for robots, runs in cells:
        about = _about(robots, runs)
        columns = [pl.lit(value, ABOUT[name]).alias(name) for name, value in about.items()]
        by_swarms = swarm_incidence(robots, runs, t_end_s, horizons)
        by_robots = robot_incidence(robots, runs, t_end_s, horizons)
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
    false_alarms: float | None = None,
) -> pl.DataFrame:
    """Compute for each cell the first time at which the upper limit of its misses is below ``error``.

    Returns: fill_ratio, truth (1: above the boundary, 0: below), robots, runs; needed_s (null: none by t_end); missed
        at t_end, and its upper limit; fewest, the smallest swarm of its fill ratio with a needed_s; where truth is 0,
        false_alarm at t_end, its upper limit, and clear_until_s (0: from the start; null: never by t_end).
    """
    alarm_rate = error if false_alarms is None else false_alarms
    rows = []
    for robots, runs in cells:
        reached_s = runs["consensus_time_s"].drop_nulls().to_numpy()
        shares = swarm_incidence(robots, runs, t_end_s, np.unique(np.append(0.0, reached_s)))
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
    """Compute when a floor above the boundary is distinguished from one below, from the table of ``needed``.

    time_s is needed_s of the floor above; null unless that is before clear_until_s of the floor below.
    """
    above = found.filter(pl.col("truth") == 1).select("fill_ratio", "robots", "needed_s")
    below = found.filter(pl.col("truth") == 0).select(
        "robots", "clear_until_s", fill_ratio_below="fill_ratio"
    )
    clear = pl.col("clear_until_s").is_null() | (pl.col("needed_s") < pl.col("clear_until_s"))
    both = above.join(below, on="robots").with_columns(time_s=pl.when(clear).then("needed_s"))
    floors = ("fill_ratio", "fill_ratio_below")
    return both.select(*floors, "robots", "time_s", _fewest("time_s", *floors)).sort(*floors, "robots")
