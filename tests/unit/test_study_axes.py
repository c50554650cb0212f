"""How cells are laid out in pictures: numbers along x, words in series, units in labels."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from vibroswarm.documents import study_figures
from vibroswarm.documents.figure_axes import layout_of, name_of, plane_of
from vibroswarm.plots.labels import label_of
from vibroswarm.scenario.scenario import preset
from vibroswarm.study.spec import Study

if TYPE_CHECKING:
    from vibroswarm.study.summary import Outcome

PAPER = preset("paper")


def test_the_numeric_field_with_most_values_lies_along_x() -> None:
    study = Study.of(
        PAPER, 1, swarm__robots=[5, 6, 7], strategy__name=["none", "soft"], strategy__soft__eta=[0.0, 1.0]
    )
    layout = layout_of(study.cells)
    assert (layout.field, layout.label) == ("swarm.robots", "robots")
    assert layout.x is not None
    assert [layout.x[n] for n in (0, 4, 8)] == [5.0, 6.0, 7.0]
    assert [layout.series[n] for n in range(4)] == [
        "none, feedback η 0",
        "none, feedback η 1",
        "soft, feedback η 0",
        "soft, feedback η 1",
    ]


def test_fills_of_one_family_are_numbers_and_of_several_are_words() -> None:
    one = Study.of(PAPER, 1, floor__source=["random:0.44", "random:0.48"])
    layout = layout_of(one.cells)
    assert (layout.label, layout.x, layout.series) == ("fill ratio", {0: 0.44, 1: 0.48}, {0: "all", 1: "all"})
    several = Study.of(PAPER, 1, floor__source=["random:0.48", "stripe:0.48"])
    assert layout_of(several.cells).x is None


def test_words_alone_have_no_x() -> None:
    layout = layout_of(Study.of(PAPER, 1, strategy__name=["none", "soft"]).cells)
    assert (layout.x, layout.series) == (None, {0: "none", 1: "soft"})


def test_figures_that_too_many_cells_leave_out_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    believes = True
    monkeypatch.setattr(study_figures, "_sampled", lambda *_: believes)

    def said(*, truths: int = 99, groups: int = 1, **varied: list[int] | list[str]) -> str:
        counts = [int(k < truths) for k in range(99)]  # of runs with a truth, by cell
        summaries = [SimpleNamespace(swarm_right=SimpleNamespace(n=n)) for n in counts]
        pairs = zip(Study.of(PAPER, 1, **varied).cells, summaries, strict=False)
        cells = [SimpleNamespace(cell=cell, summary=summary) for cell, summary in pairs]
        plan = SimpleNamespace(groups=range(groups))
        outcome = SimpleNamespace(cells=cells, result=SimpleNamespace(plan=plan))
        return study_figures.not_drawn(cast("Outcome", outcome))

    ten, networks = list(range(2, 12)), ["ideal", "loss", "loss_by_size", "bursts", "range", "delay", "tree"]
    four = ["none", "positive", "soft", "places"]
    assert said(swarm__robots=[5, 6]) == ""
    assert said(swarm__robots=ten) == "Too many cells (10) to draw: belief over time. Tables have all cells."
    assert said(network__name=networks[:6], truths=4) == ""
    assert said(network__name=networks[:6], truths=0) == ""
    assert "draw: decisions over time." in said(network__name=networks[:6])
    assert "decisions over time" in said(swarm__robots=[5, 6], network__name=networks, strategy__name=four)
    assert "where robots sampled" in said(swarm__robots=ten, groups=10)
    assert "consensus time of each run and belief" in said(
        network__name=networks, strategy__name=four, truths=0
    )
    believes = False
    assert said(swarm__robots=ten) == ""


def test_two_numbers_with_three_values_each_make_a_plane() -> None:
    grid = {"strategy__soft__eta": [0.0, 1.0, 2.0], "strategy__soft__kappa": [1.0, 2.0, 3.0]}
    soft = PAPER.with_values({"strategy.name": "soft"})
    fields = list(plane_of(Study.of(soft, 1, **grid).cells) or {})
    assert fields == ["strategy.soft.eta", "strategy.soft.kappa"]
    assert plane_of(Study.of(soft, 1, **grid, swarm__robots=[1, 2, 3]).cells) is None
    assert plane_of(Study.of(PAPER, 1, swarm__robots=[1, 2, 3]).cells) is None


@pytest.mark.parametrize(
    ("field", "words"),
    [
        ("walk.avoidance_threshold_mm", "avoidance threshold θ_c (mm)"),
        ("robot.full_speed_m_s", "full speed (m/s)"),
        ("sample.sample_interval_ms", "sample interval τ (ms)"),
        ("strategy.soft.eta", "feedback η"),
    ],
)
def test_labels_have_units(field: str, words: str) -> None:
    assert label_of(field).text == words


def test_cells_are_named_with_symbols_and_units_but_labels_stay() -> None:
    fields = {"sample__sample_interval_ms": [5000.0, 6000.0], "decision__gate": ["total", "own"]}
    study = Study.of(PAPER, 1, strategy__name=["none"], **fields)
    assert name_of(study.cells[1]) == "none, sample interval τ 5000 ms, gate own"
    labelled = Study(base=PAPER, vary={"list": [{"label": "sample_interval_ms 1"}, {"label": "B"}]}, runs=1)
    assert [name_of(cell) for cell in labelled.cells] == ["sample_interval_ms 1", "B"]
