"""Say which entries of a league err least, and which are fastest, without crowning noise or guesses.

An entry **guesses** if its forced error is not significantly below ``GUESS``. It is never called fastest, since any
answer can be given at once. Besides, no single winner is named but the group that cannot be told apart from it
(``analysis.best_group``).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.best_group import best_group
from vibroswarm.analysis.intervals import columns_of
from vibroswarm.inference.outcomes import costs_of
from vibroswarm.league.entries import main_entries
from vibroswarm.league.fronts import drawn_means
from vibroswarm.league.standings import Standings
from vibroswarm.scenario.scenario import Scenario

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
