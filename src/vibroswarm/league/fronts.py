"""Compare the strategies of a league at equal error and at equal time, each with the best of its own settings.

Each entry (a strategy with settings) is a point (decision time, forced error). The front of a strategy consists of the
points that no other of its points beats in both, joined by straight lines. Every point of a line can be reached: a
swarm that draws one of two settings for each run has a weighted mean of their times and of their errors.

| name | equation |
|---|---|
| reference | an entry, with its decision time and its forced error |
| time at equal error | time at which the front has the forced error of the reference |
| error at equal time | forced error of the front at the decision time of the reference |

Limits are percentiles of a bootstrap over units (a run of one swarm size). The same draws serve all strategies, so that
comparisons stay paired; each draw has its own front. A front has no value beyond its ends: a strategy that never has an
error as small as the reference has no time at equal error. If the estimate or more than one draw in twenty has no
value, no limits are given.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from vibroswarm.analysis.forced_error import DRAWS, LEAST_KNOWN, front_of, on_line
from vibroswarm.analysis.intervals import generator
from vibroswarm.errors import check_choice
from vibroswarm.inference.outcomes import Array
from vibroswarm.league.standings import Standings


def front_table(standings: Standings, reference: str | None = None, seed: int = 0) -> pl.DataFrame:
    """Compute time at equal error and error at equal time for each strategy.

    Args:
        standings: results of the league. reference: label of an entry; by default the first.
        seed: seed of the bootstrap.
    Returns: one row per strategy: strategy, points (number of entries on its front), reference (its label),
        time_at_equal_error_s and error_at_equal_time with ``_low`` and ``_high`` (null where the front has no value),
        reference_time_s and reference_error.
    Raises:
        InputError: no entry has the label ``reference``.
    """
    entries = standings.league.entries
    labels = [entry.label for entry in entries]
    if reference is not None:
        check_choice(reference, "reference", labels)
    against = 0 if reference is None else labels.index(reference)  # index of the reference
    # Figures of each unit, (entries, units).
    time_s = np.array([standings.by_unit(k, "decision_time_s") for k in range(len(entries))])
    error = np.array([standings.by_unit(k, "forced_error") for k in range(len(entries))])
    units = time_s.shape[1]
    rng = generator(seed, "league front")
    weights = rng.multinomial(units, np.full(units, 1.0 / units), size=DRAWS) / units
    # Means over all units (column 0, the estimate) and over each bootstrap draw, (entries, 1 + draws).
    times, errors = (np.column_stack([each.mean(axis=1), each @ weights.T]) for each in (time_s, error))
    rows: list[dict[str, Any]] = []
    for name in dict.fromkeys(entry.strategy for entry in entries):
        own = [k for k, entry in enumerate(entries) if entry.strategy == name]
        time_at_error, error_at_time = np.empty(DRAWS + 1), np.empty(DRAWS + 1)
        for draw in range(DRAWS + 1):
            # ``on_line`` wants rising x. Along a front time rises and error falls; so the front is reversed to look up
            # the time at an error.
            front_s, front_error = front_of(times[own, draw], errors[own, draw])
            error_at_time[draw] = on_line(times[against, draw], front_s, front_error)
            time_at_error[draw] = on_line(errors[against, draw], front_error[::-1], front_s[::-1])
        points = front_of(times[own, 0], errors[own, 0])[0].size
        rows.append(
            {
                "strategy": name,
                "points": points,
                "reference": labels[against],
                **_with_limits("time_at_equal_error_s", time_at_error),
                "reference_time_s": times[against, 0],
                **_with_limits("error_at_equal_time", error_at_time),
                "reference_error": errors[against, 0],
            }
        )
    return pl.DataFrame(rows, infer_schema_length=None).fill_nan(None)


def _with_limits(name: str, values: Array) -> dict[str, float]:
    """Return the columns of a figure from its estimate ``values[0]`` and its bootstrap draws ``values[1:]``.

    The limits are nan if the estimate is nan, or if less than ``LEAST_KNOWN`` of the draws have a value.
    """
    drawn = values[1:][~np.isnan(values[1:])]
    is_enough = drawn.size >= LEAST_KNOWN * DRAWS and not np.isnan(values[0])
    low, high = np.quantile(drawn, (0.025, 0.975)) if is_enough else (np.nan, np.nan)
    return {name: float(values[0]), f"{name}_low": float(low), f"{name}_high": float(high)}
