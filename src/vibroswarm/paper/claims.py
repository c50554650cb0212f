"""Read the paper's claims, and decide them by the limits of measured values.

A claim has one or more values in each column (a preset of the reproduction). Limits of all values of a column are at
one level, 1 - 0.05 / n with the number n of values that the column's claims have (Bonferroni): with 95 % confidence all
limits of a column hold at once, whatever the dependence between values.

| value | limits | source |
|---|---|---|
| a constant | itself | - |
| a mean over runs | Student's; none if nearly all runs are equal | Student 1908 |
| a mean of shares | Student's, at least those of rare events (``intervals.allowing_for_rare``) | Wilson 1927 |
| the same, less a published mean of N runs | half-widths of both added in quadrature | - |

| verdict | condition |
|---|---|
| not reproduced | the limits of a value lie wholly outside the bounds |
| cannot be asked | else, and a value cannot be asked where floor or sensor do not allow the question |
| reproduced | the limits of all values lie within the bounds |
| inconclusive | else: more runs may settle it |
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.resources import files
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy.special import stdtrit

from vibroswarm.paper.columns import COLUMNS
from vibroswarm.statistics.intervals import FEW, Interval, allowing_for_rare, mean_interval

Limits = tuple[float, float]
Selection = dict[str, Any]
CANNOT: Final = "cannot be asked"
VERDICTS: Final = ("reproduced", "not reproduced", "inconclusive", CANNOT)
ALPHA: Final = 0.05
"""Largest probability that any limit of a column does not hold."""


class Claim(BaseModel):
    """One claim of ``claims.toml``, where the fields are explained."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    id: str
    item: str
    statement: str
    measured: str
    unit: str
    values: int
    within: float = math.inf
    at_least: float = -math.inf
    at_most: float = math.inf
    columns: tuple[str, ...] = COLUMNS
    check: bool = False
    cannot: str = ""
    study: str = ""
    figure: str = ""
    statistic: Literal["difference", "share saved", "log spread"] = "difference"
    first: Selection | list[Selection] = {}
    second: Selection | list[Selection] | None = None
    beyond: Selection | list[Selection] | None = None
    least: bool = False
    less: float | list[str] = 0.0
    published_runs: int | None = None
    spread: Selection | None = None
    error_of: float | None = None
    asked: bool = False

    @property
    def bounds(self) -> Limits:
        """Lower and upper bound of the measured value."""
        return max(self.at_least, -self.within), min(self.at_most, self.within)


@cache
def all_claims() -> tuple[Claim, ...]:
    """Return the claims of ``claims.toml``."""
    text = files("vibroswarm.paper").joinpath("claims.toml").read_text(encoding="utf-8")
    return tuple(Claim(**table) for table in tomllib.loads(text)["claim"])


class Value(NamedTuple):
    """A measured value of a claim in a column, and its limits at a level."""

    claim: str
    column: str
    cell: str
    estimate: float
    runs: int
    limits: Callable[[float], Limits]
    cannot: str = ""


def constant(claim: str, column: str, cell: str, value: float, cannot: str = "") -> Value:
    """Return a value that has no sampling error."""
    return Value(claim, column, cell, value, 1, lambda level: (value, value), cannot)


def mean(
    claim: str,
    column: str,
    cell: str,
    by_run: NDArray[np.float64],
    less: float = 0.0,
    *,
    published_error: float = 0.0,
    apart: float = math.nan,
    cannot: str = "",
) -> Value:
    """Return the mean over runs, minus ``less``."""
    limits = partial(_mean_limits, by_run - less, published_error, apart)
    found = mean_interval(by_run - less)
    return Value(claim, column, cell, found.estimate, found.n, limits, cannot)


def estimated(claim: str, column: str, cell: str, found: Interval, cannot: str = "") -> Value:
    """Return a value that is known by an interval, as if its limits were Student's."""
    error = (found.high - found.low) / 2 / float(stdtrit(max(found.n - 1, 1), 0.5 + found.level / 2))

    def limits(level: float) -> Limits:
        half = error * float(stdtrit(max(found.n - 1, 1), 0.5 + level / 2))
        return found.estimate - half, found.estimate + half

    return Value(claim, column, cell, found.estimate, found.n, limits, cannot)


def _mean_limits(by_run: NDArray[np.float64], error: float, apart: float, level: float) -> Limits:
    most = int(np.unique(by_run, return_counts=True)[1].max(initial=0))
    if math.isnan(apart) and by_run.size - most < min(
        FEW, most
    ):  # the few others say too little of the scatter
        return -math.inf, math.inf
    found = allowing_for_rare(mean_interval(by_run, level), by_run, apart)
    half = error * float(stdtrit(max(found.n - 1, 1), 0.5 + level / 2))
    down, up = found.estimate - found.low, found.high - found.estimate
    return found.estimate - math.hypot(down, half), found.estimate + math.hypot(up, half)


@dataclass(frozen=True, eq=False)
class Decided:
    """Verdict on one claim in one column."""

    claim: Claim
    column: str
    verdict: str
    """One of ``VERDICTS``."""
    level: float
    values: pl.DataFrame
    """cell, estimate with ``_low`` and ``_high``, runs, state (within, outside, open, cannot be asked), why."""


def decide(measured: Sequence[Value], claims: Sequence[Claim] | None = None) -> list[Decided]:
    """Decide all claims in all columns in which they were measured, by column and claim."""
    decided = []
    for column in COLUMNS:
        of_column = [claim for claim in claims or all_claims() if column in claim.columns]
        level = 1.0 - ALPHA / max(sum(claim.values for claim in of_column), 1)
        for claim in of_column:
            values = [one for one in measured if (one.claim, one.column) == (claim.id, column)]
            if values and len(values) != claim.values:
                raise ValueError(f"{claim.id}: {len(values)} values, and not {claim.values}")
            if values:
                decided.append(_decided(claim, column, values, level))
    return decided


def _decided(claim: Claim, column: str, values: Sequence[Value], level: float) -> Decided:
    rows = []
    for one in values:
        why = claim.cannot or one.cannot
        low, high = (-math.inf, math.inf) if why or math.isnan(one.estimate) else one.limits(level)
        rows.append(
            (
                one.cell,
                one.estimate,
                low,
                high,
                one.runs,
                CANNOT if why else state(low, high, claim.bounds),
                why,
            )
        )
    names = ["cell", "estimate", "estimate_low", "estimate_high", "runs", "state", "why"]
    frame = pl.DataFrame(rows, schema=names, orient="row")
    return Decided(claim, column, verdict_of(frame["state"].to_list()), level, frame)


def state(low: float, high: float, bounds: Limits) -> str:
    """Return whether limits lie within bounds, outside, or neither (open); a value equal to a bound lies within."""
    tiny = 1e-9 * max(abs(bound) for bound in bounds if math.isfinite(bound)) + 1e-12  # rounding errors
    if bounds[0] - tiny <= low and high <= bounds[1] + tiny:
        return "within"
    return "outside" if high < bounds[0] - tiny or low > bounds[1] + tiny else "open"


def verdict_of(states: Sequence[str]) -> str:
    """Return the verdict on a claim from the states of its values."""
    if "outside" in states:
        return "not reproduced"
    if CANNOT in states:
        return CANNOT
    return "inconclusive" if "open" in states else "reproduced"
