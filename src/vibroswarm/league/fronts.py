"""Compare the strategies of a league at equal forced error, each with its own settings.

Each entry (a strategy with settings) is a point (decision time, forced error). The front of a strategy consists of the
points that no other of its points beats in both, joined by straight lines. Every point of a line can be reached: a
swarm that draws one of two settings for each run has a weighted mean of their times and of their errors.

Strategies are compared at several forced errors (``LEVELS``). These do not depend on what any strategy reaches, so no
strategy meets them by construction, and none passes or fails at an error near a level: its front is read between its
settings. The settings were chosen on other runs (``tuning``), so the fronts are not lucky.

| name | equation |
|---|---|
| time at a level | time at which the front of a strategy has this forced error |
| behind | time at a level - that of the fastest strategy, paired, with intervals that hold together |
| group | strategies that cannot be told apart from the fastest (``statistics.best_group``) |

Limits are from a bootstrap over units (a run of one swarm size). The same draws serve all strategies, so that
comparisons stay paired; each draw has its own fronts. A front has no value beyond its ends. That is the tolerance of a
level: a strategy **reaches** it if at least 95 % of the draws have a value; if at most 5 % have one, it does **not
reach** it or, where the largest error of its front is below the level, **errs less**; otherwise it is **open**. Only
strategies that reach a level are compared at it.

Entries are also compared by their forced error, and by their decision time where no strategy has a front
(``best_table``), without crowning noise or guesses. An entry **guesses** if its forced error is not significantly below
``GUESS``. It is never called fastest, since any answer can be given at once. No single winner is named, but the group
without a significant difference from the best (``statistics.best_group``).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.inference.outcomes import Array, costs_of
from vibroswarm.league.entries import main_entries
from vibroswarm.league.standings import Standings
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics import paired
from vibroswarm.statistics.best_group import best_group
from vibroswarm.statistics.fronts import METHOD, front_of, on_line
from vibroswarm.statistics.intervals import columns_of, plain, within
from vibroswarm.statistics.paired import LEAST_KNOWN

LEVELS: Final = (0.01, 0.02, 0.05, 0.10, 0.15, 0.20)
"""Forced errors at which strategies are compared."""
REACHES, OPEN, NOT, LESS = "yes", "open", "no", "errs less"
"""Whether a strategy reaches a level."""
FRONTS: Final[dict[str, Any]] = {
    "level": pl.Float64,
    "strategy": pl.String,
    "reached": pl.String,
    **dict.fromkeys(("time_s", "time_s_low", "time_s_high"), pl.Float64),
    **dict.fromkeys(("behind_s", "behind_s_low", "behind_s_high"), pl.Float64),
    "in_group": pl.Boolean,
}
"""Columns of ``front_table`` and their types."""


def drawn_means(standings: Standings, figure: str, seed: int = 0) -> Array:
    """Return the mean of a figure of each entry, (entries, 1 + draws): over all units, then of each bootstrap draw."""
    values = np.array([standings.by_unit(k, figure) for k in range(len(standings.league.entries))])
    return paired.drawn_means(values, seed, "league front")


def times_at_levels(standings: Standings, seed: int = 0) -> tuple[list[str], Array, Array]:
    """Return the strategies, times at the levels, and the largest error on each front.

    Shapes: (levels, strategies, 1 + draws), nan where a front has no value; (strategies,).
    """
    times, errors = (drawn_means(standings, name, seed) for name in ("decision_time_s", "forced_error"))
    entries = standings.league.entries
    names = list(dict.fromkeys(entry.strategy for entry in entries))
    found = np.full((len(LEVELS), len(names), times.shape[1]), np.nan)
    largest = np.empty(len(names))
    for row, name in enumerate(names):
        own = [k for k, entry in enumerate(entries) if entry.strategy == name]
        largest[row] = front_of(times[own, 0], errors[own, 0])[1].max()
        for draw in range(times.shape[1]):
            # ``on_line`` wants rising x. Along a front time rises and error falls, so it is reversed.
            time_s, error = (each[::-1] for each in front_of(times[own, draw], errors[own, draw]))
            found[:, row, draw] = [on_line(level, error, time_s) for level in LEVELS]
    return names, found, largest


def front_table(standings: Standings, seed: int = 0) -> pl.DataFrame:
    """Compare the strategies at each level, see the head of this module.

    Args:
        standings: results of the league. seed: of the bootstrap.
    Returns: one row per level and strategy with the columns ``FRONTS``: levels rise; strategies in the order of the
        league. time_s is null where the front has no value, its limits also unless the level is reached; the last four
        columns are null unless it is reached.
    """
    names, times, largest = times_at_levels(standings, seed)
    units = standings.by_unit(0, "decision_time_s").size
    return pl.DataFrame(
        [
            row
            for level, of_level in zip(LEVELS, times, strict=True)
            for row in _rows(level, names, of_level, largest, units, standings.t_end_s)
        ],
        schema=FRONTS,
    )


def _rows(
    level: float, names: list[str], times: Array, largest: Array, units: int, t_end_s: float
) -> list[dict[str, Any]]:
    """Return the rows of a level; ``times``: (strategies, 1 + draws); ``largest``: error on each front."""
    known = (~np.isnan(times[:, 1:])).mean(axis=1)  # share of draws with a value
    reached = (known >= LEAST_KNOWN) & ~np.isnan(times[:, 0])
    unread = np.where(known > 1.0 - LEAST_KNOWN, OPEN, np.where(largest < level, LESS, NOT))
    rows: list[dict[str, Any]] = [
        {
            "level": level,
            "strategy": name,
            "reached": REACHES if reaches else str(why_not),
            "time_s": plain(float(of_name[0])),
        }
        for name, of_name, why_not, reaches in zip(names, times, unread, reached, strict=True)
    ]
    if reached.any():
        group = best_group(times[reached], units)
        for place, row in enumerate(np.flatnonzero(reached)):
            behind = group.difference[place]
            time = within(paired.drawn_interval(times[row], units, METHOD), 0.0, t_end_s)
            rows[row] |= {
                **columns_of("time_s", time),
                **columns_of("behind_s", behind.tolist()),
                "in_group": bool(group.member[place]),
            }
    return rows


GUESS: Final = 0.4
"""Forced error from which an entry guesses. A swarm that tosses a coin in four runs of five, and is always right in the
fifth, has this error; one that always tosses a coin has 1/2, which strategies that lean on the floor's few clues just
undercut. Of k answers it is as large a part of the error of a guess, 1 - 1/k, or of its cost: that of the cheapest
answer, given on all floors, where mistakes cost differently."""


def guess_level(scenario: Scenario) -> float:
    """Return ``GUESS`` for the answers of a scenario's task, and for what its mistakes cost."""
    costs = costs_of(scenario)
    # Columns are answers: the mean cost of each if it is given whatever the floor, as often on the side of each truth.
    return GUESS if costs is None else 2.0 * GUESS * float(costs.mean(axis=0).min())


BEST: Final[dict[str, Any]] = {
    **dict.fromkeys(("figure", "name"), pl.String),
    **dict.fromkeys(("value", "behind", "behind_low", "behind_high"), pl.Float64),
    "in_group": pl.Boolean,
}
"""Columns of ``best_table`` and their types."""


def guesses(standings: Standings, entry: int) -> bool:
    """Return whether an entry is not shown to err less than a guess; one without a forced error does not guess."""
    error = standings.interval(entry, "forced_error")
    return not (error.high < guess_level(standings.league.base) or np.isnan(error.estimate))


def best_table(standings: Standings) -> pl.DataFrame:
    """Compare entries by forced error, and by decision time those that do not guess.

    Of a strategy with settings along a front only those with the least error are compared. Where any strategy has a
    front, times are compared at equal error alone (``fronts``), and not here.

    Args:
        standings: results of the league.
    Returns: one row per figure and compared entry, the smallest value first: ``BEST``. "behind" is the difference from
        the smallest; limits of a figure hold together with 95 %.
    """
    entries = standings.league.entries
    places, least = range(len(entries)), main_entries(entries, error=0.0)
    known = [k for k in places if not np.isnan(standings.interval(k, "forced_error").estimate)]
    has_fronts = any(entry.aim is not None for entry in entries)
    compared = {
        "forced_error": [k for k in known if entries[k] in least],
        "decision_time_s": [k for k in known if not has_fronts and not guesses(standings, k)],
    }
    rows: list[dict[str, Any]] = []
    for figure, chosen in compared.items():
        if not chosen:
            continue
        means = drawn_means(standings, figure)[chosen]
        group = best_group(means, standings.by_unit(0, figure).size)
        for place in np.argsort(means[:, 0], kind="stable"):
            rows.append(
                {
                    "figure": figure,
                    "name": entries[chosen[place]].label,
                    "value": float(means[place, 0]),
                    **columns_of("behind", group.difference[place].tolist()),
                    "in_group": bool(group.member[place]),
                }
            )
    return pl.DataFrame(rows, schema=BEST)
