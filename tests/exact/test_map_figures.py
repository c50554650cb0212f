"""Scores of the maps that robots have at the end of runs, as figures of studies."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm import Study, preset, simulate
from vibroswarm.documents.detection import detection_document
from vibroswarm.documents.league import league_document
from vibroswarm.documents.run import run_document
from vibroswarm.documents.study import study_document
from vibroswarm.league.entries import Entry, LeagueFloor
from vibroswarm.league.standings import League
from vibroswarm.result import Result
from vibroswarm.show.document import Text
from vibroswarm.statistics.map_figures import floor_maps, keeps_map
from vibroswarm.statistics.map_scores import map_scores
from vibroswarm.study.detection import detection_of, detection_study
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


def detection_by_hand(result: Result) -> list[float | None]:
    """Time to detection of each run, in plain loops over the robots' beliefs; None where nothing is to be detected."""
    found: list[float | None] = []
    key = ["run", "robot", "sample"]
    beliefs = result.inference.join(result.motion.select(*key, "time_s"), on=key).sort(key)
    for run, truth in result.runs.select("run", "truth").iter_rows():
        times = []
        for robot in range(result.scenario.swarm.robots):
            since = result.scenario.run.t_end_s
            for time_s, below in (
                beliefs.filter(run=run, robot=robot).select("time_s", "belief_below").iter_rows()
            ):
                if 1.0 - below < result.scenario.decision.credible_threshold:
                    since = result.scenario.run.t_end_s
                else:
                    since = min(since, time_s)
            times.append(since)
        found.append(float(np.mean(times)) if truth == 1 else None)
    return found


@pytest.mark.parametrize("name", ["places", "explore"])
def test_a_study_scores_the_maps_of_its_robots(name: str) -> None:
    scenario = preset("paper").with_values({"strategy.name": name, "run.t_end_s": 200.0, "swarm.robots": 3})
    study = Study.of(scenario, runs=3, seed=4).run()
    stored = study.rows(cells=study.cells[:1])
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


@pytest.mark.parametrize(("name", "boundary"), [("places", 0.3), ("fading", 0.5), ("explore", 0.3)])
def test_maps_are_reported_as_they_are_at_the_end(name: str, boundary: float) -> None:
    """The array ``p`` of a robot is scratch: it had sums of the last update, or tiles before the last reading."""
    scenario = preset("paper").with_values({
        "strategy.name": name, "run.t_end_s": 200.0, "localisation.method": "true",
        "decision.decision_boundary": boundary, "floor.source": "random:0.25", "floor.rows": 4, "floor.columns": 4,
    })  # fmt: skip
    if name == "fading":
        scenario = scenario.with_values({"strategy.fading.memory_s": 20.0})
    result = simulate(scenario, 3, 2)
    assert result.reports is not None
    reported = result.reports.filter(name="p").sort("run", "robot", "index")["value"].to_numpy()
    maps = floor_maps(result).drop_nulls("robot").sort("run", "robot", "row", "column")
    np.testing.assert_array_equal(reported, maps["vibrating"].to_numpy())
    pooled = floor_maps(result).filter(pl.col("robot").is_null(), run=0)
    right = sum((p > 0.5) == truth for p, truth in pooled.select("vibrating", "vibrates").iter_rows())
    texts = [part for part in run_document(result, 0).parts if isinstance(part, Text)]
    assert any(f"all robots' samples: {right} of 16 tiles right" in text.words for text in texts)
    (drawn,) = [text.words for text in texts if text.kind == "code"]
    assert drawn.count("!") == 16 - right
    of_study = (
        Study.of(scenario, runs=2, seed=3)
        .run()
        .reported.filter(name_reported="p")
        .sort("run", "index")["value"]
    )
    np.testing.assert_allclose(of_study, reported.reshape(2, 5, 16).mean(axis=1).ravel(), rtol=1e-12)


def test_a_map_with_nan_has_no_score() -> None:
    """The AUC took nan for the largest probability."""
    floor = preset("paper").floor_for(0, 0)
    p = np.where(np.arange(floor.tiles.size) == 3, np.nan, 0.5)
    scores = map_scores(p, floor)
    assert all(math.isnan(scores[name]) for name in ("brier", "auc", "location_error_m"))


def test_maps_are_compared_with_the_floor_at_the_end() -> None:
    scenario = preset("paper").with_values({
        "strategy.name": "fading", "run.t_end_s": 90.0, "swarm.robots": 2, "change.at_s": 60, "change.to": "invert",
    })  # fmt: skip
    result = simulate(scenario, 4, 2)
    for (run,), of_run in floor_maps(result).drop_nulls("robot").group_by("run", maintain_order=True):
        first = result.floor(int(run)).tiles.ravel().tolist()  # type: ignore[call-overload]
        assert of_run["vibrates"].to_list() == [1 - kind for kind in first] * 2


def test_who_keeps_no_map_has_no_scores(tmp_path: Path) -> None:
    cells = Study.of(preset("paper"), runs=2, strategy__name=["none", "places"], run__t_end_s=[60.0])
    result = cells.run(tmp_path / "study")
    assert [keeps_map(cell.scenario) for cell in cells.cells] == [False, True]
    found = outcome_of(result)
    assert found.table["map_brier"].is_null().to_list() == [True, False]
    assert study_document(found).tables["maps"].frame.height == 1
    assert "maps" not in study_document(outcome_of(result.where(strategy__name="none"))).tables


def test_damage_is_detected_where_there_is_some() -> None:
    """Floors with 60 % vibrating are detected in a part of the run, those with 30 % not at all."""
    base = preset("paper").with_values({"strategy.name": "places", "run.t_end_s": 600.0, "swarm.robots": 3})
    study = Study.of(base, 3, 5, floor__source=["random:0.6", "random:0.32"]).run()
    damaged, sound = (study.rows(cells=[cell])["detection_time_s"] for cell in study.cells)
    assert sound.null_count() == 3
    assert 60.0 < damaged.mean() < 500.0
    # Of robots that must be surer, some have not detected it at the end, which counts as the whole time.
    unsure = base.with_values({"floor.source": "random:0.6", "decision.credible_threshold": 0.9995})
    later = Study.of(unsure, 3, 5).run().frame["detection_time_s"]
    assert later.to_list() == pytest.approx(detection_by_hand(simulate(unsure, 5, 3)))
    assert damaged.mean() + 50.0 < later.mean() < 600.0


def test_leagues_and_detections_show_maps_where_robots_keep_them() -> None:
    base = preset("paper").with_values({"run.t_end_s": 60.0})
    floors = (LeagueFloor("random", 0.32, "random:0.32"), LeagueFloor("random", 0.6, "random:0.6"))
    entries = tuple(Entry(name, name, {}) for name in ("none", "places"))
    for chosen, names in ((entries, ["places"]), (entries[:1], [])):
        standings = League(base, chosen, floors, (2, 3), 3, 6).play()
        tables = league_document(standings).tables
        assert ("maps" in tables) == bool(names)
        if names:
            row = tables["maps"].frame.row(0, named=True)
            assert (row["name"], row["runs"]) == ("places", 6)
            own = standings.study.frame.drop_nulls("map_brier")
            assert row["map_brier"] == pytest.approx(own["map_brier"].mean())
            assert row["detection_time_s"] == pytest.approx(own["detection_time_s"].mean())
            assert standings.main.maps.equals(standings.maps)
    for name in ("places", "none"):
        scenario = base.with_values({"strategy.name": name})
        study = detection_study(scenario, [2], [0.32, 0.6], 3)
        found = detection_of(study.run(), 0.05)
        assert ("maps" in detection_document(found).tables) == (name == "places")
        if name == "places":
            assert found.tables["maps"]["fill_ratio"].to_list() == [0.32, 0.6]
            assert found.tables["maps"]["detection_time_s"].is_null().to_list() == [True, False]


def test_patches_have_no_scores() -> None:
    assert not keeps_map(preset("optimised-places").with_values({"floor.source": "patch:0.10"}))
