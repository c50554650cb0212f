"""Markers in a real handheld video and in a photograph, against OpenCV's detector alone."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from vibroswarm.tracking.camera import fit_camera, square_of
from vibroswarm.tracking.marker_detection import _Detector, detect
from vibroswarm.tracking.markers import Markers
from vibroswarm.tracking.video_file import frames_of

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


def corners_in(name: str) -> tuple[tuple[int, ...], dict[int, Floats]]:
    """Return the size of a picture, rows and columns, and the corners, (4, 2), px, of each marker in it."""
    picture = cv2.imread(str(FOLDER / name), cv2.IMREAD_GRAYSCALE)
    return picture.shape, {
        marker: four for marker, (four,) in _Detector(cv2, "6X6_250").markers_in(picture).items()
    }


def away_mm_and_deg(markers: tuple[int, ...], height_m: float) -> Floats:
    """Return how far some markers of the photographed sheet are from their printed places, mm, and headings, degrees.

    The five others are those of the floor each time. 2200 px of the sheet are 11 inches.
    """
    (rows, _), printed_px = corners_in("sheet-6x6.png")
    shape, seen_px = corners_in("photograph-6x6.jpg")
    m_per_px = 11 * 0.0254 / 2200
    printed = {
        marker: m_per_px * (np.array([0, rows]) + [1, -1] * four) for marker, four in printed_px.items()
    }
    size_m = float(np.mean([np.linalg.norm(four[1] - four[0]) for four in printed.values()]))
    found = []
    for marker in markers:
        others = [other for other in IDS if other != marker]
        camera = fit_camera(
            shape[::-1],
            floor_m=np.concatenate([np.column_stack([printed[other], np.zeros(4)]) for other in others]),
            floor_px=np.concatenate([seen_px[other] for other in others]),
            robots_px=seen_px[marker][None],
            robot_size_m=size_m,
            robot_height_m=height_m,
        )
        at, along = square_of(camera.at_height(seen_px[marker][None], height_m))
        at_printed, along_printed = square_of(printed[marker][None])
        turned = np.angle(np.exp(1j * (along - along_printed)[0]))
        found.append((1000 * np.linalg.norm(at - at_printed), abs(np.degrees(turned))))
    return np.array(found)


@pytest.mark.slow
def test_places_in_a_photograph_are_those_of_the_printed_sheet() -> None:
    assert (away_mm_and_deg(IDS, 0.0) < [1.2, 1.2]).all()
    assert (
        away_mm_and_deg(IDS[:1], 0.02)[:, 0] > 10.0
    ).all()  # the control: told to lie 2 cm higher than it does
