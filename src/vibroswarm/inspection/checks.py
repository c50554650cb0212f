"""Does the law of the sensor hold in this inspection? What can be tested on still places.

| check | statistic |
|---|---|
| law of still places | largest difference between the distribution of values there and that of the law (Kolmogorov) |
| robots against each other | largest mean of a robot's scores less those of all, in standard errors |
| drift | largest slope of these over time, of a robot or summed over all, in standard errors |

The score of a value is Phi^-1(F(value)), with F that of still places, or a reading of 0 or 1 itself, less the mean on
its tile if the law says that tiles differ. Each statistic is compared with those of surfaces drawn at the same places,
by the law with its error and the differences between robots and tiles that it states. The p-values are corrected by
Holm's method, so that at most 5 % of right laws are refused by any check.

**Still places** are those at which the other robots feel nothing by their map of the grid, so that no value says by
itself where it counts; without a grid, those away from called patches. **The law of damage cannot be tested where there
is none.**
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import ndtri

from vibroswarm.inspection.damage import EVEN, drawn_parts, judged, quantiles_of, tiles_below
from vibroswarm.inspection.patches import Box
from vibroswarm.inspection.samples import FEWEST, Floats, Law, Samples, read_by
from vibroswarm.inspection.scan import near, p_value
from vibroswarm.inspection.tile_map import felt_on, tile_map
from vibroswarm.statistics.intervals import generator
from vibroswarm.statistics.paired import holm

DRAWN: Final = 499
"""Surfaces drawn for the p-values."""
LEVEL: Final = 0.05
"""A law is refused if the smallest corrected p-value is below this."""
LAW_CHECKS: Final = ("law of still places", "robots against each other", "drift")
LEAST_PER_ROBOT: Final = 10
"""Robots with fewer samples are not compared."""
LEAST_PER_TILE: Final = 5
"""Tiles with fewer samples are not compared with themselves."""
SURE: Final = 0.02
"""A place is still if vibration is felt there with this probability at most."""
CHECKS: Final[Any] = {
    "check": pl.String, "samples": pl.UInt32, "p_value": pl.Float64, "p_holm": pl.Float64, "outcome": pl.String,
}  # fmt: skip
"""A row for each check. ``samples``: how many it reads. ``p_holm``: the p-value by Holm's method. ``outcome``: "not
refused", "refused", or "not made": too few samples or robots are on still places, or samples have no times."""


def law_checks(samples: Samples, called: Sequence[Box] = (), *, seed: int = 4) -> pl.DataFrame:
    """Return the checks of an inspection, with the columns of ``CHECKS``."""
    quiet = _still_by_others(samples) if samples.floor is not None else _away(samples, called)
    some = samples.where(pl.Series(quiet))
    enough = int((some.frame["robot"].value_counts()["count"] >= LEAST_PER_ROBOT).sum())
    is_timed = samples.frame.select("robot", "time_s").n_unique() > len(samples.robots)
    possible = (some.frame.height >= FEWEST, enough >= 2, enough >= 1 and is_timed)
    law = samples.law
    # By ranks, all values of a reference count: each judge left out a third of them.
    by_ranks = law.sensor.still_energies is not None and not law.bits
    drawing = replace(some, law=replace(law, draws=())) if by_ranks else some
    p: dict[str, float] = {}
    if any(possible):
        parts = drawn_parts(generator(seed, "checks of the law"), drawing, DRAWN)
        null = np.hstack([_statistics(some, judged(law, part, _ranks)) for part in parts])
        value = (
            some.column("value").astype(np.float32).astype(np.float64)[:, None]
        )  # in the precision of the law
        observed = _statistics(some, _ranks(law, value))[:, 0].tolist()
        p = {
            check: p_value(of_check, row)
            for check, of_check, row, may in zip(LAW_CHECKS, observed, null, possible, strict=True)
            if may
        }
    corrected = dict(zip(p, holm(list(p.values())), strict=True))
    words = {check: "refused" if corrected[check] < LEVEL else "not refused" for check in p}
    rows = [
        (check, some.frame.height, p.get(check), corrected.get(check), words.get(check, "not made"))
        for check in LAW_CHECKS
    ]
    return pl.DataFrame(rows, CHECKS, orient="row")


def _still_by_others(samples: Samples) -> NDArray[np.bool_]:
    """Return which samples are on still places by the map of the other robots; of one robot by its own."""
    robot, still = samples.frame["robot"].to_numpy(), np.zeros(samples.frame.height, dtype=bool)
    for one in samples.robots:
        others = samples.where(pl.col("robot") != one) if len(samples.robots) > 1 else samples
        own = robot == one
        still[own] = felt_on(samples.where(pl.Series(own)), tile_map(others, [np.inf])[0]) <= SURE
    return still


def _away(samples: Samples, called: Sequence[Box]) -> NDArray[np.bool_]:
    away = np.ones(samples.frame.height, dtype=bool)
    for box in called:
        away &= ~near(samples, box)
    return away


def _ranks(law: Law, values: Floats) -> Floats:
    """Return the share of still values that are smaller, of each value; a reading is its own rank."""
    if law.bits:
        return values
    return np.asarray(np.searchsorted(quantiles_of(law)[0], values, side="right") / EVEN)


def _statistics(some: Samples, rank: Floats) -> Floats:
    """Return the statistics of ``LAW_CHECKS``, (checks, replicates), of ranks, (samples, replicates)."""
    number = len(rank)
    if some.law.bits:
        score = rank - read_by(some.law, quantiles_of(some.law)[0]).mean()
        from_law = np.abs(score.mean(axis=0))
    else:
        still = np.sort(rank, axis=0)
        is_last = still != np.vstack([still[1:], np.full_like(still[:1], np.nan)])  # of equal ones
        from_law = np.max(np.abs(still - (np.arange(number)[:, None] + 0.5) / number) * is_last, axis=0)
        score = ndtri(np.clip(rank, 1e-6, 1.0 - 1e-6))
    score = _against_the_tile(some, score)
    robot, time_s = some.frame["robot"].to_numpy(), some.column("time_s")
    between, drift, together = (np.zeros(rank.shape[1]) for _ in range(3))
    squared = 1e-18
    for one in np.unique(robot):
        own = robot == one
        if own.sum() >= LEAST_PER_ROBOT:
            between = np.maximum(between, np.abs(score[own].sum(axis=0)) / np.sqrt(own.sum()))
            when = time_s[own] - time_s[own].mean()
            slope, square = when @ score[own], float(when @ when) + 1e-18
            drift = np.maximum(drift, np.abs(slope) / np.sqrt(square))
            together, squared = together + slope, squared + square
    return np.stack([from_law, between, np.maximum(drift, np.abs(together) / np.sqrt(squared))])


def _against_the_tile(some: Samples, score: Floats) -> Floats:
    """Return scores less their mean, on the same tile if tiles differ, in standard deviations."""
    tile = tiles_below(some)
    _, which, count = np.unique(tile, return_inverse=True, return_counts=True)
    differ = bool(some.law.sensor.tile_spread) & (count[which] >= LEAST_PER_TILE)
    place = np.unique(np.where(differ, 1 + tile, 0), return_inverse=True)[1]
    on_place = (np.arange(place.max() + 1)[:, None] == place).astype(np.float64)
    apart = score - ((on_place @ score) / on_place.sum(axis=1, keepdims=True))[place]
    return np.asarray(apart / np.maximum(np.sqrt((apart**2).mean(axis=0)), 1e-9))
