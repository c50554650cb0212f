"""The three recorded sessions, each judged with the law of the sensor of the other two, by energies and by bits.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder. One floor, always the same, proves that the
law and the places fit this floor, not how often a map would be wrong on another.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.errors import InputError
from vibroswarm.inspection.checks import law_checks
from vibroswarm.inspection.inspection import Inspection, inspect
from vibroswarm.inspection.laws import law_named, law_of_sessions, write_law
from vibroswarm.inspection.samples import Doubt, ratios_of_values
from vibroswarm.inspection.sources import samples_of_result
from vibroswarm.inspection.tile_map import tile_map
from vibroswarm.recordings.recording import Recording
from vibroswarm.statistics.map_figures import map_scores

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def sessions(real: Recording) -> list[Inspection]:
    return [inspect(real, run=run) for run in range(3)]


def test_all_tiles_are_right_by_300_s_and_not_if_mirrored(sessions: list[Inspection]) -> None:
    for found in sessions:
        by_then = tile_map(found.samples, [300.0])[0]
        assert map_scores(by_then, found.samples.grid)["right"] == 1.0
        assert found.scores["brier"][-1] < 1e-6
        mirrored = found.samples.with_columns(x_m=1.0 - found.samples.column("x_m"))
        assert map_scores(tile_map(mirrored, [300.0])[0], found.samples.grid)["brier"] > 0.25


def test_bits_alone_give_the_map_without_a_law_of_energies(real: Recording) -> None:
    bare = replace(real, rows=real.rows.with_columns(energy=pl.lit(None, real.rows["energy"].dtype)))
    for run in range(3):
        found = inspect(bare, run=run, bits=True)
        assert found.samples.law.sensor.model == "confusion"
        assert found.scores["right"][-1] >= 0.96
        assert set(found.samples.column("value")) == {0.0, 1.0}  # zeros are readings


def test_a_law_of_one_session_serves_another_and_not_its_own(real: Recording, tmp_path: Path) -> None:
    found = dataset_of([real])
    write_law(law_of_sessions(found, [0], "session 1", draws=2), real.scenario, tmp_path / "law.toml")
    law = law_named(str(tmp_path / "law.toml"))
    own, other = (samples_of_result(real, run, law) for run in (0, 1))
    assert own.doubts == (Doubt.OWN_LAW,)
    assert not other.doubts
    assert map_scores(tile_map(other, [600.0])[0], other.grid)["right"] == 1.0


def test_a_session_in_another_unit_is_refused(real: Recording) -> None:
    law = law_of_sessions(dataset_of([real]), [0], "session 1", draws=0)
    energy = (pl.col("energy") * 1000.0).cast(real.rows["energy"].dtype)
    with pytest.raises(InputError, match="outside those of the law"):
        samples_of_result(replace(real, rows=real.rows.with_columns(energy)), 1, law)


def test_the_law_of_the_others_holds_and_not_with_another_gain(sessions: list[Inspection]) -> None:
    refused = []
    for found in sessions:
        samples = found.samples
        assert set(law_checks(samples)["outcome"]) == {"not refused"}
        for robot in samples.robots:
            gain = pl.when(pl.col("robot") == robot).then(1.5).otherwise(1.0)
            value = samples.frame.select(pl.col("value") * gain)["value"].to_numpy()
            changed = samples.with_columns(value=value, log_ratio=ratios_of_values(samples.law, value))
            refused.append("refused" in law_checks(changed)["outcome"])
    assert sum(refused) >= 0.4 * len(
        refused
    )  # robots differ by 12 % by the law: not every such gain is unusual
