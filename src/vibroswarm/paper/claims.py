"""The paper's claims as data: read, checked, and decided by intervals.

A value **holds** where its whole interval lies within what the claim says, **fails** where it lies wholly outside, and
is **open** otherwise, also where there is no interval (``limits`` has the intervals). A value **cannot be asked** where
the column's floor or sensor does not allow the question (``askable``).

| verdict | what it asserts | when |
|---|---|---|
| reproduced | every value lies within | every value holds, at the claim's level |
| in part | some value lies within and some outside | at least one holds and at least one fails, both corrected |
| not reproduced | some value lies outside | at least one fails, corrected, and none holds |
| cannot be asked | nothing | a value cannot be asked, and no other fails |
| inconclusive | nothing | everything else: more runs may settle it |

Corrections, so that the probability of **any** false verdict in a column is at most a = 0.05:

| name | equation | why |
|---|---|---|
| level of a claim | 1 - a / (m - k) | of m claims (measured or not), k were settled at stricter levels (Holm 1979) |
| for "reproduced" | the same | if one value is outside, all hold only if that one does (Berger 1982) |
| for single values | 1 - a / ((m - k) v) | any of the v values asked may fail or hold by chance (Bonferroni) |

Each limit errs with half of its level's complement. Where all values lie inside, only a failing one errs: a' / 2 in
all, with a' = a / (m - k). Where all lie outside, "reproduced" and a holding one err: a' / 2 each. Holm's proof is for
claims that can be settled falsely in one direction; in two it is proven for independent claims (Shaffer 1980), and
simulated for dependent ones (tests). A claim keeps the verdict of the level at which it was settled. "Not significant"
is never "reproduced".

A **check** (``kind = "check"``) compares a preset's constant with the text, or ours or the paper with itself: no run
can turn it, or it is about the software. By the same rules, in a family of its own, it is passed, failed or open; it
counts as no verdict.
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

from vibroswarm.errors import InputError, nearest
from vibroswarm.paper.columns import COLUMNS
from vibroswarm.paper.limits import interval

TESTS: Final = ("within", "at_least", "at_most")
VERDICTS: Final = ("reproduced", "in part", "not reproduced", "inconclusive", "cannot be asked")
CHECKED: Final = {
    "reproduced": "passed",
    "in part": "failed",
    "not reproduced": "failed",
    "inconclusive": "open",
    "cannot be asked": "open",
}
"""What a check is said to be in place of a verdict."""
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
"""What an item measures for its claims: see ``limits`` for how these give an interval.

exact: a constant, not an estimate. above, below: means of the positive and the negative parts of values between -1 and
1. cannot: why the column cannot ask for this value; null: it can.
"""
UNKNOWN: Final = frozenset({"estimate", "standard_error", "above", "below", "cannot"})
"""Columns of ``MEASURED`` that may be null."""


@dataclass(frozen=True)
class Claim:
    """One claim, as ``claims.toml`` has it."""

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
    """Why negative controls need not turn it."""

    def __post_init__(self) -> None:
        if self.test not in TESTS:
            raise InputError(f"'{self.test}' is no test{nearest(self.test, TESTS)}", field=self.id)
        given = self.margin if self.test == "within" else self.effect
        if given is None or not math.isfinite(given) or (self.test == "within" and given <= 0):
            raise InputError(f"the test '{self.test}' needs a margin above 0, or an effect", field=self.id)
        if (self.margin is not None) == (self.effect is not None):
            raise InputError("has a margin or an effect, not both", field=self.id)
        if self.cells < 1 or not self.columns or not set(self.columns) <= set(COLUMNS):
            raise InputError("needs at least one cell, and columns that exist", field=self.id)
        if self.kind not in KINDS:
            raise InputError(f"'{self.kind}' must be one of {', '.join(KINDS)}", field=self.id)

    @property
    def bounds(self) -> tuple[float, float]:
        """Between which values it holds."""
        if self.test == "within":
            assert self.margin is not None
            return -self.margin, self.margin
        assert self.effect is not None
        return (self.effect, math.inf) if self.test == "at_least" else (-math.inf, self.effect)

    @property
    def words(self) -> str:
        """The test in words."""
        if self.test == "within":
            return f"within ± {self.margin:g}"
        return f"{'at least' if self.test == 'at_least' else 'at most'} {self.effect:g}"


def claims_from(text: str) -> tuple[Claim, ...]:
    """Claims from TOML.

    Raises:
        InputError: no TOML, a key that there is not, an id that stands twice.
    """
    try:
        tables = tomllib.loads(text)["claim"]
    except (ValueError, KeyError) as error:
        raise InputError(f"holds no claims: {error}", field="claims.toml") from None
    known = {field.name for field in fields(Claim)}
    found = []
    for table in tables:
        if unknown := set(table) - known:
            raise InputError(f"there is no such key{nearest(min(unknown), known)}", field=min(unknown))
        found.append(Claim(**{**table, "columns": tuple(table.get("columns", COLUMNS))}))
    if len({claim.id for claim in found}) != len(found):
        raise InputError("an id stands twice", field="claims.toml")
    return tuple(found)


@cache
def all_claims() -> tuple[Claim, ...]:
    """The claims of ``claims.toml``."""
    return claims_from(files("vibroswarm.paper").joinpath("claims.toml").read_text(encoding="utf-8"))


class Decided(NamedTuple):
    """What came of one claim in one column."""

    claim: Claim
    column: str
    verdict: str
    """Of ``VERDICTS``; of a check one of the values of ``CHECKED``."""
    level: float
    """Of the claim, before it is corrected for the number of its values."""
    cells: pl.DataFrame
    """cell, estimate, low, high, level (of these limits), n, holds (holds, fails, open, cannot be asked), why."""


Rows = Sequence[Mapping[str, Any]]


def state(low: float, high: float, bounds: tuple[float, float]) -> str:
    """holds, fails or open."""
    tiny = 1e-9 * max(abs(b) for b in bounds if math.isfinite(b)) + 1e-12
    if bounds[0] - tiny <= low and high <= bounds[1] + tiny:
        return "holds"
    return "fails" if high < bounds[0] - tiny or low > bounds[1] + tiny else "open"


def states_of(rows: Rows, bounds: tuple[float, float], level: float) -> list[str]:
    """The state of each value with intervals of this level."""
    return [CANNOT if row["cannot"] else state(*interval(row, level), bounds) for row in rows]


def corrected(level: float, rows: Rows) -> float:
    """The level for single values of a claim: corrected for how many can be asked."""
    return 1.0 - (1.0 - level) / max(sum(not row["cannot"] for row in rows), 1)


def verdict_of(plain: Sequence[str], strict: Sequence[str]) -> str:
    """The verdict by the states of the values at the claim's level, and at the corrected one; see the head."""
    if plain and all(one == "holds" for one in plain):
        return "reproduced"
    if "fails" in strict:
        return "in part" if "holds" in strict else "not reproduced"
    return CANNOT if CANNOT in strict else "inconclusive"


def verdict_at(claim: Claim, rows: Rows, level: float) -> str:
    """The verdict of a claim at a level."""
    plain, strict = (states_of(rows, claim.bounds, each) for each in (level, corrected(level, rows)))
    return verdict_of(plain, strict)


def settle(
    claims: Sequence[Claim], rows: Mapping[str, Rows], alpha: float = ALPHA
) -> dict[str, tuple[str, float]]:
    """Verdict and level of each claim that was measured, by Holm's steps over a family.

    Args:
        claims: all of the family. rows: of each claim by its id, as ``MEASURED``; none where it was not measured.
    """
    found: dict[str, tuple[str, float]] = {}
    open_ = [claim for claim in claims if rows.get(claim.id)]
    while True:  # what is settled at the strictest level relaxes the level of the others
        level = 1.0 - alpha / max(len(claims) - len(found), 1)
        now = {claim.id: verdict_at(claim, rows[claim.id], level) for claim in open_ if claim.id not in found}
        settled = {
            one: (verdict, level) for one, verdict in now.items() if verdict not in (CANNOT, "inconclusive")
        }
        if not settled:
            return found | {one: (verdict, level) for one, verdict in now.items()}
        found |= settled


def decide(measured: pl.DataFrame, claims: Sequence[Claim] | None = None) -> list[Decided]:
    """All claims in all their columns that were measured; claims and checks of a column are a family each.

    Args:
        measured: ``MEASURED``. claims: without, all.
    """
    claims = all_claims() if claims is None else claims
    found = []
    for column in COLUMNS:
        asked = [claim for claim in claims if column in claim.columns]
        here = measured.filter(pl.col("column") == column)
        rows = {claim.id: here.filter(pl.col("claim") == claim.id).to_dicts() for claim in asked}
        settled: dict[str, tuple[str, float]] = {}
        for kind in KINDS:
            settled |= settle([claim for claim in asked if claim.kind == kind], rows)
        found += [_decided(c, column, rows[c.id], *settled[c.id]) for c in asked if c.id in settled]
    return found


def _decided(claim: Claim, column: str, rows: Rows, verdict: str, level: float) -> Decided:
    if len(rows) != claim.cells:
        raise InputError(f"{len(rows)} values were measured, and {claim.cells} are asked for", field=claim.id)
    shown = level if verdict == "reproduced" else corrected(level, rows)
    limits = [(-math.inf, math.inf) if row["cannot"] else interval(row, shown) for row in rows]
    cells = pl.DataFrame(
        {
            "cell": [row["cell"] for row in rows],
            "estimate": [row["estimate"] for row in rows],
            "low": [low if math.isfinite(low) else None for low, _ in limits],
            "high": [high if math.isfinite(high) else None for _, high in limits],
            "level": [shown] * len(rows),
            "n": [row["n"] for row in rows],
            "holds": states_of(rows, claim.bounds, shown),
            "why": [row["cannot"] for row in rows],
        },
        schema_overrides={
            **dict.fromkeys(("low", "high", "estimate"), pl.Float64), "n": pl.Int64, "why": pl.String,
        },
    )  # fmt: skip
    return Decided(claim, column, CHECKED[verdict] if claim.kind == "check" else verdict, level, cells)
