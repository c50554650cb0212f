"""Videos as they come from phones and broken disks: what can be used gives the same places, the rest a sentence."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from helpers.commands import refusal_of
from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.tracking import opencv, video_file

cv2 = pytest.importorskip("cv2")
drawn = pytest.importorskip("helpers.drawn_video")
boxes = pytest.importorskip("helpers.mp4_boxes")
pytestmark = pytest.mark.usefixtures("blank_pictures", "one_focal_length")
FRAMES, FEW = 40, 6
TURNS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a markers' file and a good video, as .mp4 and as .avi."""
    path = tmp_path_factory.mktemp("bad videos")
    (path / "markers.toml").write_text(drawn.MARKERS.to_toml(), encoding="utf-8")
    for name in ("good.mp4", "good.avi"):
        drawn.write(path / name, drawn.frames(FRAMES))
    drawn.write(path / "short.mp4", drawn.frames(FEW))
    return path


def tracked(folder: Path, video: Path, out: Path, *more: str) -> int:
    return main(
        ["lab", "track", str(video), "--markers", str(folder / "markers.toml"), "--out", str(out), *more]
    )


def positions(out: Path) -> pl.DataFrame:
    return pl.read_parquet(out / "positions.parquet")


def errors_mm(table: pl.DataFrame) -> np.ndarray[Any, Any]:
    """Distances from where the robots were drawn, by the number of each position."""
    parts = []
    for robot in range(2):
        own = table.filter(pl.col("robot") == robot)
        true = np.array([drawn.centre_m(robot, k) for k in range(own.height)])
        parts.append(1000 * np.hypot(own["x_m"] - true[:, 0], own["y_m"] - true[:, 1]))
    return np.concatenate(parts)


def test_a_good_video_is_tracked(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "a folder"
    assert tracked(folder, folder / "good.mp4", out) == 0
    table = positions(out)
    assert table.height == 2 * FRAMES
    assert errors_mm(table).max() < 2.0  # a pixel is 2.1 mm
    assert np.abs(table["heading_rad"] - np.pi / 2).max() < 0.05  # type: ignore[operator]


@pytest.mark.parametrize(("by", "degrees"), [("pixels", 90), ("pixels", 180), ("flag", 270)])
def test_a_turned_camera_gives_the_same_places(folder: Path, tmp_path: Path, degrees: int, by: str) -> None:
    """The floor's markers tell which way the picture is; a phone's flag is obeyed, and would not matter."""
    video = tmp_path / "turned.mp4"
    if by == "flag":
        video.write_bytes(boxes.with_rotation((folder / "short.mp4").read_bytes(), degrees))
    else:
        drawn.write(video, [cv2.rotate(picture, TURNS[degrees]) for picture in drawn.frames(FEW)])
    assert tracked(folder, video, tmp_path / "out") == 0
    table = positions(tmp_path / "out")
    assert table.height == 2 * FEW
    assert errors_mm(table).max() < 2.0
    assert np.abs(table["heading_rad"] - np.pi / 2).max() < 0.05  # type: ignore[operator]


def test_a_mirrored_picture_is_refused(folder: Path, tmp_path: Path, capsys: Any) -> None:
    """A control of the test above: not every picture is accepted. Mirrored markers are none."""
    drawn.write(tmp_path / "m.mp4", [cv2.flip(picture, 1) for picture in drawn.frames(FEW)])
    assert tracked(folder, tmp_path / "m.mp4", tmp_path / "out") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "shows none of the robots' markers" in said
    assert "the picture is mirrored (seen in a mirror it shows 0, 1, 46, 47, 48, 49)" in said


def test_uneven_frames_have_the_times_of_the_file(folder: Path, tmp_path: Path, capsys: Any) -> None:
    whole = (folder / "good.mp4").read_bytes()
    usual = boxes.units_per_s(whole) // 10
    steps = [usual] * 15 + [4 * usual] + [usual // 2] * 6 + [usual] * 18  # as long as before in all
    video = tmp_path / "uneven.mp4"
    video.write_bytes(boxes.with_steps(whole, steps))
    assert tracked(folder, video, tmp_path / "out") == 0
    own = positions(tmp_path / "out").filter(pl.col("robot") == 0)["time_s"].to_numpy()
    expected = np.cumsum([0, *steps[:-1]]) / (10 * usual)
    assert own == pytest.approx(expected, abs=1e-3)
    assert "Frames are uneven" in " ".join(capsys.readouterr().out.split())
    page = (tmp_path / "out" / "review.html").read_text(encoding="utf-8")
    assert "the longest is 400" in page.replace("\u00a0", " ")


def damaged(whole: bytes) -> bytes:
    half = len(whole) // 2
    return whole[:half] + np.random.default_rng(1).bytes(len(whole) // 6) + whole[half + len(whole) // 6 :]


@pytest.mark.parametrize(
    ("name", "make", "words"),
    [
        ("empty.mp4", lambda whole: b"", "is empty: 0 bytes"),
        ("text.mp4", lambda whole: b"this is no video\n" * 99, "cannot be read as a video"),
        ("half.mp4", lambda whole: whole[: len(whole) // 2], "cut off before its index was written"),
        (
            "half.avi",
            lambda whole: whole[: len(whole) // 2],
            r"ends after 20 of 40 frames \(1.9 s\): it is truncated or damaged",
        ),
        ("in the middle.avi", damaged, "it is truncated or damaged; copy it again, or add --partial"),
        (
            "head.avi",
            lambda whole: bytes(3000) + whole[3000:],
            "cannot be read as a video|states neither its length",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_sentence(
    folder: Path, tmp_path: Path, capfd: Any, name: str, make: Any, words: str
) -> None:
    video = tmp_path / name
    video.write_bytes(make((folder / f"good{video.suffix}").read_bytes()))
    assert tracked(folder, video, tmp_path / "out") == 2
    said = capfd.readouterr().err
    assert re.search(words, " ".join(said.split())), said
    assert said.startswith("vibroswarm: error: ")
    assert said.count("\n") == 1  # nothing of OpenCV's or FFmpeg's
    assert not (tmp_path / "out").exists()


def test_what_is_there_of_a_truncated_video_is_used_if_asked(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "good.avi").read_bytes()
    (tmp_path / "half.avi").write_bytes(whole[: int(0.7 * len(whole))])
    assert tracked(folder, tmp_path / "half.avi", tmp_path / "out", "--partial") == 0
    table = positions(tmp_path / "out")
    assert 2 * 20 < table.height < 2 * 30
    assert errors_mm(table).max() < 2.0


def test_a_folder_and_a_missing_file_are_named(folder: Path, tmp_path: Path, capsys: Any) -> None:
    assert tracked(folder, folder, tmp_path / "out") == 2
    assert "is a folder; give the name of a file" in " ".join(capsys.readouterr().err.split())
    assert tracked(folder, folder / "there is none.mp4", tmp_path / "out") == 2
    assert "there is none.mp4: cannot be read: there is no such file" in " ".join(
        capsys.readouterr().err.split()
    )
    track = ["lab", "track", str(folder / "short.mp4"), "--markers", str(tmp_path / "missing.toml")]
    assert "missing.toml" in refusal_of(capsys, *track, "--out", str(tmp_path / "out"))


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        ({"robots": False}, "shows none of the robots' markers [0, 1]"),
        ({"floor": False}, "shows none of the floor's markers [46, 47, 48, 49]"),
    ],
)
def test_a_video_without_markers_is_refused(
    folder: Path, tmp_path: Path, capsys: Any, shown: Any, words: str
) -> None:
    drawn.write(tmp_path / "bare.mp4", drawn.frames(FEW, **shown))
    assert tracked(folder, tmp_path / "bare.mp4", tmp_path / "out") == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("beside", "words"),
    [
        ({}, "shows the robots' markers [0, 1] at"),
        ({"robots": False}, "shows the floor's markers [46, 47, 48, 49]"),
    ],
)
def test_two_arenas_in_a_video_are_said(
    folder: Path, tmp_path: Path, capsys: Any, beside: Any, words: str
) -> None:
    """It said that a video shows none of these markers, and which it does show: the same."""
    both = zip(drawn.frames(FEW), drawn.frames(FEW, **beside), strict=True)
    drawn.write(tmp_path / "two.mp4", [np.hstack(pair) for pair in both])
    assert tracked(folder, tmp_path / "two.mp4", tmp_path / "out") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert words in said
    assert "if it shows several arenas, crop it to one" in said


def test_interrupted_it_leaves_nothing_half_written(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from vibroswarm.tracking import marker_detection as detection

    real, seen = detection.pictures_of, []

    def stopped(*given: Any, **more: Any) -> Any:
        for picture in real(*given, **more):
            seen.append(picture)
            if len(seen) == 3:
                raise KeyboardInterrupt
            yield picture

    monkeypatch.setattr(detection, "pictures_of", stopped)
    assert tracked(folder, folder / "short.mp4", tmp_path / "out") == 130
    assert len(seen) == 3
    assert list(tmp_path.iterdir()) == []
    assert "interrupted" in capsys.readouterr().err
    monkeypatch.undo()
    out = tmp_path / "out"
    assert tracked(folder, folder / "short.mp4", out) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    with monkeypatch.context() as patched:  # later, while the page is drawn
        patched.setattr("vibroswarm.show.page.write_page", interrupt)
        assert tracked(folder, folder / "short.mp4", out) == 130
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def interrupt(*given: Any) -> None:
    raise KeyboardInterrupt


def test_an_upright_video_without_frames_is_closed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The size of an upright video is that of its first frame; without one the file must not stay open."""
    captures = []

    class Empty:
        """A capture of a video that was taken upright and has no frames."""

        released = False

        def get(self, _: int) -> float:
            return 90.0

        def read(self) -> tuple[bool, None]:
            return False, None

        def isOpened(self) -> bool:  # noqa: N802 - named by OpenCV
            return True

        def release(self) -> None:
            self.released = True

    monkeypatch.setattr(opencv(), "VideoCapture", lambda *_: captures.append(Empty()) or captures[-1])
    with pytest.raises(InputError, match="has no frames"):
        video_file.video_info(folder / "good.mp4")
    assert [capture.released for capture in captures] == [True]
