"""Compare how sure robots are when they decide with how often they are right.

A robot that decides at a belief of 95 % should be right in 95 % of such decisions, averaged over the floors that it
expects. Floors with different numbers k of vibrating tiles are simulated and weighted by a prior of k, so that one set
of runs serves all priors.

| prior | weight of k of N tiles | name |
|---|---|---|
| own | that of the strategy: beta-binomial of its prior of the fill ratio; uniform where it has none | ``OWN`` |
| common | binomial of N and 1/2: tiles that vibrate independently | ``COMMON`` |

| column | what it is |
|---|---|
| settings | "as it plays", or "95 %, no gate": p_c = 0.95 and O_c = 0 |
| confidence | mean confidence, at their decisions, of the robots that decided |
| right | share of their decisions that are right |
| decided | share of robots that decided |

Floors of independent tiles lie near 1/2 more often than a uniform prior expects, so a strategy that assumes one is too
sure on them. **The unit is the motion of a run**, which all floors share: shares are ratios of sums over floors and
robots, with intervals by the jackknife over motions.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.stats import betabinom, binom
from scipy.stats import t as student

from vibroswarm.inference.outcomes import numbers
from vibroswarm.league.entries import Entry, LeagueFloor
from vibroswarm.league.standings import League
from vibroswarm.strategies import strategy
from vibroswarm.strategies.static_analysis import fields_read
from vibroswarm.study.study_result import run

BELIEFS: Final = "beliefs"
"""Folder of its runs in that of a league."""
OWN, COMMON = "own prior", "independent tiles"
AS_PLAYED, AT_95 = "as it plays", "95 %, no gate"
TILES: Final = 100
"""Of a random floor of a league (``entries.SIZE``)."""
HALF: Final = TILES // 2
NEAR: Final = 14
"""Within so many tiles of one half, every number of vibrating tiles is simulated; beyond, where few robots err, each
fifth."""
COUNTS: Final = tuple(k for k in range(TILES + 1) if k != HALF and (abs(k - HALF) <= NEAR or k % 5 == 0))
"""Numbers of vibrating tiles. On exactly one half no decision is right."""
ALL: Final = np.array([k for k in range(TILES + 1) if k != HALF])
SURE: Final[dict[str, Any]] = {"decision.credible_threshold": 0.95, "decision.min_observations": 0}
COLUMNS: Final = ("name", "strategy", "settings", "prior", "confidence", "right", "decided")
Array = NDArray[np.float64]


def belief_calibration(
    league: League, folder: Path | None = None, *, runs: int = 100, **how: Any
) -> pl.DataFrame:
    """Simulate floors of every fill ratio and compare beliefs with outcomes.

    Args:
        league: gives the entries, the base scenario and the smallest swarm; floors and seed differ from the league's.
        folder: where runs are kept; those that are there are not repeated.
        runs: motions; each is read on every floor.
        how: workers and executor, as of ``League.play``.
    Returns: ``COLUMNS`` with ``_low`` and ``_high``, a row for each entry that has a belief, its settings and prior;
    empty if no entry has one.
    """
    entries = [entry for entry in league.entries if strategy(entry.strategy).belief is not None]
    if not entries:
        return pl.DataFrame(schema=dict.fromkeys(COLUMNS, pl.String))
    floors = [LeagueFloor("random", k / TILES, f"random:{k / TILES:g}") for k in COUNTS]
    variants = [
        (
            entry.label,
            settings,
            replace(entry, label=f"{entry.label}, {settings}", settings={**entry.settings, **more}),
        )
        for entry in entries
        for settings, more in _settings_of(entry)
    ]
    asked = replace(
        league,
        entries=tuple(variant for _, _, variant in variants),
        floors=tuple(floors),
        robots=(min(league.robots),),
        runs=runs,
        seed=league.seed + 1,
    )
    study = run(asked.study, folder, **how)
    rows: list[dict[str, Any]] = []
    for place, (label, settings, entry) in enumerate(variants):
        mine = asked.study.cells[place * len(COUNTS) : (place + 1) * len(COUNTS)]
        table = study.rows(*(cell.number for cell in mine)).select(
            "cell", "run", "decision", "belief_below", "truth"
        )
        sums = _sums(table.collect(), mine[0].number, (len(COUNTS), runs))
        for prior in (OWN, COMMON):
            weights = prior_weights(prior, entry, league)
            # Each figure is the ratio of two of the sums.
            found = {"confidence": (1, 0), "right": (2, 0), "decided": (0, 3)}
            row: dict[str, Any] = {
                "name": label,
                "strategy": entry.strategy,
                "settings": settings,
                "prior": prior,
            }
            for name, (top, bottom) in found.items():
                values = ratio_interval(weights @ sums[top], weights @ sums[bottom])
                row |= dict(zip((name, f"{name}_low", f"{name}_high"), values, strict=True))
            rows.append(row)
    return pl.DataFrame(rows).fill_nan(None)


def _settings_of(entry: Entry) -> list[tuple[str, dict[str, Any]]]:
    """Return names and fields of the settings at which an entry is judged: only as it plays if it does not use p_c."""
    has_threshold = "credible_threshold" in fields_read(strategy(entry.strategy))
    return [(AS_PLAYED, {}), (AT_95, SURE)] if has_threshold else [(AS_PLAYED, {})]


def prior_weights(prior: str, entry: Entry, league: League) -> Array:
    """Return the weights of ``COUNTS``, with sum 1: each stands for all numbers of tiles that are nearest to it.

    Args:
        prior: ``OWN`` or ``COMMON``.
    """
    if prior == COMMON:
        every = binom.pmf(ALL, TILES, 0.5)
    else:
        scenario = league.base.with_values({"strategy.name": entry.strategy, **entry.settings})
        alpha, beta = scenario.decision.prior_alpha, scenario.decision.prior_beta
        params: Any = getattr(scenario.strategy, entry.strategy, None)
        if hasattr(params, "prior"):  # of Bayes Bots, which has one of its own
            alpha = beta = params.prior
        every = betabinom.pmf(ALL, TILES, alpha, beta)
    nearest = np.abs(ALL[:, None] - np.array(COUNTS)).argmin(axis=1)
    weights: Array = np.bincount(nearest, every, minlength=len(COUNTS)).astype(np.float64)
    normalised: Array = weights / weights.sum()
    return normalised


def _sums(table: pl.DataFrame, first: int, shape: tuple[int, int]) -> tuple[Array, Array, Array, Array]:
    """Return the sums of robots that decided, of their confidences, of those right, and of all, (floors, runs) each."""
    place = table["cell"].to_numpy().astype(np.int64) - first
    place = place * shape[1] + table["run"].to_numpy()
    decision, below = numbers(table["decision"]), numbers(table["belief_below"])
    decided = decision >= 0
    confidence = np.where(decision == 0, below, 1.0 - below)
    right = decision == numbers(table["truth"])

    def by_run(values: Array) -> Array:
        return np.bincount(place, values, minlength=shape[0] * shape[1]).astype(np.float64).reshape(shape)

    return (
        by_run(decided.astype(float)),
        by_run(np.where(decided, confidence, 0.0)),
        by_run((decided & right).astype(float)),
        by_run(np.ones(place.size)),
    )


def ratio_interval(top: Array, bottom: Array) -> tuple[float, float, float]:
    """Return sum(top) / sum(bottom) and its 95 % limits by the jackknife over units.

    All are nan if sum(bottom) is 0; the limits are nan if there is one unit, or if one unit has all of ``bottom``.

    Args:
        top, bottom: (units,).
    """
    total = bottom.sum()
    if total <= 0.0:
        return (np.nan,) * 3
    estimate = float(top.sum() / total)
    rest = total - bottom
    if top.size < 2 or (rest <= 0.0).any():
        return estimate, np.nan, np.nan
    without = (top.sum() - top) / rest
    units = top.size
    error = float(np.sqrt((units - 1) / units * ((without - without.mean()) ** 2).sum()))
    reach = float(student.ppf(0.975, units - 1)) * error
    return estimate, max(estimate - reach, 0.0), min(estimate + reach, 1.0)
