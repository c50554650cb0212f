"""Does the law of the sensor hold in this inspection? What can be tested where nothing is damaged.

| check | statistic |
|---|---|
| law of still places | largest difference between the distribution of values there and that of the law (Kolmogorov) |
| robots against each other | largest difference of a robot's mean normal score from that of all, in standard errors |
| drift | largest correlation of a robot's normal scores with time, in standard errors |

The normal score of a value is Phi^-1(F_still(value)). Each statistic is compared with those of intact surfaces, drawn
at the same places with the differences between robots and tiles that the law states: without them a law with such
differences would be refused nearly always. The p-values are corrected by Holm's method, so that at most 5 % of right
laws are refused by any check. **The law of damage cannot be tested where there is none.**
"""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import ndtri

from vibroswarm.analysis.intervals import generator
from vibroswarm.analysis.paired import holm
from vibroswarm.inspection.damage import Table, drawn_values, tables_of
from vibroswarm.inspection.samples import FEWEST, Floats, Samples

DRAWN: Final = 499
"""Intact surfaces drawn for the p-values."""
LEVEL: Final = 0.05
"""A law is refused if the smallest corrected p-value is below this."""
CHECKS: Final = ("law of still places", "robots against each other", "drift")
LEAST_PER_ROBOT: Final = 10
"""Robots with fewer samples are not compared."""


def law_checks(
    samples: Samples, still: NDArray[np.bool_], *, drawn: int = DRAWN, seed: int = 4
) -> pl.DataFrame:
    """Return a row for each check: check, p_value, corrected (by Holm), refused; p-values are null if too few samples.

    Args:
        still: which samples are taken as on still places, (samples,).
    """
    if still.sum() < FEWEST:
        empty = pl.Series([None] * len(CHECKS), dtype=pl.Float64)
        return pl.DataFrame({"check": CHECKS, "p_value": empty, "corrected": empty, "refused": False})
    table = tables_of(samples.law, False)
    some = samples.with_frame(samples.frame.filter(pl.Series(still)))
    robot = np.unique(some.frame["robot"].to_numpy(), return_inverse=True)[1].astype(np.int64)
    time_s = some.column("time_s")
    observed = _statistics(some.column("value")[:, None], table, robot, time_s)
    random = generator(seed, "checks of the law")
    null = _statistics(drawn_values(random, some, drawn), table, robot, time_s)
    p = (1 + (null >= observed).sum(axis=1)) / (drawn + 1)
    corrected = np.array(holm(p))
    return pl.DataFrame({"check": CHECKS, "p_value": p, "corrected": corrected, "refused": corrected < LEVEL})


def _statistics(values: Floats, table: Table, robot: NDArray[np.int64], time_s: Floats) -> Floats:
    """Return the statistics of each replicate, (checks, replicates).

    Args:
        values: (samples, replicates). robot: number of each sample's robot, from 0.
    """
    u = np.interp(values, table.still, table.u)
    rank = (np.arange(u.shape[0])[:, None] + 0.5) / u.shape[0]
    kolmogorov = np.abs(np.sort(u, axis=0) - rank).max(axis=0)
    score = ndtri(np.clip(u, 1e-6, 1.0 - 1e-6))
    scale = np.maximum(score.std(axis=0), 1e-9)
    apart, drift = np.zeros(u.shape[1]), np.zeros(u.shape[1])
    for each in range(int(robot.max()) + 1):
        own = robot == each
        if own.sum() < LEAST_PER_ROBOT:
            continue
        root = np.sqrt(own.sum())
        if not own.all():
            apart = np.maximum(
                apart, root * np.abs(score[own].mean(axis=0) - score[~own].mean(axis=0)) / scale
            )
        when = time_s[own] - time_s[own].mean()
        when /= max(float(np.sqrt((when**2).sum())), 1e-9)
        drift = np.maximum(drift, np.abs(when @ score[own]) / scale)
    return np.stack([kolmogorov, apart, drift])
