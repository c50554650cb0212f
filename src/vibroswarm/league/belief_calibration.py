"""Compare how confident robots of a league are when they decide with how often they are right.

A league compares entries (strategies with settings). A robot that decides at a belief of 95 % should be right in 95 %
of such decisions, averaged over the floors that its prior expects. Floors with different numbers k of vibrating tiles
are simulated once and weighted by a prior of k, so that the same runs serve all priors.

| prior | weight of k of N tiles | name |
|---|---|---|
| own | beta-binomial of the strategy's prior Beta(alpha, beta) of the fill ratio (uniform by default) | ``OWN`` |
| common | binomial of N and 1/2: each tile vibrates with probability 1/2 | ``COMMON`` |

| column | what it is |
|---|---|
| settings | "as it plays": the entry's settings; "95 %, no gate": these with p_c = 0.95 and O_c = 0 |
| confidence | mean confidence at decision time, of the robots that decided |
| right | share of right decisions, of the robots that decided |
| decided | share of robots that decided |

Floors of independent tiles have a fill ratio near 1/2 more often than a uniform prior expects. So a strategy that
assumes a uniform prior is too confident on them. **The unit is the motion of a run**, which all floors share. Figures
are ratios of sums over floors and robots, with intervals by the jackknife over motions.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from scipy.special import stdtrit

from vibroswarm.floors.source import source_of
from vibroswarm.inference.outcomes import Array, numbers
from vibroswarm.league.entries import Entry, LeagueFloor
from vibroswarm.league.standings import League
from vibroswarm.statistics.intervals import (
    Interval,
    allowing_for_rare,
    columns_of,
    jackknife_error,
    within,
)
from vibroswarm.strategies import strategy
from vibroswarm.strategies.static_analysis import fields_read
from vibroswarm.study.runs import Runs

BELIEFS: Final = "beliefs"
"""Name of the folder of these runs inside the folder of a league."""
OWN, COMMON = "own prior", "independent tiles"
"""Names of the two priors."""
AS_PLAYED, AT_95 = "as it plays", "95 %, no gate"
"""Names of the settings of an entry: those that it has in the league, and those with ``SURE``."""
TILES: Final = 100
"""Number of tiles of a random floor of a league (``entries.SIZE``)."""
HALF: Final = TILES // 2
NEAR: Final = 14
"""Up to this distance from ``HALF`` every number of vibrating tiles is simulated. Farther away, where few robots err,
only multiples of 5 are."""
COUNTS: Final = tuple(k for k in range(TILES + 1) if k != HALF and (abs(k - HALF) <= NEAR or k % 5 == 0))
"""Numbers of vibrating tiles that are simulated; not ``HALF``, where neither decision is right."""
ALL: Final = np.array([k for k in range(TILES + 1) if k != HALF])
"""All numbers of vibrating tiles that a prior has weights for."""
SURE: Final[dict[str, Any]] = {"decision.credible_threshold": 0.95, "decision.min_observations": 0}
"""Fields that the settings ``AT_95`` change: p_c = 0.95, and O_c = 0 (no gate)."""
COLUMNS: Final = ("name", "strategy", "settings", "prior", "confidence", "right", "decided")
"""Columns of the result of ``belief_calibration``, without the limits."""


def belief_calibration(
    league: League, folder: Path | None = None, *, runs: int = 100, **how: Any
) -> pl.DataFrame:
    """Simulate random floors with the numbers of vibrating tiles ``COUNTS``, and compare confidence with outcomes.

    Args:
        league: its entries, its base scenario and its smallest swarm size are used, with other floors and another seed.
        folder: where runs are saved; runs that are there already are not repeated. None: they are not saved.
        runs: number of motions; each is used on every floor.
        how: further arguments of ``study.run.run``, such as workers.
    Returns: one row per entry whose strategy has a belief, settings and prior: ``COLUMNS``, the figures also with
        ``_low`` and ``_high`` (null if undefined). If no entry has a belief, the table has no rows, and only
        ``COLUMNS``, all of type String.
    Raises:
        InputError: runs are missing, for example because some failed.
    """
    variants = _variants(league)
    if not variants:
        return pl.DataFrame(schema=dict.fromkeys(COLUMNS, pl.String))
    result = belief_league(league, runs).study.run(folder, **how)
    sums = _sums(result, (len(variants), len(COUNTS), runs))
    rows: list[dict[str, Any]] = []
    for place, (label, settings, entry) in enumerate(variants):
        # Sums over the robots of each run on each floor, (floors, runs) each.
        decided, confidence, right, robots = sums[:, place]
        # Each figure is a ratio of two of these sums.
        ratios = {
            "confidence": (confidence, decided),
            "right": (right, decided),
            "decided": (decided, robots),
        }
        for prior in (OWN, COMMON):
            weights = prior_weights(prior, entry, league)
            row: dict[str, Any] = {
                "name": label,
                "strategy": entry.strategy,
                "settings": settings,
                "prior": prior,
            }
            for name, (top, bottom) in ratios.items():
                # Weighted sums over the floors, one for each run: the units of the jackknife.
                row |= columns_of(name, ratio_interval(weights @ top, weights @ bottom))
            rows.append(row)
    return pl.DataFrame(rows).fill_nan(None)


Variant = tuple[str, str, Entry]
"""Label of an entry of a league, name of the settings with which it is tested, and the entry with these settings."""


def _variants(league: League) -> list[Variant]:
    """Return the variants of all entries whose strategy has a belief."""
    return [
        (
            entry.label,
            settings,
            replace(entry, label=f"{entry.label}, {settings}", settings={**entry.settings, **more}),
        )
        for entry in league.entries
        if strategy(entry.strategy).belief is not None
        for settings, more in _settings_of(entry)
    ]


def belief_league(league: League, runs: int) -> League:
    """Return the league whose runs ``belief_calibration`` needs; it has no entries if no strategy has a belief."""
    floors = [
        LeagueFloor(pattern="random", fill_ratio=k / TILES, source=source_of("random", k / TILES))
        for k in COUNTS
    ]
    return replace(
        league,
        entries=tuple(variant for _, _, variant in _variants(league)),
        floors=tuple(floors),
        robots=(min(league.robots),),
        runs=runs,
        seed=league.seed + 1,  # motion that the league does not use
    )


def _settings_of(entry: Entry) -> list[tuple[str, dict[str, Any]]]:
    """Return the settings whose beliefs are tested: the entry's own, and p_c = 0.95, O_c = 0 if it uses p_c."""
    has_threshold = "credible_threshold" in fields_read(strategy(entry.strategy))
    return [(AS_PLAYED, {}), (AT_95, SURE)] if has_threshold else [(AS_PLAYED, {})]


def prior_weights(prior: str, entry: Entry, league: League) -> Array:
    """Return the weights of ``COUNTS`` by a prior, (counts,); their sum is 1.

    Only the numbers ``COUNTS`` of vibrating tiles are simulated. So each number (except ``HALF``) adds its prior
    probability to the weight of the nearest number that is simulated.

    Args:
        prior: ``OWN`` or ``COMMON``. entry: the entry that has its own prior. league: its base scenario has the fields
            that the entry does not set.
    """
    from scipy.stats import betabinom, binom  # whose import takes as long as showing a league

    if prior == COMMON:
        prior_of_all = binom.pmf(ALL, TILES, 0.5)
    else:
        scenario = league.base.with_values({"strategy.name": entry.strategy, **entry.settings})
        alpha, beta = scenario.decision.prior_alpha, scenario.decision.prior_beta
        params: Any = getattr(scenario.strategy, entry.strategy, None)
        if hasattr(params, "prior"):  # Bayes Bots has a symmetric prior of its own
            alpha = beta = params.prior
        prior_of_all = betabinom.pmf(ALL, TILES, alpha, beta)
    nearest = np.abs(ALL[:, None] - np.array(COUNTS)).argmin(axis=1)
    weights = np.bincount(nearest, prior_of_all, minlength=len(COUNTS)).astype(np.float64)
    return np.asarray(weights / weights.sum())


def _sums(study: Runs, shape: tuple[int, int, int]) -> Array:
    """Sum over the robots of each run.

    Args:
        study: its cells are ordered by variant of an entry, then floor. shape: numbers of variants, floors and runs.
    Returns: four sums, (4, variants, floors, runs): number of robots that decided, sum of their confidences at decision
        time, number of them that are right, and number of all robots.
    Raises:
        InputError: runs are missing.
    """
    variants, floors, runs = shape
    sums = np.zeros((4, variants * floors, runs))
    study.check_complete()
    for cells, rows in study.blocks("truth", "robot.decision", "robot.belief_below"):
        shape_here = (len(cells), runs, -1)
        decision = numbers(rows["robot.decision"].explode()).reshape(shape_here)
        below = numbers(rows["robot.belief_below"].explode()).reshape(shape_here)
        decided = decision >= 0
        # Decision 0 is "below the boundary".
        confidence = np.where(decision == 0, below, 1.0 - below)
        right = decided & (decision == numbers(rows["truth"]).reshape(shape_here))
        of_robots = (decided, np.where(decided, confidence, 0.0), right, np.ones(decision.shape))
        for k, values in enumerate(of_robots):
            # ``cumsum`` adds the robots one after the other, whatever their number.
            sums[k, [cell.number for cell in cells]] = values.astype(np.float64).cumsum(axis=2)[:, :, -1]
    return sums.reshape(4, *shape)


def ratio_interval(top: Array, bottom: Array) -> tuple[float, float, float]:
    """Compute sum(top) / sum(bottom), with 95 % limits by the jackknife over units.

    If all units, or all but a few, have the same ratio, the limits are at least those of how often others may occur
    (``allowing_for_rare``).

    Args:
        top, bottom: numerator and denominator of each unit, (units,) each; 0 or more, and top at most bottom.
    Returns: estimate, lower limit, upper limit, cut off at 0 and 1. All are nan if sum(bottom) is 0. The limits are nan
        if there is only one unit, or only one with ``bottom`` above 0.
    """
    total = bottom.sum()
    if total <= 0.0:
        return (np.nan,) * 3
    estimate = float(top.sum() / total)
    rest = total - bottom
    if top.size < 2 or (rest <= 0.0).any():
        return estimate, np.nan, np.nan
    without = (top.sum() - top) / rest  # the ratio without each unit
    reach = float(stdtrit(top.size - 1, 0.975)) * jackknife_error(without)
    found = Interval(estimate, estimate - reach, estimate + reach, 0.95, top.size, "jackknife")
    top, bottom = top[bottom > 0.0], bottom[bottom > 0.0]
    ratios = top / bottom
    alike, counts = np.unique(ratios.round(9), return_counts=True)
    usual = ratios[ratios.round(9) == alike[counts.argmax()]][0]
    # Their mean is the ratio, and those of units with the usual ratio are equal.
    of_units = usual + (top - usual * bottom) / bottom.mean()
    return within(allowing_for_rare(found, of_units, 1.0), 0.0, 1.0)[:3]
