"""Claims: the file is whole, and verdicts follow from intervals and nothing else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from vibroswarm.paper.claim_values import frame, log_spread, mean, row, share_saved
from vibroswarm.paper.claims import Claim, decide, interval, verdict_of

WITHIN = Claim("a", "difficulty", "Equal.", "difference", "within", 2, margin=10.0)
LEAST = Claim("b", "difficulty", "More.", "difference", "at_least", 1, effect=5.0)


def _decided(rows: Sequence[dict[str, Any]], claims: Sequence[Claim] = (WITHIN, LEAST)) -> dict[str, str]:
    return {one.claim.id: one.verdict for one in decide(frame(rows), claims) if one.column == "paper"}


@pytest.mark.parametrize(
    ("states", "verdict"),
    [
        (["holds", "holds"], "reproduced"),
        (["holds", "open"], "inconclusive"),
        (["holds", "fails"], "in part"),
        (["holds", "fails", "open"], "in part"),
        (["fails", "open"], "not reproduced"),
        (["fails", "cannot be asked"], "not reproduced"),
        (["holds", "cannot be asked"], "cannot be asked"),
        (["open", "cannot be asked"], "cannot be asked"),
        (["open", "open"], "inconclusive"),
        ([], "inconclusive"),
    ],
)
def test_verdicts(states: list[str], verdict: str) -> None:
    assert verdict_of(states, states) == verdict


def test_a_verdict_needs_the_level_that_it_says() -> None:
    """Reproduced at the claim's level; what a single value shows, only at the corrected one."""
    assert verdict_of(["holds", "holds"], ["open", "open"]) == "reproduced"
    assert verdict_of(["holds", "fails"], ["holds", "open"]) == "inconclusive"
    assert verdict_of(["holds", "fails"], ["open", "fails"]) == "not reproduced"


def test_a_difference_that_is_not_significant_is_not_reproduced() -> None:
    wide = [row("a", "paper", k, 0.0, 8.0, 100) for k in ("x", "y")]
    assert _decided(wide) == {"a": "inconclusive"}
    narrow = [row("a", "paper", k, 0.0, 1.0, 100) for k in ("x", "y")]
    assert _decided(narrow) == {"a": "reproduced"}
    one_out = [narrow[0], row("a", "paper", "y", 30.0, 1.0, 100)]
    assert _decided(one_out) == {"a": "in part"}
    one_open = [narrow[0], wide[1]]
    assert _decided(one_open) == {"a": "inconclusive"}


def test_a_failure_is_corrected_for_the_number_of_values() -> None:
    """p = 0.03, by one claim of one value a failure, by one of two none."""
    near = 10.0 + 2.2
    alone = Claim("a", "difficulty", "Equal.", "difference", "within", 1, margin=10.0)
    assert _decided([row("a", "paper", "x", near, 1.0, 10_000)], [alone]) == {"a": "not reproduced"}
    pair = [row("a", "paper", "x", near, 1.0, 10_000), row("a", "paper", "y", 10.0, 1.0, 10_000)]
    assert _decided(pair, [WITHIN]) == {"a": "inconclusive"}


def test_levels_are_those_of_holm() -> None:
    """Ten claims: a p-value between 0.05 / 10 and 0.05 / 9 counts only where a smaller one stands beside it."""
    claims = [Claim(f"c{k}", "i", "s", "m", "at_least", 1, effect=0.0) for k in range(10)]
    near = row("c0", "paper", "x", 2.79, 1.0, 100_000)  # p = 0.0053
    alone = {one.claim.id: one for one in decide(frame([near]), claims)}
    assert alone["c0"].verdict == "inconclusive"
    assert alone["c0"].level == pytest.approx(1 - 0.05 / 10)
    far = row("c1", "paper", "x", 9.0, 1.0, 100_000)
    both = {one.claim.id: one for one in decide(frame([near, far]), claims)}
    assert both["c0"].verdict == both["c1"].verdict == "reproduced"
    assert both["c0"].level == pytest.approx(1 - 0.05 / 9)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    random = np.random.default_rng(7)
    held = [
        low <= 3.0 <= high
        for values in random.normal(3.0, 2.0, (2000, 12))
        for low, high in [interval(mean("a", "paper", "x", values), 0.9)]
    ]
    assert np.mean(held) == pytest.approx(0.9, abs=0.02)


def test_shares_saved_and_log_spreads_have_the_errors_that_repeated_draws_have() -> None:
    random = np.random.default_rng(8)
    saved, spreads = [], []
    for _ in range(400):
        second = random.normal(900.0, 300.0, 200)
        first = 0.8 * second + random.normal(0.0, 50.0, 200)
        saved.append(share_saved("a", "paper", "x", first, second))
        spreads.append(log_spread("a", "paper", "x", first, second))
    for rows, truth in ((saved, 0.2), (spreads, math.log(math.hypot(240.0, 50.0) / 300.0))):
        estimates = np.array([one["estimate"] for one in rows])
        assert estimates.mean() == pytest.approx(truth, abs=0.005)
        assert np.mean([one["standard_error"] for one in rows]) == pytest.approx(estimates.std(), rel=0.12)
