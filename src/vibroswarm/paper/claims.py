"""Intervals of measured values, by what was measured of them.

| value | limits | source |
|---|---|---|
| a constant, marked as such | itself | - |
| a mean over n runs, with its standard error s | x -+ t(1 - c / 2; n - 1) s | Student 1908 |
| a mean of values of which many may be alike and few far off | the wider of Student's and the next | - |
| a share, or a difference d of shares, between -1 and 1 | d - w(d+, d-) to d + w(d-, d+) | Zou & Donner 2008 |
| anything else, a standard error of 0 too | none | - |

c is 1 - level. d+ and d- are the means of the positive and of the negative parts of d, so that d = d+ - d-. L and U are
Clopper and Pearson's limits (1934) of a share whose count is the sum of the parts, rounded outwards, each at c / (2 e).
The e makes them hold for all values between 0 and 1, not for 0 and 1 alone: the tail of a sum of such values is at most
e times that of a binomial of the same mean (Bentkus 2004). The widths of the two are put together as errors are:

    w(p, q)^2 = l^2 + u^2 + 2 r l u, l = p - L(p), u = U(q) - q, r = sqrt(p q / ((1 - p) (1 - q)))

with -r the correlation of two parts of which a run has one at most. So 0 of 100 runs do not give [0, 0].

The paper's claims as data: read, checked, and decided by intervals.

A value **holds** if its whole interval lies within the bounds of the claim, **fails** if it lies wholly outside, and is
**open** otherwise, also without an interval. A value **cannot be asked** where the column's floor or sensor does not
allow the question (``item.cannot_ask``).

| verdict | meaning | condition |
|---|---|---|
| reproduced | every value lies within | every value holds, at the claim's level |
| in part | some values lie within and some outside | at least one holds and at least one fails, both corrected |
| not reproduced | some value lies outside | at least one fails, corrected, and none holds |
| cannot be asked | nothing | a value cannot be asked, and no other fails |
| inconclusive | nothing | all else: more runs may settle it |

Corrections keep the probability of **any** false verdict in a column at or below a = 0.05:

| name | equation | reason |
|---|---|---|
| level of a claim | 1 - a / (m - k) | of m claims (measured or not), k were settled at stricter levels (Holm 1979) |
| for "reproduced" | the same | if one value is outside, all hold only if that one does (Berger 1982) |
| for single values | 1 - a / ((m - k) v) | any of the v values asked may fail or hold by chance (Bonferroni) |

Each limit errs with half of its level's complement. If all values lie inside, only a failing one is an error: a' / 2 in
all, with a' = a / (m - k). If all lie outside, "reproduced" and a holding one are errors: a' / 2 each. Holm's proof is
for claims that can be settled falsely in one direction; for two it is proven for independent claims (Shaffer 1980), and
simulated for dependent ones (tests). A claim keeps the verdict of the level at which it was settled. "Not significant"
is never "reproduced".

A **check** (``kind = "check"``) compares a preset's constant with the text, or ours or the paper with itself: no run
can change it, or it is about the software. The same rules apply, in a family of its own; it passes, fails or stays
open, and counts as no verdict.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from importlib.resources import files
from typing import Any, Final, NamedTuple

import polars as pl
from scipy.special import betaincinv, stdtrit

from vibroswarm.core.notebook_view import NotebookView, html_view, short_text
from vibroswarm.errors import InputError, nearest
from vibroswarm.paper.columns import COLUMNS

Limits = tuple[float, float]
UNBOUNDED: Limits = (-math.inf, math.inf)


def interval(row: Mapping[str, Any], level: float) -> Limits:
    """Return the interval of a row of ``MEASURED`` at a level.

    An exact value has no width. Where there is a choice the wider interval counts; without any it is infinite.
    """
    x = row["estimate"]
    if x is None or not math.isfinite(x):
        return UNBOUNDED
    if row["exact"]:
        return x, x
    error, bounded = row["standard_error"], row["above"] is not None
    candidates = []
    if error is not None and math.isfinite(error) and error > 0.0:
        half = float(stdtrit(max(row["n"] - 1, 1), 0.5 + level / 2)) * error
        candidates.append((x - half, x + half))
    if bounded:
        low, high = mean_limits(row["above"], row["below"], row["n"], level)
        shift = x - (row["above"] - row["below"])
        candidates.append((low + shift, high + shift))
    return (
        (min(low for low, _ in candidates), max(high for _, high in candidates)) if candidates else UNBOUNDED
    )


def mean_limits(above: float, below: float, n: int, level: float) -> Limits:
    """Return the limits of the mean of n independent values between -1 and 1 (Zou & Donner 2008).

    Args:
        above, below: means of their positive and negative parts.
    """
    tail = (1.0 - level) / 2
    (low_above, high_above), (low_below, high_below) = (share_limits(p, n, tail) for p in (above, below))
    rest = (1.0 - above) * (1.0 - below)
    correlation = min(math.sqrt(above * below / rest), 1.0) if rest > 0.0 else 0.0
    down = _together(above - low_above, high_below - below, correlation)
    up = _together(high_above - above, below - low_below, correlation)
    return above - below - down, above - below + up  # Zou & Donner 2008


def _together(first: float, second: float, alike: float) -> float:
    return math.sqrt(first**2 + second**2 + 2.0 * alike * first * second)  # w(p, q)


def share_limits(share: float, n: int, tail: float) -> Limits:
    """Return the limits of the mean of n independent values between 0 and 1, each wrong with probability ``tail`` at
    most."""
    total, each = share * n, tail / math.e
    least, most = math.floor(total + 1e-9), math.ceil(total - 1e-9)
    # Clopper & Pearson 1934, at c / (2 e)
    low = float(betaincinv(least, n - least + 1, each)) if least > 0 else 0.0
    high = float(betaincinv(most + 1, n - most, 1.0 - each)) if most < n else 1.0
    return low, high


TESTS: Final = ("within", "at_least", "at_most")
VERDICTS: Final = ("reproduced", "in part", "not reproduced", "inconclusive", "cannot be asked")
CHECKED: Final = {
    "reproduced": "passed",
    "in part": "failed",
    "not reproduced": "failed",
    "inconclusive": "open",
    "cannot be asked": "open",
}
"""Result of a check in place of a verdict."""
KINDS: Final = ("claim", "check")
CANNOT: Final = "cannot be asked"
ALPHA: Final = 0.05

MEASURED: Final[dict[str, Any]] = {
    "claim": pl.String,
    "column": pl.String,
    "cell": pl.String,
    "estimate": pl.Float64,
    "standard_error": pl.Float64,
    "n": pl.Int64,
    "exact": pl.Boolean,
    "above": pl.Float64,
    "below": pl.Float64,
    "cannot": pl.String,
}
"""What an item measures for its claims; ``interval`` gives the limits.

exact: a constant, not an estimate. above, below: means of the positive and the
negative parts of values between -1 and 1. cannot: why the column cannot answer the question, or null.
"""
UNKNOWN: Final = frozenset({"estimate", "standard_error", "above", "below", "cannot"})
"""Columns of ``MEASURED`` that may be null."""


@dataclass(frozen=True)
class Claim(NotebookView):
    """One claim of ``claims.toml``."""

    id: str
    item: str
    statement: str
    measured: str
    test: str
    cells: int
    margin: float | None = None
    effect: float | None = None
    columns: tuple[str, ...] = COLUMNS
    kind: str = "claim"
    no_control: str | None = None
    """Why negative controls need not change its verdict."""
    unit: str = ""
    """Of the measured value as it is printed: "s", "points", "in belief"; see ``scale``."""

    def __post_init__(self) -> None:
        if self.test not in TESTS:
            raise InputError(f"'{self.test}' is not a test{nearest(self.test, TESTS)}", field=self.id)
        bound = self.margin if self.test == "within" else self.effect
        if bound is None or not math.isfinite(bound) or (self.test == "within" and bound <= 0):
            raise InputError(f"the test '{self.test}' needs a margin above 0, or an effect", field=self.id)
        if (self.margin is not None) == (self.effect is not None):
            raise InputError("has a margin or an effect, not both", field=self.id)
        if self.cells < 1 or not self.columns or not set(self.columns) <= set(COLUMNS):
            raise InputError("needs at least one cell, and columns that exist", field=self.id)
        if self.kind not in KINDS:
            raise InputError(f"'{self.kind}' must be one of {', '.join(KINDS)}", field=self.id)

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds between which the claim holds."""
        if self.test == "within":
            assert self.margin is not None
            return -self.margin, self.margin
        assert self.effect is not None
        return (self.effect, math.inf) if self.test == "at_least" else (-math.inf, self.effect)

    @property
    def words(self) -> str:
        """The test in words, with its unit."""
        if self.test == "within":
            assert self.margin is not None
            return f"within ± {self.scale * self.margin:g} {self.unit}".rstrip()
        assert self.effect is not None
        return (
            f"{'at least' if self.test == 'at_least' else 'at most'} {self.scale * self.effect:g} {self.unit}"
        )

    @property
    def scale(self) -> float:
        """Factor from measured to printed values: 100 for percent and percentage points."""
        return 100.0 if self.unit == "points" or self.unit.startswith("%") else 1.0


def claims_from(text: str) -> tuple[Claim, ...]:
    """Parse claims from TOML.

    Raises:
        InputError: invalid TOML, an unknown key, a claim without unit, or a repeated id.
    """
    try:
        tables = tomllib.loads(text)["claim"]
    except (ValueError, KeyError) as error:
        raise InputError(f"has no claims: {error}", field="claims.toml") from None
    known = {field.name for field in fields(Claim)}
    claims = []
    for table in tables:
        if unknown := set(table) - known:
            raise InputError(f"unknown key{nearest(min(unknown), known)}", field=min(unknown))
        claims.append(Claim(**{**table, "columns": tuple(table.get("columns", COLUMNS))}))
        if not claims[-1].unit:
            raise InputError("needs a unit, or what its numbers count: 'in belief'", field=claims[-1].id)
    if len({claim.id for claim in claims}) != len(claims):
        raise InputError("an id is repeated", field="claims.toml")
    return tuple(claims)


@cache
def all_claims() -> tuple[Claim, ...]:
    """Return the claims of ``claims.toml``."""
    return claims_from(files("vibroswarm.paper").joinpath("claims.toml").read_text(encoding="utf-8"))


class Decided(NamedTuple):
    """Verdict on one claim in one column."""

    claim: Claim
    column: str
    verdict: str
    """One of ``VERDICTS``; for a check one of the values of ``CHECKED``."""
    level: float
    """Level of the claim, before it is corrected for the number of its values."""
    cells: pl.DataFrame
    """cell, estimate, low, high, level (of these limits), n, holds (holds, fails, open, cannot be asked), why."""

    def _repr_html_(self) -> str:
        return html_view(self)

    def __repr__(self) -> str:
        return short_text(self)


Rows = Sequence[Mapping[str, Any]]


def state(low: float, high: float, bounds: tuple[float, float]) -> str:
    """Compare an interval with bounds: holds, fails or open."""
    tiny = 1e-9 * max(abs(b) for b in bounds if math.isfinite(b)) + 1e-12
    if bounds[0] - tiny <= low and high <= bounds[1] + tiny:
        return "holds"
    return "fails" if high < bounds[0] - tiny or low > bounds[1] + tiny else "open"


def states_of(rows: Rows, bounds: tuple[float, float], level: float) -> list[str]:
    """Return the state of each value, with intervals of this level; ``CANNOT`` if it cannot answer the question."""
    return [CANNOT if row["cannot"] else state(*interval(row, level), bounds) for row in rows]


def corrected(level: float, rows: Rows) -> float:
    """Return the level of single values of a claim, corrected for how many can be asked (Bonferroni)."""
    return 1.0 - (1.0 - level) / max(sum(not row["cannot"] for row in rows), 1)


def verdict_of(plain: Sequence[str], strict: Sequence[str]) -> str:
    """Return the verdict from the states at the claim's level and at the corrected one, see the head of this module."""
    if plain and all(state == "holds" for state in plain):
        return "reproduced"
    if "fails" in strict:
        return "in part" if "holds" in strict else "not reproduced"
    return CANNOT if CANNOT in strict else "inconclusive"


def verdict_at(claim: Claim, rows: Rows, level: float) -> str:
    """Return the verdict on a claim at a level."""
    plain, strict = (states_of(rows, claim.bounds, each) for each in (level, corrected(level, rows)))
    return verdict_of(plain, strict)


def settle(
    claims: Sequence[Claim], rows: Mapping[str, Rows], alpha: float = ALPHA
) -> dict[str, tuple[str, float]]:
    """Return the verdict and level of each measured claim of a family, by Holm's procedure; unmeasured ones are absent.

    Args:
        claims: the whole family. rows: measured rows by claim id; none where a claim was not measured.
    """
    decided_now: dict[str, tuple[str, float]] = {}
    open_ = [claim for claim in claims if rows.get(claim.id)]
    while True:  # Holm: claims settled at the strictest level relax the level of the others
        level = 1.0 - alpha / max(len(claims) - len(decided_now), 1)
        now = {
            claim.id: verdict_at(claim, rows[claim.id], level)
            for claim in open_
            if claim.id not in decided_now
        }
        settled = {
            claim_id: (verdict, level)
            for claim_id, verdict in now.items()
            if verdict not in (CANNOT, "inconclusive")
        }
        if not settled:
            return decided_now | {claim_id: (verdict, level) for claim_id, verdict in now.items()}
        decided_now |= settled


def decide(measured: pl.DataFrame, claims: Sequence[Claim] | None = None) -> list[Decided]:
    """Decide all claims in all columns in which they were measured; claims and checks of a column are a family each.

    Args:
        measured: ``MEASURED``. claims: default all.
    """
    claims = all_claims() if claims is None else claims
    verdicts = []
    for column in COLUMNS:
        applicable = [claim for claim in claims if column in claim.columns]
        of_column = measured.filter(pl.col("column") == column)
        rows = {claim.id: of_column.filter(pl.col("claim") == claim.id).to_dicts() for claim in applicable}
        settled: dict[str, tuple[str, float]] = {}
        for kind in KINDS:
            settled |= settle([claim for claim in applicable if claim.kind == kind], rows)
        verdicts += [_decided(c, column, rows[c.id], *settled[c.id]) for c in applicable if c.id in settled]
    return verdicts


def _decided(claim: Claim, column: str, rows: Rows, verdict: str, level: float) -> Decided:
    """Return verdict on a claim, with the interval of each value at the level that decided it."""
    if len(rows) != claim.cells:
        raise InputError(f"{len(rows)} values were measured, but {claim.cells} are needed", field=claim.id)
    shown_level = level if verdict == "reproduced" else corrected(level, rows)
    limits = [(-math.inf, math.inf) if row["cannot"] else interval(row, shown_level) for row in rows]
    cells = pl.DataFrame(
        {
            "cell": [row["cell"] for row in rows],
            "estimate": [row["estimate"] for row in rows],
            "low": [low if math.isfinite(low) else None for low, _ in limits],
            "high": [high if math.isfinite(high) else None for _, high in limits],
            "level": [shown_level] * len(rows),
            "n": [row["n"] for row in rows],
            "holds": states_of(rows, claim.bounds, shown_level),
            "why": [row["cannot"] for row in rows],
        },
        schema_overrides={
            **dict.fromkeys(("low", "high", "estimate"), pl.Float64), "n": pl.Int64, "why": pl.String,
        },
    )  # fmt: skip
    return Decided(claim, column, CHECKED[verdict] if claim.kind == "check" else verdict, level, cells)
