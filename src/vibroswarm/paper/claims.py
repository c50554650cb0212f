"""The paper's claims as data: read, checked, and decided by intervals.

| name | symbol | equation |
|---|---|---|
| a measured value, its standard error, its degrees of freedom | x, s, n - 1 | of a mean over n runs |
| claims | m | of one column, whether they were measured or not |
| level of the interval of a claim | 1 - a / (m - k) | k claims were settled at stricter levels (Holm 1979) |
| interval | x -+ t(1 - a / (2 (m - k)); n - 1) s | |

A value **holds** where its whole interval lies within what the claim says, **fails** where it lies wholly outside,
and is **open** otherwise: also where there is no interval. A claim with several values is settled when none is
open. All hold: reproduced. None holds and at least one fails: not reproduced. Some hold: in part. Otherwise: cannot
be told. "Not significant" is thus never "reproduced". Within a claim nothing more is corrected, since all its
values have to hold.
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
from scipy.special import stdtrit

from vibroswarm.errors import InputError, nearest
from vibroswarm.paper.columns import COLUMNS

TESTS: Final = ("within", "at_least", "at_most")
VERDICTS: Final = ("reproduced", "in part", "not reproduced", "cannot be told")
ALPHA: Final = 0.05

MEASURED: Final[dict[str, Any]] = {
    "claim": pl.String,
    "column": pl.String,
    "cell": pl.String,
    "estimate": pl.Float64,
    "standard_error": pl.Float64,
    "n": pl.Int64,
}
"""What an item measures for its claims. A standard error of 0: known exactly; null: it cannot be told."""


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
            raise InputError("needs at least one cell, and columns that there are", field=self.id)

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
    level: float
    cells: pl.DataFrame
    """cell, estimate, low, high (at that level), n, holds (text: holds, fails, open)."""


def interval(row: Mapping[str, Any], level: float) -> tuple[float, float]:
    """Student's limits of a measured value; infinite where its error cannot be told."""
    x, error, n = row["estimate"], row["standard_error"], row["n"]
    if x is None or not math.isfinite(x) or error is None or not math.isfinite(error):
        return -math.inf, math.inf
    if error == 0.0:
        return x, x
    half = float(stdtrit(max(n - 1, 1), 0.5 + level / 2)) * error
    return x - half, x + half


def state(low: float, high: float, bounds: tuple[float, float]) -> str:
    """holds, fails or open."""
    tiny = 1e-9 * max(abs(b) for b in bounds if math.isfinite(b)) + 1e-12
    if bounds[0] - tiny <= low and high <= bounds[1] + tiny:
        return "holds"
    return "fails" if high < bounds[0] - tiny or low > bounds[1] + tiny else "open"


def verdict_of(states: Sequence[str]) -> str:
    """See the head of this module."""
    if states and all(one == "holds" for one in states):
        return "reproduced"
    if "holds" in states:
        return "in part"
    return "not reproduced" if "fails" in states else "cannot be told"


def decide(measured: pl.DataFrame, claims: Sequence[Claim] | None = None) -> list[Decided]:
    """All claims in all their columns that were measured, Holm-corrected within a column.

    Args:
        measured: ``MEASURED``. claims: without, all.
    """
    claims = all_claims() if claims is None else claims
    return [one for column in COLUMNS for one in _column(measured, column, claims)]


def _column(measured: pl.DataFrame, column: str, claims: Sequence[Claim]) -> list[Decided]:
    asked = [claim for claim in claims if column in claim.columns]
    rows = {
        claim.id: measured.filter((pl.col("claim") == claim.id) & (pl.col("column") == column)).to_dicts()
        for claim in asked
    }
    open_ = [claim for claim in asked if rows[claim.id]]
    settled: dict[str, float] = {}
    while True:  # Holm: what is settled at the strictest level relaxes the level of the others
        level = 1.0 - ALPHA / max(len(asked) - len(settled), 1)
        now = [claim for claim in open_ if claim.id not in settled and _settles(claim, rows[claim.id], level)]
        if not now:
            break
        settled |= dict.fromkeys((claim.id for claim in now), level)
    return [_decided(claim, column, rows[claim.id], settled.get(claim.id, level)) for claim in open_]


def _settles(claim: Claim, rows: Sequence[Mapping[str, Any]], level: float) -> bool:
    return all(state(*interval(row, level), claim.bounds) != "open" for row in rows)


def _decided(claim: Claim, column: str, rows: Sequence[Mapping[str, Any]], level: float) -> Decided:
    if len(rows) != claim.cells:
        raise InputError(f"{len(rows)} values were measured, and {claim.cells} are asked for", field=claim.id)
    limits = [interval(row, level) for row in rows]
    states = [state(*pair, claim.bounds) for pair in limits]
    cells = pl.DataFrame(
        {
            "cell": [row["cell"] for row in rows],
            "estimate": [row["estimate"] for row in rows],
            "low": [low if math.isfinite(low) else None for low, _ in limits],
            "high": [high if math.isfinite(high) else None for _, high in limits],
            "n": [row["n"] for row in rows],
            "holds": states,
        },
        schema_overrides={"low": pl.Float64, "high": pl.Float64, "estimate": pl.Float64, "n": pl.Int64},
    )
    return Decided(claim, column, verdict_of(states), level, cells)
