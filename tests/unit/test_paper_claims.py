"""Claims: the file is whole, and verdicts follow from intervals and nothing else."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import vibroswarm.paper
from vibroswarm.errors import InputError
from vibroswarm.paper.claim_values import exact, frame, log_spread, mean, row, share_saved
from vibroswarm.paper.claims import MEASURED, Claim, all_claims, claims_from, decide, interval, verdict_of
from vibroswarm.paper.columns import COLUMNS, parameters, published
from vibroswarm.paper.items import all_items

WITHIN = Claim("a", "difficulty", "Equal.", "difference", "within", 2, margin=10.0)
LEAST = Claim("b", "difficulty", "More.", "difference", "at_least", 1, effect=5.0)


def _decided(rows: Sequence[dict[str, Any]], claims: Sequence[Claim] = (WITHIN, LEAST)) -> dict[str, str]:
    return {one.claim.id: one.verdict for one in decide(frame(rows), claims) if one.column == "paper"}


def test_every_claim_has_a_unit_and_says_its_bound_in_it() -> None:
    by_id = {claim.id: claim.words for claim in all_claims()}
    assert by_id["fill-time"] == "at least 50 s"
    assert by_id["soft-wrong"] == "at most 2 points"
    assert by_id["soft-belief"] == "at least -0.02 in belief"
    assert by_id["search-score-holds"] == "within ± 10 %"
    for claim in all_claims():  # what is said to be in s, m, or a share of robots is measured so
        said = [unit for unit in ("s", "m") if re.search(rf", {unit}(,|$)", claim.measured)]
        said += ["s"] if claim.measured.startswith("seconds ") else []
        assert said == ([claim.unit] if claim.unit in ("s", "m") else []), claim.id
        assert not claim.measured.startswith("share of robots wrong") or claim.unit == "points"
        assert not claim.measured.startswith("belief") or claim.unit == "in belief"


def test_the_file_names_every_item_but_those_without_a_claim_and_no_other() -> None:
    items = {item.name for item in all_items()}
    named = {claim.item for claim in all_claims()}
    assert named == items
    assert len({claim.id for claim in all_claims()}) == len(all_claims())


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ('test = "within"', "margin above 0"),
        ('test = "within"\nmargin = -1', "margin above 0"),
        ('test = "at_least"\nmargin = 1', "effect"),
        ('test = "at_most"\nmargin = 1\neffect = 1', "not both"),
        ('test = "about"\nmargin = 1', "there is no 'about'"),
        ('test = "within"\nmargin = 1\ncolumns = ["mine"]', "columns"),
        ('test = "within"\nmargin = 1\nmargins = 2', "unknown key"),
    ],
)
def test_a_wrong_claim_is_refused(change: str, says: str) -> None:
    text = f'[[claim]]\nid = "x"\nitem = "difficulty"\nstatement = "s"\nmeasured = "m"\ncells = 1\n{change}\n'
    with pytest.raises(InputError, match=says):
        claims_from(text)


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


def test_a_value_without_an_error_or_a_number_is_inconclusive() -> None:
    assert _decided([row("b", "paper", "x", 9.0, None, 1)]) == {"b": "inconclusive"}
    assert _decided([row("b", "paper", "x", math.nan, 1.0, 9)]) == {"b": "inconclusive"}
    assert _decided([exact("b", "paper", "x", 9.0)]) == {"b": "reproduced"}
    assert _decided([exact("b", "paper", "x", 4.0)]) == {"b": "not reproduced"}


def test_a_standard_error_of_0_is_not_exact() -> None:
    assert _decided([row("b", "paper", "x", 9.0, 0.0, 100)]) == {"b": "inconclusive"}
    assert _decided([mean("b", "paper", "x", np.full(100, 9.0))]) == {"b": "inconclusive"}
    lumped = np.concatenate([np.full(95, 9.0), np.arange(5.0)])
    assert mean("b", "paper", "x", lumped)["standard_error"] is None


def test_a_value_that_cannot_be_asked_says_why_and_is_not_counted() -> None:
    asked = row("a", "paper", "x", 0.0, 1.0, 100)
    not_asked = row("a", "paper", "y", 0.0, 1.0, 100, "wrong side")
    (one,) = [each for each in decide(frame([asked, not_asked]), [WITHIN]) if each.column == "paper"]
    assert one.verdict == "cannot be asked"
    assert one.cells["holds"].to_list() == ["holds", "cannot be asked"]
    assert one.cells["why"].to_list() == [None, "wrong side"]
    assert one.cells["low"].to_list()[1] is None
    failing = row("a", "paper", "x", 30.0, 1.0, 100)
    assert _decided([failing, not_asked], [WITHIN]) == {"a": "not reproduced"}


def test_checks_are_a_family_of_their_own_and_no_verdicts() -> None:
    check = Claim("k", "headline", "Ours.", "difference", "within", 1, margin=1.0, kind="check")
    made = [row("b", "paper", "x", 9.0, 1.0, 10_000), exact("k", "paper", "x", 0.0)]
    found = {one.claim.id: one for one in decide(frame(made), [LEAST, check])}
    assert found["k"].verdict == "passed"
    assert found["b"].level == pytest.approx(0.95)
    assert _decided([exact("k", "paper", "x", 2.0)], [check]) == {"k": "failed"}
    assert _decided([row("k", "paper", "x", 0.0, 9.0, 10)], [check]) == {"k": "open"}
    with pytest.raises(InputError, match="k, kind: there is no 'checks', did you mean 'check'"):
        Claim("k", "headline", "Ours.", "difference", "within", 1, margin=1.0, kind="checks")


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


def test_too_few_values_are_an_error() -> None:
    with pytest.raises(InputError, match="1 values were measured, but 2"):
        _decided([exact("a", "paper", "x", 0.0)])


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


def test_the_error_of_a_published_saving_is_that_of_unpaired_runs() -> None:
    random = np.random.default_rng(9)

    def drawn(shape: int | tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        return random.normal(450.0, 200.0, shape), random.normal(900.0, 300.0, shape)

    first, second = drawn(5000)
    alone, both = (
        share_saved("a", "paper", "x", first, second, published_runs=runs)["standard_error"]
        for runs in (None, 50)
    )
    firsts, seconds = drawn((20_000, 50))
    published = 1.0 - firsts.mean(axis=1) / seconds.mean(axis=1)
    assert math.sqrt(both**2 - alone**2) == pytest.approx(published.std(), rel=0.04)
    of_mean, with_published = (
        mean("a", "paper", "x", first, published_runs=runs)["standard_error"] for runs in (None, first.size)
    )
    assert with_published == pytest.approx(math.sqrt(2.0) * of_mean)


def test_runs_that_are_nearly_all_equal_have_no_standard_error() -> None:
    assert mean("a", "paper", "x", [1.0] * 9 + [2.0], less=1.5)["estimate"] == pytest.approx(-0.4)
    assert mean("a", "paper", "x", [1.0] * 9 + [2.0])["standard_error"] is None
    assert mean("a", "paper", "x", [1.0, 1.0, 2.0, 3.0, 4.0])["standard_error"] == pytest.approx(
        0.5831, abs=1e-4
    )


def test_the_papers_numbers_are_there() -> None:
    assert parameters("P_star")["decision.min_observations"] == 381
    assert len(published("experiments.decision_time_s.none")) == len(published("experiments.swarm_sizes"))
    with pytest.raises(InputError, match="not a number of the paper"):
        published("experiments.colour")


def test_columns_of_measured_values() -> None:
    assert frame([]).schema == pl.Schema(MEASURED)
    assert COLUMNS[0] == "paper"


def test_a_claim_that_no_number_of_runs_settles_is_not_asked() -> None:
    made = [row("a", "paper", cell, 0.0, 1.0, 10_000) for cell in ("x", "y")]
    unsettled = replace(WITHIN, cannot="the published errors are wider than the margin")
    (one,) = [each for each in decide(frame(made), [unsettled]) if each.column == "paper"]
    assert one.verdict == "cannot be asked"
    assert one.cells["why"].to_list() == [unsettled.cannot] * 2
    assert _decided(made, [WITHIN]) == {"a": "reproduced"}
    assert [claim.id for claim in all_claims() if claim.cannot] == ["robots-times"]


def test_a_value_that_scattered_points_hold_as_well_is_not_asked() -> None:
    narrow = [row("a", "paper", cell, 0.0, 1.0, 10_000) for cell in ("x", "y")]
    by_scattered = {
        value: _decided([narrow[0], narrow[1] | {"scattered": value}])["a"]
        for value in (-10.5, -9.5, 9.5, 10.5)
    }
    asked, not_asked = "reproduced", "cannot be asked"
    assert list(by_scattered.values()) == [asked, not_asked, not_asked, asked]


def test_claims_are_data_and_no_code_knows_one() -> None:
    """Items give values by name, and claims name them: no id of a claim is written in the code of an item."""
    values = [claim.value for claim in all_claims()]
    assert all(values)
    assert len(set(values)) == len(values)
    top = Path(vibroswarm.paper.__file__).parent
    code = "\n".join(path.read_text(encoding="utf-8") for path in top.rglob("*.py"))
    named_otherwise = {"estimate", "corners", "headline-seeds"}  # a figure, a table, a picture
    written = {claim.id for claim in all_claims() if f'"{claim.id}"' in code}
    assert written <= named_otherwise
    assert all(f'"{value}"' in code for value in values)


def test_two_claims_may_be_about_the_same_values() -> None:
    more, less = (
        Claim(name, "difficulty", "About it.", "difference", test, 1, effect=5.0, value="v")
        for name, test in (("more", "at_least"), ("less", "at_most"))
    )
    made = [row("v", "paper", "x", 9.0, 1.0, 10_000)]
    assert _decided(made, [more, less]) == {"more": "reproduced", "less": "not reproduced"}
