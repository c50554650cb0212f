"""A simulation written as a log is read back equal to what the format holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from vibroswarm.recordings.read import read_log

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.motion.pose import pose
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.export import write_csv
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.replay import with_beliefs
from vibroswarm.report.report import report
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.statistics.sampling import packet_loss, walk_figures
from vibroswarm.statistics.verdict import verdict

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


def test_times_are_late_by_at_most_a_camera_loop_and_counters_are_exact(
    recording: Recording, made: Result
) -> None:
    both = side_by_side(recording.motion, made.motion)
    late = (both["time_s"] - both["time_s_made"]).to_numpy()
    assert late.min() > -0.23
    assert late.max() < 0.2251
    assert np.mean(late >= -1e-9) > 0.99  # but for the last loop
    # But places are those of the samples, and not those to which the robots drove by then.
    assert np.hypot(both["x_m"] - both["x_m_made"], both["y_m"] - both["y_m_made"]).max() < 1e-6
    assert (both["avoid_s"] - both["avoid_s_made"]).abs().max() < 0.0011
    assert (both["stop_s"] - both["stop_s_made"]).abs().max() < 0.0011
    assert both["heading_rad"].null_count() == both.height
    assert max(one["told"]["counters_wrapped"] for one in recording.sessions) >= 5  # 100 s of standing each


def stands_at(result: Result, robot: int, times: np.ndarray) -> np.ndarray:
    own = result.poses.filter(run=1, robot=robot).sort("time_s")
    return (own["kind"] == "stop").to_numpy()[own["time_s"].search_sorted(times, side="right").to_numpy() - 1]


def test_a_session_can_be_watched_where_the_robots_were(recording: Recording, made: Result) -> None:
    times = np.arange(1.0, 399.0, 7.3)
    for robot in range(5):
        seen, was = pose(recording.poses, 1, robot, times), pose(made.poses, 1, robot, times)
        off = np.hypot(*(seen - was)[:, :2].T)
        assert off.max() < 0.004  # a straight line for an arc of a quarter of a second, and 2 mm of standing
        often = np.arange(1.0, 399.0, 0.05)
        stands, stood = (stands_at(result, robot, often) for result in (recording, made))
        assert (stands != stood).mean() < 0.06  # a camera's step at each end of a stop


def test_what_became_of_the_robots(recording: Recording, made: Result) -> None:
    mine, theirs = recording.robots, made.robots
    for name in ("decision", "alpha", "beta", "samples", "sent"):
        differs = (mine[name] != theirs[name]).sum()
        # Messages that came after the last sample are in no row.
        assert differs == 0 or name in ("alpha", "beta"), name
    assert (mine["decision_time_s"] - theirs["decision_time_s"]).abs().max() < 0.23
    assert recording.runs["consensus"].to_list() == made.runs["consensus"].to_list()
    assert not recording.runs["stopped_early"].any()


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
    said = verdict(found)
    assert (said.consensus, said.decision, said.robots[0].estimate) == (None, None, None)
    assert report(found).answer[0].startswith("Not logged")
    assert packet_loss(found)["packet_loss"].to_list() == [None]
    assert walk_figures(found.motion, found.observations)["avoid_per_sample_s"].to_list() == [None]
    shown = with_beliefs(replace(found, scenario=found.scenario.with_values({"run.t_end_s": 5000.0})))
    assert shown.runs["stopped_early"].to_list() == [False]  # the session was ended by people
    assert set(shown.robots["decision"].to_list()) <= {-1, 0, 1}


def test_tables_are_written_as_csv_all_or_none(recording: Recording, tmp_path: Path) -> None:
    (tmp_path / "runs.csv").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"runs\.csv: exists already"):
        write_csv(recording, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["runs.csv"]
    write_csv(recording, str(tmp_path), replace=True)
    for name in ("runs", "motion", "observations"):
        assert pl.read_csv(tmp_path / f"{name}.csv").height == getattr(recording, name).height
