"""A simulation written as a log is read back equal to what the format holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.read import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.statistics.sampling import packet_loss

KEY = ["run", "robot", "sample"]


@pytest.fixture(scope="module")
def recording(logs: list[Path], ground: Floor) -> Recording:
    return recording_of([read_log(path) for path in logs], ground, preset("paper"))


@pytest.fixture(scope="module")
def from_console(console_logs: list[Path], ground: Floor) -> Recording:
    return recording_of([read_log(path) for path in console_logs], ground, preset("paper"))


def side_by_side(mine: pl.DataFrame, theirs: pl.DataFrame) -> pl.DataFrame:
    both = mine.join(theirs, on=KEY, how="inner", suffix="_made")
    assert both.height == mine.height
    return both


def test_the_robots_log_holds_every_sample(recording: Recording, made: Result) -> None:
    assert recording.motion.height == made.motion.height
    assert recording.seed is None
    both = side_by_side(recording.inference, made.inference)
    for name in ("alpha", "beta", "messages_received", "decision"):
        assert (both[name] == both[f"{name}_made"]).all(), name
    cut = np.floor(both["belief_below_made"].to_numpy() * 1000 + 1e-9) / 1000
    assert np.array_equal(both["belief_below"].to_numpy(), cut)
    assert both["message"].null_count() == both.height  # it does not tell them
    energy = side_by_side(recording.rows.select(*KEY, "energy"), made.observations)
    assert np.abs(energy["energy"] - energy["energy_made"].cast(pl.Float64)).max() <= 0.0005 + 1e-6
    bits = side_by_side(recording.observations, made.observations)
    assert (bits["observation"] == bits["observation_made"]).all()


def test_the_console_log_holds_samples_after_five_seconds(from_console: Recording, made: Result) -> None:
    later = made.motion.filter(pl.col("time_s") > 5.0)
    both = from_console.motion.join(later, on=KEY, how="inner", suffix="_made")
    assert both.height == later.height == from_console.motion.height
    assert (both["time_s"] - both["time_s_made"]).abs().max() < 1e-6
    assert np.hypot(both["x_m"] - both["x_m_made"], both["y_m"] - both["y_m_made"]).max() < 1e-6
    for name in ("message", "alpha", "beta", "messages_received", "decision"):
        inferred = side_by_side(from_console.inference, made.inference)
        assert (inferred[name] == inferred[f"{name}_made"]).all(), name
    assert all(one["told"]["rows_repeated"] == 5 for one in from_console.sessions)
    assert from_console.scenario.walk.walk_duration_scale_ms == 15000.0
    assert "walk.walk_duration_scale_ms" in from_console.stated


def test_a_recording_is_kept_and_read_back(recording: Recording, tmp_path: Path) -> None:
    recording.write(tmp_path / "kept")
    again = Recording.read(tmp_path / "kept")
    assert again == recording
    assert Result.read(tmp_path / "kept").same_tables(recording)


def test_any_csv_can_be_read_by_a_column_map(made: Result, ground: Floor, tmp_path: Path) -> None:
    """Centimetres, milliseconds, a y that counts down, a robot's number from 7 on, no posteriors."""
    table = made.motion.join(made.observations, on=KEY).filter(pl.col("run") == 0)
    table.select(
        t=(pl.col("time_s") * 1000).round(),
        who=pl.col("robot") + 7,
        x=pl.col("x_m") * 100,
        down=100 - pl.col("y_m") * 100,
        rms="energy",
    ).write_csv(tmp_path / "mine.csv")
    (tmp_path / "map.toml").write_text(
        'name = "mine"\n[columns]\nrobot = "who"\ntime_s = { name = "t", times = 0.001 }\n'
        'x_m = { name = "x", times = 0.01 }\ny_m = { name = "down", times = -0.01, plus = 1.0 }\nenergy = "rms"\n'
    )
    log = read_log(tmp_path / "mine.csv", columns=tmp_path / "map.toml")
    found = recording_of([log], ground, preset("paper"), ["sensor.rms_threshold"])
    assert found.names == (7, 8, 9, 10, 11)
    assert found.source == "recording (mine)"
    mine = found.motion.join(made.motion, on=KEY, suffix="_made")
    assert mine.height == table.height
    assert np.abs(mine["x_m"] - mine["x_m_made"]).max() < 1e-9
    assert np.abs(mine["y_m"] - mine["y_m_made"]).max() < 1e-9
    assert found.inference["alpha"].null_count() == table.height
    assert found.robots["decision"].to_list() == [None] * 5
    assert found.runs["consensus"].to_list() == [None]
    assert packet_loss(found)["packet_loss"].to_list() == [None]
