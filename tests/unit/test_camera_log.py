"""The log of a tracked session is read back as it was written, and a folder stands for its log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from helpers.commands import refusal_of
from vibroswarm.cli import main
from vibroswarm.recordings.log import SAMPLES, TRACKS, Log, log_frame
from vibroswarm.recordings.log_readers import (
    CAMERA_LOG,
    camera_log_bytes,
    looks_like_camera,
    read_log,
)
from vibroswarm.recordings.recording import Recording
from vibroswarm.tracking.track import read_robot_log


def log_of(seed: int, robots: int = 2) -> Log:
    """Robots that drive for 60 s, seen ten times a second, with a sample every 5 s."""
    chance = np.random.default_rng(seed)
    parts = []
    for robot in range(robots):
        time_s = np.arange(0, 60, 0.1)
        turn = np.cumsum(chance.normal(0, 0.1, time_s.size))
        parts.append(
            pl.DataFrame(
                {
                    "robot": np.full(time_s.size, robot + 4),
                    "time_s": time_s + 0.003 * robot,
                    "x_m": 0.5 + 0.3 * np.sin(0.1 * turn + robot),
                    "y_m": 0.5 + 0.3 * np.cos(0.1 * turn + robot),
                    "heading_rad": np.angle(np.exp(1j * turn)),
                }
            )
        )
    tracks = pl.concat(parts).with_columns(line=pl.lit(0, dtype=pl.UInt32)).sort("time_s", "robot")
    samples = tracks.filter(pl.col("time_s") % 5.0 < 0.05, pl.col("time_s") > 1.0)
    samples = samples.with_columns(energy=pl.Series(chance.uniform(0.5, 3.0, samples.height)))
    return Log("a.csv", "camera", log_frame(samples.to_dict(), SAMPLES), log_frame(tracks.to_dict(), TRACKS))


def test_a_log_is_read_back(tmp_path: Path) -> None:
    log = log_of(1)
    (tmp_path / CAMERA_LOG).write_bytes(camera_log_bytes(log))
    back = read_log(tmp_path / CAMERA_LOG)
    assert back.reader == "camera"
    for table, written in ((back.samples, log.samples), (back.tracks, log.tracks)):
        assert table.drop("line").columns == written.drop("line").columns
        for name in table.drop("line").columns:
            if written[name].null_count() == written.height:
                assert table[name].null_count() == table.height
            else:
                assert table[name].to_numpy() == pytest.approx(written[name].to_numpy(), abs=1e-6)
    assert not looks_like_camera("robot,time_s,x_m\n")


def test_the_robots_log_may_have_timestamps(tmp_path: Path) -> None:
    """Its clock is found from the stops, so that its times may begin anywhere."""
    (tmp_path / "log.csv").write_text(
        "robot,time_s,energy\n4,2026-05-01 10:00:00.250+02:00,1.5\n4,2026-05-01 10:00:03+02:00,1.6\n"
    )
    assert read_robot_log(tmp_path / "log.csv")["time_s"].to_list() == [0.0, 2.75]


def test_sessions_of_several_folders_become_one_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = []
    for seed in (1, 2):
        folder = tmp_path / f"tracked {seed}"
        folder.mkdir()
        (folder / CAMERA_LOG).write_bytes(camera_log_bytes(log_of(seed)))
        folders.append(str(folder))
    floor = tmp_path / "floor.txt"
    floor.write_text("10\n01\n", encoding="utf-8")
    given = ["--floor", str(floor), "--any-floor", "--out", str(tmp_path / "lab")]
    assert main(["lab", "import", *folders, *given]) == 0
    recording = Recording.read(tmp_path / "lab")
    assert [session["log"] for session in recording.sessions] == ["tracked 1", "tracked 2"]
    assert [session["reader"] for session in recording.sessions] == ["camera", "camera"]
    assert recording.runs.height == 2
    assert recording.names == (4, 5)
    assert recording.motion.filter(pl.col("run") == 1).height == log_of(2).samples.height
    assert "is a folder without log.csv" in refusal_of(
        capsys, "lab", "import", str(tmp_path), *given, "--force"
    )
