"""Markers in a real handheld video and in a photograph, against OpenCV's detector alone."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from vibroswarm.lab.tracking.marker_detection import detect
from vibroswarm.lab.tracking.markers import Markers
from vibroswarm.lab.tracking.video_file import frames_of

cv2 = pytest.importorskip("cv2")
Floats = NDArray[np.float64]
FOLDER = Path(os.environ.get("VIBROSWARM_MARKERS", "missing"))
pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason="set VIBROSWARM_MARKERS to the folder of real pictures of markers"
)
IDS = (23, 40, 62, 98, 124, 203)
SHEET = Markers(
    dictionary="6X6_250",
    robots={marker: k for k, marker in enumerate(IDS)},
    size_m=0.022,
    height_m=0.0,
    floor={249: (0.0, 0.0, 0.0)},
    floor_size_m=0.05,
)


@pytest.mark.slow
def test_in_a_handheld_video_no_fewer_are_found_than_by_the_detector_alone() -> None:
    video = FOLDER / "handheld-384x216.mp4"
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250))
    seen = [detector.detectMarkers(frame)[1] for _, frame in frames_of(video)]
    alone = np.array([[ids is not None and marker in ids for marker in IDS] for ids in seen])
    found = np.isfinite(detect(video, SHEET).corners_px).all(axis=(2, 3))
    assert alone.mean(axis=0) == pytest.approx([0.959, 0.986, 0.984, 0.710, 0.777, 0.966], abs=0.01)
    assert not (alone & ~found).any()
    assert (found.mean(axis=0) > alone.mean(axis=0)).all()
