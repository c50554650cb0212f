"""Which markers are found in the frames of a video, against OpenCV's detector alone; and what is said if none are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vibroswarm.lab.tracking import marker_detection
from vibroswarm.lab.tracking.marker_detection import detect
from vibroswarm.lab.tracking.markers import DICTIONARIES, Markers, first_corner, read_markers
from vibroswarm.lab.tracking.video_file import frames_of

cv2 = pytest.importorskip("cv2")
drawn = pytest.importorskip("helpers.drawn_video")
pytestmark = pytest.mark.usefixtures("one_focal_length")
Pictures = list[np.ndarray[Any, Any]]


def by_detector_alone(video: Path, markers: Markers) -> np.ndarray[Any, Any]:
    """Whether OpenCV's detector, with its default settings, sees each robot's marker in each frame."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{markers.dictionary}"))
    detector = cv2.aruco.ArucoDetector(dictionary)
    seen = [detector.detectMarkers(frame)[1] for _, frame in frames_of(video)]
    return np.array([[ids is not None and marker in ids for marker in markers.robots] for ids in seen])


def found_in(video: Path, markers: Markers) -> np.ndarray[Any, Any]:
    """Whether each robot's marker is found in each frame."""
    return np.isfinite(detect(video, markers).corners_px).all(axis=(2, 3))


def bad_frames() -> Pictures:
    """Frames in which markers are hidden, blurred, noisy and put elsewhere, at random times."""
    chance = np.random.default_rng(5)
    frames = drawn.frames(40)
    for k, frame in enumerate(frames):
        if 12 < k % 20 < 17:  # a hand
            frame[:, int(chance.integers(0, 400)) :][:, :240] = 90
        if k % 7 == 3:
            frame[:] = cv2.GaussianBlur(frame, (0, 0), 1.6)
        if k % 11 > 7:  # somebody knocks against the camera
            frame[:] = np.roll(frame, (-25, -60), axis=(0, 1))
        noise = chance.normal(0.0, 12.0, frame.shape)
        frame[:] = np.clip(frame + noise, 0, 255).astype(np.uint8)
    return frames


def test_no_marker_is_missed_that_the_detector_alone_sees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    video = tmp_path / "bad.avi"
    drawn.write(video, bad_frames())
    alone = by_detector_alone(video, drawn.MARKERS)
    assert 0.3 < alone.mean() < 0.9
    assert not (alone & ~found_in(video, drawn.MARKERS)).any()
    monkeypatch.setattr(marker_detection, "_window", lambda *given: None)
    monkeypatch.setattr(marker_detection._Detector, "markers_in", lambda self, image: {})
    assert (alone & ~found_in(video, drawn.MARKERS)).any()  # the control


@pytest.mark.parametrize("dictionary", DICTIONARIES)
def test_markers_of_every_dictionary_are_found(tmp_path: Path, dictionary: str) -> None:
    path = tmp_path / "markers.toml"
    markers = replace(drawn.MARKERS, dictionary=dictionary, floor={9: (0.1, 0.1, 0.0)})
    path.write_text(markers.to_toml(), encoding="utf-8")
    assert read_markers(path) == markers
    of_opencv = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    assert len(of_opencv.bytesList) == DICTIONARIES[dictionary]
    picture = np.full((200, 200), 230, dtype=np.uint8)
    picture[60:140, 70:150] = cv2.aruco.generateImageMarker(of_opencv, 7, 80)
    finder = marker_detection._Finder(cv2, replace(markers, robots={3: 0, 7: 1}))
    (four,), (of_listed,) = finder.everywhere(picture)[7], finder.listed_in(picture)[7]
    assert (four == of_listed).all()
    at = np.array([[70, 60], [149, 60], [149, 139], [70, 139]], dtype=float)
    assert np.abs(four - np.roll(at, first_corner(dictionary), axis=0)).max() < 1.0
