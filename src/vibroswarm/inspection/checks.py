"""Do the law of the sensor and the places hold in this inspection? What can be tested.

| check | statistic |
|---|---|
| law of still places | largest difference between the distribution of values there and that of the law (Kolmogorov) |
| robots against each other | largest mean of a robot's scores less those of all, in standard errors |
| drift | largest slope of these over time, of a robot or summed over all, in standard errors |
| places | how far a robot's values fit the map of the others less at its places than they should: largest (m - S) / s |

The score of a value is Phi^-1(F(value)), with F that of the place's kind, or a reading of 0 or 1 itself. Each statistic
is compared with those of surfaces drawn at the same places, by the law with its error and the differences between
robots and tiles that it states: without these a law with such differences would be refused nearly always. The p-values
are corrected by Holm's method, so that at most 5 % of right laws are refused by any check.

**Still places** are those at which the other robots feel nothing (``others``), so that no value says by itself where it
counts. Robots are compared with each other, and with time, also on places that vibrate by the others' map: there
only with scores on the same tile, so that it does not matter how strong damage is; where the law says that tiles
differ, also on still ones.

Where something vibrates and places are not exact, some samples were taken on the other kind of place all the same.
Values that are more likely there are then left out, of the samples as of the drawn ones, and F is that of the values
that remain.

**Places** of a robot: S is the sum of ln (1 + (r - 1) q) - ln (1 + (r - 1) mean q), with r the likelihood ratio of a
sample and q the probability that it feels vibration by the map of the others; m and s are its mean and standard
deviation over drawn surfaces. Places that say nothing have S below 0. Its power is the share of drawn robots, whose
places say nothing, that it finds at 5 %. **Where nothing vibrates places cannot be tested**: any place would do.

**The law of damage cannot be tested where there is none.**
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import ndtri

from vibroswarm.inspection.damage import judged, quantiles_of, ratios_at, tiles_below, values_where
from vibroswarm.inspection.others import Others
from vibroswarm.inspection.patches import AT_ONCE
from vibroswarm.inspection.samples import FEWEST, Floats, Law, Samples
from vibroswarm.inspection.scan import p_value
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.statistics.intervals import generator
from vibroswarm.statistics.paired import holm

DRAWN: Final = 499
"""Surfaces drawn for the p-values."""
LEVEL: Final = 0.05
"""A law is refused if the smallest corrected p-value is below this."""
BETWEEN: Final = "robots against each other"
LAW_CHECKS: Final = ("law of still places", BETWEEN, "drift")
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
refused", "refused", "not made" (too few samples are on still places) or "not testable" (of places, and of drift where
each robot has one time). p-values are null without a test. ``power``: of places."""
LEAST_PER_ROBOT: Final = 10
"""Robots with fewer samples are not compared."""
LEAST_PER_TILE: Final = 5
"""Tiles with fewer samples are not compared with themselves, see ``_against_the_place``."""
SURE: Final = 0.02
"""A place is still if vibration is felt there with this probability at most, and vibrates if it is not felt with it."""
LEAST_POWER: Final = 0.5
"""With less power places count as not testable."""


def law_checks(
    samples: Samples, others: Others, still: NDArray[np.bool_] | bool = True, *, drawn: int = DRAWN, seed: int = 4
) -> pl.DataFrame:  # fmt: skip
    """Return the checks of an inspection, with the columns of ``CHECKS``.

    Args:
        others: what the other robots say of the samples' places. still: which samples may be taken as on still places,
            besides; True: all, by what the others say.
    """
    random = generator(seed, "checks of the law")
    quiet = still & (others.felt <= SURE)
    known = quiet | (others.felt >= 1.0 - SURE)
    some = _of_whole_reference(samples).with_frame(samples.frame.filter(pl.Series(known)))
    exact = not (samples.column("spread_x_m").any() or samples.column("spread_y_m").any())
    compared = (some.frame["robot"].value_counts()["count"] >= LEAST_PER_ROBOT).sum()
    possible = (quiet.sum() >= FEWEST, compared >= 2, compared >= 1 and not samples.is_timeless)
    p: dict[str, float] = {}
    if any(possible):
        found = _of_law(some, samples.law, ~quiet[known], others.found and not exact, drawn, random)
        p = {check: value for check, value, may in zip(LAW_CHECKS, found, possible, strict=True) if may}
    power = 0.0
    if len(others.maps) > 1 and others.found:
        of_places, power = _of_places(samples, others, drawn, random)
        p |= {PLACES: of_places} if power >= LEAST_POWER else {}
    corrected = dict(zip(p, holm(list(p.values())), strict=True))
    outcome = dict.fromkeys(LAW_CHECKS, "not made") | {PLACES: "not testable"}
    outcome |= {"drift": "not testable"} if samples.is_timeless else {}
    outcome |= {check: "refused" if value < LEVEL else "not refused" for check, value in corrected.items()}
    numbers = int(quiet.sum()), some.frame.height, some.frame.height, samples.frame.height
    read = dict(zip((*LAW_CHECKS, PLACES), numbers, strict=True))
    rows = [
        (check, read[check], p.get(check), corrected.get(check), word, power if check == PLACES else None)
        for check, word in outcome.items()
    ]
    return pl.DataFrame(rows, CHECKS, orient="row")


def _of_whole_reference(samples: Samples) -> Samples:
    """Return samples whose law draws surfaces by all values of its reference, if these are judged by ranks.

    Each judge left out a third of them. Surfaces drawn by that third alone differ so much from the law that 100 values
    count as 21. Likelihoods need this, as they favour a judge's own values (``damage``), and readings of 0 and 1, which
    are judged by the rates of the law itself.
    """
    law = samples.law
    by_ranks = law.sensor.still_energies is not None and not law.bits
    return replace(samples, law=replace(law, draws=())) if by_ranks else samples


def _of_law(
    some: Samples, law: Law, vibrates: NDArray[np.bool_], only_likely: bool, drawn: int, random: np.random.Generator
) -> list[float]:  # fmt: skip
    """Return the p-values of ``LAW_CHECKS``.

    Args:
        some: samples on places that are still or vibrate, with the law by which surfaces are drawn.
        law: by which they are judged, with its error. vibrates: which are on vibrating places, (samples,).
        only_likely: leave out values that are more likely on places of the other kind.
    """
    ranks = partial(_ranks, vibrates=vibrates, only_likely=only_likely)
    values = values_where(random, some, drawn, vibrates[:, None])
    # In the precision of the law, whose values they may equal.
    value = some.column("value").astype(np.float32).astype(np.float64)[:, None]
    observed = _statistics(some, ranks(law, value), vibrates)
    rank = judged(law, values, ranks)
    # In parts, for memory.
    parts = (rank[:, begin : begin + AT_ONCE] for begin in range(0, drawn, AT_ONCE))
    null = np.hstack([_statistics(some, part, vibrates) for part in parts])
    return [p_value(one, row) for one, row in zip(observed[:, 0].tolist(), null, strict=True)]


def _ranks(law: Law, values: Floats, vibrates: NDArray[np.bool_], only_likely: bool) -> Floats:
    """Return the share of values of the place's kind that are smaller, of each value; nan: it is left out.

    The rank of a reading is the reading itself.
    """
    if law.bits:
        return values
    table, ranks = quantiles_of(law), np.empty(values.shape)
    for own, quantiles, sign in ((~vibrates, table.still, -1.0), (vibrates, table.vibrating, 1.0)):
        kept = sign * ratios_at(law, quantiles) > 0.0 if only_likely else np.ones(quantiles.size, dtype=bool)
        share = np.cumsum(kept * np.gradient(table.u))
        ranks[own] = np.interp(values[own], quantiles, share / share[-1])
        if only_likely:
            ranks[own] = np.where(sign * ratios_at(law, values[own]) > 0.0, ranks[own], np.nan)
    return ranks


def _statistics(some: Samples, rank: Floats, vibrates: NDArray[np.bool_]) -> Floats:
    """Return the statistics of ``LAW_CHECKS`` for each replicate, (checks, replicates).

    Args:
        rank: (samples, replicates), as ``_ranks`` returns them.
    """
    law, counted = some.law, np.isfinite(rank)
    if law.bits:
        score = rank - error_rates(law.sensor, law.place)[0]
        apart_from_law = np.abs(score[~vibrates].mean(axis=0))
    else:
        still = np.sort(rank[~vibrates], axis=0)  # nan is sorted to the end
        at = (np.arange(still.shape[0])[:, None] + 0.5) / np.maximum(counted[~vibrates].sum(axis=0), 1)
        is_last = still != np.vstack([still[1:], np.full_like(still[:1], np.nan)])  # of equal ones
        apart_from_law = np.nanmax(np.abs(still - at) * is_last, axis=0, initial=0.0)
        score = np.nan_to_num(ndtri(np.clip(rank, 1e-6, 1.0 - 1e-6)))
    score = _against_the_place(some, score, counted, vibrates)
    robot, time_s = some.frame["robot"].to_numpy(), some.column("time_s")
    between, drift = np.zeros(rank.shape[1]), np.zeros(rank.shape[1])
    together, squared = np.zeros(rank.shape[1]), np.zeros(rank.shape[1])
    for one in np.unique(robot):
        own = robot == one
        count = counted[own].sum(axis=0)
        enough = count >= LEAST_PER_ROBOT
        between = np.maximum(between, enough * np.abs(score[own].sum(axis=0)) / np.sqrt(np.maximum(count, 1)))
        when = np.where(counted[own], time_s[own, None], np.nan)
        when = np.nan_to_num(when - np.nansum(when, axis=0) / np.maximum(count, 1))
        slope, square = (when * score[own]).sum(axis=0), np.maximum((when**2).sum(axis=0), 1e-18)
        drift = np.maximum(drift, enough * np.abs(slope) / np.sqrt(square))
        together += enough * slope
        squared += enough * square
    drift = np.maximum(drift, np.abs(together) / np.sqrt(np.maximum(squared, 1e-18)))
    return np.stack([apart_from_law, between, drift])


def _against_the_place(
    some: Samples, score: Floats, counted: NDArray[np.bool_], vibrates: NDArray[np.bool_]
) -> Floats:
    """Return scores less their mean on all still places, or on the same tile, in standard deviations.

    What all robots measure alike on a tile, such as damage of another contrast, so is no difference between robots.
    Still tiles are alike, unless the law says that they differ and a tile has ``LEAST_PER_TILE`` samples: the mean of
    fewer would take away what is looked for.
    """
    tile = tiles_below(some)
    _, number, count = np.unique(tile, return_inverse=True, return_counts=True)
    often = count[number] >= LEAST_PER_TILE
    differ = vibrates | (often & bool(some.law.sensor.tile_spread))
    place = np.unique(np.where(differ, 1 + 2 * tile + vibrates, 0), return_inverse=True)[1]
    of_place = (np.arange(place.max() + 1)[:, None] == place).astype(np.float64)
    mean = (of_place @ score) / np.maximum(of_place @ counted, 1.0)
    apart = np.where(counted, score - mean[place], 0.0)
    for own in (vibrates, ~vibrates):
        number = np.maximum(counted[own].sum(axis=0), 1)
        apart[own] /= np.maximum(np.sqrt((apart[own] ** 2).sum(axis=0) / number), 1e-9)
    return apart


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
    null = ((mean - right) / spread).max(axis=0)
    power = float(((mean - wrong) / spread >= np.quantile(null, 1.0 - LEVEL)).mean())
    return p_value(float(observed.max()), null), power
