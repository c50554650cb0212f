"""Cells are named by all that tells them apart: no two alike, whatever is varied, before anything is run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibroswarm.cli import main
from vibroswarm.documents.figure_axes import layout_of
from vibroswarm.study.cell_comparison import pairs_of
from vibroswarm.study.factors import names_of, words_of_points
from vibroswarm.study.spec import Study

BASE = {"run": {"t_end_s": 20.0}, "swarm": {"robots": 2}}
STRATEGY, FLOOR, P_C, EYES = "strategy.name", "floor.source", "decision.credible_threshold", "swarm.robots"
SAME_LABEL = {"list": [{"label": "A", STRATEGY: "none"}, {"label": "A", STRATEGY: "soft"}]}
LABELS_AND_GRID = {
    "grid": {STRATEGY: ["none", "soft"]},
    "list": [{"label": "A", FLOOR: "random:0.44"}, {"label": "B", FLOOR: "random:0.48"}],
}
SIX_DIGITS = {"grid": {P_C: [0.90000001, 0.90000002, 0.95]}}
TWICE = {"zip": {STRATEGY: ["none", "none", "soft"], P_C: [0.9, 0.9, 0.9]}}
LABEL_IS_A_VALUE = {"list": [{"label": "soft", STRATEGY: "none"}, {STRATEGY: "soft"}]}
NUMBERS = {"grid": {EYES: [2, 3], P_C: [0.9, 0.9]}}
PLAIN = {"grid": {FLOOR: ["random:0.44", "random:0.48"], STRATEGY: ["none", "soft"]}}
ALL = [SAME_LABEL, LABELS_AND_GRID, SIX_DIGITS, TWICE, LABEL_IS_A_VALUE, NUMBERS, PLAIN]


def names(vary: dict[str, Any]) -> list[str]:
    return [cell.name for cell in Study(BASE, vary, 3).cells]


@pytest.mark.parametrize("vary", ALL, ids=range(len(ALL)))
def test_no_two_cells_or_comparisons_are_called_alike(vary: dict[str, Any]) -> None:
    study = Study(BASE, vary, 3)
    assert len(set(names(vary))) == len(study.cells)
    layout = layout_of(study.cells)
    places = [
        (None if layout.x is None else layout.x[c.number], layout.series[c.number]) for c in study.cells
    ]
    assert len(set(places)) == len(places)
    for cell, reference, _ in pairs_of(study):
        assert cell.point != reference.point


def test_names_say_what_differs_and_no_more() -> None:
    assert names(SAME_LABEL) == ["A (none)", "A (soft)"]
    assert names(LABELS_AND_GRID) == ["A (none)", "B (none)", "A (soft)", "B (soft)"]
    assert names(SIX_DIGITS) == [f"credible_threshold {n}" for n in ("0.90000001", "0.90000002", "0.95")]
    assert names(TWICE)[:2] == [
        "none, credible_threshold 0.9 (cell 0)",
        "none, credible_threshold 0.9 (cell 1)",
    ]
    assert names(PLAIN) == [
        "random:0.44, none",
        "random:0.44, soft",
        "random:0.48, none",
        "random:0.48, soft",
    ]
    assert names({}) == ["none"]


def test_labels_are_compared_where_all_else_is_equal() -> None:
    study = Study(BASE, LABELS_AND_GRID, 3)
    pairs = {(cell.name, reference.name, field) for cell, reference, field in pairs_of(study)}
    assert pairs == {
        ("B (none)", "A (none)", "label"), ("B (soft)", "A (soft)", "label"),
        ("A (soft)", "A (none)", STRATEGY), ("B (soft)", "B (none)", STRATEGY),
    }  # fmt: skip


def test_long_values_are_told_by_a_hash() -> None:
    energies = [[float(k) for k in range(1000)], [float(k) for k in range(1, 1001)]]
    words = words_of_points([{"sensor.still_energies": one} for one in energies])
    found = names_of(words, ["none", "none"])
    assert len(set(found)) == 2
    assert all(len(name) < 60 for name in found)


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=6))
def test_different_numbers_are_told_apart(values: list[float]) -> None:
    points = [{P_C: value} for value in values]
    found = names_of(words_of_points(points), ["none"] * len(points))
    assert len(set(found)) == len(points)


@pytest.mark.usefixtures("empty_pictures")
@pytest.mark.parametrize("vary", [SAME_LABEL, TWICE], ids=["label", "twice"])
def test_a_report_comes_of_it(
    vary: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the command to the pictures; it used to end without a report."""
    (tmp_path / "study.toml").write_text(Study(BASE, vary, 3).to_toml())
    assert main(["evaluate", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "report.html").is_file()
    assert "A - A" not in capsys.readouterr().out


def test_long_labels_keep_their_beginning() -> None:
    long = "soft feedback with a threshold of the kind that the second experiment had, version"
    first, second = names(
        {"list": [{"label": f"{long} 1", STRATEGY: "none"}, {"label": f"{long} 2", STRATEGY: "soft"}]}
    )
    assert first != second
    assert first.startswith("soft feedback with a threshold of the kind that th... ")
    assert len(first) == len(second) <= 60
    assert names({"list": [{"label": long[:60], STRATEGY: "none"}]}) == [long[:60]]


def test_names_that_stand_for_themselves_are_not_called_name() -> None:
    for field, values in {
        "network.name": ["ideal", "range"], "task.name": ["fill_ratio", "mean"], STRATEGY: ["none", "soft"],
    }.items():  # fmt: skip
        assert names({"grid": {field: values}}) == values
