"""The three recorded sessions, each judged with the law of the sensor of the other two.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder. One floor, always the same, proves that the
law and the places fit this floor, not how often a map would be wrong on another.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.calibrate.fit_sensor import SPREADS
from vibroswarm.inspection.checks import law_checks
from vibroswarm.inspection.inspection import Inspection, inspect
from vibroswarm.inspection.laws import law_named, law_of_sessions, write_law
from vibroswarm.inspection.others import by_tiles
from vibroswarm.inspection.samples import Law, ratios_of_values
from vibroswarm.inspection.sources import samples_of_result
from vibroswarm.inspection.tile_map import tile_map
from vibroswarm.recordings.recording import Recording
from vibroswarm.statistics.map_scores import map_scores

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def sessions(real: Recording) -> list[Inspection]:
    return [inspect(real, run=run) for run in range(3)]


def test_all_tiles_are_right_before_300_s(sessions: list[Inspection]) -> None:
    for found in sessions:
        assert "other 2 sessions" in found.samples.law.origin
        assert found.right_from_s is not None
        assert found.right_from_s < 300.0
        assert found.scores["brier"][-1] < 1e-6


def test_a_law_of_one_session_serves_another_and_not_its_own(real: Recording, tmp_path: Path) -> None:
    found = dataset_of([real])
    write_law(law_of_sessions(found, [0], "session 1", draws=2), real.scenario, tmp_path / "law.toml")
    law = law_named(str(tmp_path / "law.toml"))
    own, other = (samples_of_result(real, run, law) for run in (0, 1))
    assert own.warning.startswith("The session judges itself")
    assert not other.warning
    assert map_scores(tile_map(other, [600.0])[0], other.floor)["right"] == 1.0


def test_a_session_in_another_unit_and_a_stuck_sensor_are_warned_of(real: Recording) -> None:
    """Maps of both were sure, without a word: of values times 1000 all tiles vibrated."""
    law = law_of_sessions(dataset_of([real]), [0], "session 1", draws=0)
    value, own = pl.col("energy"), pl.col("robot") == 2
    for changed, words in (
        (value * 1000.0, "outside of those of the law"),
        (pl.when(own & value.is_not_null()).then(1.0).otherwise(value), "All values of robot 2 are the same"),
    ):
        wrong = replace(real, rows=real.rows.with_columns(energy=changed.cast(real.rows["energy"].dtype)))
        assert words in samples_of_result(wrong, 1, law).warning


def test_the_law_of_the_others_holds_and_not_with_another_gain(sessions: list[Inspection]) -> None:
    refused = []
    for found in sessions:
        samples = found.samples
        assert set(law_checks(samples, by_tiles(samples), drawn=99)["outcome"]) == {"not refused"}
        for robot in samples.robots:
            gain = np.where(samples.frame["robot"].to_numpy() == robot, 1.5, 1.0)
            value = samples.column("value") * gain
            changed = samples.with_columns(value=value, log_ratio=ratios_of_values(samples.law, value))
            refused.append("refused" in law_checks(changed, by_tiles(changed), drawn=99)["outcome"])
    assert np.mean(refused) >= 0.4  # robots differ by 12 % by the law, so that not every such gain is unusual


@pytest.mark.parametrize("control", ["shuffled", "mirrored", "swapped"])
def test_a_control_must_fail(sessions: list[Inspection], control: str) -> None:
    random = np.random.default_rng(5)
    for found in sessions:
        samples = found.samples
        order = random.permutation(samples.frame.height)
        wrong = {
            "shuffled": {name: samples.column(name)[order] for name in ("x_m", "y_m")},
            "mirrored": {"x_m": 1.0 - samples.column("x_m")},
            "swapped": {"log_ratio": -samples.column("log_ratio")},
        }[control]
        scores = [
            map_scores(p, samples.floor)
            for p in tile_map(samples.with_columns(**wrong), [180.0, 300.0, 600.0])
        ]
        assert min(score["brier"] for score in scores) > 0.25
        assert min(score["surely_wrong"] for score in scores) >= 5


def test_a_law_that_splits_the_values_of_the_session_itself_must_fail(sessions: list[Inspection]) -> None:
    """The larger half of the values is taken for vibrating; nothing is known of edges, tiles and robots."""
    wrong, at_s = [], [180.0, 300.0]
    for found in sessions:
        value = found.samples.column("value")
        stated: dict[str, float | None] = dict.fromkeys(("edge_reach_m", "edge_blur_m", *SPREADS))
        for kind, part in (("still", value <= np.median(value)), ("vibrating", value > np.median(value))):
            scale = value[part].var() / value[part].mean()
            stated |= {
                f"{kind}_shape": value[part].mean() / scale, f"{kind}_scale": scale, f"{kind}_location": 0.0,
            }  # fmt: skip
        law = Law(found.samples.law.sensor.model_copy(update=stated), "of the session itself")
        blind = replace(found.samples, law=law).with_columns(log_ratio=ratios_of_values(law, value))
        scores = [map_scores(p, blind.floor) for p in tile_map(blind, at_s)]
        wrong.append(max(score["surely_wrong"] for score in scores))
        of_others = [map_scores(p, blind.floor) for p in tile_map(found.samples, at_s)]
        assert max(score["surely_wrong"] for score in of_others) == 0
    assert sum(number >= 1 for number in wrong) >= 2
