"""Do the law of the sensor and the places hold in this inspection? What can be tested.

| check | statistic |
|---|---|
| law of still places | largest difference between the distribution of values there and that of the law (Kolmogorov) |
| robots against each other | largest difference of a robot's mean score from that of all, in standard errors |
| drift | largest correlation of a robot's scores with time, in standard errors |
| places | how far a robot's values fit the map of the others less at its places than they should: largest (m - S) / s |

The score of a value is Phi^-1(F_still(value)), or a reading of 0 or 1 itself. Each statistic is compared with those of
surfaces drawn at the same places, by the law with its error and the differences between robots and tiles that it
states: without these a law with such differences would be refused nearly always. The p-values are corrected by Holm's
method, so that at most 5 % of right laws are refused by any check.

**Still places** are those at which the other robots feel nothing (``others``), so that no value says by itself where it
counts. Where something vibrates and places are not exact, some samples were taken there all the same. Values that are
more likely where it vibrates are then left out, of the samples as of the drawn ones: what remains of such samples is
few. Their score is F_still(value) among the values that remain, so that these few do not count much.

**Places** of a robot: S is the sum of ln (1 + (r - 1) q) - ln (1 + (r - 1) mean q), with r the likelihood ratio of a
sample and q the probability that it feels vibration by the map of the others; m and s are its mean and standard
deviation over drawn surfaces. Places that say nothing have S below 0. Its power is the share of drawn robots, whose
places say nothing, that it finds at 5 %. **Where nothing vibrates places cannot be tested**: any place would do.

**The law of damage cannot be tested where there is none.**
"""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import ndtri

from vibroswarm.analysis.intervals import generator
from vibroswarm.analysis.paired import holm
from vibroswarm.inspection.damage import drawn_values, judged, ratios_at, tables_of, values_where
from vibroswarm.inspection.others import Others
from vibroswarm.inspection.samples import FEWEST, Floats, Law, Samples
from vibroswarm.observation.energy_model import error_rates

DRAWN: Final = 499
"""Surfaces drawn for the p-values."""
LEVEL: Final = 0.05
"""A law is refused if the smallest corrected p-value is below this."""
LAW_CHECKS: Final = ("law of still places", "robots against each other", "drift")
PLACES: Final = "places"
CHECKS: Final[Any] = {
    "check": pl.String,
    "samples": pl.UInt32,
    "p_value": pl.Float64,
    "corrected": pl.Float64,
    "outcome": pl.String,
    "power": pl.Float64,
}
"""A row for each check. ``samples``: how many it reads. ``corrected``: the p-value by Holm's method. ``outcome``: "not
refused", "refused", "not made" (too few samples are on still places) or "not testable" (of places). p-values are null
without a test. ``power``: of places."""
LEAST_PER_ROBOT: Final = 10
"""Robots with fewer samples are not compared."""
STILL: Final = 0.02
"""A place is still if vibration is felt there with this probability at most."""
LEAST_POWER: Final = 0.5
"""With less power places count as not testable."""


def law_checks(
    samples: Samples, others: Others, still: NDArray[np.bool_] | None = None, *, drawn: int = DRAWN, seed: int = 4
) -> pl.DataFrame:  # fmt: skip
    """Return the checks of an inspection, with the columns of ``CHECKS``.

    Args:
        others: what the other robots say of the samples' places. still: which samples may be taken as on still places,
            besides; None: all, by what the others say.
    """
    random = generator(seed, "checks of the law")
    quiet = others.felt <= STILL if still is None else still & (others.felt <= STILL)
    some = samples.with_frame(samples.frame.filter(pl.Series(quiet)))
    exact = not (samples.column("spread_x_m").any() or samples.column("spread_y_m").any())
    compared = (some.frame["robot"].value_counts()["count"] >= LEAST_PER_ROBOT).sum()
    possible = (quiet.sum() >= FEWEST, compared >= 2, compared >= 1)
    p: dict[str, float] = {}
    if any(possible):
        found = _of_law(some, others.found and not exact, drawn, random)
        p = {check: value for check, value, may in zip(LAW_CHECKS, found, possible, strict=True) if may}
    power = 0.0
    if len(others.maps) > 1 and others.found:
        of_places, power = _of_places(samples, others, drawn, random)
        p |= {PLACES: of_places} if power >= LEAST_POWER else {}
    corrected = dict(zip(p, holm(list(p.values())), strict=True))
    outcome = dict.fromkeys(LAW_CHECKS, "not made") | {PLACES: "not testable"}
    outcome |= {check: "refused" if value < LEVEL else "not refused" for check, value in corrected.items()}
    read = dict.fromkeys(LAW_CHECKS, int(quiet.sum())) | {PLACES: samples.frame.height}
    rows = [
        (check, read[check], p.get(check), corrected.get(check), word, power if check == PLACES else None)
        for check, word in outcome.items()
    ]
    return pl.DataFrame(rows, CHECKS, orient="row")


def _p_values(observed: Floats, null: Floats) -> list[float]:
    """Return the p-value of each statistic, (checks, 1), against drawn ones, (checks, drawn)."""
    return [float((1 + (row >= one).sum()) / (row.size + 1)) for one, row in zip(observed, null, strict=True)]


def _of_law(some: Samples, only_still: bool, drawn: int, random: np.random.Generator) -> list[float]:
    """Return the p-values of ``LAW_CHECKS``.

    Args:
        some: samples on still places. only_still: leave out values that are more likely where it vibrates.
    """
    robot, time_s = some.frame["robot"].to_numpy(), some.column("time_s")
    ranks = partial(_ranks, only_still=only_still)
    of_drawn = judged(some.law, drawn_values(random, some, drawn), ranks)
    observed, null = (
        _statistics(some.law, rank, only_still, robot, time_s)
        for rank in (ranks(some.law, some.column("value")[:, None]), of_drawn)
    )
    return _p_values(observed, null)


def _ranks(law: Law, values: Floats, only_still: bool) -> Floats:
    """Return the share of still values that are smaller, of each value, or a reading itself; nan: it is left out."""
    if law.bits:
        return values
    table = tables_of(law)
    kept = ratios_at(law, table.still) < 0.0 if only_still else np.ones(table.u.size, dtype=bool)
    share = np.cumsum(kept * np.gradient(table.u))
    rank = np.interp(values, table.still, share / share[-1])
    return np.where(ratios_at(law, values) < 0.0, rank, np.nan) if only_still else rank


def _statistics(
    law: Law, rank: Floats, only_still: bool, robot: NDArray[np.uint16], time_s: Floats
) -> Floats:
    """Return the statistics of ``LAW_CHECKS`` for each replicate, (checks, replicates).

    Args:
        rank: (samples, replicates), as ``_ranks`` returns them. robot, time_s: of each sample.
    """
    counted = np.isfinite(rank)
    number = np.maximum(counted.sum(axis=0), 1)
    if law.bits:
        score = rank - error_rates(law.sensor, law.place)[0]
        apart_from_law = np.abs(score.mean(axis=0))
    else:
        at = (np.arange(rank.shape[0])[:, None] + 0.5) / number
        # nan is sorted to the end
        apart_from_law = np.nanmax(np.abs(np.sort(rank, axis=0) - at), axis=0, initial=0.0)
        score = np.nan_to_num(rank - 0.5) if only_still else ndtri(np.clip(rank, 1e-6, 1.0 - 1e-6))
    scale = np.maximum(np.sqrt((score**2).sum(axis=0) / number), 1e-9)
    between, drift = np.zeros(rank.shape[1]), np.zeros(rank.shape[1])
    for one in np.unique(robot):
        own = robot == one
        count = counted[own].sum(axis=0)
        enough = (count >= LEAST_PER_ROBOT) & (number > count)
        mean = score[own].sum(axis=0) / np.maximum(count, 1)
        rest = score[~own].sum(axis=0) / np.maximum(number - count, 1)
        between = np.maximum(between, enough * np.sqrt(count) * np.abs(mean - rest) / scale)
        when = np.where(counted[own], time_s[own, None], np.nan)
        when = np.nan_to_num(when - np.nansum(when, axis=0) / np.maximum(count, 1))
        length = np.maximum(np.sqrt((when**2).sum(axis=0)), 1e-9)
        drift = np.maximum(
            drift, (count >= LEAST_PER_ROBOT) * np.abs((when * score[own]).sum(axis=0)) / length / scale
        )
    return np.stack([apart_from_law, between, drift])


def _of_places(
    samples: Samples, others: Others, drawn: int, random: np.random.Generator
) -> tuple[float, float]:
    """Return the p-value of the check of places, and its power: the mean over robots whose places say nothing."""
    robot, felt = samples.frame["robot"].to_numpy(), others.felt
    anywhere = np.empty_like(felt)
    for one in others.maps:
        anywhere[robot == one] = felt[robot == one].mean()

    def fits(ratios: Floats) -> Floats:
        """Return S of each robot and replicate, (robots, replicates), from log ratios."""
        more = np.expm1(ratios)
        each = np.log1p(more * felt[:, None]) - np.log1p(more * anywhere[:, None])
        return np.stack([each[robot == one].sum(axis=0) for one in others.maps])

    nowhere = random.random((felt.size, drawn)) < anywhere[:, None]
    right, wrong = (
        fits(judged(samples.law, values_where(random, samples, drawn, inside), ratios_at))
        for inside in (others.drawn(random, drawn), nowhere)
    )
    mean, spread = right.mean(axis=1, keepdims=True), right.std(axis=1, keepdims=True) + 1e-9
    observed = (mean - fits(samples.column("log_ratio")[:, None])) / spread
    null = ((mean - right) / spread).max(axis=0, keepdims=True)
    power = float(((mean - wrong) / spread >= np.quantile(null, 1.0 - LEVEL)).mean())
    return _p_values(observed.max(axis=0, keepdims=True), null)[0], power
