"""What public objects show in a session: one short line, and HTML in which nothing of a scenario becomes markup."""

from __future__ import annotations

import gc
import html
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from helpers.markup import HOSTILE, Markup
from vibroswarm import Floor, Result, Scenario, Study, StudyResult, preset, simulate, verdict
from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.documents.notebook import _frame, html_of
from vibroswarm.motion.source import source
from vibroswarm.optimize.validation import Scored

SHORT = preset("paper").with_values({"run.t_end_s": 60.0, "swarm.robots": 2})


@pytest.fixture(scope="module")
def result() -> Result:
    return simulate(SHORT, 3, 2, segments=True)


@pytest.fixture(scope="module")
def studied() -> StudyResult:
    return Study.of(SHORT, 12, 3, floor__source=["random:0.44"], strategy__name=["none", "soft"]).run()


def public(result: Result, studied: StudyResult) -> dict[str, Any]:
    """One object of each public class."""
    found = verdict(result)
    return {
        "scenario": SHORT,
        "floor": result.floor(),
        "result": result,
        "verdict": found,
        "robot": found.robots[0],
        "motion": source("event").batch(SHORT, 3, [0]),
        "study": studied.study,
        "cell": studied.study.cells[0],
        "study result": studied,
        "picture": studied.plot(),
    }


def test_every_public_object_is_short_as_text_and_inert_as_html(result: Result, studied: StudyResult) -> None:
    for name, value in public(result, studied).items():
        text = repr(value)
        assert text.startswith(type(value).__name__), name
        assert "\n" not in text, name
        assert len(text) < 200, name
        view = Markup(value._repr_html_())
        view.check_inert()
        assert view.tags[0] == "div", name
    assert str(SHORT) == repr(SHORT)


def test_the_texts_say_what_it_is(result: Result, studied: StudyResult) -> None:
    assert repr(SHORT) == "Scenario(2 robots, none, floor 'random:0.48', 1 m x 1 m, up to 60 s)"
    assert repr(result) == "Result(2 runs, 2 robots, none, floor 'random:0.48', seed 3, 2 incomplete)"
    assert repr(studied) == "StudyResult(2 cells, 24 runs, not saved, varied: floor.source, strategy.name)"
    assert repr(verdict(result)).startswith("Verdict(incomplete; 0 right, 0 wrong, 2 undecided, of 2 robots;")


def test_a_result_shows_verdict_picture_and_player(result: Result) -> None:
    view = Markup(result._repr_html_())
    assert "INCOMPLETE: 2 of 2 robots undecided after 60\u00a0s" in view.text
    assert view.tags.count("img") == 1
    (player,) = view.frames
    assert player.startswith("<!doctype html>")
    assert "Content-Security-Policy" in player
    assert ("sandbox", "allow-scripts allow-downloads") in view.attributes
    without = Markup(replace(result, segments=None)._repr_html_())
    assert without.frames == []
    assert "segments=True" in without.text


def test_under_feedback_a_posterior_is_called_an_opinion(result: Result) -> None:
    """The control is the same swarm without feedback."""
    from vibroswarm.analysis.verdict import OPINION_NOTE

    soft = Markup(simulate(SHORT.with_values({"strategy.name": "soft"}), 3, 1)._repr_html_()).text
    none = Markup(result._repr_html_()).text
    assert "opinion (95 %)" in soft
    assert OPINION_NOTE in soft
    assert "share of ones (95 %)" in none
    assert "opinion" not in none


def test_nothing_of_a_scenario_or_file_becomes_markup(result: Result) -> None:
    """The control: the same parser sees the tags of a name that is not escaped."""
    with pytest.raises(AssertionError):
        Markup(f"<div>{HOSTILE}</div>").check_inert()
    scenario = Scenario.from_values(
        {**SHORT.model_dump(exclude_none=True), "floor": {"source": HOSTILE, "tiles": ["10", "01"]}}
    )
    hostile = simulate(scenario, 3, 1, segments=True)
    floor = Floor([[0, 1]], 0.5, 0.5, name=HOSTILE)  # type: ignore[arg-type]
    study = Study(scenario, name=HOSTILE, runs=2)
    for value in (scenario, hostile, floor, study, study.cells[0], verdict(hostile)):
        view = Markup(value._repr_html_())
        view.check_inert()
        assert "iframe" not in view.tags or view.tags.count("iframe") == 1
        for player in view.frames:  # its own script only, and the title as text
            assert "<script>alert" not in player
            assert (
                "onerror" not in Markup(re.sub(r"<script\b.*?</script>", "", player, flags=re.S)).attributes
            )
            assert player.count("<script") == Markup(player).tags.count("script") == 2
    assert "<script>" in Markup(scenario._repr_html_()).text


@pytest.mark.parametrize("text", [HOSTILE, "\ud800", "\x00"])
def test_frames_escape_what_they_are_given(text: str) -> None:
    made = _frame(text, text, 10)
    made.encode("utf-8")
    Markup(made).check_inert()
    (document,) = Markup(_frame(HOSTILE, "", 10)).frames
    assert document == HOSTILE


def test_a_study_shows_labels_presets_and_fields_that_only_some_cells_set() -> None:
    grid = {"preset": ["paper", "text"]}
    lists = [{"label": "a", "strategy.name": "soft"}, {"label": "b", "swarm.robots": 7}]
    for study in (Study({}, {"grid": grid}, runs=2), Study(SHORT, {"list": lists}, runs=2)):
        view = Markup(study._repr_html_())
        assert view.tags.count("tr") == 3
        for cell in study.cells:
            assert all(words in view.text for words in cell.words.values())
    assert "7" in view.text
    unset = [study.cells[0].scenario["swarm.robots"], study.cells[1].scenario["strategy.name"]]
    assert unset == [2, "none"]
    assert "none" in view.text


class RobotRow(NamedTuple):
    """A row of a table."""

    number: int


class Holder(NotebookView):
    """Holds what a test gives it."""

    def __init__(self, held: Any) -> None:
        self.held = held


@pytest.mark.parametrize("module", ["__main__", "mine", "mine.parts"])
def test_a_class_of_the_users_has_the_view_of_its_base(
    module: str, monkeypatch: pytest.MonkeyPatch, result: Result
) -> None:
    class MyFloor(Floor):
        pass

    class MyScored(Scored):
        pass

    for kind in (MyFloor, MyScored):
        monkeypatch.setattr(kind, "__module__", module)
    assert "<img" in html_of(MyFloor(**vars(result.floor())))
    scored = Scored(
        "winner", {"swarm.robots": 5}, mean_interval([1.0, 2.0]), np.zeros((2, 1, 1)), np.arange(2), 0
    )
    assert Markup(html_of(MyScored(**vars(scored)))).text == Markup(html_of(scored)).text


@pytest.mark.parametrize(
    ("rows", "note"), [(20, ""), (21, "... and 1 more rows"), (50, "... and 30 more rows")]
)
def test_a_list_that_is_cut_says_so(rows: int, note: str) -> None:
    text = Markup(Holder([RobotRow(1000 + k) for k in range(rows)])._repr_html_()).text
    assert ("more rows" in text) == bool(note)
    assert note in text
    assert "1019" in text
    assert "1020" not in text


def test_values_by_dotted_name_and_their_completion() -> None:
    offered = SHORT._ipython_key_completions_()
    assert "walk.leg_min_ms" in offered or "sample.interval_ms" in offered
    for name in offered:
        SHORT[name]
    assert SHORT["swarm.robots"] == 2
    with pytest.raises(ValueError, match=r"did you mean 'swarm\.robots'"):
        SHORT["swarm.robot"]


def test_a_study_answers(studied: StudyResult, tmp_path: Path) -> None:
    summary = studied.summary()
    assert summary.height == 2
    assert {"strategy.name", "decision_time_s", "decision_time_s_low", "robots_right"} <= set(summary.columns)
    compared = studied.compare("none")
    sentence, *warnings = compared.sentences
    assert ["No robot was allowed to decide" in words for words in warnings] == [True]
    assert repr(compared).splitlines()[1] == sentence
    assert compared.table["reference"].unique().to_list() == [0]
    assert sentence in Markup(compared._repr_html_()).text.replace("\u00a0", " ").replace("\u2212", "-")
    assert studied.plot("robots_wrong").numbers.height == 2
    with pytest.raises(ValueError, match=r"did you mean 'robots_wrong'.*choices: outcomes"):
        studied.plot("robots_wrongs")
    with pytest.raises(ValueError, match=r"^reference: .*did you mean 'none'"):
        studied.compare("non")


@pytest.mark.slow
@pytest.mark.usefixtures("one_picture", "empty_pictures")
def test_a_study_writes_its_report_and_shows_it(studied: StudyResult, tmp_path: Path) -> None:
    report = studied.report(tmp_path / "report")
    document = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert report.path == tmp_path / "report" / "report.html"
    written = html.unescape(document).replace("\u00a0", " ").replace("\u2212", "-")
    assert studied.compare().sentences[0] in written
    view = Markup(report._repr_html_())
    view.check_inert()
    assert view.frames == [document]
    assert repr(report) == f"ReportFile({str(report.path)!r})"
    with pytest.raises(ValueError, match=r"^folder: .*exists already"):
        studied.report(tmp_path / "report")


@pytest.mark.usefixtures("one_picture", "empty_pictures")
def test_a_report_is_shown_after_its_unsaved_study_is_gone() -> None:
    """As of a cell that ends with ``study.run().report()``."""
    report = Study(preset("paper").with_values({"run.t_end_s": 5.0}), runs=1).run(progress=False).report()
    gc.collect()
    assert Markup(report._repr_html_()).frames == [report.path.read_text(encoding="utf-8")]
