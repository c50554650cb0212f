"""Compare two cells run by run: with the same seed, run r has the same motion and floor in both cells.

| figure | symbol | equation |
|---|---|---|
| difference | D | mean over runs of d_r = first_r - second_r |
| interval, p-value | - | Student's limits and paired t-test, see ``intervals.student_test`` |
| interval, if few d_r are far from others | - | at least that of rare events, see ``intervals.allowing_for_rare`` |
| p-value, if these limits hold 0 | - | at least 1 - level |
| corrected p-value | - | Holm, for m figures: cumulative maximum of (m - i + 1) p_(i), at most 1 (Holm 1979) |
| equivalent | - | the interval lies inside (-margin, margin): two one-sided tests, each at (1 - level) / 2 |

All comparisons on one block of seeds share its luck; repeat important ones with another seed. With one fixed floor the
interval applies to that floor. With I motions crossed with J floors, d_ij = D + M_i + F_j + e_ij, the variance of the
mean is

    Var(M) / I + Var(F) / J + Var(e) / (I J),

so vary floors and motions over runs instead of crossing few of either. No significant difference is not equality.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from vibroswarm.inference.outcomes import numbers
from vibroswarm.statistics.figures import BY_COLUMN, ESTIMATES, FIGURES
from vibroswarm.statistics.intervals import (
    Interval,
    Tested,
    Values,
    allowing_for_rare,
    columns_of,
    draw_limits,
    generator,
    plain,
    student_test,
    within,
    without_nan,
)

COMPARED: Final = tuple(figure.by_run for figure in FIGURES if figure.compared)
"""Columns of ``figures.run_figures`` that are compared by default."""
ESTIMATED: Final = tuple(name for name in ESTIMATES if BY_COLUMN[name].better)
"""Those that are compared where the task asks for a number."""


DRAWS: Final = 1000
"""Bootstrap draws of runs, where a figure is computed from the means of several cells."""
LEAST_KNOWN: Final = 0.95
"""Smallest share of draws in which a figure is defined for which it has limits."""


@dataclass(frozen=True)
class Paired:
    """Comparison of one figure in two cells, over the runs that have the figure in both ("pairs").

    ``first``, ``second``: means; ``difference``: first - second; ``wins``: runs in which the first cell does better.
    """

    figure: str
    """Name of the figure in ``figures.run_figures``."""
    first: float
    second: float
    difference: Interval
    wins: int
    ties: int
    losses: int
    pairs: int
    unpaired: int
    """Runs left out: they are in one cell only, or lack the figure in a cell."""
    p_value: float
    p_holm: float

    def as_row(self) -> dict[str, float | int | str | None]:
        """Return the fields as one flat row, the interval last; a number that is not finite becomes None."""
        row: dict[str, Any] = {name: plain(value) for name, value in self.__dict__.items()}
        interval = row.pop("difference")
        return row | columns_of("difference", interval) | {"level": interval.level}


def compare(
    first: pl.DataFrame,
    second: pl.DataFrame,
    figures: Sequence[str] = COMPARED,
    level: float = 0.95,
) -> tuple[Paired, ...]:
    """Compare two cells figure by figure; p-values are Holm-corrected over the figures.

    Args:
        first, second: ``run_figures`` of the two cells, of the same seed; rows with the same run number are a pair.
    """
    both, *rows = np.intersect1d(first["run"], second["run"], assume_unique=True, return_indices=True)
    in_one_only = first.height + second.height - 2 * both.size  # number of runs that only one cell has
    compared = [
        _compare_one(numbers(first[name])[rows[0]], numbers(second[name])[rows[1]], name, in_one_only, level)
        for name in figures
    ]
    corrected = holm([paired.p_value for paired in compared])
    return tuple(replace(paired, p_holm=p) for paired, p in zip(compared, corrected, strict=True))


def differences(first: ArrayLike, second: ArrayLike) -> Values:
    """Return first - second of paired values; 0 for pairs that differ by rounding alone, nan where one is nan."""
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    d: Values = a - b
    d[np.isclose(a, b, rtol=1e-12, atol=1e-12)] = 0.0
    return d


def difference(
    first: ArrayLike,
    second: ArrayLike,
    level: float = 0.95,
    most: float = math.nan,
) -> Tested:
    """Estimate and test the mean of first - second, (runs,) each.

    Args:
        most: by how much runs can differ; nan: not known, then as much as all values here, and 0, are apart.
    """
    d = differences(first, second)
    found, unseen = student_test(d, level), most
    if math.isnan(most):
        unseen = float(np.ptp(np.append(without_nan(np.asarray((first, second), dtype=np.float64)), 0.0)))
    interval = allowing_for_rare(found.interval, d, unseen)
    p_value = found.p_value
    if interval != found.interval and not interval.excludes(0.0):
        p_value = max(p_value, 1.0 - level)
    # Too few pairs have no limits, and keep none.
    return Tested(within(interval, -most, most) if math.isfinite(interval.low) else interval, p_value)


def _compare_one(first: Values, second: Values, figure: str, in_one_only: int, level: float) -> Paired:
    """Compare one figure over the runs of both cells, (runs,) each; p is not corrected yet."""
    is_known = ~(np.isnan(first) | np.isnan(second))
    a, b = first[is_known], second[is_known]
    of_figure = BY_COLUMN[figure]
    interval, p_value = difference(a, b, level, of_figure.most_apart)
    d = differences(a, b)
    better = d * of_figure.better
    return Paired(
        figure=figure,
        first=float(a.mean()) if a.size else math.nan,
        second=float(b.mean()) if b.size else math.nan,
        difference=interval,
        wins=int((better > 0).sum()),
        ties=int((better == 0).sum()),
        losses=int((better < 0).sum()),
        pairs=d.size,
        unpaired=in_one_only + first.size - d.size,
        p_value=p_value,
        p_holm=p_value,
    )


def drawn_means(values: Values, seed: int, purpose: str) -> Values:
    """Return the mean of each row over the runs, and over the runs of each bootstrap draw: (rows, 1 + draws).

    Calls with the same seed, purpose and number of runs have the same draws, so that rows stay paired run by run.
    """
    weights = _weights(values.shape[1], seed, purpose)
    return np.column_stack([values.mean(axis=1), values @ weights.T])


@lru_cache(maxsize=1)  # several figures of the same runs are drawn one after the other
def _weights(runs: int, seed: int, purpose: str) -> Values:
    """Return the share of each run in each bootstrap draw, (draws, runs)."""
    return generator(seed, purpose).multinomial(runs, np.full(runs, 1.0 / runs), size=DRAWS) / runs


def drawn_interval(drawn: Values, runs: int, how: str) -> Interval:
    """Return an estimate and the 95 % limits of its draws, (1 + draws,); nan if too few are defined."""
    known = drawn[1:][~np.isnan(drawn[1:])]
    is_enough = known.size >= LEAST_KNOWN * (drawn.size - 1) and not math.isnan(drawn[0])
    low, high = draw_limits(known, runs, 0.95) if is_enough else (math.nan, math.nan)
    return Interval(float(drawn[0]), low, high, 0.95, runs, how)


def holm(p_values: ArrayLike) -> list[float]:
    """Correct p-values of figures that are compared at once, by Holm's method; nan does not count."""
    p = np.asarray(p_values, dtype=np.float64).ravel()
    corrected = np.full(p.size, np.nan)
    defined = np.flatnonzero(~np.isnan(p))
    order = defined[np.argsort(p[defined], kind="stable")]
    scaled = p[order] * np.arange(order.size, 0, -1)  # (m - i + 1) p_(i)
    corrected[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)  # Holm 1979
    return [float(value) for value in corrected]


def side(interval: Interval) -> int:
    """Return 1 if the interval lies above 0, -1 if it lies below 0, and 0 if it contains 0 or its limits are nan."""
    return int(interval.low > 0) - int(interval.high < 0)


def equivalent(interval: Interval, margin: float) -> bool:
    """Return whether the whole interval lies inside (-margin, margin), for a margin that was set beforehand.

    A 95 % interval gives two one-sided tests at 2.5 % each. Where a few large differences dominate the mean, they are
    wrong more often. An interval of width 0 says nothing of how differences vary, and is never equivalent.
    """
    return bool(-margin < interval.low < interval.high < margin)
