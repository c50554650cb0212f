"""Compare strategies at equal error and at equal time, along what each can reach with its own settings.

Each entry of a strategy is a point (decision time, forced error). The front of a strategy joins those of its points
that no other of its points beats in both, by straight lines. Every point of a line can be reached: a swarm that draws
one of two settings for each run has the mean time and error of both.

| name | equation |
|---|---|
| time at equal error | time at which the front reaches the forced error of the reference |
| error at equal time | forced error of the front at the decision time of the reference |

Limits are percentiles of a bootstrap over (size, run) units, drawn once for all strategies, so that comparisons stay
paired; each draw has its own front. Beyond its ends a front has no value: a strategy that never gets as good as the
reference has no time at equal error. If more than one draw in twenty has no value, no limits are given.
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
    """Compute both figures for each strategy.

    Args:
        reference: the label of an entry; by default the first. seed: of the bootstrap.
    Returns: strategy, points (entries on its front), time_at_equal_error_s and error_at_equal_time with ``_low`` and
    ``_high``, null where the front does not reach; and those of the reference.
    Raises:
        InputError: the reference does not take part.
    """
    entries = standings.league.entries
    labels = [entry.label for entry in entries]
    if reference is not None:
        check_choice(reference, "reference", labels)
    against = 0 if reference is None else labels.index(reference)
    time_s = np.array([standings.by_unit(k, "decision_time_s") for k in range(len(entries))])
    error = np.array([standings.by_unit(k, "forced_error") for k in range(len(entries))])
    units = time_s.shape[1]
    rng = generator(seed, "league front")
    weights = rng.multinomial(units, np.full(units, 1.0 / units), size=DRAWS) / units
    times, errors = (np.column_stack([each.mean(axis=1), each @ weights.T]) for each in (time_s, error))
    rows: list[dict[str, Any]] = []
    for name in dict.fromkeys(entry.strategy for entry in entries):
        mine = [k for k, entry in enumerate(entries) if entry.strategy == name]
        at_error, at_time = np.empty(DRAWS + 1), np.empty(DRAWS + 1)
        for draw in range(DRAWS + 1):
            x, y = front_of(times[mine, draw], errors[mine, draw])
            at_time[draw] = on_line(times[against, draw], x, y)
            at_error[draw] = on_line(errors[against, draw], y[::-1], x[::-1])
        points = front_of(times[mine, 0], errors[mine, 0])[0].size
        rows.append(
            {
                "strategy": name,
                "points": points,
                "reference": labels[against],
                **_with_limits("time_at_equal_error_s", at_error),
                "reference_time_s": times[against, 0],
                **_with_limits("error_at_equal_time", at_time),
                "reference_error": errors[against, 0],
            }
        )
    return pl.DataFrame(rows, infer_schema_length=None).fill_nan(None)


def _with_limits(name: str, values: Array) -> dict[str, float]:
    drawn = values[1:][~np.isnan(values[1:])]
    low, high = np.quantile(drawn, (0.025, 0.975)) if drawn.size >= LEAST_KNOWN * DRAWS else (np.nan, np.nan)
    return {name: float(values[0]), f"{name}_low": float(low), f"{name}_high": float(high)}
