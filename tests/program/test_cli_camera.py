"""``lab track``: from a result to a rendered video and back, against where the robots were."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from helpers.commands import json_of
from helpers.rehearsal import write_rehearsal
from helpers.scene import Look
from vibroswarm import preset, simulate
from vibroswarm.cli import lab_track
from vibroswarm.lab.tracking.camera import square_of
from vibroswarm.lab.tracking.markers import read_markers, usual_markers
from vibroswarm.lab.tracking.track import Tracking, track
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

pytest.importorskip("cv2")
pytestmark = pytest.mark.slow
OFFSET_S = 12.3
LOOK = Look(size_px=(720, 540), frames_per_s=10.0, hands_per_min=0.0, samples=2)
ROBOTS = usual_markers(5, 1.0, 1.0, size_mm=50.0)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a result, its video and what belongs to it: 14 s of five robots at low resolution."""
    folder = tmp_path_factory.mktemp("a session")
    scenario = preset("paper").with_values({"run.t_end_s": 14.0, "floor.source": "random:0.48"})
    result = simulate(scenario, 3, 1, poses=True)
    result.write(folder / "run")
    rows = ["".join(map(str, row)) for row in result.floor(0).tiles.tolist()]
    (folder / "floor.txt").write_text("\n".join(rows) + "\n", encoding="utf-8")
    board = {"chessboard": True, "board_frames": 20}
    write_rehearsal(result, folder / "v.avi", ROBOTS, LOOK, clock_offset_s=OFFSET_S, **board)
    return folder


@pytest.fixture(scope="module", autouse=True)
def tracked_once() -> Iterator[None]:
    """The same video with the same settings is tracked once; what commands do with it is done each time."""
    track_it, kept = lab_track._tracking, {}

    def once(video: Path, *how: Any, **more: Any) -> Tracking:
        key = f"{video} {video.stat().st_mtime_ns} {how} {more}"
        if key not in kept:
            kept[key] = track_it(video, *how, **more)
        return kept[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lab_track, "_tracking", once)
        yield


@pytest.fixture(scope="module")
def tracked(session: Path) -> Tracking:
    """What is seen in the video with the markers of its file, and by its own lens."""
    return track(session / "v.avi", read_markers(session / "v.markers.toml"))


def errors_mm(session: Path, positions: pl.DataFrame) -> np.ndarray[Any, Any]:
    """Distances of positions from the truth."""
    frame = (pl.col("time_s") * 10).round().cast(pl.Int64)
    truth = pl.read_parquet(session / "v.truth.parquet").select(
        pl.col("robot").cast(pl.Int64), "x_m", "y_m", frame=frame
    )
    both = positions.with_columns(frame=frame).join(truth, on=["robot", "frame"], suffix="_true")
    assert both.height == positions.height
    return 1000 * np.hypot(both["x_m"] - both["x_m_true"], both["y_m"] - both["y_m_true"])


def test_a_video_is_tracked_into_a_recording(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = session / "tracked"
    given = [
        "lab",
        "track",
        str(session / "v.avi"),
        "--markers",
        str(session / "v.markers.toml"),
        "--out",
        str(out),
    ]
    given += ["--lens", str(session / "v.chessboard.avi"), "--log", str(session / "v.log.csv"), "--any-floor"]
    given += ["--floor", str(session / "floor.txt"), "--tiles", "5x5"]
    answer = json_of(capsys, *given, "--json")["answer"]
    assert "The robots' clock is +12." in answer[2]
    positions = pl.read_parquet(out / "positions.parquet")
    assert positions.height > 0.95 * 140 * 5
    assert np.quantile(errors_mm(session, positions), 0.95) < 2.0  # 0.75 px/mm; 1 mm at 1080p: the benchmark
    true = Result.read(session / "run").motion
    stops = pl.read_csv(out / "stops.csv")
    pairs = stops.join(true.select("robot", true_s="time_s").cast({"robot": pl.Int64}), on="robot")
    hits = pairs.filter((pl.col("end_s") - pl.col("true_s")).abs() < 0.5)
    assert hits.height >= 0.9 * true.height
    assert hits.height >= 0.97 * stops.height
    recording = Recording.read(out)
    assert recording.motion.height >= 0.9 * true.height
    near = recording.motion.join(
        true.with_columns(time_s=pl.col("time_s") + OFFSET_S).sort("time_s"),
        on=["robot", "sample"],
        how="inner",
    )
    apart = np.hypot(near["x_m"] - near["x_m_right"], near["y_m"] - near["y_m_right"])
    assert np.quantile(apart, 0.9) < 0.004


def test_heights_and_lenses_that_are_ignored_fail_the_bar(session: Path, tracked: Tracking) -> None:
    """Controls: the same video without the markers' height, and by the video's own lens."""
    markers, own = read_markers(session / "v.markers.toml"), tracked
    assert np.quantile(errors_mm(session, own.positions), 0.95) < 6.0
    seen = np.isfinite(own.detections.corners_px).all(axis=(2, 3))
    flat, _ = square_of(own.camera.at_height(own.detections.corners_px[seen], 0.0))
    right, _ = square_of(own.camera.at_height(own.detections.corners_px[seen], markers.height_m))
    assert np.quantile(np.hypot(*(flat - right).T), 0.95) > 0.008
    assert own.gaps().columns == ["robot", "start_s", "end_s"]
