"""Scores of the maps that robots have at the end of runs, as figures of studies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vibroswarm import Study, preset, simulate
from vibroswarm.analysis.floor_maps import floor_maps
from vibroswarm.analysis.map_figures import keeps_map
from vibroswarm.documents.study import study_document
from vibroswarm.study.summary import outcome_of

FIGURES = ("map_brier", "map_auc", "map_location_error_m")


def by_hand(p: np.ndarray, x: np.ndarray) -> tuple[float, float, float]:
    """Brier score, AUC and location error of one map of 5 x 5 tiles of 20 cm, in plain loops."""
    brier = sum((a - b) ** 2 for a, b in zip(p, x, strict=True)) / 25
    pairs = [(a > b) + 0.5 * (a == b) for a in p[x == 1] for b in p[x == 0]]
    centres = []
    for weight in (p, x):
        row = sum(w * (k // 5) for k, w in enumerate(weight)) / weight.sum()
        column = sum(w * (k % 5) for k, w in enumerate(weight)) / weight.sum()
        centres.append(np.array([row, column]))
    return brier, sum(pairs) / len(pairs), 0.2 * float(np.hypot(*(centres[0] - centres[1])))


@pytest.mark.parametrize("name", ["places", "explore", "fading"])
def test_a_study_scores_the_maps_of_its_robots(name: str) -> None:
    scenario = preset("paper").with_values({"strategy.name": name, "run.t_end_s": 200.0, "swarm.robots": 3})
    study = Study.of(scenario, runs=3, seed=4).run()
    stored = study.agreements(0)
    assert stored is not None
    maps = floor_maps(simulate(scenario, 4, 3)).drop_nulls("robot")
    for run in range(3):
        each = [
            by_hand(own["vibrating"].to_numpy(), own["vibrates"].to_numpy())
            for _, own in maps.filter(run=run).group_by("robot", maintain_order=True)
        ]
        assert stored.filter(run=run).select(FIGURES).row(0) == pytest.approx(np.mean(each, axis=0))
    table = outcome_of(study).table
    assert table["map_brier"].item() == pytest.approx(stored["map_brier"].mean())
    assert table["map_brier_low"].item() < table["map_brier"].item() < table["map_brier_high"].item()
    assert 0.5 < table["map_auc"].item() <= 1.0


def test_who_keeps_no_map_has_no_scores(tmp_path: Path) -> None:
    cells = Study.of(preset("paper"), runs=2, strategy__name=["none", "places"], run__t_end_s=[60.0])
    result = cells.run(tmp_path / "study")
    assert [keeps_map(cell.scenario) for cell in cells.cells] == [False, True]
    assert result.agreements(0) is None
    table = outcome_of(result).table
    assert table["map_brier"].is_null().to_list() == [True, False]


def test_patches_have_no_scores() -> None:
    assert not keeps_map(preset("optimised-places").with_values({"floor.source": "patch:0.10"}))


def test_the_page_of_a_study_has_them_where_robots_keep_maps() -> None:
    base = preset("paper").with_values({"run.t_end_s": 60.0})
    mapping = Study.of(base, runs=2, strategy__name=["none", "places"])
    plain = Study.of(base, runs=2, strategy__name=["none", "soft"])
    with_maps, without = (study_document(outcome_of(study.run())) for study in (mapping, plain))
    assert "maps" in with_maps.tables
    assert with_maps.tables["maps"].frame.height == 1
    assert "maps" not in without.tables
