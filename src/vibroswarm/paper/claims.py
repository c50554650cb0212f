"""Read the paper's claims, and decide them by the intervals of measured values.

A claim has one or more values in each column (a preset of the reproduction). Their limits depend on what was measured:

| value | limits | source |
|---|---|---|
| a constant, marked as such | itself | - |
| a mean x over n runs, with its standard error s | x -+ t(1 - c / 2; n - 1) s | Student 1908 |
| a share, or a difference d of shares, between -1 and 1 | d - w(d+, d-) to d + w(d-, d+) | Zou & Donner 2008 |
| a mean of values between -1 and 1, few of which are far from the others | the wider of the two above | - |
| anything else, also if the standard error is 0 | none | - |

c is 1 - level. d+ and d- are the means over runs of the positive and of the negative parts of d, so that d = d+ - d-.
L(p) and U(p) are the lower and upper limit of the expected value of the parts with mean p. They are Clopper and
Pearson's limits (1934) of a share whose count is the sum of the parts over the runs, rounded down for L and up for U.
Each limit is wrong with probability c / (2 e) instead of c / 2. The e makes the limits hold for all values between 0
and 1, not for 0 and 1 alone: the tail of a sum of such values is at most e times the tail of a binomial of the same
mean (Bentkus 2004). The distances of the limits of d+ and d- from their means are combined as correlated errors are:

    w(p, q)^2 = l^2 + u^2 + 2 r l u, l = p - L(p), u = U(q) - q, r = sqrt(p q / ((1 - p) (1 - q)))

-r is the correlation of the positive and the negative part, of which a run has at most one. With these limits, an event
that occurs in 0 of 100 runs does not get the interval [0, 0].

A value **holds** if its whole interval lies within the bounds of the claim, **fails** if the interval lies wholly
outside, and is **open** otherwise, also if it has no interval. A value **cannot be asked** where the column's floor or
sensor does not allow the question (``item.cannot_ask``), where it would hold whatever was simulated, or where the claim
says that no number of runs settles it (``Claim.cannot``).

| verdict | what it says | condition |
|---|---|---|
| reproduced | every value lies within the bounds | every value holds, at the claim's level |
| in part | some values lie within, some outside | at least one holds and one fails, at the corrected level |
| not reproduced | some value lies outside the bounds | at least one fails and none holds, at the corrected level |
| cannot be asked | nothing | a value cannot be asked, and no other fails |
| inconclusive | nothing | all else: more runs may settle it |

Corrections keep the probability of **any** false verdict in a column at or below a = 0.05:

| name | equation | reason |
|---|---|---|
| level of a claim | 1 - a / (m - k) | of m claims (measured or not), k were settled at stricter levels (Holm 1979) |
| level for "reproduced" | the same | if one value is outside, all hold only if this one holds falsely (Berger 1982) |
| corrected level of single values | 1 - a / ((m - k) v) | any of v values may fail or hold by chance (Bonferroni) |

Each limit is wrong with half the probability 1 - level. If all values lie inside the bounds, the only error is that a
value fails: a' / 2 in all, with a' = a / (m - k). If all values lie outside, there are two possible errors,
"reproduced" and a single value that holds: a' / 2 each. Holm's proof is for claims that can be settled falsely in one
direction. For two directions it is proven for independent claims (Shaffer 1980), and confirmed by simulation for
dependent claims (in the tests). A claim keeps the verdict of the level at which it was settled. "Not significant" is
never "reproduced".

A **check** (``kind = "check"``) is no claim about robots. It compares a preset's constant with the paper's text, or two
numbers of the paper. The same rules apply to checks, in a family of their own (a
family is the set of claims that are corrected together). A check passes, fails or stays open, and is not counted as a
verdict.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from importlib.resources import files
from typing import Any, Final

import polars as pl
from scipy.special import betaincinv, stdtrit

from vibroswarm.core.numbers import number, stated
from vibroswarm.errors import InputError, check_choice, check_known_keys
from vibroswarm.paper.columns import COLUMNS

Limits = tuple[float, float]
"""Lower and upper limit."""
UNBOUNDED: Limits = (-math.inf, math.inf)
"""Limits of a value without an interval."""


def interval(row: Mapping[str, Any], level: float) -> Limits:
    """Return the lower and upper limit of a row of ``MEASURED`` at a level, see the head of this module.

    An exact value is its own lower and upper limit. A row with a standard error above 0 has Student's interval. A row
    of values between -1 and 1 has the mean of max(value, 0) in its column ``above`` and the mean of max(-value, 0) in
    ``below``; these two means give an interval by ``mean_limits``. If a row has both intervals, the result has the
    smaller lower limit and the larger upper limit. If it has none, or its estimate is missing or not finite, the limits
    are infinite.

    Args:
        row: one measured value, with the columns ``MEASURED``. level: confidence level, such as 0.95.
    """
    x = row["estimate"]
    if x is None or not math.isfinite(x):
        return UNBOUNDED
    if row["exact"]:
        return x, x
    error = row["standard_error"]
    intervals = []
    if error is not None and math.isfinite(error) and error > 0.0:
        # At least one degree of freedom; with one run there is no finite standard error.
        half = float(stdtrit(max(row["n"] - 1, 1), 0.5 + level / 2)) * error
        intervals.append((x - half, x + half))
    if row["above"] is not None:
        low, high = mean_limits(row["above"], row["below"], row["n"], level)
        # These are the limits of the mean of the values, which is above - below. The estimate is this mean minus a
        # constant, such as a published value, so the limits are shifted by the same constant.
        shift = x - (row["above"] - row["below"])
        intervals.append((low + shift, high + shift))
    if not intervals:
        return UNBOUNDED
    return min(low for low, _ in intervals), max(high for _, high in intervals)


def mean_limits(above: float, below: float, n: int, level: float) -> Limits:
    """Return the limits of the mean of n independent values between -1 and 1 (Zou & Donner 2008).

    Args:
        above, below: mean of max(value, 0) and mean of max(-value, 0), so that the mean of the values is their
            difference, ``above - below``.
        n: number of values. level: confidence level.
    """
    tail = (1.0 - level) / 2
    (low_above, high_above), (low_below, high_below) = (share_limits(p, n, tail) for p in (above, below))
    rest = (1.0 - above) * (1.0 - below)
    # r of the module's docstring. It exceeds 1 only by rounding, because above + below <= 1. If ``above`` or ``below``
    # is 1, the other is 0, and r is 0 / 0, taken as 0.
    correlation = min(math.sqrt(above * below / rest), 1.0) if rest > 0.0 else 0.0
    # The mean may be lower if ``above`` is lower or ``below`` is higher, and higher the other way round.
    down = _combined(above - low_above, high_below - below, correlation)  # w(above, below)
    up = _combined(high_above - above, below - low_below, correlation)  # w(below, above)
    return above - below - down, above - below + up


def _combined(first: float, second: float, correlation: float) -> float:
    """Return the width w that two errors have together.

    Args:
        first, second: distances l and u of the two limits from their means. correlation: r at the head of this module.
    """
    return math.sqrt(first**2 + second**2 + 2.0 * correlation * first * second)  # w(p, q)


def share_limits(share: float, n: int, tail: float) -> Limits:
    """Return the lower and upper limit of the expected value, given the mean of n independent values between 0 and 1.

    Args:
        share: the mean of the values. n: number of values.
        tail: largest probability with which each limit may be wrong.
    """
    total, each = share * n, tail / math.e
    # The sum of the values, rounded outwards to a count; 1e-9 makes up for rounding errors of the sum.
    least, most = math.floor(total + 1e-9), math.ceil(total - 1e-9)
    # Clopper & Pearson 1934, with the error probability tail / e: see the module's docstring for the e.
    low = float(betaincinv(least, n - least + 1, each)) if least > 0 else 0.0
    high = float(betaincinv(most + 1, n - most, 1.0 - each)) if most < n else 1.0
    return low, high


TESTS: Final = {"within": "within ±", "at_least": "at least", "at_most": "at most"}
"""Tests of a claim: a value is within -``margin`` to ``margin``, at least ``effect``, or at most ``effect``."""
VERDICTS: Final = ("reproduced", "in part", "not reproduced", "inconclusive", "cannot be asked")
"""Verdicts on claims, see the table in the module's docstring."""
CHECKED: Final = {
    "reproduced": "passed",
    "in part": "failed",
    "not reproduced": "failed",
    "inconclusive": "open",
    "cannot be asked": "open",
}
"""Result of a check in place of a verdict."""
KINDS: Final = ("claim", "check")
"""Kinds of claims: claims about robots, and checks of numbers."""
CANNOT: Final = "cannot be asked"
"""State and verdict if a column cannot answer the question of a claim."""
ALPHA: Final = 0.05
"""Largest probability of any false verdict in a column, a."""

MEASURED: Final[dict[str, Any]] = {
    "value": pl.String,
    "column": pl.String,
    "cell": pl.String,
    "estimate": pl.Float64,
    "standard_error": pl.Float64,
    "n": pl.Int64,
    "exact": pl.Boolean,
    "above": pl.Float64,
    "below": pl.Float64,
    "cannot": pl.String,
    "scattered": pl.Float64,
}
"""Columns of the table of measured values, one row per value; ``interval`` gives the limits of a row.

value: name of what is measured, which claims name (``Claim.value``). column: preset of the reproduction. cell: label
of the value. n: number of runs. exact: whether it is a constant, not an estimate. above, below: means of the positive
and of the negative parts of values between -1 and 1. cannot: why the column cannot answer the question, or null.
scattered: the value that evenly scattered points have, in place of those that were simulated; null if nothing of the
kind is known.
"""
UNKNOWN: Final = frozenset({"estimate", "standard_error", "above", "below", "cannot", "scattered"})
"""Columns of ``MEASURED`` that may be null."""


@dataclass(frozen=True)
class Claim:
    """One claim of ``claims.toml``."""

    id: str
    item: str
    """Name of the item that measures it."""
    statement: str
    """What the paper says."""
    measured: str
    """What is measured, in words."""
    test: str
    """One of ``TESTS``: "within" -``margin`` to ``margin``, or "at_least" or "at_most" ``effect``."""
    cells: int
    """Number of values that are measured in each column."""
    margin: float | None = None
    """Bound of the test "within"; None with the other tests."""
    effect: float | None = None
    """Bound of the tests "at_least" and "at_most"; None with the test "within"."""
    columns: tuple[str, ...] = COLUMNS
    """Presets of the reproduction in which the claim is decided."""
    kind: str = "claim"
    """One of ``KINDS``: a claim about robots, or a check of numbers."""
    value: str = ""
    """Name of its measured values, in the column ``value`` of ``MEASURED``; empty: its ``id``."""
    cannot: str | None = None
    """Why no number of our runs can settle it, so that none of its values can be asked."""
    unit: str = ""
    """Unit of the measured value as it is printed: "s", "points", "in belief"; see ``scale``."""

    def __post_init__(self) -> None:
        """Check the fields.

        Raises:
            InputError: an unknown test, kind or column, no cells, or not exactly the bound that the test needs.
        """
        check_choice(self.test, f"{self.id}, test", TESTS)
        check_choice(self.kind, f"{self.id}, kind", KINDS)
        if not math.isfinite(self.bound) or (self.test == "within" and self.bound <= 0):
            needed = "a margin above 0" if self.test == "within" else "a finite effect"
            raise InputError(f"the test '{self.test}' needs {needed}", field=self.id)
        if (self.margin is not None) == (self.effect is not None):
            raise InputError("give a margin or an effect, not both", field=self.id)
        if self.cells < 1 or not self.columns or not set(self.columns) <= set(COLUMNS):
            raise InputError("needs at least one cell, and columns that exist", field=self.id)

    @property
    def bound(self) -> float:
        """The margin, or the effect of the other tests; nan if it is not given."""
        bound = self.margin if self.test == "within" else self.effect
        return math.nan if bound is None else bound

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound between which a value must lie; one of them is infinite unless the test is "within"."""
        if self.test == "within":
            return -self.bound, self.bound
        return (self.bound, math.inf) if self.test == "at_least" else (-math.inf, self.bound)

    @property
    def words(self) -> str:
        """The test in words, with its unit."""
        return f"{TESTS[self.test]} {stated(self.scale * self.bound)} {self.unit}".rstrip()

    @property
    def scale(self) -> float:
        """Factor from measured to printed values: 100 for percent and percentage points."""
        return 100.0 if self.unit == "points" or self.unit.startswith("%") else 1.0


def claims_from(text: str) -> tuple[Claim, ...]:
    """Parse claims from a TOML text.

    Raises:
        InputError: invalid TOML, no claims, an unknown key, an invalid claim, a claim without unit, or a repeated id.
        TypeError: a claim lacks a required key.
    """
    try:
        tables = tomllib.loads(text)["claim"]
    except (ValueError, KeyError) as error:
        raise InputError(f"has no claims: {error}", field="claims.toml") from None
    known = {field.name for field in fields(Claim)}
    claims = []
    for table in tables:
        check_known_keys(table, "claims.toml", known)
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


@dataclass(frozen=True, eq=False)
class Decided:
    """Verdict on one claim in one column."""

    claim: Claim
    column: str
    verdict: str
    """One of ``VERDICTS``; for a check one of the values of ``CHECKED``."""
    level: float
    """Level of the claim, before it is corrected for the number of its values."""
    cells: pl.DataFrame
    """cell, estimate, low, high, level (of these limits), n, holds (holds, fails, open, cannot be asked), why."""


Rows = Sequence[Mapping[str, Any]]
"""Rows of the table ``MEASURED``."""


def state(low: float, high: float, bounds: tuple[float, float]) -> str:
    """Compare an interval with bounds: return "holds" (wholly inside), "fails" (wholly outside) or "open".

    Args:
        low, high: limits of the interval. bounds: lower and upper bound; one of them may be infinite.
    """
    # Tolerance for rounding errors, so that a value equal to a bound lies inside.
    # It is relative to the larger bound, plus 1e-12 for a bound of 0.
    tiny = 1e-9 * max(abs(b) for b in bounds if math.isfinite(b)) + 1e-12
    if bounds[0] - tiny <= low and high <= bounds[1] + tiny:
        return "holds"
    return "fails" if high < bounds[0] - tiny or low > bounds[1] + tiny else "open"


def states_of(rows: Rows, bounds: tuple[float, float], level: float) -> list[str]:
    """Return the state of each row's value: "holds", "fails" or "open" with intervals of this level, or ``CANNOT``."""
    return [CANNOT if row["cannot"] else state(*interval(row, level), bounds) for row in rows]


def corrected(level: float, rows: Rows) -> float:
    """Return the corrected level for single values of a claim (Bonferroni).

    The error 1 - level is divided by the number of values, without the values that cannot be asked.

    Args:
        level: level of the claim. rows: measured values of the claim.
    """
    askable = sum(not row["cannot"] for row in rows)
    return 1.0 - (1.0 - level) / max(askable, 1)  # 1: without such values, the level does not matter


def verdict_of(plain: Sequence[str], strict: Sequence[str]) -> str:
    """Return the verdict on a claim, see the head of this module.

    Args:
        plain: states of the values at the claim's level. strict: their states at the corrected level.
    """
    # Each ``state`` is "holds", "fails", "open" or ``CANNOT``.
    if plain and all(state == "holds" for state in plain):
        return "reproduced"
    if "fails" in strict:
        return "in part" if "holds" in strict else "not reproduced"
    return CANNOT if CANNOT in strict else "inconclusive"


def verdict_at(claim: Claim, rows: Rows, level: float) -> str:
    """Return the verdict on a claim from its measured values, if the claim's level is ``level``."""
    plain, strict = (states_of(rows, claim.bounds, each) for each in (level, corrected(level, rows)))
    return verdict_of(plain, strict)


def settle(
    claims: Sequence[Claim], rows: Mapping[str, Rows], alpha: float = ALPHA
) -> dict[str, tuple[str, float]]:
    """Return the verdict and level of each measured claim of a family, by id, with Holm's procedure.

    A claim is settled when its verdict is neither "inconclusive" nor "cannot be asked". Each round of the procedure
    tests the claims that are not settled yet at a level that is less strict the more claims are settled. It ends when a
    round settles no claim. Claims that were not measured count in the family, but have no verdict.

    Args:
        claims: the whole family. rows: measured rows by claim id; missing or empty for a claim without any.
        alpha: largest probability of any false verdict in the family.
    """
    settled: dict[str, tuple[str, float]] = {}
    measured = [claim for claim in claims if rows.get(claim.id)]
    while True:
        level = 1.0 - alpha / max(len(claims) - len(settled), 1)  # 1: if all are settled, none is tested
        now = {
            claim.id: (verdict_at(claim, rows[claim.id], level), level)
            for claim in measured
            if claim.id not in settled
        }
        newly_settled = {
            claim_id: (verdict, level)
            for claim_id, (verdict, level) in now.items()
            if verdict not in (CANNOT, "inconclusive")
        }
        if not newly_settled:
            return settled | now  # claims that are not settled have the verdict of the last round
        settled |= newly_settled


def decide(measured: pl.DataFrame, claims: Sequence[Claim] | None = None) -> list[Decided]:
    """Decide all claims in all columns in which they were measured; return the verdicts by column and claim.

    The claims of a column are one family for the corrections, and the checks of the column are another family. Measured
    values of other claims, and of columns to which their claim does not apply (``Claim.columns``), are ignored.

    Args:
        measured: table with the columns of ``MEASURED``. claims: claims to decide; None: all.
    Raises:
        InputError: the number of measured values of a claim is not the one that the claim states.
    """
    claims = all_claims() if claims is None else claims
    verdicts = []
    for column in COLUMNS:
        applicable = [claim for claim in claims if column in claim.columns]
        of_column = measured.filter(pl.col("column") == column)
        rows = {claim.id: _rows_of(claim, of_column) for claim in applicable}
        settled: dict[str, tuple[str, float]] = {}
        for kind in KINDS:
            settled |= settle([claim for claim in applicable if claim.kind == kind], rows)
        verdicts += [_decided(c, column, rows[c.id], *settled[c.id]) for c in applicable if c.id in settled]
    return verdicts


def _rows_of(claim: Claim, measured: pl.DataFrame) -> Rows:
    """Return the measured rows of a claim; those that the claim or scattered points rule out state the reason."""
    rows = measured.filter(pl.col("value") == (claim.value or claim.id)).to_dicts()
    return [
        row | {"cannot": claim.cannot or row["cannot"] or _too_easy(claim, row["scattered"])} for row in rows
    ]


def _too_easy(claim: Claim, scattered: float | None) -> str | None:
    """Return a reason if evenly scattered points have a value within the claim's bounds, so that it shows nothing."""
    if scattered is None or state(scattered, scattered, claim.bounds) != "holds":
        return None
    return f"evenly scattered points have {number(scattered, 3, sign=True)}, and would hold, too"


def _decided(claim: Claim, column: str, rows: Rows, verdict: str, level: float) -> Decided:
    """Combine a claim's verdict with a table of its values and their intervals.

    The intervals are at the level that decided: the claim's level for "reproduced", and the corrected level for all
    other verdicts.

    Args:
        claim, column: claim and preset. rows: measured values of the claim in the column.
        verdict, level: verdict and level of the claim, from ``settle``.
    Raises:
        InputError: the number of values is not the one that the claim states.
    """
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
            "why": [row["cannot"] for row in rows],  # why the value cannot be asked, or None
        },
        schema_overrides={
            **dict.fromkeys(("low", "high", "estimate"), pl.Float64), "n": pl.Int64, "why": pl.String,
        },
    )  # fmt: skip
    return Decided(claim, column, CHECKED[verdict] if claim.kind == "check" else verdict, level, cells)
