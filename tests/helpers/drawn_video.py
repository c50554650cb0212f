"""A short video of two robots seen from straight above, drawn in a moment: without lens, noise or perspective."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vibroswarm.lab.tracking.markers import Markers, dictionary_of, usual_markers

PX_PER_M, SIZE, RATE = 480.0, (640, 520), 10.0
ORIGIN_PX = (80.0, 500.0)
MARKERS: Markers = usual_markers(2, 1.0, 1.0, size_mm=62.5, height_mm=0.0)


def centre_m(robot: int, frame: int) -> tuple[float, float]:
    """Where a robot is, at whole pixels: robot 0 goes right, robot 1 goes up."""
    return (0.2 + frame / PX_PER_M, 0.4) if robot == 0 else (0.7, 0.2 + frame / PX_PER_M)


def frames(count: int, *, robots: bool = True, floor: bool = True) -> list[np.ndarray[Any, Any]]:
    """Draw frames, BGR."""
    found = []
    for k in range(count):
        image = np.full((SIZE[1], SIZE[0]), 200, dtype=np.uint8)
        if floor:
            for marker, (x, y, _) in MARKERS.floor.items():
                _paste(image, marker, x, y, 24)
        if robots:
            for robot in range(2):
                _paste(image, robot, *centre_m(robot, k), 30)
        found.append(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    return found


def _paste(image: np.ndarray[Any, Any], marker: int, x_m: float, y_m: float, edge: int) -> None:
    """Put a marker whose upper edge points upwards in the picture."""
    left = round(ORIGIN_PX[0] + PX_PER_M * x_m - edge / 2)
    top = round(ORIGIN_PX[1] - PX_PER_M * y_m - edge / 2)
    image[top - 6 : top + edge + 6, left - 6 : left + edge + 6] = 236
    image[top : top + edge, left : left + edge] = cv2.aruco.generateImageMarker(
        dictionary_of(MARKERS.dictionary), marker, edge
    )


def write(path: Path, pictures: list[np.ndarray[Any, Any]]) -> None:
    """Write a video; .mp4 or .avi."""
    code = cv2.VideoWriter_fourcc(*{".mp4": "mp4v", ".avi": "MJPG"}[path.suffix])
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), code, RATE, (width, height))
    for picture in pictures:
        writer.write(picture)
    writer.release()
