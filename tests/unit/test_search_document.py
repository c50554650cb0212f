"""The document of a search says what its numbers say, with warnings, and nothing in a name breaks its page."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from helpers.manifests import resealed
from vibroswarm.analysis.intervals import Interval, plain
from vibroswarm.documents.grid import grid_document
from vibroswarm.documents.search import (
    checked_document,
    plan_sentences,
    search_document,
    sensitivity_document,
)
from vibroswarm.documents.search_words import (
    OF_THE_PAPER,
    aim,
    bound_of,
    score_label,
    score_sentence,
    values_text,
)
from vibroswarm.errors import InputError
from vibroswarm.optimize import compare_scenarios, evaluate
from vibroswarm.optimize.grid import Grid, Nodes, scores_of, truth_of_grid
from vibroswarm.optimize.loop import Found, run_search
from vibroswarm.optimize.objective import NAMES, Objective
from vibroswarm.optimize.outcomes import Outcomes
from vibroswarm.optimize.search_files import made_by, write_grid, write_search
from vibroswarm.optimize.sensitivity import indices
from vibroswarm.optimize.space import Dimension
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.validation import (
    LUCK,
    Front,
    Member,
    Truth,
    front_of,
    is_too_short,
    score_fresh,
    truth_of,
)
from vibroswarm.plots.labels import setting_words
from vibroswarm.scenario.scenario import preset
from vibroswarm.show.cells import written
from vibroswarm.show.document import Document, Text, walk, without_pictures
from vibroswarm.show.page import page_html
from vibroswarm.simulation import versions
from vibroswarm.study.run import run as run_study
from vibroswarm.study.runner import run_batch
from vibroswarm.study.spec import Study
from vibroswarm.study.study_result import StudyResult

pytestmark = pytest.mark.usefixtures("without_layout")

SMALL = (Path(__file__).parents[1] / "helpers" / "small_search.toml").read_text()
START = 'start = [{ "sample.sample_interval_ms" = 2000.0, "decision.min_observations" = 20 }]\n'
RACE = "[search]\nbudget = 90\nfinal = 60\nfinalists = 2\n"
TWO = """[search]
budget = 100
fresh = 400
[[objective]]
cost = "decision_time"
statistic = "mean"
[[objective]]
cost = "errors"
statistic = "mean"
"""
NASTY = "</script><img src=x onerror=alert(1)><b>`"
MADE = [{"vibroswarm": "1"}]


@pytest.fixture(scope="module")
def found() -> Found:
    return run_search(Search.from_toml(START + SMALL + RACE), workers=2)


@pytest.fixture(scope="module")
def truth(found: Found) -> Truth:
    return truth_of(found, runs=150)


@pytest.fixture(scope="module")
def nodes() -> Nodes:
    base = {"preset": "paper", "run": {"t_end_s": 100.0}, "strategy": {"name": "soft"}}
    vary = {"strategy.soft.eta": [10.0, 500.0, 1000.0], "strategy.soft.kappa": [1.0, 2.0]}
    grid = Grid(Study(base, {"grid": vary}, 20, seed=1), Objective())
    return scores_of(grid, run_study(grid.study))


@pytest.fixture(autouse=True)
def _small_caches() -> Iterator[None]:
    yield
    evaluate._scenario.cache_clear()


def seen(text: str) -> str:
    """What is read on a page, in one line."""
    body = re.sub(r"<(style|script)>.*?</\1>", "", text, flags=re.DOTALL)
    body = re.sub(r'<span class="option">(.*?)</span>', r"\1", body)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", body)).replace("\u00a0", " ").split())


def page_of(found: Found, truth: Truth | None, front: Front | None = None) -> Document:
    return search_document(found, truth, front, MADE)


def rows_of(document: Document, name: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = document.tables[name].frame.to_dicts()
    return rows


def code_of(document: Document) -> list[str]:
    return [part.words for part in walk(document.parts) if isinstance(part, Text) and part.kind == "code"]


def test_the_three_numbers_are_those_of_the_truth(found: Found, truth: Truth) -> None:
    report = page_of(found, truth)
    believed, true, difference = rows_of(report, "truth")
    score = truth.winner.score
    assert believed["score"] == found.believed
    assert believed["runs"] == found.archive[found.best].count
    assert (true["score"], true["score_low"], true["score_high"], true["runs"]) == (
        score.estimate,
        score.low,
        score.high,
        150,
    )
    assert difference["score"] == pytest.approx(score.estimate - found.believed)
    assert difference["share"] == truth.difference
    assert difference["luck"] == truth.luck
    assert truth.words in seen(page_html(report))


def test_the_winner_stands_beside_the_start_and_the_bounds(found: Found, truth: Truth) -> None:
    report = page_of(found, truth)
    (against,) = rows_of(report, "against")
    paired = truth.against[0]
    assert (against["difference"], against["difference_low"], against["difference_high"]) == (
        paired.estimate,
        paired.low,
        paired.high,
    )
    values = {row["field"]: row for row in rows_of(report, "values")}
    gate = values["decision.min_observations"]
    assert gate["winner"] == found.values["decision.min_observations"]
    table = report.tables["values"]
    of_two = replace(table, frame=table.frame.with_columns(winner=pl.Series([3778.0, 0.95])))
    assert [row[1].text for row in written(of_two).rows] == ["3778", "0.95"]  # not 4 and 1
    headings = [head.title for head in written(report.tables["best-candidates"]).headings]
    assert headings[-2:] == ["sample interval τ", "minimum of observations O_c"]  # as pictures say
    assert (gate["other 0"], gate["low"], gate["high"]) == (20, 0, 60)
    text = seen(page_html(report))
    assert "vibroswarm run --scenario best.toml" in text
    assert "vibroswarm optimize compare best.toml paper --search search.toml" in text
    assert "vibroswarm optimize search.toml --out ." in text
    assert code_of(report) == [found.search.to_toml()]


def test_the_account_and_the_best_are_the_archives(found: Found, truth: Truth) -> None:
    report = page_of(found, truth)
    stages = {row["stage"]: row for row in rows_of(report, "runs")}
    assert stages["search"]["runs"] + stages["race"]["runs"] == found.runs == 90
    assert (stages["search"]["wanted"], stages["race"]["wanted"]) == (30, 60)
    assert stages["fresh runs of the start"]["runs"] == 150
    best = rows_of(report, "best-candidates")
    assert len(best) == min(20, len(found.archive))
    of_race = [row for row in best if row["origin"].startswith(("finalist", "start", "surface"))]
    assert best[: len(of_race)] == of_race
    assert len(of_race) == stages["race"]["candidates"] == 2
    assert [row["key"] for row in best if row["origin"].endswith(", the winner")] == [str(found.best)]
    cautious = [row["score"] + row["error"] for row in best[2:] if row["error"] is not None]
    assert cautious == sorted(cautious)
    assert len(rows_of(report, "history")) == len(found.history) + len(found.race)


def test_cases_and_what_a_score_is_made_of() -> None:
    aim = '[objective]\ncost = "time_at_error"\nmax_error = 0.2\n'
    floors = '[grid]\n"floor.source" = ["stripe:0.48", "alternating:0.48"]\n'
    search = Search.from_toml(START + SMALL + RACE + aim + floors)
    found = run_search(search, workers=2)
    truth = truth_of(found, runs=60)
    report = page_of(found, truth)
    cases = rows_of(report, "cases")
    assert [row["case"] for row in cases] == ["stripe:0.48", "alternating:0.48"]
    assert max(row["score"] for row in cases) == truth.winner.score.estimate
    parts = {row["part"]: row for row in rows_of(report, "parts")}
    error = truth.winner.parts or {}
    wrong = parts["wrong of those who decide, %"]
    assert wrong["value"] == 100 * error["robot_error"].estimate
    assert wrong["against limit"] == truth.winner.near["robot_error"]
    assert parts["decision time, s"]["against limit"] is None
    assert "each in 2 cases" in seen(page_html(report))


def warned(report: Document, *words: str) -> bool:
    return any(all(word in text for word in words) for text in report.warnings)


def shifted(interval: Interval, middle: float) -> Interval:
    return interval._replace(estimate=middle, low=middle - 1.0, high=middle + 1.0)


@pytest.mark.parametrize(("middle", "standing"), [(-5.0, "better"), (0.0, "not significant"), (5.0, "worse")])
def test_a_start_that_is_not_beaten_is_a_warning(
    found: Found, truth: Truth, middle: float, standing: str
) -> None:
    report = page_of(found, replace(truth, against=(shifted(truth.against[0], middle),)))
    (against,) = rows_of(report, "against")
    assert against["standing"] == standing
    assert warned(report, "start") == (standing != "better")
    assert warned(report, "start", "nothing was found") == (standing == "not significant")


def test_a_start_that_won_is_a_warning(found: Found, truth: Truth) -> None:
    itself = replace(truth.others[0], values=truth.winner.values)
    report = page_of(found, replace(truth, others=(itself,)))
    assert warned(report, "The winner is the start itself: nothing better was found.")


def test_a_swarm_that_never_moved_gets_no_verdict(found: Found, truth: Truth) -> None:
    short = replace(truth, believed=0.1 * truth.winner.score.estimate, too_short=True)
    assert not truth.too_short
    assert short.luck == "too short"
    warnings = page_of(found, short).warnings
    assert short.words in warnings
    assert not any("nothing was found" in text for text in warnings)
    once = replace(found, history=found.history[:1])
    assert is_too_short(once)
    assert not is_too_short(found)


def test_luck_is_a_warning_and_its_absence_none(found: Found, truth: Truth) -> None:
    score = truth.winner.score
    wide = truth.winner.score._replace(low=0.1 * score.estimate, high=2.0 * score.estimate)
    cases = {
        "not significant": replace(truth, believed=score.estimate),
        "lucky": replace(truth, believed=0.1 * score.estimate),
        "unlucky": replace(truth, believed=9.0 * score.estimate),
        "inconclusive": replace(
            truth, believed=0.5 * score.estimate, winner=replace(truth.winner, score=wide)
        ),
        "not defined": replace(truth, believed=np.inf),
        "too short": replace(truth, too_short=True),
    }
    assert set(cases) == set(LUCK)
    for luck, one in cases.items():
        assert one.luck == luck
        assert (one.words in page_of(found, one).warnings) == (luck != "not significant")


def test_an_interval_that_tells_little_is_a_warning(found: Found, truth: Truth) -> None:
    score = truth.winner.score
    for within, said in ((0.2, False), (0.3, True), (np.inf, True)):
        wide = score._replace(low=score.estimate * (1 - within), high=score.estimate * 1.1)
        one = replace(truth, believed=score.estimate, winner=replace(truth.winner, score=wide))
        assert one.luck == "not significant"
        assert warned(page_of(found, one), "Too few validation runs") == said
        assert warned(page_of(found, one), "known to within 30 %") == (within == 0.3)


@pytest.mark.parametrize(("believed", "luck"), [(0.0, "not significant"), (0.5, "not defined")])
def test_a_score_of_nothing_is_no_division(found: Found, truth: Truth, believed: float, luck: str) -> None:
    """No robot of the winner was ever wrong, say."""
    nothing = truth.winner.score._replace(estimate=0.0, low=0.0, high=0.0)
    one = replace(truth, believed=believed, winner=replace(truth.winner, score=nothing))
    assert one.luck == luck
    assert (one.words in page_of(found, one).warnings) == (luck == "not defined")


def test_a_winner_at_a_bound_is_a_warning(found: Found, truth: Truth) -> None:
    tau = Dimension.of("sample.sample_interval_ms", {"from": 1000, "to": 6000})
    said = {value: bound_of(tau, value) for value in (1000.0, 1040.0, 1100.0, 5900.0, 5960.0, 6000.0)}
    assert list(said.values()) == ["lower", "lower", "", "", "upper", "upper"]
    assert bound_of(Dimension.of("strategy.name", ["none", "soft"]), "soft") == ""
    archive = found.archive
    key = archive.new(np.array([0.5, 1.0]), "made")
    try:
        there = page_of(replace(found, best=key), truth)
        assert warned(there, "at a bound of the space: minimum of observations O_c 60 (upper bound 60)")
        archive[key].values["decision.min_observations"] = 30
        assert not warned(page_of(replace(found, best=key), truth), "bound")
    finally:
        archive.candidates.pop()


def test_what_was_not_done_is_a_warning(found: Found, truth: Truth) -> None:
    assert not warned(page_of(found, truth), "finished")
    too_few_for_a_step = replace(found, search=found.search.with_settings(final=70, budget=100))
    assert not warned(page_of(too_few_for_a_step, truth), "finished")
    longer = replace(found, search=found.search.with_settings(final=600, budget=700))
    assert warned(page_of(longer, truth), "The search is not finished: 90 of 690 runs.")
    assert warned(page_of(found, None), "not scored on fresh runs")
    assert "truth" not in page_of(found, None).tables
    both = search_document(found, truth, None, [*MADE, {"vibroswarm": "2"}])
    assert warned(both, "Different versions")
    assert both.made_by["made by (2)"] == "vibroswarm 2"


def test_versions_are_those_that_began_it_and_those_of_now(found: Found, tmp_path: Path) -> None:
    assert made_by(tmp_path) == [versions()]
    run_search(found.search, tmp_path / "s", workers=2)
    assert made_by(tmp_path / "s") == [versions()]
    head = tmp_path / "s" / "vibroswarm.json"
    head.write_text(head.read_text().replace(f'"numba": "{versions()["numba"]}"', '"numba": "0.1"'))
    resealed(head)
    assert [one["numba"] for one in made_by(tmp_path / "s")] == ["0.1", versions()["numba"]]


def test_failed_runs_stand_first_with_why(monkeypatch: pytest.MonkeyPatch, truth: Truth) -> None:
    right = evaluate.outcomes_of

    def failing(scenarios: Any, seed: int, runs: range, motion: str) -> list[Outcomes]:
        if 4 in runs:
            raise ZeroDivisionError(f"a crash {NASTY}")
        return right(scenarios, seed, runs, motion)

    monkeypatch.setattr(evaluate, "outcomes_of", failing)
    found = run_search(Search.from_toml(START + SMALL + RACE), workers=1)
    lame = replace(truth, winner=replace(truth.winner, failed=7))
    report = page_of(found, lame)
    assert report.warnings[0].startswith("3 runs FAILED; a candidate with a failed run cannot win. Why: ")
    assert "a crash" in report.warnings[0]
    assert report.warnings[1] == "7 fresh runs of the winner FAILED (in no figure)."
    (why,) = rows_of(report, "failures")
    assert (why["runs"], why["candidates"]) == (3, 1)
    assert sum(row["failed"] for row in rows_of(report, "runs")) == 3 + 7
    text = page_html(report)
    assert "<img" not in text
    assert "&lt;img src=x onerror=alert(1)&gt;" in text


def test_fresh_runs_are_counted_with_those_that_failed(found: Found, truth: Truth) -> None:
    """Of the winner's runs one failed, of the start's two."""
    sizes = [truth.winner.rows.shape[0] - 1, truth.others[0].rows.shape[0] - 2]
    winner, other = (
        replace(scored, rows=scored.rows[:size], runs=scored.runs[:size], failed=scored.rows.shape[0] - size)
        for scored, size in zip((truth.winner, truth.others[0]), sizes, strict=True)
    )
    lame = replace(truth, winner=winner, others=(other, *truth.others[1:]))
    for one in (truth, lame):
        fresh = rows_of(page_of(found, one), "runs")[2:]
        assert [row["runs"] for row in fresh] == [150, 150]
    assert [row["failed"] for row in fresh] == [1, 2]


def test_nothing_in_a_name_breaks_a_page(found: Found, truth: Truth) -> None:
    search = replace(found.search, study=replace(found.search.study, name=NASTY))
    mine = Objective(NASTY, function=lambda outcomes: outcomes.time_s.mean(axis=1))
    named = replace(truth, others=(replace(truth.others[0], name=NASTY),))
    for changed in (search, replace(search, objectives=(mine,))):
        text = page_html(page_of(replace(found, search=changed), named))
        assert "<img" not in text
        assert text.count("<script>") == 1
        assert f"<title>{html.escape(NASTY)}</title>" in text
    assert "search.toml" not in text  # a cost that is a function is in no file
    assert "search.toml" in page_html(page_of(found, truth))


def test_a_page_is_the_same_each_time_and_has_figures_unless_they_are_left_out(
    found: Found, truth: Truth
) -> None:
    document = page_of(found, truth)
    assert list(document.figures) == ["scores", "parameters"]
    text = page_html(document)
    assert page_html(page_of(found, truth)) == text
    assert text.count("<figure") == text.count('class="drawing"') == 2
    read = seen(text)
    assert "From the 30 runs of the search before the race. The line across: 150 fresh runs." in read
    without = page_html(without_pictures(document))
    assert without.count("<figure") == 0
    assert truth.words in seen(without)


def test_only_a_cost_of_the_users_is_called_theirs() -> None:
    assert not [name for name in NAMES if "your cost" in score_sentence(Objective(name))]
    assert score_sentence(Objective("robots_wrong", "mean")).startswith(
        "Score: robots wrong (mean over runs);"
    )
    assert "your cost mine" in score_sentence(Objective("mine", function=lambda outcomes: outcomes.end_s))


def test_a_front_is_a_table_of_believed_and_true(tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    found = run_search(Search.from_toml(SMALL.partition("[pso]")[0] + TWO), workers=2)
    front = front_of(found)
    report = page_of(found, None, front)
    rows = rows_of(report, "front")
    assert len(rows) == len(front.members) == len(found.front)
    for row, member in zip(rows, front.members, strict=True):
        assert row["stays"] == ("stays" if member.stays else "beaten")
        for name, believed, true in zip(front.names, member.believed, member.true, strict=True):
            assert row[f"{name}, believed"] == believed
            assert (row[f"{name}, true low"], row[f"{name}, true high"]) == (
                plain(true.low),
                plain(true.high),
            )
    second = replace(found.search, objectives=found.search.objectives[::-1])
    (alone,) = score_fresh(second, [("", front.members[0].values)], front.runs)
    assert front.members[0].true[1].estimate == pytest.approx(alone.score.estimate)
    assert front.words in seen(page_html(report))
    beaten = replace(front, members=(replace(front.members[0], stays=False, failed=3), *front.members[1:]))
    told = page_of(found, None, beaten)
    assert warned(told, beaten.words)
    assert seen(page_html(told)).count(beaten.words) == 1, "not in the answer too"
    assert warned(told, "3 fresh runs of the front's candidates FAILED")
    assert warned(page_of(found, None), "The front was not scored on fresh runs")
    assert warned(page_of(replace(found, front=()), None), "There is no front")
    assert rows_of(told, "runs")[-1]["runs"] == front.runs * len(front.members)
    assert list(told.figures) == ["true-front", "scores", "parameters"]
    write_search(found, tmp_path, front)
    assert (tmp_path / "front.csv").is_file()


def test_a_grid_has_its_cells_and_the_lowest_scored_again(nodes: Nodes, tmp_path: Path) -> None:
    truth = truth_of_grid(nodes, 50)
    assert (truth.winner.rows[:20] != nodes.best.scored.rows).any(), "runs that the grid has not seen"
    report = grid_document(nodes, truth, MADE)
    believed, true, _ = rows_of(report, "truth")
    assert (believed["score"], believed["runs"]) == (nodes.best.scored.score.estimate, 20)
    assert (true["score"], true["runs"]) == (truth.winner.score.estimate, 50)
    cells = rows_of(report, "grid")
    assert [row["score"] for row in cells] == [node.scored.score.estimate for node in nodes.nodes]
    assert [node.as_good for node in nodes.nodes] == [node.above_best.low <= 0.0 for node in nodes.nodes]
    result = run_study(nodes.grid.study)
    for node in nodes.nodes:
        decided = result.robots(node.cell.number)["decision"] != -1
        assert node.undecided == pytest.approx(1.0 - decided.mean())
    standing = [row["standing"] for row in cells]
    assert standing.count("the lowest") == 1
    assert standing.count("not significant") == sum(node.as_good for node in nodes.nodes) - 1
    text = page_html(report)
    assert text.count("<figure") == 3
    assert "All cells replay one motion" in text
    assert (truth.words in report.warnings) == (truth.luck != "not significant")
    others = standing.count("not significant")
    assert warned(
        report, f"{others} of 5 are not significantly different", "do not show which of them is best"
    ) == (others > 0)
    eta = nodes.best.cell.point["strategy.soft.eta"]
    assert warned(report, "edge of the grid", "feedback η") == (eta in (10.0, 1000.0))
    assert not warned(report, "feedback κ")  # two values have no middle
    write_grid(nodes, tmp_path)
    again = Grid.read(tmp_path / "grid.toml")
    assert again.study.hash == nodes.grid.study.hash
    assert (again.study.runs, again.study.seed, again.objective) == (20, 1, nodes.grid.objective)
    assert warned(grid_document(nodes, None, MADE), "not scored on fresh runs")


def test_a_grid_that_moves_robots_claims_no_shared_motion() -> None:
    vary = {"walk.walk_duration_scale_ms": [1000.0, 2000.0]}
    grid = Grid(Study({"preset": "paper", "run": {"t_end_s": 60.0}}, {"grid": vary}, 4), Objective())
    told = seen(page_html(grid_document(scores_of(grid, run_study(grid.study)), None, MADE)))
    assert "one motion" not in told
    assert "walk.walk_duration_scale_ms" in told


def test_a_grid_without_a_run_in_all_cells_is_refused(tmp_path: Path) -> None:
    """Its cells were all nan above the best, and all as good."""
    vary = {"walk.walk_duration_scale_ms": [1000.0, 2000.0]}
    grid = Grid(Study({"preset": "paper", "run": {"t_end_s": 30.0}}, {"grid": vary}, 2), Objective())
    for batch in ("0:0-1", "1:1-2"):
        run_batch(grid.study, tmp_path, batch)
    with pytest.raises(InputError, match="no run is in all cells"):
        scores_of(grid, StudyResult.open(tmp_path))


def test_a_front_with_scores_of_0_has_no_share_of_them() -> None:
    """The share by which a believed score is too low is not defined where the true one is 0."""

    def scored(estimate: float) -> Interval:
        return Interval(estimate, estimate, estimate, 0.95, 300, "mean")

    members = tuple(
        Member(k, {}, (1.0, 10.0), (scored(errors), scored(12.5)), True, 0)
        for k, errors in enumerate((0.0, 2.0, 2.0, 40.0))
    )
    front = Front(("errors", "time"), ("", "s"), members, 300)
    assert front.too_little == [0.5, pytest.approx(0.2)]
    assert "50 % too low for errors, 20 % too low for time" in front.words
    nothing = replace(front, members=members[:1])
    assert math.isnan(nothing.too_little[0])
    assert nothing.words.endswith("the believed scores were 20 % too low for time (medians).")


def test_large_values_of_fields_have_no_exponent() -> None:
    field = "walk.walk_duration_location_ms"
    assert setting_words(field, 12000.0) == "γ₀ 12000"
    assert values_text({field: 12000.0}) == "walk duration, location γ₀ 12000 ms"
    assert setting_words(field, 4750.25) == "γ₀ 4750"
    assert setting_words("swarm.robots", 12000) == "robots 12000"


def test_a_comparison_says_which_is_better_and_what_robots_knew() -> None:
    short = {"run.t_end_s": 100.0, "decision.min_observations": 5, "swarm.robots": 2}
    first = preset("paper").with_values(short | {"strategy.name": "soft"})
    second = preset("paper").with_values(
        short | {"strategy.name": "places", "localisation.method": "true", "decision.min_observations": 60}
    )
    aim = Objective("time_at_error")
    cases = ({"floor.source": "stripe:0.48"}, {"floor.source": "alternating:0.48"})
    found = compare_scenarios(first, second, aim, 6, names=("soft", "places"), cases=cases)
    document = checked_document(found)
    assert document.made_by["seed"] == "1"
    assert document.answer[0] == found.says
    assert "places with true places: an upper bound" in document.knew[0]
    assert [row["score"] for row in rows_of(document, "scores")] == [
        found.first.score.estimate,
        found.second.score.estimate,
    ]
    assert len(rows_of(document, "cases")) == 4
    assert len(rows_of(document, "parts")) == 6
    assert document.data["differences"]["difference"].to_list() == [
        found.difference.estimate,
        found.replicate.estimate,
    ]
    figures = {row["figure"]: row for row in rows_of(document, "figures")}
    exact = {row["figure"]: row for row in document.data["figures"].to_dicts()}
    assert figures["robots wrong, %"]["first"] == 100 * exact["wrong_share"]["first"]
    assert figures["decision time, s"]["first"] == exact["decision_time_s"]["first"]


def test_a_sensitivity_names_what_matters_and_what_does_not() -> None:
    pytest.importorskip("SALib")
    costs = np.array([[k % 7 + 5.0 * (k // 7 % 2), k % 7 + 5.0 * (k // 7 % 2) + 0.1] for k in range(64)])
    document = sensitivity_document(indices(["one.matters", "other.not"], costs))
    words = " ".join(document.answer)
    rows = document.data["fields"].to_dicts()
    for row in rows:
        assert (f"No significant effect: {row['name']}" in words) == (not row["total_low"] > 0)
    hidden = sensitivity_document(indices(["a.b", "c.d"], np.ones((64, 2))))
    assert hidden.answer[0].startswith("No effect can be estimated")


@pytest.mark.parametrize(
    ("objective", "minimised", "label"),
    [
        (Objective("authors_code"), "cost of the authors' code, mean + sd", None),
        (Objective("printed", "mean"), "cost as printed, mean", None),
        (Objective("decision_time", "mean"), "decision time, mean (s)", "cost (decision time, mean), s"),
        (Objective("time_at_error"), "time at error (s)", "cost (time at error), s"),
    ],
)
def test_what_is_minimised_is_said_in_words(objective: Objective, minimised: str, label: str | None) -> None:
    """An axis needs not say twice that the paper's costs are costs."""
    assert aim(objective) == minimised
    assert score_label(objective) == (label or minimised)


def test_the_costs_of_the_paper_are_among_all() -> None:
    assert set(OF_THE_PAPER) < set(NAMES)


def test_a_plan_counts_the_fresh_runs_of_the_starts_as_theirs() -> None:
    """Each start is scored on as many fresh runs as the winner."""
    assert "4,000 fresh runs to validate the best and the starts" in next(plan_sentences(Search()))
    assert "2,000 fresh runs to validate the best;" in next(plan_sentences(Search(start=())))
