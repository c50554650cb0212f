"""The family-wise error of verdicts, by simulation; verdicts of each claim alone must fail the same test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vibroswarm.paper.claim_values import row
from vibroswarm.paper.claims import ALPHA, Claim, Rows, settle

MARGIN = 4.0
CLAIMS, VALUES, FAMILIES = 8, 6, 600
N = 100_000
"""Degrees of freedom: normal, so that the simulation needs no runs."""
MOST = float(ALPHA + 2.7 * np.sqrt(ALPHA * (1 - ALPHA) / FAMILIES))
"""What 5 % may look like: 2.7 standard errors are one-sided 5 % over the 15 cases."""
Rule = Callable[[Sequence[Claim], dict[str, Rows]], dict[str, tuple[str, float]]]

INSIDE, OUTSIDE = MARGIN - 1e-6, MARGIN + 1e-6
TRUTHS = {
    "all values just inside": np.full((CLAIMS, VALUES), INSIDE),
    "all values just outside": np.full((CLAIMS, VALUES), OUTSIDE),
    "one of each claim just outside": np.where(np.arange(VALUES) == 0, OUTSIDE, 0.0)[None].repeat(CLAIMS, 0),
    # Half of the claims are settled, rightly, at the strictest level, which relaxes that of the others.
    "half of the claims settled, the others just inside": np.where(
        np.arange(CLAIMS)[:, None] < CLAIMS // 2, 40.0, np.full((CLAIMS, VALUES), INSIDE)
    ),
    "half of the claims settled, the others just outside": np.where(
        np.arange(CLAIMS)[:, None] < CLAIMS // 2, 40.0, np.full((CLAIMS, VALUES), OUTSIDE)
    ),
}
SHARED = {"independent": 0.0, "values of a claim alike": 0.7, "all values alike": 0.9}


def each_alone(claims: Sequence[Claim], rows: dict[str, Rows]) -> dict[str, tuple[str, float]]:
    """The verdicts as if no claim had others beside it."""
    return {claim.id: settle([claim], rows)[claim.id] for claim in claims}


def _false(verdict: str, truth: NDArray[np.float64]) -> bool:
    """Whether a verdict asserts what is not so."""
    inside = np.abs(truth) <= MARGIN
    return {
        "reproduced": not inside.all(),
        "not reproduced": bool(inside.all()),
        "in part": bool(inside.all() or not inside.any()),
    }.get(verdict, False)


def _errors(rule: Rule, truth: NDArray[np.float64], shared: str) -> float:
    """Share of families with at least one false verdict."""
    random = np.random.default_rng(11)
    claims = [Claim(f"c{k}", "i", "s", "m", "within", VALUES, margin=MARGIN) for k in range(CLAIMS)]
    weight, wrong = SHARED[shared], 0
    for _ in range(FAMILIES):
        own = random.normal(size=truth.shape)
        common = random.normal(size=(1, 1) if shared == "all values alike" else (CLAIMS, 1))
        # The margin is 16 standard errors: a value in the middle is sure to hold.
        x = truth + (np.sqrt(1 - weight) * own + np.sqrt(weight) * common) * MARGIN / 16
        rows: dict[str, Any] = {
            claim.id: [row(claim.id, "paper", str(v), x[k, v], MARGIN / 16, N) for v in range(VALUES)]
            for k, claim in enumerate(claims)
        }
        found = rule(claims, rows)
        wrong += any(_false(found[claim.id][0], truth[k]) for k, claim in enumerate(claims))
    return wrong / FAMILIES


@pytest.mark.parametrize("shared", list(SHARED))
@pytest.mark.parametrize("truth", list(TRUTHS))
def test_a_false_verdict_in_a_family_is_as_rare_as_said(truth: str, shared: str) -> None:
    assert _errors(settle, TRUTHS[truth], shared) <= MOST


@pytest.mark.parametrize("truth", ["all values just inside", "one of each claim just outside"])
def test_claims_judged_each_alone_fail(truth: str) -> None:
    """The negative control."""
    assert _errors(each_alone, TRUTHS[truth], "independent") > MOST
