"""Scores of the maps that robots have at the end of runs, as figures of studies."""

from __future__ import annotations

import numpy as np
import pytest

from vibroswarm import Study, preset, simulate
from vibroswarm.result import Result
from vibroswarm.statistics.map_figures import floor_maps, keeps_map
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


def test_patches_have_no_scores() -> None:
    assert not keeps_map(preset("optimised-places").with_values({"floor.source": "patch:0.10"}))
