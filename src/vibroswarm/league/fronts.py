"""Compare the strategies of a league at equal forced error, each with its own settings.

| column | equation |
|---|---|
| forced_error | the error that is asked for, one of ``LEVELS`` |
| time_s | min of T_k over settings k with E_k <= forced_error; null if none has |
| reached_share | share of the bootstrap draws in which one has |
| behind_s | time_s - that of the fastest strategy, paired |
| p_holm | of behind_s, corrected over the strategies at this error |
| fastest | whether the strategy does not differ from the fastest, nor from others that do not |
| name, p_c, O_c, settings | of the setting whose time it is |

Limits are percentiles of a bootstrap over runs; the same draws serve all settings, and each has its own front. Where
some draws do not reach an error, the upper limit is open (null). Two strategies differ if the interval of their
difference leaves 0 out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.inference.outcomes import Array, costs_of
from vibroswarm.league.standings import ENTRY
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.intervals import columns_of, draw_limits, few_factor, plain
from vibroswarm.statistics.paired import drawn_means, holm

LEVELS: Final = (0.01, 0.02, 0.05, 0.10, 0.15, 0.20)
"""Forced errors at which strategies are compared."""
GUESS: Final = 0.4
"""Forced error from which an entry guesses. A swarm that tosses a coin in four runs of five, and is always right in the
fifth, has this error; one that always tosses a coin has 1/2, which strategies that lean on the floor's few clues just
undercut. Of k answers it is as large a part of the error of a guess, 1 - 1/k, or of its cost: that of the cheapest
answer, given on all floors, where mistakes cost differently."""


def front_table(units: pl.DataFrame, by: Sequence[str] = (), seed: int = 0) -> pl.DataFrame:
    """Compare the strategies at each level; ``by``: columns whose values have fronts of their own."""
    rows: list[dict[str, Any]] = []
    for part in units.partition_by(by, maintain_order=True) if by else [units]:
        group = part.select(by).row(0, named=True) if by else {}
        entries = part.select(ENTRY).unique("name", maintain_order=True)
        times, errors = (_drawn(part, figure, seed) for figure in ("decision_time_s", "forced_error"))
        runs = part["run"].n_unique()
        for level in LEVELS:
            reached = np.where(errors <= level + 1e-9, times, math.inf)
            rows += [{**group, "forced_error": level, **row} for row in _rows(entries, reached, runs)]
    return pl.DataFrame(rows, infer_schema_length=None)


def _drawn(part: pl.DataFrame, figure: str, seed: int) -> Array:
    """Return the mean of a figure of each entry over all runs, then over those of each draw, (entries, 1 + draws)."""
    values = np.array([own[figure] for own in part.partition_by("name", maintain_order=True)])
    return drawn_means(values, seed, "league front")


def _rows(entries: pl.DataFrame, times: Array, runs: int) -> list[dict[str, Any]]:
    """Return the rows of a level."""
    least, rows = dict[str, Array](), list[dict[str, Any]]()
    for strategy in entries["strategy"].unique(maintain_order=True):
        own = np.flatnonzero(entries["strategy"] == strategy)
        least[strategy] = times[own].min(axis=0)
        chosen = entries.row(int(own[times[own, 0].argmin()]), named=True)
        is_reached = math.isfinite(least[strategy][0])
        rows.append(chosen if is_reached else dict.fromkeys(ENTRY) | {"strategy": strategy})
    rows.sort(key=lambda row: least[row["strategy"]][0])
    best, fastest = least[rows[0]["strategy"]], list[Array]()
    for row in rows:
        time_s = least[row["strategy"]]
        behind, is_reached = _difference(time_s, best), math.isfinite(time_s[0])
        row["reached_share"] = float(np.isfinite(time_s[1:]).mean())
        time = _interval(time_s, runs)
        row |= columns_of("time_s", (*time[:2], time[2] if row["reached_share"] == 1.0 else math.inf))
        row |= columns_of("behind_s", _interval(behind, runs) if is_reached else [math.nan] * 3)
        row["p_holm"] = _p_value(behind, runs) if is_reached and time_s is not best else math.nan
        row["fastest"] = is_reached and all(
            _interval(_difference(time_s, other), runs)[1] <= 0.0 for other in fastest
        )
        if row["fastest"]:
            fastest.append(time_s)
    corrected = holm([row["p_holm"] for row in rows])
    return [row | {"p_holm": plain(p_holm)} for row, p_holm in zip(rows, corrected, strict=True)]


def _difference(first: Array, second: Array) -> Array:
    """Return first - second; 0 where both are infinite."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.nan_to_num(first - second, nan=0.0, posinf=math.inf, neginf=-math.inf))


def _interval(drawn: Array, runs: int) -> tuple[float, float, float]:
    """Return the estimate, which is the first, and percentile limits of the draws; infinite if it is."""
    estimate = float(drawn[0])
    if math.isinf(estimate):
        return (estimate,) * 3
    low, high = draw_limits(drawn[1:], runs, 0.95)
    return estimate, min(low, estimate), max(high, estimate)


def _p_value(drawn: Array, runs: int) -> float:
    """Return twice the share of the draws that are not above 0, with deviations as wide as those of ``draw_limits``."""
    if runs < 2:
        return 1.0
    draws = drawn[1:]
    centre = draws[np.isfinite(draws)].mean()
    is_above = centre + few_factor(runs, 0.95) * (draws - centre) > 0.0
    return min(1.0, 2.0 * (1 + np.count_nonzero(~is_above)) / (1 + draws.size))


def guess_level(scenario: Scenario) -> float:
    """Return ``GUESS`` for the answers of a scenario's task, and for what its mistakes cost."""
    costs = costs_of(scenario)
    # Columns are answers: the mean cost of each if it is given whatever the floor, as often on the side of each truth.
    return GUESS if costs is None else 2.0 * GUESS * float(costs.mean(axis=0).min())
